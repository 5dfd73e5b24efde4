#include "firmware/canopen/lss.h"

#include <stddef.h>

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"

/* Command specifiers of LSS, as CiA 305 defines them. */
enum {
  SWITCH_GLOBAL = 0x04,
  CONFIGURE_NODE_ID = 0x11,
  CONFIGURE_BIT_TIMING = 0x13,
  ACTIVATE_BIT_TIMING = 0x15,
  STORE_CONFIGURATION = 0x17,
  /* first of the four commands that select a node, in this order: vendor, product, revision, serial
   * number */
  SELECT_FIRST = 0x40,
  SELECT_LAST = 0x43,
  SELECTED = 0x44,
  /* first of the six commands that identify a node, in this order: vendor, product, lowest and
   * highest revision, lowest and highest serial number */
  IDENTIFY_FIRST = 0x46,
  IDENTIFY_LAST = 0x4B,
  IDENTIFY_NON_CONFIGURED = 0x4C,
  IDENTIFIED = 0x4F,
  IDENTIFIED_NON_CONFIGURED = 0x50,
  FAST_SCAN = 0x51,
  /* command that reads the first field of the LSS address; the fields have the order of
   * SELECT_FIRST */
  INQUIRE_FIRST = 0x5A,
  INQUIRE_LAST = 0x5D,
  INQUIRE_NODE_ID = 0x5E
};

enum { WAITING, CONFIGURATION };
enum { ADDRESS_PARTS = 4, IDENTIFY_PARTS = 6 };
enum { SCAN_ALL = 128, SCAN_BITS = 32 };
enum { OK = 0, OUT_OF_RANGE = 1, SPECIFIC = 255, SPECIFIC_FIXED = 1 };

/* Phases of a change of the bit rate: no change, switch delay before the new bit rate, switch delay
 * after the new bit rate. */
enum { NO_SILENCE, BEFORE, AFTER };

/* Bit rates of CiA 305, table 0, in kbit/s; 0 marks a reserved index. */
static const uint16_t rates_kbit_s[LSS_RATES] = {1000, 800, 500, 250, 125, 0, 50, 20, 10};

uint16_t lss_kbit_s(uint8_t rate) { return rates_kbit_s[rate]; }

uint8_t lss_rate_of(uint32_t kbit_s) {
  uint8_t rate = 0;
  while (rate < LSS_RATES && (rates_kbit_s[rate] != kbit_s || kbit_s == 0)) {
    rate++;
  }
  return rate;
}

bool lss_has_rate(const canopen_t *canopen, uint8_t rate) {
  const uint16_t rates = canopen->lss.rates;
  return rate < LSS_RATES && rates_kbit_s[rate] != 0 && (rates == 0 || (rates & fx_bit(rate)) != 0);
}

void lss_restart(canopen_t *canopen) {
  lss_t *lss = &canopen->lss;
  lss->state = WAITING;
  lss->selected = 0;
  lss->identified = 0;
  lss->scanned = 0;
}

void lss_init(canopen_t *canopen, uint8_t node_id, bool fixed, uint8_t rate, uint16_t rates) {
  canopen->lss = (lss_t){.rates = rates, .node_id = node_id, .fixed = fixed ? 1 : 0};
  canopen->lss.rate = lss_has_rate(canopen, rate) ? rate : LSS_RATE_DEFAULT;
  canopen->lss.next_rate = canopen->lss.rate;
  lss_restart(canopen);
}

static void answer(canopen_t *canopen, uint8_t command, uint32_t value) {
  can_frame_t *frame = can_output_add(&canopen->output, LSS_ANSWER_ID, 8, CAN_OUTPUT_KEEP_SDO);
  if (frame != NULL) {
    frame->data[0] = command;
    fx_store_le(&frame->data[1], value, 4);
  }
}

