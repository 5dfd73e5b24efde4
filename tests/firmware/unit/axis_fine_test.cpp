// An output with more than 12 bits: the law is rounded once, to the step of the output, and limits,
// faults and bumpless transfer act on what is rounded. Expected values are exact fractions.
#include <cstdint>
#include <random>
#include <string>

#include "tests/firmware/unit/axis_fixture.hpp"

namespace {

// floor(a / b), b > 0.
int64_t FloorDivide(int64_t a, int64_t b) {
  const int64_t quotient = a / b;
  return quotient - (a % b < 0 ? 1 : 0);
}

// The fraction num / 2^16 in codes, rounded half up to a step of 2^(12 - bits) code and limited to
// -limit..limit codes and to the codes of the DAC; in 1/16 code.
int64_t Rounded(int64_t num, int bits, int64_t limit = 2048) {
  const int64_t steps = int64_t{1} << (bits - 12);
  const int64_t nearest = FloorDivide(2 * num * steps + 65536, 2 * 65536);
  const int64_t fine = nearest * (16 / steps);
  const int64_t most = (limit > 2047 ? 2047 : limit) * 16;
  return fine > most ? most : (fine < -16 * limit ? -16 * limit : fine);
}

class AxisFine : public AxisFixture {
 protected:
  // Force mode without bias, with an ADC of 16 bits, so that a code is 1/256 count.
  void StartForceWith(int bits) {
    Set(AXIS_OBJ_ADC_BITS, 16);
    Set(AXIS_OBJ_DAC_BITS, bits);
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
  }

  int Fine() const { return outputs_.dac_fine; }
};

TEST_F(AxisFine, TheForceLawIsRoundedOnce) {
  std::mt19937 random(31);
  int64_t within = 0, odd = 0;
  for (int bits = 12; bits <= 16; ++bits) {
    PowerUp();
    StartForceWith(bits);
    for (int i = 0; i < 20000; ++i) {
      const auto gain = static_cast<int32_t>(random() % (i % 3 == 0 ? 65536 : 2000));
      const auto setpoint = static_cast<int32_t>(random() % 65536);
      // Near the set-point most codes are within the range.
      const auto reading =
          static_cast<uint16_t>(i % 2 == 0 ? random() : setpoint + random() % 2048 - 1024);
      Set(AXIS_OBJ_FORCE_GAIN, gain);
      Set(AXIS_OBJ_FORCE_SETPOINT, setpoint);
      TickForce(reading);
      const int64_t expected = Rounded(int64_t{gain} * (setpoint - reading), bits);
      ASSERT_EQ(Fine(), expected) << "bits " << bits << " gain " << gain << " set-point "
                                  << setpoint << " reading " << reading;
      ASSERT_EQ(outputs_.dac_code, FloorDivide(expected + 8, 16));
      ASSERT_EQ(Read(AXIS_OBJ_DAC_FINE), expected);
      within += expected > -32768 && expected < 32752;
      odd += expected % 2 != 0;
    }
  }
  EXPECT_GT(within, 40000);
  EXPECT_GT(odd, 4000) << "all 16 bits are used";
}

TEST_F(AxisFine, ThePositionLawIsRoundedOnce) {
  std::mt19937 random(32);
  for (int bits = 12; bits <= 16; ++bits) {
    PowerUp();
    Set(AXIS_OBJ_DAC_BITS, bits);
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    Set(AXIS_OBJ_MODE, AXIS_MODE_POSITION);
    int32_t before = 0;
    TickPosition(before);
    for (int i = 0; i < 10000; ++i) {
      const auto kp = static_cast<int32_t>(random() % 3000);
      const auto kd = static_cast<int32_t>(random() % 3000);
      const auto place = static_cast<int32_t>(random() % 400) - 200;
      const auto target = static_cast<int32_t>(random() % 400) - 200;
      Set(AXIS_OBJ_POSITION_GAIN, kp);
      Set(AXIS_OBJ_VELOCITY_GAIN, kd);
      Set(AXIS_OBJ_POSITION_SETPOINT, target);
      TickPosition(place);
      const int64_t q8 = int64_t{kp} * (target - place) - int64_t{kd} * (place - before);
      ASSERT_EQ(Fine(), Rounded(q8 * 256, bits)) << bits;
      before = place;
    }
  }
}

// A gain of 1/256 code per count, so that an ADC code is 1/65536 code.
TEST_F(AxisFine, TheEndsAreWholeCodes) {
  StartForceWith(16);
  const struct {
    int gain, setpoint, reading, limit, fine, reason;
  } cases[] = {
      // 2047.5 and -2048.5 codes
      {65536 / 2, 4095, 0, 2048, 2047 * 16, AXIS_LIMIT_REASON_DAC_SATURATION},
      {65536 / 2, 0, 4097, 2048, -2048 * 16, AXIS_LIMIT_REASON_DAC_SATURATION},
      {65536 / 2, 4094, 0, 2048, 2047 * 16, AXIS_LIMIT_REASON_NONE},
      {65536 / 2, 0, 4096, 2048, -2048 * 16, AXIS_LIMIT_REASON_NONE},
      // 100.0625 codes beyond a limit of 100, 99.9375 within it
      {4096, 1601, 0, 100, 1600, AXIS_LIMIT_REASON_OUTPUT_LIMIT},
      {4096, 0, 1601, 100, -1600, AXIS_LIMIT_REASON_OUTPUT_LIMIT},
      {4096, 1599, 0, 100, 1599, AXIS_LIMIT_REASON_NONE},
      {4096, 0, 1599, 100, -1599, AXIS_LIMIT_REASON_NONE},
      {4096, 1, 0, 0, 0, AXIS_LIMIT_REASON_OUTPUT_LIMIT},
  };
  for (const auto &c : cases) {
    Set(AXIS_OBJ_FORCE_GAIN, c.gain);
    Set(AXIS_OBJ_FORCE_SETPOINT, c.setpoint);
    Set(AXIS_OBJ_OUTPUT_LIMIT, c.limit);
    TickForce(static_cast<uint16_t>(c.reading));
    EXPECT_EQ(Fine(), c.fine) << c.setpoint << " " << c.reading;
    EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), c.reason) << c.setpoint << " " << c.reading;
  }
}

