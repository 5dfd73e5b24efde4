#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "tests/unit/cia402_fixture.hpp"

// Modes of operation on a simulated axis. Figures are worked out by hand from the parameters:
// 3000 count/s are 2 counts a tick, 225,000 count/s^2 are 0.1 count/tick^2.

namespace {

constexpr int kPp = 1, kPv = 3, kTq = 4, kHm = 6, kCsp = 8, kCsv = 9, kCst = 10;
constexpr int kOperate = 0x0F, kNew = 0x1F, kNewNow = 0x3F, kNewRelative = 0x5F;
constexpr int kReached = 0x400, kBit12 = 0x1000, kBit13 = 0x2000, kLimit = 0x800;

class Drive : public DriveFixture {
 protected:
  void MoveTo(int32_t target, int command = kNew) {
    Set(AXIS_OBJ_TARGET_POSITION, target);
    Control(command);
    Control(kOperate);
  }

  // Follows the trajectory until it stands; checks speed and its changes.
  int Follow(double speed_max, double up, double down, int most = 20000) {
    double before = Speed();
    for (int i = 1; i <= most; ++i) {
      Tick();
      EXPECT_LE(std::abs(Speed()), speed_max + 1e-9);
      const double change = Speed() - before;
      const bool slower = std::abs(Speed()) < std::abs(before);
      EXPECT_LE(std::abs(change), (slower ? down : up) + 1e-9) << "tick " << i;
      before = Speed();
      if (Speed() == 0.0) {
        return i;
      }
    }
    return -1;
  }
};

// --- profile position ---------------------------------------------------------------------------

TEST_F(Drive, ProfilePositionLandsExactly) {
  Enable(kPp);
  Set(AXIS_OBJ_TRAJECTORY_VELOCITY, 3000);
  Set(AXIS_OBJ_TRAJECTORY_ACCELERATION, 225000);
  Set(AXIS_OBJ_TRAJECTORY_DECELERATION, 112500);
  for (const int32_t target : {1000, -777, -776, -778, 0, 36000}) {
    MoveTo(target);
    EXPECT_EQ(Status() & kReached, 0);
    EXPECT_GT(Follow(2.0, 0.1, 0.05), 0);
    EXPECT_EQ(Demand(), target);
    EXPECT_EQ(fw_.drive.trajectory.position_q32, fx_q32_from_cnt(target));
    ASSERT_GE(TicksUntil(kReached, kReached, 500), 0);
    EXPECT_NEAR(place_, target, 11);
  }
}

TEST_F(Drive, ProfilePositionTakesTheTimeOfATrapezoid) {
  Enable(kPp);
  Set(AXIS_OBJ_TRAJECTORY_VELOCITY, 3000);
  MoveTo(2000);
  // 2 counts a tick, 20 ticks up and down: 2000 / 2 + 20 ticks, and one to stand.
  EXPECT_NEAR(Follow(2.0, 0.1, 0.1), 1021, 3);
}

TEST_F(Drive, TheHandshakeOfSetpoints) {
  Enable(kPp);
  Set(AXIS_OBJ_TARGET_POSITION, 500);
  EXPECT_EQ(Status() & kBit12, 0);
  Control(kNew);
  EXPECT_EQ(Status() & kBit12, kBit12);  // acknowledged
  Control(kNew);                         // no edge
  Set(AXIS_OBJ_TARGET_POSITION, 900);
  Tick();
  EXPECT_EQ(fw_.drive.setpoint.position, 500);
  Control(kOperate);
  EXPECT_EQ(Status() & kBit12, 0);  // there is room
  Control(kNew);
  Control(kOperate);
  EXPECT_EQ(Status() & kBit12, kBit12);  // 900 waits behind 500: no room
  Set(AXIS_OBJ_TARGET_POSITION, -50);
  Control(kNew);
  EXPECT_EQ(fw_.drive.buffered.position, 900);
  Control(kOperate);
  ASSERT_GE(TicksUntil(kBit12, 0, 5000), 0);  // 500 was reached
  EXPECT_EQ(Demand(), 500);
  EXPECT_EQ(Status() & kReached, 0);
  ASSERT_GE(TicksUntil(kReached, kReached, 5000), 0);
  EXPECT_EQ(Demand(), 900);
}

TEST_F(Drive, AnImmediateSetpointReplacesTheOthers) {
  Enable(kPp);
  MoveTo(5000);
  Tick(50);
  MoveTo(6000);
  MoveTo(-1000, kNewNow);
  ASSERT_GE(TicksUntil(kReached, kReached, 5000), 0);
  EXPECT_EQ(Demand(), -1000);
  EXPECT_EQ(fw_.drive.setpoint_buffered, 0);
}

TEST_F(Drive, RelativeSetpointsAdd) {
  Enable(kPp);
  MoveTo(100, kNewRelative);
  MoveTo(30, kNewRelative);
  ASSERT_GE(TicksUntil(kReached | kBit12, kReached, 5000), 0);
  EXPECT_EQ(Demand(), 130);
  MoveTo(-130, kNewRelative);
  ASSERT_GE(TicksUntil(kReached, kReached, 5000), 0);
  EXPECT_EQ(Demand(), 0);
}

TEST_F(Drive, ChangeOnSetpointDoesNotStop) {
  for (const bool blend : {false, true}) {
    PowerUp();
    Enable(kPp);
    Set(AXIS_OBJ_TRAJECTORY_VELOCITY, 3000);
    const int change = blend ? 0x200 : 0;
    Set(AXIS_OBJ_TARGET_POSITION, 1000);
    Control(kNew | change);
    Control(kOperate | change);
    Set(AXIS_OBJ_TARGET_POSITION, 2000);
    Control(kNew | change);
    Control(kOperate | change);
    double slowest = 2.0;
    while (Demand() < 1500) {
      Tick();
      if (Demand() > 500) {
        slowest = std::min(slowest, Speed());
      }
    }
    EXPECT_EQ(slowest, blend ? 2.0 : 0.0);
    ASSERT_GE(TicksUntil(kReached, kReached, 5000), 0);
    EXPECT_EQ(Demand(), 2000);
  }
}

TEST_F(Drive, NothingMovesWithoutASetpoint) {
  place_ = 4000;
  Enable(kPp);
  Set(AXIS_OBJ_TARGET_POSITION, 9000);
  Tick(100);
  EXPECT_EQ(Demand(), 4000);
  EXPECT_EQ(place_, 4000);
}

TEST_F(Drive, TheReachedWindowWantsItsTime) {
  Enable(kPp);
  Set(AXIS_OBJ_POSITION_WINDOW_TIME, 100);  // 150 ticks
  MoveTo(10);
  int in_window = 0;
  for (int i = 0; i < 1000 && (Status() & kReached) == 0; ++i) {
    Tick();
    in_window +=
        fw_.drive.setpoint_active == 0 && std::abs(Read(AXIS_OBJ_POSITION_ACTUAL) - 10) <= 10;
  }
  EXPECT_NEAR(in_window, 152, 1);  // within for 150 whole ticks, judged in every second one
}

TEST_F(Drive, PositionLimitsDrawTargetsIn) {
  Enable(kPp);
  Set(AXIS_OBJ_POSITION_LIMIT_MAX, 300);
  Set(AXIS_OBJ_POSITION_LIMIT_MIN, -200);
  MoveTo(1000);
  Tick();
  EXPECT_EQ(Status() & kLimit, kLimit);
  Tick(2000);
  EXPECT_EQ(Demand(), 300);
  MoveTo(-1000);
  Tick(2000);
  EXPECT_EQ(Demand(), -200);
}

TEST_F(Drive, LimitsDecideTheWayRound) {
  place_ = -2000000000.0;
  Enable(kPp);
  Set(AXIS_OBJ_POSITION_LIMIT_MIN, -2000000100);
  MoveTo(2000000000);
  Tick(50);
  EXPECT_GT(Speed(), 0.0);  // not backward across the limit, which would be the shorter way
}

// --- halt, quick stop, options -------------------------------------------------------------------

TEST_F(Drive, HaltStopsAndGoesOn) {
  Enable(kPp);
  Set(AXIS_OBJ_TRAJECTORY_VELOCITY, 3000);
  Set(AXIS_OBJ_TRAJECTORY_DECELERATION, 22500);  // 0.01 count/tick^2
  for (const int option : {1, 2}) {
    Set(AXIS_OBJ_HALT_OPTION, option);
    MoveTo(place_ + 3000);
    const int32_t target = Read(AXIS_OBJ_TARGET_POSITION);
    Tick(200);
    ASSERT_EQ(Speed(), 2.0);
    const int32_t from = Demand();
    Control(kOperate | kHalt);
    // 200 ticks, 2^2 / (2 x 0.01) = 200 counts; the quick-stop ramp of 1 count/tick^2 takes 2.
    const int ticks = Follow(2.0, 0.0, option == 1 ? 0.01 : 1.0);
    EXPECT_NEAR(ticks, option == 1 ? 201 : 2, 1);
    EXPECT_NEAR(Demand() - from, option == 1 ? 200 : 1, 2);
    EXPECT_EQ(Status() & kReached, kReached);
    Tick(100);
    Control(kOperate);
    EXPECT_EQ(Status() & kReached, 0);
    ASSERT_GE(TicksUntil(kReached, kReached, 5000), 0);
    EXPECT_EQ(Demand(), target);
  }
}

TEST_F(Drive, QuickStopTakesItsRamp) {
  for (const int option : {1, 2, 5, 6}) {
    PowerUp();
    Set(AXIS_OBJ_QUICK_STOP_OPTION, option);
    Enable(kPv);
    Set(AXIS_OBJ_TARGET_VELOCITY, 15000);  // 10 counts a tick
    Tick(200);
    ASSERT_NEAR(Speed(), 10.0, 1e-4);
    const auto led = [&] { return fx_cnt_from_q32(fw_.drive.trajectory.position_q32); };
    const int32_t from = led();
    Control(0x02);
    const bool quick = option == 2 || option == 6;
    EXPECT_NEAR(Follow(10.0, 0.0, quick ? 1.0 : 0.1), quick ? 10 : 100, 1);
    EXPECT_NEAR(led() - from, quick ? 45 : 495, 1);
    Tick(152);
    EXPECT_EQ(State(), option < 5 ? AXIS_DRIVE_STATE_SWITCH_ON_DISABLED
                                  : AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE);
  }
}

TEST_F(Drive, DisableOperationAndShutdownSlowDownIfAsked) {
  for (const int command : {0x07, 0x06}) {
    for (const int option : {0, 1}) {
      PowerUp();
      Set(AXIS_OBJ_SHUTDOWN_OPTION, option);
      Set(AXIS_OBJ_DISABLE_OPERATION_OPTION, option);
      Enable(kPv);
      Set(AXIS_OBJ_TARGET_VELOCITY, 15000);
      Tick(200);
      Control(command);
      const int after =
          command == 7 ? AXIS_DRIVE_STATE_SWITCHED_ON : AXIS_DRIVE_STATE_READY_TO_SWITCH_ON;
      if (option == 1) {
        EXPECT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
        EXPECT_NEAR(Follow(10.0, 0.0, 0.1), 100, 1);
      }
      if (option == 1) {
        // It is switched off once the axis stands too, not only its trajectory.
        EXPECT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
        Tick(151);
        EXPECT_LE(std::abs(Read(AXIS_OBJ_VELOCITY_ACTUAL)), 200);
      }
      EXPECT_EQ(State(), after);
      Tick();
      EXPECT_EQ(outputs_.amp_enable, 0);
    }
  }
}

TEST_F(Drive, SlowingDownCanBeCalledOff) {
  Enable(kPv);
  Set(AXIS_OBJ_TARGET_VELOCITY, 15000);
  Tick(200);
  Control(0x07);
  Tick(50);
  Control(kOperate);
  Tick(100);
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
  EXPECT_NEAR(Speed(), 10.0, 1e-4);
}

TEST_F(Drive, TheFaultReactionTakesItsRampAndThenLatches) {
  for (const int option : {0, 1, 2}) {
    PowerUp();
    Set(AXIS_OBJ_FAULT_REACTION_OPTION, option);
    Enable(kPv);
    Set(AXIS_OBJ_TARGET_VELOCITY, 15000);
    Tick(200);
    cia402_owner_lost(&fw_.drive, &fw_.axis, AXIS_FAULT_HEARTBEAT_LOST);
    EXPECT_EQ(Read(AXIS_OBJ_ERROR_CODE), 0x8130);
    if (option != 0) {
      EXPECT_EQ(State(), AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE);
      EXPECT_EQ(Status() & 0x4F, 0x0F);
      EXPECT_NEAR(Follow(10.0, 0.0, option == 1 ? 0.1 : 1.0), option == 1 ? 100 : 10, 1);
      Tick(151);
    }
    EXPECT_EQ(State(), AXIS_DRIVE_STATE_FAULT);
    Tick();
    EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_HEARTBEAT_LOST);
    EXPECT_EQ(Read(AXIS_OBJ_ERROR_CODE), 0x8130);
    EXPECT_EQ(outputs_.amp_enable, 0);
    // What was asked for before the fault must be asked for again.
    Control(0x80);
    Enable(kPv);
    Tick(100);
    EXPECT_EQ(Speed(), 0.0);
  }
}

