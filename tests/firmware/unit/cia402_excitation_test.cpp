// Excitation inside a closed force mode: what is added, when it ends, what is recorded of it.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <vector>

#include "tests/firmware/unit/cia402_fixture.hpp"

namespace {

constexpr int kCounts = -1, kForce = 4, kCyclic = 10;

// The noise of a seed, typed from Knuth's generator: Q15 of its upper half.
std::vector<int> Noise(uint32_t seed, int count) {
  std::vector<int> values;
  uint32_t state = seed * 2654435769U;
  for (int i = 0; i < count; ++i) {
    state = state * 1664525U + 1013904223U;
    values.push_back(static_cast<int>(static_cast<int64_t>(state) / 65536) -
                     ((state & 0x80000000U) ? 65536 : 0));
  }
  return values;
}

int FloorOf(double x) { return static_cast<int>(std::floor(x)); }

// A drive that presses; from then on each tick gets its reading and position from the test.
class Excited : public DriveFixture {
 protected:
  static constexpr int kReading = 30, kPlace = 500;

  void Press(int mode, int ramp_ms = 0) {
    PowerUp();
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    Set(AXIS_OBJ_RATED_FORCE, 100000);
    Set(AXIS_OBJ_FORCE_SLOPE, 1000000);
    Set(AXIS_OBJ_EXCITATION_CODE, 40);
    Set(AXIS_OBJ_EXCITATION_RAMP, ramp_ms);
    Set(AXIS_OBJ_EXCITATION_SEED, 7);
    Set(AXIS_OBJ_FORCE_SETPOINT, 32 * 256);
    inputs_.adc_code[0] = 0;
    inputs_.encoder_cnt = kPlace;
    Set(AXIS_OBJ_MODES_OF_OPERATION, mode);
    Give(kReading);
    for (const int word : {0x06, 0x07, 0x0F}) Control(word);
    Give(kReading);
    Set(AXIS_OBJ_TARGET_FORCE, 800);  // 32 counts of 2.5 N
    for (int i = 0; i < 20; ++i) Give(kReading);
    ASSERT_EQ(Read(AXIS_OBJ_ACTIVE_MODE), AXIS_MODE_FORCE);
  }

  // A tick with these inputs; returns its command code.
  int Give(int reading, int place = kPlace) {
    inputs_.adc_code[0] = static_cast<uint16_t>(reading);
    inputs_.encoder_cnt = place;
    fw_tick(&fw_, &inputs_, &outputs_);
    return Read(AXIS_OBJ_COMMAND_CODE);
  }

  void Start() { Set(AXIS_OBJ_EXCITATION_RUN, AXIS_EXCITATION_RUN_START); }
  void Stop() { Set(AXIS_OBJ_EXCITATION_RUN, AXIS_EXCITATION_RUN_STOP); }
  int Value() const { return Read(AXIS_OBJ_EXCITATION_VALUE); }
  int Doing() const { return Read(AXIS_OBJ_EXCITATION_STATE); }
  bool IsActive() const { return Doing() >= AXIS_EXCITATION_STATE_RAMPING_DOWN; }

  // The code of the law itself, gain 5, at 32 counts.
  static int Law(int reading) { return 5 * (32 - reading); }

