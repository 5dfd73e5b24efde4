#include "firmware/drive/force_modes.h"

#include "firmware/drive/motion.h"
#include "firmware/drive/position_modes.h"
#include "firmware/drive/state.h"
#include "firmware/drive/units.h"
#include "firmware/fx/fx.h"

/* Range of force_setpoint. */
#define FORCE_SETPOINT_MAX INT32_C(65536)

static inline void press(cia402_t *drive, axis_t *axis, int32_t setpoint_q8) {
  motion_override(drive, axis);
  axis->params.force_setpoint = fx_clamp(setpoint_q8, -FORCE_SETPOINT_MAX, FORCE_SETPOINT_MAX);
  axis->params.mode = AXIS_MODE_FORCE;
  motion_restrict_law(drive, axis);
}

/* Out of contact: in position mode, toward the sign of the target, at most at
 * approach_velocity_max. */
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
  /* An axis that is held up must not find the trajectory far ahead when it comes free: no more than
   * the way of a quarter second, which a position loop of more than 4 rad/s does not need. */
  const int32_t lead =
      fx_diff_wrap(fx_cnt_from_q32(drive->trajectory.position_q32), axis->signals.position);
  const int32_t most = fx_floor_shift((int32_t)drive->params.approach_velocity_max, 2) + 16;
  const bool ahead = (target > 0) ? lead > most : lead < -most;
  motion_move_at(drive, (target == 0 || ahead) ? 0 : ((target > 0) ? speed : -speed), &limits);
  motion_follow(drive, axis);
}

/* Without the bounds. */
static int32_t wanted_force(const cia402_t *drive) {
  return (drive->force_written != 0) ? drive->params.target_force + drive->params.force_offset : 0;
}

static int32_t bounded_force(const cia402_t *drive, int32_t force) {
  return fx_clamp(force, drive->force_bounds.least, drive->force_bounds.most);
}

/* Contact was lost a short time ago: the law goes on, its pressing capped, because to approach at
 * once throws the axis against a workpiece that comes back. */
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

/* From the reading without contact to the end of the dwell nothing presses with more than
 * contact_loss_cap: toward the workpiece that is lost, nor where the set-point presses by now. */
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

/* One tick of the demanded force toward the target. A halt bypasses the shaper, from the force that
 * is demanded. */
static void demand(cia402_t *drive, int32_t target, bool at_once, bool halted) {
  int32_t step = fx_q16_from_per_s(drive->params.force_slope);
  if (halted) {
    drive->force_ramp_q16 = drive->force_demand_q16;
    shaper_clear(&drive->force_shaper);
    const int32_t least = motion_least_step(drive, fx_magnitude(drive->force_ramp_q16));
    step = (step < least) ? least : step;
  }
  const int32_t before_q16 = drive->force_ramp_q16;
  const int32_t wanted_q16 = fx_scale(target, 16);
  const int64_t change = (int64_t)wanted_q16 - before_q16;
  drive->force_ramp_q16 =
      (at_once && !halted) ? wanted_q16 : before_q16 + fx_saturate(change, -step, step);
  drive->force_demand_q16 =
      (halted || !shaper_is_on(&drive->force_shaper))
          ? drive->force_ramp_q16
          : shaper_step(&drive->force_shaper, drive->force_ramp_q16, before_q16);
}

/* Force of a standard client: per mille of rated force; a profile ramps its demand. */
static void control_force(cia402_t *drive, axis_t *axis, bool cyclic) {
  const bool halted = (drive->params.controlword & CIA402_CW_HALT) != 0;
  const int32_t wanted = halted ? 0 : wanted_force(drive);
  const int32_t target = bounded_force(drive, wanted);
  drive->limited |= (uint8_t)(target != wanted);
  contact_guard_approach(&drive->guards.contact_guard, target, drive->force_demand_q16);
  const bool dwells = dwells_after_loss(drive, axis);
  if (drive->signals.contact == 0 && !dwells) {
    if (drive->pressing != 0) {
      /* Lost: brake at once, without the bias that would carry the pressing code on. */
      motion_override(drive, axis);
      axis->params.bump_decay_shift = 0;
      drive->pressing = 0;
    }
    drive->force_demand_q16 = 0;
    approach(drive, axis, target, halted);
    return;
  }
  if (drive->pressing == 0) {
    /* Go on from the force that is there. */
    const int32_t reading = fx_ratio_apply(axis->signals.force, drive->force_of_reading, 0);
    drive->force_ramp_q16 = fx_scale(bounded_force(drive, reading), 16);
    drive->force_demand_q16 = drive->force_ramp_q16;
    shaper_clear(&drive->force_shaper);
    drive->slowing = 0; /* a halt under way releases the force from now on */
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

/* Stiffness, damping, impedance (thesis, 1.1.3): the errors of position and velocity give the force
 * set-point, f_d = K (x_d - x) + D (v_d - v); the force law does the rest. */

static inline bool track_virtual(cia402_t *drive, axis_t *axis) {
  return motion_track(drive, axis, CIA402_TRACKING_VIRTUAL, 0);
}

/* One tick of the virtual trajectory toward the target position, or to a stand without one. */
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

/* K (x_d - x) and D (v_d - v), in 1/256 count of the reading. */
static inline int64_t spring(const cia402_t *drive, const axis_t *axis) {
  const int32_t error = fx_diff_wrap(led_to(drive), axis->signals.position);
  return fx_floor_shift_wide(fx_mul((int32_t)drive->params.stiffness, error), 8);
}
static inline int64_t damper(const cia402_t *drive, const axis_t *axis) {
  const int32_t error_q16 = motion_followed(drive)->velocity_q16 - motion_axis_speed(axis);
  return fx_floor_shift_wide(fx_mul((int32_t)drive->params.damping, error_q16), 16);
}

/* Presses with this force, within the bounds. `demand` is what it follows from but the axis. */
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
  const int32_t wanted = bounded_force(drive, wanted_force(drive));
  if (drive->pressing == 0) {
    return wanted == 0;
  }
  const int32_t error = fx_diff_wrap(wanted, drive->signals.force_actual);
  return drive->force_demand_q16 == fx_scale(wanted, 16) &&
         fx_within(fx_ratio_apply(error, drive->reading_of_force, 0), axis->params.contact_force);
}
