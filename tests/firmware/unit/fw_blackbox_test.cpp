// The black box: what it keeps of an error, who may have its buffer, and what outlives a restart.

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "tests/firmware/unit/bus_fixture.hpp"

namespace {

// Place of each signal in a sample.
enum { kPosition, kProfile, kForceRaw, kDemand, kDac, kStatusword, kReason, kInputs };

class BlackBox : public BusFixture {
 protected:
  BlackBox() { PowerUp(); }

  void PowerUp(bool watchdog_fired = false) {
    PowerUpAfter(watchdog_fired ? AXIS_RESET_CAUSE_WATCHDOG : 0, nullptr);
  }

  void PowerUpAfter(int reset_cause, const fw_core_fault_t *core_fault) {
    fw_config_t config = NodeConfig();
    config.blackbox = &blackbox_;
    config.reset_cause = static_cast<uint8_t>(reset_cause);
    config.core_fault = core_fault;
    fw_init(&fw_, &config);
    Tick();
  }

  void Enable() {
    Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
    Tick(2);
    ASSERT_EQ(outputs_.amp_enable, 1);
  }

  // Ticks of an encoder that counts them, then the enable chain opens.
  void MoveAndFail(int ticks) {
    for (int i = 0; i < ticks; ++i) {
      ++inputs_.encoder_cnt;
      Tick();
    }
    inputs_.din = 0;
    Tick();
  }

  void Complete() { Tick(BLACKBOX_AFTER + 32768 / 16); }

  int State() { return Read(AXIS_OBJ_BLACKBOX_STATE); }

  std::vector<std::int32_t> Sample(uint32_t index) {
    std::vector<std::int32_t> values(RECORDER_CHANNELS);
    EXPECT_EQ(fw_recorder_read(&fw_, index, values.data()), RECORDER_CHANNELS);
    return values;
  }

  blackbox_t blackbox_{};
};

TEST_F(BlackBox, KeepsTheSecondBeforeAnErrorAndWhatFollows) {
  ASSERT_EQ(State(), AXIS_BLACKBOX_STATE_RECORDING);
  Enable();
  inputs_.adc_code[0] = 7;
  MoveAndFail(2000);
  const auto tick = static_cast<uint32_t>(Read(AXIS_OBJ_TICK_COUNT));
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_ENABLE_LOST);
  Complete();
  ASSERT_EQ(State(), AXIS_BLACKBOX_STATE_INCIDENT);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_FAULT), AXIS_FAULT_ENABLE_LOST);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_ERROR_CODE), AXIS_ERROR_CODE_ENABLE_LOST);
  EXPECT_EQ(static_cast<uint32_t>(Read(AXIS_OBJ_INCIDENT_TICK)), tick);
  Set(AXIS_OBJ_INCIDENT_COMMAND, AXIS_INCIDENT_COMMAND_FETCH);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_STATE), AXIS_RECORDER_STATE_DONE);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_COUNT), BLACKBOX_SAMPLES);
  ASSERT_EQ(Read(AXIS_OBJ_RECORDER_TRIGGER_INDEX), BLACKBOX_BEFORE);
  for (const uint32_t i : {0u, 700u, 1499u}) {
    EXPECT_EQ(Sample(i)[kPosition], 501 + static_cast<int>(i));
    EXPECT_EQ(Sample(i)[kForceRaw], 7);
    EXPECT_EQ(Sample(i)[kInputs] & AXIS_DIGITAL_INPUTS_ENABLE, AXIS_DIGITAL_INPUTS_ENABLE);
    EXPECT_EQ(Sample(i)[kStatusword] & 8, 0);
  }
  for (const uint32_t i : {1500u, 1529u}) {
    EXPECT_EQ(Sample(i)[kPosition], 2000);
    EXPECT_EQ(Sample(i)[kInputs], 0);
    EXPECT_EQ(Sample(i)[kDac], 0);
    EXPECT_EQ(Sample(i)[kStatusword] & 8, 8);
  }
}