// --- velocity ------------------------------------------------------------------------------------

TEST_F(Drive, ProfileVelocityRamps) {
  Enable(kPv);
  EXPECT_EQ(Status() & kBit12, kBit12);  // speed is 0
  Set(AXIS_OBJ_TRAJECTORY_DECELERATION, 450000);
  Set(AXIS_OBJ_TARGET_VELOCITY, 30000);
  double before = 0.0;
  int ticks = 0;
  for (; Speed() < 19.999; ++ticks) {
    Tick();
    ASSERT_LE(Speed() - before, 0.1);
    before = Speed();
    ASSERT_LT(ticks, 300);
  }
  EXPECT_NEAR(ticks, 200, 1);
  EXPECT_EQ(Read(AXIS_OBJ_VELOCITY_DEMAND), 30000);
  ASSERT_GE(TicksUntil(kReached, kReached, 200), 0);
  EXPECT_NEAR(Read(AXIS_OBJ_VELOCITY_ACTUAL), 30000, 200);
  EXPECT_EQ(Status() & kBit12, 0);
  Set(AXIS_OBJ_TARGET_VELOCITY, -30000);
  Tick(100);
  EXPECT_NEAR(Speed(), 0.0, 0.3);
  Tick(210);
  EXPECT_EQ(Read(AXIS_OBJ_VELOCITY_DEMAND), -30000);
}

