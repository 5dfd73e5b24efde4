#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <random>

#include "firmware/port/host/firmware.hpp"
#include "tests/firmware/unit/axis_fixture.hpp"

namespace {

class Axis : public AxisFixture {};

TEST_F(Axis, PowerUpIsDisabledWithCodeZero) {
  std::memset(&fw_, 0xA5, sizeof(fw_));
  PowerUp();
  EXPECT_EQ(Read(AXIS_OBJ_MODE), AXIS_MODE_DISABLED);
  for (int i = 0; i < 3; ++i) {
    outputs_ = {77, 1, 1, 1232, 0};
    inputs_.adc_code[0] = 200;
    EXPECT_EQ(TickPosition(1000 * i), 0);
    EXPECT_EQ(outputs_.amp_enable, 0);
    EXPECT_EQ(outputs_.brake_release, 0);
    EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
    EXPECT_EQ(Read(AXIS_OBJ_TICK_COUNT), i + 1);
  }
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_GAIN), 0);
  EXPECT_EQ(Read(AXIS_OBJ_ADC_BITS), 8);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_SIGN), 1);
  EXPECT_EQ(Read(AXIS_OBJ_OUTPUT_LIMIT), 2048);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_MIN), INT32_MIN);
}

TEST_F(Axis, AxisInitAloneIsPowerUpToo) {
  axis_t axis;
  std::memset(&axis, 0xA5, sizeof(axis));
  axis_init(&axis);
  axis_outputs_t outputs{5, 1, 1, 80, 0};
  axis_tick(&axis, &inputs_, &outputs);
  EXPECT_EQ(outputs.dac_code, 0);
  EXPECT_EQ(outputs.amp_enable, 0);
  EXPECT_EQ(axis.params.adc_bits, 8);
}

TEST_F(Axis, CodeZeroEnabledAndDisabledDiffer) {
  Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  EXPECT_EQ(Tick(), 0);
  EXPECT_EQ(outputs_.amp_enable, 1);
  EXPECT_EQ(outputs_.brake_release, 1);
  Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
  EXPECT_EQ(Tick(), 0);
  EXPECT_EQ(outputs_.amp_enable, 0);
  EXPECT_EQ(outputs_.brake_release, 0);
}

TEST_F(Axis, OpenLoopPutsOutItsCode) {
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  for (int code : {-2048, -1, 0, 1, 2047}) {
    Set(AXIS_OBJ_OPEN_LOOP_CODE, code);
    EXPECT_EQ(Tick(), code);
  }
}

TEST_F(Axis, SignalsComeFromTheInputs) {
  inputs_.adc_code[0] = 17;
  inputs_.adc_code[1] = 99;
  inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE | AXIS_DIGITAL_INPUTS_INDEX;
  TickPosition(-5);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_RAW), 17);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE), 17 * 256);
  EXPECT_EQ(Read(AXIS_OBJ_CURRENT_RAW), 99);
  EXPECT_EQ(Read(AXIS_OBJ_DIGITAL_INPUTS), 9);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION), -5);
  EXPECT_EQ(Read(AXIS_OBJ_VELOCITY), 0) << "no speed in the first tick";
  TickPosition(7);
  EXPECT_EQ(Read(AXIS_OBJ_VELOCITY), 12);
}

TEST_F(Axis, EncoderWraps) {
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Set(AXIS_OBJ_POSITION_GAIN, 256);
  Set(AXIS_OBJ_VELOCITY_GAIN, 256);
  TickPosition(INT32_MAX - 3);
  Set(AXIS_OBJ_POSITION_SETPOINT, INT32_MIN + 6);
  Set(AXIS_OBJ_MODE, AXIS_MODE_POSITION);
  EXPECT_EQ(TickPosition(INT32_MAX - 3), 10);
  EXPECT_EQ(TickPosition(INT32_MIN + 1), 0);  // error 5, speed 5
  EXPECT_EQ(Read(AXIS_OBJ_VELOCITY), 5);
  EXPECT_EQ(TickPosition(INT32_MAX), 9);  // error 7, speed -2
}

