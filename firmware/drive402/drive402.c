#include "firmware/drive402/drive402.h"

#include <stddef.h>

#include "firmware/drive402/drive402_cycle.h"
#include "firmware/drive402/drive402_setup.h"
#include "firmware/fx/bytes.h"

/* CAN identifiers of the predefined connection set, without the node id that is added to each of
 * them. */
enum { NMT_ID = 0x000, EMCY_ID = 0x080, TPDO_ID = 0x180, SDO_ID = 0x580, HEARTBEAT_ID = 0x700 };

/* Commands of NMT, and NMT states in heartbeats. */
enum { NMT_START = 0x01, NMT_RESET_NODE = 0x81, NMT_BOOTED = 0x00, NMT_OPERATIONAL = 0x05 };

static void enter(drive402_t *master, uint8_t phase) {
  master->phase = phase;
  master->command_sent = 0;
  master->entry = 0;
  drive402_sdo_init(&master->sdo);
  master->wait_ticks = 0;
}

/* Computes the scale of the target. Returns false if its numerator or denominator has more than 31
 * bits in lowest terms. */
static bool set_scale(drive402_t *master) {
  const drive402_config_t *config = master->config;
  const uint32_t over[3] = {config->scale_num, 1, 1};
  const uint32_t under[3] = {config->scale_den, (uint32_t)fx_scale(1, config->scale_shift), 1};
  return fx_fraction(over, under, &master->scale);
}

uint8_t drive402_init(drive402_t *master, const drive402_config_t *config) {
  master->config = config;
  master->reason = drive402_setup_check(config);
  if (master->reason == DRIVE402_NONE && !set_scale(master)) {
    master->reason = DRIVE402_REFUSED_SCALE;
  }
  if (master->reason != DRIVE402_NONE) {
    return master->reason;
  }
  master->cycle_ticks = (uint16_t)fx_ticks_from_ms(config->cycle_ms);
  drive402_setup_list(master);
  drive402_cycle_start(master);
  return DRIVE402_NONE;
}

static void receive_boot_up(drive402_t *master) {
  const bool was_reset = master->command_sent != 0 || master->phase == DRIVE402_CONFIGURING;
  if (master->phase >= DRIVE402_STARTING) {
    drive402_fail(master, DRIVE402_BOOTED);
  } else if (was_reset && master->reason == DRIVE402_NONE) {
    enter(master, DRIVE402_CONFIGURING);
  }
}

static void receive_heartbeat(drive402_t *master, const can_frame_t *frame) {
  if (frame->length != 1) {
    return;
  }
  const uint8_t state = frame->data[0] & 0x7Fu;
  if (state == NMT_BOOTED) {
    receive_boot_up(master);
    return;
  }
  /* The heartbeat counts as missing one tick later than its time, because it was received some time
   * after the last tick. */
  master->drive_heartbeat_ticks = fx_ticks_from_ms(master->config->heartbeat_timeout_ms) + 1;
  master->operational = (state == NMT_OPERATIONAL) ? 1 : 0;
  if (master->phase == DRIVE402_RUNNING && state != NMT_OPERATIONAL) {
    drive402_fail(master, DRIVE402_NOT_OPERATIONAL);
  }
}

/* Processes an emergency message: error code and error register (1001h). Error code 0 reports the
 * end of an error. If no bit of the error register is 1, no error is present, and the message is a
 * warning. */
static void receive_emergency(drive402_t *master, const can_frame_t *frame) {
  const uint16_t code = (frame->length == 8) ? (uint16_t)fx_load_le(frame->data, 2) : 0;
  if (code == 0) {
    return;
  }
  master->error_code = code;
  if (master->phase == DRIVE402_RUNNING && frame->data[2] != 0) {
    drive402_fail(master, DRIVE402_DRIVE_EMERGENCY);
  }
}

static bool is_refused(const drive402_t *master) {
  return master->reason != DRIVE402_NONE && master->reason <= DRIVE402_REFUSED_LAST;
}

void drive402_receive(drive402_t *master, const can_frame_t *frame) {
  if (is_refused(master) || frame->remote != 0 || frame->id <= master->config->node_id) {
    return;
  }
  switch (frame->id - master->config->node_id) {
    case EMCY_ID:
      receive_emergency(master, frame);
      break;
    case TPDO_ID:
      drive402_cycle_receive(master, frame);
      break;
    case SDO_ID:
      drive402_sdo_receive(&master->sdo, frame);
      break;
    case HEARTBEAT_ID:
      receive_heartbeat(master, frame);
      break;
    default:
      break;
  }
}