// A sixteenth of a code would move a drive on a bus, although dac_code is 0.
TEST_F(AxisFine, ASwitchBlocksAlsoAFractionOfACode) {
  StartForceWith(16);
  Set(AXIS_OBJ_FORCE_GAIN, 4096);
  for (const int sign : {1, -1}) {
    Set(AXIS_OBJ_FORCE_SETPOINT, 1000 + sign);
    inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
    TickForce(1000);
    EXPECT_EQ(Fine(), sign);
    EXPECT_EQ(outputs_.dac_code, 0);
    const int toward =
        sign > 0 ? AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE : AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE;
    const int away =
        sign > 0 ? AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE : AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE;
    inputs_.din = static_cast<uint8_t>(AXIS_DIGITAL_INPUTS_ENABLE | toward);
    Tick();
    EXPECT_EQ(Fine(), 0);
    inputs_.din = static_cast<uint8_t>(AXIS_DIGITAL_INPUTS_ENABLE | away);
    Tick();
    EXPECT_EQ(Fine(), sign);
  }
  inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
  Set(AXIS_OBJ_FORCE_SETPOINT, 1001);
  Set(AXIS_OBJ_POSITION_MIN, -20);
  Set(AXIS_OBJ_POSITION_MAX, -10);
  Tick();
  EXPECT_EQ(Fine(), 0) << "beyond the soft limit";
}

TEST_F(AxisFine, ALateOutputIsThatOfTheTickBefore) {
  StartForceWith(16);
  Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
  Tick();
  Set(AXIS_OBJ_LATENCY_TICKS, 1);
  Set(AXIS_OBJ_FORCE_GAIN, 1234);
  Set(AXIS_OBJ_FORCE_SETPOINT, 30000);
  Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
  std::mt19937 random(33);
  int64_t due = 0;
  for (int i = 0; i < 2000; ++i) {
    const auto reading = static_cast<uint16_t>(29000 + random() % 2000);
    TickForce(reading);
    ASSERT_EQ(Fine(), due) << i;
    due = Rounded(int64_t{1234} * (30000 - reading), 16);
  }
}

