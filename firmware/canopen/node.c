#include "firmware/canopen/node.h"

#include <stddef.h>

#include "firmware/fx/fx.h"
#include "firmware/objects/value.h"

/* Identifiers and commands of network management. */
enum { ID_NMT = 0x000, ID_HEARTBEAT = 0x700, ID_HEARTBEAT_LAST = 0x77F };
enum {
  NMT_START = 1,
  NMT_STOP = 2,
  NMT_PRE_OPERATIONAL = 128,
  NMT_RESET_NODE = 129,
  NMT_RESET_COMMUNICATION = 130
};

/* What canopen_tick_begin() left: all, or what follows the PDOs. */
enum { LEFT_NOTHING = 0, LEFT_OUTPUT = 1, LEFT_ALL = 2 };

/* 1029h: what a communication error does to the state. */
enum { BEHAVIOUR_PRE_OPERATIONAL = 0, BEHAVIOUR_STOPPED = 2 };

/* --- power-up --------------------------------------------------------------------------------- */

/* Adds the node id to the COB-IDs of one block whose defaults depend on it. */
static void add_node_id(void *structure, uint8_t block, uint8_t node_id) {
  for (uint16_t i = AXIS_OBJ_NONE + 1; i < AXIS_OBJ_COUNT; i++) {
    const axis_object_t *object = &axis_objects[i];
    if (object->block == block && object->node_id != 0) {
      const uint32_t value = (uint32_t)object->initial + node_id;
      value_store(structure, object->offset, object->type, fx_s32_from_u32(value));
    }
  }
}

/* `value` is not read before it was sent or received once, `places` not before they were mapped. */
static void init_pdo(pdo_t *pdo) {
  pdo->bits = 0;
  pdo->pending = 0;
  pdo->syncs = 0;
  pdo->told = 0;
}

void canopen_init(canopen_t *canopen, uint8_t node_id) {
  value_store_defaults(&canopen->params, AXIS_BLOCK_CANOPEN_PARAMETER);
  value_store_defaults(&canopen->signals, AXIS_BLOCK_CANOPEN_SIGNAL);
  add_node_id(&canopen->params, AXIS_BLOCK_CANOPEN_PARAMETER, node_id);
  add_node_id(&canopen->signals, AXIS_BLOCK_CANOPEN_SIGNAL, node_id);
  canopen->signals.nmt_state = AXIS_NMT_STATE_INITIALISING;
  canopen_timers_init(&canopen->timers);
  can_output_clear(&canopen->output);
  canopen->output.lost = 0;
  canopen->output.closed = 0;
  for (uint8_t i = 0; i < CANOPEN_PDOS; i++) {
    init_pdo(&canopen->rpdo[i]);
    init_pdo(&canopen->tpdo[i]);
  }
  canopen->rpdos_late = 0;
  canopen->rpdos_waiting = 0;
  canopen->tpdos_watched = 0;
  canopen->tpdos_timed = 0;
  canopen->tpdos_inhibited = 0;
  canopen->heartbeats_lost = 0;
  canopen->left = LEFT_NOTHING;
  canopen->late = 0;
  sdo_drop(canopen);
  canopen->emcy.drive_code = 0;
  canopen->emcy.count = 0;
  canopen->emcy.overrun_told = 0;
  canopen->sync_told = 0;
  canopen->bus = CAN_BUS_ACTIVE;
  canopen->reset = CANOPEN_RESET_NONE;
  canopen->node_id = node_id;
}

static void start_heartbeat(canopen_t *canopen) {
  canopen_timer_start(&canopen->timers, CANOPEN_TIMER_HEARTBEAT,
                      fx_ticks_from_ms(canopen->params.producer_heartbeat_time));
}

static void send_state(canopen_t *canopen, uint8_t state) {
  can_frame_t *frame = can_output_add(&canopen->output, (uint16_t)(ID_HEARTBEAT + canopen->node_id),
                                      1, CAN_OUTPUT_KEEP_NMT);
  if (frame != NULL) {
    frame->data[0] = state;
  }
}

