// The curve of a cycle against a model that is written from its description, and against what every
// curve has to have: its points are samples, where a step was reached and at both ends.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <random>
#include <vector>

#include "firmware/port/host/firmware.hpp"
#include "tests/support/frames.hpp"

namespace {

// A sample as a machine has it: everything is wider than in the firmware.
struct Sample {
  std::int64_t time = 0, position = 0, force_q8 = 0;  // position from the start of the cycle
  int phase = 0;
  bool operator==(const Sample &) const = default;
};
using Samples = std::vector<Sample>;

struct Steps {
  std::int64_t travel = 0, force = 0, time = 0;
};

bool reached(std::int64_t change, std::int64_t step) {
  return step != 0 && std::abs(change) >= step;
}

bool is_due(const Sample &last, const Sample &now, const Steps &steps) {
  return now.phase != last.phase || reached(now.position - last.position, steps.travel) ||
         reached(now.force_q8 - last.force_q8, steps.force) ||
         reached(now.time - last.time, steps.time);
}

struct Model {
  std::size_t room;
  Steps steps;
  Samples points;
  int thinned = 0;

  void put(const Sample &point) {
    if (points.size() == room) thin();
    points.push_back(point);
  }
  void thin() {
    Samples kept;
    const auto begins = [&](std::size_t i) {
      return i == 0 || points[i].phase != points[i - 1].phase;
    };
    for (std::size_t i = 0; i < points.size(); i += 2) {
      const bool has_second = i + 1 < points.size();
      kept.push_back(points[has_second && begins(i + 1) && !begins(i) ? i + 1 : i]);
    }
    points = kept;
    for (std::int64_t *step : {&steps.travel, &steps.force, &steps.time})
      *step = std::min<std::int64_t>(2 * *step, std::numeric_limits<std::uint32_t>::max());
    ++thinned;
  }
  void run(const Samples &samples) {
    for (const Sample &sample : samples)
      if (points.empty() || is_due(points.back(), sample, steps)) put(sample);
    if (!samples.empty() && points.back().time != samples.back().time) put(samples.back());
  }
};

class Curve : public ::testing::Test {
 protected:
  static constexpr std::uint32_t kBegin = 0xFFFFFFF0u;  // the number of the tick wraps

  // The points of the firmware for samples, of which the one at `zero` is at travel 0; SIZE_MAX:
  // none is. Their travel is from the start of the cycle as that of the samples.
  Samples curve_of(const Samples &samples, const Steps &steps, std::size_t room,
                   std::size_t zero = SIZE_MAX) {
    memory_.assign(3 * room + 2, 0x5A5A5A5Au);
    cycle_curve_init(&curve_, &memory_[1], static_cast<std::uint32_t>(12 * room));
    const cycle_curve_steps_t own{static_cast<std::uint32_t>(steps.travel),
                                  static_cast<std::uint32_t>(steps.force),
                                  static_cast<std::uint32_t>(steps.time)};
    cycle_curve_begin(&curve_, &own, kBegin);
    const std::int64_t at_zero = zero < samples.size() ? samples[zero].position : 0;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      cycle_sample_t sample{};
      sample.tick = kBegin + static_cast<std::uint32_t>(samples[i].time);
      sample.travel = static_cast<std::int32_t>(samples[i].position - (i >= zero ? at_zero : 0));
      sample.force_q8 = static_cast<std::int32_t>(samples[i].force_q8);
      sample.phase = static_cast<std::uint8_t>(samples[i].phase);
      sample.zeroed = i >= zero;
      cycle_curve_take(&curve_, &sample, i >= zero ? static_cast<std::int32_t>(at_zero) : -777);
    }
    cycle_curve_end(&curve_);
    EXPECT_EQ(memory_.front(), 0x5A5A5A5Au);
    EXPECT_EQ(memory_.back(), 0x5A5A5A5Au);
    return decoded(at_zero);
  }