TEST_F(BlackBox, TheFirstErrorStaysAndLaterOnesAreCounted) {
  Enable();
  MoveAndFail(1600);
  Complete();
  for (int i = 0; i < 2; ++i) {
    inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
    Set(AXIS_OBJ_FAULT_RESET, 1);
    Tick(2);
    inputs_.sensor_valid = 0;
    Tick();
    inputs_.sensor_valid = 1;
    Tick();
  }
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_SENSOR_INVALID);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_FAULT), AXIS_FAULT_ENABLE_LOST);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_LATER), 2);
  Set(AXIS_OBJ_INCIDENT_COMMAND, AXIS_INCIDENT_COMMAND_CLEAR);
  Tick();
  EXPECT_EQ(State(), AXIS_BLACKBOX_STATE_RECORDING);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_FAULT), AXIS_FAULT_NONE);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_LATER), 0);
}

TEST_F(BlackBox, AnErrorOfAnAxisThatIsNotEnabledIsNoIncident) {
  Tick(2000);
  inputs_.sensor_valid = 0;
  Tick();
  inputs_.sensor_valid = 1;
  Complete();
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_SENSOR_INVALID);
  EXPECT_EQ(State(), AXIS_BLACKBOX_STATE_RECORDING);
  EXPECT_EQ(Write(AXIS_OBJ_INCIDENT_COMMAND, AXIS_INCIDENT_COMMAND_FETCH), FW_ERROR_NO_DATA);
}

TEST_F(BlackBox, ARecordingHasTheBufferUntilItIsStopped) {
  Set(AXIS_OBJ_RECORDER_SIGNAL_1, 0x202300);
  Set(AXIS_OBJ_RECORDER_LENGTH, 10);
  Set(AXIS_OBJ_RECORDER_ARM, 1);
  Enable();
  MoveAndFail(100);
  Complete();
  EXPECT_EQ(State(), AXIS_BLACKBOX_STATE_RECORDER);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_COUNT), 10);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_FAULT), AXIS_FAULT_NONE);
  Set(AXIS_OBJ_RECORDER_ARM, 0);
  Tick();
  EXPECT_EQ(State(), AXIS_BLACKBOX_STATE_RECORDING);
}

TEST_F(BlackBox, ARefusedRecordingEndsNoIncident) {
  Enable();
  MoveAndFail(1600);
  Complete();
  EXPECT_EQ(Write(AXIS_OBJ_RECORDER_ARM, 1), FW_ERROR_RANGE);  // no signal is chosen
  Tick();
  EXPECT_EQ(State(), AXIS_BLACKBOX_STATE_INCIDENT);
}

TEST_F(BlackBox, OffItKeepsNothing) {
  Set(AXIS_OBJ_BLACKBOX_OPTION, AXIS_BLACKBOX_OPTION_OFF);
  Enable();
  MoveAndFail(1600);
  Complete();
  EXPECT_EQ(State(), AXIS_BLACKBOX_STATE_OFF);
}

TEST_F(BlackBox, AnIncidentOutlivesARestart) {
  Enable();
  MoveAndFail(1600);
  Complete();
  const int32_t crc = Read(AXIS_OBJ_INCIDENT_CRC);
  const int32_t tick = Read(AXIS_OBJ_INCIDENT_TICK);
  PowerUp();
  Complete();
  ASSERT_EQ(State(), AXIS_BLACKBOX_STATE_INCIDENT_KEPT);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_FAULT), AXIS_FAULT_ENABLE_LOST);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_TICK), tick);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_CRC), crc);
}

TEST_F(BlackBox, AMainLoopThatHangsIsAnIncidentAfterTheReset) {
  Enable();
  Tick(1600);
  for (int i = 0; i < 30; ++i) {  // until the watchdog resets the chip
    fw_prepare(&fw_);
    fw_control(&fw_, &inputs_, &outputs_);
    (void)fw_report(&fw_);
  }
  PowerUp(true);
  Complete();
  ASSERT_EQ(State(), AXIS_BLACKBOX_STATE_INCIDENT_KEPT);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_FAULT), AXIS_FAULT_MAIN_LOOP_LOST);
  Set(AXIS_OBJ_INCIDENT_COMMAND, AXIS_INCIDENT_COMMAND_FETCH);
  const auto at = static_cast<uint32_t>(Read(AXIS_OBJ_RECORDER_TRIGGER_INDEX));
  EXPECT_EQ(Sample(at - 1)[kStatusword] & 8, 0);
  EXPECT_EQ(Sample(at)[kStatusword] & 8, 8);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_COUNT), BLACKBOX_BEFORE + 15);
}

