#include "firmware/drive402/drive402_cycle.h"

#include "firmware/fx/bytes.h"

enum { SYNC_ID = 0x80, RPDO_ID = 0x200 };

void drive402_cycle_start(drive402_t *master) {
  master->since_sync = DRIVE402_NO_SYNC;
  master->age_ticks = UINT16_MAX;
  master->stop_ticks = 0;
  master->controlword = DRIVE402_DISABLE_VOLTAGE;
  master->statusword = 0;
  master->state = DRIVE402_NOT_READY;
  master->sampled = 0;
  master->other_length = 0;
  master->tpdos = 0;
  master->missing = 0;
  master->doubled = 0;
  master->mode_displayed = 0;
  master->was_on = 0;
  master->resets_fault = 0;
  master->saturated = 0;
}

void drive402_cycle_receive(drive402_t *master, const can_frame_t *frame) {
  if (master->since_sync == DRIVE402_NO_SYNC) {
    return;
  }
  if (frame->length != master->tpdo_bytes) {
    master->other_length = 1;
    return;
  }
  /* After a missing TPDO, the next TPDO may be the missing one that arrives late. */
  const bool late = master->missing > 0 && master->tpdos == 0;
  master->age_ticks = (uint16_t)(master->since_sync + (late ? master->cycle_ticks : 0));
  master->statusword = (uint16_t)fx_load_le(frame->data, 2);
  master->position_cnt = fx_s32_from_u32(fx_load_le32(frame->data + 2));
  if (master->tpdo_bytes == 8) {
    master->torque = (int16_t)fx_sign_extend(fx_load_le(frame->data + 6, 2), 16);
  }
  master->state = drive402_state_of(master->statusword);
  master->sampled = 1;
  if (master->tpdos < UINT8_MAX) {
    master->tpdos++;
  }
}

/* Returns true if more than one TPDO was received in the bus cycle, and none of them was late. If
 * the TPDO of the drive is not synchronous, the drive may send several TPDOs in a cycle. */
static bool is_doubled(const drive402_t *master) {
  return master->tpdos > 1 && master->missing == 0 && master->phase != DRIVE402_RESETTING &&
         (master->config->without & DRIVE402_WITHOUT_TPDO_TYPE) == 0;
}

/* Ends a bus cycle. Counts consecutive SYNCs to which the drive has sent no TPDO, and consecutive
 * SYNCs to which it has sent more than one TPDO. A single additional TPDO is permitted, because a
 * disturbed bus may have doubled a frame. */
static void close_cycle(drive402_t *master) {
  master->doubled = is_doubled(master) ? (uint8_t)(master->doubled + 1) : 0;
  if (master->doubled == 2) {
    master->doubled = 1;
    drive402_fail(master, DRIVE402_DOUBLED);
  }
  if (master->tpdos > 0 || master->phase != DRIVE402_RUNNING) {
    master->missing = 0;
  } else if (master->missing < 2) {
    master->missing++;
  }
  master->tpdos = 0;
  if (master->missing == 2) {
    drive402_fail(master, DRIVE402_TPDO_MISSING);
  }
}

/* Returns the reason why the drive is not on yet, or is no longer on. */
static uint8_t off_reason(const drive402_t *master) {
  if ((~master->statusword & master->needed & DRIVE402_REMOTE) != 0) {
    return DRIVE402_NOT_REMOTE;
  }
  if (master->state != DRIVE402_OPERATION_ENABLED) {
    return (master->was_on != 0) ? DRIVE402_DRIVE_OFF : DRIVE402_NOT_ENABLED;
  }
  return (master->mode_displayed == 0) ? DRIVE402_MODE_LOST : DRIVE402_TARGET_IGNORED;
}

/* Latches a failure if the newest statusword shows a fault or an unexpected stop, or if the drive
 * was not enabled in time. */
