// Halt, quick stop and the options that choose a ramp.

#include <gtest/gtest.h>

#include <cstdint>
#include <cstdlib>

#include "tests/firmware/unit/cia402_fixture.hpp"

namespace {

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

// An axis that something else keeps moving is switched off 100 ms, 150 ticks, after its trajectory
// stands.
TEST_F(Drive, SlowingDownWaitsForAnAxisThatDoesNotStand) {
  Set(AXIS_OBJ_DISABLE_OPERATION_OPTION, 1);
  Set(AXIS_OBJ_FOLLOWING_ERROR_WINDOW, -1);  // the largest: off
  Enable(kPp);
  stuck_ = true;
  for (int i = -20; i < 150; ++i) {
    if (i == 0) Control(0x07);
    place_ += 40;
    ASSERT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED) << i;
    Tick();
  }
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_SWITCHED_ON);
}

TEST_F(Drive, DisableOperationAndShutdownSlowDownIfAsked) {
  for (const int command : {0x07, 0x06}) {
    for (const int option : {0, 1}) {
      PowerUp();
      Set(AXIS_OBJ_SHUTDOWN_OPTION, option);
      Set(AXIS_OBJ_DISABLE_OPERATION_OPTION, option);
      EnableAtSpeed();
      Control(command);
      const int after =
          command == 7 ? AXIS_DRIVE_STATE_SWITCHED_ON : AXIS_DRIVE_STATE_READY_TO_SWITCH_ON;
      if (option == 1) {
        EXPECT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
        EXPECT_NEAR(Follow(10.0, 0.0, 0.1), 100, 1);
      }
      if (option == 1) {
        // It is switched off when the axis itself is at rest, not only its trajectory.
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
  EnableAtSpeed();
  Control(0x07);
  Tick(50);
  Control(kOperate);
  Tick(100);
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
  EXPECT_NEAR(Speed(), 10.0, 1e-4);
}

// With the option to continue, an axis that lost its owner keeps its last command.
TEST_F(Drive, AnAxisThatContinuesKeepsItsTarget) {
  Set(AXIS_OBJ_ABORT_CONNECTION_OPTION, 0);
  Enable(kPv);
  Set(AXIS_OBJ_TARGET_VELOCITY, 3000);
  Tick(100);
  cia402_owner_lost(&fw_.drive, &fw_.axis, AXIS_FAULT_SOURCE_LOST);
  Tick(100);
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
  EXPECT_EQ(Speed(), 2.0);
}

// A deceleration near 0 with no master left: the reaction is a ramp of 10 s, its end included.
TEST_F(Drive, AFaultReactionEnds) {
  Set(AXIS_OBJ_FAULT_REACTION_OPTION, 1);
  Set(AXIS_OBJ_TRAJECTORY_DECELERATION, 40);
  EnableAtSpeed();
  cia402_owner_lost(&fw_.drive, &fw_.axis, AXIS_FAULT_HEARTBEAT_LOST);
  EXPECT_EQ(dictionary_check(&fw_.objects, FW_SOURCE_LOCAL, AXIS_OBJ_MODE, AXIS_MODE_POSITION),
            FW_ERROR_STATE);
  Tick(14000);
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE);
  EXPECT_GT(Speed(), 0.0);
  EXPECT_LT(Speed(), 10.0 / 15) << "of 10 counts a tick";
  Tick(1000);
  EXPECT_EQ(Speed(), 0.0) << "not switched off at speed";
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_FAULT);
  EXPECT_EQ(outputs_.amp_enable, 0);
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_HEARTBEAT_LOST);
}

// Each quick stop has its own 10 s: 15000 ticks of 1/1500 s, independent of earlier ones.
TEST_F(Drive, EveryQuickStopHasItsWholeTime) {
  Set(AXIS_OBJ_QUICK_STOP_OPTION, 1);
  Set(AXIS_OBJ_TRAJECTORY_DECELERATION, 40);  // 15000 count/s would take 375 s
  for (int stop = 0; stop < 2; ++stop) {
    EnableAtSpeed();
    Control(0x02);
    Tick(14000);
    ASSERT_EQ(State(), AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE) << "stop " << stop;
    Tick(1000);
    ASSERT_EQ(State(), AXIS_DRIVE_STATE_SWITCH_ON_DISABLED) << "stop " << stop;
    stuck_ = true;  // the axis does not coast into the next one
    Tick(50);
    stuck_ = false;
  }
}

