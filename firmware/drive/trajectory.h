#ifndef FIRMWARE_DRIVE_TRAJECTORY_H_
#define FIRMWARE_DRIVE_TRAJECTORY_H_

/* The drive's own trajectory: position and speed of a profile_t, one step a tick. Unlike the
 * axis' profile it brakes by another rate than it speeds up by, and can follow a speed.
 *
 * Speeds are Q16 per tick, -2^27..2^27; rates Q16 per tick squared, 1..2^24. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/profile.h"

typedef struct {
  int32_t speed;        /* never exceeded, but when it is written while the axis is faster: then it
                           is braked down to; >= 0 */
  int32_t acceleration; /* of the speed's growth in a tick */
  int32_t deceleration; /* of its shrinking */
} trajectory_limits_t;

/* The largest rate: practically at once. */
#define TRAJECTORY_RATE_MAX INT32_C(16777216)

/* One tick toward a place at this distance (fx_distance_q16). From rest, and while place and
 * limits stay, it is never passed and landed on exactly, with speed 0 one tick later. */
void trajectory_move(profile_t *trajectory, uint64_t distance_q16, bool negative,
                     const trajectory_limits_t *limits);

/* One tick with the speed going toward `speed` and within limits->speed; a change of sign passes
 * through 0. */
void trajectory_ramp(profile_t *trajectory, int32_t speed, const trajectory_limits_t *limits);

/* One tick at this speed, whatever it was before. */
void trajectory_step(profile_t *trajectory, int32_t speed);

#endif
