// Command shaping: of the demanded force and of the trajectory, and what bypasses it.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <random>
#include <vector>

#include "tests/firmware/unit/cia402_fixture.hpp"

namespace {

struct Impulses {
  std::vector<int> amplitude;
  std::vector<int> delay;
};
const Impulses kTwo{{40000, 25536}, {0, 20}};
const Impulses kThree{{20000, 30000, 15536}, {0, 17, 255}};

class Shaper : public Drive {
 protected:
  void Shape(int first, const Impulses &set) {
    Set(static_cast<uint16_t>(first), static_cast<int32_t>(set.amplitude.size()));
    for (size_t i = 0; i < set.amplitude.size(); ++i) {
      Set(static_cast<uint16_t>(first + 1 + static_cast<int>(i)), set.amplitude[i]);
      Set(static_cast<uint16_t>(first + 4 + static_cast<int>(i)), set.delay[i]);
    }
  }
  void ShapeForce(const Impulses &set) { Shape(AXIS_OBJ_FORCE_SHAPER_IMPULSES, set); }
  void ShapeMotion(const Impulses &set) { Shape(AXIS_OBJ_MOTION_SHAPER_IMPULSES, set); }

  double ShapedSpeed() const {
    const bool shaped = fw_.drive.motion_shaper.age != 0;
    return (shaped ? fw_.drive.shaped : fw_.drive.trajectory).velocity_q16 / 65536.0;
  }

  // The demanded positions of a number of ticks.
  std::vector<double> Demands(int ticks) {
    std::vector<double> demands;
    for (int i = 0; i < ticks; ++i) {
      Tick();
      demands.push_back(Demand());
    }
    return demands;
  }
};

// What a convolution makes of values that were `before` until the first of them.
std::vector<double> Convolved(const std::vector<double> &x, const Impulses &set, double before) {
  std::vector<double> y;
  for (size_t n = 0; n < x.size(); ++n) {
    double sum = 0.0;
    for (size_t i = 0; i < set.delay.size(); ++i) {
      const auto delay = static_cast<size_t>(set.delay[i]);
      sum += set.amplitude[i] / 65536.0 * (n >= delay ? x[n - delay] : before);
    }
    y.push_back(sum);
  }
  return y;
}

TEST_F(Shaper, ASetIsJudgedAsAWhole) {
  for (const auto &[first, state] :
       {std::pair{AXIS_OBJ_FORCE_SHAPER_IMPULSES, AXIS_OBJ_FORCE_SHAPER_STATE},
        std::pair{AXIS_OBJ_MOTION_SHAPER_IMPULSES, AXIS_OBJ_MOTION_SHAPER_STATE}}) {
    const auto state_of = [this, first = first, state = state](const Impulses &set) {
      Shape(first, set);
      return Read(static_cast<uint16_t>(state));
    };
    EXPECT_EQ(state_of({{}, {}}), AXIS_FORCE_SHAPER_STATE_OFF);
    EXPECT_EQ(state_of({{65536}, {0}}), AXIS_FORCE_SHAPER_STATE_VALID);
    EXPECT_EQ(state_of(kTwo), AXIS_FORCE_SHAPER_STATE_VALID);
    EXPECT_EQ(state_of(kThree), AXIS_FORCE_SHAPER_STATE_VALID);
    EXPECT_EQ(state_of({{40000, 25535}, {0, 20}}), AXIS_FORCE_SHAPER_STATE_WRONG_SUM);
    EXPECT_EQ(state_of({{65536, 65536}, {0, 20}}), AXIS_FORCE_SHAPER_STATE_WRONG_SUM);
    EXPECT_EQ(state_of({{40000, 25536}, {1, 20}}), AXIS_FORCE_SHAPER_STATE_WRONG_ORDER);
    EXPECT_EQ(state_of({{40000, 25536}, {0, 0}}), AXIS_FORCE_SHAPER_STATE_WRONG_ORDER);
    EXPECT_EQ(state_of({{20000, 30000, 15536}, {0, 20, 19}}), AXIS_FORCE_SHAPER_STATE_WRONG_ORDER);
    EXPECT_EQ(state_of({{40000, 25536}, {0, 20}}), AXIS_FORCE_SHAPER_STATE_VALID)
        << "what the third impulse is does not matter";
    EXPECT_EQ(Write(static_cast<uint16_t>(first + 1), -1), FW_ERROR_RANGE);
    EXPECT_EQ(Write(static_cast<uint16_t>(first + 4), 256), FW_ERROR_RANGE);
  }
}

TEST_F(Shaper, AnEnabledAxisKeepsItsImpulses) {
  ShapeForce(kTwo);
  ShapeMotion(kTwo);
  Enable(kPp);
  for (int i = 0; i < 7; ++i) {
    EXPECT_EQ(Write(static_cast<uint16_t>(AXIS_OBJ_FORCE_SHAPER_IMPULSES + i), 1), FW_ERROR_STATE);
    EXPECT_EQ(Write(static_cast<uint16_t>(AXIS_OBJ_MOTION_SHAPER_IMPULSES + i), 1), FW_ERROR_STATE);
  }
}

// The demand of modes 4 and 10, from the force that is there (255 counts, bounded to 1000).
TEST_F(Shaper, TheDemandedForceIsTheConvolution) {
  for (const int mode : {kTq, kCst}) {
    for (const Impulses &set : {Impulses{}, kTwo, kThree}) {
      std::vector<double> demands[2];
      for (const bool shaped : {false, true}) {
        PowerUp();
        wall_ = -1000;
        stuck_ = true;
        if (shaped) ShapeForce(set);
        Set(AXIS_OBJ_TARGET_FORCE, 1000);
        Enable(mode);
        Tick(300);
        for (const int target : {300, 900, -200}) {
          Set(AXIS_OBJ_TARGET_FORCE, target);
          for (int i = 0; i < 600; ++i) {
            Tick(2);  // force_demand is made in every second tick
            demands[shaped ? 1 : 0].push_back(fw_.drive.force_demand_q16 / 65536.0);
          }
          EXPECT_EQ(demands[shaped ? 1 : 0].back(), target);
          EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), target);
        }
      }
      if (set.delay.empty()) {
        EXPECT_EQ(demands[0], demands[1]);
      } else if (set.delay[1] % 2 == 0) {  // sampled in every second tick
        const Impulses halved{set.amplitude, {set.delay[0], set.delay[1] / 2}};
        const std::vector<double> expected = Convolved(demands[0], halved, 1000.0);
        for (size_t n = 0; n < expected.size(); ++n) {
          ASSERT_NEAR(demands[1][n], expected[n], 1e-3) << mode << " at " << n;
        }
      }
    }
  }
}

