#include "firmware/drive/modes.h"

#include "firmware/drive/state.h"
#include "firmware/drive/trajectory.h"
#include "firmware/drive/units.h"
#include "firmware/fx/fx.h"

/* Range of force_setpoint. */
#define FORCE_SETPOINT_MAX INT32_C(65536)

/* Fastest axis that a trajectory may begin with, count a tick. */
enum { SPEED_MAX_CNT = 2048 };

bool cia402_mode_exists(int32_t mode) {
  switch (mode) {
    case AXIS_MODES_OF_OPERATION_PROFILE_POSITION:
    case AXIS_MODES_OF_OPERATION_PROFILE_VELOCITY:
    case AXIS_MODES_OF_OPERATION_FORCE:
    case AXIS_MODES_OF_OPERATION_HOMING:
    case AXIS_MODES_OF_OPERATION_CYCLIC_POSITION:
    case AXIS_MODES_OF_OPERATION_CYCLIC_VELOCITY:
    case AXIS_MODES_OF_OPERATION_CYCLIC_FORCE:
      return true;
    default:
      return mode >= AXIS_MODES_OF_OPERATION_IMPEDANCE && mode <= AXIS_MODES_OF_OPERATION_NONE;
  }
}

/* --- lending ---------------------------------------------------------------------------------- */

static void lend(cia402_t *drive, axis_t *axis) {
  axis_params_t *params = &axis->params;
  if (drive->lent.lent == 0) {
    drive->lent = (cia402_lent_t){.position_setpoint = params->position_setpoint,
                                  .force_setpoint = params->force_setpoint,
                                  .profile_enable = params->profile_enable,
                                  .bump_decay_shift = params->bump_decay_shift,
                                  .lent = 1};
  }
}

void cia402_take_back(cia402_t *drive, axis_t *axis) {
  axis_params_t *params = &axis->params;
  if (drive->lent.lent != 0) {
    params->position_setpoint = drive->lent.position_setpoint;
    params->force_setpoint = drive->lent.force_setpoint;
    params->profile_enable = drive->lent.profile_enable;
    params->bump_decay_shift = drive->lent.bump_decay_shift;
    drive->lent.lent = 0;
  }
}

void cia402_rest(cia402_t *drive, axis_t *axis) {
  axis->params.mode = AXIS_MODE_DISABLED;
  drive->tracking = CIA402_TRACKING_NONE;
}

/* The axis goes where the trajectory is. */
static void follow(cia402_t *drive, axis_t *axis) {
  lend(drive, axis);
  const int32_t setpoint = fx_cnt_from_q32(drive->trajectory.position_q32);
  axis->params.profile_enable = AXIS_PROFILE_ENABLE_RAW_STEP;
  axis->params.position_setpoint = setpoint;
  axis->params.mode = AXIS_MODE_POSITION;
  if (axis->signals.active_mode != AXIS_MODE_POSITION) {
    /* To be pursued by the position mode that begins. */
    axis_parameter_written(axis, AXIS_OBJ_POSITION_SETPOINT, setpoint, setpoint);
  }
}

static void press(cia402_t *drive, axis_t *axis, int32_t setpoint_q8) {
  lend(drive, axis);
  axis->params.force_setpoint = fx_clamp(setpoint_q8, -FORCE_SETPOINT_MAX, FORCE_SETPOINT_MAX);
  axis->params.mode = AXIS_MODE_FORCE;
}

/* --- trajectory ------------------------------------------------------------------------------- */

static int32_t axis_speed_q16(const axis_t *axis) {
  return fx_scale(fx_clamp(axis->signals.velocity, -SPEED_MAX_CNT, SPEED_MAX_CNT), 16);
}

/* The trajectory of the axis or the virtual one; begun at the place and speed of the axis, at most
 * `most`. False: the axis has not seen a count yet, and rests. */
static bool track(cia402_t *drive, axis_t *axis, uint8_t tracking, int32_t most) {
  if (axis->primed == 0) {
    cia402_rest(drive, axis);
    return false;
  }
  if (drive->tracking != tracking) {
    drive->settling_tick = 0;
    profile_set(&drive->trajectory, axis->signals.position);
    drive->trajectory.velocity_q16 = fx_clamp(axis_speed_q16(axis), -most, most);
    drive->tracking = tracking;
  }
  return true;
}

static bool track_axis(cia402_t *drive, axis_t *axis) {
  return track(drive, axis, CIA402_TRACKING_AXIS, drive->speed_max);
}

