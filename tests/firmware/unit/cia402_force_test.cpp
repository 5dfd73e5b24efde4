// Force, guarded move, stiffness and damping.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>

#include "tests/firmware/unit/cia402_fixture.hpp"

namespace {

// 1000 per mille are 100 N, a count of the reading 2.5 N: 40 counts.
TEST_F(Drive, TheForceModeApproachesSlowlyAndPresses) {
  for (const int mode : {kTq, kCst}) {
    PowerUp();
    wall_ = 400;
    Enable(mode);
    Tick(50);
    EXPECT_EQ(place_, 0.0);
    EXPECT_EQ(Status() & kReached, kReached);  // the target force is 0
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
    // Halted, the axis releases the force and then stays.
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
  Tick();       // the force law reads no force yet
  for (int i = 0; i < 300; ++i) {
    const double from = place_;
    Tick();
    ASSERT_LE(place_ - from, 2.2) << i;
    ASSERT_LE(Speed(), 2.0);
  }
  EXPECT_EQ(Read(AXIS_OBJ_CONTACT_LOSSES), 1);
  EXPECT_EQ(Read(AXIS_OBJ_BUMP_DECAY_SHIFT), 6);
}

// The law goes on for contact_loss_dwell, its pressing capped; only then the axis approaches.
TEST_F(Drive, AfterALossTheLawGoesOnWithItsPressingCapped) {
  for (const int cap : {0, 12, 2048}) {
    PowerUp();
    Set(AXIS_OBJ_CONTACT_LOSS_DWELL, 200);  // 300 ticks
    Set(AXIS_OBJ_CONTACT_LOSS_CAP, cap);
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    wall_ = 400;
    Enable(kTq);
    Set(AXIS_OBJ_TARGET_FORCE, 750);
    Tick(1200);
    ASSERT_EQ(Read(AXIS_OBJ_CONTACT), 1);
    wall_ = 1e6;
    Tick();  // the loss itself
    for (int i = 0; i < 300; ++i) {
      ASSERT_LE(outputs_.dac_code, cap) << i;
      ASSERT_GT(outputs_.dac_code, (cap == 0) ? -1 : 0) << i;
      Tick();
      ASSERT_EQ(Read(AXIS_OBJ_ACTIVE_MODE), AXIS_MODE_FORCE) << i;
    }
    ASSERT_LE(outputs_.dac_code, cap) << "the last tick of the dwell";
    Tick();
    EXPECT_EQ(Read(AXIS_OBJ_ACTIVE_MODE), AXIS_MODE_POSITION);
    EXPECT_EQ(Read(AXIS_OBJ_CONTACT_LOSSES), 1);
  }
}

// What comes back within the dwell is pressed on, from the force demanded before; a reading that
// asks to pull back is not capped; a stop does not wait for the dwell.
TEST_F(Drive, TheDwellEndsWithTheContactOrAStop) {
  Set(AXIS_OBJ_CONTACT_LOSS_DWELL, 200);
  wall_ = 400;
  Enable(kTq);
  Set(AXIS_OBJ_TARGET_FORCE, 750);
  Tick(1200);
  wall_ += 100;
  Tick(100);
  ASSERT_EQ(Read(AXIS_OBJ_CONTACT), 0);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), 750);
  wall_ = 400;
  Tick(500);
  EXPECT_EQ(Read(AXIS_OBJ_CONTACT), 1);
  EXPECT_EQ(Read(AXIS_OBJ_ACTIVE_MODE), AXIS_MODE_FORCE);
  EXPECT_NEAR(Read(AXIS_OBJ_FORCE_ACTUAL), 750, 26);
  wall_ += 100;
  Tick(50);
  Control(0);
  Tick();
  EXPECT_EQ(outputs_.amp_enable, 0);
  Enable(kTq);  // begins with an approach
  Tick(2);
  EXPECT_EQ(Read(AXIS_OBJ_ACTIVE_MODE), AXIS_MODE_POSITION);
}

TEST_F(Drive, WithoutADwellALostContactIsApproachedAtOnce) {
  Set(AXIS_OBJ_CONTACT_LOSS_DWELL, 0);
  wall_ = 400;
  Enable(kTq);
  Set(AXIS_OBJ_TARGET_FORCE, 750);
  Tick(1200);
  wall_ += 100;
  Tick(3);
  EXPECT_EQ(Read(AXIS_OBJ_ACTIVE_MODE), AXIS_MODE_POSITION);
}

