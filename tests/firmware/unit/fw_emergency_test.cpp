// Emergencies: of a fault with a ramp before it, and of events that are no faults.

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <vector>

#include "tests/firmware/unit/flash.hpp"
#include "tests/firmware/unit/fw_fixture.hpp"
#include "tests/firmware/unit/store_fixture.hpp"

namespace {

TEST_F(Fw, AFaultReactionIsNamedFromItsBeginning) {
  Set(AXIS_OBJ_FAULT_REACTION_OPTION, 1);
  Set(AXIS_OBJ_POSITION_GAIN, 5 * 256);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_MODES_OF_OPERATION, AXIS_MODES_OF_OPERATION_PROFILE_VELOCITY),
            0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_TARGET_VELOCITY, 3000), 0u);
  double place = 0;
  const auto move = [&](int ticks) {
    for (int i = 0; i < ticks; ++i) {
      inputs_.encoder_cnt = static_cast<int32_t>(place);
      Tick();
      if (outputs_.amp_enable != 0) place += 0.02 * outputs_.dac_code;
    }
  };
  move(500);
  Emergencies();
  // A fault that the drive detects: the axis is held while the demand moves away.
  Set(AXIS_OBJ_FOLLOWING_ERROR_WINDOW, 20);
  Set(AXIS_OBJ_FOLLOWING_ERROR_TIMEOUT, 0);
  int waited = 0;
  while (Inner(AXIS_OBJ_DRIVE_STATE) == AXIS_DRIVE_STATE_OPERATION_ENABLED && waited < 2000) {
    Tick();
    ++waited;
  }
  ASSERT_EQ(Inner(AXIS_OBJ_DRIVE_STATE), AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE);
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_NONE) << "latched at the end";
  EXPECT_EQ(Inner(AXIS_OBJ_ERROR_CODE), 0x8611);
  EXPECT_EQ(Emergencies(), std::vector<int>{0x8611 | AXIS_FAULT_FOLLOWING_ERROR << 16});
  for (int i = 0; i < 2000 && !IsOff(); ++i) Tick();
  EXPECT_TRUE(IsOff());
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_FOLLOWING_ERROR);
  EXPECT_TRUE(Emergencies().empty()) << "once";
}

TEST_F(Fw, AnExpiredCalibrationIsReportedOnce) {
  const auto put = [this](uint16_t object, int32_t value) {
    ASSERT_EQ(Write(kCanopen, object, value), 0u);
    Tick();
    Take();
  };
  put(AXIS_OBJ_CALIBRATION_DATE, 15000);
  put(AXIS_OBJ_CALIBRATION_VALIDITY, 365);
  put(AXIS_OBJ_DATE, 15365);
  EXPECT_TRUE(Emergencies().empty());
  put(AXIS_OBJ_DATE, 15366);
  Tick(100);
  EXPECT_EQ(Emergencies(), std::vector<int>{0xFF1C});
  EXPECT_EQ(Inner(AXIS_OBJ_STATUSWORD) & 0x80, 0x80);
  EXPECT_EQ(Inner(AXIS_OBJ_ERROR_REGISTER), 0) << "a warning";
  put(AXIS_OBJ_CALIBRATION_DATE, 15366);
  EXPECT_TRUE(Emergencies().empty());
  EXPECT_EQ(Inner(AXIS_OBJ_STATUSWORD) & 0x80, 0);
}

TEST_F(Fw, ATareIsTakenOverTheBusAndRefusedWithItsCode) {
  inputs_.adc_code[0] = 12;
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_TARE, 1), 0u);
  Tick(256);
  EXPECT_EQ(Inner(AXIS_OBJ_TARE_STATE), AXIS_TARE_STATE_DONE);
  EXPECT_EQ(Inner(AXIS_OBJ_FORCE_TARE), 12 * 256);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_TARE_BAND, 20 * 256), 0u);
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_FORCE_TARE, 21 * 256), 0x06090030u);
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_CALIBRATE, 1), 0x06090030u);
  EXPECT_EQ(Inner(AXIS_OBJ_CALIBRATION_STATE), AXIS_CALIBRATION_STATE_REFUSED_POINTS);
  Drive();
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_TARE, 1), 0x08000022u);
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_FORCE_TARE, 0), 0x08000022u);
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_CALIBRATE, 1), 0x08000022u);
}

