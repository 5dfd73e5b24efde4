#include "firmware/drive/position_modes.h"

#include <stddef.h>

#include "firmware/drive/motion.h"
#include "firmware/drive/state.h"
#include "firmware/drive/units.h"
#include "firmware/fx/fx.h"

/* Largest lead of the position set-point that a velocity offset causes, in 1/256 count. With a
 * larger lead the position law saturates. */
#define LEAD_MAX_Q8 (INT32_C(65536) * 256)

void position_take_setpoint(cia402_t *drive) {
  const drive_params_t *params = &drive->params;
  const bool at_once = (params->controlword & AXIS_CONTROLWORD_AT_ONCE) != 0;
  if (drive->setpoint_buffered != 0 && !at_once) {
    return; /* The new set-point is not acknowledged, because another set-point is already buffered.
             */
  }
  cia402_setpoint_t setpoint = {.position = params->target_position,
                                .speed = params->trajectory_velocity};
  if ((params->controlword & AXIS_CONTROLWORD_RELATIVE) != 0) {
    const int64_t wide = (int64_t)drive->setpoint.position + params->target_position;
    setpoint.position = motion_has_limits(drive)
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
  /* The target position is used for this set-point, so a later cyclic mode does not use it. */
  drive->position_written = 0;
  drive->acknowledged = 1;
  drive->reached_tick = 0;
  drive->stopped_by_contact = 0;
}

/* Ends a set-point that the trajectory has reached or passed. If there is a buffered set-point,
 * makes it the active set-point. */
static void end_setpoint(cia402_t *drive) {
  drive->setpoint_active = drive->setpoint_buffered;
  if (drive->setpoint_buffered != 0) {
    drive->setpoint = drive->buffered;
    drive->setpoint_buffered = 0;
  }
}

/* Stores the position of the trajectory as the position of the reached set-point. The position that
 * the client wrote is kept if it is the same encoder count. A conversion of the count would round
 * it, and the rounding errors of relative moves would accumulate. */
static void keep_place(cia402_t *drive) {
  const int32_t count = fx_cnt_from_q32(drive->trajectory.position_q32);
  if (cia402_encoder(drive, drive->setpoint.position) != count) {
    drive->setpoint.position = cia402_user(drive, count);
  }
}

/* Moves the trajectory by one tick towards the set-point. `known` is the distance to the set-point;
 * NULL if the distance is not known. */
static void pursue_setpoint(cia402_t *drive, const motion_distance_t *known) {
  const trajectory_limits_t limits =
      cia402_limits(drive, cia402_speed_q16(drive, drive->setpoint.speed));
  profile_t *trajectory = &drive->trajectory;
  if (drive->setpoint_active == 0) {
    trajectory_ramp(trajectory, 0, &limits);
    keep_place(drive);
    return;
  }
  const int32_t place = motion_within_limits(drive, drive->setpoint.position);
  motion_distance_t distance = (known != NULL) ? *known : motion_distance_to(drive, place);
  if (drive->setpoint_buffered != 0 &&
      (drive->params.controlword & AXIS_CONTROLWORD_CHANGE_ON_SETPOINT) != 0) {
    const motion_distance_t to_buffered =
        motion_distance_to(drive, motion_within_limits(drive, drive->buffered.position));
    if (to_buffered.negative == distance.negative &&
        to_buffered.magnitude_q16 >= distance.magnitude_q16) {
      trajectory_move(trajectory, to_buffered.magnitude_q16, to_buffered.negative, &limits);
      distance = motion_distance_to(drive, place);
      if (distance.negative != to_buffered.negative || distance.magnitude_q16 == 0) {
        end_setpoint(drive);
      }
      return;
    }
  }
  trajectory_move(trajectory, distance.magnitude_q16, distance.negative, &limits);
  if (distance.magnitude_q16 == 0 && trajectory->velocity_q16 == 0) {
    end_setpoint(drive);
  }
}

/* Ends a guarded move at contact. The axis stops at its present position. It does not move on to
 * the position of the trajectory, because the trajectory is ahead of the axis. */
static void stop_by_contact(cia402_t *drive, const axis_t *axis) {
  profile_set(&drive->trajectory, axis->signals.position);
  shaper_clear(&drive->motion_shaper);
  drive->setpoint_active = 0;
  drive->setpoint_buffered = 0;
  drive->stopped_by_contact = 1;
  keep_place(drive);
}

/* Converts a speed in user units per second to Q16 counts per tick in the direction of the encoder,
 * and limits it. */
static int32_t bounded_speed(cia402_t *drive, int32_t per_s) {
  const uint32_t size = fx_magnitude(per_s);
  drive->limited |= (uint8_t)(size > drive->params.velocity_max);
  const int32_t speed = cia402_speed_q16(drive, size);
  return cia402_signed_by(drive, (per_s < 0) ? -speed : speed, AXIS_POLARITY_VELOCITY);
}

/* Returns the target velocity of the active mode. In cyclic velocity mode velocity_offset is
 * added. */
static int32_t wanted_velocity(const cia402_t *drive) {
  const drive_params_t *params = &drive->params;
  const bool cyclic =
      drive->signals.modes_of_operation_display == AXIS_MODES_OF_OPERATION_CYCLIC_VELOCITY;
  return (drive->velocity_written == 0)
             ? 0
             : params->target_velocity + (cyclic ? params->velocity_offset : 0);
}

void position_follow_velocity(cia402_t *drive, bool at_once) {
  trajectory_limits_t limits = cia402_limits(drive, 0);
  const int32_t least = at_once ? TRAJECTORY_RATE_MAX : 0;
  limits.acceleration = (limits.acceleration < least) ? least : limits.acceleration;
  limits.deceleration = (limits.deceleration < least) ? least : limits.deceleration;
  motion_move_at(drive, bounded_speed(drive, wanted_velocity(drive)), &limits);
}

/* Returns the lead of the position set-point with which the position law has the same output as
 * with a velocity offset v. The law with the offset is u = k_p e - k_d (v_axis - v). So the lead is
 * k_d v / k_p. */
static int32_t lead_of(cia402_t *drive, const axis_params_t *gains) {
  if (drive->params.velocity_offset == 0 || gains->position_gain == 0) {
    return 0;
  }
  const int32_t speed_q8 = fx_floor_shift(bounded_speed(drive, drive->params.velocity_offset), 8);
  const uint64_t size_q8 = (uint64_t)fx_magnitude(speed_q8) * gains->velocity_gain;
  const int32_t lead =
      fx_floor_shift(fx_part_q16(size_q8, gains->position_gain, LEAD_MAX_Q8) + 128, 8);
  return (speed_q8 < 0) ? -lead : lead;
}

/* Computes one tick of cyclic position mode. During the interpolation period the axis moves in
 * equal steps to its target. After this period it waits for the next target. */
void position_cyclic(cia402_t *drive, axis_t *axis) {
  const int32_t most = drive->speed_max;
  if (drive->position_written == 0) {
    const trajectory_limits_t limits = cia402_limits(drive, most);
    trajectory_ramp(&drive->trajectory, 0, &limits);
    return;
  }
  const motion_distance_t distance =
      motion_distance_to(drive, motion_within_limits(drive, drive->params.target_position));
  const uint32_t ticks = (drive->interpolation_remaining == 0) ? 1 : drive->interpolation_remaining;
  drive->interpolation_remaining = ticks - 1;
  const int32_t step = fx_part_q16(distance.magnitude_q16, ticks, most);
  drive->limited |= (uint8_t)(step == most);
  drive->lead_cnt = lead_of(drive, &axis->params);
  trajectory_step(&drive->trajectory, distance.negative ? -step : step);
}

void position_guarded_move(cia402_t *drive, axis_t *axis) {
  if ((drive->setpoint_active == 0 && motion_has_place(drive)) || drive->signals.contact == 0) {
    pursue_setpoint(drive, NULL);
    return;
  }
  const motion_distance_t distance =
      motion_distance_from(drive, motion_followed(drive)->position_q32,
                           motion_within_limits(drive, drive->setpoint.position));
  const bool pressing = distance.negative == (axis->signals.force < 0);
  if (pressing && distance.magnitude_q16 != 0) {
    stop_by_contact(drive, axis);
    return;
  }
  /* If the shaped trajectory has reached the unshaped trajectory, the distance to the set-point has
   * already been computed. */
  pursue_setpoint(drive, motion_has_place(drive) ? &distance : NULL);
}

void position_profile(cia402_t *drive, axis_t *axis) {
  (void)axis;
  pursue_setpoint(drive, NULL);
}

void position_profile_velocity(cia402_t *drive, axis_t *axis) {
  (void)axis;
  position_follow_velocity(drive, false);
}

void position_cyclic_velocity(cia402_t *drive, axis_t *axis) {
  (void)axis;
  position_follow_velocity(drive, true);
}

static bool is_in_position_window(const cia402_t *drive, int32_t target) {
  /* The positions are also compared in counts, because one count may be larger than position_window
   * in user units. */
  return fx_magnitude(fx_diff_wrap(target, drive->signals.position_actual)) <=
             drive->params.position_window ||
         cia402_encoder(drive, target) == drive->signals.position_internal;
}

bool position_velocity_reached(const cia402_t *drive, const axis_t *axis) {
  (void)axis;
  return motion_has_speed(drive) &&
         fx_magnitude(fx_diff_wrap(wanted_velocity(drive), drive->signals.velocity_actual)) <=
             drive->params.velocity_window;
}

bool position_setpoint_reached(const cia402_t *drive, const axis_t *axis) {
  (void)axis;
  return drive->setpoint_active == 0 && motion_has_place(drive) &&
         (drive->stopped_by_contact != 0 || is_in_position_window(drive, drive->setpoint.position));
}

bool position_target_reached(const cia402_t *drive, const axis_t *axis) {
  (void)axis;
  return drive->position_written == 0 ||
         (motion_has_place(drive) && is_in_position_window(drive, drive->params.target_position));
}