// Two in succession without a standstill between them, with options that resume.
TEST_F(Drive, AQuickStopThatIsResumedDoesNotShortenTheNext) {
  Set(AXIS_OBJ_QUICK_STOP_OPTION, 5);
  Set(AXIS_OBJ_TRAJECTORY_DECELERATION, 40);
  EnableAtSpeed();
  Control(0x02);
  Tick(14000);
  Control(kOperate);
  Tick();
  ASSERT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
  Set(AXIS_OBJ_QUICK_STOP_OPTION, 1);
  Tick(200);
  Control(0x02);
  Tick(14000);
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE);
  Tick(1000);
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_SWITCH_ON_DISABLED);
}

// As reported: 6084h = 35 and 15,000 count/s, which would take minutes. Every ramp to a stand ends
// within 10 s = 15,000 ticks and within speed x 5 s = 75,000 counts.
TEST_F(Drive, EveryRampToAStandEndsInTimeAndWithinItsWay) {
  enum { kDisable, kShutdown, kHaltSlow, kHaltQuick, kOtherMode, kStops };
  for (int how = kDisable; how < kStops; ++how) {
    PowerUp();
    Set(AXIS_OBJ_VELOCITY_THRESHOLD, 100);
    Enable(kPv);
    Set(AXIS_OBJ_TARGET_VELOCITY, 15000);
    Tick(1000);
    ASSERT_NEAR(Speed(), 10.0, 1e-3);
    Set(AXIS_OBJ_TRAJECTORY_DECELERATION, 35);
    Set(AXIS_OBJ_QUICK_STOP_DECELERATION, 35);
    Set(AXIS_OBJ_HALT_OPTION, how == kHaltQuick ? 2 : 1);
    Set(AXIS_OBJ_DISABLE_OPERATION_OPTION, 1);
    Set(AXIS_OBJ_SHUTDOWN_OPTION, 1);
    const double from = place_;
    switch (how) {
      case kDisable:
        Control(0x07);
        break;
      case kShutdown:
        Control(0x06);
        break;
      case kOtherMode:
        Set(AXIS_OBJ_MODES_OF_OPERATION, kPp);
        break;
      default:
        Control(kOperate | kHalt);
        break;
    }
    Tick(7000);
    EXPECT_GT(Speed(), 4.0) << how << ": no faster than it must";
    Tick(8000);
    EXPECT_EQ(Speed(), 0.0) << how;
    EXPECT_LE(place_ - from, 75000) << how;
    const double stands = place_;
    Tick(500);
    EXPECT_NEAR(place_, stands, 2) << how;
    if (how == kDisable) {
      EXPECT_EQ(State(), AXIS_DRIVE_STATE_SWITCHED_ON);
    }
    if (how == kShutdown) {
      EXPECT_EQ(State(), AXIS_DRIVE_STATE_READY_TO_SWITCH_ON);
    }
    if (how == kOtherMode) {
      EXPECT_EQ(Mode(), kPp);
    }
  }
}

// Mode 4 halts itself: the approach, and the release of a force.
TEST_F(Drive, AHaltOfTheForceModeEndsInTimeToo) {
  Set(AXIS_OBJ_APPROACH_VELOCITY_MAX, 15000);
  Enable(kTq);
  Set(AXIS_OBJ_TARGET_FORCE, 750);
  Tick(500);
  ASSERT_NEAR(Speed(), 10.0, 1e-3);
  Set(AXIS_OBJ_TRAJECTORY_DECELERATION, 35);
  const double from = place_;
  Control(kOperate | kHalt);
  Tick(15000);
  EXPECT_EQ(Speed(), 0.0);
  EXPECT_LE(place_ - from, 75000);
  Control(kOperate);
  wall_ = place_ + 200;
  Tick(1500);
  ASSERT_NEAR(Read(AXIS_OBJ_FORCE_ACTUAL), 750, 40);
  Set(AXIS_OBJ_FORCE_SLOPE, 1);  // per mille/s: 750 s
  Control(kOperate | kHalt);
  Tick(7000);
  EXPECT_GT(Read(AXIS_OBJ_FORCE_DEMAND), 300);
  Tick(8000);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), 0);
}