// Mode -1: the set-point that the axis gets begins with the force that is there, and the user's own
// reads as it was written.
TEST_F(Shaper, TheSetPointOfTheForceLawIsShapedToo) {
  ShapeForce(kTwo);
  wall_ = -100;
  stuck_ = true;  // a reading of 50 counts
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Set(AXIS_OBJ_FORCE_SETPOINT, 70 * 256);
  Tick(3);
  Enable(-1);
  const double first = 50.0 + 20.0 * 40000 / 65536;
  EXPECT_EQ(outputs_.dac_code, std::lround(5 * (first - 50.0)));
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_SETPOINT), 70 * 256);
  Tick(16);
  EXPECT_EQ(outputs_.dac_code, std::lround(5 * (first - 50.0)));
  Tick(4);
  EXPECT_EQ(outputs_.dac_code, 5 * 20);
  Set(AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
  Tick();
  EXPECT_EQ(outputs_.dac_code, std::lround(5 * (20.0 - 40.0 * 40000 / 65536)));
  Tick(20);
  EXPECT_EQ(outputs_.dac_code, 5 * -20);
}

// A halt ends the shaping of mode -1: after it the set-point begins with the force that is there
// then, 20 counts of reading and not the 50 from before.
TEST_F(Shaper, TheForceLawsSetPointBeginsAnewAfterAHalt) {
  ShapeForce(kTwo);
  wall_ = -100;
  stuck_ = true;  // a reading of 50 counts
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Set(AXIS_OBJ_FORCE_SETPOINT, 70 * 256);
  Enable(-1);
  Tick(30);
  ASSERT_EQ(outputs_.dac_code, 5 * 20);
  Control(kOperate | kHalt);
  Tick(50);
  wall_ = -40;
  Tick(50);
  Control(kOperate);
  Tick();
  EXPECT_EQ(outputs_.dac_code, std::lround(5 * 50.0 * 40000 / 65536));
  Tick(20);
  EXPECT_EQ(outputs_.dac_code, 5 * 50);
}