static uint32_t part_of_address(const canopen_t *canopen, uint8_t part) {
  const uint32_t parts[ADDRESS_PARTS] = {canopen->signals.vendor_id, canopen->signals.product_code,
                                         canopen->signals.revision_number,
                                         canopen->signals.serial_number};
  return parts[part];
}

/* Returns true if the node has no node id and LSS has given it no node id. */
static bool is_non_configured(const canopen_t *canopen) {
  return canopen->node_id == LSS_NO_NODE_ID && canopen->lss.node_id == LSS_NO_NODE_ID;
}

/* Counts the parts of the LSS address that have matched one after the other. `part` is the number
 * of the part that was compared now, and `count` parts have matched before. Returns the new count,
 * which is 0 if this part does not match or is not the next one. */
static uint8_t matched(uint8_t count, uint8_t part, bool matches) {
  const bool follows = part == 0 || count == part;
  return (uint8_t)((follows && matches) ? part + 1 : 0);
}

static void select_by(canopen_t *canopen, uint8_t part, uint32_t value) {
  lss_t *lss = &canopen->lss;
  lss->selected = matched(lss->selected, part, value == part_of_address(canopen, part));
  if (lss->selected == ADDRESS_PARTS) {
    lss->selected = 0;
    lss->state = CONFIGURATION;
    answer(canopen, SELECTED, 0);
  }
}

static void identify(canopen_t *canopen, uint8_t part, uint32_t value) {
  static const uint8_t parts[IDENTIFY_PARTS] = {0, 1, 2, 2, 3, 3};
  const uint32_t own = part_of_address(canopen, parts[part]);
  const bool lowest = part == 2 || part == 4;
  const bool highest = part == 3 || part == 5;
  const bool matches = lowest ? own >= value : highest ? own <= value : own == value;
  lss_t *lss = &canopen->lss;
  lss->identified = matched(lss->identified, part, matches);
  if (lss->identified == IDENTIFY_PARTS) {
    lss->identified = 0;
    answer(canopen, IDENTIFIED, 0);
  }
}

/* Processes a request of fast scan. The node compares one part of its LSS address with `value`,
 * from bit `check` upwards. The node answers if these bits are equal. So the master finds each part
 * of the address bit by bit, beginning with the highest bit. */
static void scan(canopen_t *canopen, const uint8_t *data) {
  lss_t *lss = &canopen->lss;
  const uint32_t value = fx_load_le32(&data[1]);
  const uint8_t check = data[5];
  const uint8_t part = data[6];
  const uint8_t next = data[7];
  if (!is_non_configured(canopen)) {
    return;
  }
  if (check == SCAN_ALL) {
    lss->scanned = 0;
    answer(canopen, IDENTIFIED, 0);
    return;
  }
  if (check >= SCAN_BITS || part >= ADDRESS_PARTS || next >= ADDRESS_PARTS ||
      part != lss->scanned || (value ^ part_of_address(canopen, part)) > fx_bit(check) - 1) {
    return;
  }
  lss->scanned = next;
  if (check == 0 && next < part) {
    lss->state = CONFIGURATION;
  }
  answer(canopen, IDENTIFIED, 0);
}

static lss_result_t switch_global(canopen_t *canopen, uint8_t state) {
  lss_t *lss = &canopen->lss;
  if (state > CONFIGURATION) {
    return LSS_NOTHING;
  }
  const bool leaves = lss->state == CONFIGURATION && state == WAITING;
  lss->state = state;
  lss->selected = 0;
  const bool is_given = canopen->node_id == LSS_NO_NODE_ID && lss->node_id != LSS_NO_NODE_ID;
  return (leaves && is_given) ? LSS_RESET : LSS_NOTHING;
}