void drive402_bus(drive402_t *master, uint8_t state, uint16_t frames_lost) {
  if (state == CAN_BUS_OFF) {
    drive402_fail(master, DRIVE402_BUS_OFF);
  }
  if (frames_lost > 0) {
    drive402_fail(master, DRIVE402_FRAMES_LOST);
  }
}

drive402_feedback_t drive402_feedback(const drive402_t *master) {
  const bool faulted = master->state == DRIVE402_FAULT || master->state == DRIVE402_FAULT_REACTION;
  const drive402_feedback_t feedback = {
      .position_cnt = master->position_cnt,
      .torque = master->torque,
      .age_ticks = master->age_ticks,
      .statusword = master->statusword,
      .error_code = master->error_code,
      .fitted = is_refused(master) ? 0 : 1,
      .on = drive402_is_on(master) ? 1 : 0,
      .fault = (master->reason != DRIVE402_NONE || faulted) ? 1 : 0,
      .limit = ((master->statusword & DRIVE402_LIMIT_ACTIVE) != 0) ? 1 : 0,
      .saturated = master->saturated,
      .phase = master->phase,
      .state = master->state,
      .reason = master->reason,
      .failed_sub = master->failed_sub,
      .failed_index = master->failed_index,
      .abort_code = master->abort_code,
  };
  return feedback;
}

static void send_nmt(drive402_t *master, uint8_t command) {
  can_frame_t *frame = drive402_frame(master, NMT_ID, 2);
  frame->data[0] = command;
  frame->data[1] = master->config->node_id;
  master->command_sent = 1;
  master->wait_ticks = fx_ticks_from_ms(master->config->wait_ms);
}

static void send_heartbeat(drive402_t *master) {
  drive402_count_down(&master->own_heartbeat_ticks);
  if (master->own_heartbeat_ticks == 0) {
    const uint16_t id = (uint16_t)(HEARTBEAT_ID + master->config->own_node_id);
    drive402_frame(master, id, 1)->data[0] = NMT_OPERATIONAL;
    master->own_heartbeat_ticks = fx_ticks_from_ms(master->config->heartbeat_ms);
  }
}

/* Computes a tick of the phase RESETTING: waits for the end of a stop, resets the node, and waits
 * for the boot-up message. */
static void reset_node(drive402_t *master) {
  if (master->stop_ticks > 0) {
    return;
  }
  if (master->command_sent == 0) {
    drive402_cycle_start(master);
    send_nmt(master, NMT_RESET_NODE);
  } else if (master->wait_ticks == 0) {
    drive402_fail(master, DRIVE402_BOOT_TIMEOUT);
  }
}

static void configure(drive402_t *master) {
  if (drive402_setup_tick(master)) {
    enter(master, DRIVE402_STARTING);
    master->operational = 0;
  }
}

/* Returns the reason why the drive is not ready yet after the start of its node, for example a
 * missing TPDO. */
static uint8_t start_reason(const drive402_t *master) {
  if (master->sampled != 0) {
    return DRIVE402_START_TIMEOUT;
  }
  return (master->other_length != 0) ? DRIVE402_TPDO_LENGTH : DRIVE402_NO_TPDO;
}

static void start_node(drive402_t *master) {
  if (master->command_sent == 0) {
    send_nmt(master, NMT_START);
  } else if (master->operational != 0 && master->sampled != 0) {
    enter(master, DRIVE402_RUNNING);
    master->wait_ticks = fx_ticks_from_ms(master->config->wait_ms) + 1;
    master->resets_fault = master->reset_asked;
    master->reset_asked = 0;
    master->read_ticks = 0;
  } else if (master->wait_ticks == 0) {
    drive402_fail(master, start_reason(master));
  }
}

static void supervise(drive402_t *master) {
  if (master->drive_heartbeat_ticks == 0) {
    drive402_fail(master, DRIVE402_HEARTBEAT_LOST);
  }
  drive402_count_down(&master->read_ticks);
  drive402_setup_watch(master);
}

/* Does the work of the present phase in a tick, except the cyclic frames. After a failure no phase
 * continues, but the master still reads objects of a running drive. */
static void step(drive402_t *master) {
  if (master->phase == DRIVE402_RUNNING) {
    supervise(master);
  }
  if (master->reason != DRIVE402_NONE) {
    return;
  }
  switch (master->phase) {
    case DRIVE402_RESETTING:
      reset_node(master);
      break;
    case DRIVE402_CONFIGURING:
      configure(master);
      break;
    case DRIVE402_STARTING:
      start_node(master);
      break;
    default:
      break;
  }
}