// Faults, each by its name, in the tick that shows it.
class Faults : public AxisFixture {
 protected:
  // Running with latency 1 and a code of 150 pending: neither may reach the DAC.
  void SetUp() override {
    Set(AXIS_OBJ_LATENCY_TICKS, 1);
    StartForce();
    TickForce(0);
    ASSERT_EQ(Tick(), 150);
    ASSERT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
  }

  // The fault stays, modes are refused, and a reset leaves the axis disabled.
  void ExpectLatched(int fault) {
    ExpectOff(fault);
    inputs_ = {inputs_.encoder_cnt, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
    for (int i = 0; i < 3; ++i) {
      Tick();
      ExpectOff(fault);
    }
    EXPECT_EQ(Write(AXIS_OBJ_MODE, AXIS_MODE_FORCE), FW_ERROR_STATE);
    EXPECT_EQ(Write(AXIS_OBJ_MODE, AXIS_MODE_DISABLED), FW_OK);
    EXPECT_EQ(Write(AXIS_OBJ_FAULT_RESET, 1), FW_OK);
    Tick();
    ExpectOff(AXIS_FAULT_NONE);
    Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
    Tick();
    EXPECT_EQ(outputs_.amp_enable, 1);
    EXPECT_EQ(outputs_.dac_code, 0) << "the code from before the fault must be gone";
  }
};

TEST_F(Faults, SensorInvalid) {
  inputs_.sensor_valid = 0;
  Tick();
  ExpectLatched(AXIS_FAULT_SENSOR_INVALID);
}

TEST_F(Faults, SensorInvalidWhileDisabledAndNoSpeedAfterIt) {
  Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
  TickPosition(100);
  inputs_.sensor_valid = 0;
  TickPosition(999999);
  ExpectOff(AXIS_FAULT_SENSOR_INVALID);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION), 100) << "an invalid count is not used";
  inputs_.sensor_valid = 1;
  TickPosition(5000);
  EXPECT_EQ(Read(AXIS_OBJ_VELOCITY), 0);
  TickPosition(5003);
  EXPECT_EQ(Read(AXIS_OBJ_VELOCITY), 3);
}

TEST_F(Faults, EnableLost) {
  inputs_.din = 0;
  Tick();
  ExpectLatched(AXIS_FAULT_ENABLE_LOST);
}

TEST_F(Faults, EnableOpenAtModeEntry) {
  Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
  Tick();
  inputs_.din = 0;
  Tick();
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE) << "an open chain is no fault while disabled";
  Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
  Tick();
  ExpectLatched(AXIS_FAULT_ENABLE_LOST);
}

TEST_F(Faults, AdcRangeForce) {
  TickForce(255);
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
  TickForce(256);
  ExpectLatched(AXIS_FAULT_ADC_RANGE);
}

TEST_F(Faults, AdcRangeCurrent) {
  inputs_.adc_code[1] = 256;
  Tick();
  ExpectLatched(AXIS_FAULT_ADC_RANGE);
}

TEST_F(Faults, LimitSwitches) {
  inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE | AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE |
                AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE;
  Tick();
  ExpectLatched(AXIS_FAULT_LIMIT_SWITCHES);
}

TEST_F(Faults, Overspeed) {
  Set(AXIS_OBJ_SPEED_MAX, 10);
  TickPosition(10);
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
  TickPosition(0);
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
  TickPosition(-11);
  ExpectLatched(AXIS_FAULT_OVERSPEED);
}

TEST_F(Faults, ForceMax) {
  Set(AXIS_OBJ_FORCE_MAX, 40 * 256);
  TickForce(40);
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
  TickForce(41);
  ExpectLatched(AXIS_FAULT_FORCE_MAX);
}

TEST_F(Faults, FollowingError) {
  Set(AXIS_OBJ_FOLLOWING_ERROR_MAX, 20);
  TickPosition(1000);
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE) << "only in position mode";
  Set(AXIS_OBJ_MODE, AXIS_MODE_POSITION);
  TickPosition(1000);
  TickPosition(1020);
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
  TickPosition(979);
  ExpectLatched(AXIS_FAULT_FOLLOWING_ERROR);
}

TEST_F(Faults, TheFirstOneStays) {
  inputs_.din = 0;
  Tick();
  inputs_.sensor_valid = 0;
  Tick();
  ExpectOff(AXIS_FAULT_ENABLE_LOST);
}

