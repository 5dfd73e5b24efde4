#include "firmware/drive/modes.h"

#include <stddef.h>

#include "firmware/drive/force_modes.h"
#include "firmware/drive/homing.h"
#include "firmware/drive/motion.h"
#include "firmware/drive/position_modes.h"
#include "firmware/drive/state.h"
#include "firmware/fx/fx.h"

static bool follows_command(const cia402_t *drive) {
  return (drive->params.controlword & AXIS_CONTROLWORD_HALT) == 0 && drive->leaving == 0 &&
         drive->params.modes_of_operation == drive->signals.modes_of_operation_display;
}

static uint16_t bits_of(bool bit_12, uint16_t mask_12, bool bit_13, uint16_t mask_13) {
  return (uint16_t)((bit_12 ? mask_12 : 0) | (bit_13 ? mask_13 : 0));
}

/* Each of the following functions returns bits 12 and 13 of the statusword for one group of modes
 * of operation. */
static uint16_t setpoint_bits(const cia402_t *drive) {
  return bits_of(drive->acknowledged != 0 || drive->setpoint_buffered != 0,
                 AXIS_STATUSWORD_ACKNOWLEDGED, drive->outside_tick != 0,
                 AXIS_STATUSWORD_FOLLOWING_ERROR);
}

static uint16_t standing_bits(const cia402_t *drive) {
  const uint32_t ticks = fx_ticks_from_ms(drive->params.velocity_threshold_time);
  return (drive->standing_tick > ticks) ? AXIS_STATUSWORD_SPEED_ZERO : 0;
}

static uint16_t homing_bits(const cia402_t *drive) {
  return bits_of(drive->homing.state == CIA402_HOMING_DONE, AXIS_STATUSWORD_ATTAINED,
                 drive->homing.state == CIA402_HOMING_ERROR, AXIS_STATUSWORD_HOMING_ERROR);
}

static uint16_t cyclic_bits(const cia402_t *drive) {
  return follows_command(drive) ? AXIS_STATUSWORD_FOLLOWS : 0;
}

static uint16_t position_bits(const cia402_t *drive) {
  return bits_of(follows_command(drive), AXIS_STATUSWORD_FOLLOWS, drive->outside_tick != 0,
                 AXIS_STATUSWORD_FOLLOWING_ERROR);
}

uint16_t cia402_cycle_bits(const cia402_t *drive) {
  const uint8_t state = drive->signals.cycle_state;
  return bits_of(state == AXIS_CYCLE_STATE_GOOD || state == AXIS_CYCLE_STATE_BAD ||
                     state == AXIS_CYCLE_STATE_ABORTED,
                 AXIS_STATUSWORD_CYCLE_DONE, state >= AXIS_CYCLE_STATE_BAD,
                 AXIS_STATUSWORD_NOT_GOOD);
}

#define ROW(mode) [AXIS_MODES_OF_OPERATION_##mode + CIA402_MODE_OFFSET]

const cia402_mode_t cia402_modes[CIA402_MODES] = {
    ROW(PROFILE_POSITION) = {.lead = position_profile,
                             .shaped = 1,
                             .window = CIA402_WINDOW_POSITION,
                             .reached = position_setpoint_reached,
                             .bits = setpoint_bits},
    ROW(PROFILE_VELOCITY) = {.lead = position_profile_velocity,
                             .shaped = 1,
                             .window = CIA402_WINDOW_VELOCITY,
                             .reached = position_velocity_reached,
                             .bits = standing_bits},
    ROW(FORCE) = {.run = force_profile,
                  .controls_force = 1,
                  .holds = CIA402_HOLDS_TARGET,
                  .halts_itself = 1,
                  .reached = force_target_reached},
    ROW(HOMING) = {.lead = homing_run, .bits = homing_bits},
    ROW(CYCLIC_POSITION) = {.lead = position_cyclic,
                            .uses_position = 1,
                            .shaped = 1,
                            .window = CIA402_WINDOW_POSITION,
                            .reached = position_target_reached,
                            .bits = position_bits},
    ROW(CYCLIC_VELOCITY) = {.lead = position_cyclic_velocity,
                            .shaped = 1,
                            .window = CIA402_WINDOW_VELOCITY,
                            .reached = position_velocity_reached,
                            .bits = cyclic_bits},
    ROW(CYCLIC_FORCE) = {.run = force_cyclic,
                         .controls_force = 1,
                         .holds = CIA402_HOLDS_TARGET,
                         .halts_itself = 1,
                         .reached = force_target_reached,
                         .bits = cyclic_bits},
    ROW(NONE) = {.lead = homing_run},
    ROW(FORCE_COUNTS) = {.native = AXIS_MODE_FORCE,
                         .controls_force = 1,
                         .holds = CIA402_HOLDS_SETPOINT},
    ROW(OPEN_LOOP) = {.native = AXIS_MODE_OPEN_LOOP},
    ROW(EXCITATION) = {.native = AXIS_MODE_EXCITATION},
    ROW(NATIVE_POSITION) = {.native = AXIS_MODE_POSITION},
    ROW(GUARDED_MOVE) = {.lead = position_guarded_move,
                         .shaped = 1,
                         .window = CIA402_WINDOW_POSITION,
                         .reached = position_setpoint_reached,
                         .bits = setpoint_bits},
    ROW(STIFFNESS) = {.run = force_stiffness,
                      .controls_force = 1,
                      .uses_position = 1,
                      .bits = cyclic_bits},
    ROW(DAMPING) = {.run = force_damping, .controls_force = 1, .bits = cyclic_bits},
    ROW(CYCLE) = {.lead = homing_run, .bits = cia402_cycle_bits},
    ROW(IMPEDANCE) = {.run = force_impedance,
                      .controls_force = 1,
                      .uses_position = 1,
                      .bits = cyclic_bits},
};