// Found in the tick before the one that enables: the law begins with the tare that was in force.
TEST_F(Fw, ATareDoesNotComeIntoForceInTheTickThatEnables) {
  inputs_.adc_code[0] = 12;
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
  Set(AXIS_OBJ_TARE_AVERAGING, 4);  // 16 readings
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_TARE, 1), 0u);
  Tick(15);
  fw_prepare(&fw_);
  fw_control(&fw_, &inputs_, &outputs_);
  (void)fw_report(&fw_);  // the last reading; before fw_between() a frame enables the axis
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
  fw_between(&fw_);
  Tick(3);
  EXPECT_EQ(outputs_.amp_enable, 1);
  EXPECT_EQ(Inner(AXIS_OBJ_FORCE_TARE), 0);
  EXPECT_EQ(Inner(AXIS_OBJ_TARE_STATE), AXIS_TARE_STATE_REFUSED_ENABLED);
}

// A law without a certificate is named whenever a mode that it restricts is enabled.
TEST_F(Fw, ALawWithoutACertificateIsReportedAtEnabling) {
  for (const bool required : {true, false}) {
    Set(AXIS_OBJ_CERTIFICATE_REQUIRED, required ? 1 : 0);
    for (int i = 0; i < 2; ++i) {
      for (const int mode : {AXIS_MODES_OF_OPERATION_FORCE, AXIS_MODES_OF_OPERATION_FORCE_COUNTS}) {
        ASSERT_EQ(Write(kCanopen, AXIS_OBJ_MODES_OF_OPERATION, mode), 0u);
        Set(AXIS_OBJ_POSITION_GAIN, 5 * 256);
        ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
        ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
        Tick(50);
        EXPECT_EQ(CountEmergencies(0xFF13), required ? 1 : 0) << mode;
        ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x00), 0u);
        Tick(50);
      }
    }
  }
}

TEST_F(Fw, ALostContactIsReportedWhileForceIsControlled) {
  inputs_.adc_code[0] = 30;
  Tick(2);
  inputs_.adc_code[0] = 0;
  Tick(2);
  EXPECT_EQ(CountEmergencies(0xFF01), 0) << "nobody controls force";
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_MODES_OF_OPERATION, AXIS_MODES_OF_OPERATION_FORCE_COUNTS), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
  inputs_.adc_code[0] = 30;
  Tick(3);
  EXPECT_EQ(CountEmergencies(0xFF01), 0);
  inputs_.adc_code[0] = 0;
  Tick();
  EXPECT_EQ(Emergencies(), std::vector<int>{0xFF01});
  // Again and again: once a second, and the limit cycle.
  for (int i = 0; i < 1480; ++i) {
    inputs_.adc_code[0] = (i & 1) != 0 ? 0 : 30;
    Tick();
    Take();
  }
  EXPECT_EQ(Emergencies(), std::vector<int>{0xFF03});
  for (int i = 0; i < 1500; ++i) {
    inputs_.adc_code[0] = (i & 1) != 0 ? 0 : 30;
    Tick();
    Take();
  }
  EXPECT_EQ(Emergencies(), std::vector<int>{0xFF01});
  EXPECT_EQ(Inner(AXIS_OBJ_CONTACT_LOSSES), 1 + 740 + 750);
  EXPECT_EQ(Inner(AXIS_OBJ_ERROR_REGISTER), 0) << "nothing of it lasts";
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
}