TEST_F(Drive, EverySpeedReadsBackAsWritten) {
  Enable(kCsv);
  for (int32_t speed = 0; speed <= 3072000; speed += (speed < 3000) ? 1 : 997) {
    EXPECT_EQ(fx_per_s_from_q16(fx_q16_from_per_s(static_cast<uint32_t>(speed))), speed);
    EXPECT_EQ(fx_per_s_from_q16(-fx_q16_from_per_s(static_cast<uint32_t>(speed))), -speed);
  }
  EXPECT_EQ(fx_q16_from_per_s(3072000), 1 << 27);
}

TEST_F(Drive, VelocityModesStopAtPositionLimits) {
  for (const int mode : {kPv, kCsv}) {
    PowerUp();
    Enable(mode);
    Set(AXIS_OBJ_POSITION_LIMIT_MAX, 2000);
    Set(AXIS_OBJ_TARGET_VELOCITY, 15000);
    Tick(1000);
    EXPECT_EQ(Demand(), 2000);
    Set(AXIS_OBJ_TARGET_VELOCITY, -15000);
    Tick(100);
    EXPECT_LT(Demand(), 1500);
  }
}

TEST_F(Drive, CyclicVelocityActsAtOnce) {
  Enable(kCsv);
  Set(AXIS_OBJ_TARGET_VELOCITY, 15000);
  Tick();
  EXPECT_EQ(Read(AXIS_OBJ_VELOCITY_DEMAND), 15000);
  EXPECT_EQ(Status() & kBit12, kBit12);
  Control(kOperate | kHalt);
  Tick();
  EXPECT_EQ(Status() & kBit12, 0);
  Set(AXIS_OBJ_VELOCITY_MAX, 1500);
  Control(kOperate);
  Tick(300);
  EXPECT_EQ(Read(AXIS_OBJ_VELOCITY_DEMAND), 1500);
  EXPECT_EQ(Status() & kLimit, kLimit);
}