  Samples decoded(std::int64_t at_zero) const {
    std::vector<std::uint8_t> bytes(12 * curve_.count + 5);
    EXPECT_EQ(cycle_curve_bytes(&curve_, 0, bytes.data(), static_cast<std::uint32_t>(bytes.size())),
              12 * curve_.count);
    Samples points;
    for (std::size_t i = 0; i < curve_.count; ++i) {
      const std::uint8_t *at = &bytes[12 * i];
      std::uint32_t time = 0;
      std::int32_t travel = 0;
      std::memcpy(&time, at, 4);
      std::memcpy(&travel, at + 4, 4);
      // 24 bits with a sign, after the byte of the phase
      const int high = static_cast<std::int8_t>(at[11]);
      const std::int32_t force = high * 65536 + at[10] * 256 + at[9];
      points.push_back({time, travel + at_zero, force, at[8]});
    }
    return points;
  }

  std::vector<std::uint32_t> memory_;
  cycle_curve_t curve_{};
};

// A walk in travel and force through random phases.
Samples random_samples(std::mt19937 &random, std::size_t count, int phases) {
  const auto pick = [&](int low, int high) {
    return low + static_cast<int>(random() % static_cast<unsigned>(high - low + 1));
  };
  Samples samples;
  Sample now;
  const int speed = pick(0, 9), noise = pick(0, 300);
  while (samples.size() < count) {
    now.time += pick(0, 60) == 0 ? pick(2, 5) : 1;  // ticks may be missing
    now.position += pick(-speed, 2 * speed);
    now.force_q8 += pick(-noise, noise);
    if (pick(0, 500) == 0)
      now.force_q8 = pick(0, 1) == 0 ? CYCLE_FORCE_MAX_Q8 : -CYCLE_FORCE_MAX_Q8;
    now.force_q8 = std::clamp<std::int64_t>(now.force_q8, -CYCLE_FORCE_MAX_Q8, CYCLE_FORCE_MAX_Q8);
    if (pick(0, 40) == 0) now.phase = pick(0, phases - 1);
    samples.push_back(now);
  }
  return samples;
}

Steps random_steps(std::mt19937 &random) {
  Steps steps;
  if (random() % 3 != 0) steps.travel = 1 + random() % 60;
  if (random() % 3 != 0) steps.force = 1 + random() % 2000;
  if (random() % 3 != 0) steps.time = 1 + random() % 40;
  return steps;
}

// Without a full memory: between two points no sample is due, and every point but the last is.
TEST_F(Curve, APointIsWhereAStepIsReachedAndNoGapIsLarger) {
  std::mt19937 random(243);
  for (int round = 0; round < 300; ++round) {
    const Samples samples = random_samples(random, 1 + random() % 400, 1 + round % 16);
    const Steps steps = random_steps(random);
    const Samples points = curve_of(samples, steps, 400, random() % (2 * samples.size()));
    ASSERT_EQ(curve_.thinned, 0);
    ASSERT_EQ(points.front(), samples.front());
    ASSERT_EQ(points.back(), samples.back());
    std::size_t at = 0;
    for (std::size_t i = 1; i < points.size(); ++i) {
      for (++at; samples[at].time < points[i].time; ++at)
        ASSERT_FALSE(is_due(points[i - 1], samples[at], steps)) << round << " " << at;
      ASSERT_EQ(points[i], samples[at]) << round;
      ASSERT_TRUE(is_due(points[i - 1], points[i], steps) || i + 1 == points.size()) << round;
    }
    ASSERT_EQ(at + 1, samples.size());
  }
}

TEST_F(Curve, AThousandRandomCurvesAreThoseOfTheModel) {
  std::mt19937 random(1000);
  int thinned = 0, most = 0;
  for (int round = 0; round < 1000; ++round) {
    const Samples samples = random_samples(random, 1 + random() % 900, 1 + round % 16);
    const std::size_t room = 2 + random() % (round % 2 == 0 ? 20 : 200);
    Model model{room, random_steps(random), {}};
    const Steps steps = model.steps;
    model.run(samples);
    const Samples points = curve_of(samples, steps, room, random() % (2 * samples.size()));
    ASSERT_EQ(points, model.points) << round;
    ASSERT_EQ(curve_.thinned, std::min(model.thinned, 255)) << round;
    ASSERT_LE(points.size(), room);
    ASSERT_EQ(points.front(), samples.front());
    ASSERT_EQ(points.back(), samples.back());
    if (model.thinned > 0) {
      ASSERT_GT(points.size(), room / 2) << "half of it at least is used";
    }
    thinned += model.thinned > 0;
    most = std::max(most, model.thinned);
  }
  EXPECT_GT(thinned, 300);
  EXPECT_GT(most, 5);
}

