#include "firmware/canopen/node.h"

#include <stddef.h>

#include "firmware/canopen/cob_id.h"
#include "firmware/canopen/emcy.h"
#include "firmware/canopen/heartbeat.h"
#include "firmware/canopen/identifier.h"
#include "firmware/canopen/lss.h"
#include "firmware/canopen/pdo.h"
#include "firmware/canopen/sdo.h"
#include "firmware/canopen/sdo_block.h"
#include "firmware/canopen/sync.h"
#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/generated/axis_objects.h"
#include "firmware/objects/value.h"

/* ID_NMT: CAN identifier of the network management (NMT). NMT_: commands of the NMT. */
enum { ID_NMT = 0x000 };
enum {
  NMT_START = 1,
  NMT_STOP = 2,
  NMT_PRE_OPERATIONAL = 128,
  NMT_RESET_NODE = 129,
  NMT_RESET_COMMUNICATION = 130
};

/* Values of error_behaviour (1029h): NMT state that the node enters after a communication error. */
enum { BEHAVIOUR_PRE_OPERATIONAL = 0, BEHAVIOUR_STOPPED = 2 };

/* Adds the node id to the COB-IDs in one block of objects. Only COB-IDs whose default value
 * contains the node id are changed. */
static void add_node_id(void *structure, uint8_t block, uint8_t node_id) {
  for (uint16_t i = AXIS_OBJ_NONE + 1; i < AXIS_OBJ_COUNT; i++) {
    const axis_object_t *object = &axis_objects[i];
    if (object->block == block && object->node_id != 0) {
      const uint32_t value = (uint32_t)object->initial + node_id;
      value_store(structure, object->offset, object->type, fx_s32_from_u32(value));
    }
  }
}

/* Initialises a PDO. The field `value` and the field `places` need no initial value: no function
 * reads `value` before the PDO was sent or received once, or `places` before the PDO was mapped. */
static void init_pdo(pdo_t *pdo) {
  pdo->bits = 0;
  pdo->pending = 0;
  pdo->syncs = 0;
  pdo->reported = 0;
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
  canopen->deferred = CANOPEN_DEFERRED_NOTHING;
  canopen->late = 0;
  canopen->sdos_sending = 0;
  sdo_drop(canopen);
  canopen->emcy.drive_code = 0;
  canopen->emcy.count = 0;
  canopen->emcy.overrun_reported = 0;
  canopen->sync_reported = 0;
  canopen->bus = CAN_BUS_ACTIVE;
  canopen->reset = CANOPEN_RESET_NONE;
  canopen->requests = (canopen_requests_t){0};
  canopen->node_id = node_id;
  lss_restart(canopen);
}

static void start_heartbeat(canopen_t *canopen) {
  canopen_timer_start(&canopen->timers, CANOPEN_TIMER_HEARTBEAT,
                      fx_ticks_from_ms(canopen->params.producer_heartbeat_time));
}

static void send_state(canopen_t *canopen, uint8_t state) {
  can_frame_t *frame = can_output_add(&canopen->output, (uint16_t)(HEARTBEAT_ID + canopen->node_id),
                                      1, CAN_OUTPUT_KEEP_NMT);
  if (frame != NULL) {
    frame->data[0] = state;
  }
}

void canopen_start(canopen_t *canopen, const dictionary_t *objects) {
  if (canopen->node_id == LSS_NO_NODE_ID) {
    return;
  }
  /* The boot-up message has the format of a heartbeat with the state initialising. After this
   * message the node leaves the state initialising. */
  send_state(canopen, AXIS_NMT_STATE_INITIALISING);
  canopen->signals.nmt_state = AXIS_NMT_STATE_PRE_OPERATIONAL;
  start_heartbeat(canopen);
  pdo_start(canopen, objects);
}

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

/* Requests a stop of the axis, whichever bus owns the axis, and reports all command sources on the
 * CAN bus as lost. */
static void stop_axis(canopen_t *canopen, uint8_t fault) {
  canopen_lose_all(canopen, fault);
  canopen->requests.stop = 1;
}

/* Reports `frames` more lost frames to the firmware. The number of reported frames saturates at its
 * largest value. */