void canopen_start(canopen_t *canopen) {
  /* The boot-up message is a heartbeat of the state that is left with it. */
  send_state(canopen, AXIS_NMT_STATE_INITIALISING);
  canopen->signals.nmt_state = AXIS_NMT_STATE_PRE_OPERATIONAL;
  start_heartbeat(canopen);
  pdo_start(canopen);
}

/* --- states ----------------------------------------------------------------------------------- */

static void enter(canopen_t *canopen, uint8_t state) {
  const uint8_t previous = canopen->signals.nmt_state;
  if (state == previous) {
    return;
  }
  canopen->signals.nmt_state = state;
  if (state == AXIS_NMT_STATE_OPERATIONAL || previous == AXIS_NMT_STATE_OPERATIONAL) {
    pdo_operational(canopen, state == AXIS_NMT_STATE_OPERATIONAL);
  }
  if (state != AXIS_NMT_STATE_PRE_OPERATIONAL && state != AXIS_NMT_STATE_OPERATIONAL) {
    sdo_drop(canopen);
  }
}

/* Owners whose only way in is this bus. */
static void lose_masters(fw_t *fw, uint8_t fault) {
  fw_source_lost(fw, FW_SOURCE_CANOPEN, fault);
  fw_source_lost(fw, FW_SOURCE_LCM, fault);
}

/* The owner can no longer reach an axis that it left active. The drive says whether it is: of a
 * controlword that came just before, active_mode knows nothing yet. */
static void leave_axis(fw_t *fw) { lose_masters(fw, AXIS_FAULT_SOURCE_LOST); }

static void communication_error(canopen_t *canopen) {
  const uint8_t behaviour = canopen->params.error_behaviour;
  const uint8_t state = canopen->signals.nmt_state;
  if (behaviour == BEHAVIOUR_STOPPED && state != AXIS_NMT_STATE_INITIALISING) {
    enter(canopen, AXIS_NMT_STATE_STOPPED);
  } else if (behaviour == BEHAVIOUR_PRE_OPERATIONAL && state == AXIS_NMT_STATE_OPERATIONAL) {
    enter(canopen, AXIS_NMT_STATE_PRE_OPERATIONAL);
  }
}

static void ask_reset(canopen_t *canopen, fw_t *fw, uint8_t reset) {
  leave_axis(fw);
  /* The reset empties the output. */
  fw_can_count_lost(fw, canopen->output.lost);
  canopen->output.lost = 0;
  enter(canopen, AXIS_NMT_STATE_INITIALISING);
  canopen->reset = reset;
}

uint8_t canopen_take_reset(canopen_t *canopen) {
  const uint8_t reset = canopen->reset;
  canopen->reset = CANOPEN_RESET_NONE;
  return reset;
}

/* --- what comes in ---------------------------------------------------------------------------- */

static void receive_nmt(canopen_t *canopen, fw_t *fw, const can_frame_t *frame) {
  const uint8_t node = frame->data[1];
  if (frame->length != 2 || (node != 0 && node != canopen->node_id)) {
    return;
  }
  switch (frame->data[0]) {
    case NMT_START:
      enter(canopen, AXIS_NMT_STATE_OPERATIONAL);
      break;
    case NMT_STOP:
      leave_axis(fw);
      enter(canopen, AXIS_NMT_STATE_STOPPED);
      break;
    case NMT_PRE_OPERATIONAL:
      enter(canopen, AXIS_NMT_STATE_PRE_OPERATIONAL);
      break;
    case NMT_RESET_NODE:
      ask_reset(canopen, fw, CANOPEN_RESET_NODE);
      break;
    case NMT_RESET_COMMUNICATION:
      ask_reset(canopen, fw, CANOPEN_RESET_COMMUNICATION);
      break;
    default:
      return;
  }
}