bool cia402_slow_down(cia402_t *drive, axis_t *axis, int32_t rate) {
  if (!track_axis(drive, axis)) {
    return true;
  }
  const trajectory_limits_t limits = {.deceleration = rate};
  trajectory_ramp(&drive->trajectory, 0, &limits);
  follow(drive, axis);
  if (drive->trajectory.velocity_q16 != 0) {
    drive->settling_tick = 0;
    return false;
  }
  if (drive->settling_tick < CIA402_SETTLING_TICKS) {
    drive->settling_tick = (uint8_t)(drive->settling_tick + 1);
  }
  return cia402_stands(drive) || drive->settling_tick >= CIA402_SETTLING_TICKS;
}

bool cia402_stands(const cia402_t *drive) {
  return drive->tracking == CIA402_TRACKING_AXIS && drive->trajectory.velocity_q16 == 0 &&
         fx_magnitude(drive->signals.velocity_actual) <= drive->params.velocity_threshold;
}

static bool has_limits(const cia402_t *drive) {
  return drive->params.position_limit_min != INT32_MIN ||
         drive->params.position_limit_max != INT32_MAX;
}

static int32_t within_limits(cia402_t *drive, int32_t user) {
  const int32_t drawn =
      fx_clamp(user, drive->params.position_limit_min, drive->params.position_limit_max);
  drive->limited |= (uint8_t)(drawn != user);
  return drawn;
}

typedef struct {
  uint64_t distance_q16;
  bool negative;
} way_t;

/* From the trajectory to a user's position: the shorter way round, but with position limits the
 * one that does not cross them. */
static way_t way_to(const cia402_t *drive, int32_t user) {
  const uint64_t position_q32 = drive->trajectory.position_q32;
  const int32_t at = cia402_user(drive, fx_cnt_from_q32(position_q32));
  way_t way;
  way.distance_q16 =
      fx_distance_q16(fx_q32_from_cnt(cia402_encoder(drive, user)), position_q32, &way.negative);
  const bool forth = fx_diff_wrap(user, at) > 0;
  if (user != at && forth != (user > at) && has_limits(drive)) {
    way.distance_q16 = FX_DISTANCE_MAX_Q16;
    way.negative = !way.negative;
  }
  return way;
}

static void move_to(cia402_t *drive, int32_t user, const trajectory_limits_t *limits) {
  const way_t way = way_to(drive, user);
  trajectory_move(&drive->trajectory, way.distance_q16, way.negative, limits);
}

/* A user's speed, bounded, as Q16 in the direction of the encoder. */
static int32_t bounded_speed(cia402_t *drive, int32_t count_per_s) {
  const uint32_t size = fx_magnitude(count_per_s);
  drive->limited |= (uint8_t)(size > drive->params.velocity_max);
  const int32_t speed = cia402_speed_q16(drive, size);
  return cia402_signed_by(drive, (count_per_s < 0) ? -speed : speed, CIA402_POLARITY_VELOCITY);
}

/* One tick toward a speed; a position limit ahead is a place to stop at. */
static void move_at(cia402_t *drive, int32_t speed, trajectory_limits_t *limits) {
  limits->speed = (int32_t)fx_magnitude(speed);
  if (speed != 0 && has_limits(drive)) {
    const int32_t at = cia402_user(drive, fx_cnt_from_q32(drive->trajectory.position_q32));
    const bool up = cia402_signed_by(drive, speed, CIA402_POLARITY_POSITION) > 0;
    const int32_t end = up ? drive->params.position_limit_max : drive->params.position_limit_min;
    if (up ? at < end : at > end) {
      move_to(drive, end, limits);
      return;
    }
    drive->limited = 1;
    speed = 0;
  }
  trajectory_ramp(&drive->trajectory, speed, limits);
}

/* --- profile position, guarded move ----------------------------------------------------------- */

void cia402_take_setpoint(cia402_t *drive) {
  const drive_params_t *params = &drive->params;
  const bool at_once = (params->controlword & CIA402_CW_MODE_5) != 0;
  if (drive->setpoint_buffered != 0 && !at_once) {
    return; /* no room: stays unacknowledged */
  }
  cia402_setpoint_t setpoint = {.position = params->target_position,
                                .speed = params->trajectory_velocity};
  if ((params->controlword & CIA402_CW_MODE_6) != 0) {
    const int64_t wide = (int64_t)drive->setpoint.position + params->target_position;
    setpoint.position = has_limits(drive)
                            ? fx_saturate(wide, INT32_MIN, INT32_MAX)
                            : fx_sum_wrap(drive->setpoint.position, params->target_position);
  }
  if (drive->setpoint_active == 0 || at_once) {
    drive->setpoint = setpoint;
    drive->setpoint_active = 1;
    drive->setpoint_buffered = 0;
  } else {
    drive->buffered = setpoint;
    drive->setpoint_buffered = 1;
  }
  drive->position_written = 0; /* it was written for this, not for a cyclic mode to come */
  drive->acknowledged = 1;
  drive->reached_tick = 0;
  drive->stopped_by_contact = 0;
}

