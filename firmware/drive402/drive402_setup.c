#include "firmware/drive402/drive402_setup.h"

#include <stddef.h>

#include "firmware/fx/bytes.h"

/* COB-ID flags of CiA 301: the PDO does not exist; no remote request is answered (TPDO). */
#define INVALID UINT32_C(0x80000000)
#define NO_REQUEST UINT32_C(0x40000000)

enum { RPDO = 0x200, TPDO = 0x180, SDO_REQUEST = 0x600, SYNC = 0x80 };
enum { ERROR_CODE = 0x603F, MODE_DISPLAY = 0x6061 };

/* Ticks between the end of a read of MODE_DISPLAY or ERROR_CODE and the next one: 10 ms. */
enum { READ_TICKS = 15 };

static bool is_node(uint8_t node_id) { return node_id >= 1 && node_id <= 127; }

static bool is_scale(uint32_t number) { return number >= 1 && number <= INT32_MAX; }

static bool are_times(const drive402_config_t *config) {
  return config->heartbeat_ms >= 1 && config->heartbeat_timeout_ms > config->heartbeat_ms &&
         config->sdo_timeout_ms >= 1 && config->wait_ms >= 1;
}

static bool are_entries(const drive402_config_t *config) {
  for (uint8_t i = 0; i < config->extra_count; i++) {
    const uint8_t bytes = config->extra[i].bytes;
    if (bytes != 1 && bytes != 2 && bytes != 4) {
      return false;
    }
  }
  return true;
}

static bool is_cycle(uint8_t cycle_ms) {
  return cycle_ms >= 2 && cycle_ms <= 100 && (cycle_ms & 1) == 0;
}

static uint8_t check_target(const drive402_config_t *config) {
  const int32_t most = (config->mode == DRIVE402_CST) ? INT16_MAX : INT32_MAX - 5;
  if (!is_scale(config->scale_num) || !is_scale(config->scale_den) ||
      config->scale_shift > DRIVE402_SHIFT_MAX) {
    return DRIVE402_REFUSED_SCALE;
  }
  if (config->target_max < 1 || config->target_max > most) {
    return DRIVE402_REFUSED_TARGET;
  }
  return DRIVE402_NONE;
}

uint8_t drive402_setup_check(const drive402_config_t *config) {
  if (!is_node(config->node_id) || !is_node(config->own_node_id) ||
      config->node_id == config->own_node_id) {
    return DRIVE402_REFUSED_NODE;
  }
  if (config->mode < DRIVE402_CSP || config->mode > DRIVE402_CST) {
    return DRIVE402_REFUSED_MODE;
  }
  if (!is_cycle(config->cycle_ms)) {
    return DRIVE402_REFUSED_CYCLE;
  }
  if (config->rpdo_type != 1 && config->rpdo_type < 254) {
    return DRIVE402_REFUSED_TYPE;
  }
  if (!are_times(config)) {
    return DRIVE402_REFUSED_TIMES;
  }
  if (!are_entries(config)) {
    return DRIVE402_REFUSED_ENTRIES;
  }
  return check_target(config);
}

static void add(drive402_t *master, uint16_t index, uint8_t sub, uint8_t bytes, uint32_t value) {
  drive402_entry_t *entry = &master->entries[master->entry_count];
  master->entry_count++;
  entry->index = index;
  entry->sub = sub;
  entry->bytes = bytes;
  entry->value = value;
}

/* Maps `count` objects to the first RPDO (1400h) or TPDO (1800h) in the order of CiA 301: the PDO
 * off, its type, the mapping off, each object, the mapping on, the PDO on. */
static void add_pdo(drive402_t *master, uint16_t index, uint32_t cob_id, uint8_t type,
                    const uint32_t *mapped, uint8_t count) {
  const uint16_t mapping = (uint16_t)(index + 0x200);
  add(master, index, 1, 4, cob_id | INVALID);
  add(master, index, 2, 1, type);
  add(master, mapping, 0, 1, 0);
  for (uint8_t i = 0; i < count; i++) {
    add(master, mapping, (uint8_t)(i + 1), 4, mapped[i]);
  }
  add(master, mapping, 0, 1, count);
  add(master, index, 1, 4, cob_id);
}

static uint32_t target_object(uint8_t mode) {
  switch (mode) {
    case DRIVE402_CSP:
      return UINT32_C(0x607A0020);
    case DRIVE402_CSV:
      return UINT32_C(0x60FF0020);
    default:
      return UINT32_C(0x60710010);
  }
}

static bool has(const drive402_config_t *config, uint8_t without) {
  return (config->without & without) == 0;
}

void drive402_setup_list(drive402_t *master) {
  static const uint32_t transmitted[] = {UINT32_C(0x60410010), UINT32_C(0x60640020),
                                         UINT32_C(0x60770010)};
  const drive402_config_t *config = master->config;
  const uint32_t received[] = {UINT32_C(0x60400010), target_object(config->mode)};
  const uint32_t node_id = config->node_id;
  if (has(config, DRIVE402_WITHOUT_SYNC_ID)) {
    add(master, 0x1005, 0, 4, SYNC);
  }
  if (has(config, DRIVE402_WITHOUT_SYNC_PERIOD)) {
    add(master, 0x1006, 0, 4, (uint32_t)config->cycle_ms * 1000);
  }
  add(master, 0x1016, 1, 4, (uint32_t)config->own_node_id * 0x10000 + config->heartbeat_timeout_ms);
  add(master, 0x1017, 0, 2, config->heartbeat_ms);
  if (has(config, DRIVE402_WITHOUT_ABORT_OPTION)) {
    add(master, 0x6007, 0, 2, (uint32_t)config->abort_option & 0xFFFFu);
  }
  add_pdo(master, 0x1400, RPDO + node_id, config->rpdo_type, received, 2);
  add_pdo(master, 0x1800, (TPDO + node_id) | NO_REQUEST, 1, transmitted, 3);
  if (has(config, DRIVE402_WITHOUT_INTERPOLATION)) {
    add(master, 0x60C2, 1, 1, config->cycle_ms);
    add(master, 0x60C2, 2, 1, 0xFD); /* 10^-3 s */
  }
  add(master, 0x6060, 0, 1, config->mode);
}