TEST_F(BlackBox, ATickThatHangsIsAnIncidentAfterTheReset) {
  Enable();
  inputs_.encoder_cnt = 33;
  Tick(700);
  const int32_t tick = Read(AXIS_OBJ_TICK_COUNT);
  PowerUp(true);
  Complete();
  ASSERT_EQ(State(), AXIS_BLACKBOX_STATE_INCIDENT_KEPT);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_FAULT), AXIS_FAULT_NONE);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_ERROR_CODE), AXIS_ERROR_CODE_WATCHDOG_RESET);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_TICK), tick);
  Set(AXIS_OBJ_INCIDENT_COMMAND, AXIS_INCIDENT_COMMAND_FETCH);
  const auto last = static_cast<uint32_t>(Read(AXIS_OBJ_RECORDER_TRIGGER_INDEX));
  EXPECT_EQ(last + 1, static_cast<uint32_t>(Read(AXIS_OBJ_RECORDER_COUNT)));
  EXPECT_EQ(Sample(last)[kPosition], 33);
}

TEST_F(BlackBox, AFaultOfTheCoreIsAnIncidentWithItsWords) {
  Enable();
  Tick(700);
  const fw_core_fault_t words{0x0800C123, 0x0800D001, 0x00008200, 0x40000000, 0x20030000};
  PowerUpAfter(AXIS_RESET_CAUSE_SOFTWARE | AXIS_RESET_CAUSE_PIN, &words);
  Complete();
  ASSERT_EQ(State(), AXIS_BLACKBOX_STATE_INCIDENT_KEPT);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_ERROR_CODE), AXIS_ERROR_CODE_CORE_FAULT);
  EXPECT_EQ(Read(AXIS_OBJ_RESET_CAUSE), 16 + 4);
  EXPECT_EQ(static_cast<uint32_t>(Read(AXIS_OBJ_CORE_FAULT_PC)), words.pc);
  EXPECT_EQ(static_cast<uint32_t>(Read(AXIS_OBJ_CORE_FAULT_LR)), words.lr);
  EXPECT_EQ(static_cast<uint32_t>(Read(AXIS_OBJ_CORE_FAULT_CFSR)), words.cfsr);
  EXPECT_EQ(static_cast<uint32_t>(Read(AXIS_OBJ_CORE_FAULT_HFSR)), words.hfsr);
  EXPECT_EQ(static_cast<uint32_t>(Read(AXIS_OBJ_CORE_FAULT_BFAR)), words.bfar);
}

TEST_F(BlackBox, ABrownOutKeepsNothingOfAMemoryThatItMayHaveSpoilt) {
  Enable();
  Tick(700);
  PowerUpAfter(AXIS_RESET_CAUSE_BROWN_OUT | AXIS_RESET_CAUSE_PIN, nullptr);
  Complete();
  EXPECT_EQ(State(), AXIS_BLACKBOX_STATE_RECORDING);
}

TEST_F(BlackBox, ARestartWithoutAnErrorKeepsNothing) {
  Enable();
  Tick(1600);
  PowerUp();
  Complete();
  EXPECT_EQ(State(), AXIS_BLACKBOX_STATE_RECORDING);
}

TEST_F(BlackBox, WhatPowerUpLeavesInMemoryIsNoIncident) {
  for (const int byte : {0x00, 0x55, 0xFF}) {
    auto *bytes = reinterpret_cast<uint8_t *>(&blackbox_);
    for (std::size_t i = 0; i < sizeof(blackbox_); ++i) bytes[i] = static_cast<uint8_t>(byte);
    PowerUp(true);
    Complete();
    EXPECT_EQ(State(), AXIS_BLACKBOX_STATE_RECORDING) << byte;
  }
}

TEST_F(BlackBox, ABufferThatIsTooSmallKeepsNothing) {
  fw_config_t config = NodeConfig();
  config.blackbox = &blackbox_;
  config.recorder_bytes = 18 * BLACKBOX_AFTER;
  fw_init(&fw_, &config);
  Enable();
  MoveAndFail(100);
  EXPECT_EQ(State(), AXIS_BLACKBOX_STATE_OFF);
}

}  // namespace
