#ifndef FIRMWARE_CORE_PROFILE_H_
#define FIRMWARE_CORE_PROFILE_H_

/* Trapezoidal set-point profile, one step a tick, without division or square root.
 *
 * From any state the speed changes by at most the acceleration limit per tick and stays within the
 * velocity limit once it is below it. From rest, and as long as the target and the limits are not
 * changed, the position never passes the target and lands exactly on it, with speed 0 one tick
 * later. A target moved closer than the way needed to stop is passed and returned to; that is the
 * only way to keep the acceleration limit. The way round is the shorter one modulo 2^32.
 *
 * Moves longer than 2^21 counts brake as if 2^21 counts were left until they are: their speed is
 * limited to the one that can be stopped within 2^21 counts. */

#include <stdint.h>

#include "firmware/fx/fx.h"

typedef struct {
  uint64_t position_q32; /* counts modulo 2^32 with 32 fractional bits */
  int32_t velocity_q16;  /* counts per tick, |v| <= 2^27 */
} profile_t;

/* At rest at a count. */
static inline void profile_set(profile_t *profile, int32_t position_cnt) {
  profile->position_q32 = fx_q32_from_cnt(position_cnt);
  profile->velocity_q16 = 0;
}

/* The speed of the next tick on the way to a place at the distance d, Q16: the fastest of `wanted`,
 * the present speed v and the braking or landing step from which the place can be stopped at. v and
 * `wanted` are toward the place, v at most `most` unless it is being lowered; rates up and down. */
static inline int32_t profile_next_speed(uint64_t d, int32_t v, int32_t wanted, int32_t most,
                                         int32_t up, int32_t down) {
  const uint64_t room = fx_stopping_room(down, d);
  if (wanted > down && fx_stops_within(wanted, down, room)) {
    return wanted;
  }
  /* Holding the speed uses up what braking leaves over; after it less than `down` is left over. */
  if (v > down && v <= most && fx_stops_within(v, down, room)) {
    return v;
  }
  /* A step of at most `down` can be stopped in the tick after it: this is the landing. At speeds
   * above twice that the lower bound makes it the braking step. */
  const int32_t limit = (most < down) ? most : down;
  const int32_t landing = (d < (uint64_t)(uint32_t)limit) ? (int32_t)d : limit;
  return fx_clamp(landing, v - down, v + up);
}

/* One tick toward the target. velocity_max 1..2^27, acceleration_max 1..2^24, both Q16. */
void profile_step(profile_t *profile, int32_t target_cnt, uint32_t velocity_max_q16,
                  uint32_t acceleration_max_q16);

#endif