// Every mode whose trajectory is shaped: it is the convolution of what the axis would follow
// without, and it ends exactly there.
TEST_F(Shaper, TheTrajectoryIsTheConvolution) {
  for (const int mode : {kPp, kPv, kCsp, kCsv, -5, -6, -8}) {
    for (const Impulses &set : {kTwo, kThree}) {
      std::vector<double> demands[2];
      for (const bool shaped : {false, true}) {
        PowerUp();
        if (shaped) ShapeMotion(set);
        Enable(mode);
        Set(AXIS_OBJ_TRAJECTORY_VELOCITY, 3000);
        Set(AXIS_OBJ_TARGET_VELOCITY, 2777);
        Set(AXIS_OBJ_INTERPOLATION_PERIOD, 100);
        MoveTo(701);
        std::vector<double> part = Demands(700);
        Set(AXIS_OBJ_TARGET_VELOCITY, 0);
        MoveTo(-33);
        const std::vector<double> back = Demands(1500);
        part.insert(part.end(), back.begin(), back.end());
        demands[shaped ? 1 : 0] = part;
      }
      EXPECT_GT(demands[0][600], 600) << mode;
      const std::vector<double> expected = Convolved(demands[0], set, 0.0);
      for (size_t n = 0; n < expected.size(); ++n) {
        ASSERT_NEAR(demands[1][n], expected[n], 1.01) << "mode " << mode << " at " << n;
      }
      EXPECT_EQ(demands[1].back(), demands[0].back()) << mode;
      EXPECT_EQ(fw_.drive.shaped.position_q32, fw_.drive.trajectory.position_q32) << mode;
      EXPECT_EQ(ShapedSpeed(), 0.0) << mode;
    }
  }
}

TEST_F(Shaper, ATargetIsReachedOnlyWhenTheShapedTrajectoryIsThere) {
  for (const int mode : {kPp, kCsp, -5}) {
    PowerUp();
    ShapeMotion({{32768, 32768}, {0, 200}});
    Set(AXIS_OBJ_POSITION_WINDOW, 1000);  // the place of the axis alone would do
    Set(AXIS_OBJ_POSITION_WINDOW_TIME, 0);
    Enable(mode);
    Set(AXIS_OBJ_TARGET_POSITION, 100);
    Control(kNew);
    const int ticks = TicksUntil(kReached, kReached, 2000);
    ASSERT_GE(ticks, 200) << mode;
    EXPECT_LE(ticks, 320) << mode;
    EXPECT_EQ(Demand(), 100) << mode;
  }
  PowerUp();
  ShapeMotion({{32768, 32768}, {0, 200}});
  Set(AXIS_OBJ_VELOCITY_WINDOW, 60000);
  Set(AXIS_OBJ_VELOCITY_WINDOW_TIME, 0);
  Enable(kPv);
  Set(AXIS_OBJ_TARGET_VELOCITY, 3000);
  EXPECT_GE(TicksUntil(kReached, kReached, 2000), 200);
}

// A stop goes on from the speed at which the axis is commanded, at its own deceleration, from its
// first tick; nothing of the command comes after it.
TEST_F(Shaper, EveryStopBypassesIt) {
  enum Stop { kHalted, kQuickStop, kDisabled, kModeChanged, kFault, kStops };
  for (int stop = 0; stop < kStops; ++stop) {
    for (const int wait : {100, 130, 400}) {
      PowerUp();
      ShapeMotion(kThree);
      Set(AXIS_OBJ_QUICK_STOP_DECELERATION, 225000);
      Set(AXIS_OBJ_TRAJECTORY_DECELERATION, 225000);  // 0.1 count/tick^2
      Set(AXIS_OBJ_FAULT_REACTION_OPTION, 2);
      Set(AXIS_OBJ_DISABLE_OPERATION_OPTION, 1);
      Set(AXIS_OBJ_HALT_OPTION, 1);
      Enable(kPv);
      Set(AXIS_OBJ_TARGET_VELOCITY, 3000);
      Tick(wait);
      double before = ShapedSpeed();
      ASSERT_GT(before, 0.3);
      switch (stop) {
        case kHalted:
          Control(kOperate | kHalt);
          break;
        case kQuickStop:
          Control(0x02);
          break;
        case kDisabled:
          Control(0x07);
          break;
        case kModeChanged:
          Set(AXIS_OBJ_MODES_OF_OPERATION, kPp);
          break;
        default:
          Set(AXIS_OBJ_ABORT_CONNECTION_OPTION, 1);
          cia402_owner_lost(&fw_.drive, &fw_.axis, AXIS_FAULT_SOURCE_LOST);
          break;
      }
      for (int i = 0; before > 0.0; ++i) {
        Tick();
        ASSERT_NEAR(ShapedSpeed(), std::fmax(0.0, before - 0.1), 1e-4)
            << "stop " << stop << " tick " << i;
        before = ShapedSpeed();
      }
      const double place = place_;
      Tick(300);
      EXPECT_NEAR(place_, place, 30.0) << "only the lag of the position law remains";
      EXPECT_EQ(ShapedSpeed(), 0.0);
    }
  }
}

// After a halt that ended, motion is shaped again, and its end is exact.
TEST_F(Shaper, ItGoesOnAfterAStop) {
  ShapeMotion(kThree);
  Set(AXIS_OBJ_TRAJECTORY_VELOCITY, 3000);
  Enable(kPp);
  MoveTo(5000);
  Tick(400);
  Control(kOperate | kHalt);
  Tick(500);
  const int32_t halted = Demand();
  EXPECT_GT(halted, 100);
  EXPECT_LT(halted, 4000);
  MoveTo(5001);
  EXPECT_GE(TicksUntil(kReached, kReached, 6000), 255);
  EXPECT_EQ(Demand(), 5001);
}