  void ExpectEnded(int state, int code) {
    EXPECT_EQ(Doing(), state);
    EXPECT_EQ(Value(), 0);
    EXPECT_EQ(Read(AXIS_OBJ_COMMAND_CODE), code);
    EXPECT_EQ(fw_.axis.excitation_q16, 0);
  }
};

TEST_F(Excited, TheNoiseIsAddedAtTheOutputFromItsFirstValueOn) {
  for (const int mode : {kCounts, kForce, kCyclic}) {
    SCOPED_TRACE(mode);
    Press(mode);
    EXPECT_EQ(Give(kReading), Law(kReading));
    Start();
    EXPECT_EQ(Doing(), AXIS_EXCITATION_STATE_RAMPING_UP);
    for (const int wave : Noise(7, 200)) {
      const int value = FloorOf(40.0 * 256 * wave / 32768);
      EXPECT_EQ(Give(kReading), FloorOf(Law(kReading) + value / 256.0 + 0.5));
      EXPECT_EQ(Value(), value);
      ASSERT_EQ(Doing(), AXIS_EXCITATION_STATE_RUNNING);
    }
    Stop();
    EXPECT_EQ(Give(kReading), Law(kReading));
    EXPECT_EQ(Doing(), AXIS_EXCITATION_STATE_DONE);
  }
}

TEST_F(Excited, AtTheSetPointItIsMultipliedByTheGainAndTheUserSeesHisOwn) {
  for (const int mode : {kCounts, kForce}) {
    SCOPED_TRACE(mode);
    Press(mode);
    Set(AXIS_OBJ_EXCITATION_POINT, AXIS_EXCITATION_POINT_SETPOINT);
    Set(AXIS_OBJ_EXCITATION_FORCE, 4 * 256);
    Start();
    for (const int wave : Noise(7, 100)) {
      const int value = FloorOf(4.0 * 256 * wave / 32768);
      EXPECT_EQ(Give(kReading), FloorOf(Law(kReading) + 5 * value / 256.0 + 0.5));
      EXPECT_EQ(Value(), value);
      EXPECT_EQ(Read(AXIS_OBJ_FORCE_SETPOINT), 32 * 256);
      EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), 800);
    }
  }
}

TEST_F(Excited, WithAmplitudeZeroEveryCodeIsThatOfTheLaw) {
  Press(kForce);
  Set(AXIS_OBJ_EXCITATION_CODE, 0);
  Start();
  for (int reading = 20; reading < 60; ++reading) EXPECT_EQ(Give(reading), Law(reading));
  EXPECT_EQ(Doing(), AXIS_EXCITATION_STATE_RUNNING);
}

// Level and product are each rounded down to 1/256 code: the two differ by less than 2.
TEST_F(Excited, TheAmplitudeIsRampedUpAndDown) {
  constexpr int kTicks = 150;  // 100 ms
  Press(kCounts, 100);
  Start();
  const std::vector<int> noise = Noise(7, 3 * kTicks);
  for (int i = 0; i < kTicks; ++i) {
    EXPECT_EQ(Doing(), AXIS_EXCITATION_STATE_RAMPING_UP);
    Give(kReading);
    EXPECT_NEAR(Value(), 40.0 * 256 * noise[i] / 32768 * (i + 1) / kTicks, 2.0) << i;
  }
  Give(kReading);
  EXPECT_EQ(Doing(), AXIS_EXCITATION_STATE_RUNNING);
  EXPECT_EQ(Value(), FloorOf(40.0 * 256 * noise[kTicks] / 32768));
  Stop();
  for (int i = 1; i < kTicks; ++i) {
    EXPECT_EQ(Doing(), AXIS_EXCITATION_STATE_RAMPING_DOWN);
    Give(kReading);
    const double level = static_cast<double>(kTicks - i) / kTicks;
    EXPECT_NEAR(Value(), 40.0 * 256 * noise[kTicks + i] / 32768 * level, 2.0) << i;
  }
  Give(kReading);
  Give(kReading);
  ExpectEnded(AXIS_EXCITATION_STATE_DONE, Law(kReading));
}

TEST_F(Excited, AStopDuringTheRampComesDownFromThere) {
  Press(kCounts, 100);
  Start();
  for (int i = 0; i < 30; ++i) Give(kReading);
  Stop();
  for (int i = 0; i < 28; ++i) {
    Give(kReading);
    ASSERT_EQ(Doing(), AXIS_EXCITATION_STATE_RAMPING_DOWN) << i;
  }
  for (int i = 0; i < 3; ++i) Give(kReading);
  EXPECT_EQ(Doing(), AXIS_EXCITATION_STATE_DONE);
}