// --- cyclic position -----------------------------------------------------------------------------

TEST_F(Drive, CyclicPositionInterpolates) {
  place_ = 1000;
  Enable(kCsp);
  EXPECT_EQ(Demand(), 1000);              // holds until a target is written
  Set(AXIS_OBJ_INTERPOLATION_PERIOD, 2);  // ms: 3 ticks
  int32_t target = 1000;
  for (int i = 0; i < 50; ++i) {
    const int32_t from = target;
    target += 7 * (i % 5) - 9;
    Set(AXIS_OBJ_TARGET_POSITION, target);
    for (int k = 1; k <= 3; ++k) {
      Tick();
      EXPECT_NEAR(Demand(), from + (target - from) * k / 3.0, 0.51);
    }
    EXPECT_EQ(fw_.drive.trajectory.position_q32, fx_q32_from_cnt(target));
  }
  Tick(5);
  EXPECT_EQ(Demand(), target);
  Set(AXIS_OBJ_INTERPOLATION_PERIOD, 0);
  Set(AXIS_OBJ_TARGET_POSITION, target + 40);
  Tick();
  EXPECT_EQ(Demand(), target + 40);
}

TEST_F(Drive, CyclicPositionIsBoundedInSpeed) {
  Enable(kCsp);
  Set(AXIS_OBJ_VELOCITY_MAX, 3000);
  Set(AXIS_OBJ_TARGET_POSITION, 100000);
  for (int i = 0; i < 100; ++i) {
    Tick();
    ASSERT_LE(Speed(), 2.0);
  }
  EXPECT_EQ(Demand(), 200);
}