// At a loss the axis brakes at once: the first code is the position law's for a trajectory that is
// at most 2 counts and a count of rounding ahead of an axis that moves on, at 5 codes a count. It
// is not the pressing code, which a bias would carry on.
TEST_F(Drive, TheApproachAfterALossDoesNotCarryThePressingCodeOn) {
  Set(AXIS_OBJ_CONTACT_LOSS_DWELL, 0);
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 12);
  wall_ = 400;
  Enable(kTq);
  Set(AXIS_OBJ_TARGET_FORCE, 750);
  Tick(1200);
  ASSERT_EQ(Read(AXIS_OBJ_CONTACT), 1);
  wall_ += 1000;
  int pressing = 0;
  while (Read(AXIS_OBJ_ACTIVE_MODE) == AXIS_MODE_FORCE) {
    pressing = outputs_.dac_code;
    Tick();
  }
  EXPECT_GT(pressing, 100) << "the law asked for that without a reading";
  EXPECT_LE(outputs_.dac_code, 15);
}

TEST_F(Drive, AnAxisHeldUpDuringTheApproachDoesNotLurch) {
  for (const int target : {750, 1, -1, -750}) {
    PowerUp();
    Enable(kTq);
    stuck_ = true;
    Set(AXIS_OBJ_TARGET_FORCE, target);
    Tick(3000);
    // A quarter second of approach, 16 counts, and the way of the ramp: 2^2 / (2 x 0.1).
    EXPECT_LE(std::abs(Demand()), 750 + 16 + 21) << target;
    EXPECT_GE(std::abs(Demand()), 750) << target;
    EXPECT_EQ(Demand() > 0, target > 0);
  }
}

// A target force acts only if it was written since the last fault.
TEST_F(Drive, ATargetForceFromBeforeAFaultMovesNothing) {
  for (const int mode : {kTq, kCst}) {
    PowerUp();
    Enable(mode);
    Set(AXIS_OBJ_TARGET_FORCE, 750);
    inputs_.sensor_valid = 0;
    Tick();
    inputs_.sensor_valid = 1;
    ASSERT_EQ(State(), AXIS_DRIVE_STATE_FAULT);
    Control(0x80);
    Enable(mode);
    const double from = place_;
    Tick(300);
    EXPECT_EQ(place_, from) << mode;
    EXPECT_EQ(Read(AXIS_OBJ_TARGET_FORCE), 750) << "it is still what was written";
    Set(AXIS_OBJ_TARGET_FORCE, 750);
    Tick(300);
    EXPECT_GT(place_, from + 100) << mode;
  }
}

TEST_F(Drive, LossesAndPeakBeginAnewWithForceControl) {
  Enable(kTq);
  Set(AXIS_OBJ_TARGET_FORCE, 750);
  wall_ = place_ - 100;
  Tick(2);
  wall_ = 1e9;
  Tick(2);
  ASSERT_EQ(Read(AXIS_OBJ_CONTACT_LOSSES), 1);
  ASSERT_EQ(Read(AXIS_OBJ_FORCE_PEAK), 50 * 256);
  Control(0x07);
  Tick(300);
  EXPECT_EQ(Read(AXIS_OBJ_CONTACT_LOSSES), 1) << "until then they can be read";
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_PEAK), 50 * 256);
  Enable(kTq);
  EXPECT_EQ(Read(AXIS_OBJ_CONTACT_LOSSES), 0);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_PEAK), 0);
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

