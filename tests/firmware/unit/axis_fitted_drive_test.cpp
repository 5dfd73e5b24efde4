// An axis with a drive that has a control loop of its own (axis_inputs_t.drive) and with values
// that are older than a tick. The requirement: a fault acts in the tick of its input, nothing
// begins before the drive is on, and an axis without such a drive ignores all of it.
#include <cstdlib>
#include <random>
#include <vector>

#include "tests/firmware/unit/axis_fixture.hpp"
#include "tests/firmware/unit/cia402_fixture.hpp"

namespace {

constexpr uint8_t kFitted = AXIS_DRIVE_REPORT_FITTED,
                  kOn = AXIS_DRIVE_REPORT_FITTED | AXIS_DRIVE_REPORT_ON;
constexpr int kNativeModes[] = {AXIS_MODE_OPEN_LOOP, AXIS_MODE_POSITION, AXIS_MODE_FORCE,
                                AXIS_MODE_EXCITATION};

class FittedDrive : public AxisFixture {
 protected:
  void Begin(int mode) {
    PowerUp();
    inputs_ = {100, {10, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, kFitted, 0, 0};
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    Set(AXIS_OBJ_OPEN_LOOP_CODE, 300);
    Set(AXIS_OBJ_EXCITATION_AMPLITUDE, 100);
    Set(AXIS_OBJ_EXCITATION_WAVEFORM, AXIS_EXCITATION_WAVEFORM_NOISE);
    Set(AXIS_OBJ_FORCE_GAIN, 5 * 256);
    Set(AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
    Set(AXIS_OBJ_POSITION_GAIN, 5 * 256);
    Set(AXIS_OBJ_PROFILE_ENABLE, AXIS_PROFILE_ENABLE_TRAPEZOID);
    Set(AXIS_OBJ_POSITION_SETPOINT, 5000);
    Set(AXIS_OBJ_MODE, mode);
  }

  void ExpectWaiting() {
    EXPECT_EQ(outputs_.dac_code, 0);
    EXPECT_EQ(outputs_.amp_enable, 1);
    EXPECT_EQ(outputs_.brake_release, 0);
    EXPECT_EQ(Read(AXIS_OBJ_ACTIVE_MODE), AXIS_MODE_DISABLED);
    EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
    EXPECT_EQ(Read(AXIS_OBJ_PROFILE_POSITION), inputs_.encoder_cnt);
    EXPECT_EQ(Read(AXIS_OBJ_PROFILE_VELOCITY), 0);
  }
};

// The outputs of the first 50 ticks with the drive on are those of an axis that never waited.
TEST_F(FittedDrive, TheModeBeginsWhenTheDriveIsOnAsIfItHadNotWaited) {
  for (const int mode : kNativeModes) {
    std::vector<int> codes[2];
    for (const int waits : {0, 40}) {
      Begin(mode);
      for (int t = 0; t < waits; ++t) {
        Tick();
        ExpectWaiting();
      }
      inputs_.drive = kOn;
      for (int t = 0; t < 50; ++t) {
        codes[waits != 0].push_back(Tick());
        EXPECT_EQ(outputs_.brake_release, 1);
        EXPECT_EQ(Read(AXIS_OBJ_ACTIVE_MODE), mode);
      }
    }
    EXPECT_EQ(codes[0], codes[1]) << "mode " << mode;
  }
}

TEST_F(FittedDrive, TheLastTickOfTheTimeIsInTimeAndTheNextIsNot) {
  for (const int mode : kNativeModes) {
    for (const int most : {1, 2, 600}) {
      for (const bool late : {false, true}) {
        Begin(mode);
        Set(AXIS_OBJ_DRIVE_ON_TICKS_MAX, most);
        for (int t = 0; t < most; ++t) {
          Tick();
          ExpectWaiting();
        }
        inputs_.drive = late ? kFitted : kOn;
        Tick();
        if (late) {
          ExpectOff(AXIS_FAULT_DRIVE_NOT_READY);
          EXPECT_EQ(Read(AXIS_OBJ_MODE), AXIS_MODE_DISABLED);
          inputs_.drive = kOn;  // too late: the fault stays
          Tick();
          ExpectOff(AXIS_FAULT_DRIVE_NOT_READY);
        } else {
          EXPECT_EQ(outputs_.brake_release, 1);
          EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
        }
      }
    }
  }
}

// Each time that the axis is enabled has the whole of drive_on_ticks_max.
TEST_F(FittedDrive, AStopWhileItWaitsActsInItsTickAndTheTimeBeginsAnew) {
  Begin(AXIS_MODE_POSITION);
  Set(AXIS_OBJ_DRIVE_ON_TICKS_MAX, 10);
  for (int round = 0; round < 3; ++round) {
    Set(AXIS_OBJ_MODE, AXIS_MODE_POSITION);
    for (int t = 0; t < 9; ++t) {
      Tick();
      ExpectWaiting();
    }
    Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
    Tick();
    ExpectOff(AXIS_FAULT_NONE);
  }
}

TEST_F(FittedDrive, EveryFaultActsInItsTickInEveryModeWaitingOrNot) {
  const struct {
    int fault;
    void (*make)(axis_inputs_t &);
    bool while_waiting;
  } cases[] = {
      {AXIS_FAULT_DRIVE_LOST, [](axis_inputs_t &in) { in.drive = kFitted; }, false},
      {AXIS_FAULT_DRIVE_FAULT, [](axis_inputs_t &in) { in.drive |= AXIS_DRIVE_REPORT_FAULT; },
       true},
      {AXIS_FAULT_POSITION_OLD, [](axis_inputs_t &in) { in.position_age = 16; }, false},
      {AXIS_FAULT_POSITION_OLD, [](axis_inputs_t &in) { in.position_age = 255; }, false},
      {AXIS_FAULT_FORCE_OLD, [](axis_inputs_t &in) { in.force_age = 16; }, false},
      {AXIS_FAULT_ENABLE_LOST, [](axis_inputs_t &in) { in.din = 0; }, true},
      {AXIS_FAULT_SENSOR_INVALID, [](axis_inputs_t &in) { in.sensor_valid = 0; }, true},
  };
  for (const int mode : kNativeModes) {
    for (const int latency : {0, 1}) {
      for (const auto &c : cases) {
        for (const bool waiting : {false, true}) {
          if (waiting && !c.while_waiting) continue;
          Begin(AXIS_MODE_DISABLED);
          Set(AXIS_OBJ_LATENCY_TICKS, latency);
          Set(AXIS_OBJ_MODE, mode);
          Tick();
          if (!waiting) {
            inputs_.drive = kOn;
            Tick();
            Tick();
          }
          const axis_inputs_t good = inputs_;
          c.make(inputs_);
          Tick();
          ExpectOff(c.fault);
          inputs_ = good;  // latched: the good input changes nothing
          inputs_.drive = kOn;
          Tick();
          ExpectOff(c.fault);
          Set(AXIS_OBJ_FAULT_RESET, 1);
          Set(AXIS_OBJ_MODE, mode);
          Tick();
          EXPECT_EQ(outputs_.brake_release, 1) << "fault " << c.fault;
        }
      }
    }
  }
}

TEST_F(FittedDrive, AnAgeAtItsBoundIsNoFault) {
  for (const int bound : {0, 1, 15, 254}) {
    for (const bool force : {false, true}) {
      Begin(AXIS_MODE_FORCE);
      inputs_.drive = 0;
      Set(force ? AXIS_OBJ_FORCE_AGE_MAX : AXIS_OBJ_POSITION_AGE_MAX, bound);
      uint8_t &age = force ? inputs_.force_age : inputs_.position_age;
      age = static_cast<uint8_t>(bound);
      Tick();
      EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
      EXPECT_EQ(outputs_.brake_release, 1);
      age = static_cast<uint8_t>(bound + 1);
      Tick();
      ExpectOff(force ? AXIS_FAULT_FORCE_OLD : AXIS_FAULT_POSITION_OLD);
    }
  }
}

// A drive that sends a position every `cycle` ticks, each `late` ticks after its reading. At a
// constant speed every tick has that speed, as it has with a position in each tick.
TEST_F(FittedDrive, TheVelocityIsThatOfThePositionsHoweverRareTheyAre) {
  for (const int cycle : {1, 3, 6, 15}) {
    for (const int late : {0, 2, 6}) {
      for (const int speed : {-7, 1, 40}) {
        Begin(AXIS_MODE_OPEN_LOOP);
        inputs_.drive = kOn;
        Set(AXIS_OBJ_POSITION_AGE_MAX, 40);
        Set(AXIS_OBJ_SPEED_MAX, 41);
        for (int t = 0; t < 10 * cycle; ++t) {
          inputs_.position_age = static_cast<uint8_t>(late + t % cycle);
          inputs_.encoder_cnt = speed * (t - inputs_.position_age);
          Tick();
          if (t >= 2 * cycle) {
            ASSERT_EQ(Read(AXIS_OBJ_VELOCITY), speed);
          }
        }
        EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
      }
    }
  }
}

// The sum of velocity times elapsed ticks is the travel, so that no speed is too low to be seen.
TEST_F(FittedDrive, NoCountIsLostBetweenPositionsAtIrregularTimes) {
  std::mt19937 random(11);
  for (const int speed_most : {1, 5, 100000}) {
    Begin(AXIS_MODE_OPEN_LOOP);
    inputs_.drive = kOn;
    Set(AXIS_OBJ_POSITION_AGE_MAX, 200);
    Set(AXIS_OBJ_SPEED_MAX, 0);
    Tick();
    int64_t position = inputs_.encoder_cnt, sum = 0;
    const int64_t start = position;
    std::vector<int64_t> places{position};
    int read_at = 0;
    for (int t = 1; t < 5000; ++t) {
      position += static_cast<int64_t>(random() % (2 * speed_most + 1)) - speed_most;
      places.push_back(position);
      const int before = read_at;
      if (random() % 4 == 0) read_at += static_cast<int>(random() % (t - read_at + 1));
      if (t - read_at > 190) read_at = t;
      inputs_.position_age = static_cast<uint8_t>(t - read_at);
      inputs_.encoder_cnt = static_cast<int>(places[read_at]);
      Tick();
      sum += static_cast<int64_t>(Read(AXIS_OBJ_VELOCITY)) * (read_at - before);
      ASSERT_LT(std::abs(sum - (places[read_at] - start)), 200) << t;
    }
  }
}

// Position and force of a drive that is not on yet may be of any age: nothing uses them.
TEST_F(FittedDrive, AgesCountFromTheTickInWhichTheDriveIsOn) {
  Begin(AXIS_MODE_FORCE);
  inputs_.position_age = inputs_.force_age = 255;
  for (int t = 0; t < 20; ++t) {
    Tick();
    ExpectWaiting();
  }
  inputs_.drive = kOn;
  Tick();
  ExpectOff(AXIS_FAULT_POSITION_OLD);
}

TEST_F(FittedDrive, WhileTheAxisIsDisabledNothingIsLatched) {
  Begin(AXIS_MODE_DISABLED);
  inputs_.drive = kFitted | AXIS_DRIVE_REPORT_FAULT;
  inputs_.position_age = inputs_.force_age = 255;
  for (int t = 0; t < 700; ++t) Tick();
  ExpectOff(AXIS_FAULT_NONE);
}

// Without AXIS_DRIVE_REPORT_FITTED every other bit of the report has no meaning.
TEST_F(FittedDrive, AnAmplifierForTenVoltsIgnoresEveryBit) {
  std::mt19937 random(3);
  for (const int mode : kNativeModes) {
    std::vector<int> with, without;
    for (const bool bits : {true, false}) {
      Begin(mode);
      random.seed(7);
      for (int t = 0; t < 300; ++t) {
        const auto noise = static_cast<uint8_t>(random() & 0xFE);
        inputs_.drive = bits ? noise : 0;
        inputs_.encoder_cnt += static_cast<int>(random() % 3) - 1;
        (bits ? with : without)
            .push_back(Tick() * 4 + outputs_.amp_enable * 2 + outputs_.brake_release);
      }
      EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
    }
    EXPECT_EQ(with, without) << "mode " << mode;
  }
}

TEST_F(FittedDrive, ALimitOfTheDriveIsALimitReasonAndBoundsNoCode) {
  Begin(AXIS_MODE_OPEN_LOOP);
  inputs_.drive = kOn | AXIS_DRIVE_REPORT_LIMIT;
  EXPECT_EQ(Tick(), 300);
  EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), AXIS_LIMIT_REASON_DRIVE_LIMIT);
  Set(AXIS_OBJ_OUTPUT_LIMIT, 200);
  EXPECT_EQ(Tick(), 200);
  EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), AXIS_LIMIT_REASON_OUTPUT_LIMIT) << "the axis' own limit";
  inputs_.drive = kOn;
  Set(AXIS_OBJ_OUTPUT_LIMIT, 2048);
  EXPECT_EQ(Tick(), 300);
  EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), AXIS_LIMIT_REASON_NONE);
}

