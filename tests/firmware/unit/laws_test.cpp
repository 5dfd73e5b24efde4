#include <gtest/gtest.h>

#include <random>

#include "firmware/port/host/firmware.hpp"
#include "tests/firmware/unit/axis_fixture.hpp"

namespace {

constexpr uint32_t kSeed = 42;

int64_t FloorDivide(int64_t a, int64_t b) {
  const int64_t q = a / b;
  return (a % b != 0 && a < 0) ? q - 1 : q;
}

int64_t Saturate(int64_t code) { return code < -2048 ? -2048 : (code > 2047 ? 2047 : code); }

class Laws : public AxisFixture {};

// u = floor(k_f (f_d - n) + 1/2), worked out by hand.
TEST_F(Laws, ForceByHand) {
  StartForce();
  EXPECT_EQ(TickForce(28), 10);  // 5 (30 - 28): presses harder
  EXPECT_EQ(TickForce(0), 150);
  EXPECT_EQ(TickForce(31), -5);
  EXPECT_EQ(TickForce(255), -1125);
  Set(AXIS_OBJ_FORCE_GAIN, 128);
  EXPECT_EQ(TickForce(29), 1);   // 0.5 rounds up
  EXPECT_EQ(TickForce(31), 0);   // -0.5 rounds up
  EXPECT_EQ(TickForce(33), -1);  // -1.5 rounds up
  Set(AXIS_OBJ_FORCE_GAIN, 65535);
  EXPECT_EQ(TickForce(22), 2047);  // 255.996 * 8 = 2047.97 rounds to 2048
  EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), AXIS_LIMIT_REASON_DAC_SATURATION);
  EXPECT_EQ(TickForce(38), -2048);  // -2047.97 rounds to -2048, which the DAC has
  EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), AXIS_LIMIT_REASON_NONE);
  EXPECT_EQ(TickForce(39), -2048);
  EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), AXIS_LIMIT_REASON_DAC_SATURATION);
}

TEST_F(Laws, ForceFormulaForEveryReading) {
  StartForce();
  std::mt19937 random(kSeed);
  for (int i = 0; i < 200; ++i) {
    const int gain = static_cast<int>(random() % 65536) >> (random() % 12);
    const int setpoint = static_cast<int>(random() % 131073) - 65536;
    Set(AXIS_OBJ_FORCE_GAIN, gain);
    Set(AXIS_OBJ_FORCE_SETPOINT, setpoint);
    for (int n = 0; n < 256; ++n) {
      const int64_t exact = FloorDivide(int64_t{gain} * (setpoint - 256 * n) * 2 + 65536, 131072);
      ASSERT_EQ(TickForce(static_cast<uint16_t>(n)), Saturate(exact))
          << "gain " << gain << " setpoint " << setpoint << " n " << n;
    }
  }
}

TEST_F(Laws, ForceReading) {
  EXPECT_EQ(law_force_reading(200, 0, 1, 8, 0), 51200);
  EXPECT_EQ(law_force_reading(128, 128, 1, 8, 0), 0);
  EXPECT_EQ(law_force_reading(0, 128, -1, 8, 0), 32768);
  EXPECT_EQ(law_force_reading(255, 128, -1, 8, 0), -32512);
  EXPECT_EQ(law_force_reading(4095, 0, 1, 12, 0), 65520);  // 255.9375 counts
  EXPECT_EQ(law_force_reading(1, 0, 1, 12, 0), 16);
  EXPECT_EQ(law_force_reading(65535, 0, 1, 16, 0), 65535);
  EXPECT_EQ(law_force_reading(0, 32768, 1, 16, 0), -32768);
  EXPECT_EQ(law_force_reading(10, 0, 1, 8, 256), 2304);
  EXPECT_EQ(law_force_reading(10, 0, 1, 8, -65536), 68096);
}

// The same force read by a wider ADC gives the same code.
TEST_F(Laws, ForceIsTheSameForEveryAdcWidth) {
  StartForce();
  for (int bits = 8; bits <= 16; ++bits) {
    Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
    Tick();
    Set(AXIS_OBJ_ADC_BITS, bits);
    Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
    EXPECT_EQ(TickForce(static_cast<uint16_t>(28 << (bits - 8))), 10) << bits;
  }
}

TEST_F(Laws, TareIsSubtracted) {
  StartForce();
  Set(AXIS_OBJ_FORCE_TARE, 2 * 256);
  EXPECT_EQ(TickForce(30), 10);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE), 28 * 256);
}

TEST(LawPosition, ByHand) {
  const int32_t one = 65536;
  EXPECT_EQ(law_position(256, 0, 100, 0), 100 * one);
  EXPECT_EQ(law_position(10, 0, 1000, 0), 2560000);    // 39.0625
  EXPECT_EQ(law_position(10, 640, 1000, 12), 593920);  // 39.0625 - 2.5 * 12 = 9.0625
  EXPECT_EQ(law_position(0, 640, 1000, -12), 30 * one);
  EXPECT_EQ(law_position(1, 0, 32767, 0), 8388352);  // 127.99609375
  EXPECT_EQ(law_position(1, 0, 32768, 0), 8388352);  // the error is limited
  EXPECT_EQ(law_position(1, 0, INT32_MAX, 0), 8388352);
  EXPECT_EQ(law_position(1, 0, INT32_MIN, 0), -8388352);
  EXPECT_EQ(law_position(65535, 0, 32767, 0), LAW_MAX_Q16);
  EXPECT_EQ(law_position(65535, 65535, -32767, INT32_MAX), LAW_MIN_Q16);
  EXPECT_EQ(law_position(65535, 65535, -32767, INT32_MIN), LAW_MAX_Q16);
  EXPECT_EQ(law_position(256, 256, 5, 5), 0);
}

TEST(LawOpenLoop, IsTheCode) {
  EXPECT_EQ(law_open_loop(-2048), -134217728);
  EXPECT_EQ(law_open_loop(2047), 134152192);
}

TEST(LawForce, Rails) {
  EXPECT_EQ(law_force(65535, 65536, -33554432), LAW_MAX_Q16);
  EXPECT_EQ(law_force(65535, -65536, 33554432), LAW_MIN_Q16);
  EXPECT_EQ(law_force(256, 524287, 0), 134217472);  // 2047.996
  EXPECT_EQ(law_force(256, 524288, 0), LAW_MAX_Q16);
  EXPECT_EQ(law_force(256, 524289, 0), LAW_MAX_Q16);
  EXPECT_EQ(law_force(256, -524544, 0), LAW_MIN_Q16);  // -2049
  EXPECT_EQ(law_force(256, -524543, 0), LAW_MIN_Q16 + 256);
}

TEST_F(Laws, PositionLoopByHand) {
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Set(AXIS_OBJ_POSITION_GAIN, 128);
  Set(AXIS_OBJ_VELOCITY_GAIN, 512);
  Set(AXIS_OBJ_POSITION_SETPOINT, 201);
  Set(AXIS_OBJ_MODE, AXIS_MODE_POSITION);
  EXPECT_EQ(TickPosition(0), 101);     // 100.5 rounds up; no speed in the first tick
  EXPECT_EQ(TickPosition(10), 76);     // 95.5 - 20 = 75.5
  EXPECT_EQ(TickPosition(220), -429);  // -9.5 - 420 = -429.5
  EXPECT_EQ(Read(AXIS_OBJ_VELOCITY), 210);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_ERROR), -19);
}

}  // namespace
