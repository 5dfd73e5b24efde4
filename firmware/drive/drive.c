#include "firmware/drive/drive.h"

#include <stddef.h>

#include "firmware/drive/cycle_mode.h"
#include "firmware/drive/homing.h"
#include "firmware/drive/modes.h"
#include "firmware/drive/motion.h"
#include "firmware/drive/parameters.h"
#include "firmware/drive/position_modes.h"
#include "firmware/drive/state.h"
#include "firmware/drive/status.h"
#include "firmware/drive/units.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/access.h"

static uint8_t state_of(const cia402_t *drive) { return drive->signals.drive_state; }

void cia402_forget_targets(cia402_t *drive) {
  drive->position_written = 0;
  drive->velocity_written = 0;
  drive->force_written = 0;
  drive->params.velocity_offset = 0;
  drive->params.force_offset = 0;
}

/* Discards the set-points of the native modes. These set-points have no flag that shows a write, so
 * the value 0 means that there is no set-point. */
static void forget_setpoints(axis_t *axis) {
  axis->params.open_loop_code = 0;
  axis->params.excitation_amplitude = 0;
  axis->params.force_setpoint = 0;
}

static void enter(cia402_t *drive, uint8_t state) {
  drive->leaving = 0;
  if (state == drive->signals.drive_state) {
    return;
  }
  if (drive->signals.drive_state == AXIS_DRIVE_STATE_OPERATION_ENABLED) {
    cia402_leave_mode(drive);
    drive->unsupervised = 0;
    first_motion_cancel(&drive->guards.first_motion, &drive->signals);
  }
  drive->outside_tick = 0;
  drive->stopping_tick = 0;
  if (state == AXIS_DRIVE_STATE_FAULT || state == AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE) {
    /* A fault discards all targets: the user must write each target again. */
    cia402_forget_targets(drive);
  }
  if (state != AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE) {
    drive->fault = AXIS_FAULT_NONE;
  }
  drive->signals.drive_state = state;
}

static int32_t rate_of(const cia402_t *drive, bool quick) {
  return quick ? drive->quick_deceleration : drive->deceleration;
}

/* Returns true if no tick has switched the amplifier on since the axis was enabled. The axis must
 * then not be stopped by a ramp, because a ramp would switch the amplifier on. */
static bool is_at_rest(const axis_t *axis) {
  return axis->signals.active_mode == AXIS_MODE_DISABLED;
}

/* Raises the fault `fault` that the drive or another module has detected. */
static void raise_fault(cia402_t *drive, axis_t *axis, uint8_t fault) {
  const uint8_t state = state_of(drive);
  if (state == AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE) {
    return; /* The first fault stays reported; a later fault does not replace it. */
  }
  if (cia402_is_powered(state) && drive->params.fault_reaction_option != STOP_AT_ONCE &&
      !first_motion_is_running(&drive->guards.first_motion) && !is_at_rest(axis)) {
    enter(drive, AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE);
    drive->fault = fault;
    return;
  }
  axis_fault(axis, fault);
  enter(drive, AXIS_DRIVE_STATE_FAULT);
}

/* Raises the fault following_error if the following error has been outside its window for longer
 * than following_error_timeout. */
static void watch_following(cia402_t *drive, axis_t *axis) {
  const bool outside =
      drive->tracking == CIA402_TRACKING_AXIS && axis->signals.active_mode == AXIS_MODE_POSITION &&
      fx_magnitude(drive->signals.following_error) > drive->params.following_error_window;
  if (!outside) {
    drive->outside_tick = 0;
    return;
  }
  drive->outside_tick += 1;
  if (drive->outside_tick > fx_ticks_from_ms(drive->params.following_error_timeout)) {
    /* The trajectory of the fault reaction begins at the present position of the axis. */
    drive->tracking = CIA402_TRACKING_NONE;
    raise_fault(drive, axis, AXIS_FAULT_FOLLOWING_ERROR);
  }
}

static void change_mode(cia402_t *drive) {
  cia402_leave_mode(drive);
  cia402_set_mode(drive, drive->params.modes_of_operation);
}