// With one phase, thinning n times makes the gaps 2^n times as long, and no longer.
TEST_F(Curve, ThinningDoublesTheGaps) {
  for (const std::size_t room : {2u, 3u, 4u, 7u, 100u, 1000u}) {
    Samples samples;
    for (int i = 1; i <= 18000; ++i) samples.push_back({i, 0, 0, 3});
    const Samples points = curve_of(samples, {0, 0, 5}, room);
    ASSERT_EQ(points.front().time, 1);
    ASSERT_EQ(points.back().time, 18000);
    const std::int64_t step = std::int64_t{5} << curve_.thinned;
    for (std::size_t i = 1; i < points.size(); ++i)
      ASSERT_LE(points[i].time - points[i - 1].time, step) << room;
    if (room >= 100) {
      EXPECT_GE(points.size(), room / 2);
      // It is full after 500, 1000, 2000 .. 16000 ticks, or after 5000 and 10000.
      EXPECT_EQ(curve_.thinned, room == 100 ? 6 : 2);
    }
  }
}

// A change of phase is where it was, also after the curve was thinned many times.
TEST_F(Curve, ThinningKeepsTheBeginOfEveryPhase) {
  Samples samples;
  const std::vector<int> begins{1, 778, 1211, 1999, 2477, 4095, 7013};
  for (int i = 1; i <= 9000; ++i) {
    const auto phase = std::upper_bound(begins.begin(), begins.end(), i) - begins.begin() - 1;
    samples.push_back({i, i, 0, static_cast<int>(phase)});
  }
  const Samples points = curve_of(samples, {1, 0, 0}, 200);
  EXPECT_GE(curve_.thinned, 5);
  std::vector<int> found;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (i == 0 || points[i].phase != points[i - 1].phase)
      found.push_back(static_cast<int>(points[i].time));
  EXPECT_EQ(found, begins);
}

// A program that loops may change its phase in every tick, so every point begins one.
TEST_F(Curve, PhasesWithoutEndNeverFillTheMemory) {
  Samples samples;
  for (int i = 1; i <= 100000; ++i) samples.push_back({i, 0, 0, i % 2});
  const Samples points = curve_of(samples, {}, 50);
  EXPECT_EQ(points.front().time, 1);
  EXPECT_EQ(points.back().time, 100000);
  EXPECT_LE(points.size(), 50u);
  EXPECT_EQ(curve_.thinned, 255) << "and it counts no further";
}

// 8 (2^29 + 1) does not fit into 32 bits: a step that wrapped would be 8 counts.
TEST_F(Curve, AStepThatIsDoubledDoesNotWrap) {
  Samples samples;
  for (int i = 1; i <= 25; ++i) samples.push_back({i, 0, 0, i % 2});
  for (int i = 26; i <= 100; ++i) samples.push_back({i, 10 * i, 0, 1});
  const Steps steps{(1 << 29) + 1, 0, 0};
  Model model{8, steps, {}};
  model.run(samples);
  EXPECT_EQ(curve_of(samples, steps, 8), model.points);
  EXPECT_EQ(curve_.thinned, model.thinned);
  EXPECT_GE(curve_.thinned, 3);
}

TEST_F(Curve, OneSampleIsOnePoint) {
  const Samples one{{1, -5, 70, 15}};
  EXPECT_EQ(curve_of(one, {1, 1, 1}, 1000), one);
  EXPECT_TRUE(curve_of({}, {1, 1, 1}, 1000).empty()) << "and none is none";
  const Samples two{{1, 0, 0, 0}, {2, 0, 0, 0}};
  EXPECT_EQ(curve_of(two, {}, 1000), two) << "the first and the last";
}

