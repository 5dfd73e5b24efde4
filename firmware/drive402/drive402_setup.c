#include "firmware/drive402/drive402_setup.h"

#include <stddef.h>

#include "firmware/fx/bytes.h"

/* Flags in a COB-ID of CiA 301. INVALID: the PDO does not exist. NO_REQUEST, in the COB-ID of a
 * TPDO: remote requests are not answered. */
#define INVALID UINT32_C(0x80000000)
#define NO_REQUEST UINT32_C(0x40000000)

enum { RPDO = 0x200, TPDO = 0x180, SDO_REQUEST = 0x600, SYNC = 0x80 };
enum { COUNTER = 0x1019, ERROR_CODE = 0x603F, MODE_DISPLAY = 0x6061 };

/* If this number of downloads have received two answers each, the master concludes that two nodes
 * have the same id. A single download with two answers is permitted, because a disturbed bus may
 * have doubled a frame. */
enum { DOUBLED_MAX = 2 };

/* Time in ticks between two reads of the objects MODE_DISPLAY or ERROR_CODE: 10 ms. */
enum { READ_TICKS = 15 };

static bool is_node(uint8_t node_id) { return node_id >= 1 && node_id <= 127; }

static bool is_scale(uint32_t number) { return number >= 1 && number <= INT32_MAX; }

static bool are_times(const drive402_config_t *config) {
  return config->heartbeat_ms >= 1 && config->heartbeat_timeout_ms > config->heartbeat_ms &&
         config->sdo_timeout_ms >= 1 && config->wait_ms >= 1;
}

/* Returns true if the entries of the configuration are permitted. A PDO mapping is always compared,
 * so it must not be in `differs`. */
