// Profile position, cyclic position, homing, and what bounds them.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>

#include "tests/firmware/unit/cia402_fixture.hpp"

namespace {

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
  EXPECT_EQ(Status() & kBit12, kBit12);  // 900 is queued behind 500: no room
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
      if (std::abs(Demand() - 1000) > 4) {
        ASSERT_EQ(Status() & kBit12, Demand() < 1000 ? kBit12 : 0)
            << "room once the first is passed";
      }
    }
    EXPECT_EQ(slowest, blend ? 2.0 : 0.0);
    ASSERT_GE(TicksUntil(kReached, kReached, 5000), 0);
    EXPECT_EQ(Demand(), 2000);
  }
}

// Both set-points, the active one and the queued one, are discarded when the mode is left.
TEST_F(Drive, LeavingProfilePositionDropsItsSetpoints) {
  Enable(kPp);
  MoveTo(500);
  MoveTo(900);
  ASSERT_EQ(Status() & kBit12, kBit12);
  Tick(50);
  Control(0x07);
  Tick(400);
  ASSERT_EQ(State(), AXIS_DRIVE_STATE_SWITCHED_ON);
  Enable(kPp);
  const int32_t here = Demand();
  ASSERT_LT(here, 400);
  EXPECT_EQ(Status() & kBit12, 0) << "there is room";
  Tick(500);
  EXPECT_EQ(Demand(), here);
  MoveTo(here + 100);
  EXPECT_EQ(Status() & kBit12, 0) << "taken, and room behind it";
  Tick(1500);
  EXPECT_EQ(Demand(), here + 100);
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
  // One that was written while disabled becomes active.
  Control(0x07);
  Tick(3);
  Set(AXIS_OBJ_TARGET_POSITION, 5100);
  Enable(kCsp);
  Tick(50);
  EXPECT_EQ(Demand(), 5100);
}