/* The set-point was reached or passed: on to the buffered one, if there is one. */
static void end_setpoint(cia402_t *drive) {
  drive->setpoint_active = drive->setpoint_buffered;
  if (drive->setpoint_buffered != 0) {
    drive->setpoint = drive->buffered;
    drive->setpoint_buffered = 0;
  }
}

static void pursue_setpoint(cia402_t *drive) {
  const trajectory_limits_t limits =
      cia402_limits(drive, cia402_speed_q16(drive, drive->setpoint.speed));
  profile_t *trajectory = &drive->trajectory;
  if (drive->setpoint_active == 0) {
    trajectory_ramp(trajectory, 0, &limits);
    drive->setpoint.position = cia402_user(drive, fx_cnt_from_q32(trajectory->position_q32));
    return;
  }
  const int32_t place = within_limits(drive, drive->setpoint.position);
  way_t way = way_to(drive, place);
  if (drive->setpoint_buffered != 0 &&
      (drive->params.controlword & CIA402_CW_CHANGE_ON_SETPOINT) != 0) {
    const way_t on = way_to(drive, within_limits(drive, drive->buffered.position));
    if (on.negative == way.negative && on.distance_q16 >= way.distance_q16) {
      trajectory_move(trajectory, on.distance_q16, on.negative, &limits);
      way = way_to(drive, place);
      if (way.negative != on.negative || way.distance_q16 == 0) {
        end_setpoint(drive);
      }
      return;
    }
  }
  trajectory_move(trajectory, way.distance_q16, way.negative, &limits);
  if (way.distance_q16 == 0 && trajectory->velocity_q16 == 0) {
    end_setpoint(drive);
  }
}

/* Contact in the direction of the way: stop where the axis is, without the trajectory's lead. */
static void guard_move(cia402_t *drive, const axis_t *axis) {
  if (drive->setpoint_active == 0 || drive->signals.contact == 0) {
    return;
  }
  const way_t way = way_to(drive, within_limits(drive, drive->setpoint.position));
  const bool pressing = way.negative == (axis->signals.force < 0);
  if (pressing && way.distance_q16 != 0) {
    profile_set(&drive->trajectory, axis->signals.position);
    drive->setpoint_active = 0;
    drive->setpoint_buffered = 0;
    drive->stopped_by_contact = 1;
  }
}

/* --- the other modes of position and velocity ------------------------------------------------- */

static void follow_velocity(cia402_t *drive, bool at_once) {
  trajectory_limits_t limits = cia402_limits(drive, 0);
  const int32_t wanted = (drive->velocity_written != 0) ? drive->params.target_velocity : 0;
  if (at_once) {
    limits.acceleration = TRAJECTORY_RATE_MAX;
    limits.deceleration = TRAJECTORY_RATE_MAX;
  }
  move_at(drive, bounded_speed(drive, wanted), &limits);
}

/* Cyclic position: in equal steps over the interpolation period, then wait for the next target. */
static void interpolate(cia402_t *drive) {
  const int32_t most = drive->speed_max;
  if (drive->position_written == 0) {
    const trajectory_limits_t limits = cia402_limits(drive, most);
    trajectory_ramp(&drive->trajectory, 0, &limits);
    return;
  }
  const way_t way = way_to(drive, within_limits(drive, drive->params.target_position));
  const uint32_t ticks = (drive->interpolation_left == 0) ? 1 : drive->interpolation_left;
  drive->interpolation_left = ticks - 1;
  const int32_t step = fx_part_q16(way.distance_q16, ticks, most);
  drive->limited |= (uint8_t)(step == most);
  trajectory_step(&drive->trajectory, way.negative ? -step : step);
}

/* Methods 35 and 37: the place where the axis stands is home_offset. An axis that still moves
 * behind its trajectory would call a place home that it has left. */
