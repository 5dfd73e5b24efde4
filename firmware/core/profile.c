#include "firmware/core/profile.h"

#include "firmware/fx/fx.h"

void profile_step(profile_t *profile, int32_t target_cnt, uint32_t velocity_max_q16,
                  uint32_t acceleration_max_q16) {
  bool negative;
  const uint64_t d = fx_distance_q16(fx_q32_from_cnt(target_cnt), profile->position_q32, &negative);
  const int32_t v = negative ? -profile->velocity_q16 : profile->velocity_q16;
  const int32_t most = (int32_t)velocity_max_q16;
  const int32_t a = (int32_t)acceleration_max_q16;
  /* If the present speed is above the velocity limit, the profile slows down. */
  const int32_t wanted = (v > most) ? 0 : ((most - v < a) ? most : v + a);
  const int32_t next = profile_next_speed(d, v, wanted, most, a, a);
  profile->velocity_q16 = negative ? -next : next;
  profile->position_q32 = fx_q32_advance(profile->position_q32, profile->velocity_q16);
}
