// Profile and cyclic velocity.

#include <gtest/gtest.h>

#include <cstdint>

#include "tests/firmware/unit/cia402_fixture.hpp"

namespace {

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

}  // namespace