// A steeper deceleration is the ramp's own.
TEST_F(Drive, ARampThatEndsInTimeIsNotMadeSteeper) {
  Enable(kPv);
  Set(AXIS_OBJ_TARGET_VELOCITY, 15000);
  Tick(1000);
  Set(AXIS_OBJ_TRAJECTORY_DECELERATION, 3000);  // 5 s
  Control(0x07);
  Tick(3750);
  EXPECT_NEAR(Speed(), 5.0, 0.05);
}

// A halt that another gave: 0080h commands nothing, so the axis stays; then 000Fh lets it go on.
TEST_F(Drive, AHaltIsLiftedByAControlwordThatEnablesAlone) {
  for (const int word : {0x80, 0x8F, 0x87, 0xFF & ~kHalt}) {
    PowerUp();
    Enable(kPv);
    Set(AXIS_OBJ_TARGET_VELOCITY, 3000);
    Tick(100);
    cia402_stop(&fw_.drive, &fw_.axis, kOperate | kHalt);
    Tick(200);
    ASSERT_EQ(Speed(), 0.0);
    for (int i = 0; i < 3; ++i) {
      Control(word);
      Tick(100);
      EXPECT_EQ(Speed(), 0.0) << std::hex << word;
      EXPECT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
    }
    Control(kOperate);
    Tick(100);
    EXPECT_EQ(Speed(), 2.0) << std::hex << word;
  }
}

// Enabled and stopped before a tick: nothing is powered, not even for a ramp.
TEST_F(Drive, WhatIsStoppedBeforeItsFirstTickIsNeverPowered) {
  for (int how = 0; how < 5; ++how) {
    PowerUp();
    Set(AXIS_OBJ_FAULT_REACTION_OPTION, 1);
    Set(AXIS_OBJ_ABORT_CONNECTION_OPTION, how == 4 ? 3 : 1);
    Set(AXIS_OBJ_QUICK_STOP_OPTION, how == 1 ? 6 : 2);
    Set(AXIS_OBJ_MODES_OF_OPERATION, kPv);
    Tick(2);
    Control(0x06);
    Control(0x0F);
    ASSERT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
    switch (how) {
      case 0:
      case 1:
        Control(0x02);
        break;
      case 2:
        cia402_stop(&fw_.drive, &fw_.axis, 0x02);
        break;
      default:
        cia402_owner_lost(&fw_.drive, &fw_.axis, AXIS_FAULT_SOURCE_LOST);
        break;
    }
    for (int i = 0; i < 5; ++i) {
      Tick();
      ASSERT_EQ(outputs_.amp_enable, 0) << how;
    }
    EXPECT_EQ(State(), how == 3 ? AXIS_DRIVE_STATE_FAULT : AXIS_DRIVE_STATE_SWITCH_ON_DISABLED);
  }
}

TEST_F(Drive, TheFaultReactionTakesItsRampAndThenLatches) {
  for (const int option : {0, 1, 2}) {
    PowerUp();
    Set(AXIS_OBJ_FAULT_REACTION_OPTION, option);
    EnableAtSpeed();
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
    // A command from before the fault must be repeated.
    Control(0x80);
    Enable(kPv);
    Tick(100);
    EXPECT_EQ(Speed(), 0.0);
  }
}

// Native mode disabled cuts the ramp of a fault reaction short: off in the next tick, and the fault
// that the reaction was for is latched by name.
TEST_F(Drive, NativeModeDisabledEndsAFaultReactionInItsFault) {
  Set(AXIS_OBJ_FAULT_REACTION_OPTION, 1);
  Set(AXIS_OBJ_TRAJECTORY_DECELERATION, 40);
  EnableAtSpeed();
  cia402_owner_lost(&fw_.drive, &fw_.axis, AXIS_FAULT_HEARTBEAT_LOST);
  Tick(10);
  ASSERT_EQ(State(), AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE);
  Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
  Tick();
  EXPECT_EQ(outputs_.amp_enable, 0);
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_FAULT);
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_HEARTBEAT_LOST);
  EXPECT_EQ(Read(AXIS_OBJ_ERROR_CODE), 0x8130);
  EXPECT_EQ(Write(AXIS_OBJ_MODE, AXIS_MODE_POSITION), FW_ERROR_STATE) << "not before a reset";
}

}  // namespace
