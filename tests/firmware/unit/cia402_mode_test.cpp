// Native modes, changes of mode, and masters that write at random.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <random>
#include <utility>

#include "tests/firmware/unit/cia402_fixture.hpp"
#include "tests/firmware/unit/code_oracle.hpp"

namespace {

TEST_F(Drive, NativeModesRunWithTheUsersParameters) {
  Set(AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Enable(-1);
  EXPECT_EQ(outputs_.dac_code, 150);  // 5 x (30 - 0)
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), 750);
  PowerUp();
  Set(AXIS_OBJ_OPEN_LOOP_CODE, 12);
  Enable(-2);
  Tick(600);
  EXPECT_EQ(outputs_.dac_code, 12);
  PowerUp();
  Set(AXIS_OBJ_PROFILE_ENABLE, AXIS_PROFILE_ENABLE_TRAPEZOID);
  Set(AXIS_OBJ_PROFILE_VELOCITY_MAX, 65536);
  Enable(-4);
  Set(AXIS_OBJ_POSITION_SETPOINT, 500);
  Tick(100);
  EXPECT_EQ(Read(AXIS_OBJ_PROFILE_VELOCITY), 65536);
  EXPECT_EQ(Read(AXIS_OBJ_PROFILE_ENABLE), AXIS_PROFILE_ENABLE_TRAPEZOID);
}

TEST_F(Drive, TheUsersParametersAreOnlyLent) {
  Set(AXIS_OBJ_PROFILE_ENABLE, AXIS_PROFILE_ENABLE_TRAPEZOID);
  Set(AXIS_OBJ_POSITION_SETPOINT, 77);
  Set(AXIS_OBJ_FORCE_SETPOINT, 88);
  wall_ = 300;
  for (const int mode : {kPp, kPv, kTq, kHm, kCsp, kCsv, kCst, -5, -6, -7, -8}) {
    Enable(mode);
    Set(AXIS_OBJ_TARGET_FORCE, 300);
    for (int i = 0; i < 400; ++i) {
      Tick();
      ASSERT_EQ(Read(AXIS_OBJ_PROFILE_ENABLE), AXIS_PROFILE_ENABLE_TRAPEZOID);
      ASSERT_EQ(Read(AXIS_OBJ_POSITION_SETPOINT), 77);
      ASSERT_EQ(Read(AXIS_OBJ_FORCE_SETPOINT), 88);
      ASSERT_EQ(Read(AXIS_OBJ_BUMP_DECAY_SHIFT), 6);
    }
    Control(0);
    Tick(2);
  }
}

TEST_F(Drive, ARewriteOfTheModeChangesNothing) {
  Enable(kPp);
  MoveTo(5000);
  Tick(100);
  for (int i = 0; i < 3000; ++i) {
    Set(AXIS_OBJ_MODES_OF_OPERATION, kPp);
    Tick();
  }
  EXPECT_EQ(Demand(), 5000);
}

// The target that was reached is that of the previous mode.
TEST_F(Drive, AChangeOfModeShowsNothingReached) {
  for (const int to : {kPv, kCsv, kCsp}) {
    PowerUp();
    Enable(kPp);
    MoveTo(10);
    ASSERT_GE(TicksUntil(kReached, kReached, 500), 0);
    Tick(300);
    Set(AXIS_OBJ_MODES_OF_OPERATION, to);
    ASSERT_EQ(Mode(), to) << "at once: the axis stands";
    EXPECT_EQ(Status() & kReached, 0) << to;
  }
}

// The bit "new set-point" stays 1: it was taken by the mode before.
TEST_F(Drive, AChangeOfModeAcknowledgesNothing) {
  Enable(kPp);
  Set(AXIS_OBJ_TARGET_POSITION, 0);
  Control(kNew);
  Tick(20);
  ASSERT_EQ(Status() & kBit12, kBit12);
  Set(AXIS_OBJ_MODES_OF_OPERATION, -5);
  ASSERT_EQ(Mode(), -5) << "at once: the axis stands";
  EXPECT_EQ(Status() & kBit12, 0);
  Tick(20);
  EXPECT_EQ(Status() & kBit12, 0);
}

// A guarded move that the workpiece stopped counts as reached, in that mode alone.
TEST_F(Drive, AChangeOfModeForgetsTheWorkpiece) {
  wall_ = 1000;
  Enable(-5);
  Set(AXIS_OBJ_POSITION_WINDOW, 10);
  MoveTo(5000);
  ASSERT_GE(TicksUntil(kReached, kReached, 3000), 0);
  Tick(500);
  Set(AXIS_OBJ_MODES_OF_OPERATION, kPp);
  for (int i = 0; i < 300 && Mode() != kPp; ++i) Tick();
  ASSERT_EQ(Mode(), kPp);
  stuck_ = true;
  place_ -= 100;  // pushed out of the window, away from the workpiece
  Tick(50);
  EXPECT_EQ(Status() & kReached, 0);
}