static bool wants_other_mode(const cia402_t *drive) {
  return drive->params.modes_of_operation != drive->signals.modes_of_operation_display;
}

/* Waits until a drive on a bus is on: enables the amplifier with DAC code 0. The mode of operation
 * and its trajectory begin in the first tick after the drive is on. */
static void wait_for_drive(cia402_t *drive, axis_t *axis) {
  if (wants_other_mode(drive)) {
    change_mode(drive);
  }
  motion_rest(drive, axis);
  motion_override(drive, axis);
  axis->params.open_loop_code = 0;
  axis->params.mode = AXIS_MODE_OPEN_LOOP;
}

static void operate(cia402_t *drive, axis_t *axis) {
  if (cia402_run_first_motion(drive, axis)) {
    return;
  }
  if (axis_drive_is_off(axis->signals.drive_report)) {
    wait_for_drive(drive, axis);
    return;
  }
  if (drive->leaving != 0) {
    if (motion_slow_down(drive, axis, rate_of(drive, false))) {
      enter(drive, drive->leaving_to);
      motion_rest(drive, axis);
    }
    return;
  }
  if (wants_other_mode(drive)) {
    if (motion_slow_down(drive, axis, rate_of(drive, false))) {
      change_mode(drive);
    }
    return;
  }
  cia402_run(drive, axis);
}

/* Returns true if a quick stop or fault reaction has ended. A quick stop or fault reaction is
 * reported for at least one tick, even if the axis is at standstill when it begins. It ends after
 * CIA402_STOPPING_TICKS at the latest, so that the axis does not keep moving with a very small
 * deceleration. */
static bool has_stopped(cia402_t *drive, axis_t *axis, bool quick) {
  const bool seen = drive->leaving != 0;
  drive->leaving = 1;
  const bool stands = motion_slow_down(drive, axis, rate_of(drive, quick));
  if (drive->stopping_tick < CIA402_STOPPING_TICKS) {
    drive->stopping_tick = (uint16_t)(drive->stopping_tick + 1);
  }
  return (stands && seen) || drive->stopping_tick == CIA402_STOPPING_TICKS;
}

static void stop_quickly(cia402_t *drive, axis_t *axis) {
  const int16_t option = drive->params.quick_stop_option;
  const bool quick = option != QUICK_STOP_SLOW && option != QUICK_STOP_STAY;
  if (option == QUICK_STOP_DISABLE ||
      (has_stopped(drive, axis, quick) && option < QUICK_STOP_STAY)) {
    enter(drive, AXIS_DRIVE_STATE_SWITCH_ON_DISABLED);
    motion_rest(drive, axis);
  }
}

static void react(cia402_t *drive, axis_t *axis) {
  const int16_t option = drive->params.fault_reaction_option;
  const bool at_once = option == STOP_AT_ONCE;
  if (!at_once && drive->stopping_tick < CIA402_STOPPING_TICKS &&
      !has_stopped(drive, axis, option == STOP_QUICK)) {
    return;
  }
  /* The fault switches the amplifier off, so it waits until the brake of the stopped axis holds. */
  drive->stopping_tick = CIA402_STOPPING_TICKS;
  if (at_once || axis->params.brake_engage_ticks == 0 || is_at_rest(axis)) {
    axis_fault(axis, drive->fault);
    enter(drive, AXIS_DRIVE_STATE_FAULT);
  }
  motion_rest(drive, axis);
}

static void answer_guards(cia402_t *drive, axis_t *axis) {
  const uint8_t halvings = drive->signals.gain_halvings;
  const uint8_t fault = guards_answer(&drive->guards, &drive->params, &drive->signals, axis);
  if (drive->signals.gain_halvings != halvings) {
    cycle_mode_change(drive);
  }
  if (fault != AXIS_FAULT_NONE && state_of(drive) == AXIS_DRIVE_STATE_OPERATION_ENABLED) {
    raise_fault(drive, axis, fault);
  }
}

