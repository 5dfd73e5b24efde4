// The sequence of a cycle: its record, conditions, limits, loops and ends. The elements are in
// tests/firmware/unit/test_cycle_elements.py.
#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "tests/firmware/unit/cycle_records.hpp"

namespace {

cycle_check_t check(const std::vector<std::uint32_t> &words) {
  return cycle_program_check(words.data(), static_cast<std::uint32_t>(4 * words.size()));
}

class Cycle : public ::testing::Test {
 protected:
  void start(const std::vector<cycle_phase_t> &phases, std::uint8_t zero = CYCLE_ZERO_TOUCH,
             std::int32_t zero_level = 0) {
    begin(record_with_zero(phases, zero, zero_level));
  }
  void begin(std::vector<std::uint32_t> record) {
    words_ = std::move(record);
    ASSERT_EQ(check(words_).reason, CYCLE_ACCEPTED);
    now_ = {};
    now_.tick = 0xFFFFFFF0u;  // the number of the tick wraps
    now_.position = INT32_MAX - 20;
    cycle_start(&cycle_, reinterpret_cast<const cycle_header_t *>(words_.data()), &now_,
                reference_);
  }
  // One tick, with its evaluation. Returns the phase after it, or CYCLE_END.
  int tick() {
    ++now_.tick;
    cycle_step(&cycle_, &now_);
    cycle_evaluate(&cycle_);
    return cycle_is_running(&cycle_) ? int{cycle_.phase} : int{CYCLE_END};
  }
  void move(std::int32_t counts) { now_.position = fx_sum_wrap(now_.position, counts); }