static void home(cia402_t *drive, const axis_t *axis) {
  const trajectory_limits_t limits = cia402_limits(drive, 0);
  trajectory_ramp(&drive->trajectory, 0, &limits);
  if (drive->homing != CIA402_HOMING_BEGUN || !cia402_stands(drive)) {
    return;
  }
  if (drive->params.homing_method == 0) {
    drive->homing = CIA402_HOMING_ERROR;
    return;
  }
  const int32_t offset =
      cia402_signed_by(drive, drive->params.home_offset, CIA402_POLARITY_POSITION);
  drive->origin_cnt = fx_diff_wrap(offset, axis->signals.position);
  drive->position_written = 0; /* it was meant from another origin */
  drive->homing = CIA402_HOMING_DONE;
}

/* --- force ------------------------------------------------------------------------------------ */

/* Out of contact: in position mode, toward the sign of the target, at most at
 * approach_velocity_max. */
static void approach(cia402_t *drive, axis_t *axis, int32_t target) {
  const int32_t speed = cia402_speed_q16(drive, drive->params.approach_velocity_max);
  if (!track(drive, axis, CIA402_TRACKING_AXIS, speed)) {
    return;
  }
  trajectory_limits_t limits = cia402_limits(drive, 0);
  /* An axis that is held up must not find the trajectory far ahead when it comes free: no more than
   * the way of a quarter second, which a position loop of more than 4 rad/s does not need. */
  const int32_t lead =
      fx_diff_wrap(fx_cnt_from_q32(drive->trajectory.position_q32), axis->signals.position);
  const int32_t most = fx_floor_shift((int32_t)drive->params.approach_velocity_max, 2) + 16;
  const bool ahead = (target > 0) ? lead > most : lead < -most;
  move_at(drive, (target == 0 || ahead) ? 0 : ((target > 0) ? speed : -speed), &limits);
  follow(drive, axis);
}

/* Force of a standard client: per mille of rated force; `ramp` per mille a tick, Q16. */
static void control_force(cia402_t *drive, axis_t *axis, bool cyclic, bool halted) {
  const int32_t limit = drive->params.force_limit;
  int32_t target = (drive->force_written != 0 && !halted) ? drive->params.target_force : 0;
  drive->limited |= (uint8_t)!fx_within(target, limit);
  target = fx_clamp(target, -limit, limit);
  if (drive->signals.contact == 0) {
    if (drive->pressing != 0) {
      /* Lost: brake at once, without the bias that would carry the pressing code on. */
      lend(drive, axis);
      axis->params.bump_decay_shift = 0;
      drive->pressing = 0;
    }
    drive->force_demand_q16 = 0;
    approach(drive, axis, target);
    return;
  }
  if (drive->pressing == 0) {
    /* Go on from the force that is there. */
    const int32_t reading = fx_ratio_apply(axis->signals.force, drive->force_of_reading, 0);
    drive->force_demand_q16 = fx_scale(fx_clamp(reading, -limit, limit), 16);
    drive->pressing = 1;
  }
  const int32_t wanted_q16 = fx_scale(target, 16);
  const int32_t step = fx_q16_from_per_s(drive->params.force_slope);
  const int64_t change = (int64_t)wanted_q16 - drive->force_demand_q16;
  drive->force_demand_q16 =
      (cyclic && !halted) ? wanted_q16 : drive->force_demand_q16 + fx_saturate(change, -step, step);
  drive->tracking = CIA402_TRACKING_NONE;
  press(drive, axis, fx_ratio_apply(drive->force_demand_q16, drive->reading_of_force, 16));
}

/* Stiffness, damping, impedance (thesis, 1.1.3): the errors of position and velocity give the force
 * set-point, f_d = K (x_d - x) + D (v_d - v); the force law does the rest. */
static void control_impedance(cia402_t *drive, axis_t *axis, int8_t mode) {
  const drive_params_t *params = &drive->params;
  if (!track(drive, axis, CIA402_TRACKING_VIRTUAL, 0)) {
    return;
  }
  trajectory_limits_t limits =
      cia402_limits(drive, cia402_speed_q16(drive, params->trajectory_velocity));
  if (mode == AXIS_MODES_OF_OPERATION_DAMPING) {
    follow_velocity(drive, false);
  } else if (drive->position_written != 0) {
    move_to(drive, within_limits(drive, params->target_position), &limits);
  } else {
    trajectory_ramp(&drive->trajectory, 0, &limits);
  }
  const int32_t position_error =
      fx_diff_wrap(fx_cnt_from_q32(drive->trajectory.position_q32), axis->signals.position);
  const int32_t velocity_error_q16 = drive->trajectory.velocity_q16 - axis_speed_q16(axis);
  const int64_t spring =
      (mode == AXIS_MODES_OF_OPERATION_DAMPING)
          ? 0
          : fx_floor_shift_wide(fx_mul((int32_t)params->stiffness, position_error), 8);
  const int64_t damper =
      (mode == AXIS_MODES_OF_OPERATION_STIFFNESS)
          ? 0
          : fx_floor_shift_wide(fx_mul((int32_t)params->damping, velocity_error_q16), 16);
  const int32_t limit = fx_ratio_apply(params->force_limit, drive->reading_of_force, 0);
  press(drive, axis, fx_saturate(spring + damper, -limit, limit));
}