TEST_F(Drive, AStaleCyclicTargetDoesNotMoveTheAxis) {
  Enable(kCsp);
  Set(AXIS_OBJ_TARGET_POSITION, 300);
  Tick(100);
  Control(0x07);
  Tick(3);
  place_ = 5000;  // moved by hand
  Tick(30);
  Enable(kCsp);
  Tick(50);
  EXPECT_EQ(Demand(), 5000);
  // One that was written while disabled is pursued.
  Control(0x07);
  Tick(3);
  Set(AXIS_OBJ_TARGET_POSITION, 5100);
  Enable(kCsp);
  Tick(50);
  EXPECT_EQ(Demand(), 5100);
}

// Written for a set-point of profile position, and taken: not for a cyclic mode that comes later.
TEST_F(Drive, ATakenSetpointIsNoCyclicTarget) {
  for (const int mode : {kCsp, static_cast<int>(CIA402_MODE_STIFFNESS)}) {
    PowerUp();
    Enable(kPp);
    MoveTo(300);
    Tick(1000);
    Control(0x07);
    Tick(3);
    place_ = 5000;  // moved by hand
    Tick(30);
    Enable(mode);
    Tick(50);
    EXPECT_EQ(Demand(), 5000) << mode;
  }
}

TEST_F(Drive, PeriodsRoundUpToTicks) {
  EXPECT_EQ(fx_ticks_from_period(1, -3), 2u);
  EXPECT_EQ(fx_ticks_from_period(2, -3), 3u);
  EXPECT_EQ(fx_ticks_from_period(20, -4), 3u);
  EXPECT_EQ(fx_ticks_from_period(200, -5), 3u);
  EXPECT_EQ(fx_ticks_from_period(255, -6), 1u);
  EXPECT_EQ(fx_ticks_from_period(0, -6), 0u);
  EXPECT_EQ(fx_ticks_from_period(3, -2), 45u);
  EXPECT_EQ(fx_ticks_from_period(3, -1), 450u);
  EXPECT_EQ(fx_ticks_from_period(255, 0), 382500u);
}

// --- homing --------------------------------------------------------------------------------------

TEST_F(Drive, HomingShowsItsBitsInOrder) {
  place_ = 1234;
  for (const int method : {35, 37}) {
    Set(AXIS_OBJ_HOMING_METHOD, method);
    Set(AXIS_OBJ_HOME_OFFSET, 500 + method);
    Enable(kHm);
    Tick(3);
    EXPECT_EQ(Status() & 0x3400, 0x0400);
    Control(kNew);
    EXPECT_EQ(Status() & 0x3400, 0x0000);
    Tick();
    EXPECT_EQ(Status() & 0x3400, 0x0000);  // what the next PDO carries
    Tick();
    EXPECT_EQ(Status() & 0x3400, 0x1400);
    EXPECT_EQ(Read(AXIS_OBJ_POSITION_ACTUAL), 500 + method);
    EXPECT_EQ(Read(AXIS_OBJ_POSITION_INTERNAL), 1234);
    Control(kOperate);
    Tick(10);
    EXPECT_EQ(Status() & 0x3400, 0x1400);
    EXPECT_EQ(place_, 1234);
    Control(0x07);
    Tick(2);
  }
  // The origin stays: a move counts from it.
  Enable(kPp);
  MoveTo(0);
  ASSERT_GE(TicksUntil(kReached, kReached, 5000), 0);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_ACTUAL), Read(AXIS_OBJ_POSITION_INTERNAL) - 1234 + 537);
  EXPECT_EQ(Demand(), 0);
}