static void lose_frames(canopen_t *canopen, uint16_t frames) {
  const uint32_t sum = (uint32_t)canopen->requests.frames_lost + frames;
  canopen->requests.frames_lost = (uint16_t)((sum > UINT16_MAX) ? UINT16_MAX : sum);
}

/* Reports to the firmware the frames that the output queue has refused because it was full. */
static void take_output_lost(canopen_t *canopen) {
  lose_frames(canopen, canopen->output.lost);
  canopen->output.lost = 0;
}

static void communication_error(canopen_t *canopen) {
  const uint8_t behaviour = canopen->params.error_behaviour;
  const uint8_t state = canopen->signals.nmt_state;
  if (behaviour == BEHAVIOUR_STOPPED && state != AXIS_NMT_STATE_INITIALISING) {
    enter(canopen, AXIS_NMT_STATE_STOPPED);
  } else if (behaviour == BEHAVIOUR_PRE_OPERATIONAL && state == AXIS_NMT_STATE_OPERATIONAL) {
    enter(canopen, AXIS_NMT_STATE_PRE_OPERATIONAL);
  }
}

static void request_reset(canopen_t *canopen, uint8_t reset) {
  stop_axis(canopen, AXIS_FAULT_SOURCE_LOST);
  /* The lost frames are counted before the reset, because the reset empties the output queue. */
  take_output_lost(canopen);
  enter(canopen, AXIS_NMT_STATE_INITIALISING);
  canopen->reset = reset;
}

uint8_t canopen_take_reset(canopen_t *canopen) {
  const uint8_t reset = canopen->reset;
  canopen->reset = CANOPEN_RESET_NONE;
  return reset;
}

static void bus_off(canopen_t *canopen) {
  /* Frames that wait in the queue would be sent too late, so they are discarded. The queue accepts
   * no new frame until the bus works again. */
  can_output_clear(&canopen->output);
  canopen->output.closed = 1;
  emcy_update(canopen);
  stop_axis(canopen, AXIS_FAULT_CAN_OFF);
  communication_error(canopen);
}

static void receive_lss(canopen_t *canopen, const can_frame_t *frame) {
  const lss_result_t result =
      (canopen->reset == CANOPEN_RESET_NONE) ? lss_receive(canopen, frame) : LSS_NOTHING;
  if (result == LSS_RESET) {
    request_reset(canopen, CANOPEN_RESET_COMMUNICATION);
  } else if (result == LSS_SILENCE) {
    bus_off(canopen);
  }
}

/* Opens the output queue for new frames. If the bus is off, or if the node is silent during a
 * change of the bit rate, closes the queue. */
static void update_output(canopen_t *canopen) {
  const bool closed = canopen->bus == CAN_BUS_OFF || lss_is_silent(canopen);
  canopen->output.closed = closed ? 1 : 0;
}

void canopen_lss_tick(canopen_t *canopen, uint32_t ticks) {
  if (lss_tick(canopen, ticks)) {
    update_output(canopen);
  }
}

static void receive_nmt(canopen_t *canopen, const can_frame_t *frame) {
  const uint8_t node = frame->data[1];
  if (frame->length != 2 || (node != 0 && node != canopen->node_id)) {
    return;
  }
  switch (frame->data[0]) {
    case NMT_START:
      enter(canopen, AXIS_NMT_STATE_OPERATIONAL);
      break;
    case NMT_STOP:
      stop_axis(canopen, AXIS_FAULT_SOURCE_LOST);
      enter(canopen, AXIS_NMT_STATE_STOPPED);
      break;
    case NMT_PRE_OPERATIONAL:
      enter(canopen, AXIS_NMT_STATE_PRE_OPERATIONAL);
      break;
    case NMT_RESET_NODE:
      request_reset(canopen, CANOPEN_RESET_NODE);
      break;
    case NMT_RESET_COMMUNICATION:
      request_reset(canopen, CANOPEN_RESET_COMMUNICATION);
      break;
    default:
      return;
  }
}

/* Passes a frame to the SDO server whose requests have the identifier of the frame. Returns false
 * if there is no such server. */