TEST_F(Faults, ResetWithTheCauseStillThere) {
  inputs_.sensor_valid = 0;
  Tick();
  Set(AXIS_OBJ_FAULT_RESET, 1);
  Tick();
  ExpectOff(AXIS_FAULT_SENSOR_INVALID);
}

class Limits : public AxisFixture {
 protected:
  void SetUp() override {
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  }
  void Expect(int asked, int code, int reason) {
    Set(AXIS_OBJ_OPEN_LOOP_CODE, asked);
    EXPECT_EQ(Tick(), code) << asked;
    EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), reason) << asked;
    EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE) << "an active limit is not a fault";
    EXPECT_EQ(outputs_.amp_enable, 1);
  }
};

TEST_F(Limits, OutputLimit) {
  Set(AXIS_OBJ_OUTPUT_LIMIT, 100);
  Expect(99, 99, AXIS_LIMIT_REASON_NONE);
  Expect(100, 100, AXIS_LIMIT_REASON_NONE);
  Expect(101, 100, AXIS_LIMIT_REASON_OUTPUT_LIMIT);
  Expect(-100, -100, AXIS_LIMIT_REASON_NONE);
  Expect(-101, -100, AXIS_LIMIT_REASON_OUTPUT_LIMIT);
  Set(AXIS_OBJ_OUTPUT_LIMIT, 0);
  Expect(5, 0, AXIS_LIMIT_REASON_OUTPUT_LIMIT);
  Set(AXIS_OBJ_OUTPUT_LIMIT, 2047);
  Expect(-2048, -2047, AXIS_LIMIT_REASON_OUTPUT_LIMIT);
  Set(AXIS_OBJ_OUTPUT_LIMIT, 2048);
  Expect(-2048, -2048, AXIS_LIMIT_REASON_NONE);
  Expect(2047, 2047, AXIS_LIMIT_REASON_NONE);
}

TEST_F(Limits, SoftLimitsBlockOneDirection) {
  Set(AXIS_OBJ_POSITION_MIN, -50);
  Set(AXIS_OBJ_POSITION_MAX, 50);
  TickPosition(50);
  Expect(10, 10, AXIS_LIMIT_REASON_NONE);
  TickPosition(51);
  Expect(10, 0, AXIS_LIMIT_REASON_POSITION_MAX);
  Expect(-10, -10, AXIS_LIMIT_REASON_NONE);
  TickPosition(-50);
  Expect(-10, -10, AXIS_LIMIT_REASON_NONE);
  TickPosition(-51);
  Expect(-10, 0, AXIS_LIMIT_REASON_POSITION_MIN);
  Expect(10, 10, AXIS_LIMIT_REASON_NONE);
  Expect(0, 0, AXIS_LIMIT_REASON_NONE);
}

TEST_F(Limits, NoSoftLimitAtTheEndsOfTheRange) {
  TickPosition(INT32_MAX);
  Expect(10, 10, AXIS_LIMIT_REASON_NONE);
  TickPosition(INT32_MIN);
  Expect(-10, -10, AXIS_LIMIT_REASON_NONE);
}

TEST_F(Limits, LimitSwitchesBlockOneDirection) {
  inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE | AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE;
  Expect(10, 0, AXIS_LIMIT_REASON_LIMIT_SWITCH_POS);
  Expect(-10, -10, AXIS_LIMIT_REASON_NONE);
  inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE | AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE;
  Expect(-10, 0, AXIS_LIMIT_REASON_LIMIT_SWITCH_NEG);
  Expect(10, 10, AXIS_LIMIT_REASON_NONE);
  Set(AXIS_OBJ_POSITION_MIN, 5);
  Expect(-10, 0, AXIS_LIMIT_REASON_LIMIT_SWITCH_NEG);
}

TEST_F(Axis, LatencyDelaysByOneTick) {
  Set(AXIS_OBJ_LATENCY_TICKS, 1);
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Set(AXIS_OBJ_FORCE_GAIN, 256);
  Set(AXIS_OBJ_FORCE_SETPOINT, 100 * 256);
  Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
  EXPECT_EQ(TickForce(10), 0);
  EXPECT_EQ(outputs_.amp_enable, 1);
  EXPECT_EQ(Read(AXIS_OBJ_COMMAND_CODE), 90);
  EXPECT_EQ(TickForce(20), 90);
  EXPECT_EQ(TickForce(30), 80);
  EXPECT_EQ(Read(AXIS_OBJ_DAC_CODE), 80);
  EXPECT_EQ(Read(AXIS_OBJ_COMMAND_CODE), 70);
  Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
  EXPECT_EQ(TickForce(30), 0);
  EXPECT_EQ(outputs_.amp_enable, 0);
  Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
  EXPECT_EQ(TickForce(30), 0) << "nothing is left from before";
}