static bool are_entries(const drive402_config_t *config) {
  if ((config->differs & ~DRIVE402_DIFFERS_ALL) != 0) {
    return false;
  }
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

/* The objects that belong to each bit of `without`. The sub-index ANY means every sub-index. The
 * bit of a PDO mapping also includes the COB-ID of the PDO. */
enum { ANY = 0xFF, OBJECT_COUNT = 13 };
static const struct {
  uint16_t index;
  uint8_t sub;
  uint16_t bit;
} objects[OBJECT_COUNT] = {
    {0x1005, ANY, DRIVE402_WITHOUT_SYNC_ID},       {0x1006, ANY, DRIVE402_WITHOUT_SYNC_PERIOD},
    {0x60C2, ANY, DRIVE402_WITHOUT_INTERPOLATION}, {0x6007, ANY, DRIVE402_WITHOUT_ABORT_OPTION},
    {0x1016, ANY, DRIVE402_WITHOUT_CONSUMER},      {0x1017, ANY, DRIVE402_WITHOUT_PRODUCER},
    {0x1600, ANY, DRIVE402_WITHOUT_RPDO_MAPPING},  {0x1400, 1, DRIVE402_WITHOUT_RPDO_MAPPING},
    {0x1400, 2, DRIVE402_WITHOUT_RPDO_TYPE},       {0x1A00, ANY, DRIVE402_WITHOUT_TPDO_MAPPING},
    {0x1800, 1, DRIVE402_WITHOUT_TPDO_MAPPING},    {0x1800, 2, DRIVE402_WITHOUT_TPDO_TYPE},
    {0x6060, ANY, DRIVE402_WITHOUT_MODE},
};

uint16_t drive402_object_bit(uint16_t index, uint8_t sub) {
  uint16_t bit = 0;
  for (uint8_t i = 0; i < OBJECT_COUNT; i++) {
    if (objects[i].index == index && (objects[i].sub == ANY || objects[i].sub == sub)) {
      bit = objects[i].bit;
    }
  }
  return bit;
}

static bool lacks(const drive402_t *master, uint16_t bit) {
  return (master->config->without & bit) != 0;
}

/* Returns true if the drive may refuse the write of this value, because the write is only an
 * intermediate step: the 0 that switches a PDO mapping off, or the 0 in 1006h that a write to 1019h
 * needs. */
static bool is_step(uint16_t index, uint32_t value) {
  return value == 0 && (index == 0x1006 || index == 0x1600 || index == 0x1A00);
}

/* Adds an entry to the list of objects, unless the configuration leaves it out. If the drive does
 * not permit a change of a PDO mapping, the mapping is only compared. */
static void add(drive402_t *master, uint16_t index, uint8_t sub, uint8_t bytes, uint32_t value) {
  const uint16_t bit = drive402_object_bit(index, sub);
  const bool differs = (master->config->differs & bit) != 0 || is_step(index, value);
  const bool is_mapping = (bit & DRIVE402_DIFFERS_ALL) == 0;
  if (lacks(master, bit) && !is_mapping) {
    return;
  }
  const uint32_t own = fx_bit(master->entry_count);
  master->read_only |= lacks(master, bit) ? own : 0;
  master->uncompared |= differs ? own : 0;
  master->entries[master->entry_count] = (drive402_entry_t){index, sub, bytes, value};
  master->entry_count++;
}

/* Adds the entries that map `count` objects to the first RPDO (1400h) or TPDO (1800h). Their order
 * is that of CiA 301: PDO off, transmission type, mapping off, each object, mapping on, PDO on. */
static void add_pdo(drive402_t *master, uint16_t index, uint32_t cob_id, uint8_t type,
                    const uint32_t *mapped, uint8_t count) {
  const uint16_t mapping = (uint16_t)(index + 0x200);
  const bool is_fixed = lacks(master, drive402_object_bit(mapping, 0));
  if (!is_fixed) {
    add(master, index, 1, 4, cob_id | INVALID);
  }
  add(master, index, 2, 1, type);
  if (!is_fixed) {
    add(master, mapping, 0, 1, 0);
  }
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

void drive402_setup_list(drive402_t *master) {
  const drive402_config_t *config = master->config;
  const uint32_t node_id = config->node_id;
  const uint32_t received[2] = {UINT32_C(0x60400010), target_object(config->mode)};
  const uint32_t transmitted[3] = {UINT32_C(0x60410010), UINT32_C(0x60640020),
                                   UINT32_C(0x60770010)};
  const bool has_torque = !lacks(master, DRIVE402_WITHOUT_TORQUE);
  const bool has_flag = !lacks(master, DRIVE402_WITHOUT_REQUEST_BIT);
  add(master, 0x1005, 0, 4, SYNC);
  /* 1019h can be changed only while 1006h is 0 (CiA 301). If a drive does not store these objects,
   * 1006h is 0 anyway. */
  add(master, 0x1006, 0, 4, 0);
  add(master, COUNTER, 0, 1, 0);
  add(master, 0x1006, 0, 4, (uint32_t)config->cycle_ms * 1000);
  add(master, 0x1016, 1, 4, (uint32_t)config->own_node_id * 0x10000 + config->heartbeat_timeout_ms);
  add(master, 0x1017, 0, 2, config->heartbeat_ms);
  add(master, 0x6007, 0, 2, (uint32_t)config->abort_option & 0xFFFFu);
  add_pdo(master, 0x1400, RPDO + node_id, config->rpdo_type, received, 2);
  add_pdo(master, 0x1800, (TPDO + node_id) | (has_flag ? NO_REQUEST : 0), 1, transmitted,
          has_torque ? 3 : 2);
  add(master, 0x60C2, 1, 1, config->cycle_ms);
  add(master, 0x60C2, 2, 1, 0xFD); /* the period is in 10^-3 s */
  add(master, 0x6060, 0, 1, config->mode);
  master->tpdo_bytes = has_torque ? 8 : 6;
  master->needed = (uint16_t)((lacks(master, DRIVE402_WITHOUT_REMOTE) ? 0 : DRIVE402_REMOTE) |
                              (lacks(master, DRIVE402_WITHOUT_FOLLOWS) ? 0 : DRIVE402_FOLLOWS));
}

/* Returns the reason why the last SDO transfer has failed, or DRIVE402_NONE if it has not
 * failed. */
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

/* Stores the reason of a failure together with the object of the present transfer. If the download
 * of the object was refused, the stored abort code is that of the download. */
static void fail(drive402_t *master, uint8_t reason) {
  if (master->reason == DRIVE402_NONE) {
    master->failed_index = master->sdo.entry.index;
    master->failed_sub = master->sdo.entry.sub;
    master->abort_code = master->refused;
    if (reason == DRIVE402_SDO_ABORTED && master->refused == 0) {
      master->abort_code = master->sdo.answer;
    }
  }
  drive402_fail(master, reason);
}

/* Sends the request of the present transfer when it is due. Returns true until the transfer has
 * ended. */
static bool is_waiting(drive402_t *master) {
  if (drive402_sdo_tick(&master->sdo)) {
    can_frame_t *frame =
        drive402_frame(master, (uint16_t)(SDO_REQUEST + master->config->node_id), 8);
    drive402_sdo_request(&master->sdo, fx_ticks_from_ms(master->config->sdo_timeout_ms),
                         frame->data);
  }
  return master->sdo.state == DRIVE402_TRANSFER_ASKS ||
         master->sdo.state == DRIVE402_TRANSFER_WAITING;
}

static const drive402_entry_t *entry_of(const drive402_t *master) {
  const uint8_t extra = master->config->extra_count;
  return (master->entry < extra) ? &master->config->extra[master->entry]
                                 : &master->entries[master->entry - extra];
}

/* `bits` is a set with one bit for each of the master's own entries. Returns true if the bit of the
 * present entry is 1. Extra entries of the configuration have no bit. */
static bool is_marked(const drive402_t *master, uint32_t bits) {
  const uint8_t extra = master->config->extra_count;
  return master->entry >= extra && (bits & fx_bit(master->entry - (uint32_t)extra)) != 0;
}

/* Returns true if the value that was read is the value of the entry. Bit 30 of a COB-ID is ignored,
 * because it only affects remote requests, and the master sends no remote requests. */
static bool is_same(const drive402_sdo_t *sdo) {
  uint8_t wanted[4] = {0, 0, 0, 0};
  fx_store_le(wanted, sdo->entry.value, sdo->entry.bytes);
  const uint32_t differs = sdo->answer ^ fx_load_le(wanted, sdo->entry.bytes);
  const bool is_cob_id =
      (sdo->entry.index == 0x1400 || sdo->entry.index == 0x1800) && sdo->entry.sub == 1;
  return (is_cob_id ? differs & ~NO_REQUEST : differs) == 0;
}

/* Starts the SDO transfer of the present entry of the configuration. Returns true if there are no
 * more entries. */
static bool start_entry(drive402_t *master) {
  master->refused = 0;
  if (master->entry >= (uint32_t)master->config->extra_count + master->entry_count) {
    return true;
  }
  drive402_sdo_start(&master->sdo, entry_of(master), !is_marked(master, master->read_only));
  return false;
}

/* Acts on an answered transfer: reads back an object that was written or whose write was refused,
 * or continues with the next entry. If the object already has the value, it need not be written.
 * Returns true after the last entry. */
static bool next_transfer(drive402_t *master) {
  const bool is_aborted = master->sdo.state == DRIVE402_TRANSFER_ABORTED;
  const bool is_compared = !is_marked(master, master->uncompared);
  if (master->sdo.writes != 0 && is_compared) {
    master->refused = is_aborted ? master->sdo.answer : 0;
    drive402_sdo_start(&master->sdo, entry_of(master), false);
    return false;
  }
  /* A drive without object 1019h does not count SYNC messages. */
  if (is_compared && is_aborted && master->sdo.entry.index != COUNTER) {
    fail(master, DRIVE402_SDO_ABORTED);
    return false;
  }
  if (is_compared && !is_aborted && !is_same(&master->sdo)) {
    fail(master, (master->refused != 0) ? DRIVE402_SDO_ABORTED : DRIVE402_SDO_DIFFERS);
    return false;
  }
  master->entry++;
  return start_entry(master);
}

bool drive402_setup_tick(drive402_t *master) {
  bool is_done = false;
  if (master->sdo.state == DRIVE402_TRANSFER_IDLE) {
    is_done = start_entry(master);
  }
  if (is_waiting(master)) {
    return is_done;
  }
  if (master->sdo.doubled >= DOUBLED_MAX) {
    drive402_fail(master, DRIVE402_DOUBLED);
  } else if (master->sdo.state == DRIVE402_TRANSFER_DONE ||
             master->sdo.state == DRIVE402_TRANSFER_ABORTED) {
    is_done = next_transfer(master);
  } else {
    fail(master, transfer_reason(master));
  }
  return is_done;
}

/* Acts on the end of a read of 6061h or 603Fh. 603Fh is optional, so a failed read of 603Fh is no
 * failure. */
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
  if (master->read_ticks == 0 && master->sdo.state == DRIVE402_TRANSFER_IDLE) {
    drive402_sdo_start(&master->sdo, (master->state == DRIVE402_FAULT) ? &error : &mode, false);
  }
  if (is_waiting(master) || master->sdo.state == DRIVE402_TRANSFER_IDLE) {
    return;
  }
  watched(master);
  master->sdo.state = DRIVE402_TRANSFER_IDLE;
  master->read_ticks = READ_TICKS;
}