// The same in the modes of CiA 402, whose trajectories the firmware computes before the inputs.
class FittedDriveModes : public Drive {
 protected:
  static constexpr int kModes[] = {-8, -7, -6, -5, -4, -3, -2, -1, 1, 3, 4, 6, 8, 9, 10};

  void Begin(int mode) {
    PowerUp();
    inputs_.drive = kFitted;
    Set(AXIS_OBJ_MODES_OF_OPERATION, mode);
    Tick();
    Set(AXIS_OBJ_OPEN_LOOP_CODE, 300);
    Control(0x06);
    Control(0x07);
    Control(0x0F);
    Set(AXIS_OBJ_TARGET_POSITION, 5000);
    Set(AXIS_OBJ_TARGET_VELOCITY, 15000);
    Set(AXIS_OBJ_TARGET_FORCE, 300);
    Set(AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
    Control(0x1F);
  }

  void ExpectWaiting(int mode) {
    EXPECT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED) << "mode " << mode;
    EXPECT_EQ(outputs_.dac_code, 0) << "mode " << mode;
    EXPECT_EQ(outputs_.amp_enable, 1) << "mode " << mode;
    EXPECT_EQ(outputs_.brake_release, 0) << "mode " << mode;
    EXPECT_EQ(Demand(), 0) << "mode " << mode;
    EXPECT_EQ(fw_.drive.tracking, CIA402_TRACKING_NONE) << "mode " << mode;
    EXPECT_EQ(fw_.drive.force_ramp_q16, 0) << "mode " << mode;
  }
};