static void receive_sync(canopen_t *canopen, fw_t *fw, const can_frame_t *frame) {
  if (frame->length != 0) {
    if (canopen->sync_told == 0) {
      canopen->sync_told = 1;
      emcy_raise(canopen, AXIS_ERROR_CODE_SYNC_LENGTH, frame->length);
    }
    return;
  }
  canopen->sync_told = 0;
  canopen->signals.sync_count = (uint16_t)(canopen->signals.sync_count + 1);
  if (canopen->signals.nmt_state == AXIS_NMT_STATE_OPERATIONAL) {
    pdo_sync(canopen, fw);
  }
}

/* An entry of 1016h, taken apart; the node is 0 if it watches none. */
static uint8_t watched_node(uint32_t entry) {
  const uint32_t node = fx_field(entry, 16, 8);
  return (uint8_t)((fx_field(entry, 0, 16) != 0 && node <= 127) ? node : 0);
}

static void heartbeat_found(canopen_t *canopen, uint8_t i) {
  if (canopen_has(canopen->heartbeats_lost, i)) {
    canopen_drop(&canopen->heartbeats_lost, i);
    emcy_raise(canopen, AXIS_ERROR_CODE_NONE, 0);
  }
}

static void receive_heartbeat(canopen_t *canopen, fw_t *fw, const can_frame_t *frame) {
  const uint32_t node = (uint32_t)frame->id - ID_HEARTBEAT;
  if (frame->length != 1 || node == 0) {
    return;
  }
  for (uint8_t i = 0; i < CANOPEN_HEARTBEATS; i++) {
    const uint32_t entry = canopen->params.consumer_heartbeat[i];
    if (watched_node(entry) == node) {
      heartbeat_found(canopen, i);
      canopen_timer_start(&canopen->timers, CANOPEN_TIMER_CONSUMER + (uint32_t)i,
                          fx_ticks_from_ms(fx_field(entry, 0, 16)));
      /* A boot-up message: who enabled the axis knows nothing of it any more. */
      if (frame->data[0] == AXIS_NMT_STATE_INITIALISING) {
        fw_source_lost(fw, FW_SOURCE_CANOPEN, AXIS_FAULT_SOURCE_LOST);
      }
    }
  }
}

/* Whether the frame was a request to an SDO server. */
static bool receive_sdo(canopen_t *canopen, fw_t *fw, const can_frame_t *frame) {
  const canopen_signals_t *signals = &canopen->signals;
  const uint32_t requests[CANOPEN_SDOS] = {signals->sdo_server_receive, signals->sdo_modbus_receive,
                                           signals->sdo_lcm_receive};
  for (uint8_t i = 0; i < CANOPEN_SDOS; i++) {
    if (requests[i] == frame->id) {
      sdo_receive(canopen, fw, i, frame);
      return true;
    }
  }
  return false;
}

void canopen_receive(canopen_t *canopen, fw_t *fw, const can_frame_t *frame) {
  if (frame->remote != 0 || frame->length > 8 ||
      canopen->signals.nmt_state == AXIS_NMT_STATE_INITIALISING) {
    return;
  }
  if (frame->id == ID_NMT) {
    receive_nmt(canopen, fw, frame);
    return;
  }
  if (frame->id >= ID_HEARTBEAT && frame->id <= ID_HEARTBEAT_LAST) {
    receive_heartbeat(canopen, fw, frame);
    return;
  }
  if (canopen->signals.nmt_state == AXIS_NMT_STATE_STOPPED) {
    return;
  }
  if (frame->id == canopen_can_id(canopen->params.sync_cob_id)) {
    receive_sync(canopen, fw, frame);
  } else if (!receive_sdo(canopen, fw, frame) &&
             canopen->signals.nmt_state == AXIS_NMT_STATE_OPERATIONAL) {
    pdo_receive(canopen, fw, frame);
  }
}

/* --- the tick --------------------------------------------------------------------------------- */

static void heartbeat_missed(canopen_t *canopen, fw_t *fw, uint8_t i) {
  /* It was not lost before: what runs out was started by a heartbeat. */
  canopen_put(&canopen->heartbeats_lost, i);
  emcy_raise(canopen, AXIS_ERROR_CODE_HEARTBEAT_LOST,
             watched_node(canopen->params.consumer_heartbeat[i]));
  fw_source_lost(fw, FW_SOURCE_CANOPEN, AXIS_FAULT_HEARTBEAT_LOST);
  communication_error(canopen);
}