// The largest bounds that a reading meets do not act; one more ends it before this tick's output.
TEST_F(Excited, ForceTravelAndLossOfContactEndItInTheirOwnTick) {
  struct Row {
    int state;
    int inside_reading, inside_place;
    int reading, place;
  };
  const std::array<Row, 5> rows{{
      {AXIS_EXCITATION_STATE_ENDED_FORCE, 36, kPlace, 37, kPlace},
      {AXIS_EXCITATION_STATE_ENDED_FORCE, 22, kPlace, 21, kPlace},
      {AXIS_EXCITATION_STATE_ENDED_TRAVEL, kReading, kPlace + 50, kReading, kPlace + 51},
      {AXIS_EXCITATION_STATE_ENDED_TRAVEL, kReading, kPlace - 50, kReading, kPlace - 51},
      {AXIS_EXCITATION_STATE_ENDED_CONTACT, 22, kPlace, 0, kPlace},
  }};
  for (const int point : {AXIS_EXCITATION_POINT_OUTPUT, AXIS_EXCITATION_POINT_SETPOINT}) {
    for (const Row &row : rows) {
      SCOPED_TRACE(::testing::Message() << "point " << point << " state " << row.state);
      Press(kCounts);
      Set(AXIS_OBJ_EXCITATION_POINT, point);
      Set(AXIS_OBJ_EXCITATION_FORCE, 4 * 256);
      Set(AXIS_OBJ_EXCITATION_FORCE_MAX, 36 * 256);
      Set(AXIS_OBJ_EXCITATION_FORCE_MIN,
          (row.state == AXIS_EXCITATION_STATE_ENDED_CONTACT) ? -256 : 22 * 256);
      Set(AXIS_OBJ_EXCITATION_TRAVEL, 50);
      Start();
      for (int i = 0; i < 50; ++i) {
        Give(row.inside_reading, row.inside_place);
        ASSERT_TRUE(IsActive());
      }
      EXPECT_NE(Value(), 0);
      const int code = Give(row.reading, row.place);
      ExpectEnded(row.state, Law(row.reading));
      EXPECT_EQ(code, Law(row.reading));
      // It does not come back by itself.
      EXPECT_EQ(Give(kReading), Law(kReading));
      EXPECT_EQ(Doing(), row.state);
    }
  }
}

TEST_F(Excited, TravelIsMeasuredAcrossTheWrapOfTheEncoder) {
  Press(kCounts);
  Set(AXIS_OBJ_EXCITATION_TRAVEL, 50);
  Give(kReading, INT32_MAX - 5);
  Start();
  for (int i = 0; i < 10; ++i) Give(kReading, INT32_MIN + 40);
  EXPECT_TRUE(IsActive());
  Give(kReading, INT32_MIN + 45);
  EXPECT_EQ(Doing(), AXIS_EXCITATION_STATE_ENDED_TRAVEL);
}

TEST_F(Excited, WhateverEndsTheModeEndsTheExcitation) {
  const std::array<std::function<void()>, 6> ends{{
      [this] { Control(0x07); },                           // disabled
      [this] { Control(0x02); },                           // quick stop
      [this] { Control(0x10F); },                          // halt
      [this] { Set(AXIS_OBJ_MODES_OF_OPERATION, 8); },     // another mode
      [this] { Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED); },  // by the port
      [this] { inputs_.sensor_valid = 0; },                // a fault
  }};
  for (std::size_t i = 0; i < ends.size(); ++i) {
    SCOPED_TRACE(i);
    Press(kForce);
    Start();
    for (int k = 0; k < 20; ++k) Give(kReading);
    ASSERT_TRUE(IsActive());
    ends[i]();
    Give(kReading);
    EXPECT_EQ(Doing(), AXIS_EXCITATION_STATE_ENDED_MODE);
    EXPECT_EQ(Value(), 0);
    EXPECT_EQ(fw_.axis.excitation_q16, 0);
    inputs_.sensor_valid = 1;
  }
}

TEST_F(Excited, ALostOwnerEndsItAlsoWhereTheAxisGoesOn) {
  Press(kForce);
  Set(AXIS_OBJ_ABORT_CONNECTION_OPTION, 0);
  Start();
  for (int i = 0; i < 20; ++i) Give(kReading);
  cia402_owner_lost(&fw_.drive, &fw_.axis, AXIS_FAULT_SOURCE_LOST);
  Give(kReading);
  ExpectEnded(AXIS_EXCITATION_STATE_ENDED_OWNER, Law(kReading));
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
}