TEST_F(FittedDriveModes, NothingBeginsBeforeTheDriveIsOn) {
  for (const int mode : kModes) {
    Begin(mode);
    for (int t = 0; t < 500; ++t) {
      Tick();
      ExpectWaiting(mode);
    }
    inputs_.drive = kOn;
    Tick();
    EXPECT_EQ(outputs_.dac_code, 0) << "the first tick releases the brake, mode " << mode;
    EXPECT_EQ(outputs_.brake_release, 1) << "mode " << mode;
    Tick(20);
    EXPECT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED) << "mode " << mode;
    EXPECT_EQ(outputs_.brake_release, 1) << "mode " << mode;
  }
}

TEST_F(FittedDriveModes, TheTargetIsReachedAfterALateDrive) {
  Begin(kPp);
  Tick(500);
  inputs_.drive = kOn;
  ASSERT_GE(TicksUntil(kReached, kReached, 20000), 0);
  Tick(1500);
  EXPECT_NEAR(place_, 5000, 2);
}

TEST_F(FittedDriveModes, ADriveThatDoesNotComeOnOrGoesOffIsAFaultByName) {
  for (const int mode : kModes) {
    Begin(mode);
    Tick(600);
    ExpectWaiting(mode);
    Tick();
    EXPECT_EQ(State(), AXIS_DRIVE_STATE_FAULT) << "mode " << mode;
    EXPECT_EQ(Read(AXIS_OBJ_ERROR_CODE), 0xFF1F) << "mode " << mode;

    Begin(mode);
    Tick(3);
    inputs_.drive = kOn;
    Tick(30);
    inputs_.drive = kFitted;
    Tick();
    EXPECT_EQ(outputs_.amp_enable, 0) << "mode " << mode;
    EXPECT_EQ(State(), AXIS_DRIVE_STATE_FAULT) << "mode " << mode;
    EXPECT_EQ(Read(AXIS_OBJ_ERROR_CODE), 0xFF20) << "mode " << mode;
    inputs_.drive = kOn;
    Tick(5);
    EXPECT_EQ(State(), AXIS_DRIVE_STATE_FAULT) << "it stays off, mode " << mode;
  }
}

