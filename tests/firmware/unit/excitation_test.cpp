#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "firmware/port/host/firmware.hpp"
#include "tests/firmware/unit/axis_fixture.hpp"

namespace {

constexpr double kTurn = 4294967296.0;
constexpr double kTwoPi = 6.283185307179586;

class Excitation : public AxisFixture {
 protected:
  void Start(int waveform, int amplitude) {
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    Set(AXIS_OBJ_EXCITATION_WAVEFORM, waveform);
    Set(AXIS_OBJ_EXCITATION_AMPLITUDE, amplitude);
    Set(AXIS_OBJ_MODE, AXIS_MODE_EXCITATION);
  }

  std::vector<int> Codes(int count) {
    std::vector<int> codes;
    for (int i = 0; i < count; ++i) codes.push_back(Tick());
    return codes;
  }
};

TEST_F(Excitation, WithoutAmplitudeIsOpenLoop) {
  Set(AXIS_OBJ_OPEN_LOOP_CODE, -123);
  Start(AXIS_EXCITATION_WAVEFORM_NOISE, 0);
  EXPECT_EQ(Codes(3), (std::vector<int>{-123, -123, -123}));
  EXPECT_EQ(Read(AXIS_OBJ_ACTIVE_MODE), AXIS_MODE_EXCITATION);
  EXPECT_EQ(outputs_.amp_enable, 1);
}

// Uniform within +-A: mean 0, variance A^2 / 3, successive values uncorrelated.
TEST_F(Excitation, NoiseIsUniformAndWhite) {
  constexpr int kCount = 40000;
  constexpr double kA = 1000;
  Set(AXIS_OBJ_EXCITATION_SEED, 5);
  Start(AXIS_EXCITATION_WAVEFORM_NOISE, static_cast<int>(kA));
  const std::vector<int> codes = Codes(kCount);
  double sum = 0, square = 0, next = 0, fourth = 0;
  for (int i = 0; i < kCount; ++i) {
    const double x = codes[static_cast<std::size_t>(i)] / kA;
    ASSERT_LE(std::abs(x), 1.0);
    sum += x;
    square += x * x;
    fourth += x * x * x * x;
    if (i > 0) next += x * codes[static_cast<std::size_t>(i - 1)] / kA;
  }
  // Four standard deviations of each estimate.
  EXPECT_NEAR(sum / kCount, 0.0, 4 * std::sqrt(1.0 / 3 / kCount));
  EXPECT_NEAR(square / kCount, 1.0 / 3, 4 * std::sqrt(4.0 / 45 / kCount));
  EXPECT_NEAR(fourth / kCount, 1.0 / 5, 4 * std::sqrt(16.0 / 225 / kCount));
  EXPECT_NEAR(next / kCount, 0.0, 4.0 / 3 / std::sqrt(kCount));
}

TEST_F(Excitation, NoiseIsHeld) {
  Set(AXIS_OBJ_EXCITATION_HOLD, 7);
  Start(AXIS_EXCITATION_WAVEFORM_NOISE, 2000);
  const std::vector<int> codes = Codes(70);
  for (std::size_t i = 0; i < codes.size(); ++i)
    EXPECT_EQ(codes[i] == codes[i - i % 7], true) << "tick " << i;
  for (std::size_t i = 7; i < codes.size(); i += 7) EXPECT_NE(codes[i], codes[i - 1]);
}

TEST_F(Excitation, RepeatsItselfAndFollowsItsSeedFromTheNextPeriod) {
  Set(AXIS_OBJ_EXCITATION_PERIOD, 20);
  Set(AXIS_OBJ_EXCITATION_HOLD, 3);
  Set(AXIS_OBJ_EXCITATION_SEED, 1);
  Start(AXIS_EXCITATION_WAVEFORM_NOISE, 2000);
  const std::vector<int> first = Codes(20);
  EXPECT_EQ(Codes(20), first);
  Set(AXIS_OBJ_EXCITATION_SEED, 2);
  const std::vector<int> other = Codes(20);
  EXPECT_NE(other, first);
  EXPECT_EQ(Codes(20), other);
  Set(AXIS_OBJ_EXCITATION_PERIOD, 0);
  EXPECT_NE(Codes(20), other);
}

TEST_F(Excitation, EnteringStartsFromTheBeginning) {
  Start(AXIS_EXCITATION_WAVEFORM_NOISE, 2000);
  const std::vector<int> first = Codes(10);
  EXPECT_NE(Codes(10), first);
  Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  Tick();
  Set(AXIS_OBJ_MODE, AXIS_MODE_EXCITATION);
  EXPECT_EQ(Codes(10), first);
}

TEST_F(Excitation, SineHasItsFrequencyPhaseAndAmplitude) {
  const int32_t frequency = 71582788;  // 25 Hz
  Set(AXIS_OBJ_EXCITATION_FREQUENCY, frequency);
  Set(AXIS_OBJ_EXCITATION_SEED, 16384);  // a quarter turn
  Set(AXIS_OBJ_OPEN_LOOP_CODE, 100);
  Start(AXIS_EXCITATION_WAVEFORM_SINE, 1500);
  for (int k = 0; k < 3000; ++k) {
    const double expected = 100 + 1500 * std::cos(kTwoPi * frequency / kTurn * k);
    ASSERT_NEAR(Tick(), expected, 0.5 + 1500 * 6.5 / 32768) << "tick " << k;
  }
}

TEST_F(Excitation, FrequencyMayBeStepped) {
  Start(AXIS_EXCITATION_WAVEFORM_SINE, 2000);
  double turns = 0;
  for (const int32_t frequency : {40000000, 300000000, 2147483647, 5}) {
    Set(AXIS_OBJ_EXCITATION_FREQUENCY, frequency);
    for (int k = 0; k < 50; ++k) {
      ASSERT_NEAR(Tick(), 2000 * std::sin(kTwoPi * turns), 0.5 + 2000 * 6.5 / 32768);
      turns += frequency / kTurn;
    }
  }
}

// Phase after k ticks: f k + s k (k - 1) / 2, also when it sweeps downward.
TEST_F(Excitation, SweepIsAChirp) {
  const double f = 20000000, s = -37000;
  Set(AXIS_OBJ_EXCITATION_FREQUENCY, static_cast<int32_t>(f));
  Set(AXIS_OBJ_EXCITATION_SWEEP, static_cast<int32_t>(s));
  Set(AXIS_OBJ_EXCITATION_PERIOD, 900);
  Start(AXIS_EXCITATION_WAVEFORM_SINE, 2000);
  for (int k = 0; k < 2000; ++k) {
    const double age = k % 900;
    const double turns = (f * age + s * age * (age - 1) / 2) / kTurn;
    ASSERT_NEAR(Tick(), 2000 * std::sin(kTwoPi * turns), 0.5 + 2000 * 6.5 / 32768) << "tick " << k;
  }
}

TEST_F(Excitation, LimitsActOnItAsOnEveryCode) {
  Set(AXIS_OBJ_OPEN_LOOP_CODE, 2000);
  Set(AXIS_OBJ_EXCITATION_SEED, 16384);
  Start(AXIS_EXCITATION_WAVEFORM_SINE, 2048);
  EXPECT_EQ(Tick(), 2047);
  EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), AXIS_LIMIT_REASON_DAC_SATURATION);
  Set(AXIS_OBJ_OUTPUT_LIMIT, 300);
  EXPECT_EQ(Tick(), 300);
  EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), AXIS_LIMIT_REASON_OUTPUT_LIMIT);
  inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE | AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE;
  EXPECT_EQ(Tick(), 0);
  EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), AXIS_LIMIT_REASON_LIMIT_SWITCH_POS);
}