bool cia402_mode_exists(int32_t mode) {
  if (mode < -CIA402_MODE_OFFSET || mode >= CIA402_MODES - CIA402_MODE_OFFSET) {
    return false;
  }
  const cia402_mode_t *row = &cia402_modes[mode + CIA402_MODE_OFFSET];
  return row->lead != NULL || row->run != NULL || row->native != AXIS_MODE_DISABLED;
}

int8_t cia402_operation_of(uint8_t native_mode) {
  for (uint8_t i = 0; native_mode != AXIS_MODE_DISABLED && i < CIA402_MODES; i++) {
    if (cia402_modes[i].native == native_mode) {
      return (int8_t)(i - CIA402_MODE_OFFSET);
    }
  }
  return AXIS_MODES_OF_OPERATION_NONE;
}

/* Returns true if the position law moves the axis in the active mode of operation. Mode 0 commands
 * no motion. */
static bool needs_position_gain(const cia402_t *drive) {
  const cia402_mode_t *mode = drive->mode;
  return drive->signals.modes_of_operation_display != AXIS_MODES_OF_OPERATION_NONE &&
         (mode->lead != NULL || mode->halts_itself != 0 || mode->native == AXIS_MODE_POSITION ||
          (mode->controls_force != 0 && drive->guards.contact_guard.speed_q8 != 0));
}

/* Applies input shaping to the force set-point of mode -1. The input shaper starts from the present
 * measured force. */
static void shape_setpoint(cia402_t *drive, axis_t *axis) {
  motion_override(drive, axis);
  axis->params.force_setpoint =
      shaper_step(&drive->force_shaper, axis->params.force_setpoint, axis->signals.force);
  if (drive->uncertified != 0) {
    const int32_t most_q8 = drive->force_bounds.law_q8;
    axis->params.force_setpoint = fx_clamp(axis->params.force_setpoint, -most_q8, most_q8);
  }
}

/* Runs a native mode of the axis with the parameters that the user has written. In a native force
 * mode, the bounds of a force law without a certificate, the input shaper of the force and the
 * contact guard also act. */
static void run_native(cia402_t *drive, axis_t *axis, const cia402_mode_t *mode) {
  if (mode->native == AXIS_MODE_POSITION && drive->tracking == CIA402_TRACKING_AXIS) {
    axis->params.position_setpoint = fx_cnt_from_q32(drive->trajectory.position_q32);
  }
  drive->tracking = CIA402_TRACKING_NONE;
  axis->params.mode = mode->native;
  if (mode->controls_force != 0) {
    const int32_t demand = axis->params.force_setpoint;
    if (drive->guards.contact_guard.speed_q8 != 0 || drive->uncertified != 0) {
      motion_override(drive, axis);
    }
    if (drive->uncertified != 0) {
      const int32_t most_q8 = drive->force_bounds.law_q8;
      axis->params.force_setpoint = fx_clamp(demand, -most_q8, most_q8);
      drive->limited |= (uint8_t)(axis->params.force_setpoint != demand);
      motion_restrict_law(drive, axis);
    }
    if (shaper_is_on(&drive->force_shaper)) {
      shape_setpoint(drive, axis);
    }
    contact_guard_press(&drive->guards.contact_guard, &drive->signals, axis, demand);
  }
}

static void halt(cia402_t *drive, axis_t *axis) {
  (void)motion_slow_down(
      drive, axis,
      (drive->params.halt_option == 1) ? drive->deceleration : drive->quick_deceleration);
}

void cia402_run(cia402_t *drive, axis_t *axis) {
  const cia402_mode_t *mode = drive->mode;
  if (mode->halts_itself == 0 && (drive->params.controlword & AXIS_CONTROLWORD_HALT) != 0) {
    halt(drive, axis);
  } else if (mode->lead != NULL) {
    drive->settling_tick = 0;
    if (motion_track_axis(drive, axis)) {
      const int32_t before = drive->trajectory.velocity_q16;
      mode->lead(drive, axis);
      if (mode->shaped != 0) {
        motion_shape(drive, before);
      }
      motion_follow(drive, axis);
    }
  } else if (mode->run != NULL) {
    mode->run(drive, axis);
  } else {
    run_native(drive, axis, mode);
  }
}

