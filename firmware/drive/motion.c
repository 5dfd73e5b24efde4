#include "firmware/drive/motion.h"

#include "firmware/drive/units.h"
#include "firmware/fx/fx.h"

void motion_restore(cia402_t *drive, axis_t *axis) {
  axis_params_t *params = &axis->params;
  if (drive->overridden.active != 0) {
    params->position_setpoint = drive->overridden.position_setpoint;
    params->force_setpoint = drive->overridden.force_setpoint;
    params->open_loop_code = drive->overridden.open_loop_code;
    params->profile_enable = drive->overridden.profile_enable;
    params->bump_decay_shift = drive->overridden.bump_decay_shift;
    axis->free_codes = axis_codes_all();
    axis->law_codes = axis_codes_all();
    axis->bumpless_contact = 0;
    drive->overridden.active = 0;
  }
}

void motion_rest(cia402_t *drive, axis_t *axis) {
  axis->params.mode = AXIS_MODE_DISABLED;
  if (drive->signals.gain_halvings != 0) {
    drive->signals.gain_halvings = 0;
    axis_halve_force_gain(axis, 0);
  }
  drive->tracking = CIA402_TRACKING_NONE;
  shaper_clear(&drive->force_shaper);
  shaper_clear(&drive->motion_shaper);
}

void motion_shape_step(cia402_t *drive, int32_t before) {
  const int32_t speed = drive->trajectory.velocity_q16;
  if (!shaper_has_begun(&drive->motion_shaper)) {
    if (before != 0) {
      return;
    }
    drive->shaped.position_q32 = fx_q32_advance(drive->trajectory.position_q32, -speed);
  }
  trajectory_step(&drive->shaped, shaper_step(&drive->motion_shaper, speed, 0));
}

void motion_unshape(cia402_t *drive) {
  if (shaper_has_begun(&drive->motion_shaper)) {
    drive->trajectory = drive->shaped;
    shaper_clear(&drive->motion_shaper);
  }
}

void motion_follow(cia402_t *drive, axis_t *axis) {
  motion_override(drive, axis);
  const int32_t setpoint =
      fx_sum_wrap(fx_cnt_from_q32(motion_followed(drive)->position_q32), drive->lead_cnt);
  axis->params.profile_enable = AXIS_PROFILE_ENABLE_RAW_STEP;
  axis->params.position_setpoint = setpoint;
  axis->params.mode = AXIS_MODE_POSITION;
  if (axis->signals.active_mode != AXIS_MODE_POSITION) {
    /* Position mode begins in the next tick. Its first set-point is the value that
     * position_setpoint has now. */
    axis_parameter_written(axis, AXIS_OBJ_POSITION_SETPOINT, setpoint, setpoint);
  }
}

bool motion_begin(cia402_t *drive, axis_t *axis, uint8_t tracking, int32_t most) {
  if (axis->primed == 0) {
    motion_rest(drive, axis);
    return false;
  }
  if (drive->tracking != tracking) {
    drive->settling_tick = 0;
    /* A new ramp to standstill has another start speed, so its deceleration must be computed
     * again. */
    drive->slowing = 0;
    shaper_clear(&drive->force_shaper);
    shaper_clear(&drive->motion_shaper);
    profile_set(&drive->trajectory, axis->signals.position);
    drive->trajectory.velocity_q16 = fx_clamp(motion_axis_speed(axis), -most, most);
    drive->tracking = tracking;
  }
  return true;
}

int32_t motion_least_step(cia402_t *drive, uint32_t size) {
  if (drive->slowing == 0) {
    drive->stop_step =
        (int32_t)fx_quotient(size, CIA402_STOPPING_TICKS - CIA402_SETTLING_TICKS) + 1;
  }
  drive->slowing = CIA402_SLOWING;
  return drive->stop_step;
}

bool motion_slow_down(cia402_t *drive, axis_t *axis, int32_t rate) {
  if (!motion_track_axis(drive, axis)) {
    return true;
  }
  motion_unshape(drive);
  const int32_t least = motion_least_step(drive, fx_magnitude(drive->trajectory.velocity_q16));
  const trajectory_limits_t limits = {.deceleration = (rate < least) ? least : rate};
  trajectory_ramp(&drive->trajectory, 0, &limits);
  motion_follow(drive, axis);
  if (drive->trajectory.velocity_q16 != 0) {
    drive->settling_tick = 0;
    return false;
  }
  if (drive->settling_tick < CIA402_SETTLING_TICKS) {
    drive->settling_tick = (uint8_t)(drive->settling_tick + 1);
  }
  return motion_stands(drive) || drive->settling_tick >= CIA402_SETTLING_TICKS;
}

bool motion_stands(const cia402_t *drive) {
  return drive->tracking == CIA402_TRACKING_AXIS && drive->trajectory.velocity_q16 == 0 &&
         motion_followed(drive)->velocity_q16 == 0 &&
         fx_magnitude(drive->signals.velocity_actual) <= drive->params.velocity_threshold;
}

motion_distance_t motion_distance_from(const cia402_t *drive, uint64_t position_q32, int32_t user) {
  const int32_t at = fx_sum_wrap(fx_cnt_from_q32(position_q32), drive->origin_cnt);
  const int32_t to = cia402_count(drive, user);
  motion_distance_t distance;
  distance.magnitude_q16 = fx_distance_q16(fx_q32_from_cnt(fx_diff_wrap(to, drive->origin_cnt)),
                                           position_q32, &distance.negative);
  const bool forth = fx_diff_wrap(to, at) > 0;
  if (to != at && forth != (to > at) && motion_has_limits(drive)) {
    distance.magnitude_q16 = FX_DISTANCE_MAX_Q16;
    distance.negative = !distance.negative;
  }
  return distance;
}

void motion_move_at(cia402_t *drive, int32_t speed, trajectory_limits_t *limits) {
  limits->speed = (int32_t)fx_magnitude(speed);
  if (speed != 0 && motion_has_limits(drive)) {
    const int32_t at = cia402_user(drive, fx_cnt_from_q32(drive->trajectory.position_q32));
    const bool up = cia402_signed_by(drive, speed, AXIS_POLARITY_POSITION) > 0;
    const int32_t end = up ? drive->params.position_limit_max : drive->params.position_limit_min;
    if (up ? at < end : at > end) {
      motion_move_to(drive, end, limits);
      return;
    }
    drive->limited = 1;
    speed = 0;
  }
  trajectory_ramp(&drive->trajectory, speed, limits);
}
