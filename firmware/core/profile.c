#include "firmware/core/profile.h"

#include "firmware/fx/fx.h"

/* The speed of the next tick; d is the distance to the target, v the speed toward it. */
static int32_t next_speed(uint64_t d, int32_t v, int32_t v_max, int32_t a) {
  const uint64_t room = fx_stopping_room(a, d);
  if (v <= v_max && (v <= a || fx_stops_within(v, a, room))) {
    const int32_t up = (v_max - v < a) ? v_max : v + a;
    if (up > a && fx_stops_within(up, a, room)) {
      return up;
    }
    /* Holding the speed uses up what braking leaves over; after it less than a is left over. */
    if (v > a) {
      return v;
    }
  }
  /* A step of at most a can be stopped in the tick after it: this is the landing. At speeds above
   * 2a the lower bound makes it the braking step. */
  const int32_t limit = (v_max < a) ? v_max : a;
  const int32_t landing = (d < (uint64_t)(uint32_t)limit) ? (int32_t)d : limit;
  return fx_clamp(landing, v - a, v + a);
}

void profile_step(profile_t *profile, int32_t target_cnt, uint32_t velocity_max_q16,
                  uint32_t acceleration_max_q16) {
  bool negative;
  const uint64_t d = fx_distance_q16(fx_q32_from_cnt(target_cnt), profile->position_q32, &negative);
  const int32_t v = negative ? -profile->velocity_q16 : profile->velocity_q16;
  const int32_t next = next_speed(d, v, (int32_t)velocity_max_q16, (int32_t)acceleration_max_q16);
  profile->velocity_q16 = negative ? -next : next;
  profile->position_q32 = fx_q32_advance(profile->position_q32, profile->velocity_q16);
}