// Open loop with latency 1 and a code of `asked` computed: the next tick outputs it.
class Latency : public AxisFixture {
 protected:
  void SetUp() override {
    Set(AXIS_OBJ_LATENCY_TICKS, 1);
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  }
  // Rests at code 0, with open limit switches, then computes `asked`.
  void Compute(int asked) {
    inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
    Set(AXIS_OBJ_OPEN_LOOP_CODE, 0);
    for (int i = 0; i < 2; ++i) TickPosition(0);
    Set(AXIS_OBJ_OPEN_LOOP_CODE, asked);
    ASSERT_EQ(Tick(), 0);
    ASSERT_EQ(Read(AXIS_OBJ_COMMAND_CODE), asked);
    ASSERT_EQ(Read(AXIS_OBJ_LIMIT_REASON), AXIS_LIMIT_REASON_NONE) << "0 goes out, unlimited";
  }
  void ExpectOut(int code, int reason) {
    EXPECT_EQ(Tick(), code);
    EXPECT_EQ(Read(AXIS_OBJ_DAC_CODE), code);
    EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), reason);
    EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
  }
};

TEST_F(Latency, OutputLimitActsAtOnce) {
  for (int asked : {2047, -2048}) {
    Set(AXIS_OBJ_OUTPUT_LIMIT, 2048);
    Compute(asked);
    ExpectOut(asked, AXIS_LIMIT_REASON_NONE);
    Set(AXIS_OBJ_OUTPUT_LIMIT, 100);
    ExpectOut(asked > 0 ? 100 : -100, AXIS_LIMIT_REASON_OUTPUT_LIMIT);
    Set(AXIS_OBJ_OUTPUT_LIMIT, 0);
    ExpectOut(0, AXIS_LIMIT_REASON_OUTPUT_LIMIT);
    Set(AXIS_OBJ_OUTPUT_LIMIT, 2048);
    ExpectOut(asked, AXIS_LIMIT_REASON_NONE);
  }
}

TEST_F(Latency, LimitSwitchActsAtOnce) {
  Compute(2047);
  inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE | AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE;
  ExpectOut(0, AXIS_LIMIT_REASON_LIMIT_SWITCH_POS);
  inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
  ExpectOut(2047, AXIS_LIMIT_REASON_NONE);
  Compute(-2048);
  inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE | AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE;
  ExpectOut(0, AXIS_LIMIT_REASON_LIMIT_SWITCH_NEG);
  inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE | AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE;
  ExpectOut(-2048, AXIS_LIMIT_REASON_NONE);
}

TEST_F(Latency, SoftLimitActsAtOnce) {
  Set(AXIS_OBJ_POSITION_MIN, -50);
  Set(AXIS_OBJ_POSITION_MAX, 50);
  Compute(2047);
  inputs_.encoder_cnt = 51;
  ExpectOut(0, AXIS_LIMIT_REASON_POSITION_MAX);
  inputs_.encoder_cnt = 50;
  ExpectOut(2047, AXIS_LIMIT_REASON_NONE);
  Compute(-2048);
  inputs_.encoder_cnt = -51;
  ExpectOut(0, AXIS_LIMIT_REASON_POSITION_MIN);
  inputs_.encoder_cnt = 51;
  ExpectOut(-2048, AXIS_LIMIT_REASON_NONE);
}

// A code away from the limit is computed while one into it is still pending: the pending one is
// blocked, and the reason is that of the pending code, not of the computed one.
TEST_F(Latency, TheReasonIsThatOfTheOutputCode) {
  Compute(500);
  inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE | AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE;
  Set(AXIS_OBJ_OPEN_LOOP_CODE, -500);
  ExpectOut(0, AXIS_LIMIT_REASON_LIMIT_SWITCH_POS);
  EXPECT_EQ(Read(AXIS_OBJ_COMMAND_CODE), -500);
  Set(AXIS_OBJ_OPEN_LOOP_CODE, 500);
  ExpectOut(-500, AXIS_LIMIT_REASON_NONE);
}