void cia402_before(cia402_t *drive, axis_t *axis) {
  if (guards_have_finding(&drive->guards)) {
    answer_guards(drive, axis);
  }
  guards_before(&drive->guards);
  drive->slowing = (uint8_t)((drive->slowing == CIA402_SLOWING) ? 1 : 0);
  drive->limited = 0;
  drive->lead_cnt = 0;
  if (state_of(drive) == AXIS_DRIVE_STATE_OPERATION_ENABLED ||
      state_of(drive) == AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE) {
    watch_following(drive, axis);
  } else if (wants_other_mode(drive)) {
    change_mode(drive);
  }
  switch (state_of(drive)) {
    case AXIS_DRIVE_STATE_OPERATION_ENABLED:
      operate(drive, axis);
      break;
    case AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE:
      stop_quickly(drive, axis);
      break;
    case AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE:
      react(drive, axis);
      break;
    case AXIS_DRIVE_STATE_NOT_READY:
      enter(drive, AXIS_DRIVE_STATE_SWITCH_ON_DISABLED);
      motion_rest(drive, axis);
      break;
    default:
      motion_rest(drive, axis);
      break;
  }
  cia402_excite_before(drive, axis);
}

/* Asserts the invariants after each tick: the parameters of the axis have the values that the user
 * has written, and each field is within its range. */
static inline void assert_after_tick(const cia402_t *drive) {
  fx_assert(drive->overridden.active == 0 && drive->mode != NULL);
  fx_assert(drive->signals.drive_state < AXIS_DRIVE_STATE_COUNT);
  fx_assert(drive->signals.stopped_by < AXIS_STOPPED_BY_COUNT);
  fx_assert(drive->tracking <= CIA402_TRACKING_VIRTUAL);
  fx_assert(drive->homing.state <= CIA402_HOMING_ERROR);
  fx_assert(drive->stopping_tick <= CIA402_STOPPING_TICKS);
  fx_assert(drive->speed_max > 0 && drive->acceleration > 0);
  fx_assert(drive->deceleration > 0 && drive->quick_deceleration > 0);
  const cia402_force_bounds_t *bounds = &drive->force_bounds;
  fx_assert(bounds->least <= 0 && bounds->most >= 0);
  fx_assert(bounds->least_q8 <= 0 && bounds->most_q8 >= 0 && bounds->law_q8 >= 0);
  fx_assert(drive->pressed >= -1 && drive->pressed <= 1);
  int32_t travel = 0;
  for (uint8_t i = 0; i < CIA402_MEAN_TICKS; i++) {
    travel = fx_sum_wrap(travel, drive->velocities[i]);
  }
  fx_assert(drive->velocity_next < CIA402_MEAN_TICKS && drive->velocity_sum == travel);
}

void cia402_after(cia402_t *drive, axis_t *axis) {
  cia402_excite_after(drive, axis);
  if (axis->primed == 0) {
    drive->homed = 0; /* While the sensors were invalid, the encoder may have lost counts. */
  }
  const uint8_t controlled = state_of(drive) == AXIS_DRIVE_STATE_OPERATION_ENABLED &&
                             drive->mode->controls_force != 0 &&
                             !axis_drive_is_off(axis->signals.drive_report);
  if (axis->signals.fault != AXIS_FAULT_NONE && state_of(drive) != AXIS_DRIVE_STATE_FAULT) {
    cycle_mode_tick_failed(drive, axis);
    enter(drive, AXIS_DRIVE_STATE_FAULT);
    drive->tracking = CIA402_TRACKING_NONE;
  }
  if (controlled != 0 && drive->controlled == 0 && !cycle_is_running(&drive->cycle)) {
    guards_start(&drive->guards, &drive->signals);
  }
  drive->controlled = controlled;
  if (drive->homing.state == CIA402_HOMING_ASKED) {
    drive->homing.state = CIA402_HOMING_BEGUN;
  }
  cia402_observe(drive, axis);
  cycle_mode_after(drive, axis);
  motion_restore(drive, axis);
  assert_after_tick(drive);
}

/* Changes from the state `operation enabled` to the state `to` after the command `shutdown` or
 * `disable operation`. The change is immediate, or follows a ramp to standstill. */