// A target that profile position has accepted as a set-point is none of a later cyclic mode.
TEST_F(Drive, AnAcceptedSetpointIsNoCyclicTarget) {
  for (const int mode : {kCsp, static_cast<int>(AXIS_MODES_OF_OPERATION_STIFFNESS)}) {
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

// A target from before a halt moves nothing after it; the next one does.
TEST_F(Drive, AHaltDropsTheCyclicTarget) {
  Enable(kCsp);
  Set(AXIS_OBJ_VELOCITY_MAX, 3000);  // 2 counts a tick
  Set(AXIS_OBJ_TARGET_POSITION, 10000);
  Tick(100);
  ASSERT_EQ(Demand(), 200);
  Control(kOperate | kHalt);
  Tick(300);
  const int32_t stopped = Demand();
  EXPECT_GT(stopped, 200);
  EXPECT_LT(stopped, 300);
  Control(kOperate);
  Tick(300);
  EXPECT_EQ(Demand(), stopped) << "the target from before the halt";
  Set(AXIS_OBJ_TARGET_POSITION, 10000);
  Tick(100);
  EXPECT_EQ(Demand(), stopped + 200);
}

// Without a target cyclic position brakes to a stand by the profile's deceleration, here 0.1 count
// a tick squared from where the halt left off, and stays there.
TEST_F(Drive, CyclicPositionWithoutATargetBrakesToAStand) {
  Enable(kCsp);
  Set(AXIS_OBJ_VELOCITY_MAX, 3000);  // 2 counts a tick
  Set(AXIS_OBJ_TARGET_POSITION, 10000);
  Tick(100);
  Control(kOperate | kHalt);
  Tick(3);
  ASSERT_NEAR(Speed(), 1.7, 1e-3);
  Control(kOperate);
  EXPECT_NEAR(Follow(1.7, 0.0, 0.1), 17, 1);
  const int32_t stopped = Demand();
  EXPECT_GT(stopped, 200);
  for (int i = 0; i < 1000; ++i) {
    Tick();
    ASSERT_EQ(Speed(), 0.0) << i;
  }
  EXPECT_EQ(Demand(), stopped);
}

// The same for the target of a mode with a position reference, once that mode is left.
TEST_F(Drive, LeavingAModeDropsItsTarget) {
  for (const int from : {-6, -8, kCsp}) {
    for (const int to : {kCsp, -6, -8}) {
      PowerUp();
      Set(AXIS_OBJ_STIFFNESS, 32768);
      Set(AXIS_OBJ_DAMPING, 5 * 256);
      Enable(from);
      Set(AXIS_OBJ_TARGET_POSITION, 400);
      Tick(2000);
      ASSERT_NEAR(place_, 400, 11) << from;
      Control(0x07);
      Tick(200);
      place_ = 5000;  // moved by hand
      Tick(30);
      Enable(to);
      Tick(500);
      EXPECT_EQ(Demand(), 5000) << from << " to " << to;
      EXPECT_NEAR(place_, 5000, 1) << from << " to " << to;
    }
  }
}

// The same from mode to mode while enabled.
TEST_F(Drive, LeavingImpedanceWhileEnabledDropsItsTarget) {
  for (const int from : {-6, -8}) {
    PowerUp();
    Set(AXIS_OBJ_STIFFNESS, 32768);
    Set(AXIS_OBJ_DAMPING, 5 * 256);
    stuck_ = true;  // a spring under tension
    Enable(from);
    Set(AXIS_OBJ_TARGET_POSITION, 400);
    Tick(500);
    Set(AXIS_OBJ_MODES_OF_OPERATION, kCsp);
    Tick(200);
    ASSERT_EQ(Mode(), kCsp);
    stuck_ = false;
    Tick(500);
    EXPECT_NEAR(place_, 0, 1) << from;
  }
}

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

// The trajectory stops at once, the axis is pushed on: home is where it comes to rest.
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

// An axis that moves when it is enabled is braked: 10 counts a tick by 0.1 in each, 99 ticks after
// the first, 9.8 + 9.7 + ... = 485 counts.
TEST_F(Drive, HomingAndNoModeBrakeAnAxisThatMoves) {
  for (const int mode : {kHm, 0}) {
    PowerUp();
    Set(AXIS_OBJ_MODES_OF_OPERATION, mode);
    for (int i = 0; i < 20; ++i) {
      place_ += 10;
      Tick();
    }
    for (const int command : {0x06, 0x07, 0x0F}) Control(command);
    Tick();
    ASSERT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
    ASSERT_NEAR(Speed(), 9.9, 1e-4);
    const int32_t from = Demand();
    EXPECT_NEAR(Follow(10.0, 0.0, 0.1), 99, 1) << mode;
    EXPECT_NEAR(Demand() - from, 485, 2) << mode;
  }
}

// A target from before homing refers to another origin and is discarded; a later one acts.
TEST_F(Drive, HomingDropsTheCyclicTarget) {
  for (const bool again : {false, true}) {
    PowerUp();
    place_ = 1234;
    Set(AXIS_OBJ_HOMING_METHOD, 35);
    Set(AXIS_OBJ_HOME_OFFSET, 50);
    Enable(kHm);
    Set(AXIS_OBJ_TARGET_POSITION, 300);
    Tick(3);
    Control(kNew);
    Tick(5);
    ASSERT_EQ(Status() & 0x3400, 0x1400) << "homed";
    if (again) Set(AXIS_OBJ_TARGET_POSITION, 300);
    Set(AXIS_OBJ_MODES_OF_OPERATION, kCsp);
    Tick(300);
    ASSERT_EQ(Mode(), kCsp);
    EXPECT_EQ(Demand(), again ? 300 : 50);
  }
}

TEST_F(Drive, HomingWithoutAMethodIsAnError) {
  Set(AXIS_OBJ_HOMING_METHOD, 0);
  Enable(kHm);
  Control(kNew);
  Tick(2);
  EXPECT_EQ(Status() & 0x3400, 0x2400) << "an error, and it stands";
}

// A target written before the change has the opposite direction now and is discarded.
TEST_F(Drive, PolarityDropsTargets) {
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

}  // namespace