TEST_F(Fw, EachHalvingOfTheGainIsReportedAndThenTheFault) {
  Set(AXIS_OBJ_CONTACT_UNSTABLE_OPTION, AXIS_CONTACT_UNSTABLE_OPTION_HALVE_GAIN);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_MODES_OF_OPERATION, AXIS_MODES_OF_OPERATION_FORCE_COUNTS), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
  std::vector<int> reported;
  for (int i = 0; i < 4 * 1530; ++i) {
    inputs_.adc_code[0] = (i & 1) != 0 ? 0 : 30;
    Tick();
    for (const int emergency : Emergencies()) {
      if ((emergency & 0xFFFF) >= 0xFF14) reported.push_back(emergency);
    }
  }
  EXPECT_EQ(reported, (std::vector<int>{0xFF17 | 1 << 16, 0xFF17 | 2 << 16, 0xFF17 | 3 << 16,
                                        0xFF16 | AXIS_FAULT_CONTACT_UNSTABLE << 16}));
}

TEST_F(Fw, ASaturatedSensorIsReported) {
  inputs_.adc_code[0] = 254;
  Tick(3);
  EXPECT_EQ(CountEmergencies(0xFF02), 0);
  inputs_.adc_code[0] = 255;
  Tick();
  EXPECT_EQ(CountEmergencies(0xFF02), 1);
  Tick(3000);
  EXPECT_EQ(CountEmergencies(0xFF02), 0) << "the edge, not the state";
  inputs_.adc_code[0] = 254;
  Tick();
  inputs_.adc_code[0] = 255;
  Tick();
  EXPECT_EQ(CountEmergencies(0xFF02), 1);
}

TEST_F(Fw, OverrunsAreReportedOnceASecond) {
  for (int i = 0; i < 3000; ++i) {
    fw_overrun(&fw_, 0);
    Tick();
    Take();
  }
  EXPECT_EQ(CountEmergencies(0xFF04), 2);
  EXPECT_EQ(Inner(AXIS_OBJ_OVERRUNS), 3000);
  EXPECT_EQ(Inner(AXIS_OBJ_ERROR_HISTORY_COUNT), 2);
}

// A repeated emergency is inhibited for 1500 ticks, a second, from the one sent: 1499 ticks later
// it still is.
TEST_F(Fw, AnEmergencyIsHeldForASecondToTheTick) {
  std::vector<int> given;
  for (int i = 0; i < 4600; ++i) {
    fw_overrun(&fw_, 0);
    Tick();
    if (CountEmergencies(0xFF04) != 0) given.push_back(i);
  }
  EXPECT_EQ(given, (std::vector<int>{0, 1500, 3000, 4500}));
  PowerUp();
  for (const int wait : {1499, 1500}) {
    PowerUp();
    fw_overrun(&fw_, 0);
    Tick();
    EXPECT_EQ(CountEmergencies(0xFF04), 1);
    Tick(wait - 1);
    fw_overrun(&fw_, 0);
    Tick();
    EXPECT_EQ(CountEmergencies(0xFF04), wait == 1500 ? 1 : 0) << wait;
  }
}

// Each code has its own second.
TEST_F(Fw, OneHeldEmergencyDoesNotHoldAnother) {
  fw_overrun(&fw_, 0);
  inputs_.adc_code[0] = 255;
  Tick();
  EXPECT_EQ(Emergencies(), (std::vector<int>{0xFF04, 0xFF02}));
}

// A reset of the node restores power-up values: what happens then is reported, however recently it
// was reported before.
TEST_F(Fw, AResetOfTheNodeReportsAnew) {
  inputs_.adc_code[0] = 255;
  fw_overrun(&fw_, 0);
  Tick(2);
  EXPECT_EQ(Emergencies(), (std::vector<int>{0xFF04, 0xFF02}));
  inputs_.adc_code[0] = 0;
  Tick(2);
  Send(0, {129, kNode});
  Tick(3);
  ASSERT_EQ(Inner(AXIS_OBJ_NMT_STATE), AXIS_NMT_STATE_PRE_OPERATIONAL);
  Emergencies();
  inputs_.adc_code[0] = 255;
  fw_overrun(&fw_, 0);
  Tick(2);
  EXPECT_EQ(Emergencies(), (std::vector<int>{0xFF04, 0xFF02}));
}

