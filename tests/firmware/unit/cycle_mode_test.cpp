// Mode of operation -9 on the axis of the drive's tests.
#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <random>
#include <utility>
#include <vector>

#include "tests/firmware/unit/cia402_fixture.hpp"
#include "tests/firmware/unit/code_oracle.hpp"
#include "tests/firmware/unit/cycle_records.hpp"

namespace {

class CycleMode : public Drive {
 protected:
  static constexpr int kCycle = AXIS_MODES_OF_OPERATION_CYCLE;

  bool Select(std::vector<std::uint32_t> record) {
    const cycle_check_t check = fw_select_program(
        &fw_, record.data(), static_cast<std::uint32_t>(record.size() * sizeof(record[0])));
    EXPECT_TRUE(check.reason == CYCLE_ACCEPTED || check.reason == CYCLE_BUSY) << int{check.number};
    if (check.reason == CYCLE_ACCEPTED) record_ = std::move(record);
    return check.reason == CYCLE_ACCEPTED;
  }
  int Cycle() { return Read(AXIS_OBJ_CYCLE_STATE); }
  bool Runs() const { return cycle_is_running(&fw_.drive.cycle); }

  std::vector<std::uint32_t> record_;
};

cycle_phase_t move_to(std::int32_t target) {
  cycle_phase_t phase = wait_phase(CYCLE_END);
  phase.action = CYCLE_MOVE;
  phase.target = target;
  phase.speed = 3000;
  phase.time_max = 3000;
  phase.conditions[0] = {CYCLE_REACHED, CYCLE_END, 0, 0};
  return phase;
}

// A move to a position needs homing, and homing again after the encoder may have lost counts.
TEST_F(CycleMode, InvalidSensorsLoseTheReferenceOfAbsoluteMoves) {
  ASSERT_TRUE(Select(record_of({move_to(100)})));
  const auto start = [&] {
    Enable(kCycle);
    Control(kNew);
    Tick();
    return Cycle();
  };
  const auto home = [&] {
    Control(0);
    Set(AXIS_OBJ_HOMING_METHOD, 35);
    Enable(kHm);
    Control(kNew);
    Tick(200);  // the axis comes to standstill first
    Control(0);
  };
  EXPECT_EQ(start(), AXIS_CYCLE_STATE_NOT_HOMED);
  home();
  EXPECT_EQ(start(), AXIS_CYCLE_STATE_RUNNING);
  for (int i = 0; i < 1000 && Cycle() == AXIS_CYCLE_STATE_RUNNING; ++i) Tick();
  EXPECT_EQ(Cycle(), AXIS_CYCLE_STATE_GOOD);
  EXPECT_NEAR(place_, 100, 10);  // position_window
  Control(0);
  inputs_.sensor_valid = 0;
  Tick();
  inputs_.sensor_valid = 1;
  Control(0x80);
  EXPECT_EQ(start(), AXIS_CYCLE_STATE_NOT_HOMED);
  home();
  EXPECT_EQ(start(), AXIS_CYCLE_STATE_RUNNING);
}

// Random programs under a master that now and then stops: a part is good only if nobody stopped its
// cycle, it is aborted if somebody did, and all bounds of the axis hold in every phase.
TEST_F(CycleMode, RandomProgramsKeepTheBoundsAndAStoppedPartIsAborted) {
  std::mt19937 random(32);
  const auto one_in = [&](unsigned n) { return random() % n == 0; };
  Set(AXIS_OBJ_VELOCITY_MAX, 15000);  // 10 counts a tick
  Set(AXIS_OBJ_POSITION_LIMIT_MIN, -900);
  Set(AXIS_OBJ_POSITION_LIMIT_MAX, 900);
  Set(AXIS_OBJ_TARE_BAND, 8 * 256);
  Set(AXIS_OBJ_MODES_OF_OPERATION, kCycle);
  CodeOracle codes;
  std::map<int, int> ends;  // by cycle_state
  int actions[CYCLE_ACTIONS] = {};
  bool stopped = false;
  int before = Cycle();
  for (int step = 0; step < 400000; ++step) {
    if (!Runs() && one_in(40)) (void)Select(random_record(random, Read(AXIS_OBJ_POSITION_ACTUAL)));
    if (one_in(50)) wall_ = place_ + static_cast<int>(random() % 160) - 60;
    inputs_.sensor_valid = !one_in(20000);
    inputs_.din = one_in(20000) ? 0 : AXIS_DIGITAL_INPUTS_ENABLE;
    if (State() == AXIS_DRIVE_STATE_FAULT) Control(0);
    if (State() != AXIS_DRIVE_STATE_OPERATION_ENABLED) {
      Set(AXIS_OBJ_MODES_OF_OPERATION, kCycle);
      for (const int word : {0x80, 0x06, 0x0F}) Control(word);
    } else if (!Runs() && Cycle() != AXIS_CYCLE_STATE_EVALUATING) {
      if (Read(AXIS_OBJ_MODES_OF_OPERATION) != kCycle) Set(AXIS_OBJ_MODES_OF_OPERATION, kCycle);
      Control(kOperate);
      Control(kNew);
      stopped = false;
    } else if (one_in(400)) {
      const int words[] = {kOperate, kNew | kHalt, 0x06, 0x07, 0x02, 0x00};
      Control(words[random() % 6]);
      stopped = true;
    } else if (one_in(2000)) {
      Set(AXIS_OBJ_MODES_OF_OPERATION, kPp);
      stopped = true;
    } else if (one_in(2000)) {
      cia402_owner_lost(&fw_.drive, &fw_.axis, AXIS_FAULT_CAN_OFF);
      stopped = true;
    }
    const bool ran = Runs();
    const int action = ran ? int{cycle_phase(&fw_.drive.cycle)->action} : int{CYCLE_ACTIONS};
    if (ran) ++actions[action];
    const CodeOracle::Bounds bounds(fw_);
    const bool presses = action == CYCLE_PRESS || action == CYCLE_FOLLOW;
    if (!presses || fw_.drive.cycle.phase_ticks == 0) codes.Leave();
    const std::uint8_t kept =
        ran ? fw_.drive.program->outputs_keep : std::uint8_t{CYCLE_OUTPUTS_ALL};
    Tick();
    ASSERT_EQ(Runs() ? 0 : fw_.drive.cycle.outputs & ~kept, 0) << step;
    const bool pressed = presses && State() == AXIS_DRIVE_STATE_OPERATION_ENABLED;
    ASSERT_EQ(codes.Judge(bounds, inputs_, outputs_, pressed), "") << step;
    const bool follows = fw_.drive.tracking == CIA402_TRACKING_AXIS;
    ASSERT_TRUE(!follows || std::abs(Speed()) <= 10.0) << step;
    stopped = stopped || State() != AXIS_DRIVE_STATE_OPERATION_ENABLED;
    const int state = Cycle();
    if (state == AXIS_CYCLE_STATE_EVALUATING || std::exchange(before, state) == state) continue;
    ++ends[state];
    if (state == AXIS_CYCLE_STATE_ABORTED) {
      ASSERT_TRUE(stopped) << step;
    }
    if (state == AXIS_CYCLE_STATE_GOOD || state == AXIS_CYCLE_STATE_BAD) {
      ASSERT_FALSE(stopped && ran) << step;
    }
  }
  for (const int state : {AXIS_CYCLE_STATE_GOOD, AXIS_CYCLE_STATE_BAD, AXIS_CYCLE_STATE_ABORTED,
                          AXIS_CYCLE_STATE_NOT_HOMED})
    EXPECT_GT(ends[state], 100) << state;
  for (const int action :
       {CYCLE_MOVE_BY, CYCLE_MOVE_TO_DEPTH, CYCLE_APPROACH, CYCLE_PRESS, CYCLE_WAIT, CYCLE_FOLLOW})
    EXPECT_GT(actions[action], 5000) << action;
  for (const int action : {CYCLE_TARE, CYCLE_OUTPUT}) EXPECT_GT(actions[action], 1000) << action;
}

// The workpiece begins at 100 counts, with 0.5 counts of force for each count of travel. A force of
// 1000 per mille is 100 counts here.
class CyclePress : public CycleMode {
 protected:
  CyclePress() { SetForces(); }
  void SetForces() {
    wall_ = 100;
    Set(AXIS_OBJ_RATED_FORCE, 100000);
    Set(AXIS_OBJ_FORCE_SCALE, 1000000);  // 1 N for each count
    Set(AXIS_OBJ_CONTACT_FORCE, 2 * 256);
    Set(AXIS_OBJ_APPROACH_VELOCITY_MAX, 3000);
  }
  void Start(std::vector<std::uint32_t> record) {
    ASSERT_TRUE(Select(std::move(record)));
    Enable(kCycle);
    Control(kNew);
    ASSERT_EQ(Cycle(), AXIS_CYCLE_STATE_RUNNING);
  }
  // Ticks until the axis has this fault, at most `most`; 0: it has none.
  int TicksTo(int fault, int most) {
    for (int i = 1; i <= most; ++i) {
      Tick();
      if (fw_.axis.signals.fault == fault) return i;
    }
    return 0;
  }
  double DemandedForce() const { return fw_.drive.force_demand_q16 / 65536.0; }  // per mille
};

cycle_phase_t wide_phase(std::uint8_t action, std::uint8_t next) {
  cycle_phase_t phase = wait_phase(next);
  phase.action = action;
  phase.force_max_q8 = kForceMost;
  phase.travel_max = CYCLE_TRAVEL_MAX;
  phase.time_max = 30000;
  return phase;
}

cycle_phase_t press_phase(std::int16_t force, std::uint32_t slope, std::uint8_t next) {
  cycle_phase_t phase = wide_phase(CYCLE_PRESS, next);
  phase.force = force;
  phase.slope = slope;
  phase.conditions[0] = {CYCLE_REACHED, next, 0, 0};
  return phase;
}

std::vector<std::uint32_t> with_table(const std::vector<cycle_phase_t> &phases,
                                      const std::vector<cycle_point_t> &points) {
  return completed(
      {}, phases, [](cycle_element_t &e) { e.y_most = INT32_MAX; }, points);
}

// After the press the table begins at the force of the press: from 400 per mille up to 800 in 600
// ticks and down to 200 in 300 ticks. The demanded force of a tick is that of the table at the
// begin of the tick.
TEST_F(CyclePress, FollowDemandsTheTableAndThenReportsReached) {
  cycle_phase_t follow = wide_phase(CYCLE_FOLLOW, CYCLE_END);
  follow.slope = 4000;  // per mille a second; the table has 2000 at most
  follow.points = 3;
  follow.conditions[0] = {CYCLE_REACHED, CYCLE_END, 0, 0};
  Start(with_table({press_phase(400, 4000, 1), follow},
                   {{0, 400 * 256}, {600, 800 * 256}, {900, 200 * 256}}));
  for (int i = 0; i < 5000 && fw_.drive.cycle.phase == 0; ++i) Tick();
  ASSERT_EQ(fw_.drive.cycle.phase, 1);
  int ticks = 0;
  for (; Runs() && ticks < 3000; ++ticks) {
    Tick();
    if (!Runs()) break;
    const double expected = ticks <= 600   ? 400 + ticks * 400 / 600.0
                            : ticks <= 900 ? 800 - (ticks - 600) * 2.0
                                           : 200;
    ASSERT_NEAR(DemandedForce(), expected, 0.5 / 256 + 1e-9) << ticks;
  }
  EXPECT_GE(ticks, 900);
  EXPECT_LT(ticks, 1500);
  EXPECT_EQ(fw_.drive.cycle.outcome, CYCLE_BY_PROGRAM);
  EXPECT_NEAR(fw_.axis.signals.force / 256.0, 20.0, 2.1) << "200 per mille";
}

// A step of the table from 100 to 900 per mille is limited to the slope of the phase and to
// force_limit.
TEST_F(CyclePress, TheDemandOfATableKeepsTheSlopeAndForceLimit) {
  Set(AXIS_OBJ_FORCE_LIMIT, 700);
  cycle_phase_t follow = wide_phase(CYCLE_FOLLOW, CYCLE_END);
  follow.slope = 1500;  // 1 per mille a tick
  follow.points = 4;
  follow.conditions[0] = {CYCLE_TIME, CYCLE_END, 0, 3000};
  Start(with_table({press_phase(100, 4000, 1), follow},
                   {{0, 100 * 256}, {99, 100 * 256}, {100, 900 * 256}, {101, 900 * 256}}));
  for (int i = 0; i < 5000 && fw_.drive.cycle.phase == 0; ++i) Tick();
  double before = DemandedForce();
  double most = 0;
  for (int i = 0; i < 2000 && Runs(); ++i) {
    Tick();
    ASSERT_LE(std::abs(DemandedForce() - before), 1.0 + 1e-9) << i;
    before = DemandedForce();
    most = std::max(most, before);
  }
  EXPECT_EQ(most, 700.0);
}

TEST_F(CyclePress, FollowOverTravelPressesHarderAsTheWorkpieceYields) {
  cycle_phase_t follow = wide_phase(CYCLE_FOLLOW, CYCLE_END);
  follow.slope = 30000;
  follow.points = 2;
  follow.over_travel = 1;
  follow.conditions[0] = {CYCLE_TIME, CYCLE_END, 0, 1500};
  Start(with_table({press_phase(100, 4000, 1), follow}, {{0, 100 * 256}, {40, 300 * 256}}));
  for (int i = 0; i < 5000 && fw_.drive.cycle.phase == 0; ++i) Tick();
  const std::int32_t start = fw_.axis.signals.position;
  for (int i = 0; i < 600 && Runs(); ++i) {
    wall_ = 100 + i / 10;  // the workpiece yields
    const std::int32_t travel = fx_clamp(fw_.axis.signals.position - start, 0, 40);
    Tick();
    ASSERT_EQ(fw_.drive.cycle.start_cnt, start);
    ASSERT_NEAR(DemandedForce(), 100 + travel * 5, i == 0 ? 5 : 1e-9) << i;
  }
  EXPECT_EQ(DemandedForce(), 300);
}

// The sensor reads 3 counts without a force. The target of 400 per mille has an offset of 30 per
// mille, so that 400 per mille act on the workpiece, as far as force_limit permits the sum.
TEST_F(CyclePress, TheDemandedForceHasTheOffsetWithinForceLimit) {
  for (const int force_limit : {1000, 410}) {
    PowerUp();
    SetForces();
    Set(AXIS_OBJ_FORCE_LIMIT, force_limit);
    Set(AXIS_OBJ_TARE_BAND, 8 * 256);
    Set(AXIS_OBJ_CONTACT_FORCE, 6 * 256);
    offset_ = 3;
    cycle_phase_t tare = wide_phase(CYCLE_TARE, 1);
    tare.target = 150;
    tare.conditions[0] = {CYCLE_REACHED, 1, 0, 0};
    cycle_phase_t press = press_phase(400, 4000, CYCLE_END);
    press.conditions[0] = {CYCLE_TIME, CYCLE_END, 0, 30000};
    Start(record_of({tare, press}));
    for (int i = 0; i < 5000 && fw_.drive.cycle.phase == 0; ++i) Tick();
    ASSERT_EQ(fw_.drive.cycle.offset_q8, 3 * 256);
    Tick(2500);
    ASSERT_TRUE(Runs());
    EXPECT_NEAR(DemandedForce(), force_limit == 1000 ? 430 : 410, 1.0 / 256);
    Control(kOperate);
    Tick();
    Control(kNew);
    Tick();
    EXPECT_EQ(fw_.drive.cycle.outcome, CYCLE_TARE_CONTACT) << "the axis is in contact";
    EXPECT_EQ(fw_.drive.cycle.offset_q8, 0);
    EXPECT_EQ(fw_.drive.cycle_offset_q8, 0);
  }
}

// An offset of -30 per mille would turn a target of 20 per mille into one of the other direction.
TEST_F(CyclePress, AnOffsetNeverTurnsTheApproach) {
  Set(AXIS_OBJ_FORCE_ZERO_CODE, 10);
  Set(AXIS_OBJ_TARE_BAND, 8 * 256);
  Set(AXIS_OBJ_CONTACT_FORCE, 6 * 256);
  offset_ = 7;  // 3 counts below zero
  cycle_phase_t tare = wide_phase(CYCLE_TARE, 1);
  tare.target = 10;
  tare.conditions[0] = {CYCLE_REACHED, 1, 0, 0};
  cycle_phase_t press = press_phase(20, 4000, CYCLE_END);
  press.conditions[0] = {CYCLE_TIME, CYCLE_END, 0, 100};
  Start(record_of({tare, press}));
  for (int i = 0; i < 500 && fw_.drive.cycle.phase == 0; ++i) Tick();
  ASSERT_EQ(fw_.drive.cycle.offset_q8, -3 * 256);
  const double before = place_;
  for (int i = 0; i < 60; ++i) {
    Tick();
    ASSERT_GE(place_, before - 1) << i;
  }
  EXPECT_GT(place_, before + 5);
}

// tare_band bounds the sum of force_tare and the offset; without a band there is no tare.
TEST_F(CyclePress, ATareIsBoundedByTareBandAndLeavesForceTare) {
  const struct {
    int band, own, offset, outcome;
  } cases[] = {{3 * 256, 0, 3, CYCLE_BY_PROGRAM},
               {3 * 256 - 1, 0, 3, CYCLE_TARE_BAND},
               {5 * 256, 2 * 256, 5, CYCLE_BY_PROGRAM},
               {5 * 256 - 1, 2 * 256, 5, CYCLE_TARE_BAND},
               {0, 0, 0, CYCLE_TARE_BAND},
               {8 * 256, 0, 7, CYCLE_TARE_CONTACT}};
  Set(AXIS_OBJ_CONTACT_FORCE, 6 * 256);
  for (const auto &c : cases) {
    Set(AXIS_OBJ_TARE_BAND, c.band);
    Set(AXIS_OBJ_FORCE_TARE, c.own);
    offset_ = c.offset;
    cycle_phase_t tare = wide_phase(CYCLE_TARE, CYCLE_END);
    tare.target = 10;
    tare.conditions[0] = {CYCLE_REACHED, CYCLE_END, 0, 0};
    Start(record_of({tare}));
    for (int i = 0; i < 500 && Cycle() < AXIS_CYCLE_STATE_GOOD; ++i) Tick();
    EXPECT_EQ(Read(AXIS_OBJ_CYCLE_OUTCOME), c.outcome) << c.band << " " << c.own;
    EXPECT_EQ(Read(AXIS_OBJ_FORCE_TARE), c.own);
    Control(0);
    Tick(2);
  }
}

// The protections of 2230h act in phases that move and that wait as in those that press. The axis
// begins in contact; each defect is one that no other bound of the cycle or of the axis ends.
TEST_F(CyclePress, TheSensorIsSupervisedInEveryPhase) {
  enum Defect { kRailed, kJump, kStuck, kDisconnected };
  const struct {
    Defect defect;
    int fault, most;
  } defects[] = {{kRailed, AXIS_FAULT_FORCE_RAILED, 15 + 2},
                 {kJump, AXIS_FAULT_FORCE_JUMP, 1},
                 {kStuck, AXIS_FAULT_FORCE_STUCK, 60},
                 {kDisconnected, AXIS_FAULT_FORCE_DISCONNECTED, 40}};
  for (const std::uint8_t action : {CYCLE_MOVE, CYCLE_MOVE_BY, CYCLE_MOVE_TO_DEPTH, CYCLE_WAIT})
    for (const auto &c : defects) {
      if (action == CYCLE_WAIT && (c.defect == kStuck || c.defect == kDisconnected))
        continue;  // it needs a motion, or a code
      PowerUp();
      wall_ = 100, stiffness_ = 0.5, offset_ = 0.0, stuck_ = false;
      Set(AXIS_OBJ_CONTACT_FORCE, 2 * 256);
      Set(AXIS_OBJ_FORCE_ZERO_CODE, 10);
      offset_ = 10;
      place_ = 120;
      cycle_phase_t phase = wide_phase(action, CYCLE_END);
      if (action != CYCLE_WAIT) phase.target = action == CYCLE_MOVE ? 300 : 180, phase.speed = 300;
      phase.conditions[0] = {CYCLE_TIME, CYCLE_END, 0, 20000};
      ASSERT_TRUE(Select(completed({}, {phase}, [](cycle_element_t &e) { e.y_most = INT32_MAX; })));
      if (c.defect == kRailed) Set(AXIS_OBJ_FORCE_RAILED_TIME, 10);
      if (c.defect == kJump) Set(AXIS_OBJ_FORCE_JUMP_MAX, 10 * 256);
      if (c.defect == kStuck) {
        Set(AXIS_OBJ_FORCE_STUCK_TRAVEL, 5);
        Set(AXIS_OBJ_FORCE_STUCK_TIME, 1000);
      }
      if (c.defect == kDisconnected) {
        Set(AXIS_OBJ_FORCE_DISCONNECTED_CODE, 1);
        Set(AXIS_OBJ_FORCE_DISCONNECTED_TIME, 10);
        Set(AXIS_OBJ_FORCE_DISCONNECTED_TRAVEL, 2);
      }
      Enable(kCycle);
      fw_.drive.homed = 1;  // CYCLE_MOVE counts from the reference
      Control(kNew);
      ASSERT_EQ(Cycle(), AXIS_CYCLE_STATE_RUNNING) << int{action};
      Tick(24);
      ASSERT_TRUE(Runs()) << "healthy";
      stiffness_ = 0;
      offset_ = c.defect == kRailed ? 0 : c.defect == kJump ? 60 : c.defect == kStuck ? 50 : 10;
      if (c.defect == kStuck) {
        Tick(1);
        ASSERT_TRUE(Runs());
      }
      if (c.defect == kDisconnected) stuck_ = true;
      // A code at the end of the range exceeds force_max of the phase in the same tick.
      if (c.defect == kRailed) {
        Tick(1);
        EXPECT_FALSE(Runs()) << int{action};
        continue;
      }
      EXPECT_NE(TicksTo(c.fault, c.most), 0) << int{action} << " " << int{c.defect};
      Tick(2);
      EXPECT_EQ(Cycle(), AXIS_CYCLE_STATE_ABORTED);
    }
}

// Turns of a press and of a phase without force control count like one press: 500 counts from the
// first contact, of a workpiece that yields.
TEST_F(CyclePress, TravelInContactCountsFromTheFirstContactOfTheCycle) {
  for (const std::uint8_t other : {CYCLE_WAIT, CYCLE_PRESS, CYCLE_MOVE_BY}) {
    PowerUp();
    wall_ = 100;
    Set(AXIS_OBJ_RATED_FORCE, 100000);
    Set(AXIS_OBJ_FORCE_SCALE, 1000000);
    Set(AXIS_OBJ_CONTACT_FORCE, 2 * 256);
    Set(AXIS_OBJ_APPROACH_VELOCITY_MAX, 3000);
    Set(AXIS_OBJ_CONTACT_TRAVEL_MAX, 500);
    cycle_phase_t press = press_phase(300, 4000, 1);
    press.conditions[0] = {CYCLE_TIME, 1, 0, 200};
    cycle_phase_t turn = other == CYCLE_PRESS ? press_phase(350, 4000, 0) : wide_phase(other, 0);
    if (other == CYCLE_MOVE_BY) turn.target = 30, turn.speed = 3000;
    turn.conditions[0] = {CYCLE_TIME, 0, 0, other == CYCLE_WAIT ? 1 : 40};
    Start(completed({}, {press, turn}, [](cycle_element_t &e) { e.y_most = INT32_MAX; }));
    int ticks = 0;
    for (; ticks < 20000 && Runs(); ++ticks) {
      Tick();
      if (fw_.drive.signals.contact != 0) wall_ += 0.3;  // slower than the axis follows
    }
    Tick();  // in which the fault acts
    EXPECT_EQ(fw_.axis.signals.fault, AXIS_FAULT_CONTACT_TRAVEL) << int{other};
    EXPECT_NEAR(place_ - 100, 500, 60) << int{other};
    EXPECT_EQ(Cycle(), AXIS_CYCLE_STATE_ABORTED);
  }
}

// A motion in contact that no press follows, from the first contact of the cycle on.
TEST_F(CyclePress, TravelInContactCountsInAMotion) {
  stiffness_ = 0.05;
  Set(AXIS_OBJ_CONTACT_TRAVEL_MAX, 500);
  cycle_phase_t on = wide_phase(CYCLE_MOVE_BY, CYCLE_END);
  on.target = 2000, on.speed = 3000;
  on.conditions[0] = {CYCLE_REACHED, CYCLE_END, 0, 0};
  Start(completed({}, {on}, [](cycle_element_t &e) { e.y_most = INT32_MAX; }));
  for (int i = 0; i < 5000 && Runs(); ++i) Tick();
  Tick();
  EXPECT_EQ(fw_.axis.signals.fault, AXIS_FAULT_CONTACT_TRAVEL);
  // The force is more than 2 counts from 40 counts behind the begin of the workpiece on.
  EXPECT_NEAR(place_, 100 + 40 + 500, 25);
}

// A contact in a phase that controls no force ends the approach of the press before it.
TEST_F(CyclePress, AContactInAMotionEndsTheApproach) {
  for (const bool touches : {true, false}) {
    PowerUp();
    wall_ = touches ? 1000 : 1e12;
    Set(AXIS_OBJ_CONTACT_FORCE, 2 * 256);
    Set(AXIS_OBJ_APPROACH_VELOCITY_MAX, 300);  // 0.2 counts a tick
    Set(AXIS_OBJ_APPROACH_TIMEOUT, 400);
    cycle_phase_t press = press_phase(300, 4000, 1), on = wide_phase(CYCLE_MOVE_BY, 2);
    cycle_phase_t back = wide_phase(CYCLE_MOVE_BY, 3), last = press_phase(300, 4000, CYCLE_END);
    press.conditions[0] = {CYCLE_TIME, 1, 0, 400};
    on.target = 1100, on.speed = 15000, on.conditions[0] = {CYCLE_TIME, 2, 0, 300};
    back.target = -1100, back.speed = 15000, back.conditions[0] = {CYCLE_TIME, 3, 0, 300};
    last.conditions[0] = {CYCLE_TIME, CYCLE_END, 0, 400};
    Start(completed({}, {press, on, back, last}, [](cycle_element_t &e) { e.y_most = INT32_MAX; }));
    for (int i = 0; i < 5000 && Runs(); ++i) Tick();
    Tick();
    EXPECT_EQ(fw_.axis.signals.fault, touches ? AXIS_FAULT_NONE : AXIS_FAULT_NO_CONTACT);
  }
}

// A program may come back to its start and press again: the guard counts onward travel in contact,
// and a free motion counts for nothing.
TEST_F(CyclePress, FreeMotionIsNoTravelInContact) {
  Set(AXIS_OBJ_CONTACT_TRAVEL_MAX, 100);
  cycle_phase_t press = press_phase(300, 4000, 1);
  press.conditions[0] = {CYCLE_TIME, 1, 0, 400};
  cycle_phase_t on = wide_phase(CYCLE_MOVE_BY, CYCLE_END);
  on.target = 400, on.speed = 3000;
  on.conditions[0] = {CYCLE_REACHED, CYCLE_END, 0, 0};
  Start(completed({}, {press, on}, [](cycle_element_t &e) { e.y_most = INT32_MAX; }));
  for (int i = 0; i < 5000 && fw_.drive.cycle.phase == 0; ++i) Tick();
  wall_ = 1e12;  // the part is through
  for (int i = 0; i < 5000 && Runs(); ++i) Tick();
  Tick();
  EXPECT_EQ(fw_.axis.signals.fault, AXIS_FAULT_NONE);
  EXPECT_EQ(Cycle(), AXIS_CYCLE_STATE_GOOD);
}

// The bounds of an approach hold for the sum of the phases that press without contact, however
// short they are and whatever is between them.
TEST_F(CyclePress, TheBoundsOfAnApproachHoldInTurnsOfPressAndOutput) {
  for (const bool by_time : {true, false})
    for (const int ticks : {1, 2, 3, 50}) {
      PowerUp();
      wall_ = 1e12;
      Set(AXIS_OBJ_RATED_FORCE, 100000);
      Set(AXIS_OBJ_FORCE_SCALE, 1000000);
      Set(AXIS_OBJ_CONTACT_FORCE, 2 * 256);
      Set(AXIS_OBJ_APPROACH_VELOCITY_MAX, 3000);
      Set(by_time ? AXIS_OBJ_APPROACH_TIMEOUT : AXIS_OBJ_APPROACH_TRAVEL_MAX, by_time ? 400 : 300);
      cycle_phase_t press = press_phase(300, 4000, 1), output = wide_phase(CYCLE_OUTPUT, 0);
      press.conditions[0] = {CYCLE_TIME, 1, 0, ticks};
      output.outputs_on = 1;
      output.conditions[0] = {CYCLE_REACHED, 0, 0, 0};
      Start(completed({}, {press, output}, [](cycle_element_t &e) { e.y_most = INT32_MAX; }));
      int pressed = 0;
      double travel = 0;
      for (int i = 0; i < 30000 && Runs(); ++i) {
        const bool presses = fw_.drive.cycle.phase == 0;
        const double before = place_;
        Tick();
        pressed += presses ? 1 : 0;
        travel += presses ? std::abs(place_ - before) : 0;
      }
      Tick();  // in which the fault acts
      EXPECT_EQ(fw_.axis.signals.fault, AXIS_FAULT_NO_CONTACT) << ticks;
      if (by_time) {
        EXPECT_NEAR(pressed, 600, 12) << ticks;
      } else {
        EXPECT_LE(travel, 340) << ticks;
      }
      EXPECT_EQ(Cycle(), AXIS_CYCLE_STATE_ABORTED);
    }
}

// A tare after the selection moves the end of the reading, 255 counts, below the force_max.
TEST_F(CyclePress, AForceAtTheEndOfTheSensorIsRefusedAtTheStart) {
  const struct {
    int zero, sign, tare, force_max, above;
    bool starts;
  } cases[] = {
      {0, 1, 0, 255 * 256 - 1, 0, true},    {0, 1, 0, 255 * 256, 0, false},
      {0, 1, 256, 254 * 256 - 1, 0, true},  {0, 1, 256, 254 * 256, 0, false},
      {0, 1, 0, 1000, 255 * 256 - 1, true}, {0, 1, 0, 1000, 255 * 256, false},
      {128, 1, 0, 127 * 256 - 1, 0, true},  {128, 1, 0, 127 * 256, 0, false},
      {0, -1, 0, 255 * 256, 0, false},      {0, -1, 0, 255 * 256 - 1, 0, true},
      {128, -1, 0, 128 * 256 - 1, 0, true}, {128, -1, 0, 128 * 256, 0, false},
      {192, 1, 0, 63 * 256, 0, false},      {192, 1, 0, 63 * 256 - 1, 0, true},
      {10, 1, 0, 245 * 256 - 1, 0, true},   {10, 1, 0, 245 * 256, 0, false},
  };
  for (const auto &c : cases) {
    PowerUp();
    cycle_phase_t phase = wait_phase(CYCLE_END);
    phase.force_max_q8 = static_cast<std::uint32_t>(c.force_max);
    if (c.above != 0) phase.conditions[1] = {CYCLE_FORCE_ABOVE, CYCLE_END, 0, c.above};
    ASSERT_TRUE(Select(record_of({phase})));
    Set(AXIS_OBJ_FORCE_ZERO_CODE, c.zero);
    Set(AXIS_OBJ_FORCE_SIGN, c.sign);
    Set(AXIS_OBJ_FORCE_TARE, c.tare);
    offset_ = c.zero;
    Enable(kCycle);
    Control(kNew);
    Tick();
    EXPECT_EQ(Cycle(), c.starts ? AXIS_CYCLE_STATE_RUNNING : AXIS_CYCLE_STATE_BEYOND_SENSOR)
        << c.zero << " " << c.sign << " " << c.tare << " " << c.force_max << " " << c.above;
    EXPECT_EQ((Read(AXIS_OBJ_CYCLE_BITS) & 1), 0) << "not ready";
    Control(0);
  }
}

// The part of the press is aged: force or position are as old as a bus cycle, or older.
TEST_F(CyclePress, SamplesOlderThanABusCycleMakeThePartBad) {
  for (const bool of_force : {true, false})
    for (const int age : {3, 4, 14}) {
      PowerUp();
      const int most = Read(AXIS_OBJ_CYCLE_AGE_MAX);
      ASSERT_EQ(most, 3) << "2 ms";
      ASSERT_TRUE(Select(record_of({wait_phase(CYCLE_END)})));
      Enable(kCycle);
      Control(kNew);
      for (int i = 0; i < 14; ++i) {
        (of_force ? inputs_.force_age : inputs_.position_age) =
            static_cast<std::uint8_t>(i == 5 || i == 6 ? age : 0);
        Tick();
      }
      EXPECT_EQ(Cycle(), age <= most ? AXIS_CYCLE_STATE_GOOD : AXIS_CYCLE_STATE_BAD) << age;
      EXPECT_EQ(Read(AXIS_OBJ_CYCLE_OUTCOME),
                age <= most ? CYCLE_BY_PROGRAM : CYCLE_SAMPLES_INVALID);
      EXPECT_EQ(Read(AXIS_OBJ_CYCLE_RESULT_INVALID), age <= most ? 0 : 2);
      Control(0);
    }
}

TEST_F(CycleMode, OutputsReachTheAxisAndAreOffAfterEachStop) {
  cycle_phase_t on = wait_phase(1), hold = wait_phase(CYCLE_END);
  on.action = CYCLE_OUTPUT;
  on.outputs_on = 6;
  on.conditions[0] = {CYCLE_REACHED, 1, 0, 0};
  hold.time_max = 100000;
  hold.conditions[0].level = 100000;
  cycle_header_t header{};
  header.outputs_keep = 4;
  ASSERT_TRUE(Select(completed(header, {on, hold})));
  const std::function<void()> stops[] = {
      [&] { Control(kOperate); },
      [&] { Control(kNew | kHalt); },
      [&] { Control(0x02); },
      [&] { Control(0); },
      [&] { inputs_.sensor_valid = 0; },
      [&] { inputs_.din = 0; },
      [&] { Set(AXIS_OBJ_MODES_OF_OPERATION, kPp); },
      [&] { cia402_owner_lost(&fw_.drive, &fw_.axis, AXIS_FAULT_CAN_OFF); }};
  for (std::size_t i = 0; i < std::size(stops); ++i) {
    inputs_.sensor_valid = 1;
    inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
    for (const int word : {0, 0x80, 0}) Control(word), Tick(2);
    Enable(kCycle);
    Control(kNew);
    Tick(4);
    ASSERT_TRUE(Runs());
    ASSERT_EQ(Read(AXIS_OBJ_CYCLE_OUTPUTS), 6);
    ASSERT_EQ(outputs_.digital, 6);
    stops[i]();
    Tick(2);
    EXPECT_EQ(Cycle(), AXIS_CYCLE_STATE_ABORTED) << i;
    EXPECT_EQ(Read(AXIS_OBJ_CYCLE_OUTPUTS), 4) << i;
    EXPECT_EQ(outputs_.digital, 4) << "the output to keep, " << i;
  }
  ASSERT_TRUE(Select(record_of({hold})));
  Tick();
  EXPECT_EQ(outputs_.digital, 0) << "a selection of a program";
}

// The edge comes between the stop of a cycle and the evaluation of its last samples.
TEST_F(CycleMode, AStartWhileTheLastSamplesAreEvaluatedIsNotLost) {
  cycle_phase_t hold = wait_phase(CYCLE_END);
  hold.time_max = 100000;
  hold.conditions[0].level = 100000;
  ASSERT_TRUE(Select(record_of({hold})));
  Enable(kCycle);
  Control(kNew);
  Tick(5);
  for (const bool withdrawn : {false, true}) {
    ASSERT_TRUE(Runs());
    const int count = Read(AXIS_OBJ_CYCLE_COUNT);
    Control(kOperate);
    ASSERT_EQ(Cycle(), AXIS_CYCLE_STATE_EVALUATING);
    Control(kNew);
    if (withdrawn) Control(kOperate);
    Tick(3);
    EXPECT_EQ(Runs(), !withdrawn);
    EXPECT_EQ(Read(AXIS_OBJ_CYCLE_COUNT), count + (withdrawn ? 0 : 1));
  }
  EXPECT_EQ(Cycle(), AXIS_CYCLE_STATE_IDLE) << "a start before any tick is no cycle";
}

TEST_F(CycleMode, APlaceBeyondTheRangeOfPositionsEndsTheCycleAsNotGood) {
  cycle_phase_t far = wide_phase(CYCLE_MOVE_BY, CYCLE_END);
  far.target = INT32_MAX;
  far.speed = 3000;
  far.conditions[0] = {CYCLE_TIME, CYCLE_END, 0, 10};
  ASSERT_TRUE(Select(record_of({far})));
  place_ = 10;
  Enable(kCycle);
  Control(kNew);
  Tick(30);
  EXPECT_EQ(Cycle(), AXIS_CYCLE_STATE_BAD);
  EXPECT_EQ(Read(AXIS_OBJ_CYCLE_OUTCOME), CYCLE_OVER_TRAVEL);
  EXPECT_NEAR(place_, 10, 1) << "the axis did not move";
}

}  // namespace