bool cia402_run_first_motion(cia402_t *drive, axis_t *axis) {
  if (axis->params.position_gain == 0 && drive->params.first_motion_test != 0 &&
      needs_position_gain(drive)) {
    first_motion_refuse(&drive->guards.first_motion, &drive->signals, axis);
    return true;
  }
  if (!first_motion_is_running(&drive->guards.first_motion)) {
    return false;
  }
  if (drive->params.modes_of_operation != drive->signals.modes_of_operation_display) {
    cia402_leave_mode(drive);
    cia402_set_mode(drive, drive->params.modes_of_operation);
  }
  motion_override(drive, axis);
  first_motion_command(&drive->guards.first_motion, axis,
                       (drive->params.controlword & AXIS_CONTROLWORD_HALT) != 0);
  return true;
}

bool cia402_is_guided_by_force(const cia402_t *drive) {
  const int8_t mode = drive->signals.modes_of_operation_display;
  return drive->signals.drive_state == AXIS_DRIVE_STATE_OPERATION_ENABLED &&
         !first_motion_is_running(&drive->guards.first_motion) &&
         (drive->mode->controls_force != 0 || drive->mode->lead == position_guarded_move ||
          cycle_is_running(&drive->cycle) ||
          (mode == AXIS_MODES_OF_OPERATION_HOMING && drive->params.homing_method < 0));
}

/* Returns true if the active mode is a force mode that permits excitation, and the axis is neither
 * halted nor about to leave this mode. */
static bool may_be_excited(const cia402_t *drive) {
  const int8_t mode = drive->signals.modes_of_operation_display;
  return drive->signals.drive_state == AXIS_DRIVE_STATE_OPERATION_ENABLED &&
         follows_command(drive) &&
         (mode == AXIS_MODES_OF_OPERATION_FORCE || mode == AXIS_MODES_OF_OPERATION_CYCLIC_FORCE ||
          mode == AXIS_MODES_OF_OPERATION_FORCE_COUNTS);
}

int cia402_excite(cia402_t *drive, const axis_t *axis, bool start) {
  return contact_excitation_command(&drive->guards.excitation, &drive->params, &drive->signals,
                                    axis, start, may_be_excited(drive));
}

void cia402_prepare_excitation(cia402_t *drive, axis_t *axis) {
  contact_excitation_prepare(&drive->guards.excitation, &drive->params, &drive->signals, axis,
                             may_be_excited(drive));
}

static uint8_t cycle_state(const cia402_t *drive) {
  const cycle_t *cycle = &drive->cycle;
  if (drive->cycle_refusal != AXIS_CYCLE_STATE_IDLE) {
    return drive->cycle_refusal;
  }
  switch (cycle->state) {
    case CYCLE_RUNNING:
      return AXIS_CYCLE_STATE_RUNNING;
    case CYCLE_ENDED:
      return AXIS_CYCLE_STATE_EVALUATING;
    case CYCLE_DONE:
      return (cycle->good != 0)                  ? AXIS_CYCLE_STATE_GOOD
             : (cycle->outcome == CYCLE_STOPPED) ? AXIS_CYCLE_STATE_ABORTED
                                                 : AXIS_CYCLE_STATE_BAD;
    default:
      return AXIS_CYCLE_STATE_IDLE;
  }
}

void cia402_show_cycle(cia402_t *drive) {
  drive->signals.cycle_state = cycle_state(drive);
  drive->signals.cycle_phase = drive->cycle.phase;
  drive->signals.cycle_outcome = drive->cycle.outcome;
  drive->signals.cycle_ended_by = drive->cycle.ended_by;
  drive->signals.cycle_outputs = drive->cycle.outputs;
}

void cia402_leave_mode(cia402_t *drive) {
  if (cycle_is_running(&drive->cycle)) {
    cycle_abort(&drive->cycle);
    if (drive->cycle.state == CYCLE_IDLE) {
      /* The cycle was stopped before its first tick, so it is not counted. */
      drive->signals.cycle_count -= 1;
    }
    cia402_show_cycle(drive);
  }
  cia402_set_mode(drive, drive->signals.modes_of_operation_display);
  cia402_end_mode(drive);
}

void cia402_end_mode(cia402_t *drive) {
  motion_unshape(drive);
  shaper_clear(&drive->force_shaper);
  if (drive->mode->uses_position != 0) {
    drive->position_written = 0;
  }
  drive->setpoint_active = 0;
  drive->setpoint_buffered = 0;
  drive->acknowledged = 0;
  drive->stopped_by_contact = 0;
  drive->homing.state = CIA402_HOMING_IDLE;
  drive->interpolation_remaining = 0;
  drive->force_demand_q16 = 0;
  drive->pressing = 0;
  drive->reached_tick = 0;
  drive->standing_tick = 0;
}
