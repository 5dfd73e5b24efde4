// User's units by 608Fh, 6091h and 6092h; offsets of the cyclic modes.

#include <cstdint>
#include <random>

#include "tests/firmware/unit/cia402_fixture.hpp"

namespace {

class Units : public Drive {
 protected:
  struct Ratio {
    uint32_t feed, encoder_revolutions, shaft, feed_shaft, increments, motor;
  };

  int Adopt(const Ratio &r) {
    const struct {
      uint16_t object;
      uint32_t value;
    } writes[] = {{AXIS_OBJ_ENCODER_INCREMENTS, r.increments},
                  {AXIS_OBJ_ENCODER_REVOLUTIONS, r.encoder_revolutions},
                  {AXIS_OBJ_GEAR_MOTOR_REVOLUTIONS, r.motor},
                  {AXIS_OBJ_GEAR_SHAFT_REVOLUTIONS, r.shaft},
                  {AXIS_OBJ_FEED_SHAFT_REVOLUTIONS, r.feed_shaft},
                  {AXIS_OBJ_FEED, r.feed}};
    Set(AXIS_OBJ_FEED, 0);
    for (const auto &w : writes) {
      if (const int refusal = Write(w.object, static_cast<int32_t>(w.value))) return refusal;
      EXPECT_EQ(Read(w.object), static_cast<int32_t>(w.value));
    }
    return FW_OK;
  }

  std::mt19937_64 random_{20261122};
};

TEST_F(Units, ARatioThatDoesNotFitIsRefusedAndChangesNothing) {
  ASSERT_EQ(Adopt({5000, 1, 1, 1, 4096, 1}), FW_OK);
  const Ratio cases[] = {{2147483647, 1, 1, 1, 2147483629, 7},
                         {1, 1, 1, 1, 2147483647, 1},
                         {2147483647, 1, 1, 1, 1, 1}};
  for (const Ratio &r : cases) EXPECT_EQ(Adopt(r), FW_ERROR_RANGE) << r.feed;
  ASSERT_EQ(Adopt({5000, 1, 1, 1, 4096, 1}), FW_OK);
  EXPECT_EQ(Write(AXIS_OBJ_GEAR_SHAFT_REVOLUTIONS, INT32_MAX), FW_ERROR_RANGE);
  EXPECT_EQ(Read(AXIS_OBJ_GEAR_SHAFT_REVOLUTIONS), 1);
  EXPECT_EQ(Read(AXIS_OBJ_FEED), 5000);
  place_ = 4096;
  Tick(2);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_ACTUAL), 5000);
}

TEST_F(Units, ChangeOnlyWhileTheAxisIsDisabled) {
  Enable(kPp);
  for (const uint16_t object :
       {AXIS_OBJ_ENCODER_INCREMENTS, AXIS_OBJ_ENCODER_REVOLUTIONS, AXIS_OBJ_GEAR_MOTOR_REVOLUTIONS,
        AXIS_OBJ_GEAR_SHAFT_REVOLUTIONS, AXIS_OBJ_FEED, AXIS_OBJ_FEED_SHAFT_REVOLUTIONS}) {
    EXPECT_EQ(Write(object, 2), FW_ERROR_STATE) << object;
  }
}

// A screw of 10 mm behind a gear of 3 to 2, 4096 counts a revolution, in um: 10000 um are 6144
// counts.
TEST_F(Units, ProfilePositionMovesInTheUsersUnits) {
  ASSERT_EQ(Adopt({10000, 1, 2, 1, 4096, 3}), FW_OK);
  Set(AXIS_OBJ_TRAJECTORY_VELOCITY, 20000);
  Enable(kPp);
  MoveTo(10000);
  double fastest = 0;
  while ((Status() & kReached) == 0) {
    Tick();
    fastest = std::max(fastest, Speed());
  }
  EXPECT_NEAR(fastest, 20000 * 0.6144 / 1500, 1e-3);
  EXPECT_NEAR(place_, 6144, 10);
  EXPECT_EQ(Demand(), 10000);
  Tick(300);
  EXPECT_NEAR(Read(AXIS_OBJ_POSITION_ACTUAL), 10000, 2);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_INTERNAL), 6144);
  // A hundred steps there and back end at the very count.
  for (int i = 0; i < 100; ++i) MoveTo((i % 2 == 0) ? 333 : -333, kNewRelative), Tick(200);
  Tick(500);
  EXPECT_EQ(Demand(), 10000);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_INTERNAL), 6144);
}

