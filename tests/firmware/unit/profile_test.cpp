#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "firmware/port/host/firmware.hpp"

namespace {

constexpr uint32_t kSeed = 427;

// Remaining distance in Q16, in 64-bit arithmetic of counts that do not wrap here.
int64_t PositionQ16(const profile_t &profile) {
  return static_cast<int64_t>(profile.position_q32) / 65536;
}

struct Journey {
  int ticks;         // until at rest on the target
  bool passed;       // was beyond the target at some tick
  int32_t fastest;   // largest |v|
  int32_t jerkiest;  // largest |change of v|
};

Journey Move(profile_t &profile, int32_t target, uint32_t v_max, uint32_t a_max, int most) {
  Journey run{0, false, 0, 0};
  const int64_t goal = int64_t{target} * 65536;
  const int64_t start = PositionQ16(profile);
  for (; run.ticks < most; ++run.ticks) {
    if (PositionQ16(profile) == goal && profile.velocity_q16 == 0) break;
    const int32_t before = profile.velocity_q16;
    profile_step(&profile, target, v_max, a_max);
    run.jerkiest = std::max(run.jerkiest, std::abs(profile.velocity_q16 - before));
    run.fastest = std::max(run.fastest, std::abs(profile.velocity_q16));
    const int64_t at = PositionQ16(profile);
    run.passed |= goal >= start ? at > goal : at < goal;
  }
  return run;
}

TEST(Profile, ByHand) {
  // 10 counts with a speed of at most 2 and 1 per tick of acceleration. With 3 left after 1 2 2 2
  // the speed 2 is not held, because the braking test keeps an eighth of a step in reserve: 1 1 1.
  profile_t profile;
  profile_set(&profile, 100);
  const int32_t positions[] = {101, 103, 105, 107, 108, 109, 110, 110, 110};
  for (int32_t position : positions) {
    profile_step(&profile, 110, 2 * 65536, 65536);
    EXPECT_EQ(PositionQ16(profile), int64_t{position} * 65536);
  }
}

TEST(Profile, LandsExactlyWithoutOvershootWithinItsLimits) {
  std::mt19937 random(kSeed);
  double slowest = 0;
  for (int i = 0; i < 20000; ++i) {
    const auto a = static_cast<uint32_t>(1 + (random() % (1u << 24)) / (1u << (random() % 16)));
    const auto v = static_cast<uint32_t>(1 + (random() % (1u << 27)) / (1u << (random() % 18)));
    const int32_t start = static_cast<int32_t>(random() % 2000001) - 1000000;
    const int32_t way =
        (static_cast<int32_t>(random() % 2000001) - 1000000) / (1 << (random() % 20));
    // Time-optimal duration in ticks for a continuous trapezoid.
    const double d = std::abs(static_cast<double>(way)) * 65536;
    const double optimal = d * a > static_cast<double>(v) * v ? d / v + static_cast<double>(v) / a
                                                              : 2 * std::sqrt(d / a);
    if (optimal > 20000) continue;
    profile_t profile;
    profile_set(&profile, start);
    const Journey run = Move(profile, start + way, v, a, 40000);
    const auto replay = [&] {
      return testing::Message() << "v " << v << " a " << a << " start " << start << " way " << way;
    };
    ASSERT_LT(run.ticks, 40000) << replay();
    ASSERT_FALSE(run.passed) << replay();
    ASSERT_LE(run.fastest, static_cast<int64_t>(v)) << replay();
    ASSERT_LE(run.jerkiest, static_cast<int64_t>(a)) << replay();
    slowest = std::max(slowest, run.ticks - optimal);
    // The first and the last step of a tick each, and the ticks that the whole steps of
    // acceleration cost.
    ASSERT_LE(run.ticks, optimal + 4) << replay();
  }
  RecordProperty("ticks_above_optimal", std::to_string(slowest));
}

TEST(Profile, TargetsAndLimitsChangedOnTheWay) {
  std::mt19937 random(kSeed + 1);
  for (int i = 0; i < 3000; ++i) {
    profile_t profile;
    profile_set(&profile, 0);
    int32_t target = 0;
    uint32_t a = 1 << 16;
    uint32_t v = 1 << 20;
    for (int change = 0; change < 6; ++change) {
      target = static_cast<int32_t>(random() % 4001) - 2000;
      a = static_cast<uint32_t>(1000 + random() % (1u << 18));
      v = static_cast<uint32_t>(1000 + random() % (1u << 22));
      const int ticks = static_cast<int>(random() % 200);
      for (int t = 0; t < ticks; ++t) {
        const int32_t before = profile.velocity_q16;
        profile_step(&profile, target, v, a);
        ASSERT_LE(std::abs(profile.velocity_q16 - before), static_cast<int64_t>(a)) << i;
        // Above the limit only while braking down to it.
        ASSERT_TRUE(std::abs(profile.velocity_q16) <= static_cast<int64_t>(v) ||
                    std::abs(profile.velocity_q16) < std::abs(before))
            << i;
      }
    }
    const Journey run = Move(profile, target, v, a, 1000000);
    ASSERT_LT(run.ticks, 1000000) << i;
    profile_step(&profile, target, v, a);
    ASSERT_EQ(PositionQ16(profile), int64_t{target} * 65536) << i;
    ASSERT_EQ(profile.velocity_q16, 0) << i;
  }
}

TEST(Profile, ShorterWayRound) {
  profile_t profile;
  profile_set(&profile, INT32_MAX - 5);
  for (int i = 0; i < 100; ++i) {
    profile_step(&profile, INT32_MIN + 5, 65536, 65536);
    ASSERT_GE(profile.velocity_q16, 0);
  }
  EXPECT_EQ(fx_cnt_from_q32(profile.position_q32), INT32_MIN + 5);
  EXPECT_EQ(profile.velocity_q16, 0);
}

TEST(Profile, LongestMoveAtTheLargestLimits) {
  profile_t profile;
  profile_set(&profile, 0);
  const Journey run = Move(profile, INT32_MAX, 1u << 27, 1u << 24, 2000000);
  EXPECT_LT(run.ticks, 2000000);
  EXPECT_FALSE(run.passed);
  EXPECT_EQ(run.fastest, 1 << 27);
  EXPECT_EQ(run.jerkiest, 1 << 24);
}

TEST(Profile, SmallestLimits) {
  profile_t profile;
  profile_set(&profile, 0);
  const Journey run = Move(profile, 1, 1, 1, 100000);
  EXPECT_EQ(run.ticks, 65537);  // one 65536th of a count a tick, and one tick to stop
  EXPECT_FALSE(run.passed);
}

}  // namespace