TEST_F(Curve, WithoutMemoryForTwoPointsThereIsNone) {
  const Samples samples{{1, 0, 0, 0}, {2, 9, 9, 1}, {3, 20, 0, 0}};
  for (const std::size_t room : {0u, 1u}) EXPECT_TRUE(curve_of(samples, {1, 1, 1}, room).empty());
  cycle_curve_init(&curve_, nullptr, 12000);
  cycle_sample_t sample{};
  cycle_curve_take(&curve_, &sample, 0);
  cycle_curve_end(&curve_);
  std::uint8_t byte = 7;
  EXPECT_EQ(cycle_curve_bytes(&curve_, 0, &byte, 1), 0u);
  EXPECT_EQ(byte, 7);
  EXPECT_EQ(curve_of(samples, {1, 1, 1}, 2), (Samples{samples.front(), samples.back()}));
}

TEST_F(Curve, EveryStepAloneMakesPoints) {
  Samples samples;
  for (int i = 1; i <= 41; ++i) samples.push_back({i, -3 * i, 100 * i, 0});
  const auto times = [&](const Steps &steps) {
    std::vector<std::int64_t> found;
    for (const Sample &point : curve_of(samples, steps, 1000)) found.push_back(point.time);
    return found;
  };
  using Times = std::vector<std::int64_t>;
  EXPECT_EQ(times({}), (Times{1, 41}));
  EXPECT_EQ(times({30, 0, 0}), (Times{1, 11, 21, 31, 41}));
  EXPECT_EQ(times({31, 0, 0}), (Times{1, 12, 23, 34, 41})) << "of at least the step";
  EXPECT_EQ(times({0, 1000, 0}), (Times{1, 11, 21, 31, 41}));
  EXPECT_EQ(times({0, 0, 15}), (Times{1, 16, 31, 41}));
  EXPECT_EQ(times({60, 2500, 39}), (Times{1, 21, 41})) << "the first that is reached";
}

TEST_F(Curve, TheLargestSamplesAreExact) {
  const std::int64_t most = CYCLE_TRAVEL_MAX, force = CYCLE_FORCE_MAX_Q8;
  const Samples samples{{1, -most, -force, 15}, {2, most, force, 0}, {0xFFFFFFFF, 0, -1, 7}};
  EXPECT_EQ(curve_of(samples, {1, 1, 1}, 1000), samples);
  EXPECT_EQ(curve_of(samples, {most, 0, 0}, 1000), samples);
}

TEST_F(Curve, BytesAreHandedOverInPieces) {
  Samples samples;
  for (int i = 1; i <= 5; ++i) samples.push_back({i, 1000 * i, -i, i});
  ASSERT_EQ(curve_of(samples, {1, 0, 0}, 10).size(), 5u);
  std::array<std::uint8_t, 60> all{};
  ASSERT_EQ(cycle_curve_bytes(&curve_, 0, all.data(), 60), 60u);
  EXPECT_EQ((std::vector<std::uint8_t>(all.begin(), all.begin() + 12)),
            (std::vector<std::uint8_t>{1, 0, 0, 0, 0xE8, 3, 0, 0, 1, 0xFF, 0xFF, 0xFF}));
  for (std::uint32_t offset = 0; offset <= 61; ++offset) {
    for (std::uint32_t count : {0u, 1u, 7u, 100u}) {
      std::array<std::uint8_t, 101> piece{};
      piece.fill(0xEE);
      const std::uint32_t rest = offset < 60 ? 60 - offset : 0, given = std::min(count, rest);
      ASSERT_EQ(cycle_curve_bytes(&curve_, offset, piece.data(), count), given);
      ASSERT_TRUE(std::equal(piece.begin(), piece.begin() + given, all.begin() + 60 - rest));
      ASSERT_EQ(piece[given], 0xEE);
    }
  }
}

}  // namespace