TEST_F(Units, VelocityAndAccelerationAreInTheUsersUnits) {
  ASSERT_EQ(Adopt({1000, 1, 1, 1, 4096, 1}), FW_OK);
  Enable(kPv);
  EXPECT_EQ(Speed(), 0.0) << "without a target it stands";
  Set(AXIS_OBJ_TRAJECTORY_ACCELERATION, 50000);
  Set(AXIS_OBJ_TARGET_VELOCITY, -3000);
  Tick(10);
  EXPECT_NEAR(Speed(), -10 * 50000 * 4.096 / 2.25e6, 2e-3);
  Tick(1000);
  EXPECT_NEAR(Speed(), -3000 * 4.096 / 1500, 1e-4);
  EXPECT_EQ(Read(AXIS_OBJ_VELOCITY_DEMAND), -3000);
  EXPECT_NEAR(Read(AXIS_OBJ_VELOCITY_ACTUAL), -3000, 25);
  EXPECT_NEAR(Read(AXIS_OBJ_VELOCITY_SENSOR), -3000 * 4.096, 1500) << "6069h stays in counts";
}

// A unit of a thousandth of a count: 35 of them a second squared, the least that may be written,
// are less than the smallest acceleration of a trajectory, 1/65536 count a tick squared. It is that
// one, neither 0 nor more.
TEST_F(Units, TheSmallestAccelerationIsTheTrajectorysOwn) {
  ASSERT_EQ(Adopt({1000, 1, 1, 1, 1, 1}), FW_OK);
  Set(AXIS_OBJ_TRAJECTORY_ACCELERATION, 35);
  Enable(kPv);
  Set(AXIS_OBJ_TARGET_VELOCITY, 1000000);
  const double before = Speed();
  Tick(100);
  EXPECT_EQ(Speed() - before, 100.0 / 65536);
}

// The window is 100 of the user's units, 50 counts.
TEST_F(Units, TheFollowingErrorIsInTheUsersUnits) {
  ASSERT_EQ(Adopt({2, 1, 1, 1, 1, 1}), FW_OK);
  Enable(kCsp);
  Set(AXIS_OBJ_FOLLOWING_ERROR_WINDOW, 100);
  Set(AXIS_OBJ_FOLLOWING_ERROR_TIMEOUT, 20);
  stuck_ = true;
  Set(AXIS_OBJ_TARGET_POSITION, 100);
  Tick(100);
  EXPECT_EQ(Read(AXIS_OBJ_FOLLOWING_ERROR), 100);
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
  Set(AXIS_OBJ_TARGET_POSITION, 102);
  Tick(40);
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_FOLLOWING_ERROR);
}

// With a coarse encoder a target between two counts is reached at the nearer one.
TEST_F(Units, ATargetBetweenTwoCountsIsReached) {
  ASSERT_EQ(Adopt({100, 1, 1, 1, 1, 1}), FW_OK);
  Set(AXIS_OBJ_POSITION_WINDOW, 0);
  Enable(kPp);
  MoveTo(30049);
  ASSERT_GE(TicksUntil(kReached, kReached, 5000), 0);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_INTERNAL), 300);
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 30049);
}