TEST_F(Drive, AForceReadingAtItsEndIsReported) {
  Enable(kTq);
  EXPECT_EQ(Status() & 0x80, 0);
  wall_ = -1000;
  Tick();
  EXPECT_EQ(Status() & 0x80, 0x80);
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

// Limits of each direction beside force_limit: the smaller one counts, in every mode that presses.
class ForceLimits : public Drive {
 protected:
  // A reading at an end of its range, so that contact is there whatever the axis does.
  void Begin(int mode, int sign) {
    PowerUp();
    stuck_ = true;
    if (sign > 0) {
      wall_ = -1000;
    } else {
      wall_ = 1e12;
      Set(AXIS_OBJ_FORCE_ZERO_CODE, 255);
    }
    Set(AXIS_OBJ_FORCE_SLOPE, 1000000);
    Set(AXIS_OBJ_STIFFNESS, 32768);
    Set(AXIS_OBJ_DAMPING, 256 * 256);
    Set(AXIS_OBJ_FORCE_LIMIT_POSITIVE, 300);
    Set(AXIS_OBJ_FORCE_LIMIT_NEGATIVE, 600);
    Enable(mode);
  }
  void Press(int sign, int force) {
    Set(AXIS_OBJ_TARGET_FORCE, sign * force);
    Set(AXIS_OBJ_TARGET_POSITION, sign * 5000);
    Set(AXIS_OBJ_TARGET_VELOCITY, sign * 6000);
    Tick(3000);
  }
};

TEST_F(ForceLimits, EachDirectionHasItsOwnInEveryModeThatPresses) {
  for (const int mode : {kTq, kCst, -6, -7, -8}) {
    for (const int sign : {1, -1}) {
      Begin(mode, sign);
      Press(sign, 900);
      EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), sign > 0 ? 300 : -600) << mode;
      Set(AXIS_OBJ_FORCE_LIMIT, 200);
      Tick(300);
      EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), sign * 200) << mode;
      Set(AXIS_OBJ_FORCE_LIMIT, 1000);
      Set(AXIS_OBJ_FORCE_LIMIT_POSITIVE, 65535);
      Set(AXIS_OBJ_FORCE_LIMIT_NEGATIVE, 65535);
      Tick(300);
      EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), sign * (mode > 0 ? 900 : 1000)) << mode;
    }
  }
}

TEST_F(ForceLimits, ATargetWithinThemIsNotLimited) {
  for (const int mode : {kTq, kCst}) {
    for (const int sign : {1, -1}) {
      Begin(mode, sign);
      Press(sign, sign > 0 ? 300 : 600);
      EXPECT_EQ(Status() & kLimit, 0) << mode;
      Press(sign, sign > 0 ? 301 : 601);
      EXPECT_EQ(Status() & kLimit, kLimit) << mode;
    }
  }
}

TEST_F(ForceLimits, ADirectionOfZeroIsNotPressedIn) {
  Set(AXIS_OBJ_FORCE_LIMIT_POSITIVE, 0);
  wall_ = 400;
  Enable(kTq);
  Press(1, 750);
  EXPECT_EQ(place_, 0.0) << "not even an approach";
  EXPECT_EQ(Status() & kReached, kReached);
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

// A guarded move that the workpiece ended has reached its target, whatever the workpiece does with
// the axis then; the next set-point is one to be reached.
TEST_F(Drive, AGuardedMoveThatTheWorkpieceEndedStaysReached) {
  wall_ = 1000;
  Set(AXIS_OBJ_POSITION_WINDOW, 0);
  Enable(-5);
  Set(AXIS_OBJ_TRAJECTORY_VELOCITY, 3000);
  MoveTo(5000);
  ASSERT_GE(TicksUntil(kReached, kReached, 3000), 0);
  stuck_ = true;
  for (const int pushed : {5, 40, -40}) {
    place_ += pushed;
    Tick(20);
    EXPECT_NE(Read(AXIS_OBJ_POSITION_ACTUAL), Demand());
    EXPECT_EQ(Status() & kReached, kReached) << pushed;
  }
  MoveTo(200);
  Tick(4000);
  EXPECT_EQ(Demand(), 200);
  EXPECT_EQ(Status() & kReached, 0) << "it is held up on the way";
}

TEST_F(Drive, StiffnessIsASpring) {
  // 1/2 count of force per encoder count: a displacement of 60 counts yields 30 of force.
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

// The set-point of a spring is limited as a target force is: 500 per mille, 20 counts.
TEST_F(Drive, TheForceLimitBoundsTheSpring) {
  for (const int sign : {1, -1}) {
    PowerUp();
    Set(AXIS_OBJ_STIFFNESS, 32768);
    Set(AXIS_OBJ_FORCE_LIMIT, 500);
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    stuck_ = true;
    Enable(-6);
    Set(AXIS_OBJ_TARGET_POSITION, sign * 5000);
    Tick(3000);
    EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), sign * 500);
    EXPECT_EQ(outputs_.dac_code, sign * 100) << "gain 5 x 20 counts";
  }
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

}  // namespace
