// The drive's trajectory against its header's specification: bounds of speed, bounds of its
// changes, exact landings, and braking down to a limit that was lowered on the way.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <random>

#include "firmware/port/host/firmware.hpp"

extern "C" {
#include "firmware/drive/trajectory.h"
}

namespace {

constexpr int32_t kOne = 65536;  // a count a tick, or a count a tick^2

profile_t At(int32_t cnt, int32_t velocity_q16) {
  profile_t at{};
  profile_set(&at, cnt);
  at.velocity_q16 = velocity_q16;
  return at;
}

// One tick toward a count; the remaining distance before it, positive toward larger counts,
// 1/65536.
int64_t Move(profile_t &trajectory, int32_t target, const trajectory_limits_t &limits) {
  bool negative = false;
  const uint64_t distance =
      fx_distance_q16(fx_q32_from_cnt(target), trajectory.position_q32, &negative);
  trajectory_move(&trajectory, distance, negative, &limits);
  return negative ? -static_cast<int64_t>(distance) : static_cast<int64_t>(distance);
}

// A limit lowered below the speed of now is braked down to by the deceleration, also where one tick
// of it is enough, or more than enough.
TEST(Trajectory, ALoweredLimitIsBrakedDownTo) {
  for (const int sign : {1, -1}) {
    const auto after = [&](int32_t v, int32_t limit, int32_t down) {
      profile_t trajectory = At(0, sign * v);
      Move(trajectory, sign * 100000, {.speed = limit, .acceleration = kOne, .deceleration = down});
      return sign * trajectory.velocity_q16;
    };
    EXPECT_EQ(after(3 * kOne / 2, kOne / 2, kOne), kOne / 2);  // 1.5 - 1
    EXPECT_EQ(after(3 * kOne / 2, kOne / 4, kOne), kOne / 2);  // not lower than 1.5 - 1
    EXPECT_EQ(after(3 * kOne / 2, kOne, kOne), kOne);          // not lower than the limit
    EXPECT_EQ(after(3 * kOne / 2, 5 * kOne / 4, kOne), 5 * kOne / 4);
    EXPECT_EQ(after(20 * kOne, 2 * kOne, kOne), 19 * kOne);
    EXPECT_EQ(after(kOne / 2, kOne / 4, kOne), kOne / 4);
    EXPECT_EQ(after(kOne / 2, 0, kOne), 0);
    EXPECT_EQ(after(kOne + 1, kOne, kOne), kOne);
  }
}

TEST(Trajectory, AtItsLimitTheSpeedStays) {
  profile_t trajectory = At(0, 2 * kOne);
  for (int i = 1; i <= 100; ++i) {
    Move(trajectory, 100000, {.speed = 2 * kOne, .acceleration = 7, .deceleration = 11});
    ASSERT_EQ(trajectory.velocity_q16, 2 * kOne);
    ASSERT_EQ(trajectory.position_q32, fx_q32_from_cnt(2 * i));
  }
}

// From any speed and with limits that change on the way: the speed grows by no more than the
// acceleration, shrinks by no more than the deceleration, and above the limit it does shrink.
TEST(Trajectory, EveryTickKeepsItsBounds) {
  std::mt19937 random(1988);
  const auto below = [&](uint32_t most) {  // a random width, so that small ones come up as often
    return static_cast<int32_t>(random() % most >> random() % 24);
  };
  for (int run = 0; run < 400; ++run) {
    profile_t trajectory = At(0, below(1u << 24) - below(1u << 24));
    trajectory_limits_t limits{};
    int32_t target = 0;
    for (int tick = 0; tick < 300; ++tick) {
      if (tick % 100 == 0) {
        limits = {below(1u << 24), 1 + below(1u << 20), 1 + below(1u << 20)};
        target = static_cast<int32_t>(random() % 20000) - 10000;
      }
      const int64_t v = trajectory.velocity_q16;
      const int64_t way = Move(trajectory, target, limits);
      const int64_t next = trajectory.velocity_q16;
      const int64_t size = std::abs(v), grown = std::abs(next);
      // A step from standing or across 0 begins at 0 and grows from there; landing may step by a
      // deceleration where the acceleration is less.
      if (grown > size) {
        ASSERT_LE(grown, std::max<int64_t>(limits.speed, size - limits.deceleration));
        ASSERT_LE(grown - size, limits.acceleration) << run << " " << tick;
      } else {
        ASSERT_LE(size - grown, limits.deceleration) << run << " " << tick;
      }
      if (size > limits.speed) {
        ASSERT_LE(grown, std::max<int64_t>(limits.speed, size - limits.deceleration))
            << run << " " << tick << ": held above the limit";
      }
      ASSERT_GE(v * next, 0) << "a change of sign passes through 0";
      if (v != 0 && (v > 0) != (way > 0) && way != 0) {
        ASSERT_EQ(grown, std::max<int64_t>(0, size - limits.deceleration)) << "away: first stand";
      }
    }
  }
}

// From rest with lasting limits: never passed, landed on exactly, and at rest one tick later.
TEST(Trajectory, FromRestItLandsExactly) {
  std::mt19937 random(2020);
  for (int run = 0; run < 400; ++run) {
    const trajectory_limits_t limits{1 + static_cast<int32_t>(random() % (4u << 16)),
                                     1 + static_cast<int32_t>(random() % 40000),
                                     1 + static_cast<int32_t>(random() % 40000)};
    const int32_t target = static_cast<int32_t>(random() % 600) - 300;
    profile_t trajectory = At(0, 0);
    int64_t way = Move(trajectory, target, limits);
    const int64_t first = way;
    int ticks = 0;
    for (; way != 0 && ticks < 1000000; ++ticks) {
      ASSERT_LE(std::abs(trajectory.velocity_q16), limits.speed);
      way = Move(trajectory, target, limits);
      ASSERT_GE(first * way, 0) << "passed, run " << run;
    }
    ASSERT_EQ(trajectory.position_q32, fx_q32_from_cnt(target)) << run;
    ASSERT_EQ(trajectory.velocity_q16, 0) << run;
  }
}

TEST(Trajectory, ARampGoesTowardItsSpeed) {
  const auto after = [](int32_t v, int32_t speed, int32_t limit) {
    profile_t trajectory = At(0, v);
    const trajectory_limits_t limits{.speed = limit, .acceleration = 10, .deceleration = 30};
    trajectory_ramp(&trajectory, speed, &limits);
    EXPECT_EQ(trajectory.position_q32,
              static_cast<uint64_t>(int64_t{trajectory.velocity_q16} * kOne));
    return trajectory.velocity_q16;
  };
  for (const int sign : {1, -1}) {
    EXPECT_EQ(after(0, sign * 100, 1000), sign * 10);
    EXPECT_EQ(after(0, sign * 7, 1000), sign * 7) << "not past it";
    EXPECT_EQ(after(sign * 95, sign * 100, 1000), sign * 100);
    EXPECT_EQ(after(sign * 100, sign * 100, 1000), sign * 100);
    EXPECT_EQ(after(sign * 200, sign * 100, 1000), sign * 170) << "slower by the deceleration";
    EXPECT_EQ(after(sign * 120, sign * 100, 1000), sign * 100);
    EXPECT_EQ(after(sign * 100, -sign * 100, 1000), sign * 70) << "through 0";
    EXPECT_EQ(after(sign * 20, -sign * 100, 1000), 0) << "stands for a tick";
    EXPECT_EQ(after(sign * 100, sign * 100, 80), sign * 80) << "above the limit";
    EXPECT_EQ(after(sign * 100, sign * 100, 40), sign * 70);
    EXPECT_EQ(after(0, sign * 100, 5), sign * 5);
    EXPECT_EQ(after(sign * 25, 0, 1000), 0);
    EXPECT_EQ(after(sign * 31, 0, 1000), sign * 1);
  }
}

}  // namespace