TEST_F(Units, HomingSetsTheOffsetInTheUsersUnits) {
  ASSERT_EQ(Adopt({10000, 1, 1, 1, 4096, 1}), FW_OK);
  place_ = 777;
  Set(AXIS_OBJ_HOME_OFFSET, -25000);
  Set(AXIS_OBJ_POLARITY, 0xC0);
  Enable(kHm);
  Control(kNew);
  Tick(5);
  EXPECT_NEAR(Read(AXIS_OBJ_POSITION_ACTUAL), -25000, 2);
  stuck_ = true;
  place_ -= 4096;
  Tick(2);
  EXPECT_NEAR(Read(AXIS_OBJ_POSITION_ACTUAL), -15000, 2);
}

// In counts positions wrap, with a ratio they end: nothing goes the short way round, in either
// direction of the user, and no limit at the ends of the range means the other one.
TEST_F(Units, NothingMovesAcrossTheEnds) {
  for (const int polarity : {0, 0xC0}) {
    for (const double start : {2147483000.0, -2147483000.0}) {
      for (const Ratio &r : {Ratio{1, 1, 1, 1, 2, 1}, Ratio{3, 1, 1, 1, 1, 1}}) {
        SCOPED_TRACE(std::to_string(polarity) + " " + std::to_string(start));
        PowerUp();
        ASSERT_EQ(Adopt(r), FW_OK);
        Set(AXIS_OBJ_POLARITY, polarity);
        place_ = start;
        Enable(kPp);
        const int sign = (start > 0) == (polarity == 0) ? 1 : -1;
        MoveTo(-sign * 1000000000);
        Tick(300);
        EXPECT_LT(std::abs(place_), std::abs(start)) << "away from the end";
        Set(AXIS_OBJ_MODES_OF_OPERATION, kPv);
        Set(AXIS_OBJ_TRAJECTORY_VELOCITY, 300000);
        Set(AXIS_OBJ_TARGET_VELOCITY, sign * 300000);
        Tick(6000);
        EXPECT_LT(std::abs(place_), 2147483648.0) << "held at the end";
      }
    }
  }
}

TEST_F(Units, AFeedOfTheIncrementsIsTheCount) {
  PowerUp();
  ASSERT_EQ(Adopt({4096, 1, 1, 1, 4096, 1}), FW_OK);
  std::uniform_int_distribution<int32_t> any(-2000000000, 2000000000);
  for (int i = 0; i < 200; ++i) {
    place_ = any(random_);
    Tick(1);
    ASSERT_EQ(Read(AXIS_OBJ_POSITION_ACTUAL), static_cast<int32_t>(place_));
  }
}

// 1500 count/s are one count a tick; a target and an offset of the client's add up, within
// velocity_max.
TEST_F(Units, CyclicVelocityAddsItsOffset) {
  Enable(kCsv);
  Set(AXIS_OBJ_VELOCITY_OFFSET, 1500);
  Tick(100);
  EXPECT_EQ(Speed(), 0.0) << "without a target it does nothing";
  Set(AXIS_OBJ_TARGET_VELOCITY, 3000);
  Tick(2);
  EXPECT_EQ(Speed(), 3.0);
  Tick(100);
  EXPECT_EQ(Status() & kReached, kReached);
  Set(AXIS_OBJ_VELOCITY_OFFSET, -6000);
  Tick(2);
  EXPECT_EQ(Speed(), -2.0);
  Set(AXIS_OBJ_VELOCITY_MAX, 6000);
  Set(AXIS_OBJ_VELOCITY_OFFSET, 30000);
  Tick(2);
  EXPECT_EQ(Speed(), 4.0);
  EXPECT_EQ(Status() & kLimit, kLimit);
}

TEST_F(Units, ThePolarityOfVelocityHoldsForTheOffset) {
  Set(AXIS_OBJ_POLARITY, 0x40);
  Enable(kCsv);
  Set(AXIS_OBJ_TARGET_VELOCITY, 0);
  Set(AXIS_OBJ_VELOCITY_OFFSET, 1500);
  Tick(2);
  EXPECT_EQ(Speed(), -1.0);
}