static void run_out(canopen_t *canopen, fw_t *fw, uint8_t timer) {
  if (timer == CANOPEN_TIMER_HEARTBEAT) {
    send_state(canopen, canopen->signals.nmt_state);
    start_heartbeat(canopen);
  } else if (timer >= CANOPEN_TIMER_SDO) {
    sdo_timeout(canopen, (uint8_t)(timer - CANOPEN_TIMER_SDO));
  } else if (timer >= CANOPEN_TIMER_RPDO) {
    pdo_late(canopen, fw, (uint8_t)(timer - CANOPEN_TIMER_RPDO));
  } else if (timer >= CANOPEN_TIMER_CONSUMER) {
    heartbeat_missed(canopen, fw, (uint8_t)(timer - CANOPEN_TIMER_CONSUMER));
  } /* That the inhibit time of emergencies no longer runs is enough. */
}

static void serve_timers(canopen_t *canopen, fw_t *fw) {
  for (uint32_t due = canopen_timers_due(&canopen->timers); due != 0; due &= due - 1) {
    const uint8_t timer = fx_lowest_bit(due);
    if (canopen_timer_take(&canopen->timers, timer)) {
      run_out(canopen, fw, timer);
    }
  }
}

/* Once until all frames have gone out again: a full output must not fill itself. */
static void tell_overrun(canopen_t *canopen) {
  if (canopen->emcy.overrun_told == 0) {
    canopen->emcy.overrun_told = 1;
    emcy_raise(canopen, AXIS_ERROR_CODE_CAN_OVERRUN, 0);
  }
}

static void count_lost(canopen_t *canopen, fw_t *fw) {
  fw_can_count_lost(fw, canopen->output.lost);
  canopen->output.lost = 0;
  tell_overrun(canopen);
}

static void look_at_drive(canopen_t *canopen, const fw_t *fw) {
  const uint16_t code = fw_error_code(fw);
  if (code != canopen->emcy.drive_code) {
    emcy_drive(canopen, code, fw_fault(fw));
  }
}

static bool has_timers_due(canopen_t *canopen) {
  return *canopen_timer_slot(&canopen->timers, canopen->timers.now) != 0;
}

/* More than one. */
static bool has_many(uint8_t set) { return (set & (set - UINT32_C(1))) != 0; }

static void serve_pdos(canopen_t *canopen, fw_t *fw) {
  if (canopen->tpdos_watched != 0 || canopen->tpdos_inhibited != 0) {
    pdo_tick(canopen, fw);
  }
}

void canopen_tick_begin(canopen_t *canopen, fw_t *fw, bool leave) {
  if (canopen->left != LEFT_NOTHING) {
    canopen->late = (uint8_t)(canopen->late + ((canopen->late < UINT8_MAX) ? 1 : 0));
  } else if (canopen->signals.nmt_state == AXIS_NMT_STATE_INITIALISING) {
    canopen->timers.now += 1;
  } else if (leave || has_many(canopen->tpdos_watched) || has_timers_due(canopen) ||
             canopen->emcy.count != 0 || canopen->output.lost != 0 ||
             fw_error_code(fw) != canopen->emcy.drive_code ||
             (canopen->rpdos_waiting != 0 && fw_is_active(fw))) {
    canopen->left = LEFT_ALL;
  } else {
    serve_pdos(canopen, fw);
    if (canopen->output.lost != 0) {
      canopen->left = LEFT_OUTPUT;
    } else {
      canopen->timers.now += 1;
    }
  }
}

static void finish_tick(canopen_t *canopen, fw_t *fw) {
  if (canopen->left == LEFT_ALL) {
    if (has_timers_due(canopen)) {
      serve_timers(canopen, fw);
    }
    if (canopen->rpdos_waiting != 0) {
      pdo_watch(canopen, fw);
    }
    look_at_drive(canopen, fw);
    serve_pdos(canopen, fw);
  }
  if (canopen->output.lost != 0) {
    count_lost(canopen, fw);
  }
  if (canopen->emcy.count != 0) {
    emcy_tick(canopen);
  }
  canopen->left = LEFT_NOTHING;
  canopen->timers.now += 1;
}

