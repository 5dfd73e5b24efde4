// Taking the tare: the mean by hand, every refusal by name, first and last ticks.
#include <string>

#include "tests/firmware/unit/firmware_fixture.hpp"

namespace {

class Tare : public FirmwareFixture {
 protected:
  Tare() { PowerUp(); }

  void PowerUp(int bits = 8, int zero_code = 0, int sign = 1) {
    fw_ = fw_t{};
    const fw_config_t config{};
    fw_init(&fw_, &config);
    inputs_ = {1000, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
    Set(AXIS_OBJ_ADC_BITS, bits);
    Set(AXIS_OBJ_FORCE_ZERO_CODE, zero_code);
    Set(AXIS_OBJ_FORCE_SIGN, sign);
    Set(AXIS_OBJ_TARE_AVERAGING, 4);
  }

  int State() const { return fw_.drive.signals.tare_state; }

  void Step(int code, int ticks = 1) {
    inputs_.adc_code[0] = static_cast<uint16_t>(code);
    Tick(ticks);
  }
};

TEST_F(Tare, IsTheMeanWithoutTheTareOfBefore) {
  for (int bits = 8; bits <= 16; ++bits) {
    for (int sign : {1, -1}) {
      SCOPED_TRACE(std::to_string(bits) + " bits, sign " + std::to_string(sign));
      const int zero = 1 << (bits - 1);
      PowerUp(bits, zero, sign);
      Set(AXIS_OBJ_TARE_NOISE, 0);
      Set(AXIS_OBJ_FORCE_TARE, 1234);
      Step(zero);
      Set(AXIS_OBJ_TARE, 1);
      // Eight times 3 and eight times 6 codes above zero: 4.5 codes of 2^(16 - bits) each.
      for (int i = 0; i < 16; ++i) {
        EXPECT_EQ(State(), AXIS_TARE_STATE_RUNNING) << i;
        EXPECT_EQ(Read(AXIS_OBJ_FORCE_TARE), 1234) << i;
        Step(zero + (i % 2 == 0 ? 3 : 6));
      }
      EXPECT_EQ(State(), AXIS_TARE_STATE_DONE);
      const int doubled = sign * 9 * (1 << (16 - bits));
      EXPECT_EQ(Read(AXIS_OBJ_FORCE_TARE), doubled / 2 + (bits == 16 && sign > 0 ? 1 : 0));
      Step(zero + 4);
      EXPECT_EQ(Read(AXIS_OBJ_FORCE), sign * 4 * (1 << (16 - bits)) - Read(AXIS_OBJ_FORCE_TARE));
    }
  }
}

TEST_F(Tare, TakesAsManyReadingsAsItsObjectSays) {
  for (int n : {0, 1, 12}) {
    PowerUp();
    Set(AXIS_OBJ_TARE_AVERAGING, n);
    Set(AXIS_OBJ_TARE, 1);
    Step(7, (1 << n) - 1);
    EXPECT_EQ(State(), AXIS_TARE_STATE_RUNNING) << n;
    if (n != 0) Set(AXIS_OBJ_TARE_AVERAGING, 3);  // of the next one
    Step(7);
    EXPECT_EQ(State(), AXIS_TARE_STATE_DONE) << n;
    EXPECT_EQ(Read(AXIS_OBJ_FORCE_TARE), 7 * 256) << n;
  }
}

TEST_F(Tare, TheLargestSumsAreExact) {
  PowerUp(16, 65535, 1);
  Set(AXIS_OBJ_TARE_AVERAGING, 12);
  Set(AXIS_OBJ_TARE, 1);
  Step(1, 4096);
  EXPECT_EQ(State(), AXIS_TARE_STATE_DONE);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_TARE), -65534);
  PowerUp(8, 65535, -1);
  Set(AXIS_OBJ_TARE, 1);
  Step(1, 16);
  EXPECT_EQ(State(), AXIS_TARE_STATE_REFUSED_BAND);  // 65534 counts
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_TARE), 0);
}

TEST_F(Tare, IsRefusedWhereTheAxisIsEnabled) {
  Set(AXIS_OBJ_TARE, 1);
  Step(5, 8);
  Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  EXPECT_EQ(Write(AXIS_OBJ_TARE, 1), FW_ERROR_STATE);
  Step(5);
  EXPECT_EQ(State(), AXIS_TARE_STATE_REFUSED_ENABLED);
  Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
  Step(5, 100);
  EXPECT_EQ(State(), AXIS_TARE_STATE_REFUSED_ENABLED);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_TARE), 0);
}

TEST_F(Tare, IsRefusedWhereTheAxisMoves) {
  for (int way : {1, -1}) {
    PowerUp();
    inputs_.encoder_cnt = INT32_MAX - 1;  // wraps
    Set(AXIS_OBJ_TARE, 1);
    Step(5, 4);
    inputs_.encoder_cnt = fx_sum_wrap(INT32_MAX - 1, 2 * way);
    Step(5, 11);
    EXPECT_EQ(State(), AXIS_TARE_STATE_RUNNING);
    inputs_.encoder_cnt = fx_sum_wrap(INT32_MAX - 1, 3 * way);
    Step(5);
    EXPECT_EQ(State(), AXIS_TARE_STATE_REFUSED_MOVING);
  }
}