static void leave_operation(cia402_t *drive, uint8_t to, int16_t option, const axis_t *axis) {
  if (option == STOP_AT_ONCE || motion_stands(drive) || is_at_rest(axis)) {
    enter(drive, to);
    return;
  }
  drive->leaving = 1;
  drive->leaving_to = to;
  cycle_mode_interrupt(drive);
}

/* Carries out the transition that a controlword commands, from one drive state to another. The
 * option codes determine how the axis stops. */
static void go(cia402_t *drive, const axis_t *axis, uint8_t from, uint8_t to) {
  if (first_motion_is_running(&drive->guards.first_motion)) {
    enter(drive,
          (to == AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE) ? AXIS_DRIVE_STATE_SWITCH_ON_DISABLED : to);
  } else if (from == AXIS_DRIVE_STATE_OPERATION_ENABLED && to == AXIS_DRIVE_STATE_SWITCHED_ON) {
    leave_operation(drive, to, drive->params.disable_operation_option, axis);
  } else if (from == AXIS_DRIVE_STATE_OPERATION_ENABLED &&
             to == AXIS_DRIVE_STATE_READY_TO_SWITCH_ON) {
    leave_operation(drive, to, drive->params.shutdown_option, axis);
  } else if (to == AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE &&
             (drive->params.quick_stop_option == QUICK_STOP_DISABLE || is_at_rest(axis))) {
    enter(drive, AXIS_DRIVE_STATE_SWITCH_ON_DISABLED);
  } else {
    enter(drive, to);
  }
}

static void change_state(cia402_t *drive, axis_t *axis, uint16_t controlword, uint16_t rising) {
  const uint8_t from = state_of(drive);
  const bool may_resume = drive->params.quick_stop_option >= QUICK_STOP_STAY;
  const uint8_t to = cia402_next_state(from, controlword, rising, may_resume);
  if (to == from) {
    if (from == AXIS_DRIVE_STATE_OPERATION_ENABLED && cia402_enables(controlword)) {
      /* The controlword enables the axis again during the ramp to standstill. */
      drive->leaving = 0;
    }
    return;
  }
  if (from == AXIS_DRIVE_STATE_FAULT) {
    if (!axis_fault_reset(axis)) {
      return;
    }
    forget_setpoints(axis);
  }
  go(drive, axis, from, to);
  if (to == AXIS_DRIVE_STATE_OPERATION_ENABLED) {
    drive->setpoint.position = cia402_user(drive, axis->signals.position);
    first_motion_begin(&drive->guards.first_motion, &drive->params, &drive->signals);
  }
}

/* Returns true if the start bit of the controlword may start a motion now. */
static bool may_start(const cia402_t *drive) {
  return state_of(drive) == AXIS_DRIVE_STATE_OPERATION_ENABLED && drive->leaving == 0 &&
         !wants_other_mode(drive) && !first_motion_is_running(&drive->guards.first_motion);
}

/* Ends a homing method or a cycle that is running. */
static void interrupt(cia402_t *drive) {
  homing_interrupt(drive);
  cycle_mode_interrupt(drive);
}

/* Reacts to bits 4 to 8 of the controlword, as far as the active mode of operation uses them. */
static void command_mode(cia402_t *drive, const axis_t *axis, uint16_t controlword, uint16_t rising,
                         bool halt_changed) {
  const bool started = (rising & AXIS_CONTROLWORD_START) != 0;
  if ((controlword & AXIS_CONTROLWORD_START) == 0) {
    drive->acknowledged = 0;
    interrupt(drive);
  }
  if (halt_changed) {
    drive->reached_tick = 0;
  }
  if ((rising & AXIS_CONTROLWORD_HALT) != 0) {
    /* After the halt the axis moves only when a new target was written. */
    drive->position_written = 0;
    interrupt(drive);
  }
  if (!started || !may_start(drive)) {
    return;
  }
  switch (drive->signals.modes_of_operation_display) {
    case AXIS_MODES_OF_OPERATION_PROFILE_POSITION:
    case AXIS_MODES_OF_OPERATION_GUARDED_MOVE:
      position_take_setpoint(drive);
      break;
    case AXIS_MODES_OF_OPERATION_HOMING:
      homing_start(drive);
      break;
    case AXIS_MODES_OF_OPERATION_CYCLE:
      cycle_mode_start(drive, axis);
      break;
    default:
      break;
  }
}

