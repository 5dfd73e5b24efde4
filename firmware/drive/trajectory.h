#ifndef FIRMWARE_DRIVE_TRAJECTORY_H_
#define FIRMWARE_DRIVE_TRAJECTORY_H_

/* The trajectory of the drive: position and speed of a profile_t, computed one step in each tick.
 * Unlike the profile of the axis, it has separate rates of acceleration and deceleration and can
 * follow a speed.
 *
 * Speeds are in Q16 counts per tick, -2^27..2^27; rates are in Q16 counts per tick squared,
 * 1..2^24. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/profile.h"

typedef struct {
  /* limit of the speed, >= 0; a trajectory that is faster when the limit is written brakes down to
   * it */
  int32_t speed;
  int32_t acceleration; /* largest increase of the speed in a tick */
  int32_t deceleration; /* largest decrease of the speed in a tick */
} trajectory_limits_t;

/* Largest rate, in Q16 counts per tick squared. The speed then changes practically at once. */
#define TRAJECTORY_RATE_MAX INT32_C(16777216)

/* Moves the trajectory by one tick towards a position at this distance (fx_distance_q16). A
 * trajectory that starts from standstill never passes the position and reaches it exactly, with
 * speed 0 one tick later, if position and limits do not change. */
void trajectory_move(profile_t *trajectory, uint64_t distance_q16, bool negative,
                     const trajectory_limits_t *limits);

/* Changes the speed by one tick towards `speed`, within limits->speed. A change of sign passes
 * through speed 0. */
void trajectory_ramp(profile_t *trajectory, int32_t speed, const trajectory_limits_t *limits);

/* Moves the trajectory by one tick at this speed, independent of its previous speed. */
void trajectory_step(profile_t *trajectory, int32_t speed);

#endif
