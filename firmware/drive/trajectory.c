#include "firmware/drive/trajectory.h"

#include "firmware/fx/fx.h"

void trajectory_step(profile_t *trajectory, int32_t speed) {
  fx_assert(fx_within(speed, INT32_C(134217728)));
  trajectory->velocity_q16 = speed;
  trajectory->position_q32 = fx_q32_advance(trajectory->position_q32, speed);
}

static int32_t lower(int32_t a, int32_t b) { return (a < b) ? a : b; }
static int32_t higher(int32_t a, int32_t b) { return (a > b) ? a : b; }

/* Returns the speed of the trajectory in the next tick. d is the distance to the target position,
 * and v is the present speed towards the target. */
static int32_t next_speed(uint64_t d, int32_t v, const trajectory_limits_t *limits) {
  const int32_t most = limits->speed;
  const int32_t up = limits->acceleration;
  const int32_t down = limits->deceleration;
  if (v < 0) {
    return lower(v + down, 0); /* The trajectory moves away from the target and must stop first. */
  }
  /* Increases the speed. If the speed limit has become lower, reduces the speed to this limit. */
  const int32_t wanted = (v > most) ? higher(v - down, most) : lower(v + up, most);
  return profile_next_speed(d, v, wanted, most, up, down);
}

void trajectory_move(profile_t *trajectory, uint64_t distance_q16, bool negative,
                     const trajectory_limits_t *limits) {
  const int32_t v = trajectory->velocity_q16;
  const int32_t next = next_speed(distance_q16, negative ? -v : v, limits);
  trajectory_step(trajectory, negative ? -next : next);
}

void trajectory_ramp(profile_t *trajectory, int32_t speed, const trajectory_limits_t *limits) {
  const bool negative =
      trajectory->velocity_q16 < 0 || (trajectory->velocity_q16 == 0 && speed < 0);
  const int32_t v = negative ? -trajectory->velocity_q16 : trajectory->velocity_q16;
  const int32_t toward = negative ? -speed : speed;
  const int32_t goal = fx_clamp(toward, 0, limits->speed);
  const int32_t next =
      (v < goal) ? lower(v + limits->acceleration, goal) : higher(v - limits->deceleration, goal);
  trajectory_step(trajectory, negative ? -next : next);
}
