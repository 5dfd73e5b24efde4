#ifndef FIRMWARE_DRIVE_MOTION_H_
#define FIRMWARE_DRIVE_MOTION_H_

/* Moves the axis for a mode of operation: along the drive's trajectory, within its limits. All of
 * it writes mode and set-points of the axis for the coming tick. Positions are the user's, speeds
 * Q16 per tick in the direction of the encoder. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive.h"
#include "firmware/drive/trajectory.h"
#include "firmware/fx/fx.h"

/* How long an axis may take to come to a stand behind its trajectory: 100 ms. */
enum { CIA402_SETTLING_TICKS = 150 };

/* Parameters of the axis may be overridden for the coming tick, until motion_restore(). */
static inline void motion_override(cia402_t *drive, const axis_t *axis) {
  const axis_params_t *params = &axis->params;
  if (drive->overridden.active == 0) {
    drive->overridden = (cia402_overridden_t){.position_setpoint = params->position_setpoint,
                                              .force_setpoint = params->force_setpoint,
                                              .open_loop_code = params->open_loop_code,
                                              .output_limit = params->output_limit,
                                              .profile_enable = params->profile_enable,
                                              .bump_decay_shift = params->bump_decay_shift,
                                              .active = 1};
  }
}
void motion_restore(cia402_t *drive, axis_t *axis);

/* The force law acts in the coming tick: without a certificate its code is bounded. To be called
 * after motion_override(). */
static inline void motion_restrict_law(const cia402_t *drive, axis_t *axis) {
  if (axis->params.output_limit > drive->law_output) {
    const int16_t most = (int16_t)drive->law_output;
    axis->params.output_limit = drive->law_output;
    axis->bounded = AXIS_BOUNDED_TICKS;
    axis->law_codes.least = (int16_t)-most;
    axis->law_codes.most = most;
  }
}

/* The axis disabled, and its gain whole again. */
void motion_rest(cia402_t *drive, axis_t *axis);

/* Chooses the trajectory, CIA402_TRACKING_AXIS or _VIRTUAL; a new one begins at the place and speed
 * of the axis, at most `most`. False: the axis has not had a valid count yet, and rests. */
bool motion_begin(cia402_t *drive, axis_t *axis, uint8_t tracking, int32_t most);
static inline bool motion_track(cia402_t *drive, axis_t *axis, uint8_t tracking, int32_t most) {
  return (axis->primed != 0 && drive->tracking == tracking) ||
         motion_begin(drive, axis, tracking, most);
}
static inline bool motion_track_axis(cia402_t *drive, axis_t *axis) {
  return motion_track(drive, axis, CIA402_TRACKING_AXIS, drive->speed_max);
}

/* The axis goes where the trajectory is. */
void motion_follow(cia402_t *drive, axis_t *axis);

/* In each tick of a ramp to a stand, whose speed or force still is `size`: the least step with
 * which it ends within CIA402_STOPPING_TICKS, the settling included. */
int32_t motion_least_step(cia402_t *drive, uint32_t size);

/* One tick of slowing down at a rate (Q16), or as much faster as it must be to end in time, then of
 * holding. True once trajectory and axis
 * stand, or the trajectory alone for CIA402_SETTLING_TICKS: an amplifier that is switched off lets
 * the axis coast. It begins at the place and speed of the axis unless the axis follows it
 * already. */
bool motion_slow_down(cia402_t *drive, axis_t *axis, int32_t rate);

/* Trajectory and axis both stand: the latter within velocity_threshold. */
bool motion_stands(const cia402_t *drive);

/* Fastest axis that a trajectory may begin with, count a tick. */
enum { MOTION_SPEED_MAX_CNT = 2048 };

/* The trajectory as the axis is commanded along it: shaped, once the motion shaper has begun. */
static inline const profile_t *motion_followed(const cia402_t *drive) {
  return shaper_has_begun(&drive->motion_shaper) ? &drive->shaped : &drive->trajectory;
}

/* After a step of the trajectory, whose speed was `before`: the same step, shaped. The shaper
 * begins while the trajectory stands; a trajectory that begins in motion is not shaped before. */
void motion_shape_step(cia402_t *drive, int32_t before);
static inline void motion_shape(cia402_t *drive, int32_t before) {
  if (shaper_is_on(&drive->motion_shaper)) {
    motion_shape_step(drive, before);
  }
}

/* The trajectory continues unshaped, from the commanded place and speed of the axis: for stops, and
 * at the exit from a mode. */
void motion_unshape(cia402_t *drive);

/* Whether what the axis follows has come to the trajectory's place, or speed. */
static inline bool motion_has_place(const cia402_t *drive) {
  return motion_followed(drive)->position_q32 == drive->trajectory.position_q32;
}
static inline bool motion_has_speed(const cia402_t *drive) {
  return motion_followed(drive)->velocity_q16 == drive->trajectory.velocity_q16;
}

/* Speed of the axis, at most that. */
static inline int32_t motion_axis_speed(const axis_t *axis) {
  return fx_scale(fx_clamp(axis->signals.velocity, -MOTION_SPEED_MAX_CNT, MOTION_SPEED_MAX_CNT),
                  16);
}

/* The position limits: whether there are any, or ends of the user's units, and a position bounded
 * by them. */
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

/* From a place, Q32, or from the trajectory's, to a position: the shorter way round, but with
 * position limits the one that does not cross them. */
typedef struct {
  uint64_t distance_q16;
  bool negative;
} motion_way_t;
motion_way_t motion_way_from(const cia402_t *drive, uint64_t position_q32, int32_t user);
static inline motion_way_t motion_way_to(const cia402_t *drive, int32_t user) {
  return motion_way_from(drive, drive->trajectory.position_q32, user);
}

/* One tick of the trajectory toward a position. */
static inline void motion_move_to(cia402_t *drive, int32_t user,
                                  const trajectory_limits_t *limits) {
  const motion_way_t way = motion_way_to(drive, user);
  trajectory_move(&drive->trajectory, way.distance_q16, way.negative, limits);
}

/* One tick toward a speed; a position limit ahead is a place to stop at. */
void motion_move_at(cia402_t *drive, int32_t speed, trajectory_limits_t *limits);

#endif
