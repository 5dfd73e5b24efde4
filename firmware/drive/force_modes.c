#include "firmware/drive/force_modes.h"

#include "firmware/drive/motion.h"
#include "firmware/drive/position_modes.h"
#include "firmware/drive/state.h"
#include "firmware/drive/units.h"
#include "firmware/fx/fx.h"

/* Largest magnitude of the object force_setpoint, in 1/256 count of measured force. */
#define FORCE_SETPOINT_MAX INT32_C(65536)

static inline void press(cia402_t *drive, axis_t *axis, int32_t setpoint_q8) {
  motion_override(drive, axis);
  axis->params.force_setpoint = fx_clamp(setpoint_q8, -FORCE_SETPOINT_MAX, FORCE_SETPOINT_MAX);
  axis->params.mode = AXIS_MODE_FORCE;
  motion_restrict_law(drive, axis);
}

/* Moves the axis towards the workpiece in position mode before contact. The direction is the sign
 * of the target, and the speed is at most approach_velocity_max. */
static void approach(cia402_t *drive, axis_t *axis, int32_t target, bool halted) {
  const int32_t speed = units_speed_of_cnt(drive, drive->params.approach_velocity_max);
  if (!motion_track(drive, axis, CIA402_TRACKING_AXIS, speed)) {
    return;
  }
  trajectory_limits_t limits = cia402_limits(drive, 0);
  if (halted) {
    const int32_t least = motion_least_step(drive, fx_magnitude(drive->trajectory.velocity_q16));
    limits.deceleration = (limits.deceleration < least) ? least : limits.deceleration;
  }
  /* The distance by which the trajectory leads the axis is limited. So an axis that was blocked by
   * an obstacle does not move too fast when it is free again. The limit is the travel in a quarter
   * of a second. This is sufficient for a position loop with a bandwidth of more than 4 rad/s. */
  const int32_t lead =
      fx_diff_wrap(fx_cnt_from_q32(drive->trajectory.position_q32), axis->signals.position);
  const int32_t most = fx_floor_shift((int32_t)drive->params.approach_velocity_max, 2) + 16;
  const bool ahead = (target > 0) ? lead > most : lead < -most;
  motion_move_at(drive, (target == 0 || ahead) ? 0 : ((target > 0) ? speed : -speed), &limits);
  motion_follow(drive, axis);
}

/* Returns the force target of a cycle plus the offset of its program. The offset does not change
 * the sign of the target, because the sign is also the direction of the approach. */
static int32_t target_of_cycle_q8(const cia402_t *drive) {
  const int32_t target = drive->cycle.demand_q8;
  const int32_t sum = target + drive->cycle_offset_q8;
  if (target == 0) {
    return 0;
  }
  return (target > 0) ? ((sum > 0) ? sum : 1) : ((sum < 0) ? sum : -1);
}

/* Returns the demanded force before it is limited to its bounds, in 1/256 per mille of the rated
 * force. */
static int32_t wanted_force_q8(const cia402_t *drive) {
  if (cycle_is_running(&drive->cycle)) {
    return target_of_cycle_q8(drive);
  }
  return (drive->force_written != 0)
             ? fx_scale(drive->params.target_force + drive->params.force_offset, 8)
             : 0;
}

static int32_t bounded_force_q8(const cia402_t *drive, int32_t force_q8) {
  const int32_t least_q8 = fx_scale(drive->force_bounds.least, 8);
  const int32_t most_q8 = fx_scale(drive->force_bounds.most, 8);
  return fx_clamp(force_q8, least_q8, most_q8);
}

static inline int32_t bounded_force_q16(const cia402_t *drive, int32_t force_q16) {
  return fx_clamp(force_q16, fx_scale(drive->force_bounds.least, 16),
                  fx_scale(drive->force_bounds.most, 16));
}

/* Returns true during the time contact_loss_dwell after a contact loss. The force law then stays
 * active with a limited pressing code. An immediate approach would drive the axis against a
 * workpiece that moves back. */