TEST_F(Excitation, FaultsEndIt) {
  Set(AXIS_OBJ_SPEED_MAX, 10);
  Start(AXIS_EXCITATION_WAVEFORM_NOISE, 2000);
  TickPosition(0);
  TickPosition(11);
  ExpectOff(AXIS_FAULT_OVERSPEED);
  EXPECT_EQ(Write(AXIS_OBJ_MODE, AXIS_MODE_EXCITATION), FW_ERROR_STATE);
}

TEST_F(Excitation, RefusesWhatIsOutOfRange) {
  EXPECT_EQ(Write(AXIS_OBJ_EXCITATION_WAVEFORM, 2), FW_ERROR_RANGE);
  EXPECT_EQ(Write(AXIS_OBJ_EXCITATION_AMPLITUDE, 2049), FW_ERROR_RANGE);
  EXPECT_EQ(Write(AXIS_OBJ_EXCITATION_AMPLITUDE, -1), FW_ERROR_RANGE);
  EXPECT_EQ(Write(AXIS_OBJ_EXCITATION_SEED, 65536), FW_ERROR_RANGE);
  EXPECT_EQ(Write(AXIS_OBJ_EXCITATION_HOLD, 0), FW_ERROR_RANGE);
  EXPECT_EQ(Write(AXIS_OBJ_EXCITATION_FREQUENCY, -1), FW_ERROR_RANGE);
  EXPECT_EQ(Write(AXIS_OBJ_EXCITATION_PERIOD, -1), FW_ERROR_RANGE);
  EXPECT_EQ(Write(AXIS_OBJ_MODE, AXIS_MODE_COUNT), FW_ERROR_RANGE);
}

TEST(FxSine, IsWithinSixUnitsEverywhere) {
  for (uint32_t k = 0; k < 65536; ++k) {
    const uint32_t phase = k * 65536u + k;
    const double expected = 32767 * std::sin(kTwoPi * phase / kTurn);
    ASSERT_NEAR(fx_sine_q15(phase), expected, 6.0) << phase;
    ASSERT_NEAR(fx_sine_q15(phase + 0x80000000u), -fx_sine_q15(phase), 3) << phase;
  }
  EXPECT_EQ(fx_sine_q15(0), 0);
  EXPECT_EQ(fx_sine_q15(0x40000000u), 32767);
  EXPECT_EQ(fx_sine_q15(0xC0000000u), -32767);
}

}  // namespace