TEST_F(Tare, IsRefusedWhereTheReadingIsNoisy) {
  for (int bits = 8; bits <= 16; ++bits) {
    const int count = 1 << (bits - 8);
    PowerUp(bits);
    Set(AXIS_OBJ_TARE_NOISE, 2 * 256);
    Set(AXIS_OBJ_TARE, 1);
    Step(10 * count, 2);
    Step(12 * count, 2);
    EXPECT_EQ(State(), AXIS_TARE_STATE_RUNNING) << bits;
    Step(10 * count - 1);
    EXPECT_EQ(State(), AXIS_TARE_STATE_REFUSED_NOISY) << bits;
    EXPECT_EQ(Read(AXIS_OBJ_FORCE_TARE), 0) << bits;
  }
}

TEST_F(Tare, IsRefusedBeyondTheBand) {
  for (int sign : {1, -1}) {
    PowerUp(8, 128, sign);
    Set(AXIS_OBJ_TARE_BAND, 10 * 256);
    for (int side : {1, -1}) {
      Set(AXIS_OBJ_TARE, 1);
      Step(128 + 10 * side, 16);
      EXPECT_EQ(State(), AXIS_TARE_STATE_DONE);
      EXPECT_EQ(Read(AXIS_OBJ_FORCE_TARE), sign * side * 2560);
      Set(AXIS_OBJ_TARE, 1);
      Step(128 + 11 * side, 16);
      EXPECT_EQ(State(), AXIS_TARE_STATE_REFUSED_BAND);
      EXPECT_EQ(Read(AXIS_OBJ_FORCE_TARE), sign * side * 2560);
    }
  }
}

TEST_F(Tare, IsNotWrittenBeyondABandThatBecameSmaller) {
  Set(AXIS_OBJ_TARE, 1);
  Step(10, 15);
  axis_outputs_t outputs{};
  fw_prepare(&fw_);
  fw_control(&fw_, &inputs_, &outputs);
  (void)fw_report(&fw_);
  Set(AXIS_OBJ_TARE_BAND, 9 * 256);  // after the last reading, before the tare is written
  fw_between(&fw_);
  EXPECT_EQ(State(), AXIS_TARE_STATE_REFUSED_BAND);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_TARE), 0);
}

TEST_F(Tare, KeepsTheStampOfTheVerifiedConfiguration) {
  Set(AXIS_OBJ_CONFIGURATION_DATE, 5);
  Set(AXIS_OBJ_TARE, 1);
  Step(10, 16);
  EXPECT_EQ(State(), AXIS_TARE_STATE_DONE);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_TARE), 2560);
  EXPECT_EQ(Read(AXIS_OBJ_CONFIGURATION_DATE), 5);
  Set(AXIS_OBJ_FORCE_TARE, 100);  // by a user: another configuration
  EXPECT_EQ(Read(AXIS_OBJ_CONFIGURATION_DATE), 0);
}

TEST_F(Tare, IsRefusedWithoutAReading) {
  for (int code : {0, 255}) {
    PowerUp(8, 128);
    Set(AXIS_OBJ_TARE, 1);
    Step(code);
    EXPECT_EQ(State(), AXIS_TARE_STATE_REFUSED_SENSOR);
  }
  PowerUp(8, 128);
  Set(AXIS_OBJ_TARE, 1);
  Step(130, 3);
  inputs_.sensor_valid = 0;
  Step(130);
  EXPECT_EQ(State(), AXIS_TARE_STATE_REFUSED_SENSOR);
}

TEST_F(Tare, CanBeBegunAnew) {
  EXPECT_EQ(State(), AXIS_TARE_STATE_IDLE);
  EXPECT_EQ(Write(AXIS_OBJ_TARE, 0), FW_ERROR_RANGE);
  Set(AXIS_OBJ_TARE, 1);
  Step(9, 10);
  Set(AXIS_OBJ_TARE, 1);
  Step(20, 15);
  EXPECT_EQ(State(), AXIS_TARE_STATE_RUNNING);
  Step(20);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_TARE), 20 * 256);
}

TEST_F(Tare, TheBandBoundsWritesToo) {
  Set(AXIS_OBJ_FORCE_TARE, 65536);
  Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  Tick();
  Set(AXIS_OBJ_FORCE_TARE, -65536);  // without a band nothing is refused
  Set(AXIS_OBJ_TARE_BAND, 512);
  EXPECT_EQ(Write(AXIS_OBJ_FORCE_TARE, 0), FW_ERROR_STATE);
  Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
  EXPECT_EQ(Write(AXIS_OBJ_FORCE_TARE, 0), FW_ERROR_STATE);  // until the tick that disables
  Tick();
  for (int value : {512, -512, 0}) EXPECT_EQ(Write(AXIS_OBJ_FORCE_TARE, value), FW_OK);
  for (int value : {513, -513}) EXPECT_EQ(Write(AXIS_OBJ_FORCE_TARE, value), FW_ERROR_RANGE);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_TARE), 0);
}

}  // namespace
