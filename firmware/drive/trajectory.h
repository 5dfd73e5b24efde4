#ifndef FIRMWARE_DRIVE_TRAJECTORY_H_
#define FIRMWARE_DRIVE_TRAJECTORY_H_

/* The trajectory of the drive is the position and speed of a profile_t, computed one step in each
 * tick. The profile of the axis (profile.h) has one acceleration limit. The trajectory has separate
 * limits of acceleration and deceleration, and can also follow a target speed.
 *
 * Speeds are in Q16 counts per tick, -2^27..2^27. Accelerations and decelerations are in Q16 counts
 * per tick squared, 1..2^24. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/profile.h"

typedef struct {
  /* limit of the speed, >= 0; if the trajectory is faster, it brakes to this limit */
  int32_t speed;
  int32_t acceleration; /* largest increase of the speed per tick */
  int32_t deceleration; /* largest decrease of the speed per tick */
} trajectory_limits_t;

/* Largest acceleration and deceleration, in Q16 counts per tick squared. With this value the speed
 * reaches its target in practically one tick. */
#define TRAJECTORY_RATE_MAX INT32_C(16777216)

/* Moves the trajectory by one tick towards a position at the distance distance_q16
 * (fx_distance_q16()). If position and limits do not change, a trajectory that starts from
 * standstill never passes the position; it reaches the position exactly, and one tick later the
 * speed is 0. */
void trajectory_move(profile_t *trajectory, uint64_t distance_q16, bool negative,
                     const trajectory_limits_t *limits);

/* Computes one tick of a change of the speed to `speed`. The magnitude of `speed` is limited to
 * limits->speed. If the sign of the speed changes, the speed is 0 for one tick. */
void trajectory_ramp(profile_t *trajectory, int32_t speed, const trajectory_limits_t *limits);

/* Moves the trajectory by one tick at the speed `speed`. The previous speed of the trajectory has
 * no influence. */
void trajectory_step(profile_t *trajectory, int32_t speed);

#endif