// The trajectory stands at once, the axis is pushed on: home is where it comes to rest.
TEST_F(Drive, HomingWaitsUntilTheAxisStands) {
  Set(AXIS_OBJ_HOMING_METHOD, 35);
  Set(AXIS_OBJ_HOME_OFFSET, 70);
  Enable(kHm);
  Tick(3);
  for (int i = 0; i < 60; ++i) {
    if (i == 10) Control(kNew);
    place_ += 40;
    Tick();
    ASSERT_EQ(Status() & 0x3000, 0x0000) << i;
  }
  ASSERT_GE(TicksUntil(0x3400, 0x1400, 500), 0);
  EXPECT_LE(std::abs(Read(AXIS_OBJ_VELOCITY_ACTUAL)), Read(AXIS_OBJ_VELOCITY_THRESHOLD));
  EXPECT_NEAR(Read(AXIS_OBJ_POSITION_ACTUAL), 70, 2);
}

TEST_F(Drive, HomingWithoutAMethodIsAnError) {
  Set(AXIS_OBJ_HOMING_METHOD, 0);
  Enable(kHm);
  Control(kNew);
  Tick(2);
  EXPECT_EQ(Status() & 0x3400, 0x2000);
}

// --- polarity ------------------------------------------------------------------------------------

// A target that was written before means the other way now.
TEST_F(Drive, PolarityTakesTargetsBack) {
  Set(AXIS_OBJ_TARGET_VELOCITY, 3000);
  Set(AXIS_OBJ_POLARITY, 0x40);
  Enable(kPv);
  Tick(50);
  EXPECT_EQ(Speed(), 0.0);
  Set(AXIS_OBJ_TARGET_VELOCITY, 3000);
  Tick(50);
  EXPECT_EQ(Speed(), -2.0);
}

TEST_F(Drive, PolarityNegatesTheWire) {
  place_ = 100;
  Set(AXIS_OBJ_POLARITY, 0xC0);
  Enable(kPp);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_ACTUAL), -100);
  MoveTo(400);
  Tick(50);
  EXPECT_GT(Read(AXIS_OBJ_VELOCITY_DEMAND), 0);
  EXPECT_LT(Speed(), 0.0);
  ASSERT_GE(TicksUntil(kReached, kReached, 5000), 0);
  EXPECT_EQ(Demand(), 400);
  EXPECT_NEAR(place_, -400, 11);
  Set(AXIS_OBJ_MODES_OF_OPERATION, kPv);
  Set(AXIS_OBJ_POSITION_LIMIT_MAX, 1000);
  Set(AXIS_OBJ_TARGET_VELOCITY, 3000);
  Tick(2000);
  EXPECT_EQ(Demand(), 1000);
  EXPECT_NEAR(place_, -1000, 11);
}

// --- following error -----------------------------------------------------------------------------

TEST_F(Drive, TheFollowingErrorFaultsAfterItsTimeout) {
  Enable(kCsp);
  Set(AXIS_OBJ_FOLLOWING_ERROR_WINDOW, 100);
  Set(AXIS_OBJ_FOLLOWING_ERROR_TIMEOUT, 20);  // 30 ticks
  stuck_ = true;
  Set(AXIS_OBJ_TARGET_POSITION, 100);
  Tick(100);
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
  EXPECT_EQ(Read(AXIS_OBJ_FOLLOWING_ERROR), 100);
  Set(AXIS_OBJ_TARGET_POSITION, 101);
  Tick();  // outside from here on
  Tick(30);
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
  EXPECT_EQ(Status() & kBit13, kBit13);
  Tick();
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_FAULT);
  EXPECT_EQ(outputs_.amp_enable, 0);
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_FOLLOWING_ERROR);
  EXPECT_EQ(Read(AXIS_OBJ_ERROR_CODE), 0x8611);
}

// --- force ---------------------------------------------------------------------------------------