void canopen_tick_end(canopen_t *canopen, fw_t *fw) {
  if (canopen->left != LEFT_NOTHING) {
    finish_tick(canopen, fw);
  }
  for (; canopen->late != 0; canopen->late = (uint8_t)(canopen->late - 1)) {
    if (canopen->signals.nmt_state != AXIS_NMT_STATE_INITIALISING) {
      canopen->left = LEFT_ALL;
      finish_tick(canopen, fw);
    }
  }
}

void canopen_missed(canopen_t *canopen, uint32_t ticks) {
  pdo_missed(canopen, ticks);
  canopen_timers_missed(&canopen->timers, ticks);
}

bool canopen_transmit(canopen_t *canopen, can_frame_t *frame) {
  if (can_output_take(&canopen->output, frame)) {
    return true;
  }
  canopen->emcy.overrun_told = 0;
  return false;
}

/* --- the lock --------------------------------------------------------------------------------- */

void canopen_owns(canopen_t *canopen) { pdo_restart_deadlines(canopen); }

bool canopen_is_watched(const canopen_t *canopen) {
  for (uint8_t i = 0; i < CANOPEN_HEARTBEATS; i++) {
    if (canopen_timer_runs(&canopen->timers, CANOPEN_TIMER_CONSUMER + i)) {
      return true;
    }
  }
  return pdo_has_deadline(canopen);
}

uint8_t canopen_lost_for(const canopen_t *canopen) {
  if (canopen->bus == CAN_BUS_OFF) {
    return AXIS_FAULT_CAN_OFF;
  }
  if (canopen->heartbeats_lost != 0) {
    return AXIS_FAULT_HEARTBEAT_LOST;
  }
  return (canopen->signals.nmt_state == AXIS_NMT_STATE_STOPPED) ? AXIS_FAULT_SOURCE_LOST
                                                                : AXIS_FAULT_NONE;
}

/* --- what the port tells ---------------------------------------------------------------------- */

void canopen_lost(canopen_t *canopen, fw_t *fw, uint16_t frames) {
  fw_can_count_lost(fw, frames);
  tell_overrun(canopen);
}

static void bus_off(canopen_t *canopen, fw_t *fw) {
  /* What waits would come too late, and nothing more gets in until the bus is back. */
  can_output_clear(&canopen->output);
  canopen->output.closed = 1;
  emcy_update(canopen);
  lose_masters(fw, AXIS_FAULT_CAN_OFF);
  communication_error(canopen);
}

void canopen_bus(canopen_t *canopen, fw_t *fw, uint8_t state) {
  const uint8_t previous = canopen->bus;
  if (state == previous || state > CAN_BUS_OFF) {
    return;
  }
  canopen->bus = state;
  if (state == CAN_BUS_OFF) {
    bus_off(canopen, fw);
    return;
  }
  if (previous == CAN_BUS_OFF) {
    canopen->output.closed = 0;
    emcy_raise(canopen, AXIS_ERROR_CODE_CAN_OFF, 0);
  }
  emcy_raise(canopen,
             (state == CAN_BUS_PASSIVE) ? AXIS_ERROR_CODE_CAN_PASSIVE : AXIS_ERROR_CODE_NONE, 0);
}

void canopen_emergency(canopen_t *canopen, uint16_t code, uint8_t info) {
  emcy_raise(canopen, code, info);
}

void canopen_emergency_detailed(canopen_t *canopen, uint16_t code, uint8_t info, uint32_t detail) {
  emcy_raise_detailed(canopen, code, info, detail);
}

void canopen_recording_replaced(canopen_t *canopen) { sdo_recording_replaced(canopen); }

/* --- parameters ------------------------------------------------------------------------------- */