// u = k_p e - k_d (v - v_o): at e = 0 and rest the first code is k_d v_o = 3 * 10 = 30.
TEST_F(Units, CyclicPositionFeedsTheOffsetForward) {
  Set(AXIS_OBJ_VELOCITY_GAIN, 3 * 256);
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Enable(kCsp);
  Set(AXIS_OBJ_VELOCITY_OFFSET, 15000);
  stuck_ = true;
  Tick(10);
  EXPECT_EQ(outputs_.dac_code, 0) << "without a target it does nothing";
  Set(AXIS_OBJ_TARGET_POSITION, 0);
  Tick(2);
  EXPECT_EQ(outputs_.dac_code, 30);
  EXPECT_EQ(Demand(), 0) << "the demand is the target";
  EXPECT_EQ(Read(AXIS_OBJ_FOLLOWING_ERROR), 0);
  Set(AXIS_OBJ_VELOCITY_OFFSET, -15000);
  Tick(2);
  EXPECT_EQ(outputs_.dac_code, -30);
  Set(AXIS_OBJ_POSITION_GAIN, 0);
  Tick(50);
  EXPECT_EQ(outputs_.dac_code, 0) << "no position loop, no feed-forward";
}

// A ramp that is fed forward is followed without the lag of k_d: v = 2 counts a tick, k_p = 5,
// k_d = 10, 0.02 counts a tick and code need 100 codes; e = (100 + k_d (v - v_o)) / k_p.
TEST_F(Units, TheOffsetTakesTheLagOfTheVelocityGainAway) {
  for (const int offset : {0, 3000}) {
    PowerUp();
    Set(AXIS_OBJ_VELOCITY_GAIN, 10 * 256);
    Enable(kCsp);
    for (int i = 0; i < 600; ++i) {
      Set(AXIS_OBJ_VELOCITY_OFFSET, offset);
      Set(AXIS_OBJ_TARGET_POSITION, 2 * i);
      Tick();
    }
    EXPECT_NEAR(Read(AXIS_OBJ_FOLLOWING_ERROR), (offset == 0) ? 24 : 20, 1.5);
  }
}

TEST_F(Units, OffsetsEndWithTheTargets) {
  Enable(kCsv);
  Set(AXIS_OBJ_VELOCITY_OFFSET, 1500);
  Set(AXIS_OBJ_FORCE_OFFSET, 100);
  inputs_.sensor_valid = 0;
  Tick();
  EXPECT_EQ(State(), AXIS_DRIVE_STATE_FAULT);
  EXPECT_EQ(Read(AXIS_OBJ_VELOCITY_OFFSET), 0);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_OFFSET), 0);
}

// 100 and 50 per mille of 100 N are 15 N, 6 counts of 2.5 N; force_limit holds for the sum.
TEST_F(Units, ForceAddsItsOffsetWithinTheLimit) {
  wall_ = -40;  // 20 counts
  Enable(kCst);
  Set(AXIS_OBJ_FORCE_OFFSET, 50);
  Tick(5);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), 0) << "without a target it does nothing";
  Set(AXIS_OBJ_TARGET_FORCE, 100);
  Tick(4);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), 150);
  Tick(2000);
  EXPECT_NEAR(Read(AXIS_OBJ_FORCE_ACTUAL), 150, 26);
  Set(AXIS_OBJ_FORCE_LIMIT, 120);
  Tick(4);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), 120);
  EXPECT_EQ(Status() & kLimit, kLimit);
}

// Two addresses of one value.
TEST_F(Units, TheInterpolationSetpointIsTheTargetPosition) {
  Enable(kCsp);
  Set(AXIS_OBJ_INTERPOLATION_SETPOINT, 50);
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 50);
  Tick(5);
  EXPECT_EQ(Demand(), 50);
  Set(AXIS_OBJ_TARGET_POSITION, 70);
  EXPECT_EQ(Read(AXIS_OBJ_INTERPOLATION_SETPOINT), 70);
  Tick(5);
  EXPECT_EQ(Demand(), 70);
}

}  // namespace