TEST_F(Latency, SaturationIsReportedWithTheCodeItLimits) {
  Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
  Tick();
  Set(AXIS_OBJ_FORCE_GAIN, 65535);
  Set(AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
  Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
  inputs_.adc_code[0] = 0;
  ExpectOut(0, AXIS_LIMIT_REASON_NONE);
  EXPECT_EQ(Read(AXIS_OBJ_COMMAND_CODE), 2048) << "one beyond the range of the DAC";
  inputs_.adc_code[0] = 30;
  ExpectOut(2047, AXIS_LIMIT_REASON_DAC_SATURATION);
  EXPECT_EQ(Read(AXIS_OBJ_COMMAND_CODE), 0);
  ExpectOut(0, AXIS_LIMIT_REASON_NONE);
}

// While a limit holds the output, a change of mode continues from the code at the output, not from
// a blocked one: the axis does not jump when the limit ends.
TEST_F(Latency, AChangeContinuesFromTheLimitedCode) {
  for (int latency : {0, 1}) {
    PowerUp();
    Set(AXIS_OBJ_LATENCY_TICKS, latency);
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    Set(AXIS_OBJ_OUTPUT_LIMIT, 100);
    Set(AXIS_OBJ_OPEN_LOOP_CODE, 2000);
    Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
    for (int i = 0; i < 3; ++i) Tick();
    ASSERT_EQ(outputs_.dac_code, 100);
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 12);
    Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);  // gain 0: the law computes 0
    EXPECT_EQ(Tick(), 100) << latency;
    EXPECT_EQ(Read(AXIS_OBJ_COMMAND_CODE), 100) << latency;
    Set(AXIS_OBJ_OUTPUT_LIMIT, 2048);
    EXPECT_EQ(Tick(), 100) << latency;
    EXPECT_EQ(Tick(), 100) << latency;
  }
}

TEST_F(Axis, ModeChangeContinuesAndDecays) {
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 3);
  Set(AXIS_OBJ_OPEN_LOOP_CODE, 800);
  Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  EXPECT_EQ(Tick(), 0) << "continues from the 0 of disabled";
  EXPECT_EQ(Tick(), 100);  // bias -800 * 7/8
  EXPECT_EQ(Tick(), 188);  // bias -612.5, 187.5 rounds up
  for (int i = 0; i < 200; ++i) Tick();
  EXPECT_EQ(Tick(), 800);
  EXPECT_EQ(Read(AXIS_OBJ_BUMP_BIAS), 0);
  Set(AXIS_OBJ_FORCE_GAIN, 256);
  Set(AXIS_OBJ_FORCE_SETPOINT, 20 * 256);
  Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
  int previous = TickForce(0);
  EXPECT_EQ(previous, 800);
  for (int i = 0; i < 300; ++i) {
    const int code = Tick();
    ASSERT_LE(code, previous) << "the bias only shrinks";
    previous = code;
  }
  EXPECT_EQ(previous, 20);
  EXPECT_EQ(Read(AXIS_OBJ_BUMP_BIAS), 0);
}

TEST_F(Axis, GainChangeContinuesAndDecays) {
  StartForce();
  ASSERT_EQ(TickForce(10), 100);
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 4);
  Set(AXIS_OBJ_FORCE_GAIN, 10 * 256);
  EXPECT_EQ(TickForce(10), 100);
  EXPECT_EQ(TickForce(10), 106);  // 200 - 100 * 15/16 = 106.25
  EXPECT_EQ(TickForce(11), 102);  // 190 - 87.89 = 102.11
  for (int i = 0; i < 300; ++i) TickForce(10);
  EXPECT_EQ(TickForce(10), 200);
  Set(AXIS_OBJ_POSITION_GAIN, 10 * 256);
  EXPECT_EQ(TickForce(20), 100) << "a gain of another mode leaves no bias";
  Set(AXIS_OBJ_FORCE_GAIN, 10 * 256);
  EXPECT_EQ(TickForce(10), 200) << "the same gain again changes nothing";
}

