#ifndef FIRMWARE_DRIVE_MOTION_H_
#define FIRMWARE_DRIVE_MOTION_H_

/* Moves the axis for a mode of operation along the trajectory of the drive and within its limits.
 * The functions write mode and set-points of the axis for the next tick. Positions are in user
 * units; speeds are in Q16 counts per tick in the direction of the encoder. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive.h"
#include "firmware/drive/trajectory.h"
#include "firmware/fx/fx.h"

/* Longest time for which the axis may still move after its trajectory has stopped: 100 ms. */
enum { CIA402_SETTLING_TICKS = 150 };

/* Permits overriding parameters of the axis for the next tick, until motion_restore(). */
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

/* Bounds the DAC code of the force law in the next tick if the law has no certificate. Call it
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

/* Disables the axis and ends a reduction of its gain by the contact guard. */
void motion_rest(cia402_t *drive, axis_t *axis);

/* Selects the trajectory, CIA402_TRACKING_AXIS or _VIRTUAL. A new trajectory begins at the position
 * of the axis and at its speed, limited to `most`. Returns false if the axis has not had a valid
 * encoder count yet; the axis is then disabled. */
bool motion_begin(cia402_t *drive, axis_t *axis, uint8_t tracking, int32_t most);
static inline bool motion_track(cia402_t *drive, axis_t *axis, uint8_t tracking, int32_t most) {
  return (axis->primed != 0 && drive->tracking == tracking) ||
         motion_begin(drive, axis, tracking, most);
}
static inline bool motion_track_axis(cia402_t *drive, axis_t *axis) {
  return motion_track(drive, axis, CIA402_TRACKING_AXIS, drive->speed_max);
}

/* Sets the position of the trajectory as the position set-point of the axis. */
void motion_follow(cia402_t *drive, axis_t *axis);

/* Returns the least decrease per tick with which a ramp to standstill ends within
 * CIA402_STOPPING_TICKS, settling included. `size` is the speed or force that remains. Call it in
 * each tick of the ramp. */
int32_t motion_least_step(cia402_t *drive, uint32_t size);

/* Computes one tick of a ramp to standstill with the deceleration `rate` (Q16), or with a larger
 * one if the ramp would end too late. Afterwards the axis stays at its position. Returns true when
 * trajectory and axis are at standstill, or the trajectory alone for CIA402_SETTLING_TICKS, because
 * an axis without power would only coast. If the axis does not follow the trajectory yet, the ramp
 * begins at its position and speed. */
bool motion_slow_down(cia402_t *drive, axis_t *axis, int32_t rate);

/* Whether trajectory and axis are at standstill. For the axis this means a speed within
 * velocity_threshold. */
bool motion_stands(const cia402_t *drive);

/* Highest speed of the axis, in counts per tick, at which a trajectory may begin. */
enum { MOTION_SPEED_MAX_CNT = 2048 };

/* Returns the trajectory that the axis follows: the shaped trajectory once the motion shaper has
 * begun. */
static inline const profile_t *motion_followed(const cia402_t *drive) {
  return shaper_has_begun(&drive->motion_shaper) ? &drive->shaped : &drive->trajectory;
}

/* Shapes a step of the trajectory, whose speed was `before`. The shaper begins only while the
 * trajectory is at standstill; a trajectory that begins in motion is not shaped until then. */
void motion_shape_step(cia402_t *drive, int32_t before);
static inline void motion_shape(cia402_t *drive, int32_t before) {
  if (shaper_is_on(&drive->motion_shaper)) {
    motion_shape_step(drive, before);
  }
}

/* Ends input shaping: the trajectory continues from the commanded position and speed of the axis.
 * Used for stops and when a mode ends. */
void motion_unshape(cia402_t *drive);

/* Input shaping delays the trajectory that the axis follows. The functions return whether it has
 * reached the position, or the speed, of the trajectory before shaping. */
static inline bool motion_has_place(const cia402_t *drive) {
  return motion_followed(drive)->position_q32 == drive->trajectory.position_q32;
}
static inline bool motion_has_speed(const cia402_t *drive) {
  return motion_followed(drive)->velocity_q16 == drive->trajectory.velocity_q16;
}

/* Returns the speed of the axis, limited to the given value. */
static inline int32_t motion_axis_speed(const axis_t *axis) {
  return fx_scale(fx_clamp(axis->signals.velocity, -MOTION_SPEED_MAX_CNT, MOTION_SPEED_MAX_CNT),
                  16);
}

/* Position limits: whether there are limits, or ends of the user units; and a position bounded by
 * these limits. */
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

/* Distance from a position in Q32, or from that of the trajectory, to a target. The direction is
 * that of the shorter distance modulo 2^32; with position limits it is the direction that does not
 * cross them. */
typedef struct {
  uint64_t magnitude_q16;
  bool negative;
} motion_distance_t;
motion_distance_t motion_distance_from(const cia402_t *drive, uint64_t position_q32, int32_t user);
static inline motion_distance_t motion_distance_to(const cia402_t *drive, int32_t user) {
  return motion_distance_from(drive, drive->trajectory.position_q32, user);
}

/* Moves the trajectory by one tick towards a position. */
static inline void motion_move_to(cia402_t *drive, int32_t user,
                                  const trajectory_limits_t *limits) {
  const motion_distance_t distance = motion_distance_to(drive, user);
  trajectory_move(&drive->trajectory, distance.magnitude_q16, distance.negative, limits);
}

/* Moves the trajectory by one tick towards a speed. It stops at a position limit that is ahead of
 * it. */
void motion_move_at(cia402_t *drive, int32_t speed, trajectory_limits_t *limits);

#endif
