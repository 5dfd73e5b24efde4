#ifndef FIRMWARE_DRIVE_MOTION_H_
#define FIRMWARE_DRIVE_MOTION_H_

/* Functions with which a mode of operation moves the axis along the trajectory of the drive, within
 * the limits of the axis. They write the mode and the set-points of the axis for the next tick.
 * Positions are in user units. Speeds are in Q16 counts per tick, in the direction of the
 * encoder. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive_state.h"
#include "firmware/drive/trajectory.h"
#include "firmware/fx/fx.h"

/* Longest time in ticks in which the axis may still move after its trajectory has reached
 * standstill: 100 ms. */
enum { CIA402_SETTLING_TICKS = 150 };

/* Saves the parameters of the axis that the drive overrides in the next tick. motion_restore()
 * restores them after this tick. */
static inline void motion_override(cia402_t *drive, const axis_t *axis) {
  const axis_params_t *params = &axis->params;
  if (drive->overridden.active == 0) {
    drive->overridden = (cia402_overridden_t){.position_setpoint = params->position_setpoint,
                                              .force_setpoint = params->force_setpoint,
                                              .open_loop_code = params->open_loop_code,
                                              .profile_enable = params->profile_enable,
                                              .bump_decay_shift = params->bump_decay_shift,
                                              .active = 1};
  }
}
void motion_restore(cia402_t *drive, axis_t *axis);

/* If the force law has no certificate, limits its command in the next tick. Call this function
 * after motion_override(). */
static inline void motion_restrict_law(const cia402_t *drive, axis_t *axis) {
  if (axis->params.output_limit > drive->law_output) {
    const int16_t most = (int16_t)drive->law_output;
    axis->bounded = AXIS_BOUNDED_TICKS;
    axis->law_codes.least = (int16_t)-most;
    axis->law_codes.most = most;
  }
}

/* Disables the axis. If the contact guard has halved the gain of the force law, restores the
 * gain. */
void motion_rest(cia402_t *drive, axis_t *axis);

/* Selects how the trajectory is used: CIA402_TRACKING_AXIS or CIA402_TRACKING_VIRTUAL. A new
 * trajectory begins at the position of the axis and with the speed of the axis. This speed is
 * limited to `most`. Returns false and disables the axis if the axis has not had a valid encoder
 * count yet. */
bool motion_begin(cia402_t *drive, axis_t *axis, uint8_t tracking, int32_t most);
static inline bool motion_track(cia402_t *drive, axis_t *axis, uint8_t tracking, int32_t most) {
  return (axis->primed != 0 && drive->tracking == tracking) ||
         motion_begin(drive, axis, tracking, most);
}
static inline bool motion_track_axis(cia402_t *drive, axis_t *axis) {
  return motion_track(drive, axis, CIA402_TRACKING_AXIS, drive->speed_max);
}

/* Copies the position of the trajectory to the position set-point of the axis. */
void motion_follow(cia402_t *drive, axis_t *axis);

/* A ramp to standstill and the following settling must end within CIA402_STOPPING_TICKS. Returns
 * the smallest decrease per tick that is sufficient for this. `size` is the remaining speed or
 * force. Call this function in each tick of the ramp. */
int32_t motion_least_step(cia402_t *drive, uint32_t size);

/* Computes one tick of a ramp to standstill. The deceleration is `rate` (Q16), or more if the ramp
 * would end too late. After the ramp the axis stays at its position. If the axis does not follow
 * the trajectory yet, the ramp begins at the position and speed of the axis. Returns true when both
 * the trajectory and the axis are at standstill. Also returns true when only the trajectory has
 * been at standstill for CIA402_SETTLING_TICKS, because an axis without power does not follow its
 * trajectory. */
bool motion_slow_down(cia402_t *drive, axis_t *axis, int32_t rate);

/* Returns true if both the trajectory and the axis are at standstill. The axis is at standstill if
 * its speed is at most velocity_threshold. */
