// Halt, quick stop and the options that choose a ramp.

#include <gtest/gtest.h>

#include <cstdint>
#include <cstdlib>

#include "tests/unit/cia402_fixture.hpp"

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

// A deceleration near 0 with no master left: the reaction's own time limit ends it.
TEST_F(Drive, AFaultReactionEnds) {
  Set(AXIS_OBJ_FAULT_REACTION_OPTION, 1);
  Set(AXIS_OBJ_TRAJECTORY_DECELERATION, 40);
  Enable(kPv);
  Set(AXIS_OBJ_TARGET_VELOCITY, 15000);
  Tick(200);
  cia402_owner_lost(&fw_.drive, &fw_.axis, AXIS_FAULT_HEARTBEAT_LOST);
  EXPECT_EQ(dictionary_check(&fw_.objects, FW_SOURCE_LOCAL, AXIS_OBJ_MODE, AXIS_MODE_POSITION),
            FW_ERROR_STATE);
  Tick(14999);
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE);
  EXPECT_GT(Speed(), 9.0);
  Tick();
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_FAULT);
  EXPECT_EQ(outputs_.amp_enable, 0);
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_HEARTBEAT_LOST);
}

// Each quick stop has its own 10 s: 15000 ticks of 1/1500 s, independent of earlier ones.
TEST_F(Drive, EveryQuickStopHasItsWholeTime) {
  Set(AXIS_OBJ_QUICK_STOP_OPTION, 1);
  Set(AXIS_OBJ_TRAJECTORY_DECELERATION, 40);  // 15000 count/s would take 375 s
  for (int stop = 0; stop < 2; ++stop) {
    Enable(kPv);
    Set(AXIS_OBJ_TARGET_VELOCITY, 15000);
    Tick(200);
    Control(0x02);
    Tick(14999);
    ASSERT_EQ(State(), AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE) << "stop " << stop;
    Tick();
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
  Enable(kPv);
  Set(AXIS_OBJ_TARGET_VELOCITY, 15000);
  Tick(200);
  Control(0x02);
  Tick(14000);
  Control(kOperate);
  Tick();
  ASSERT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
  Set(AXIS_OBJ_QUICK_STOP_OPTION, 1);
  Tick(200);
  Control(0x02);
  Tick(14999);
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE);
  Tick();
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_SWITCH_ON_DISABLED);
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
  Enable(kPv);
  Set(AXIS_OBJ_TARGET_VELOCITY, 15000);
  Tick(200);
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