  std::vector<std::uint32_t> words_;
  cycle_t cycle_{};
  cycle_inputs_t now_{};
  std::int32_t reference_ = 0;  // position of travel 0 for CYCLE_ZERO_POSITION
};

TEST_F(Cycle, EveryFlippedBitOfARecordIsRefused) {
  std::vector<std::uint32_t> words = record_of({wait_phase(1), wait_phase(CYCLE_END)});
  ASSERT_EQ(check(words).reason, CYCLE_ACCEPTED);
  for (std::uint32_t &word : words)
    for (int bit = 0; bit < 32; ++bit) {
      word ^= 1u << bit;
      ASSERT_NE(check(words).reason, CYCLE_ACCEPTED) << &word - words.data() << " " << bit;
      word ^= 1u << bit;
    }
}

TEST_F(Cycle, AShortOrLongRecordIsRefused) {
  std::vector<std::uint32_t> words = record_of({wait_phase(CYCLE_END)});
  for (std::uint32_t size = 0; size < 4 * words.size(); ++size)
    ASSERT_NE(cycle_program_check(words.data(), size).reason, CYCLE_ACCEPTED) << size;
  words.push_back(0);
  EXPECT_EQ(check(words).reason, CYCLE_WRONG_SIZE);
}

TEST_F(Cycle, WrongPhasesAreRefusedByTheirNumber) {
  const auto refused = [](void (*change)(cycle_phase_t &)) {
    std::vector<cycle_phase_t> phases{wait_phase(1), wait_phase(CYCLE_END)};
    change(phases[1]);
    const cycle_check_t found = check(record_of(phases));
    return found.reason == CYCLE_WRONG_PHASE && found.number == 1;
  };
  EXPECT_TRUE(refused([](cycle_phase_t &p) { p.action = CYCLE_ACTIONS; }));
  EXPECT_TRUE(refused([](cycle_phase_t &p) { p.reaction = 2; }));
  EXPECT_TRUE(refused([](cycle_phase_t &p) { p.stiffness_travel = 1; }));
  EXPECT_TRUE(refused([](cycle_phase_t &p) { p.force_max_q8 = 0; }));
  EXPECT_TRUE(refused([](cycle_phase_t &p) { p.force_max_q8 = CYCLE_FORCE_MAX_Q8 + 1; }));
  EXPECT_TRUE(refused([](cycle_phase_t &p) { p.travel_max = 0; }));
  EXPECT_TRUE(refused([](cycle_phase_t &p) { p.travel_max = CYCLE_TRAVEL_MAX + 1u; }));
  EXPECT_TRUE(refused([](cycle_phase_t &p) { p.time_max = 0; }));
  EXPECT_TRUE(refused([](cycle_phase_t &p) { p.speed = 1; }));
  EXPECT_TRUE(refused([](cycle_phase_t &p) { p.action = CYCLE_MOVE; }));   // without a speed
  EXPECT_TRUE(refused([](cycle_phase_t &p) { p.action = CYCLE_PRESS; }));  // without a force
  EXPECT_TRUE(refused([](cycle_phase_t &p) { p.conditions[3].when = CYCLE_CONDITION_KINDS; }));
  EXPECT_TRUE(refused([](cycle_phase_t &p) { p.conditions[3].next = 2; }));
  EXPECT_TRUE(refused([](cycle_phase_t &p) { p.conditions[0].level = 0; }));
  EXPECT_TRUE(refused([](cycle_phase_t &p) { p.conditions[1] = {CYCLE_CONTACT, 0, 0, 1}; }));
  EXPECT_TRUE(refused([](cycle_phase_t &p) { p.conditions[1] = {CYCLE_INPUT_ON, 0, 0, 32}; }));
  EXPECT_TRUE(refused([](cycle_phase_t &p) {
    p.conditions[1] = {CYCLE_FORCE_ABOVE, 0, 0, 131072};
  }));
}

TEST_F(Cycle, StiffnessNeedsItsSectionAndNothingElseHasOne) {
  const auto accepted = [](std::uint8_t when, std::uint32_t section) {
    cycle_phase_t phase = wait_phase(CYCLE_END);
    phase.conditions[0] = {when, CYCLE_END, 0, 5};
    phase.stiffness_travel = section;
    return check(record_of({phase})).reason == CYCLE_ACCEPTED;
  };
  EXPECT_TRUE(accepted(CYCLE_STIFFNESS_ABOVE, 1));
  EXPECT_TRUE(accepted(CYCLE_STIFFNESS_BELOW, 65535));
  EXPECT_FALSE(accepted(CYCLE_STIFFNESS_ABOVE, 0));
  EXPECT_FALSE(accepted(CYCLE_STIFFNESS_BELOW, 65536));
  EXPECT_FALSE(accepted(CYCLE_TIME, 1));
}

TEST_F(Cycle, AWrongZeroIsRefused) {
  const auto accepted = [](std::uint8_t zero, std::int32_t level) {
    return check(record_with_zero({wait_phase(CYCLE_END)}, zero, level)).reason == CYCLE_ACCEPTED;
  };
  EXPECT_TRUE(accepted(CYCLE_ZERO_TOUCH, 0));
  EXPECT_FALSE(accepted(CYCLE_ZERO_TOUCH, 1));
  EXPECT_TRUE(accepted(CYCLE_ZERO_FORCE, -1));
  EXPECT_FALSE(accepted(CYCLE_ZERO_FORCE, 0));
  EXPECT_FALSE(accepted(CYCLE_ZERO_FORCE, 131072));
  EXPECT_TRUE(accepted(CYCLE_ZERO_POSITION, INT32_MIN));
  EXPECT_FALSE(accepted(CYCLE_ZEROS, 0));
  std::vector<std::uint32_t> words =
      record_with_zero({wait_phase(CYCLE_END)}, CYCLE_ZERO_FORCE, 1, 1);
  EXPECT_EQ(check(words).reason, CYCLE_WRONG_ZERO) << "reserved bytes";
}

// Force over travel by hand: sections of 4 counts, with 8/4 and then 16/4 and -12/-4.
TEST_F(Cycle, StiffnessIsThatOfTheLastCompleteSection) {
  cycle_phase_t first = wait_phase(CYCLE_END);
  first.stiffness_travel = 4;
  first.conditions[0] = {CYCLE_STIFFNESS_ABOVE, 1, 0, 4 * 65536};
  cycle_phase_t second = first;
  second.conditions[0] = {CYCLE_STIFFNESS_BELOW, CYCLE_END, 0, 3 * 65536};
  start({first, second});
  const auto go = [&](std::int32_t counts, std::int32_t force_q8) {
    move(counts);
    now_.force_q8 = force_q8;
    return tick();
  };
  EXPECT_EQ(go(2, 100), 0) << "the section is not complete";
  EXPECT_EQ(go(2, 8), 0);
  EXPECT_EQ(go(3, 800), 0);
  EXPECT_EQ(go(1, 23), 0) << "15/4 is less than 4";
  EXPECT_EQ(go(4, 39), 1) << "16/4 is 4";
  EXPECT_EQ(go(0, 39), 1) << "the second phase has no section yet";
  EXPECT_EQ(go(-3, 0), 1);
  EXPECT_EQ(go(-1, 26), 1) << "-13/-4 is more than 3";
  EXPECT_EQ(go(-4, 14), CYCLE_END) << "-12/-4 is 3";
}

TEST_F(Cycle, TravelCountsFromAForceOrAPosition) {
  cycle_phase_t first = wait_phase(CYCLE_END);
  first.conditions[0] = {CYCLE_TOUCH_ABOVE, 1, 0, 10};
  start({first, wait_phase(CYCLE_END)}, CYCLE_ZERO_FORCE, 200);
  now_.contact = 1;  // a contact is not the zero
  now_.force_q8 = 199;
  move(100);
  EXPECT_EQ(tick(), 0);
  now_.force_q8 = 200;
  EXPECT_EQ(tick(), 0);
  now_.force_q8 = 0;
  move(9);
  EXPECT_EQ(tick(), 0);
  move(1);
  EXPECT_EQ(tick(), 1);
  start({first, wait_phase(CYCLE_END)}, CYCLE_ZERO_FORCE, -200);
  now_.force_q8 = -200;
  EXPECT_EQ(tick(), 0);
  move(10);
  EXPECT_EQ(tick(), 1);
  reference_ = INT32_MAX - 20;  // where the cycle starts
  start({first, wait_phase(CYCLE_END)}, CYCLE_ZERO_POSITION, 7);
  move(9);
  EXPECT_EQ(tick(), 0);
  move(1);
  EXPECT_EQ(tick(), 1);
}

// Each condition, in the tick in which it becomes true and not in the one before.
TEST_F(Cycle, EachConditionEndsThePhaseInItsTick) {
  struct Case {
    std::uint8_t when;
    std::int32_t level;
    void (*before)(cycle_inputs_t &);
    void (*then)(cycle_inputs_t &);
  };
  const Case cases[] = {
      {CYCLE_REACHED, 0, [](cycle_inputs_t &) {}, [](cycle_inputs_t &n) { n.reached = 1; }},
      {CYCLE_FORCE_ABOVE, 300, [](cycle_inputs_t &n) { n.force_q8 = 299; },
       [](cycle_inputs_t &n) { n.force_q8 = 300; }},
      {CYCLE_FORCE_BELOW, -300, [](cycle_inputs_t &n) { n.force_q8 = -299; },
       [](cycle_inputs_t &n) { n.force_q8 = -300; }},
      {CYCLE_TRAVEL_ABOVE, 40, [](cycle_inputs_t &n) { n.position = INT32_MIN + 18; },
       [](cycle_inputs_t &n) { n.position = INT32_MIN + 19; }},
      {CYCLE_TRAVEL_ABOVE, 40, [](cycle_inputs_t &n) { n.position = INT32_MAX - 59; },
       [](cycle_inputs_t &n) { n.position = INT32_MAX - 60; }},
      {CYCLE_CONTACT, 0, [](cycle_inputs_t &) {}, [](cycle_inputs_t &n) { n.contact = 1; }},
      {CYCLE_LOST, 0, [](cycle_inputs_t &n) { n.contact = 1; },
       [](cycle_inputs_t &n) { n.contact = 0; }},
      {CYCLE_INPUT_ON, 3, [](cycle_inputs_t &n) { n.inputs = 1; },
       [](cycle_inputs_t &n) { n.inputs = 7; }},
      {CYCLE_INPUT_OFF, 3, [](cycle_inputs_t &n) { n.inputs = 1; },
       [](cycle_inputs_t &n) { n.inputs = 4; }},
      // Only after the first contact, from its position on.
      {CYCLE_TOUCH_ABOVE, 0, [](cycle_inputs_t &) {}, [](cycle_inputs_t &n) { n.contact = 1; }},
      {CYCLE_TOUCH_BELOW, -5, [](cycle_inputs_t &n) { n.contact = 1; },
       [](cycle_inputs_t &n) { n.position -= 5; }},
  };
  for (const Case &c : cases) {
    cycle_phase_t first = wait_phase(CYCLE_END);
    first.conditions[0] = {c.when, 1, 0, c.level};
    start({first, wait_phase(CYCLE_END)});
    c.before(now_);
    for (int i = 0; i < 3; ++i) ASSERT_EQ(tick(), 0) << int{c.when};
    c.then(now_);
    ASSERT_EQ(tick(), 1) << int{c.when};
  }
}

TEST_F(Cycle, TimeIsThatOfThePhase) {
  start({wait_phase(1), wait_phase(CYCLE_END)});
  for (int i = 1; i < 10; ++i) ASSERT_EQ(tick(), 0);
  for (int i = 0; i < 10; ++i) ASSERT_EQ(tick(), 1);
  EXPECT_EQ(tick(), CYCLE_END);
  EXPECT_EQ(cycle_.state, CYCLE_DONE);
  EXPECT_EQ(cycle_.outcome, CYCLE_BY_PROGRAM);
  EXPECT_EQ(cycle_.good, 1);
}

TEST_F(Cycle, TheFirstConditionOfTheFileCounts) {
  cycle_phase_t first = wait_phase(CYCLE_END);
  first.conditions[0] = {CYCLE_FORCE_ABOVE, 1, 0, 100};
  first.conditions[1] = {CYCLE_FORCE_ABOVE, 2, 0, 50};
  start({first, wait_phase(CYCLE_END), wait_phase(CYCLE_END)});
  now_.force_q8 = 100;
  EXPECT_EQ(tick(), 1);
}

TEST_F(Cycle, ALoopEndsAfterItsCount) {
  cycle_phase_t last = wait_phase(CYCLE_END);
  last.conditions[0] = {CYCLE_TIME, 0, 3, 10};          // three times back to the start
  last.conditions[1] = {CYCLE_TIME, CYCLE_END, 0, 11};  // then the end
  start({wait_phase(1), last});
  int ticks = 1;
  while (tick() != CYCLE_END) ++ticks;
  EXPECT_EQ(ticks, 4 * 10 + 3 * 10 + 11);
  EXPECT_EQ(cycle_.good, 1);
}

TEST_F(Cycle, EachLimitEndsThePartAsNotGoodByName) {
  struct Case {
    std::uint8_t outcome;
    void (*exceed)(cycle_inputs_t &);
  };
  const Case cases[] = {
      {CYCLE_OVER_FORCE, [](cycle_inputs_t &n) { n.force_q8 = -1001; }},
      {CYCLE_OVER_TRAVEL, [](cycle_inputs_t &n) { n.position -= 501; }},
      {CYCLE_OVER_TIME, [](cycle_inputs_t &) {}},
  };
  for (const Case &c : cases) {
    cycle_phase_t first = wait_phase(CYCLE_END);
    first.reaction = 1;
    first.conditions[0] = {CYCLE_REACHED, CYCLE_END, 0, 0};
    start({first, wait_phase(CYCLE_END)});
    c.exceed(now_);
    int ticks = 1;
    while (tick() == 0) ++ticks;
    EXPECT_EQ(ticks, c.outcome == CYCLE_OVER_TIME ? 101 : 1);
    ASSERT_EQ(cycle_.phase, 1) << "the reaction";
    now_.force_q8 = 0;
    while (tick() != CYCLE_END) continue;
    EXPECT_EQ(cycle_.outcome, c.outcome);
    EXPECT_EQ(cycle_.failed_phase, 0);
    EXPECT_EQ(cycle_.good, 0);
  }
}

TEST_F(Cycle, ALimitAtItsValueIsKept) {
  start({wait_phase(CYCLE_END)});
  now_.force_q8 = 1000;
  move(500);
  EXPECT_EQ(tick(), 0);
}

TEST_F(Cycle, ASecondLimitEndsTheCycleAndTheFirstOneIsTheReason) {
  cycle_phase_t first = wait_phase(CYCLE_END);
  first.reaction = 0;  // its own reaction
  start({first});
  now_.force_q8 = 2000;
  EXPECT_EQ(tick(), 0);
  move(1000);
  EXPECT_EQ(tick(), CYCLE_END);
  EXPECT_EQ(cycle_.outcome, CYCLE_OVER_FORCE);
  EXPECT_EQ(cycle_.good, 0);
}

// Ticks that the port has missed are part of the duration, and no sample says what happened in
// them.
TEST_F(Cycle, AMissingTickMakesThePartBadAndThePhasesGoOn) {
  start({wait_phase(1), wait_phase(CYCLE_END)});
  for (int i = 1; i < 5; ++i) ASSERT_EQ(tick(), 0);
  now_.tick += 4;
  ASSERT_EQ(tick(), 0) << "the ninth tick";
  ASSERT_EQ(tick(), 1) << "the tenth tick";
  while (tick() != CYCLE_END) continue;
  EXPECT_EQ(cycle_.state, CYCLE_DONE);
  EXPECT_EQ(cycle_.outcome, CYCLE_SAMPLES_LOST);
  EXPECT_EQ(cycle_.good, 0);
}

TEST_F(Cycle, AnAbortedCycleIsNeverGood) {
  start({wait_phase(CYCLE_END)});
  tick();
  cycle_abort(&cycle_);
  EXPECT_FALSE(cycle_is_running(&cycle_));
  cycle_evaluate(&cycle_);
  EXPECT_EQ(cycle_.state, CYCLE_DONE);
  EXPECT_EQ(cycle_.outcome, CYCLE_STOPPED);
  EXPECT_EQ(cycle_.good, 0);
  const std::uint8_t before = cycle_.state;
  cycle_abort(&cycle_);
  EXPECT_EQ(cycle_.state, before) << "an end is final";
}

TEST_F(Cycle, AnElementThatIsNotGoodMakesThePartBad) {
  start({wait_phase(CYCLE_END)});
  now_.force_q8 = 901;
  while (tick() != CYCLE_END) continue;
  EXPECT_EQ(cycle_.outcome, CYCLE_BY_PROGRAM);
  EXPECT_EQ(cycle_.good, 0);
  EXPECT_EQ(cycle_result(&cycle_, 0).verdict, CYCLE_ABOVE);
  EXPECT_EQ(cycle_result(&cycle_, 0).value, 901);
}

// The travel begins anew at the first contact, 1200 counts after the start of the cycle here. The
// force then rises by 1/8 count for each count of travel, up to a travel of 100 counts.
TEST_F(Cycle, NoLineOfTheCurveJoinsTheTravelBeforeAndAfterTheFirstContact) {
  const struct {
    std::uint8_t kind, over_time;
    int verdict;
    std::int32_t value;
  } cases[] = {{CYCLE_WORK, 0, CYCLE_GOOD, 100 * 100 / 16},
               {CYCLE_AT, 0, CYCLE_NOT_REACHED, 0},
               {CYCLE_AT, 1, CYCLE_NOT_REACHED, 0},
               {CYCLE_WINDOW, 0, CYCLE_NOT_REACHED, 0},
               {CYCLE_PEAK, 0, CYCLE_GOOD, 100 * 32}};
  for (const auto &c : cases) {
    cycle_phase_t approach = wait_phase(CYCLE_END);
    approach.force_max_q8 = 10000;
    approach.travel_max = approach.time_max = 2000;
    approach.conditions[0] = {CYCLE_TOUCH_ABOVE, CYCLE_END, 0, 100};
    const auto change = [&](cycle_element_t &element) {
      element.kind = c.kind;
      element.over_time = c.over_time;
      element.y_most = CYCLE_FORCE_MAX_Q8;
      element.y_least = -CYCLE_FORCE_MAX_Q8;
      element.direction = CYCLE_FALLING;  // the travel only rises
      element.ordinal = 1;
      element.level = 500;
      element.enters = CYCLE_RIGHT | CYCLE_LEFT;
      if (c.kind == CYCLE_WINDOW) element.x_least = 1250, element.x_most = 1300;
    };
    begin(completed({}, {approach}, change));
    for (int i = 1; cycle_is_running(&cycle_); ++i) {
      move(10);
      const int past = 10 * i - 1200;
      now_.contact = past >= 0;
      now_.force_q8 = past > 0 ? 32 * past : 0;
      tick();
    }
    const cycle_element_result_t result = cycle_result(&cycle_, 0);
    EXPECT_EQ(result.verdict, c.verdict) << int{c.kind};
    EXPECT_EQ(result.value, c.value) << int{c.kind};
  }
}

TEST_F(Cycle, SamplesWaitForSixteenTicksAndMoreAreAnEnd) {
  cycle_phase_t long_phase = wait_phase(CYCLE_END);
  long_phase.conditions[0].level = 50;
  start({long_phase});
  for (int i = 0; i < CYCLE_SAMPLES; ++i) {
    ++now_.tick;
    now_.force_q8 = i;
    ASSERT_FALSE(cycle_step(&cycle_, &now_));
  }
  ++now_.tick;
  EXPECT_TRUE(cycle_step(&cycle_, &now_));
  cycle_evaluate(&cycle_);
  EXPECT_EQ(cycle_.outcome, CYCLE_SAMPLES_LOST);
  EXPECT_EQ(cycle_.good, 0);
  EXPECT_EQ(cycle_result(&cycle_, 0).value, CYCLE_SAMPLES - 1);
}

}  // namespace