TEST_F(Excited, AStartIsRefusedByNameOutOfContactAndInOtherModes) {
  const auto refused = [this](int state) {
    EXPECT_EQ(Write(AXIS_OBJ_EXCITATION_RUN, AXIS_EXCITATION_RUN_START), FW_ERROR_STATE);
    EXPECT_EQ(Doing(), state);
    Give(0);
    EXPECT_EQ(Value(), 0);
  };
  PowerUp();
  refused(AXIS_EXCITATION_STATE_REFUSED_MODE);
  for (const int mode : {1, 3, 8, 9, -2, -3, -4, -5, -6, -7, -8}) {
    PowerUp();
    Enable(mode);
    refused(AXIS_EXCITATION_STATE_REFUSED_MODE);
  }
  for (const int mode : {kCounts, kForce, kCyclic}) {
    PowerUp();
    Enable(mode);
    refused(AXIS_EXCITATION_STATE_REFUSED_CONTACT);
  }
  Press(kForce);
  Control(0x10F);
  refused(AXIS_EXCITATION_STATE_REFUSED_MODE);
  Press(kForce);
  Stop();
  EXPECT_EQ(Doing(), AXIS_EXCITATION_STATE_IDLE);
  Start();
  EXPECT_EQ(Write(AXIS_OBJ_EXCITATION_RUN, AXIS_EXCITATION_RUN_START), FW_ERROR_STATE);
  EXPECT_EQ(Doing(), AXIS_EXCITATION_STATE_RAMPING_UP);
}

// The recorder's edge excitation_start: the first value is the sample at the trigger.
class Recorded : public Excited {
 protected:
  void Arm(int pretrigger, int decimation = 1) {
    Set(AXIS_OBJ_RECORDER_SIGNAL_1, Address(AXIS_OBJ_EXCITATION_VALUE));
    Set(AXIS_OBJ_RECORDER_SIGNAL_2, Address(AXIS_OBJ_EXCITATION_STATE));
    Set(AXIS_OBJ_RECORDER_TRIGGER_EDGE, AXIS_RECORDER_TRIGGER_EDGE_EXCITATION_START);
    Set(AXIS_OBJ_RECORDER_PRETRIGGER, pretrigger);
    Set(AXIS_OBJ_RECORDER_DECIMATION, decimation);
    Set(AXIS_OBJ_RECORDER_LENGTH, 60);
    Set(AXIS_OBJ_RECORDER_ARM, 1);
  }
  void PressWithRecorder(int mode) {
    Press(mode);
    fw_.recorder.buffer = buffer_.data();
    fw_.recorder.buffer_bytes = static_cast<uint32_t>(buffer_.size());
  }
  static int Address(uint16_t object) {
    const axis_address_t *a = AddressOf(object);
    return a->index * 256 + a->sub;
  }
  // Value `index` of the recording, in 1/256.
  int Sample(int index) const {
    std::array<int32_t, RECORDER_CHANNELS> values{};
    EXPECT_EQ(fw_recorder_read(&fw_, static_cast<uint32_t>(index), values.data()), 2);
    return values[0];
  }
};

TEST_F(Recorded, TheTriggerIsTheTickOfTheFirstValue) {
  for (const int ticks_armed : {0, 1, 5, 30}) {
    SCOPED_TRACE(ticks_armed);
    PressWithRecorder(kForce);
    Arm(20);
    for (int i = 0; i < ticks_armed; ++i) Give(kReading);
    Start();
    for (int i = 0; i < 60; ++i) Give(kReading);
    ASSERT_EQ(Read(AXIS_OBJ_RECORDER_STATE), AXIS_RECORDER_STATE_DONE);
    const int at = Read(AXIS_OBJ_RECORDER_TRIGGER_INDEX);
    EXPECT_EQ(at, std::min(ticks_armed, 20));
    const std::vector<int> noise = Noise(7, 60);
    for (int i = 0; i < at; ++i) EXPECT_EQ(Sample(i), 0);
    for (int i = at; i < 60; ++i) {
      EXPECT_EQ(Sample(i), FloorOf(40.0 * 256 * noise[i - at] / 32768)) << i;
    }
  }
}

TEST_F(Recorded, OnlyAStartIsATrigger) {
  PressWithRecorder(kForce);
  Start();
  for (int i = 0; i < 10; ++i) Give(kReading);
  Arm(0);
  for (int i = 0; i < 10; ++i) Give(kReading);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_STATE), AXIS_RECORDER_STATE_ARMED) << "it ran already";
  Stop();
  for (int i = 0; i < 3; ++i) Give(kReading);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_STATE), AXIS_RECORDER_STATE_ARMED) << "the end is none";
  Start();
  Give(kReading);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_STATE), AXIS_RECORDER_STATE_RECORDING);
}

}  // namespace