static void watch_state(drive402_t *master, bool enabled) {
  const bool faulted = master->state == DRIVE402_FAULT || master->state == DRIVE402_FAULT_REACTION;
  const bool is_late = master->wait_ticks == 0;
  if (faulted && (master->resets_fault == 0 || is_late)) {
    drive402_fail(master, DRIVE402_DRIVE_FAULT);
  }
  /* A drive that was on has left the state operation enabled without a command. This is a failure
   * even if a stop is commanded in this tick. */
  if ((enabled && is_late) || (master->was_on != 0 && !drive402_follows(master))) {
    drive402_fail(master, off_reason(master));
  }
  if (!faulted || master->reason != DRIVE402_NONE) {
    master->resets_fault = 0;
  }
}

/* Returns the target of this tick. While the command acts, it is the target of the command.
 * Otherwise it is a target that moves nothing: 0, or in csp mode the present position. */
static int32_t target_of(drive402_t *master, const drive402_command_t *command, bool wanted) {
  const int32_t most = master->config->target_max;
  master->saturated = 0;
  if (!wanted || !drive402_is_on(master)) {
    return (master->config->mode == DRIVE402_CSP) ? master->position_cnt : 0;
  }
  const int32_t target = fx_fraction_apply(command->target, &master->scale);
  master->saturated = fx_within(target, most) ? 0 : 1;
  return fx_clamp(target, -most, most);
}

static uint16_t controlword_of(const drive402_t *master, bool wanted) {
  if (master->stop_ticks > 0) {
    return DRIVE402_QUICK_STOP;
  }
  if (master->resets_fault != 0 && master->state == DRIVE402_FAULT) {
    return DRIVE402_FAULT_RESET;
  }
  return wanted ? drive402_step(master->state) : DRIVE402_DISABLE_VOLTAGE;
}

static void send_rpdo(drive402_t *master, uint16_t controlword, int32_t target) {
  const uint8_t bytes = (master->config->mode == DRIVE402_CST) ? 2 : 4;
  can_frame_t *frame =
      drive402_frame(master, (uint16_t)(RPDO_ID + master->config->node_id), (uint8_t)(2 + bytes));
  fx_store_le(frame->data, controlword, 2);
  fx_store_le(frame->data + 2, (uint32_t)target, bytes);
  master->controlword = controlword;
}

/* Starts the timer of a quick stop. Stops this timer as soon as the statusword shows switch on
 * disabled or fault. */
static void time_stop(drive402_t *master, bool stops) {
  if (stops) {
    master->stop_ticks = fx_ticks_from_ms(master->config->quick_stop_ms) + 1;
  } else if (master->state == DRIVE402_SWITCH_ON_DISABLED || master->state == DRIVE402_FAULT) {
    master->stop_ticks = 0;
  }
}

/* Sends the frames of this tick. Returns true if targets act from this tick on. */
static bool act(drive402_t *master, const drive402_command_t *command, bool begins) {
  const bool wanted =
      master->phase == DRIVE402_RUNNING && command->enable != 0 && master->reason == DRIVE402_NONE;
  const bool stops = master->controlword == DRIVE402_ENABLE_OPERATION && !wanted;
  time_stop(master, stops);
  if (begins || stops) {
    const int32_t target = target_of(master, command, wanted);
    send_rpdo(master, controlword_of(master, wanted), target);
  }
  const bool is_on = wanted && drive402_is_on(master);
  /* The master waits at most wait_ms for the drive. This time runs while the drive is being
   * enabled, and begins again after a stop. */
  const bool is_waiting = wanted ? !is_on : master->resets_fault != 0;
  if (master->phase == DRIVE402_RUNNING && (master->stop_ticks > 0 || !is_waiting)) {
    master->wait_ticks = fx_ticks_from_ms(master->config->wait_ms) + 1;
  }
  drive402_count_down(&master->stop_ticks);
  return is_on;
}

void drive402_cycle_tick(drive402_t *master, const drive402_command_t *command) {
  const bool begins = master->since_sync >= master->cycle_ticks;
  if (begins) {
    close_cycle(master);
    master->since_sync = 0;
    (void)drive402_frame(master, SYNC_ID, 0);
  }
  if (master->phase == DRIVE402_RUNNING) {
    watch_state(master, command->enable != 0);
  }
  master->was_on = act(master, command, begins) ? 1 : 0;
  master->since_sync++;
  if (master->age_ticks < UINT16_MAX) {
    master->age_ticks++;
  }
}