// Speed 0 is shown once the axis has stood for its time in this mode: 100 ms are 150 ticks.
TEST_F(Drive, AChangeOfModeBeginsTheTimeOfStanding) {
  Set(AXIS_OBJ_VELOCITY_THRESHOLD_TIME, 100);
  Enable(kPp);
  Tick(400);
  Set(AXIS_OBJ_MODES_OF_OPERATION, kPv);
  ASSERT_EQ(Mode(), kPv) << "at once: the axis stands";
  EXPECT_EQ(Status() & kBit12, 0);
  EXPECT_NEAR(TicksUntil(kBit12, kBit12, 400), 151, 1);  // judged in every second tick
}

TEST_F(Drive, AChangeOfModeStopsFirstWithoutABump) {
  const int modes[] = {kPp, kPv, kTq, kHm, kCsp, kCsv, kCst, 0, -1, -2, -4, -5, -6, -7, -8};
  for (const int from : {kPv, kCsv}) {
    for (const int to : modes) {
      if (from == to) {
        continue;
      }
      PowerUp();
      Enable(from);
      Set(AXIS_OBJ_TARGET_VELOCITY, 15000);
      Tick(300);
      Set(AXIS_OBJ_MODES_OF_OPERATION, to);
      Set(AXIS_OBJ_TARGET_VELOCITY, 0);
      int before = outputs_.dac_code;
      int ticks = 0;
      while (Mode() == from && ticks < 300) {
        Tick();
        ++ticks;
        EXPECT_LE(std::abs(outputs_.dac_code - before), 20);
        before = outputs_.dac_code;
      }
      EXPECT_NEAR(ticks, 101 + 45, 25);  // 10 counts a tick at 0.1 a tick, then the lag
      EXPECT_EQ(Mode(), to);
      for (int i = 0; i < 300; ++i) {
        Tick();
        EXPECT_LE(std::abs(outputs_.dac_code - before), 20) << from << " to " << to;
        before = outputs_.dac_code;
      }
      EXPECT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
    }
  }
}

TEST_F(Drive, TheFirstTickOfAllIsNotTrusted) {
  PowerUp();
  place_ = 36000;
  Set(AXIS_OBJ_MODES_OF_OPERATION, kPp);
  Control(6);
  Control(15);
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
  for (int i = 0; i < 20; ++i) {
    Tick();
    EXPECT_EQ(outputs_.dac_code, 0);
  }
  EXPECT_EQ(Demand(), 36000);
}