/* Returns the controlword with the halt bit if the axis is halted and the new controlword does not
 * enable the axis. A halt ends only with a controlword that enables the axis and has no halt bit. A
 * controlword that commands no transition, for example one with bit 7, does not end the halt. */
static uint16_t with_halt(cia402_t *drive, uint16_t controlword, uint16_t previous) {
  if (state_of(drive) == AXIS_DRIVE_STATE_OPERATION_ENABLED &&
      (previous & AXIS_CONTROLWORD_HALT) != 0 && !cia402_enables(controlword)) {
    drive->params.controlword = (uint16_t)(controlword | AXIS_CONTROLWORD_HALT);
  }
  return drive->params.controlword;
}

void cia402_written(cia402_t *drive, axis_t *axis, uint16_t object, int32_t previous,
                    int32_t value) {
  if (object == AXIS_OBJ_CONTROLWORD) {
    value = with_halt(drive, (uint16_t)value, (uint16_t)previous);
  }
  const uint16_t controlword = (uint16_t)value;
  const uint16_t rising = (uint16_t)(controlword & (uint16_t) ~(uint16_t)previous);
  if (object != AXIS_OBJ_CONTROLWORD && value != previous) {
    /* The drive has to check again whether the target is reached, because the target or a window
     * has changed. */
    drive->reached_tick = 0;
  }
  if (value != previous) {
    guards_written(&drive->guards, &drive->signals, object);
  }
  switch (object) {
    case AXIS_OBJ_CONTROLWORD:
      drive->signals.stopped_by = AXIS_STOPPED_BY_NOBODY;
      change_state(drive, axis, controlword, rising);
      command_mode(drive, axis, controlword, rising,
                   ((value ^ previous) & AXIS_CONTROLWORD_HALT) != 0);
      break;
    case AXIS_OBJ_MODES_OF_OPERATION:
      if (wants_other_mode(drive)) {
        cycle_mode_interrupt(drive);
        if (!cia402_is_powered(state_of(drive)) || motion_stands(drive)) {
          change_mode(drive);
        }
      }
      break;
    case AXIS_OBJ_TARGET_POSITION:
    /* target_position and interpolation_setpoint are two objects that share one value. */
    case AXIS_OBJ_INTERPOLATION_SETPOINT:
      drive->params.target_position = value;
      drive->params.interpolation_setpoint = value;
      drive->position_written = 1;
      drive->interpolation_remaining = fx_ticks_from_period(drive->params.interpolation_period,
                                                            drive->params.interpolation_exponent);
      break;
    case AXIS_OBJ_TARGET_VELOCITY:
      drive->velocity_written = 1;
      break;
    case AXIS_OBJ_TARGET_FORCE:
      drive->force_written = 1;
      break;
    default:
      if (value != previous && parameters_written(drive, object)) {
        /* The targets are discarded, because they were written in other user units or for another
         * direction. */
        cia402_forget_targets(drive);
      }
      break;
  }
  cia402_show(drive, axis);
}

bool cia402_would_enable(const cia402_t *drive, uint16_t controlword) {
  const bool may_resume = drive->params.quick_stop_option >= QUICK_STOP_STAY;
  const uint8_t from = state_of(drive);
  return cia402_next_state(from, controlword, 0, may_resume) ==
             AXIS_DRIVE_STATE_OPERATION_ENABLED &&
         (from != AXIS_DRIVE_STATE_OPERATION_ENABLED || drive->leaving != 0);
}

bool cia402_hold(cia402_t *drive, const axis_t *axis, uint8_t by) {
  if (drive->signals.stopped_by != AXIS_STOPPED_BY_NOBODY) {
    return false;
  }
  drive->signals.stopped_by = by;
  cia402_show(drive, axis);
  return true;
}

void cia402_warn_unsupervised(cia402_t *drive, const axis_t *axis, bool unsupervised) {
  drive->unsupervised = unsupervised ? 1 : 0;
  cia402_show(drive, axis);
}

/* Returns true if the axis moves in this drive state, or if the next controlword can make it
 * move. */