static bool dwells_after_loss(cia402_t *drive, const axis_t *axis) {
  if (drive->signals.contact != 0) {
    drive->pressed = (axis->signals.force > 0) ? 1 : -1;
    drive->dwell_remaining = fx_ticks_from_ms(drive->params.contact_loss_dwell);
    return false;
  }
  if (drive->pressing == 0 || drive->dwell_remaining == 0) {
    return false;
  }
  drive->dwell_remaining -= 1;
  return true;
}

/* Limits the DAC code from the contact loss until the end of contact_loss_dwell. contact_loss_cap
 * limits the code in the direction of the lost workpiece, and also in the direction of the present
 * force set-point. */
static void cap_pressing(const cia402_t *drive, axis_t *axis) {
  const int16_t cap = (int16_t)drive->params.contact_loss_cap;
  axis->bounded = AXIS_BOUNDED_TICKS;
  const bool down = axis->params.force_setpoint < 0;
  if (!down || drive->pressed > 0) {
    axis->free_codes.most = cap;
  }
  if (down || drive->pressed < 0) {
    axis->free_codes.least = (int16_t)-cap;
  }
}

/* Moves the demanded force towards the target by the step of one tick. A bound that was reduced
 * limits the ramp and the output of the input shaper at once. A halt bypasses the input shaper, and
 * its ramp starts from the present demanded force. */
static void demand(cia402_t *drive, int32_t target_q8, bool at_once, bool halted) {
  const uint32_t slope = cycle_is_running(&drive->cycle) ? cycle_phase(&drive->cycle)->slope
                                                         : drive->params.force_slope;
  int32_t step = fx_q16_from_per_s(slope);
  if (halted) {
    drive->force_ramp_q16 = drive->force_demand_q16;
    shaper_clear(&drive->force_shaper);
    const int32_t least = motion_least_step(drive, fx_magnitude(drive->force_ramp_q16));
    step = (step < least) ? least : step;
  }
  const int32_t before_q16 = drive->force_ramp_q16;
  const int32_t wanted_q16 = fx_scale(target_q8, 8);
  const int64_t change = (int64_t)wanted_q16 - before_q16;
  drive->force_ramp_q16 = bounded_force_q16(
      drive, (at_once && !halted) ? wanted_q16 : before_q16 + fx_saturate(change, -step, step));
  drive->force_demand_q16 =
      (halted || !shaper_is_on(&drive->force_shaper))
          ? drive->force_ramp_q16
          : bounded_force_q16(drive,
                              shaper_step(&drive->force_shaper, drive->force_ramp_q16, before_q16));
}

/* Controls the force in the modes of CiA 402. The target is in per mille of the rated force. In
 * profile mode the demanded force changes along a ramp to the target. */
static void control_force(cia402_t *drive, axis_t *axis, bool cyclic) {
  const bool halted = (drive->params.controlword & AXIS_CONTROLWORD_HALT) != 0;
  const int32_t wanted = halted ? 0 : wanted_force_q8(drive);
  const int32_t target = bounded_force_q8(drive, wanted);
  drive->limited |= (uint8_t)(target != wanted);
  contact_guard_approach(&drive->guards.contact_guard, target, drive->force_demand_q16);
  const bool dwells = dwells_after_loss(drive, axis);
  if (drive->signals.contact == 0 && !dwells) {
    if (drive->pressing != 0) {
      /* After a contact loss the axis brakes at once. The output gets no bias from bumpless
       * transfer, because this bias would continue the DAC code with which the axis has pressed on
       * the workpiece. */
      motion_override(drive, axis);
      axis->params.bump_decay_shift = 0;
      drive->pressing = 0;
    }
    drive->force_demand_q16 = 0;
    approach(drive, axis, target, halted);
    return;
  }
  if (drive->pressing == 0) {
    /* The demanded force starts from the present measured force. */
    const int32_t reading = fx_ratio_apply(axis->signals.force, drive->force_of_reading, 0);
    drive->force_ramp_q16 =
        fx_scale(fx_clamp(reading, drive->force_bounds.least, drive->force_bounds.most), 16);
    drive->force_demand_q16 = drive->force_ramp_q16;
    shaper_clear(&drive->force_shaper);
    drive->slowing = 0; /* From this tick on, a halt reduces the demanded force by a ramp. */
    drive->pressing = 1;
  }
  demand(drive, target, cyclic, halted);
  drive->tracking = CIA402_TRACKING_NONE;
  press(drive, axis, fx_ratio_apply(drive->force_demand_q16, drive->reading_of_force, 16));
  if (dwells || drive->params.contact_loss_dwell != 0) {
    cap_pressing(drive, axis);
  }
}