class Bumpless : public AxisFixture, public ::testing::WithParamInterface<int> {};

// The code computed in the tick of the change, which is output `latency` ticks later, equals the
// code output just before it.
TEST_P(Bumpless, EveryChange) {
  const int latency = GetParam();
  std::mt19937 random(3);
  Set(AXIS_OBJ_LATENCY_TICKS, latency);
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 6);
  int previous = 0;
  for (int i = 0; i < 5000; ++i) {
    switch (random() % 4) {
      case 0:
        Set(AXIS_OBJ_MODE, static_cast<int32_t>(1 + random() % 3));
        if (Read(AXIS_OBJ_MODE) == Read(AXIS_OBJ_ACTIVE_MODE)) continue;
        break;
      case 1:
        if (Read(AXIS_OBJ_ACTIVE_MODE) != AXIS_MODE_FORCE) continue;
        Set(AXIS_OBJ_FORCE_GAIN,
            Read(AXIS_OBJ_FORCE_GAIN) ^ static_cast<int32_t>(1 + random() % 4000));
        break;
      case 2:
        if (Read(AXIS_OBJ_ACTIVE_MODE) != AXIS_MODE_POSITION) continue;
        Set(AXIS_OBJ_VELOCITY_GAIN,
            Read(AXIS_OBJ_VELOCITY_GAIN) ^ static_cast<int32_t>(1 + random() % 65535));
        break;
      default:
        if (Read(AXIS_OBJ_ACTIVE_MODE) != AXIS_MODE_POSITION) continue;
        Set(AXIS_OBJ_POSITION_GAIN,
            Read(AXIS_OBJ_POSITION_GAIN) ^ static_cast<int32_t>(1 + random() % 65535));
        break;
    }
    inputs_.encoder_cnt += static_cast<int32_t>(random() % 100);
    for (int late = 0; late < latency; ++late) previous = TickForce(inputs_.adc_code[0]);
    ASSERT_EQ(TickForce(static_cast<uint16_t>(random() % 256)), previous) << "change " << i;
    Set(AXIS_OBJ_OPEN_LOOP_CODE, static_cast<int32_t>(random() % 4096) - 2048);
    for (int t = 0; t < 5; ++t) previous = TickForce(static_cast<uint16_t>(random() % 256));
  }
}

INSTANTIATE_TEST_SUITE_P(Latency, Bumpless, ::testing::Values(0, 1));

TEST_F(Axis, AnotherShiftLeavesADecayingBiasAsItIs) {
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 4);
  Set(AXIS_OBJ_OPEN_LOOP_CODE, 2000);
  Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  ASSERT_EQ(Tick(), 0);
  ASSERT_EQ(Tick(), 125);  // bias -2000 * 15/16
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  EXPECT_EQ(Tick(), 242) << "not 2000: the bias goes on with the shift it began with";
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 1);
  EXPECT_EQ(Tick(), 352);
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Set(AXIS_OBJ_FORCE_GAIN, 256);
  Set(AXIS_OBJ_FORCE_SETPOINT, 20 * 256);
  Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
  EXPECT_EQ(TickForce(0), 20) << "the next change is taken over at once";
  EXPECT_EQ(Read(AXIS_OBJ_BUMP_BIAS), 0);
}

TEST_F(Axis, NoBiasIsWantedWithShiftZero) {
  StartForce();
  ASSERT_EQ(TickForce(10), 100);
  Set(AXIS_OBJ_FORCE_GAIN, 10 * 256);
  EXPECT_EQ(TickForce(10), 200);
  EXPECT_EQ(Read(AXIS_OBJ_BUMP_BIAS), 0);
}

TEST_F(Axis, BiasNeverExceedsTheRangeOfTheDac) {
  // A far set-point at a high gain is limited before the bias is taken, so that the way back from
  // it is not delayed by a huge bias.
  Set(AXIS_OBJ_POSITION_GAIN, 65535);
  Set(AXIS_OBJ_POSITION_SETPOINT, 1000000);
  Set(AXIS_OBJ_MODE, AXIS_MODE_POSITION);
  EXPECT_EQ(Tick(), 0);
  EXPECT_EQ(Read(AXIS_OBJ_BUMP_BIAS), -2048 * 65536);
}