static bool receive_sdo(canopen_t *canopen, dictionary_t *objects, const can_frame_t *frame) {
  const uint8_t server = sdo_server_at(canopen, frame->id);
  if (server == CANOPEN_SDOS) {
    return false;
  }
  sdo_receive(canopen, objects, server, frame);
  return true;
}

/* Returns true if the node itself sends frames with the identifier `id`. If the node receives a
 * frame with this identifier, another node has the same node id. */
static bool is_own(const canopen_t *canopen, uint16_t id) {
  const uint32_t emcy = canopen->params.emcy_cob_id;
  return id == HEARTBEAT_ID + canopen->node_id || sdo_transmits(canopen, id) ||
         (canopen_cob_valid(emcy) && canopen_can_id(emcy) == id) || pdo_transmits(canopen, id);
}

void canopen_receive(canopen_t *canopen, dictionary_t *objects, const can_frame_t *frame) {
  if (frame->remote != 0 || frame->length > 8 || lss_is_silent(canopen)) {
    return;
  }
  if (frame->id == LSS_REQUEST_ID) {
    receive_lss(canopen, frame);
    return;
  }
  if (canopen->signals.nmt_state == AXIS_NMT_STATE_INITIALISING) {
    return;
  }
  if (is_own(canopen, frame->id)) {
    canopen->requests.duplicate = 1;
    return;
  }
  if (frame->id == ID_NMT) {
    receive_nmt(canopen, frame);
    return;
  }
  if (frame->id >= HEARTBEAT_ID && frame->id <= HEARTBEAT_ID_LAST) {
    heartbeat_receive(canopen, frame);
    return;
  }
  if (canopen->signals.nmt_state == AXIS_NMT_STATE_STOPPED) {
    return;
  }
  if (frame->id == canopen_can_id(canopen->params.sync_cob_id)) {
    sync_receive(canopen, objects, frame);
  } else if (!receive_sdo(canopen, objects, frame) &&
             canopen->signals.nmt_state == AXIS_NMT_STATE_OPERATIONAL) {
    pdo_receive(canopen, objects, frame);
  }
}

/* Acts on an expired timer. The end of the inhibit time of emergency messages needs no action here,
 * because emcy_tick() then sends a waiting message in the same tick. */
static void run_out(canopen_t *canopen, bool active, uint8_t timer) {
  if (timer == CANOPEN_TIMER_HEARTBEAT) {
    send_state(canopen, canopen->signals.nmt_state);
    start_heartbeat(canopen);
  } else if (timer >= CANOPEN_TIMER_SDO) {
    sdo_timeout(canopen, (uint8_t)(timer - CANOPEN_TIMER_SDO));
  } else if (timer >= CANOPEN_TIMER_RPDO) {
    pdo_late(canopen, active, (uint8_t)(timer - CANOPEN_TIMER_RPDO));
  } else if (timer >= CANOPEN_TIMER_CONSUMER) {
    heartbeat_missed(canopen, (uint8_t)(timer - CANOPEN_TIMER_CONSUMER));
    communication_error(canopen);
  }
}

void canopen_serve_timers(canopen_t *canopen, bool active) {
  for (uint32_t due = canopen_timers_due(&canopen->timers); due != 0; due &= due - 1) {
    const uint8_t timer = fx_lowest_bit(due);
    if (canopen_timer_take(&canopen->timers, timer)) {
      run_out(canopen, active, timer);
    }
  }
}

/* Reports lost frames by an emergency message. The report is sent only once until the output queue
 * is empty, so that reports do not fill the queue. */
static void report_overrun(canopen_t *canopen) {
  if (canopen->emcy.overrun_reported == 0) {
    canopen->emcy.overrun_reported = 1;
    emcy_raise(canopen, AXIS_ERROR_CODE_CAN_OVERRUN, 0);
  }
}

static bool has_timers_due(canopen_t *canopen) {
  return *canopen_timer_slot(&canopen->timers, canopen->timers.now) != 0;
}

/* Returns true if more than one bit of the set `set` is 1. */
static bool has_many(uint8_t set) { return (set & (set - UINT32_C(1))) != 0; }