static bool can_move_soon(uint8_t state) {
  return state == AXIS_DRIVE_STATE_READY_TO_SWITCH_ON || state == AXIS_DRIVE_STATE_SWITCHED_ON ||
         state == AXIS_DRIVE_STATE_OPERATION_ENABLED || state == AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE;
}

bool cia402_would_stop(const cia402_t *drive, uint16_t controlword, uint16_t previous) {
  const uint8_t from = state_of(drive);
  return can_move_soon(from) && (cia402_state_below(from, controlword) != from ||
                                 (controlword & ~(uint32_t)previous & AXIS_CONTROLWORD_HALT) != 0);
}

bool cia402_stop(cia402_t *drive, axis_t *axis, uint16_t controlword) {
  const uint8_t from = state_of(drive);
  if (!can_move_soon(from)) {
    return false;
  }
  if ((controlword & ~(uint32_t)drive->params.controlword & AXIS_CONTROLWORD_HALT) != 0) {
    drive->params.controlword = (uint16_t)(drive->params.controlword | AXIS_CONTROLWORD_HALT);
    command_mode(drive, axis, drive->params.controlword, AXIS_CONTROLWORD_HALT, true);
  }
  const uint8_t to = cia402_state_below(from, controlword);
  if (to != from) {
    go(drive, axis, from, to);
  }
  cia402_show(drive, axis);
  return true;
}

void cia402_native_mode(cia402_t *drive, axis_t *axis, uint8_t mode) {
  const uint8_t state = state_of(drive);
  if (mode != AXIS_MODE_DISABLED) {
    drive->signals.stopped_by = AXIS_STOPPED_BY_NOBODY;
    enter(drive, AXIS_DRIVE_STATE_OPERATION_ENABLED);
    first_motion_yield(&drive->guards.first_motion, &drive->signals);
    drive->params.modes_of_operation = cia402_operation_of(mode);
    if (wants_other_mode(drive)) {
      change_mode(drive);
    }
  } else if (state == AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE) {
    axis_fault(axis, drive->fault);
    enter(drive, AXIS_DRIVE_STATE_FAULT);
  } else if (state != AXIS_DRIVE_STATE_FAULT) {
    enter(drive, AXIS_DRIVE_STATE_SWITCH_ON_DISABLED);
  }
  cia402_show(drive, axis);
}

int cia402_fault_reset(cia402_t *drive, axis_t *axis) {
  if (!axis_fault_reset(axis)) {
    return FW_ERROR_STATE;
  }
  if (state_of(drive) == AXIS_DRIVE_STATE_FAULT) {
    forget_setpoints(axis);
    enter(drive, AXIS_DRIVE_STATE_SWITCH_ON_DISABLED);
  }
  cia402_show(drive, axis);
  return FW_OK;
}

bool cia402_owner_lost(cia402_t *drive, axis_t *axis, uint8_t fault) {
  const uint8_t state = state_of(drive);
  contact_excitation_end(&drive->guards.excitation, &drive->signals,
                         AXIS_EXCITATION_STATE_ENDED_OWNER);
  cycle_mode_interrupt(drive);
  if (state != AXIS_DRIVE_STATE_OPERATION_ENABLED ||
      drive->params.abort_connection_option != ABORT_NOTHING) {
    cia402_forget_targets(drive);
    forget_setpoints(axis);
  }
  if (state != AXIS_DRIVE_STATE_OPERATION_ENABLED && state != AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE) {
    return false;
  }
  switch (drive->params.abort_connection_option) {
    case ABORT_FAULT:
      raise_fault(drive, axis, fault);
      break;
    case ABORT_DISABLE:
      enter(drive, AXIS_DRIVE_STATE_SWITCH_ON_DISABLED);
      break;
    case ABORT_QUICK_STOP:
      enter(drive, (first_motion_is_running(&drive->guards.first_motion) || is_at_rest(axis))
                       ? AXIS_DRIVE_STATE_SWITCH_ON_DISABLED
                       : AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE);
      break;
    default:
      return false; /* ABORT_NOTHING */
  }
  cia402_show(drive, axis);
  return true;
}
