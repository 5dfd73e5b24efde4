#include "firmware/drive/status.h"

#include <stdbool.h>
#include <stddef.h>

#include "firmware/drive/modes.h"
#include "firmware/drive/motion.h"
#include "firmware/drive/state.h"
#include "firmware/drive/units.h"
#include "firmware/fx/fx.h"

static bool is_enabled(const cia402_t *drive) {
  return drive->signals.drive_state == AXIS_DRIVE_STATE_OPERATION_ENABLED &&
         !first_motion_is_running(&drive->guards.first_motion);
}

/* Returns the number of ticks in which the axis must be at its target before the drive reports
 * `target reached`. */
static uint32_t reached_ticks(const cia402_t *drive) {
  switch (drive->mode->window) {
    case CIA402_WINDOW_POSITION:
      return fx_ticks_from_ms(drive->params.position_window_time);
    case CIA402_WINDOW_VELOCITY:
      return fx_ticks_from_ms(drive->params.velocity_window_time);
    default:
      return 0;
  }
}

static bool shows_reached(const cia402_t *drive) {
  if (drive->signals.drive_state == AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE) {
    return drive->trajectory.velocity_q16 == 0;
  }
  if (!is_enabled(drive)) {
    return false;
  }
  if (drive->signals.modes_of_operation_display == AXIS_MODES_OF_OPERATION_HOMING) {
    const uint8_t homing = drive->homing.state;
    const bool is_over = homing == CIA402_HOMING_IDLE || homing == CIA402_HOMING_DONE ||
                         homing == CIA402_HOMING_ERROR;
    return is_over &&
           (drive->tracking != CIA402_TRACKING_AXIS || drive->trajectory.velocity_q16 == 0);
  }
  if (drive->signals.modes_of_operation_display == AXIS_MODES_OF_OPERATION_CYCLE) {
    return !cycle_is_running(&drive->cycle) && drive->trajectory.velocity_q16 == 0;
  }
  return drive->reached_tick > reached_ticks(drive);
}

void cia402_show(cia402_t *drive, const axis_t *axis) {
  drive_signals_t *signals = &drive->signals;
  const axis_signals_t *measured = &axis->signals;
  const uint8_t fault = (measured->fault != AXIS_FAULT_NONE) ? measured->fault : drive->fault;
  const bool blocked = measured->limit_reason != AXIS_LIMIT_REASON_NONE;
  const bool limited = blocked || drive->limited != 0;
  const uint8_t state = first_motion_is_running(&drive->guards.first_motion)
                            ? AXIS_DRIVE_STATE_SWITCHED_ON
                            : signals->drive_state;
  uint16_t word = (uint16_t)(axis_drive_state_words[state] | AXIS_STATUSWORD_REMOTE);
  if ((measured->digital_inputs & AXIS_DIGITAL_INPUTS_ENABLE) != 0) {
    word |= AXIS_STATUSWORD_VOLTAGE;
  }
  if (limited || signals->limit_cycle != 0 || signals->gain_halvings != 0 ||
      signals->force_saturated != 0 || signals->calibration_expired != 0 ||
      drive->unsupervised != 0 || drive->restricted != 0) {
    word |= AXIS_STATUSWORD_WARNING;
  }
  if (limited) {
    word |= AXIS_STATUSWORD_LIMIT;
  }
  if (shows_reached(drive)) {
    word |= AXIS_STATUSWORD_REACHED;
  }
  if (is_enabled(drive) && drive->mode->bits != NULL) {
    word |= drive->mode->bits(drive);
  }
  if (signals->stopped_by != AXIS_STOPPED_BY_NOBODY) {
    word |= AXIS_STATUSWORD_STOPPED;
  }
  signals->statusword = word;
  signals->error_code = axis_fault_codes[fault];
}

static void measure_motion(cia402_t *drive, const axis_t *axis) {
  drive_signals_t *signals = &drive->signals;
  const axis_signals_t *measured = &axis->signals;
  int32_t *oldest = &drive->velocities[drive->velocity_next];
  drive->velocity_sum = fx_sum_wrap(fx_diff_wrap(drive->velocity_sum, *oldest), measured->velocity);
  *oldest = measured->velocity;
  drive->velocity_next =
      (uint8_t)((drive->velocity_next + 1 == CIA402_MEAN_TICKS) ? 0 : drive->velocity_next + 1);
  const bool tracked = drive->tracking != CIA402_TRACKING_NONE;
  const profile_t *followed = motion_followed(drive);
  const int32_t demand_q16 = tracked ? followed->velocity_q16 : 0;
  const int32_t demand_cnt = (drive->tracking == CIA402_TRACKING_VIRTUAL)
                                 ? fx_cnt_from_q32(followed->position_q32)
                                 : fx_diff_wrap(measured->profile_position, drive->lead_cnt);
  signals->position_internal = measured->position;
  signals->position_actual = cia402_user(drive, measured->position);
  signals->position_demand = cia402_user(drive, demand_cnt);
  signals->following_error = fx_diff_wrap(signals->position_demand, signals->position_actual);
  signals->velocity_demand = units_user_speed(drive, fx_per_s_from_q16(demand_q16));
}