static void serve_pdos(canopen_t *canopen, const dictionary_t *objects) {
  if (canopen->tpdos_watched != 0 || canopen->tpdos_inhibited != 0) {
    pdo_tick(canopen, objects);
  }
}

void canopen_tick_begin(canopen_t *canopen, const dictionary_t *objects, bool active, bool defer) {
  if (canopen->deferred != CANOPEN_DEFERRED_NOTHING) {
    canopen->late = (uint8_t)(canopen->late + ((canopen->late < UINT8_MAX) ? 1 : 0));
  } else if (canopen->signals.nmt_state == AXIS_NMT_STATE_INITIALISING) {
    canopen->timers.now += 1;
  } else if (defer || has_many(canopen->tpdos_watched) || has_timers_due(canopen) ||
             canopen->emcy.count != 0 || canopen->output.lost != 0 || canopen->sdos_sending != 0 ||
             (canopen->rpdos_waiting != 0 && active)) {
    canopen->deferred = CANOPEN_DEFERRED_ALL;
  } else {
    serve_pdos(canopen, objects);
    if (canopen->output.lost != 0) {
      canopen->deferred = CANOPEN_DEFERRED_OUTPUT;
    } else {
      canopen->timers.now += 1;
    }
  }
}

/* Prepares the work of a tick that began while the work of an earlier tick was still deferred. The
 * work of ticks before the boot-up message is dropped. */
static void make_up(canopen_t *canopen) {
  if (canopen->signals.nmt_state == AXIS_NMT_STATE_INITIALISING) {
    canopen->late = 0;
  }
  if (canopen->late != 0) {
    canopen->late = (uint8_t)(canopen->late - 1);
    canopen->deferred = CANOPEN_DEFERRED_ALL;
  }
}

/* Asserts in each tick that the sets of services of the node contain only services that exist. */
static inline void assert_node(const canopen_t *canopen) {
  const uint32_t pdos = (uint32_t)canopen->rpdos_late | canopen->rpdos_waiting |
                        canopen->tpdos_watched | canopen->tpdos_timed | canopen->tpdos_inhibited;
  fx_assert(pdos < fx_bit(CANOPEN_PDOS) && canopen->sdos_sending < fx_bit(CANOPEN_SDOS));
  fx_assert(canopen->heartbeats_lost < fx_bit(CANOPEN_HEARTBEATS));
  fx_assert(canopen->deferred <= CANOPEN_DEFERRED_ALL && canopen->reset <= CANOPEN_RESET_NODE);
  fx_assert(canopen->bus < AXIS_CAN_STATE_COUNT && canopen->emcy.count <= EMCY_WAITING);
  for (uint8_t i = 0; i < CANOPEN_TIMERS; i++) {
    fx_assert(!canopen_timer_runs(&canopen->timers, i) ||
              fx_s32_from_u32(canopen->timers.at[i] - canopen->timers.now) >= 0);
  }
}