// Half of the time the masters press, and the part is pulled away and comes back; the other half
// they write anything.
TEST_F(Drive, RandomMastersKeepTheRules) {
  std::mt19937 random(20);
  const auto pick = [&](int low, int high) {
    return low + static_cast<int>(random() % static_cast<unsigned>(high - low + 1));
  };
  const int commands[] = {0x00, 0x02, 0x06, 0x07, 0x0F, 0x1F, 0x3F, 0x5F, 0x10F, 0x80, 0x21F};
  Set(AXIS_OBJ_VELOCITY_MAX, 15000);  // 10 counts a tick
  Set(AXIS_OBJ_TRAJECTORY_VELOCITY, 12000);
  wall_ = 3000;
  const double most = 10.0;
  int powered_ticks = 0, law_ticks = 0, losses = 0, mode_before = 0;
  bool calm = false;
  CodeOracle codes;
  int in_mode[19] = {};
  int in_state[8] = {};
  for (int step = 0; step < 1000000; ++step) {
    if (pick(0, 500) == 0) {
      calm = !calm;
      const int presses[] = {kTq, kCst, kTq, kCst, -1, -6, -7, -8};
      Set(AXIS_OBJ_CONTROLWORD, 0);
      if (calm) (void)Write(AXIS_OBJ_MODES_OF_OPERATION, presses[pick(0, 7)]);
      Set(AXIS_OBJ_CONTACT_LOSS_CAP, std::array{0, 0, 40, 2048}[static_cast<size_t>(pick(0, 3))]);
      Set(AXIS_OBJ_CONTACT_LOSS_DWELL, pick(0, 1) * 300);
      Set(AXIS_OBJ_OUTPUT_LIMIT, std::array{2048, 300}[static_cast<size_t>(pick(0, 1))]);
      Set(AXIS_OBJ_FORCE_SETPOINT, pick(0, 60) * 256);
    }
    switch (calm ? pick(60, 500) : pick(0, 15)) {
      case 0:
        Set(AXIS_OBJ_CONTROLWORD, pick(0, 0xFFFF));
        break;
      case 1:
      case 2:
        Set(AXIS_OBJ_CONTROLWORD, commands[pick(0, 10)]);
        break;
      case 3:
        (void)Write(AXIS_OBJ_MODES_OF_OPERATION, pick(-8, 10));
        break;
      case 61:
      case 62:
        wall_ = place_ + pick(-60, 100);
        break;
      case 63:
        wall_ = place_ + pick(20, 2000);
        break;
      case 64:
      case 65:
        Set(AXIS_OBJ_TARGET_FORCE, pick(-100, 1500));
        Set(AXIS_OBJ_TARGET_POSITION, Read(AXIS_OBJ_POSITION_ACTUAL) + pick(-200, 200));
        break;
      case 4:
        Set(AXIS_OBJ_TARGET_POSITION,
            (pick(0, 9) == 0) ? static_cast<int32_t>(random()) : pick(-5000, 5000));
        break;
      case 5:
        Set(AXIS_OBJ_TARGET_VELOCITY, pick(-20000, 20000));
        break;
      case 6:
        Set(AXIS_OBJ_TARGET_FORCE, pick(-2000, 2000));
        break;
      case 7:
        if (pick(0, 40) == 0) {
          inputs_.din = static_cast<uint8_t>(pick(0, 15));
        } else {
          inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
        }
        break;
      case 8:
        (void)Write(AXIS_OBJ_QUICK_STOP_OPTION, pick(0, 6));
        Set(AXIS_OBJ_FAULT_REACTION_OPTION, pick(0, 2));
        break;
      case 9:
        if (pick(0, 20) == 0) {
          cia402_owner_lost(&fw_.drive, &fw_.axis, AXIS_FAULT_CAN_OFF);
        }
        break;
      case 10:
        Set(AXIS_OBJ_INTERPOLATION_PERIOD, pick(0, 20));
        break;
      case 11:
        wall_ = place_ + pick(-20, 2000);
        break;
      default:
        break;
    }
    if (calm) {  // the way up, a word a tick
      const int up[8] = {0x00, 0x06, 0x07, 0x0F, 0x0F, 0x00, 0x00, 0x80};
      if (State() == AXIS_DRIVE_STATE_FAULT) Set(AXIS_OBJ_CONTROLWORD, 0);
      if (State() != AXIS_DRIVE_STATE_OPERATION_ENABLED) Set(AXIS_OBJ_CONTROLWORD, up[State()]);
      inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
    }
    inputs_.sensor_valid = pick(0, 5000) != 0;
    const CodeOracle::Bounds bounds(fw_);
    const bool goes = State() == AXIS_DRIVE_STATE_OPERATION_ENABLED && fw_.drive.leaving == 0 &&
                      Read(AXIS_OBJ_MODES_OF_OPERATION) == Mode();
    if (std::exchange(mode_before, Mode()) != Mode()) codes.Leave();
    const bool touched = Read(AXIS_OBJ_CONTACT) != 0;
    const int state = State();
    const int tracking = fw_.drive.tracking;
    const double speed = Speed();
    Tick();
    const int now = State();
    const bool presses = goes && (Mode() == kTq || Mode() == kCst);
    ASSERT_EQ(codes.Judge(bounds, inputs_, outputs_, presses), "") << step << " mode " << Mode();
    const bool law = Read(AXIS_OBJ_ACTIVE_MODE) == AXIS_MODE_FORCE;
    law_ticks += law;
    losses += law && touched && Read(AXIS_OBJ_CONTACT) == 0;
    // Without a controlword the state changes by itself in these ways only.
    const bool by_itself =
        now == state || now == AXIS_DRIVE_STATE_FAULT ||
        (state == AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE &&
         now == AXIS_DRIVE_STATE_SWITCH_ON_DISABLED) ||
        (state == AXIS_DRIVE_STATE_OPERATION_ENABLED &&
         (now == AXIS_DRIVE_STATE_SWITCHED_ON || now == AXIS_DRIVE_STATE_READY_TO_SWITCH_ON));
    ASSERT_TRUE(by_itself) << step << ": " << state << " to " << now;
    ASSERT_EQ(now == AXIS_DRIVE_STATE_FAULT, Read(AXIS_OBJ_FAULT) != AXIS_FAULT_NONE);
    powered_ticks += outputs_.amp_enable;
    ++in_state[now];
    in_mode[Mode() + 8] += now == AXIS_DRIVE_STATE_OPERATION_ENABLED;
    if (fw_.drive.tracking == CIA402_TRACKING_AXIS) {
      ASSERT_LE(std::abs(Speed()), most) << step;
      const int mode = Mode();
      const bool profiled = mode != kCsp && mode != kCsv && mode != -5;
      if (tracking == CIA402_TRACKING_AXIS && profiled && fw_.drive.pressing == 0) {
        // The quick-stop ramp is the steepest: 1 count/tick^2.
        ASSERT_LE(std::abs(Speed() - speed), 1.0) << step << " mode " << mode;
      }
    }
    if (HasFatalFailure()) {
      return;
    }
  }
  EXPECT_GT(powered_ticks, 100000);
  EXPECT_GT(law_ticks, 1000000 / 3);
  EXPECT_GT(losses, 500);
  EXPECT_GT(codes.judged_after_loss(), 10000);
  for (int state = 1; state < 8; ++state) {
    EXPECT_GT(in_state[state], 500) << state;
  }
  for (const int mode : {1, 3, 4, 6, 8, 9, 10, 0, -1, -2, -3, -4, -5, -6, -7, -8}) {
    EXPECT_GT(in_mode[mode + 8], 100) << mode;
  }
}

}  // namespace