/* --- all -------------------------------------------------------------------------------------- */

/* Modes of the axis itself, with the user's parameters. */
static void run_native(cia402_t *drive, axis_t *axis, uint8_t mode) {
  if (mode == AXIS_MODE_POSITION && drive->tracking == CIA402_TRACKING_AXIS) {
    axis->params.position_setpoint = fx_cnt_from_q32(drive->trajectory.position_q32);
  }
  drive->tracking = CIA402_TRACKING_NONE;
  axis->params.mode = mode;
}

static void halt(cia402_t *drive, axis_t *axis) {
  (void)cia402_slow_down(
      drive, axis,
      (drive->params.halt_option == 1) ? drive->deceleration : drive->quick_deceleration);
}

/* Modes that lead the axis along the trajectory. */
static void run_trajectory(cia402_t *drive, axis_t *axis, int8_t mode) {
  if (!track_axis(drive, axis)) {
    return;
  }
  switch (mode) {
    case AXIS_MODES_OF_OPERATION_GUARDED_MOVE:
      guard_move(drive, axis);
      pursue_setpoint(drive);
      break;
    case AXIS_MODES_OF_OPERATION_PROFILE_POSITION:
      pursue_setpoint(drive);
      break;
    case AXIS_MODES_OF_OPERATION_PROFILE_VELOCITY:
      follow_velocity(drive, false);
      break;
    case AXIS_MODES_OF_OPERATION_CYCLIC_VELOCITY:
      follow_velocity(drive, true);
      break;
    case AXIS_MODES_OF_OPERATION_CYCLIC_POSITION:
      interpolate(drive);
      break;
    default:
      home(drive, axis); /* and mode none, which only holds */
      break;
  }
  follow(drive, axis);
}

void cia402_run(cia402_t *drive, axis_t *axis) {
  const int8_t mode = drive->signals.modes_of_operation_display;
  const bool halted = (drive->params.controlword & CIA402_CW_HALT) != 0;
  if (mode == AXIS_MODES_OF_OPERATION_FORCE || mode == AXIS_MODES_OF_OPERATION_CYCLIC_FORCE) {
    control_force(drive, axis, mode == AXIS_MODES_OF_OPERATION_CYCLIC_FORCE, halted);
    return;
  }
  if (halted) {
    halt(drive, axis);
    return;
  }
  switch (mode) {
    case AXIS_MODES_OF_OPERATION_FORCE_COUNTS:
      run_native(drive, axis, AXIS_MODE_FORCE);
      break;
    case AXIS_MODES_OF_OPERATION_OPEN_LOOP:
      run_native(drive, axis, AXIS_MODE_OPEN_LOOP);
      break;
    case AXIS_MODES_OF_OPERATION_EXCITATION:
      run_native(drive, axis, AXIS_MODE_EXCITATION);
      break;
    case AXIS_MODES_OF_OPERATION_NATIVE_POSITION:
      run_native(drive, axis, AXIS_MODE_POSITION);
      break;
    case AXIS_MODES_OF_OPERATION_STIFFNESS:
    case AXIS_MODES_OF_OPERATION_DAMPING:
    case AXIS_MODES_OF_OPERATION_IMPEDANCE:
      control_impedance(drive, axis, mode);
      break;
    default:
      run_trajectory(drive, axis, mode);
      drive->settling_tick = 0;
      break;
  }
}

void cia402_leave_mode(cia402_t *drive) {
  const int8_t mode = drive->signals.modes_of_operation_display;
  if (mode == AXIS_MODES_OF_OPERATION_CYCLIC_POSITION ||
      mode == AXIS_MODES_OF_OPERATION_STIFFNESS || mode == AXIS_MODES_OF_OPERATION_IMPEDANCE) {
    drive->position_written = 0;
  }
  drive->setpoint_active = 0;
  drive->setpoint_buffered = 0;
  drive->acknowledged = 0;
  drive->stopped_by_contact = 0;
  drive->homing = CIA402_HOMING_IDLE;
  drive->interpolation_left = 0;
  drive->force_demand_q16 = 0;
  drive->pressing = 0;
  drive->reached_tick = 0;
  drive->standing_tick = 0;
}