TEST_F(AxisFine, AChangeOfTheGainDoesNotStep) {
  StartForceWith(16);
  Set(AXIS_OBJ_FORCE_GAIN, 1000);
  Set(AXIS_OBJ_FORCE_SETPOINT, 777);
  TickForce(0);
  const int before = Fine();
  EXPECT_EQ(before, Rounded(777000, 16));
  EXPECT_NE(before % 16, 0);
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 8);
  Set(AXIS_OBJ_FORCE_GAIN, 40000);
  Tick();
  EXPECT_EQ(Fine(), before);
}

TEST_F(AxisFine, AFaultLeavesNoFraction) {
  for (const int how : {0, 1, 2}) {
    PowerUp();
    StartForceWith(16);
    Set(AXIS_OBJ_FORCE_GAIN, 4096);
    Set(AXIS_OBJ_FORCE_SETPOINT, 17);
    TickForce(0);
    ASSERT_EQ(Fine(), 17);
    inputs_.sensor_valid = how == 0 ? 0 : 1;
    inputs_.din = how == 1 ? 0 : AXIS_DIGITAL_INPUTS_ENABLE;
    if (how == 2) axis_fault(&fw_.axis, AXIS_FAULT_MAIN_LOOP_LOST);
    Tick();
    EXPECT_EQ(Fine(), 0) << how;
    EXPECT_EQ(Read(AXIS_OBJ_DAC_FINE), 0);
    EXPECT_EQ(outputs_.dac_code, 0);
    EXPECT_EQ(outputs_.amp_enable, 0);
    inputs_.sensor_valid = 1;
    inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
  }
}

TEST_F(AxisFine, TheResolutionIsThatOfTheBoardAndOfADisabledAxis) {
  EXPECT_EQ(Write(AXIS_OBJ_DAC_BITS, 11), FW_ERROR_RANGE);
  EXPECT_EQ(Write(AXIS_OBJ_DAC_BITS, 17), FW_ERROR_RANGE);
  StartForceWith(14);
  Tick();
  EXPECT_EQ(Write(AXIS_OBJ_DAC_BITS, 12), FW_ERROR_STATE);
  for (const int most : {12, 14}) {
    fw_config_t config{};
    config.dac_bits = static_cast<uint8_t>(most);
    fw_init(&fw_, &config);
    for (int bits = 12; bits <= 16; ++bits)
      EXPECT_EQ(Write(AXIS_OBJ_DAC_BITS, bits), bits <= most ? FW_OK : FW_ERROR_RANGE) << most;
    Set(AXIS_OBJ_DRIVE_NODE_ID, 9);
    EXPECT_EQ(Write(AXIS_OBJ_DAC_BITS, 16), FW_OK) << "a drive on a bus gets all bits";
  }
}

// A set that was stored with a drive, or on another board.
TEST_F(AxisFine, ABoardWith12BitsDoesNotLoadMore) {
  axis_t axis;
  axis_init(&axis);
  axis.params.dac_bits = 16;
  axis_output_loaded(&axis, 12);
  EXPECT_EQ(axis.params.dac_bits, 12);
  axis.params.dac_bits = 13;
  axis_output_loaded(&axis, 16);
  EXPECT_EQ(axis.params.dac_bits, 13);
  axis.params.mode = AXIS_MODE_FORCE;
  axis.params.force_gain = 256;  // 2^-8 code for 1/256 count
  axis.params.force_setpoint = 127;
  axis.params.bump_decay_shift = 0;
  axis_outputs_t outputs{};
  axis_tick(&axis, &inputs_, &outputs);
  EXPECT_EQ(outputs.dac_fine, 8) << "127 / 256 code, with steps of a half";
}

// A host port hands the DAC its own codes.
TEST(AxisHost, TheCodeOfADacIsTheNearest) {
  for (int fine = -32768; fine <= 2047 * 16; ++fine) {
    const axis_outputs_t outputs{0, 1, 1, static_cast<int16_t>(fine), 0};
    for (int bits = 12; bits <= 16; ++bits) {
      const int steps = 1 << (16 - bits);
      ASSERT_EQ(axis_host_dac_code(&outputs, bits), FloorDivide(2 * fine + steps, 2 * steps));
    }
  }
}

}  // namespace