static inline int16_t per_mille(const cia402_t *drive, int32_t force_q8) {
  return (int16_t)fx_clamp(fx_ratio_apply(force_q8, drive->force_of_reading, 0), INT16_MIN,
                           INT16_MAX);
}

static void measure_force(cia402_t *drive, const axis_t *axis) {
  drive_signals_t *signals = &drive->signals;
  const cia402_mode_t *mode = drive->mode;
  const bool native =
      drive->pressing == 0 &&
      (axis->signals.active_mode == AXIS_MODE_FORCE ||
       (mode->holds == CIA402_HOLDS_SETPOINT && axis->signals.active_mode == mode->native));
  signals->force_actual = per_mille(drive, axis->signals.force);
  signals->force_demand =
      native ? per_mille(drive, axis->params.force_setpoint)
             : (int16_t)fx_clamp(fx_round_q16(drive->force_demand_q16), INT16_MIN, INT16_MAX);
  signals->current_actual = fx_per_mille_of_bits(axis->signals.current_raw, axis->params.adc_bits);
}

static uint32_t inputs_bits(uint8_t din) {
  uint32_t bits = 0;
  bits |= ((din & AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE) != 0) ? AXIS_DRIVE_INPUTS_LIMIT_NEGATIVE : 0;
  bits |= ((din & AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE) != 0) ? AXIS_DRIVE_INPUTS_LIMIT_POSITIVE : 0;
  bits |= ((din & AXIS_DIGITAL_INPUTS_HOME) != 0) ? AXIS_DRIVE_INPUTS_HOME : 0;
  bits |= ((din & AXIS_DIGITAL_INPUTS_ENABLE) != 0) ? AXIS_DRIVE_INPUTS_ENABLE : 0;
  bits |= ((din & AXIS_DIGITAL_INPUTS_INDEX) != 0) ? AXIS_DRIVE_INPUTS_INDEX : 0;
  return bits;
}

static bool has_reached(const cia402_t *drive, const axis_t *axis) {
  if ((drive->params.controlword & AXIS_CONTROLWORD_HALT) != 0) {
    return drive->tracking == CIA402_TRACKING_AXIS && drive->trajectory.velocity_q16 == 0;
  }
  const cia402_mode_t *mode = drive->mode;
  return mode->reached != NULL && mode->reached(drive, axis);
}

/* Returns the number of ticks for which a condition has been true. The number is 1 in the first
 * tick in which the condition is true. It rises by 2 in each call, because the condition is checked
 * in every second tick. The number saturates. */
static uint32_t lasting(uint32_t ticks, bool lasts) {
  if (!lasts) {
    return 0;
  }
  return (ticks == 0) ? 1 : (ticks >= UINT32_MAX - 2) ? ticks : ticks + 2;
}

/* Checks in every second tick whether the target is reached and whether the axis is at
 * standstill. */
static void check_target_and_standstill(cia402_t *drive, const axis_t *axis) {
  drive->signals.velocity_actual =
      units_user_speed(drive, fx_per_s_from_16_ticks(drive->velocity_sum));
  const bool slow =
      fx_magnitude(drive->signals.velocity_actual) <= drive->params.velocity_threshold;
  drive->restricted = (uint8_t)(drive->controlled & drive->uncertified);
  /* A running cycle checks its own conditions, so the drive does not report whether the targets of
   * its phases are reached. */
  const bool reports = is_enabled(drive) && !cycle_is_running(&drive->cycle);
  drive->reached_tick = lasting(drive->reached_tick, reports && has_reached(drive, axis));
  drive->standing_tick = lasting(drive->standing_tick, slow);
}

void cia402_observe(cia402_t *drive, const axis_t *axis) {
  measure_motion(drive, axis);
  const bool controlled = drive->controlled != 0;
  guards_observe(&drive->guards, &drive->params, &drive->signals, axis, controlled);
  /* Some signals are computed only in even ticks, and the others only in odd ticks. This shortens
   * the longest tick. */
  if ((axis->signals.tick_count & 1) != 0) {
    measure_force(drive, axis);
    drive->signals.velocity_sensor =
        cia402_signed_by(drive, fx_per_s_from_tick(axis->signals.velocity), AXIS_POLARITY_VELOCITY);
    drive->signals.drive_inputs = inputs_bits(axis->signals.digital_inputs);
  } else {
    check_target_and_standstill(drive, axis);
    const bool guided = guards_need_guided(&drive->guards) && cia402_is_guided_by_force(drive);
    guards_evaluate(&drive->guards, &drive->params, &drive->signals, axis, controlled, guided,
                    cycle_is_running(&drive->cycle));
  }
  cia402_show(drive, axis);
}
