// Mode of operation -9 on the axis of the drive's tests.
#include <gtest/gtest.h>

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
  Set(AXIS_OBJ_MODES_OF_OPERATION, kCycle);
  CodeOracle codes;
  int ends[AXIS_CYCLE_STATE_NOT_HOMED + 1] = {}, actions[CYCLE_ACTIONS] = {};
  bool stopped = false;
  int before = Cycle();
  for (int step = 0; step < 400000; ++step) {
    if (!Runs() && one_in(40)) (void)Select(random_record(random, Read(AXIS_OBJ_POSITION_ACTUAL)));
    if (one_in(50)) wall_ = place_ + static_cast<int>(random() % 160) - 60;
    inputs_.sensor_valid = !one_in(20000);
    inputs_.din = one_in(20000) ? 0 : AXIS_DIN_ENABLE;
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
    if (action != CYCLE_PRESS || fw_.drive.cycle.phase_ticks == 0) codes.Leave();
    Tick();
    const bool pressed = action == CYCLE_PRESS && State() == AXIS_DRIVE_STATE_OPERATION_ENABLED;
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
       {CYCLE_MOVE_BY, CYCLE_MOVE_TO_TOUCH, CYCLE_APPROACH, CYCLE_PRESS, CYCLE_WAIT})
    EXPECT_GT(actions[action], 5000) << action;
}

}  // namespace