/* CiA 301, table of restricted CAN-IDs. */
enum { RESTRICTED = 6 };
static const struct {
  uint16_t first;
  uint16_t last;
} restricted[RESTRICTED] = {
    {0x000, 0x07F},                 /* NMT, and reserved for safety */
    {0x101, 0x180}, {0x581, 0x5FF}, /* SDO, from the server */
    {0x601, 0x67F},                 /* SDO, to the server */
    {0x6E0, 0x6FF}, {0x701, 0x7FF}, /* NMT error control, and reserved */
};

static bool is_restricted(uint16_t id) {
  for (uint8_t i = 0; i < RESTRICTED; i++) {
    if (id >= restricted[i].first && id <= restricted[i].last) {
      return true;
    }
  }
  return false;
}

int canopen_check_cob_id(uint32_t present, uint32_t wanted) {
  const bool becomes_valid = canopen_cob_valid(wanted);
  if (wanted == present) {
    return FW_OK;
  }
  if (fx_field(wanted, 11, 19) != 0 || (becomes_valid && is_restricted(canopen_can_id(wanted)))) {
    return FW_ERROR_RANGE;
  }
  const bool moves = canopen_can_id(wanted) != canopen_can_id(present);
  return (moves && becomes_valid && canopen_cob_valid(present)) ? FW_ERROR_STATE : FW_OK;
}

/* SYNC has no bit that makes it not valid; bit 30 would have the node produce it. */
static int check_sync(uint32_t wanted) {
  const bool fits = fx_field(wanted, 11, 20) == 0 && !is_restricted(canopen_can_id(wanted));
  return fits ? FW_OK : FW_ERROR_RANGE;
}

/* One consumer for each node. */
static int check_consumer(const canopen_t *canopen, uint8_t i, uint32_t wanted) {
  if (fx_field(wanted, 24, 8) != 0) {
    return FW_ERROR_RANGE;
  }
  const uint8_t node = watched_node(wanted);
  for (uint8_t k = 0; k < CANOPEN_HEARTBEATS; k++) {
    if (k != i && node != 0 && watched_node(canopen->params.consumer_heartbeat[k]) == node) {
      return FW_ERROR_MAPPING;
    }
  }
  return FW_OK;
}

int canopen_check(const canopen_t *canopen, uint16_t object, int32_t value) {
  const canopen_params_t *params = &canopen->params;
  switch (object) {
    case AXIS_OBJ_SYNC_COB_ID:
      return check_sync((uint32_t)value);
    case AXIS_OBJ_EMCY_COB_ID:
      return canopen_check_cob_id(params->emcy_cob_id, (uint32_t)value);
    default:
      break;
  }
  const int consumer = canopen_element(object, AXIS_OBJ_CONSUMER_HEARTBEAT_1, CANOPEN_HEARTBEATS);
  if (consumer >= 0) {
    return check_consumer(canopen, (uint8_t)consumer, (uint32_t)value);
  }
  const int result = pdo_check(canopen, object, value);
  return (result == PDO_NOT_MINE) ? FW_OK : result;
}

void canopen_written(canopen_t *canopen, uint16_t object, int32_t previous, int32_t value) {
  if (value == previous) {
    return;
  }
  const int consumer = canopen_element(object, AXIS_OBJ_CONSUMER_HEARTBEAT_1, CANOPEN_HEARTBEATS);
  if (consumer >= 0) {
    /* It is watched from its next heartbeat on. */
    heartbeat_found(canopen, (uint8_t)consumer);
    canopen_timer_stop(&canopen->timers, CANOPEN_TIMER_CONSUMER + (uint32_t)consumer);
    return;
  }
  switch (object) {
    case AXIS_OBJ_ERROR_HISTORY_COUNT:
      emcy_forget(canopen);
      break;
    case AXIS_OBJ_PRODUCER_HEARTBEAT_TIME:
      start_heartbeat(canopen);
      break;
    case AXIS_OBJ_EMCY_COB_ID:
      canopen->emcy.count = canopen_cob_valid((uint32_t)value) ? canopen->emcy.count : 0;
      break;
    default:
      pdo_written(canopen, object);
      break;
  }
}