void force_profile(cia402_t *drive, axis_t *axis) { control_force(drive, axis, false); }

void force_cyclic(cia402_t *drive, axis_t *axis) { control_force(drive, axis, true); }

/* Stiffness, damping and impedance control (thesis 1.1.3). The force set-point is computed from the
 * errors of position and velocity: f_d = K (x_d - x) + D (v_d - v). The force law controls the
 * force to this set-point. */

static inline bool track_virtual(cia402_t *drive, axis_t *axis) {
  return motion_track(drive, axis, CIA402_TRACKING_VIRTUAL, 0);
}

/* Moves the virtual trajectory by one tick towards the target position. If there is no target, the
 * trajectory slows down to standstill. */
static inline void lead_to_target(cia402_t *drive) {
  const int32_t before = drive->trajectory.velocity_q16;
  const drive_params_t *params = &drive->params;
  const trajectory_limits_t limits =
      cia402_limits(drive, cia402_speed_q16(drive, params->trajectory_velocity));
  if (drive->position_written != 0) {
    motion_move_to(drive, motion_within_limits(drive, params->target_position), &limits);
  } else {
    trajectory_ramp(&drive->trajectory, 0, &limits);
  }
  motion_shape(drive, before);
}

static inline int32_t led_to(const cia402_t *drive) {
  return fx_cnt_from_q32(motion_followed(drive)->position_q32);
}

/* spring() returns the force K (x_d - x), and damper() returns the force D (v_d - v), both in 1/256
 * count of measured force. */
static inline int64_t spring(const cia402_t *drive, const axis_t *axis) {
  const int32_t error = fx_diff_wrap(led_to(drive), axis->signals.position);
  return fx_floor_shift_wide(fx_mul((int32_t)drive->params.stiffness, error), 8);
}
static inline int64_t damper(const cia402_t *drive, const axis_t *axis) {
  const int32_t error_q16 = motion_followed(drive)->velocity_q16 - motion_axis_speed(axis);
  return fx_floor_shift_wide(fx_mul((int32_t)drive->params.damping, error_q16), 16);
}

/* Sets the force set-point to force_q8, limited to the bounds of the demanded force. `demand` is
 * the part of the set-point that does not depend on the motion of the axis. */
static inline void press_limited(cia402_t *drive, axis_t *axis, int64_t force_q8, int32_t demand) {
  press(drive, axis,
        fx_saturate(force_q8, drive->force_bounds.least_q8, drive->force_bounds.most_q8));
  contact_guard_press(&drive->guards.contact_guard, &drive->signals, axis, demand);
}

void force_stiffness(cia402_t *drive, axis_t *axis) {
  if (track_virtual(drive, axis)) {
    lead_to_target(drive);
    press_limited(drive, axis, spring(drive, axis), led_to(drive));
  }
}

void force_damping(cia402_t *drive, axis_t *axis) {
  if (track_virtual(drive, axis)) {
    const int32_t before = drive->trajectory.velocity_q16;
    position_follow_velocity(drive, false);
    motion_shape(drive, before);
    press_limited(drive, axis, damper(drive, axis), drive->trajectory.velocity_q16);
  }
}

void force_impedance(cia402_t *drive, axis_t *axis) {
  if (track_virtual(drive, axis)) {
    lead_to_target(drive);
    press_limited(drive, axis, spring(drive, axis) + damper(drive, axis), led_to(drive));
  }
}

bool force_target_reached(const cia402_t *drive, const axis_t *axis) {
  const int32_t wanted = bounded_force_q8(drive, wanted_force_q8(drive));
  if (drive->pressing == 0) {
    return wanted == 0;
  }
  const int32_t error = fx_diff_wrap(wanted, fx_scale(drive->signals.force_actual, 8));
  return drive->force_demand_q16 == fx_scale(wanted, 8) &&
         fx_within(fx_ratio_apply(error, drive->reading_of_force, 8), axis->params.contact_force);
}