class PositionEntry : public AxisFixture {
 protected:
  void SetUp() override {
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    Set(AXIS_OBJ_POSITION_GAIN, 256);
  }
};

TEST_F(PositionEntry, WithoutASetpointHoldsThePresentPosition) {
  TickPosition(5000);
  Set(AXIS_OBJ_MODE, AXIS_MODE_POSITION);
  EXPECT_EQ(TickPosition(5000), 0);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_SETPOINT), 5000);
  EXPECT_EQ(TickPosition(4990), 10);
}

TEST_F(PositionEntry, ASetpointWrittenBeforeIsPursued) {
  TickPosition(5000);
  Set(AXIS_OBJ_POSITION_SETPOINT, 5100);
  Set(AXIS_OBJ_MODE, AXIS_MODE_POSITION);
  EXPECT_EQ(TickPosition(5000), 100);
}

TEST_F(PositionEntry, ASetpointWrittenBetweenModeAndTickIsPursued) {
  TickPosition(5000);
  Set(AXIS_OBJ_MODE, AXIS_MODE_POSITION);
  Set(AXIS_OBJ_POSITION_SETPOINT, 5100);
  EXPECT_EQ(TickPosition(5000), 100);
}

TEST_F(PositionEntry, AnOldSetpointIsNotPursuedAgain) {
  Set(AXIS_OBJ_POSITION_SETPOINT, 100);
  Set(AXIS_OBJ_MODE, AXIS_MODE_POSITION);
  EXPECT_EQ(TickPosition(0), 100);
  Set(AXIS_OBJ_POSITION_SETPOINT, 200);
  EXPECT_EQ(TickPosition(0), 200);
  Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
  TickPosition(-300);
  Set(AXIS_OBJ_MODE, AXIS_MODE_POSITION);
  EXPECT_EQ(TickPosition(-300), 0);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_SETPOINT), -300);
}

TEST_F(PositionEntry, AFaultDropsASetpointNotYetPursued) {
  Set(AXIS_OBJ_POSITION_SETPOINT, 100);
  inputs_.sensor_valid = 0;
  Tick();
  inputs_.sensor_valid = 1;
  Set(AXIS_OBJ_FAULT_RESET, 1);
  Set(AXIS_OBJ_MODE, AXIS_MODE_POSITION);
  EXPECT_EQ(TickPosition(7), 0);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_SETPOINT), 7);
}

TEST_F(PositionEntry, ProfileStartsAtThePresentPosition) {
  Set(AXIS_OBJ_PROFILE_ENABLE, AXIS_PROFILE_ENABLE_TRAPEZOID);
  Set(AXIS_OBJ_PROFILE_VELOCITY_MAX, 2 * 65536);
  Set(AXIS_OBJ_PROFILE_ACCELERATION_MAX, 65536);
  TickPosition(1000);
  Set(AXIS_OBJ_POSITION_SETPOINT, 1010);
  Set(AXIS_OBJ_MODE, AXIS_MODE_POSITION);
  for (int position : {1001, 1003, 1005, 1007, 1008, 1009, 1010, 1010}) {
    TickPosition(1000);
    EXPECT_EQ(Read(AXIS_OBJ_PROFILE_POSITION), position);
    EXPECT_EQ(outputs_.dac_code, position - 1000);
  }
  EXPECT_EQ(Read(AXIS_OBJ_PROFILE_VELOCITY), 0);
}

TEST_F(PositionEntry, ProfileStartsThereInTheFirstTickOfAll) {
  Set(AXIS_OBJ_PROFILE_ENABLE, AXIS_PROFILE_ENABLE_TRAPEZOID);
  Set(AXIS_OBJ_PROFILE_VELOCITY_MAX, 2 * 65536);
  Set(AXIS_OBJ_PROFILE_ACCELERATION_MAX, 65536);
  Set(AXIS_OBJ_POSITION_SETPOINT, -790);
  Set(AXIS_OBJ_MODE, AXIS_MODE_POSITION);
  for (int position : {-799, -797}) {
    TickPosition(-800);
    EXPECT_EQ(Read(AXIS_OBJ_PROFILE_POSITION), position);
    EXPECT_EQ(outputs_.dac_code, position + 800);
  }
}