// Shutdown, quick stop and disable voltage while the axis waits: off in the next tick.
TEST_F(FittedDriveModes, AStopIsNeverRefusedWhileItWaits) {
  for (const int mode : kModes) {
    for (const int stop : {0x06, 0x07, 0x02, 0x00}) {
      Begin(mode);
      Tick(10);
      ExpectWaiting(mode);
      Control(stop);
      Tick();
      EXPECT_EQ(outputs_.amp_enable, 0) << "mode " << mode << " controlword " << stop;
      EXPECT_NE(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
      EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
    }
  }
}

// The phase "zero" of the first motion test lasts 90 ticks from the tick in which the drive is on.
TEST_F(FittedDriveModes, TheFirstMotionTestWaitsWithItsPhaseZero) {
  for (const int late : {0, 400}) {
    PowerUp();
    Set(AXIS_OBJ_FIRST_MOTION_TEST, 1);
    Set(AXIS_OBJ_FORCE_ZERO_CODE, 0);
    inputs_.drive = kFitted;
    Set(AXIS_OBJ_MODES_OF_OPERATION, kPv);
    Tick();
    Control(0x06);
    Control(0x0F);
    int standing = 0;
    for (; outputs_.amp_enable == 0 && standing < 2000; ++standing) Tick();
    ASSERT_LT(standing, 2000);
    for (int t = 0; t < late; ++t) {
      Tick();
      EXPECT_EQ(outputs_.brake_release, 0);
      EXPECT_EQ(fw_.drive.guards.first_motion.phase, FIRST_MOTION_ZERO);
    }
    inputs_.drive = kOn;
    for (int t = 0; t < FIRST_MOTION_ZERO_TICKS; ++t) {
      EXPECT_EQ(fw_.drive.guards.first_motion.phase, FIRST_MOTION_ZERO) << t;
      Tick();
    }
    EXPECT_EQ(fw_.drive.guards.first_motion.phase, FIRST_MOTION_OUT);
    Tick(2000);
    EXPECT_EQ(Read(AXIS_OBJ_FIRST_MOTION_RESULT), AXIS_FIRST_MOTION_RESULT_PASSED);
  }
}

}  // namespace