void canopen_tick_end(canopen_t *canopen, const dictionary_t *objects, const canopen_axis_t *axis) {
  assert_node(canopen);
  if (canopen->deferred == CANOPEN_DEFERRED_ALL) {
    if (canopen->rpdos_waiting != 0 && axis->active != 0) {
      pdo_axis_active(canopen);
    }
    if (axis->error_code != canopen->emcy.drive_code) {
      emcy_drive(canopen, axis->error_code, axis->fault);
    }
    serve_pdos(canopen, objects);
  }
  if (canopen->output.lost != 0) {
    take_output_lost(canopen);
    report_overrun(canopen);
  }
  if (canopen->emcy.count != 0) {
    emcy_tick(canopen);
  }
  if (canopen->sdos_sending != 0) {
    sdo_block_tick(canopen, objects);
  }
  canopen->deferred = CANOPEN_DEFERRED_NOTHING;
  canopen->timers.now += 1;
  if (canopen->late != 0) {
    make_up(canopen);
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
  canopen->emcy.overrun_reported = 0;
  return false;
}

void canopen_owns(canopen_t *canopen) { pdo_restart_deadlines(canopen); }

bool canopen_is_watched(const canopen_t *canopen) {
  return heartbeat_runs(canopen) || pdo_has_deadline(canopen);
}

uint8_t canopen_lost_for(const canopen_t *canopen) {
  if (canopen->bus == CAN_BUS_OFF || lss_is_silent(canopen)) {
    return AXIS_FAULT_CAN_OFF;
  }
  if (canopen->heartbeats_lost != 0) {
    return AXIS_FAULT_HEARTBEAT_LOST;
  }
  return (canopen->signals.nmt_state == AXIS_NMT_STATE_STOPPED) ? AXIS_FAULT_SOURCE_LOST
                                                                : AXIS_FAULT_NONE;
}

void canopen_lost(canopen_t *canopen, uint16_t frames) {
  lose_frames(canopen, frames);
  report_overrun(canopen);
}

void canopen_bus(canopen_t *canopen, uint8_t state) {
  const uint8_t previous = canopen->bus;
  if (state == previous || state > CAN_BUS_OFF) {
    return;
  }
  canopen->bus = state;
  if (state == CAN_BUS_OFF) {
    bus_off(canopen);
    return;
  }
  if (previous == CAN_BUS_OFF) {
    update_output(canopen);
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

void canopen_domain_replaced(canopen_t *canopen, uint16_t index) {
  sdo_domain_replaced(canopen, index);
}

static int check_value(const canopen_t *canopen, uint16_t object, int32_t value) {
  const canopen_params_t *params = &canopen->params;
  switch (object) {
    case AXIS_OBJ_SYNC_COB_ID:
      return sync_check_cob_id((uint32_t)value);
    case AXIS_OBJ_SYNC_COUNTER_OVERFLOW:
      return sync_check_overflow((uint32_t)value);
    case AXIS_OBJ_EMCY_COB_ID:
      return canopen_check_cob_id(params->emcy_cob_id, (uint32_t)value);
    default:
      break;
  }
  const int consumer = canopen_element(object, AXIS_OBJ_CONSUMER_HEARTBEAT_1, CANOPEN_HEARTBEATS);
  if (consumer >= 0) {
    return heartbeat_check(canopen, (uint8_t)consumer, (uint32_t)value);
  }
  const int result = pdo_check(canopen, object, value);
  return (result == PDO_NOT_MINE) ? sdo_check(canopen, object, (uint32_t)value) : result;
}

int canopen_check(const canopen_t *canopen, uint16_t object, int32_t value) {
  const int refusal = check_value(canopen, object, value);
  return (refusal == FW_OK && identifier_is_taken(canopen, object, (uint32_t)value))
             ? FW_ERROR_RANGE
             : refusal;
}

bool canopen_watches_by(uint16_t object) {
  return canopen_element(object, AXIS_OBJ_CONSUMER_HEARTBEAT_1, CANOPEN_HEARTBEATS) >= 0 ||
         canopen_element(object, AXIS_OBJ_RPDO_COB_ID_1, CANOPEN_PDOS) >= 0 ||
         canopen_element(object, AXIS_OBJ_RPDO_TIMEOUT_1, CANOPEN_PDOS) >= 0;
}

void canopen_written(canopen_t *canopen, const dictionary_t *objects, uint16_t object,
                     int32_t previous, int32_t value) {
  if (value == previous) {
    return;
  }
  const int consumer = canopen_element(object, AXIS_OBJ_CONSUMER_HEARTBEAT_1, CANOPEN_HEARTBEATS);
  if (consumer >= 0) {
    heartbeat_restart(canopen, (uint8_t)consumer);
    return;
  }
  switch (object) {
    case AXIS_OBJ_ERROR_HISTORY_COUNT:
      emcy_clear_history(canopen);
      break;
    case AXIS_OBJ_PRODUCER_HEARTBEAT_TIME:
      start_heartbeat(canopen);
      break;
    case AXIS_OBJ_EMCY_COB_ID:
      canopen->emcy.count = canopen_cob_valid((uint32_t)value) ? canopen->emcy.count : 0;
      break;
    default:
      sdo_written(canopen, object);
      pdo_written(canopen, objects, object);
      break;
  }
}