TEST_F(PositionEntry, ProfileStartsThereAfterCountsThatWereNotValid) {
  Set(AXIS_OBJ_PROFILE_ENABLE, AXIS_PROFILE_ENABLE_TRAPEZOID);
  Set(AXIS_OBJ_PROFILE_VELOCITY_MAX, 2 * 65536);
  Set(AXIS_OBJ_PROFILE_ACCELERATION_MAX, 65536);
  TickPosition(0);
  inputs_.sensor_valid = 0;
  TickPosition(900);
  inputs_.sensor_valid = 1;
  Set(AXIS_OBJ_FAULT_RESET, 1);
  Set(AXIS_OBJ_POSITION_SETPOINT, 910);
  Set(AXIS_OBJ_MODE, AXIS_MODE_POSITION);
  EXPECT_EQ(TickPosition(900), 1);
}

TEST_F(PositionEntry, ProfileSwitchedOnLaterStartsAtTheSetpoint) {
  Set(AXIS_OBJ_POSITION_SETPOINT, 50);
  Set(AXIS_OBJ_MODE, AXIS_MODE_POSITION);
  TickPosition(0);
  Set(AXIS_OBJ_PROFILE_ENABLE, AXIS_PROFILE_ENABLE_TRAPEZOID);
  Set(AXIS_OBJ_POSITION_SETPOINT, 60);
  Set(AXIS_OBJ_PROFILE_ACCELERATION_MAX, 65536);
  TickPosition(0);
  EXPECT_EQ(Read(AXIS_OBJ_PROFILE_POSITION), 51);
}

TEST_F(Axis, EveryModeCanFollowEveryOther) {
  for (uint8_t from = 0; from < AXIS_MODE_COUNT; ++from) {
    for (uint8_t to = 0; to < AXIS_MODE_COUNT; ++to) {
      for (uint8_t mode : {from, to}) {
        Set(AXIS_OBJ_MODE, mode);
        Tick();
        EXPECT_EQ(Read(AXIS_OBJ_ACTIVE_MODE), mode);
        EXPECT_EQ(outputs_.amp_enable, mode != AXIS_MODE_DISABLED);
      }
    }
  }
}

TEST(State, FitsAndCopies) {
  EXPECT_LE(sizeof(axis_t), 512u);
  axis_t one;
  axis_init(&one);
  one.params.mode = AXIS_MODE_OPEN_LOOP;
  one.params.open_loop_code = 300;
  const axis_inputs_t inputs{0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
  axis_outputs_t a{};
  axis_outputs_t b{};
  axis_tick(&one, &inputs, &a);
  axis_t two = one;
  for (int i = 0; i < 50; ++i) {
    axis_tick(&one, &inputs, &a);
    axis_tick(&two, &inputs, &b);
    ASSERT_EQ(a.dac_code, b.dac_code);
  }
}

TEST(HostPort, TicksReadsAndWrites) {
  fw_t *host = axis_host_create();
  ASSERT_NE(host, nullptr);
  EXPECT_EQ(fw_object_write(host, FW_SOURCE_LOCAL, AXIS_OBJ_BUMP_DECAY_SHIFT, 0), 0);
  EXPECT_EQ(fw_object_write(host, FW_SOURCE_LOCAL, AXIS_OBJ_FORCE_GAIN, 1280), 0);
  EXPECT_EQ(fw_object_write(host, FW_SOURCE_LOCAL, AXIS_OBJ_FORCE_SETPOINT, 7680), 0);
  EXPECT_EQ(fw_object_write(host, FW_SOURCE_LOCAL, AXIS_OBJ_MODE, AXIS_MODE_FORCE), 0);
  const axis_inputs_t inputs{0, {28, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
  axis_outputs_t outputs{};
  fw_tick(host, &inputs, &outputs);
  EXPECT_EQ(outputs.dac_code, 10);
  int32_t value = 0;
  EXPECT_EQ(fw_object_read(host, AXIS_OBJ_FORCE, &value), 0);
  EXPECT_EQ(value, 28 * 256);
  int32_t values[RECORDER_CHANNELS];
  EXPECT_EQ(fw_recorder_read(host, 0, values), FW_ERROR_NO_DATA);
  axis_host_destroy(host);
  axis_host_destroy(nullptr);
}

}  // namespace