// 1000 per mille are 100 N, a count of the reading 2.5 N: 40 counts.
TEST_F(Drive, TheForceModeApproachesSlowlyAndPresses) {
  for (const int mode : {kTq, kCst}) {
    PowerUp();
    wall_ = 400;
    Enable(mode);
    Tick(50);
    EXPECT_EQ(place_, 0.0);
    EXPECT_EQ(Status() & kReached, kReached);  // no force is wanted
    Set(AXIS_OBJ_TARGET_FORCE, 750);           // 30 counts
    double fastest = 0.0;
    int ticks = 0;
    for (; Read(AXIS_OBJ_CONTACT) == 0 && ticks < 1000; ++ticks) {
      const double from = place_;
      Tick();
      ASSERT_LE(Speed(), 2.0);
      if (Read(AXIS_OBJ_CONTACT) == 0) {
        fastest = std::max(fastest, place_ - from);
      }
    }
    EXPECT_LE(fastest, 2.2);
    EXPECT_NEAR(ticks, 215, 30);  // 400 counts at 2 a tick
    EXPECT_EQ(Status() & kReached, 0);
    Tick(1000);
    EXPECT_NEAR(Read(AXIS_OBJ_FORCE_ACTUAL), 750, 26);
    EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), 750);
    EXPECT_EQ(Status() & kReached, kReached);
    EXPECT_EQ(Read(AXIS_OBJ_CONTACT_LOSSES), 0);
    EXPECT_NEAR(Read(AXIS_OBJ_FORCE_PEAK), 30 * 256, 4 * 256);
    // Halted, it lets go and then stays.
    Control(kOperate | kHalt);
    Tick(1500);
    EXPECT_LT(Read(AXIS_OBJ_FORCE_ACTUAL), 60);
    EXPECT_EQ(Status() & kReached, kReached);
    EXPECT_GT(place_, 380);
  }
}

TEST_F(Drive, LosingTheContactNeverRunsAway) {
  wall_ = 400;
  Enable(kTq);
  Set(AXIS_OBJ_TARGET_FORCE, 750);
  Tick(1200);
  ASSERT_EQ(Read(AXIS_OBJ_CONTACT), 1);
  wall_ = 1e6;  // the workpiece is pulled away
  Tick();       // the force law sees no force yet
  for (int i = 0; i < 300; ++i) {
    const double from = place_;
    Tick();
    ASSERT_LE(place_ - from, 2.2) << i;
    ASSERT_LE(Speed(), 2.0);
  }
  EXPECT_EQ(Read(AXIS_OBJ_CONTACT_LOSSES), 1);
  EXPECT_EQ(Read(AXIS_OBJ_BUMP_DECAY_SHIFT), 6);
}

TEST_F(Drive, AnAxisHeldUpDuringTheApproachDoesNotLurch) {
  Enable(kTq);
  stuck_ = true;
  Set(AXIS_OBJ_TARGET_FORCE, 750);
  Tick(3000);
  // A quarter second of approach, 16 counts, and the way of the ramp: 2^2 / (2 x 0.1).
  EXPECT_LE(Demand(), 750 + 16 + 21);
}

TEST_F(Drive, LimitCyclesAreNamed) {
  Enable(kTq);
  Set(AXIS_OBJ_TARGET_FORCE, 750);
  Set(AXIS_OBJ_LIMIT_CYCLE_LOSSES, 4);
  for (int i = 0; i < 4; ++i) {
    EXPECT_EQ(Read(AXIS_OBJ_LIMIT_CYCLE), 0);
    wall_ = place_ - 100;
    Tick(2);
    wall_ = 1e9;
    Tick(2);
    EXPECT_EQ(Read(AXIS_OBJ_CONTACT_LOSSES), i + 1);
  }
  EXPECT_EQ(Read(AXIS_OBJ_LIMIT_CYCLE), 1);
  EXPECT_NE(Status() & 0x80, 0);
  Tick(1390);
  EXPECT_EQ(Read(AXIS_OBJ_LIMIT_CYCLE), 1);
  Tick(110);
  EXPECT_EQ(Read(AXIS_OBJ_LIMIT_CYCLE), 0);
}

TEST_F(Drive, AForceReadingAtItsEndIsTold) {
  Enable(kTq);
  wall_ = -1000;
  Tick();
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_SATURATED), 1);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_RAW), 255);
}

TEST_F(Drive, TheForceLimitBoundsTheTarget) {
  wall_ = 100;
  Enable(kTq);
  Set(AXIS_OBJ_FORCE_LIMIT, 500);
  Set(AXIS_OBJ_TARGET_FORCE, 900);
  Tick(2000);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), 500);
  EXPECT_EQ(Status() & kLimit, kLimit);
  EXPECT_NEAR(Read(AXIS_OBJ_FORCE_ACTUAL), 500, 26);
}

