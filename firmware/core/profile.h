#ifndef FIRMWARE_CORE_PROFILE_H_
#define FIRMWARE_CORE_PROFILE_H_

/* Trapezoidal set-point profile, computed one step in each tick without division or square root.
 *
 * The profile can start from any state. In a tick the speed changes at most by the acceleration
 * limit. Once the speed is below the velocity limit, the speed stays below this limit. If target
 * and limits do not change, a profile that starts from rest never passes its target; it reaches the
 * target exactly, and one tick later the speed is 0. If a new target is closer than the braking
 * distance, the profile passes the target and returns, because the acceleration limit has priority.
 * The profile moves in the direction of the shorter distance modulo 2^32.
 *
 * While the distance to the target is more than 2^21 counts, the profile moves at most with the
 * speed from which it can stop within 2^21 counts. */

#include <stdint.h>

#include "firmware/fx/fx.h"

typedef struct {
  uint64_t position_q32; /* position of the profile in counts modulo 2^32, with 32 fractional
                          * bits */
  int32_t velocity_q16;  /* velocity of the profile in Q16 counts per tick, |v| <= 2^27 */
} profile_t;

/* Sets the speed profile to standstill at the position `position_cnt`. */
static inline void profile_set(profile_t *profile, int32_t position_cnt) {
  profile->position_q32 = fx_q32_from_cnt(position_cnt);
  profile->velocity_q16 = 0;
}

/* Returns the speed of the next tick, in Q16 counts per tick, towards a target at the distance d:
 * the highest speed up to `wanted` from which the profile can still stop at the target. v is the
 * present speed. v and `wanted` are positive towards the target. The result is at most `most`,
 * unless v exceeds `most` and the profile brakes. `up` is the acceleration, `down` the
 * deceleration. */
static inline int32_t profile_next_speed(uint64_t d, int32_t v, int32_t wanted, int32_t most,
                                         int32_t up, int32_t down) {
  fx_assert(up > 0 && down > 0 && most >= 0 && (wanted <= most || v > most));
  const uint64_t room = fx_stopping_room(down, d);
  if (wanted > down && fx_stops_within(wanted, down, room)) {
    return wanted;
  }
  /* Keeps the speed v as long as the braking distance at this speed leaves more than one tick of
   * travel to the target. When the profile brakes afterwards, its last speed is below `down`. */
  if (v > down && v <= most && fx_stops_within(v, down, room)) {
    return v;
  }
  /* The last step before the target. After a step of at most `down` the profile can stop in the
   * next tick. If v is more than twice `down`, the lower bound v - down is the result, and the
   * profile brakes. */
  const int32_t limit = (most < down) ? most : down;
  const int32_t landing = (d < (uint64_t)(uint32_t)limit) ? (int32_t)d : limit;
  return fx_clamp(landing, v - down, v + up);
}

/* Computes one tick of motion towards the target. velocity_max is 1..2^27 in Q16 counts per tick.
 * acceleration_max is 1..2^24 in Q16 counts per tick squared. */
void profile_step(profile_t *profile, int32_t target_cnt, uint32_t velocity_max_q16,
                  uint32_t acceleration_max_q16);

#endif
