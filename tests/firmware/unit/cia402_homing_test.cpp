// Homing by switches, index and contact: where home is, and what ends it without one.

#include <cmath>
#include <string>
#include <vector>

#include "tests/firmware/unit/cia402_fixture.hpp"

namespace {

constexpr double kNowhere = 1e12;

class Homing : public Drive {
 protected:
  static constexpr int kAll = 30, kDone = 0x1400, kFailed = 0x2400, kBits = 0x3400;

  uint8_t Din() override {
    int din = AXIS_DIGITAL_INPUTS_ENABLE;
    if (place_ <= neg_) din |= AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE;
    if (place_ >= pos_) din |= AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE;
    if (place_ >= home_from_ && place_ < home_to_) din |= AXIS_DIGITAL_INPUTS_HOME;
    if ((place_ >= index_) != (before_ >= index_)) din |= AXIS_DIGITAL_INPUTS_INDEX;
    before_ = place_;
    return static_cast<uint8_t>(din);
  }

  void Prepare(int method, double start) {
    PowerUp();
    place_ = before_ = start;
    Set(AXIS_OBJ_INPUTS_FITTED, kAll);
    Set(AXIS_OBJ_HOMING_METHOD, method);
    Set(AXIS_OBJ_HOMING_SPEED_1, 6000);  // 4 counts a tick
    Set(AXIS_OBJ_HOMING_SPEED_2, 1500);  // 1 count a tick
    Enable(kHm);
    Control(kNew);
    Tick(2);
  }

  // Ticks until homing is over, or -1.
  int Run(int most = 60000) {
    for (int i = 0; i < most; ++i) {
      const int bits = Status() & kBits;
      if (bits == kDone || bits == kFailed) return i;
      Tick();
    }
    return -1;
  }

  int32_t Home() const { return fx_diff_wrap(0, fw_.drive.origin_cnt); }

  // Nothing moves any more, and enabled it stays.
  void ExpectStand() {
    Tick(30);
    const double place = place_;
    for (int i = 0; i < 500; ++i) {
      Tick();
      ASSERT_NEAR(place_, place, 1.5) << i;
      ASSERT_EQ(Speed(), 0.0);
    }
    EXPECT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
  }

  void ExpectFailure() {
    ASSERT_GE(Run(), 0) << std::hex << Status();
    EXPECT_EQ(Status() & kBits, kFailed);
    EXPECT_EQ(fw_.drive.origin_cnt, 0) << "no home was found";
    ExpectStand();
  }