TEST_F(Drive, RatiosOfForcesAreExactEnough) {
  const struct {
    uint32_t a, b;
    int8_t e;
    int32_t x, value;
  } rows[] = {{100000, 2500000, 8, 1000, 10240},
              {2500000, 100000, -8, 10240, 1000},
              {1, 2147483647, -8, INT32_MAX, 0},
              {2147483647, 1, 8, 1, INT32_MAX},
              {1, 1, 0, -12345, -12345},
              {3, 1, 0, 7, 21},
              {1, 3, 0, 300000000, 100000000},
              {1, 2, 0, 3, 2},
              {1, 2, 0, -3, -2},
              {7, 5, 2, 100, 560}};
  for (const auto &row : rows) {
    EXPECT_EQ(fx_ratio_apply(row.x, fx_ratio(row.a, row.b, row.e), 0), row.value)
        << row.a << " / " << row.b;
  }
}

TEST_F(Drive, TheGuardedMoveStopsAtTheWorkpiece) {
  wall_ = 1000;
  Enable(-5);
  Set(AXIS_OBJ_TRAJECTORY_VELOCITY, 3000);
  MoveTo(5000);
  ASSERT_GE(TicksUntil(kReached, kReached, 3000), 0);
  Tick(500);
  EXPECT_NEAR(place_, 1005, 10);
  EXPECT_EQ(Read(AXIS_OBJ_CONTACT), 1);
  MoveTo(5000);  // refused by the workpiece
  Tick(100);
  EXPECT_NEAR(place_, 1005, 10);
  MoveTo(200);  // away is free
  ASSERT_GE(TicksUntil(kReached, kReached, 3000), 0);
  EXPECT_EQ(Demand(), 200);
}

TEST_F(Drive, StiffnessIsASpring) {
  // 1/2 count of force per encoder count: pressed by 60 counts of way, the axis gives 30 of force.
  wall_ = 100;
  stiffness_ = 0.5;
  Set(AXIS_OBJ_STIFFNESS, 32768);
  Set(AXIS_OBJ_DAMPING, 0);
  Enable(-6);
  Set(AXIS_OBJ_TRAJECTORY_VELOCITY, 3000);
  Tick(10);
  EXPECT_EQ(place_, 0.0);
  Set(AXIS_OBJ_TARGET_POSITION, 180);
  Tick(3000);
  // Equilibrium: 0.5 (180 - x) = 0.5 (x - 100), x = 140, force 20 counts.
  EXPECT_NEAR(place_, 140, 3);
  EXPECT_NEAR(Read(AXIS_OBJ_FORCE) / 256.0, 20, 2);
  EXPECT_NEAR(Read(AXIS_OBJ_FORCE_DEMAND), 500, 50);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_SETPOINT), 0);
}

TEST_F(Drive, DampingFollowsASpeedAndYields) {
  Set(AXIS_OBJ_DAMPING, 5 * 256);  // 5 counts of force per count a tick
  Enable(-7);
  Set(AXIS_OBJ_TARGET_VELOCITY, 3000);
  Tick(600);
  // Free: code = 5 x 5 (2 - v) and v = 0.02 code, so v = 2/3 a tick.
  const double from = place_;
  Tick(150);
  EXPECT_NEAR((place_ - from) / 150, 2.0 / 3.0, 0.1);
}

TEST_F(Drive, ImpedanceIsBoth) {
  wall_ = 100;
  Set(AXIS_OBJ_STIFFNESS, 32768);
  Set(AXIS_OBJ_DAMPING, 5 * 256);
  Enable(-8);
  Set(AXIS_OBJ_TARGET_POSITION, 180);
  Tick(4000);
  EXPECT_NEAR(place_, 140, 4);
}

// --- native modes and changes --------------------------------------------------------------------

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

// --- everything at random ------------------------------------------------------------------------

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
  int powered_ticks = 0;
  int in_mode[19] = {};
  int in_state[8] = {};
  for (int step = 0; step < 1000000; ++step) {
    switch (pick(0, 15)) {
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
          inputs_.din = AXIS_DIN_ENABLE;
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
    inputs_.sensor_valid = pick(0, 5000) != 0;
    const int state = State();
    const int tracking = fw_.drive.tracking;
    const double speed = Speed();
    Tick();
    const int now = State();
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
  for (int state = 1; state < 8; ++state) {
    EXPECT_GT(in_state[state], 1000) << state;
  }
  for (const int mode : {1, 3, 4, 6, 8, 9, 10, 0, -1, -2, -3, -4, -5, -6, -7, -8}) {
    EXPECT_GT(in_mode[mode + 8], 100) << mode;
  }
}

}  // namespace