// A guarded move ends at the contact at once, also when only the shaped part of it is left.
TEST_F(Shaper, AGuardedMoveStopsAtTheContact) {
  for (const int wall : {200, 440}) {  // before and after the planned move of 450 ended
    PowerUp();
    ShapeMotion({{32768, 32768}, {0, 250}});
    Set(AXIS_OBJ_TRAJECTORY_VELOCITY, 3000);
    wall_ = wall;
    Enable(-5);
    MoveTo(450);
    int ticks = 0;
    for (; Read(AXIS_OBJ_CONTACT) == 0 && ticks < 2000; ++ticks) Tick();
    ASSERT_LT(ticks, 2000) << wall;
    Tick();
    EXPECT_EQ(ShapedSpeed(), 0.0) << wall;
    const int32_t there = Demand();
    Tick(600);
    EXPECT_EQ(Demand(), there) << wall;
    EXPECT_EQ(Status() & kReached, kReached) << wall;
  }
}

TEST_F(Shaper, PositionLimitsHoldForWhatTheAxisFollows) {
  std::mt19937 random(5);
  for (int run = 0; run < 60; ++run) {
    PowerUp();
    ShapeMotion((run % 2 == 0) ? kTwo : kThree);
    Set(AXIS_OBJ_POSITION_LIMIT_MAX, 1500);
    Set(AXIS_OBJ_POSITION_LIMIT_MIN, -700);
    Set(AXIS_OBJ_QUICK_STOP_DECELERATION, 225000);
    const int mode = std::array{kPp, kPv, kCsv}.at(random() % 3);
    Enable(mode);
    Set(AXIS_OBJ_TRAJECTORY_VELOCITY, 9000);
    for (int i = 0; i < 20; ++i) {
      // Cyclic velocity stops at once where a halt takes its time, with a shaper or without.
      const bool halted = mode != kCsv && random() % 3 == 0;
      const int speed = static_cast<int>(random() % 12000) - 6000;
      Set(AXIS_OBJ_TARGET_VELOCITY, speed);
      Set(AXIS_OBJ_TARGET_POSITION, (speed > 0) ? 5000 : -5000);
      Control(halted ? kOperate | kHalt : kNewNow);
      Control(halted ? kOperate | kHalt : kOperate);
      for (int t = static_cast<int>(random() % 300); t > 0; --t) {
        Tick();
        ASSERT_LE(Demand(), 1500) << run;
        ASSERT_GE(Demand(), -700) << run;
      }
    }
  }
}

// Approach and homing are not shaped: the same codes, tick by tick.
TEST_F(Shaper, ApproachAndHomingAreNotShaped) {
  for (const int mode : {kTq, kHm}) {
    std::vector<int> codes[2];
    for (const bool shaped : {false, true}) {
      PowerUp();
      if (shaped) ShapeMotion(kThree);
      wall_ = 400;
      Set(AXIS_OBJ_HOMING_METHOD, -1);
      Set(AXIS_OBJ_HOMING_SPEED_1, 1500);
      Enable(mode);
      Set(AXIS_OBJ_TARGET_FORCE, 500);
      Control(kNew);
      for (int i = 0; i < 1500; ++i) {
        Tick();
        codes[shaped ? 1 : 0].push_back(outputs_.dac_code);
      }
    }
    EXPECT_GT(place_, 300) << mode;
    EXPECT_EQ(codes[0], codes[1]) << mode;
  }
}

// Mode 4 halted: the force goes back by its slope from the demand of that tick.
TEST_F(Shaper, AHaltOfTheForceModeBypassesIt) {
  ShapeForce(kThree);
  wall_ = -1000;
  stuck_ = true;
  Set(AXIS_OBJ_FORCE_SLOPE, 1500);  // one per mille a tick
  Set(AXIS_OBJ_TARGET_FORCE, 100);
  Enable(kTq);
  Tick(1200);
  const double before = fw_.drive.force_demand_q16 / 65536.0;
  Control(kOperate | kHalt);
  for (int i = 1; i < 100; ++i) {
    Tick();
    ASSERT_NEAR(fw_.drive.force_demand_q16 / 65536.0, std::fmax(0.0, before - i), 1e-6) << i;
  }
  Control(kOperate);
  Tick();
  EXPECT_NEAR(fw_.drive.force_demand_q16 / 65536.0, std::fmax(0.0, before - 99) + 20000.0 / 65536,
              0.01);
}

}  // namespace