/* Acts on the command `reset`. If no tick has reacted to the failure yet, the failure is not reset.
 * A drive that is not running yet may report a fault later, so the command is kept for this
 * case. */
static void reset(drive402_t *master) {
  const bool in_place =
      master->phase == DRIVE402_RUNNING && (master->reason <= DRIVE402_RESET_IN_PLACE_LAST ||
                                            master->reason >= DRIVE402_RESET_IN_PLACE_AGAIN);
  master->reset_asked = in_place ? 0 : 1;
  if (master->failed_before == 0) {
    return;
  }
  master->reason = DRIVE402_NONE;
  master->failed_index = 0;
  master->failed_sub = 0;
  master->abort_code = 0;
  if (in_place) {
    master->resets_fault = 1;
    master->wait_ticks = fx_ticks_from_ms(master->config->wait_ms) + 1;
  } else {
    enter(master, DRIVE402_RESETTING);
  }
}

void drive402_tick(drive402_t *master, const drive402_command_t *command) {
  if (is_refused(master)) {
    return;
  }
  fx_assert(master->frame_next <= master->frame_count && master->frame_count <= DRIVE402_FRAMES);
  fx_assert(master->phase < DRIVE402_PHASE_COUNT && master->reason < DRIVE402_REASON_COUNT);
  if (master->frame_next < master->frame_count) {
    drive402_fail(master, DRIVE402_FRAMES_KEPT);
  }
  master->frame_count = 0;
  master->frame_next = 0;
  drive402_count_down(&master->wait_ticks);
  drive402_count_down(&master->drive_heartbeat_ticks);
  if (command->reset != 0 && master->reset_before == 0) {
    reset(master);
  }
  master->reset_before = command->reset;
  /* The master continues to send the cyclic frames until the node of the drive is reset. */
  if (master->phase >= DRIVE402_STARTING || master->since_sync != DRIVE402_NO_SYNC) {
    drive402_cycle_tick(master, command);
  }
  master->failed_before = (master->reason != DRIVE402_NONE) ? 1 : 0;
  step(master);
  send_heartbeat(master);
}

bool drive402_transmit(drive402_t *master, can_frame_t *frame) {
  if (master->frame_next >= master->frame_count) {
    return false;
  }
  *frame = master->frames[master->frame_next];
  master->frame_next++;
  return true;
}

#define TEXT_(name, text) [DRIVE402_##name] = text,
static const char *const phase_texts[DRIVE402_PHASE_COUNT] = {DRIVE402_PHASES(TEXT_)};
static const char *const state_texts[DRIVE402_STATE_COUNT] = {DRIVE402_STATES(TEXT_)};
static const char *const reason_texts[DRIVE402_REASON_COUNT] = {DRIVE402_REASONS(TEXT_)};

const char *drive402_phase_text(uint8_t phase) { return phase_texts[phase]; }
const char *drive402_state_text(uint8_t state) { return state_texts[state]; }
const char *drive402_reason_text(uint8_t reason) { return reason_texts[reason]; }

/* Abort code of CiA 301 for a value that is not permitted, for example a COB-ID in which bit 30 is
 * 1. */
#define REFUSED_VALUE UINT32_C(0x06090030)

enum { KEY_COUNT = 15 };
#define KEY_(name, bit, key, what) {bit, key},
static const struct {
  uint16_t bit;
  const char *key;
} keys[KEY_COUNT] = {DRIVE402_OBJECTS(KEY_)};

static uint16_t failed_bit(const drive402_feedback_t *feedback) {
  const uint16_t index = feedback->failed_index;
  const uint8_t sub = feedback->failed_sub;
  if (index == 0x1A00 && sub == 3) {
    return DRIVE402_WITHOUT_TORQUE;
  }
  if (index == 0x1800 && sub == 1 && feedback->abort_code == REFUSED_VALUE) {
    return DRIVE402_WITHOUT_REQUEST_BIT;
  }
  return drive402_object_bit(index, sub);
}

const char *drive402_key(const drive402_feedback_t *feedback) {
  const uint16_t bit = failed_bit(feedback);
  const bool differs = feedback->reason == DRIVE402_SDO_DIFFERS;
  if (feedback->reason == DRIVE402_SDO_TIMEOUT || (differs && (bit & DRIVE402_DIFFERS_ALL) == 0)) {
    return NULL;
  }
  for (uint8_t i = 0; i < KEY_COUNT; i++) {
    if (keys[i].bit == bit) {
      return keys[i].key;
    }
  }
  return NULL;
}