/* Returns why the transfer that has ended has failed, or DRIVE402_NONE. */
static uint8_t transfer_reason(const drive402_t *master) {
  switch (master->sdo.state) {
    case DRIVE402_TRANSFER_TIMED_OUT:
      return DRIVE402_SDO_TIMEOUT;
    case DRIVE402_TRANSFER_ABORTED:
      return DRIVE402_SDO_ABORTED;
    case DRIVE402_TRANSFER_UNEXPECTED:
      return DRIVE402_SDO_UNEXPECTED;
    default:
      return DRIVE402_NONE;
  }
}

/* Keeps the object of the present transfer with the reason of its failure. */
static void fail(drive402_t *master, uint8_t reason) {
  if (master->reason == DRIVE402_NONE) {
    master->failed_index = master->sdo.entry.index;
    master->failed_sub = master->sdo.entry.sub;
    master->abort_code = (reason == DRIVE402_SDO_ABORTED) ? master->sdo.answer : 0;
  }
  drive402_fail(master, reason);
}

static void request(drive402_t *master, const drive402_entry_t *entry, bool writes) {
  can_frame_t *frame = drive402_frame(master, (uint16_t)(SDO_REQUEST + master->config->node_id), 8);
  master->sdo.ticks = fx_ticks_from_ms(master->config->sdo_timeout_ms);
  if (writes) {
    drive402_sdo_write(&master->sdo, entry, frame->data);
  } else {
    drive402_sdo_read(&master->sdo, entry, frame->data);
  }
}

static const drive402_entry_t *entry_of(const drive402_t *master) {
  const uint8_t extra = master->config->extra_count;
  return (master->entry < extra) ? &master->config->extra[master->entry]
                                 : &master->entries[master->entry - extra];
}

/* The masked value of an entry, of which only its bytes count. */
static bool is_same(const drive402_sdo_t *sdo) {
  uint8_t wanted[4] = {0, 0, 0, 0};
  fx_store_le(wanted, sdo->entry.value, sdo->entry.bytes);
  return sdo->answer == fx_load_le(wanted, sdo->entry.bytes);
}

/* Acts on a transfer that is done: reads back what was written, or goes on to the next entry. */
static bool next_transfer(drive402_t *master) {
  if (master->sdo.writes != 0) {
    request(master, entry_of(master), false);
    return false;
  }
  if (!is_same(&master->sdo)) {
    fail(master, DRIVE402_SDO_DIFFERS);
    return false;
  }
  master->sdo.state = DRIVE402_TRANSFER_IDLE;
  master->entry++;
  if (master->entry >= (uint32_t)master->config->extra_count + master->entry_count) {
    return true;
  }
  request(master, entry_of(master), true);
  return false;
}

bool drive402_setup_tick(drive402_t *master) {
  drive402_sdo_tick(&master->sdo);
  switch (master->sdo.state) {
    case DRIVE402_TRANSFER_IDLE:
      request(master, entry_of(master), true);
      return false;
    case DRIVE402_TRANSFER_WAITING:
      return false;
    case DRIVE402_TRANSFER_DONE:
      return next_transfer(master);
    default:
      fail(master, transfer_reason(master));
      return false;
  }
}

/* Acts on the end of a read. 603Fh is optional, so nothing depends on it. */
static void watched(drive402_t *master) {
  const uint8_t reason = transfer_reason(master);
  if (master->sdo.entry.index == ERROR_CODE) {
    if (reason == DRIVE402_NONE && master->sdo.answer != 0) {
      master->error_code = (uint16_t)master->sdo.answer;
    }
    return;
  }
  if (reason != DRIVE402_NONE) {
    fail(master, reason);
    return;
  }
  master->mode_displayed = (master->sdo.answer == master->config->mode) ? 1 : 0;
  if (master->was_on != 0 && master->mode_displayed == 0) {
    fail(master, DRIVE402_MODE_LOST);
  }
}

void drive402_setup_watch(drive402_t *master) {
  static const drive402_entry_t mode = {MODE_DISPLAY, 0, 1, 0};
  static const drive402_entry_t error = {ERROR_CODE, 0, 2, 0};
  drive402_sdo_tick(&master->sdo);
  if (master->sdo.state == DRIVE402_TRANSFER_WAITING) {
    return;
  }
  if (master->sdo.state != DRIVE402_TRANSFER_IDLE) {
    watched(master);
    master->sdo.state = DRIVE402_TRANSFER_IDLE;
    master->read_ticks = READ_TICKS;
  }
  if (master->read_ticks == 0) {
    request(master, (master->state == DRIVE402_FAULT) ? &error : &mode, false);
  }
}