static void configure_node_id(canopen_t *canopen, uint8_t node_id) {
  lss_t *lss = &canopen->lss;
  uint32_t error = OK;
  if (node_id == 0 || (node_id > 127 && node_id != LSS_NO_NODE_ID)) {
    error = OUT_OF_RANGE;
  } else if (lss->fixed != 0) {
    error = SPECIFIC + SPECIFIC_FIXED * 256;
  } else {
    lss->node_id = node_id;
  }
  answer(canopen, CONFIGURE_NODE_ID, error);
}

static void configure_bit_timing(canopen_t *canopen, uint8_t table, uint8_t rate) {
  const bool fits = table == 0 && lss_has_rate(canopen, rate);
  if (fits) {
    canopen->lss.next_rate = rate;
  }
  answer(canopen, CONFIGURE_BIT_TIMING, fits ? OK : OUT_OF_RANGE);
}

static lss_result_t activate_bit_timing(canopen_t *canopen, uint32_t delay_ms) {
  lss_t *lss = &canopen->lss;
  lss->silence = BEFORE;
  lss->delay_ticks = fx_ticks_from_ms(delay_ms);
  lss->ticks = lss->delay_ticks;
  return LSS_SILENCE;
}

static lss_result_t configure(canopen_t *canopen, const uint8_t *data) {
  const uint8_t command = data[0];
  switch (command) {
    case CONFIGURE_NODE_ID:
      configure_node_id(canopen, data[1]);
      break;
    case CONFIGURE_BIT_TIMING:
      configure_bit_timing(canopen, data[1], data[2]);
      break;
    case ACTIVATE_BIT_TIMING:
      return activate_bit_timing(canopen, fx_load_le(&data[1], 2));
    case STORE_CONFIGURATION:
      if (canopen->lss.store == LSS_STORE_IDLE) {
        canopen->lss.store = LSS_STORE_REQUESTED;
      }
      break;
    case INQUIRE_NODE_ID:
      answer(canopen, command, canopen->node_id);
      break;
    default:
      if (command >= INQUIRE_FIRST && command <= INQUIRE_LAST) {
        answer(canopen, command, part_of_address(canopen, (uint8_t)(command - INQUIRE_FIRST)));
      }
      break;
  }
  return LSS_NOTHING;
}

lss_result_t lss_receive(canopen_t *canopen, const can_frame_t *frame) {
  const uint8_t *data = frame->data;
  const uint8_t command = data[0];
  if (frame->length != 8) {
    return LSS_NOTHING;
  }
  if (command == SWITCH_GLOBAL) {
    return switch_global(canopen, data[1]);
  }
  if (command >= IDENTIFY_FIRST && command <= IDENTIFY_LAST) {
    identify(canopen, (uint8_t)(command - IDENTIFY_FIRST), fx_load_le32(&data[1]));
  } else if (command == IDENTIFY_NON_CONFIGURED) {
    if (is_non_configured(canopen)) {
      answer(canopen, IDENTIFIED_NON_CONFIGURED, 0);
    }
  } else if (canopen->lss.state == CONFIGURATION) {
    return configure(canopen, data);
  } else if (command >= SELECT_FIRST && command <= SELECT_LAST) {
    select_by(canopen, (uint8_t)(command - SELECT_FIRST), fx_load_le32(&data[1]));
  } else if (command == FAST_SCAN) {
    scan(canopen, data);
  }
  return LSS_NOTHING;
}

void lss_stored(canopen_t *canopen, uint8_t result) {
  canopen->lss.store = LSS_STORE_IDLE;
  answer(canopen, STORE_CONFIGURATION, result);
}

bool lss_tick(canopen_t *canopen, uint32_t ticks) {
  lss_t *lss = &canopen->lss;
  if (lss->silence == NO_SILENCE) {
    return false;
  }
  if (lss->ticks > ticks) {
    lss->ticks -= ticks;
    return false;
  }
  if (lss->silence == BEFORE) {
    lss->rate = lss->next_rate;
    lss->ticks = lss->delay_ticks;
    lss->silence = AFTER;
    return false;
  }
  lss->silence = NO_SILENCE;
  return true;
}