// A set exists, but the meaning of its values is unknown: the axis runs on defaults.
TEST_F(Fw, AStoreThatCannotBeLoadedIsReportedAtPowerUp) {
  Flash flash;
  PowerUp(flash.memory());
  Tick();
  EXPECT_EQ(CountEmergencies(0x5530), 0);
  PutOldSet(flash.bytes(), 0, 0x12345678, 1, {0x200A00, 1234});
  PowerUp(flash.memory());
  Tick();
  ASSERT_EQ(Inner(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_OTHER_TABLE);
  EXPECT_EQ(CountEmergencies(0x5530), 1);
  Send(0, {129, kNode});
  Tick(2);
  EXPECT_EQ(CountEmergencies(0x5530), 1) << "also after a reset";
}

// The emergency names the first parameter that is not as stored, and their number.
TEST_F(Fw, AStoreThatIsLoadedPartlyNamesWhatIsNot) {
  Flash flash;
  Entry bits = EntryOf(AXIS_OBJ_ADC_BITS, 10);
  bits.first |= 1u << 24;  // a default then, another one today
  PutSet(flash.bytes(), 0, ~AXIS_OBJECTS_HASH32, 1, {{0x609902, 7, 0}, bits});
  PowerUp(flash.memory());
  Tick();
  EXPECT_EQ(
      Take(0x80 + kNode),
      (std::vector<Frame>{
          {0x80 + kNode, {0x30, 0x55, 1, AXIS_STORE_STATE_LOADED_PARTLY, 0x99, 0x60, 2, 2}}}));
  Flash other;
  PutSet(other.bytes(), 0, ~AXIS_OBJECTS_HASH32, 1, {bits});
  PowerUp(other.memory());
  Tick();
  EXPECT_EQ(Take(0x80 + kNode),
            (std::vector<Frame>{
                {0x80 + kNode,
                 {0x30, 0x55, 1, AXIS_STORE_STATE_LOADED_OLD_DEFAULTS, 0x0F, 0x20, 0, 1}}}));
}

// Without a memory a save is refused in every state, with each bus's own code for that.
TEST_F(Fw, WithoutAMemoryEveryBusRefusesASave) {
  for (const Way way : kWays) {
    ASSERT_TRUE(Acquires(way));
    const uint32_t refusal = way == kRtu ? 4u : 0x06060000u;
    EXPECT_EQ(Write(way, AXIS_OBJ_STORE_PARAMETERS, 1), refusal) << way;
    EXPECT_EQ(Write(way, AXIS_OBJ_RESTORE_DEFAULTS, 1), refusal) << way;
    ASSERT_EQ(Write(way, AXIS_OBJ_COMMAND_SOURCE, AXIS_COMMAND_SOURCE_CANOPEN), 0u);
  }
  EXPECT_EQ(Download(kCanopen, 0x1010, 1, 0x65766173, 4), 0x06060000u);
}

TEST_F(Fw, AResetByTheWatchdogIsReportedOnce) {
  fw_config_t config = NodeConfig();
  config.reset_cause = AXIS_RESET_CAUSE_WATCHDOG;
  fw_init(&fw_, &config);
  Tick();
  EXPECT_EQ(CountEmergencies(0xFF07), 1);
  EXPECT_EQ(Inner(AXIS_OBJ_ERROR_CODE), 0) << "it is no fault";
  Send(0, {129, kNode});
  Tick(3);
  EXPECT_EQ(CountEmergencies(0xFF07), 0) << "the chip was not reset again";
}

// Each cause of a reset but supply and pin is told; a brown-out where the supply was not off.
TEST_F(Fw, EveryResetThatNobodyAskedForIsReported) {
  const struct {
    int cause;
    int code;
  } cases[] = {
      {AXIS_RESET_CAUSE_POWER | AXIS_RESET_CAUSE_BROWN_OUT | AXIS_RESET_CAUSE_PIN, 0},
      {AXIS_RESET_CAUSE_PIN, 0},
      {AXIS_RESET_CAUSE_BROWN_OUT | AXIS_RESET_CAUSE_PIN, 0x5110},
      {AXIS_RESET_CAUSE_SOFTWARE | AXIS_RESET_CAUSE_PIN, 0x6000},
      {AXIS_RESET_CAUSE_LOW_POWER, 0x6000},
      {AXIS_RESET_CAUSE_WATCHDOG | AXIS_RESET_CAUSE_PIN, 0xFF07},
      {AXIS_RESET_CAUSE_WINDOW, 0xFF07},
  };
  for (const auto &c : cases) {
    fw_config_t config = NodeConfig();
    config.reset_cause = static_cast<uint8_t>(c.cause);
    fw_init(&fw_, &config);
    Tick();
    const std::vector<int> sent = Emergencies();
    ASSERT_EQ(sent.size(), c.code == 0 ? 0u : 1u) << c.cause;
    EXPECT_TRUE(sent.empty() || (sent[0] & 0xFFFF) == c.code) << c.cause;
    EXPECT_EQ(Inner(AXIS_OBJ_RESET_CAUSE), c.cause);
  }
}

// Found in a tick, off in it; as long as it is found no reset of the fault helps.
TEST_F(Fw, WhatTheBoardFindsDisablesTheAxisInThatTick) {
  const struct {
    int state;
    int fault;
  } cases[] = {
      {AXIS_BOARD_STATE_CLOCK_INTERNAL, AXIS_FAULT_NONE},
      {AXIS_BOARD_STATE_TICK_UNKNOWN | AXIS_BOARD_STATE_CLOCK_INTERNAL, AXIS_FAULT_NONE},
      {AXIS_BOARD_STATE_OPTION_BYTES, AXIS_FAULT_BOARD_UNFIT},
      {AXIS_BOARD_STATE_IMAGE | AXIS_BOARD_STATE_TICK_UNKNOWN, AXIS_FAULT_BOARD_UNFIT},
      {AXIS_BOARD_STATE_RAM, AXIS_FAULT_BOARD_UNFIT},
      {AXIS_BOARD_STATE_SUPPLY | AXIS_BOARD_STATE_TICK_UNKNOWN, AXIS_FAULT_SUPPLY_WRONG},
      {AXIS_BOARD_STATE_REFERENCE, AXIS_FAULT_SUPPLY_WRONG},
      {AXIS_BOARD_STATE_TICK, AXIS_FAULT_CLOCK_WRONG},
      {AXIS_BOARD_STATE_DAC, AXIS_FAULT_OUTPUT_WRONG},
      {AXIS_BOARD_STATE_ENABLE, AXIS_FAULT_OUTPUT_WRONG},
  };
  for (const auto &c : cases) {
    fw_config_t config = NodeConfig();
    fw_init(&fw_, &config);
    const axis_inputs_t inputs{0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
    axis_outputs_t outputs{};
    ASSERT_EQ(fw_object_write(&fw_, FW_SOURCE_LOCAL, AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP), 0);
    fw_tick(&fw_, &inputs, &outputs);
    ASSERT_EQ(outputs.amp_enable, 1);
    for (int again = 0; again < 2; ++again) {
      fw_prepare(&fw_);
      fw_board(&fw_, static_cast<uint16_t>(c.state), -7);
      fw_control(&fw_, &inputs, &outputs);
      (void)fw_report(&fw_);
      fw_between(&fw_);
      EXPECT_EQ(outputs.amp_enable, c.fault == AXIS_FAULT_NONE ? 1 : 0) << c.state;
      EXPECT_EQ(Inner(AXIS_OBJ_FAULT), c.fault) << c.state;
      EXPECT_EQ(Inner(AXIS_OBJ_BOARD_STATE), c.state);
      EXPECT_EQ(Inner(AXIS_OBJ_TICK_DEVIATION), -7);
      (void)fw_object_write(&fw_, FW_SOURCE_LOCAL, AXIS_OBJ_FAULT_RESET, 1);
    }
  }
}

}  // namespace