bool motion_stands(const cia402_t *drive);

/* Highest speed of the axis, in counts per tick, at which a trajectory may begin. */
enum { MOTION_SPEED_MAX_CNT = 2048 };

/* Returns the trajectory that the axis follows. After the first step of the motion shaper this is
 * the shaped trajectory. */
static inline const profile_t *motion_followed(const cia402_t *drive) {
  return shaper_has_begun(&drive->motion_shaper) ? &drive->shaped : &drive->trajectory;
}

/* Applies input shaping to one step of the trajectory. `before` is the speed of the trajectory
 * before this step. The shaper begins only while the trajectory is at standstill. A trajectory that
 * begins in motion is not shaped until its next standstill. */
void motion_shape_step(cia402_t *drive, int32_t before);
static inline void motion_shape(cia402_t *drive, int32_t before) {
  if (shaper_is_on(&drive->motion_shaper)) {
    motion_shape_step(drive, before);
  }
}

/* Ends input shaping of the trajectory. This is necessary at a stop and at the end of a mode. The
 * trajectory continues from the commanded position and speed of the axis. */
void motion_unshape(cia402_t *drive);

/* Input shaping delays the trajectory that the axis follows. motion_has_place() returns true if the
 * shaped trajectory has reached the position of the unshaped trajectory; motion_has_speed() returns
 * true if it has reached the speed. */
static inline bool motion_has_place(const cia402_t *drive) {
  return motion_followed(drive)->position_q32 == drive->trajectory.position_q32;
}
static inline bool motion_has_speed(const cia402_t *drive) {
  return motion_followed(drive)->velocity_q16 == drive->trajectory.velocity_q16;
}

/* Returns the speed of the axis in Q16 counts per tick. Its magnitude is limited to
 * MOTION_SPEED_MAX_CNT counts per tick. */
static inline int32_t motion_axis_speed(const axis_t *axis) {
  return fx_scale(fx_clamp(axis->signals.velocity, -MOTION_SPEED_MAX_CNT, MOTION_SPEED_MAX_CNT),
                  16);
}

/* motion_has_limits() returns true if positions are limited: by the position limits (607Dh), or
 * because a position in user units must not exceed 32 bits. motion_within_limits() limits a
 * position to these limits. */
static inline bool motion_has_limits(const cia402_t *drive) {
  return drive->units.scaled != 0 || drive->params.position_limit_min != INT32_MIN ||
         drive->params.position_limit_max != INT32_MAX;
}
static inline int32_t motion_within_limits(cia402_t *drive, int32_t user) {
  const int32_t bounded =
      fx_clamp(user, drive->params.position_limit_min, drive->params.position_limit_max);
  drive->limited |= (uint8_t)(bounded != user);
  return bounded;
}

/* Distance from a position to a target position. The start position is a given Q32 position, or the
 * position of the trajectory. The direction is the shorter way modulo 2^32. If positions
 * are limited, it is the direction that does not cross a limit. */
typedef struct {
  uint64_t magnitude_q16;
  bool negative;
} motion_distance_t;
motion_distance_t motion_distance_from(const cia402_t *drive, uint64_t position_q32, int32_t user);
static inline motion_distance_t motion_distance_to(const cia402_t *drive, int32_t user) {
  return motion_distance_from(drive, drive->trajectory.position_q32, user);
}

/* Moves the trajectory by one tick towards a target position. */
static inline void motion_move_to(cia402_t *drive, int32_t user,
                                  const trajectory_limits_t *limits) {
  const motion_distance_t distance = motion_distance_to(drive, user);
  trajectory_move(&drive->trajectory, distance.magnitude_q16, distance.negative, limits);
}

/* Moves the trajectory by one tick towards a target speed. If there is a position limit in the
 * direction of motion, the trajectory stops at this limit. */
void motion_move_at(cia402_t *drive, int32_t speed, trajectory_limits_t *limits);

#endif