  double neg_ = -4000, pos_ = 4000, home_from_ = 1000, home_to_ = 1500, index_ = 300;
  double before_ = 0;
};

// The edge is found at one count a tick, in the direction CiA 402 gives: the place is the edge or
// the count after it.
TEST_F(Homing, EachMethodFindsItsEdge) {
  const double far = kNowhere;
  const struct {
    int method;
    double start, home_from, home_to;
    double edge;
    int direction;  // of the last step
  } cases[] = {
      {17, 0, far, far, -4000, 1},     {17, -4100, far, far, -4000, 1},
      {18, 0, far, far, 4000, -1},     {18, 4100, far, far, 4000, -1},
      {19, 0, 1000, far, 1000, -1},    {19, 2000, 1000, far, 1000, -1},
      {20, 0, 1000, far, 1000, 1},     {20, 2000, 1000, far, 1000, 1},
      {21, 0, -far, -1000, -1000, 1},  {21, -2000, -far, -1000, -1000, 1},
      {22, 0, -far, -1000, -1000, -1}, {22, -2000, -far, -1000, -1000, -1},
      {33, 1000, far, far, 300, -1},   {34, -1000, far, far, 300, 1},
  };
  for (const auto &c : cases) {
    SCOPED_TRACE(std::to_string(c.method) + " from " + std::to_string(c.start));
    home_from_ = c.home_from;
    home_to_ = c.home_to;
    Prepare(c.method, c.start);
    ASSERT_GE(Run(), 0) << std::hex << Status();
    ASSERT_EQ(Status() & kBits, kDone);
    const double past = (Home() - c.edge) * c.direction;
    EXPECT_GE(past, -0.5);
    EXPECT_LE(past, 1.5);
    EXPECT_EQ(Read(AXIS_OBJ_POSITION_ACTUAL), Read(AXIS_OBJ_POSITION_INTERNAL) - Home());
    ExpectStand();
  }
}

// Homing a second time goes through every step of its method again and finds the same place.
TEST_F(Homing, ASecondHomingIsAsTheFirst) {
  home_to_ = kNowhere;
  for (const int method : {17, 18, 19, 20, 33, 34, -1}) {
    SCOPED_TRACE(method);
    wall_ = method == -1 ? 2000 : kNowhere;
    const int start = method == 33 ? 1000 : method == 34 ? -1000 : 0;
    Prepare(method, start);
    int ticks[2] = {};
    int32_t homes[2] = {};
    for (int again = 0; again < 2; ++again) {
      ticks[again] = Run();
      ASSERT_EQ(Status() & kBits, kDone) << again;
      homes[again] = Home();
      Control(0);
      Tick();
      place_ = before_ = start;
      Tick(30);
      Enable(kHm);
      Control(kNew);
      Tick(2);
    }
    EXPECT_NEAR(homes[1], homes[0], 2);
    EXPECT_NEAR(ticks[1], ticks[0], 5);
  }
}

// Two counts a tick at 3000 count/s: at most two counts late.
TEST_F(Homing, TheUncertaintyIsTheWayOfATick) {
  for (double edge = -4000.0; edge < -3996.0; edge += 0.37) {
    neg_ = edge;
    Prepare(17, 0);
    Set(AXIS_OBJ_HOMING_SPEED_2, 3000);
    ASSERT_GE(Run(), 0);
    EXPECT_GE(Home() - edge, -0.5);
    EXPECT_LE(Home() - edge, 2.5);
  }
}

TEST_F(Homing, DirectionsAreThoseOfTheAxisWhateverThePolarity) {
  PowerUp();
  Set(AXIS_OBJ_POLARITY, 0xC0);
  Set(AXIS_OBJ_INPUTS_FITTED, kAll);
  Set(AXIS_OBJ_HOME_OFFSET, 70);
  Set(AXIS_OBJ_HOMING_METHOD, 18);
  Set(AXIS_OBJ_HOMING_SPEED_2, 1500);
  Enable(kHm);
  Control(kNew);
  ASSERT_GE(Run(), 0);
  ASSERT_EQ(Status() & kBits, kDone);
  EXPECT_NEAR(Read(AXIS_OBJ_POSITION_ACTUAL) - 70, -(place_ - 4000), 2);
}

TEST_F(Homing, OnlyMethodsWhoseInputsAreFittedAreOffered) {
  const int methods[] = {35, 37, -1, 17, 18, 19, 20, 21, 22, 33, 34};
  const struct {
    int fitted;
    std::vector<int> offered;
  } cases[] = {{0, {35, 37, -1}},
               {AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE, {35, 37, -1, 17}},
               {AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE, {35, 37, -1, 18}},
               {AXIS_DIGITAL_INPUTS_HOME, {35, 37, -1, 19, 20, 21, 22}},
               {AXIS_DIGITAL_INPUTS_INDEX, {35, 37, -1, 33, 34}},
               {kAll, {35, 37, -1, 17, 18, 19, 20, 21, 22, 33, 34}}};
  for (const auto &c : cases) {
    PowerUp();
    Set(AXIS_OBJ_INPUTS_FITTED, c.fitted);
    std::vector<int> listed;
    for (uint16_t i = 0; i < 11; ++i) {
      const int32_t entry = Read(static_cast<uint16_t>(AXIS_OBJ_HOMING_METHODS_1 + i));
      if (entry != 0) listed.push_back(entry);
    }
    EXPECT_EQ(listed, c.offered) << c.fitted;
    for (const int method : methods) {
      const bool offered = std::find(c.offered.begin(), c.offered.end(), method) != c.offered.end();
      EXPECT_EQ(Write(AXIS_OBJ_HOMING_METHOD, method), offered ? FW_OK : FW_ERROR_RANGE)
          << method << " with " << c.fitted;
    }
    EXPECT_EQ(Write(AXIS_OBJ_HOMING_METHOD, 1), FW_ERROR_RANGE);
    EXPECT_EQ(Write(AXIS_OBJ_HOMING_METHOD, 23), FW_ERROR_RANGE);
  }
}

// A method that was chosen while its switch was fitted does not move without it.
TEST_F(Homing, AMethodWithoutItsSwitchIsAnErrorWithoutMotion) {
  PowerUp();
  Set(AXIS_OBJ_INPUTS_FITTED, kAll);
  Set(AXIS_OBJ_HOMING_METHOD, 17);
  Set(AXIS_OBJ_INPUTS_FITTED, 0);
  Enable(kHm);
  Control(kNew);
  Tick(300);
  EXPECT_EQ(Status() & kBits, kFailed);
  EXPECT_EQ(place_, 0.0);
}

TEST_F(Homing, ASwitchThatIsNotFoundEndsAtTheTravel) {
  for (const int method : {17, 18, 19, 20, 21, 22, 33, 34}) {
    SCOPED_TRACE(method);
    neg_ = -kNowhere;
    pos_ = home_from_ = home_to_ = index_ = kNowhere;
    Prepare(method, 0);
    Set(AXIS_OBJ_HOMING_TRAVEL, 2000);
    ExpectFailure();
    EXPECT_GT(std::abs(place_), 2000);
    // 4 counts a tick and 0.1 less in each: 80 on the way to a stand.
    EXPECT_LT(std::abs(place_), 2120);
  }
}

TEST_F(Homing, ASwitchThatIsNotFoundEndsAtTheTimeout) {
  neg_ = -kNowhere;
  Prepare(17, 0);
  Control(kOperate);
  Set(AXIS_OBJ_HOMING_TIMEOUT, 1000);
  Tick(200);
  Control(kNew);
  const int ticks = Run();
  EXPECT_EQ(Status() & kBits, kFailed);
  EXPECT_NEAR(ticks, 1500 + 40, 20);
  ExpectStand();
}

// The limit switch at the other end stops it, and it does not turn round.
TEST_F(Homing, ALimitSwitchInTheWayEndsIt) {
  home_from_ = home_to_ = index_ = kNowhere;
  for (const int method : {19, 20, 34}) {
    SCOPED_TRACE(method);
    Prepare(method, 0);
    ExpectFailure();
    EXPECT_NEAR(place_, 4000, 5);
  }
  for (const int method : {21, 22, 33}) {
    SCOPED_TRACE(method);
    Prepare(method, 0);
    ExpectFailure();
    EXPECT_NEAR(place_, -4000, 5);
  }
}

TEST_F(Homing, ASoftLimitInTheWayEndsIt) {
  Prepare(17, 0);
  Set(AXIS_OBJ_POSITION_MIN, -1000);
  ExpectFailure();
  EXPECT_NEAR(place_, -1000, 10);
}

// Position limits refer to an origin that is yet to be found.
TEST_F(Homing, PositionLimitsDoNotHoldItUp) {
  Prepare(18, 0);
  Set(AXIS_OBJ_POSITION_LIMIT_MAX, 100);
  ASSERT_GE(Run(), 0);
  EXPECT_EQ(Status() & kBits, kDone);
}

// An axis that something holds must not wind up: 6000 count/s / 4 + 16 counts behind ends it.
TEST_F(Homing, AnAxisThatIsHeldUpEndsIt) {
  Prepare(17, 0);
  Tick(200);
  stuck_ = true;
  const double place = place_;
  int ticks = 0;
  while ((Status() & 0x2000) == 0 && ++ticks < 1000) Tick();
  EXPECT_NEAR(ticks, 1516 / 4.0, 30);
  stuck_ = false;
  ExpectStand();
  EXPECT_NEAR(place_, place, 50) << "the way that was asked for is not made up for";
}

// Contact is beyond 2 counts of the reading (contact_force), 4.5 counts deep at half a count each.
TEST_F(Homing, OnContact) {
  for (const double start : {0.0, 2500.0}) {
    SCOPED_TRACE(start);
    pos_ = kNowhere;
    wall_ = 2000;
    if (start > wall_) wall_ = start - 6;  // in contact from the start
    Prepare(-1, start);
    ASSERT_GE(Run(), 0) << std::hex << Status();
    ASSERT_EQ(Status() & kBits, kDone);
    EXPECT_GE(Home(), wall_ + 4);
    EXPECT_LE(Home(), wall_ + 7);
    EXPECT_LT(Read(AXIS_OBJ_FORCE_ACTUAL), 500);
    ExpectStand();
    EXPECT_NEAR(place_, Home(), 3);
  }
}

TEST_F(Homing, OnContactGoesBackInBetween) {
  pos_ = kNowhere;
  wall_ = 2000;
  Prepare(-1, 0);
  Set(AXIS_OBJ_HOMING_RETRACT, 300);
  while (fw_.drive.homing.step < 2) Tick();
  EXPECT_NEAR(place_, 2004 - 300, 15);
  double fastest = 0;
  while ((Status() & 0x1000) == 0) {
    Tick();
    if (Speed() > 0) fastest = std::max(fastest, Speed());
  }
  EXPECT_NEAR(fastest, 1.0, 1e-3);
}

// The reading is beyond force_limit, 10 % of 100 N or 4 counts, within a tick at that stiffness.
TEST_F(Homing, OnContactIsBoundedByForce) {
  pos_ = kNowhere;
  wall_ = 2000;
  stiffness_ = 5;
  Prepare(-1, 0);
  Set(AXIS_OBJ_FORCE_LIMIT, 100);
  ExpectFailure();
  EXPECT_LT(place_, 2010);
}

// The workpiece is gone at the second approach: not further than twice the way back.
TEST_F(Homing, AContactThatIsLostIsNotChased) {
  pos_ = kNowhere;
  wall_ = 2000;
  Prepare(-1, 0);
  while (fw_.drive.homing.step < 1) Tick();
  wall_ = kNowhere;
  ExpectFailure();
  EXPECT_LT(place_, 2010 + 500 + 20);
}

// A reading that stays is no contact.
TEST_F(Homing, AContactThatStaysIsAnError) {
  pos_ = kNowhere;
  wall_ = 2000;
  Prepare(-1, 0);
  while (fw_.drive.homing.step < 1) Tick();
  wall_ = -2000;
  stiffness_ = 0.002;
  ExpectFailure();
  EXPECT_NEAR(place_, 1500 - 80, 40);  // 80 to brake from 4 counts a tick
}

TEST_F(Homing, AForceSensorThatIsDeadEndsAtTheTravel) {
  pos_ = kNowhere;
  Prepare(-1, 0);
  Set(AXIS_OBJ_HOMING_TRAVEL, 3000);
  ExpectFailure();
  EXPECT_LT(place_, 3120);
}

// Interrupted homing stops, shows no home, and does not go on without a new edge of the start bit.
TEST_F(Homing, WhatInterruptsItIsNotResumed) {
  for (const int by : {kNew | kHalt, kOperate}) {
    SCOPED_TRACE(by);
    Prepare(17, 0);
    Tick(100);
    ASSERT_LT(Speed(), 0.0);
    Control(by);
    Tick(300);
    EXPECT_EQ(Speed(), 0.0);
    EXPECT_EQ(Status() & kBits, 0x0400);
    const double place = place_;
    if (by == (kNew | kHalt)) Control(kNew);
    Tick(300);
    EXPECT_NEAR(place_, place, 1.5);
    Control(kOperate);
    Control(kNew);
    ASSERT_GE(Run(), 0);
    EXPECT_EQ(Status() & kBits, kDone);
  }
}

// Also before the first step, while it waits for the axis to stand.
TEST_F(Homing, ItIsInterruptedBeforeItMoves) {
  for (const int by : {kNew | kHalt, kOperate}) {
    for (const int ticks : {0, 1}) {
      SCOPED_TRACE(by);
      Prepare(17, 0);
      Control(kOperate);
      Tick(100);
      const double place = place_;
      Control(kNew);
      Tick(ticks);
      Control(by);
      Tick();
      Control(by & ~kHalt);
      Tick(300);
      EXPECT_NEAR(place_, place, 1.5);
    }
  }
}

TEST_F(Homing, QuickStopAndDisablingEndIt) {
  for (const int by : {0x02, 0x07, 0x06, 0x00}) {
    SCOPED_TRACE(by);
    Prepare(17, 0);
    Tick(100);
    Control(by);
    Tick(500);
    EXPECT_NE(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
    const double place = place_;
    Control(0x06);
    Control(0x07);
    Control(kOperate);
    Tick(500);
    EXPECT_NEAR(place_, place, 1.5);
    EXPECT_EQ(fw_.drive.origin_cnt, 0);
  }
}

// Another method, speed or mode written on the way.
TEST_F(Homing, TheMethodIsThatOfTheStart) {
  Prepare(17, 0);
  Tick(100);
  Set(AXIS_OBJ_HOMING_METHOD, 18);
  ASSERT_GE(Run(), 0);
  EXPECT_NEAR(Home(), -4000, 2);
  Prepare(17, 0);
  Tick(100);
  Set(AXIS_OBJ_MODES_OF_OPERATION, kPp);
  Tick(500);
  EXPECT_EQ(Mode(), kPp);
  EXPECT_EQ(fw_.drive.origin_cnt, 0);
  EXPECT_GT(place_, -1000);
}

}  // namespace
