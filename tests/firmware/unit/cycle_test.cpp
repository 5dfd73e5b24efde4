// The sequence of a cycle: its record, conditions, limits, loops and ends. The elements are in
// tests/firmware/unit/test_cycle_elements.py.
#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <functional>
#include <random>
#include <utility>
#include <vector>

#include "tests/firmware/unit/cycle_records.hpp"
#include "tests/support/poisoned.hpp"

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
    cycle_select(&cycle_, reinterpret_cast<const cycle_header_t *>(words_.data()));
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
  cycle_t cycle_ = poisoned<cycle_t>();
  cycle_inputs_t now_{};
  std::int32_t reference_ = 0;  // position of travel 0 for CYCLE_ZERO_POSITION
};

cycle_phase_t follow_phase(std::uint16_t first, std::uint8_t points, std::uint8_t over_travel,
                           std::uint8_t next) {
  cycle_phase_t phase = wait_phase(next);
  phase.action = CYCLE_FOLLOW;
  phase.slope = 1000;
  phase.first = first;
  phase.points = points;
  phase.over_travel = over_travel;
  phase.force_max_q8 = CYCLE_FORCE_MAX_Q8;
  phase.travel_max = phase.time_max = 1000000;
  phase.conditions[0] = {CYCLE_REACHED, next, 0, 0};
  return phase;
}

cycle_phase_t tare_phase(std::int32_t ticks, std::uint8_t next) {
  cycle_phase_t phase = wait_phase(next);
  phase.action = CYCLE_TARE;
  phase.target = ticks;
  phase.conditions[0] = {CYCLE_REACHED, next, 0, 0};
  return phase;
}

cycle_phase_t output_phase(std::uint8_t on, std::uint8_t off, std::uint8_t next) {
  cycle_phase_t phase = wait_phase(next);
  phase.action = CYCLE_OUTPUT;
  phase.outputs_on = on;
  phase.outputs_off = off;
  phase.conditions[0] = {CYCLE_REACHED, next, 0, 0};
  return phase;
}

// A record with a table, a compliance, outputs to keep and phases of all actions that use them.
std::vector<std::uint32_t> rich_record() {
  cycle_header_t header{};
  header.compliance = 2;
  header.outputs_keep = 5;
  return completed(header,
                   {tare_phase(20, 1), output_phase(5, 2, 2), follow_phase(2, 3, 1, CYCLE_END)},
                   [](cycle_element_t &) {}, {{0, 0}, {25600, 12}, {0, 256}, {40, 25600}, {90, 0}});
}

TEST_F(Cycle, EveryFlippedBitOfARecordIsRefused) {
  std::vector<std::uint32_t> words = rich_record();
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

// The CRC is right here, so that the fields themselves are checked.
TEST_F(Cycle, WrongFieldsOfTablesTaresAndOutputsAreRefused) {
  const std::vector<cycle_point_t> points{{0, 0}, {25600, 12}, {0, 256}, {40, 25600}, {90, 0}};
  const auto reason = [&](const cycle_phase_t &phase, std::uint8_t compliance = 2,
                          std::uint8_t keep = 15, std::vector<cycle_point_t> with = {}) {
    cycle_header_t header{};
    header.compliance = compliance;
    header.outputs_keep = keep;
    return int{check(completed(
                         header, {phase}, [](cycle_element_t &) {}, with.empty() ? points : with))
                   .reason};
  };
  const auto changed = [&](const cycle_phase_t &phase, void (*change)(cycle_phase_t &)) {
    cycle_phase_t other = phase;
    change(other);
    return reason(other);
  };
  const cycle_phase_t follow = follow_phase(2, 3, 1, CYCLE_END), tare = tare_phase(20, CYCLE_END);
  const cycle_phase_t output = output_phase(1, 2, CYCLE_END), wait = wait_phase(CYCLE_END);
  for (const cycle_phase_t &phase : {follow, tare, output, wait})
    ASSERT_EQ(reason(phase), CYCLE_ACCEPTED) << int{phase.action};
  using Change = void (*)(cycle_phase_t &);
  const std::pair<cycle_phase_t, std::vector<Change>> wrong[] = {
      {follow,
       {[](cycle_phase_t &p) { p.first = 3; }, [](cycle_phase_t &p) { p.points = 1; },
        [](cycle_phase_t &p) {
          p.first = 1; /* x falls */
        },
        [](cycle_phase_t &p) { p.points = 0; }, [](cycle_phase_t &p) { p.over_travel = 2; },
        [](cycle_phase_t &p) { p.slope = 0; }, [](cycle_phase_t &p) { p.force = 1; },
        [](cycle_phase_t &p) { p.target = 1; }, [](cycle_phase_t &p) { p.speed = 1; }}},
      {tare,
       {[](cycle_phase_t &p) { p.target = 0; }, [](cycle_phase_t &p) { p.target = -1; },
        [](cycle_phase_t &p) { p.target = 15001; }, [](cycle_phase_t &p) { p.slope = 1; },
        [](cycle_phase_t &p) { p.force = 1; }, [](cycle_phase_t &p) { p.speed = 1; },
        [](cycle_phase_t &p) { p.first = 2; }, [](cycle_phase_t &p) { p.points = 3; },
        [](cycle_phase_t &p) { p.over_travel = 1; }}},
      {output,
       {[](cycle_phase_t &p) { p.outputs_on = p.outputs_off = 0; },
        [](cycle_phase_t &p) { p.outputs_off = 1; }, [](cycle_phase_t &p) { p.outputs_on = 16; },
        [](cycle_phase_t &p) { p.outputs_off = 32; }, [](cycle_phase_t &p) { p.target = 1; }}},
      {wait, {[](cycle_phase_t &p) { p.outputs_on = p.outputs_off = 4; }}},
  };
  for (const auto &[phase, changes] : wrong)
    for (std::size_t i = 0; i < changes.size(); ++i)
      EXPECT_EQ(changed(phase, changes[i]), CYCLE_WRONG_PHASE) << int{phase.action} << " " << i;
  EXPECT_EQ(reason(wait, 1), CYCLE_WRONG_HEADER) << "one point of compliance";
  EXPECT_EQ(reason(wait, 3), CYCLE_WRONG_HEADER) << "x of the compliance falls";
  EXPECT_EQ(reason(wait, 6), CYCLE_WRONG_HEADER) << "more points than there are";
  const auto straight = [](std::int32_t count) {
    std::vector<cycle_point_t> all;
    for (std::int32_t i = 0; i < count; ++i) all.push_back({i, 0});
    return all;
  };
  EXPECT_EQ(reason(wait, 16, 0, straight(20)), CYCLE_ACCEPTED);
  EXPECT_EQ(reason(wait, 17, 0, straight(20)), CYCLE_WRONG_HEADER);
  EXPECT_EQ(reason(wait, 2, 16), CYCLE_WRONG_HEADER) << "an output that does not exist";
  EXPECT_EQ(reason(wait, 2, 0, {{0, 0}, {9, 9000000}}), CYCLE_WRONG_HEADER) << "deflection";
  EXPECT_EQ(reason(wait, 2, 0, {{-131071, 0}, {131071, 1}}), CYCLE_ACCEPTED);
  EXPECT_EQ(reason(wait, 2, 0, {{0, 0}, {131072, 1}}), CYCLE_WRONG_HEADER);
  EXPECT_EQ(reason(wait, 2, 0, {{-131072, 0}, {0, 1}}), CYCLE_WRONG_HEADER);
}

TEST_F(Cycle, StiffnessNeedsItsSectionAndNothingElseHasOne) {
  const auto accepted = [](std::uint8_t when, std::uint16_t section) {
    cycle_phase_t phase = wait_phase(CYCLE_END);
    phase.conditions[0] = {when, CYCLE_END, 0, 5};
    phase.stiffness_travel = section;
    return check(record_of({phase})).reason == CYCLE_ACCEPTED;
  };
  EXPECT_TRUE(accepted(CYCLE_STIFFNESS_ABOVE, 1));
  EXPECT_TRUE(accepted(CYCLE_STIFFNESS_BELOW, 65535));
  EXPECT_FALSE(accepted(CYCLE_STIFFNESS_ABOVE, 0));
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
  EXPECT_EQ(check(words).reason, CYCLE_WRONG_HEADER) << "reserved byte";
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
  first.conditions[0] = {CYCLE_DEPTH_ABOVE, 1, 0, 10};
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
      {CYCLE_DEPTH_ABOVE, 0, [](cycle_inputs_t &) {}, [](cycle_inputs_t &n) { n.contact = 1; }},
      {CYCLE_DEPTH_BELOW, -5, [](cycle_inputs_t &n) { n.contact = 1; },
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
    approach.conditions[0] = {CYCLE_DEPTH_ABOVE, CYCLE_END, 0, 100};
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

// One phase that waits for ten ticks, with a condition of force that is never met if it is asked
// for, and one tick with this defect.
struct Invalid {
  std::uint8_t defects;
  bool has_element, has_condition;
  int outcome;
  std::uint32_t ticks;
};
class CycleInvalid : public Cycle {
 protected:
  void run(const Invalid &c, int at, int zero) {
    cycle_phase_t phase = wait_phase(CYCLE_END);
    if (c.has_condition) phase.conditions[1] = {CYCLE_FORCE_ABOVE, CYCLE_END, 0, 990};
    cycle_header_t header{};
    header.zero = static_cast<std::uint8_t>(zero);
    // The element is of the second phase, which is not reached, unless it is asked for.
    begin(completed(header, {phase, wait_phase(CYCLE_END)},
                    [&](cycle_element_t &e) { e.phases = c.has_element ? 1 : 2; }));
    for (int i = 0; i < 12 && cycle_is_running(&cycle_); ++i) {
      now_.defects = i == at ? c.defects : 0;
      tick();
    }
  }
};

TEST_F(CycleInvalid, InAJudgedPhaseItMakesThePartBadByAName) {
  const Invalid cases[] = {
      {CYCLE_SAMPLE_VALID, true, false, CYCLE_BY_PROGRAM, 0},
      {CYCLE_SAMPLE_OLD, true, false, CYCLE_SAMPLES_INVALID, 1},
      {CYCLE_SAMPLE_OLD, false, true, CYCLE_SAMPLES_INVALID, 1},
      {CYCLE_SAMPLE_OLD, false, false, CYCLE_BY_PROGRAM, 0},
      {CYCLE_SAMPLE_AT_END, true, false, CYCLE_SAMPLES_INVALID, 1},
      {CYCLE_SAMPLE_AT_END, false, false, CYCLE_OVER_FORCE, 0},
      {CYCLE_SAMPLE_AT_END | CYCLE_SAMPLE_OLD, false, true, CYCLE_SAMPLES_INVALID, 1},
  };
  for (const Invalid &c : cases)
    for (const int at : {0, 4, 9}) {
      run(c, at, CYCLE_ZERO_POSITION);
      EXPECT_EQ(cycle_.outcome, c.outcome) << int{c.defects} << " " << c.has_element;
      EXPECT_EQ(cycle_.invalid_ticks, c.ticks) << at;
      EXPECT_EQ(cycle_.good, c.has_element && c.outcome == CYCLE_BY_PROGRAM ? 1 : 0);
      EXPECT_EQ(cycle_.failed_phase, 0);
      EXPECT_EQ(cycle_.phase_ticks,
                (c.defects & CYCLE_SAMPLE_AT_END) != 0 ? static_cast<std::uint32_t>(at + 1) : 10u);
    }
}

TEST_F(CycleInvalid, WhileTravelZeroIsNotFoundEveryPhaseIsJudged) {
  run({CYCLE_SAMPLE_OLD, false, false, 0, 0}, 4, CYCLE_ZERO_TOUCH);
  EXPECT_EQ(cycle_.outcome, CYCLE_SAMPLES_INVALID);
}

TEST_F(CycleInvalid, MeetsNoConditionFindsNoZeroAndIsInNoElement) {
  cycle_phase_t phase = wait_phase(CYCLE_END);
  phase.conditions[0] = {CYCLE_FORCE_ABOVE, CYCLE_END, 0, 500};
  phase.conditions[1] = {CYCLE_INPUT_ON, CYCLE_END, 0, 16};
  begin(record_with_zero({phase}, CYCLE_ZERO_FORCE, 400));
  now_.force_q8 = 100;
  EXPECT_EQ(tick(), 0);
  now_.force_q8 = 800;
  now_.defects = CYCLE_SAMPLE_OLD;
  EXPECT_EQ(tick(), 0);
  EXPECT_EQ(cycle_.zeroed, 0);
  EXPECT_EQ(cycle_result(&cycle_, 0).value, 100) << "the peak of the valid samples";
  now_.inputs = 16;
  EXPECT_EQ(tick(), CYCLE_END) << "an input needs no sample of the sensors";
  EXPECT_EQ(cycle_.outcome, CYCLE_SAMPLES_INVALID);
}

TEST_F(CycleInvalid, BeginsATareAnewLikeAMotion) {
  start({tare_phase(10, CYCLE_END)});
  cycle_.tare_least = -4000;
  cycle_.tare_most = 4000;
  for (int i = 0; i < 15; ++i) {
    now_.defects = i == 5 ? CYCLE_SAMPLE_OLD : 0;
    now_.force_q8 = i <= 5 ? 900 : 20;
    ASSERT_EQ(tick(), 0) << i;
  }
  EXPECT_EQ(tick(), CYCLE_END);
  EXPECT_EQ(cycle_.offset_q8, 20);
  EXPECT_EQ(cycle_.outcome, CYCLE_SAMPLES_INVALID) << "a tare is judged";
}

// y of a table of two to three points at x, by hand in the comments.
TEST_F(Cycle, FollowDemandsTheForceOfItsTableOverTime) {
  cycle_phase_t phase = follow_phase(0, 3, 0, 1);
  begin(completed({}, {phase, wait_phase(CYCLE_END)}, [](cycle_element_t &) {},
                  {{3, 1000}, {7, 1010}, {10, -1000}}));
  now_.reached = 1;  // the drive reports that the demanded force is reached
  const std::int32_t expected[] = {1000, 1000, 1000, 1000, 1003, 1005,
                                   1008, 1010, 340,  -330, -1000};
  for (std::int32_t i = 0; i < 10; ++i) {
    ASSERT_EQ(cycle_.demand_q8, expected[i]) << "after " << i << " ticks";
    ASSERT_EQ(tick(), 0) << i;
  }
  ASSERT_EQ(cycle_.demand_q8, expected[10]);
  EXPECT_EQ(tick(), 1) << "reached in the tick after the one that took the last point";
  EXPECT_EQ(cycle_.ended_by, 1);
}

TEST_F(Cycle, FollowNeedsTheDriveAndTheEndOfTheTableToBeReached) {
  cycle_phase_t phase = follow_phase(0, 2, 1, 1);
  begin(completed({}, {phase, wait_phase(CYCLE_END)}, [](cycle_element_t &) {},
                  {{-20, 2560}, {20, 5120}}));
  EXPECT_EQ(cycle_.demand_q8, 3840) << "travel 0 is in the middle of the table";
  now_.reached = 1;
  move(19);
  EXPECT_EQ(tick(), 0);
  EXPECT_EQ(cycle_.demand_q8, 5056);
  now_.reached = 0;
  move(1);
  EXPECT_EQ(tick(), 0);
  EXPECT_EQ(tick(), 0);
  move(-41);  // back, beyond the first point
  now_.reached = 1;
  EXPECT_EQ(tick(), 1) << "the demand of the tick before was the last one of the table";
}

TEST_F(Cycle, FollowOverTravelGoesBackAndForth) {
  begin(completed({}, {follow_phase(0, 3, 1, CYCLE_END)}, [](cycle_element_t &) {},
                  {{0, 0}, {100, 1000}, {150, 6000}}));
  const std::pair<std::int32_t, std::int32_t> steps[] = {
      {40, 400}, {70, 2000}, {-75, 350}, {-100, 0}, {200, 4500}, {60, 6000}, {-1000, 0}};
  for (const auto &[counts, force] : steps) {
    move(counts);
    ASSERT_EQ(tick(), 0);
    ASSERT_EQ(cycle_.demand_q8, force) << counts;
  }
}

TEST_F(Cycle, ATareIsTheRoundedMeanAndIsGoneAtTheEndOfTheCycle) {
  std::mt19937 random(7);
  for (int n = 0; n < 200; ++n) {
    const int ticks = 1 + static_cast<int>(random() % 60);
    cycle_phase_t second = wait_phase(CYCLE_END);
    second.conditions[0] = {CYCLE_FORCE_ABOVE, CYCLE_END, 0, 100};
    start({tare_phase(ticks, 1), second});
    EXPECT_EQ(cycle_.offset_q8, 0) << "that of the cycle before is gone";
    cycle_.tare_least = -4000;
    cycle_.tare_most = 4000;
    std::int64_t sum = 0;
    for (int i = 1; i <= ticks; ++i) {
      now_.force_q8 = static_cast<std::int32_t>(random() % 1000) - 500;
      sum += now_.force_q8;
      ASSERT_EQ(tick(), i == ticks ? 1 : 0);
    }
    const std::int64_t twice = 2 * sum + ticks, by = 2 * ticks;
    const std::int64_t mean = twice / by - (twice % by < 0 ? 1 : 0);
    ASSERT_EQ(cycle_.offset_q8, mean) << n;
    now_.force_q8 = static_cast<std::int32_t>(mean) + 99;
    ASSERT_EQ(tick(), 1);
    now_.force_q8 += 1;
    ASSERT_EQ(tick(), CYCLE_END) << "the condition sees the force less the offset";
  }
}

// Element, travel 0, stiffness and conditions see the offset; force_max does not.
TEST_F(Cycle, TheOffsetActsOnWhatIsEvaluatedAndNotOnTheLimit) {
  cycle_phase_t second = wait_phase(CYCLE_END);  // force_max is 1000
  second.conditions[0] = {CYCLE_DEPTH_ABOVE, CYCLE_END, 0, 7};
  second.conditions[1] = {CYCLE_STIFFNESS_ABOVE, CYCLE_END, 0, 1000 * 65536};
  second.stiffness_travel = 4;
  const auto begin_with = [&](std::int32_t force_q8) {
    cycle_header_t header{};
    header.zero = CYCLE_ZERO_FORCE;
    header.zero_level = 100;
    begin(completed(header, {tare_phase(5, 1), second},
                    [](cycle_element_t &element) { element.phases = 2; }));
    cycle_.tare_least = -400;
    cycle_.tare_most = 400;
    now_.force_q8 = force_q8;
    for (int i = 0; i < 5; ++i) tick();
    ASSERT_EQ(cycle_.phase, 1);
    ASSERT_EQ(cycle_.offset_q8, force_q8);
  };
  begin_with(-300);
  now_.force_q8 = -201;
  move(4);
  EXPECT_EQ(tick(), 1);
  EXPECT_EQ(cycle_.zeroed, 0);
  EXPECT_EQ(cycle_.section_change_q8, 99) << "the section began with the force of the tare";
  now_.force_q8 = -200;
  EXPECT_EQ(tick(), 1);
  EXPECT_EQ(cycle_.zeroed, 1) << "-200 less the offset is 100";
  now_.force_q8 = 600;  // the element sees 900, its bound
  EXPECT_EQ(tick(), 1);
  move(7);
  now_.force_q8 = 0;
  EXPECT_EQ(tick(), CYCLE_END);
  EXPECT_EQ(cycle_result(&cycle_, 0).value, 900);
  EXPECT_EQ(cycle_.good, 1);
  begin_with(300);
  now_.force_q8 = 1000;
  EXPECT_EQ(tick(), 1);
  now_.force_q8 = 1001;  // 701 less the offset
  EXPECT_EQ(tick(), CYCLE_END);
  EXPECT_EQ(cycle_.outcome, CYCLE_OVER_FORCE);
}

TEST_F(Cycle, ATareIsRefusedByNameAndTheReactionFollows) {
  const auto outcome_of = [&](void (*disturb)(cycle_inputs_t &, int), std::int32_t band) {
    cycle_phase_t tare = tare_phase(10, CYCLE_END);
    tare.reaction = 1;
    start({tare, wait_phase(CYCLE_END)});
    cycle_.tare_least = -band;
    cycle_.tare_most = band;
    for (int i = 0; cycle_is_running(&cycle_) && cycle_.phase == 0; ++i) {
      disturb(now_, i);
      tick();
    }
    const bool reacts = cycle_is_running(&cycle_);
    while (cycle_is_running(&cycle_)) tick();
    EXPECT_EQ(reacts, cycle_.outcome != CYCLE_BY_PROGRAM);
    EXPECT_EQ(cycle_.good, reacts ? 0 : 1);
    return int{cycle_.outcome};
  };
  static const auto move = [](cycle_inputs_t &now, int by) {  // positions wrap
    now.position =
        static_cast<int32_t>(static_cast<uint32_t>(now.position) + static_cast<uint32_t>(by));
  };
  EXPECT_EQ(outcome_of([](cycle_inputs_t &, int) {}, 0), CYCLE_BY_PROGRAM);
  EXPECT_EQ(outcome_of([](cycle_inputs_t &n, int) { n.force_q8 = 300; }, 300), CYCLE_BY_PROGRAM);
  EXPECT_EQ(outcome_of([](cycle_inputs_t &n, int) { n.force_q8 = 301; }, 300), CYCLE_TARE_BAND);
  EXPECT_EQ(outcome_of([](cycle_inputs_t &n, int) { n.force_q8 = -301; }, 300), CYCLE_TARE_BAND);
  EXPECT_EQ(outcome_of([](cycle_inputs_t &, int) {}, -1), CYCLE_TARE_BAND) << "no tare_band";
  EXPECT_EQ(outcome_of([](cycle_inputs_t &n, int i) { n.contact = i == 9; }, 0),
            CYCLE_TARE_CONTACT);
  EXPECT_EQ(outcome_of([](cycle_inputs_t &n, int i) { move(n, i % 9 == 8 ? 3 : 0); }, 0),
            CYCLE_TARE_MOVING);
  EXPECT_EQ(outcome_of([](cycle_inputs_t &n, int i) { move(n, i % 2 == 0 ? 2 : -2); }, 0),
            CYCLE_BY_PROGRAM);
  EXPECT_EQ(outcome_of([](cycle_inputs_t &n, int i) { move(n, i < 20 ? 4 : 0); }, 0),
            CYCLE_BY_PROGRAM)
      << "the mean begins at standstill";
  EXPECT_EQ(outcome_of([](cycle_inputs_t &n, int) { n.force_q8 = 1001; }, 9999), CYCLE_OVER_FORCE);
}

TEST_F(Cycle, OutputsChangeAtTheBeginOfAPhaseAndGoOffAtTheEnd) {
  cycle_phase_t last = wait_phase(CYCLE_END);
  last.outputs_on = 8;
  cycle_header_t header{};
  header.outputs_keep = 1;
  const auto record = completed(header, {output_phase(3, 0, 1), output_phase(4, 2, 2), last});
  begin(record);
  EXPECT_EQ(cycle_.outputs, 3);
  EXPECT_EQ(tick(), 1) << "an output phase is reached in its first tick";
  EXPECT_EQ(cycle_.outputs, 5);
  EXPECT_EQ(tick(), 2);
  EXPECT_EQ(cycle_.outputs, 13);
  while (tick() != CYCLE_END) continue;
  EXPECT_EQ(cycle_.outputs, 1) << "the one to keep";
  cycle_start(&cycle_, cycle_.program, &now_, 0);
  EXPECT_EQ(cycle_.outputs, 3);
  cycle_abort(&cycle_);
  EXPECT_EQ(cycle_.outputs, 1);
  cycle_evaluate(&cycle_);
  const auto other = record_of({wait_phase(CYCLE_END)});
  cycle_start(&cycle_, reinterpret_cast<const cycle_header_t *>(other.data()), &now_, 0);
  EXPECT_EQ(cycle_.outputs, 0) << "this program keeps none";
  begin(record);
  tick();
  now_.force_q8 = 2000;  // beyond force_max; the reaction is the end
  EXPECT_EQ(tick(), CYCLE_END);
  EXPECT_EQ(cycle_.outputs, 1);
}

TEST_F(Cycle, TheConditionThatEndedAPhaseIsRecorded) {
  cycle_phase_t first = wait_phase(CYCLE_END);
  first.reaction = 1;
  first.conditions[2] = {CYCLE_FORCE_ABOVE, 1, 0, 300};
  start({first, wait_phase(CYCLE_END)});
  EXPECT_EQ(cycle_.ended_by, 0);
  now_.force_q8 = 300;
  EXPECT_EQ(tick(), 1);
  EXPECT_EQ(cycle_.ended_by, 3);
  while (tick() != CYCLE_END) continue;
  EXPECT_EQ(cycle_.ended_by, 1);
  start({first, wait_phase(CYCLE_END)});
  now_.force_q8 = 300;
  tick();
  now_.force_q8 = 3000;
  EXPECT_EQ(tick(), CYCLE_END);
  EXPECT_EQ(cycle_.ended_by, 0) << "a limit";
}

// Deflection: 0 at 0, 12 counts at 25,600, and so on; the model divides exactly.
TEST_F(Cycle, TheDepthIsTheTravelLessTheDeflection) {
  cycle_phase_t phase = wait_phase(CYCLE_END);
  phase.force_max_q8 = CYCLE_FORCE_MAX_Q8;
  phase.travel_max = 100000;
  phase.time_max = 100000;
  phase.conditions[0] = {CYCLE_DEPTH_ABOVE, CYCLE_END, 0, 5000};
  const std::vector<cycle_point_t> points{{-1000, -7}, {0, 0}, {25600, 12}, {51200, 40}};
  const auto deflection = [&](std::int64_t force) -> std::int64_t {
    for (std::size_t i = 1; i < points.size(); ++i)
      if (force <= points[i].x && force >= points[i - 1].x) {
        const std::int64_t dx = points[i].x - points[i - 1].x, dy = points[i].y - points[i - 1].y;
        const std::int64_t a = 2 * (points[i - 1].y * dx + dy * (force - points[i - 1].x)) + dx;
        return a / (2 * dx) - (a % (2 * dx) < 0 ? 1 : 0);
      }
    return force < points[0].x ? points[0].y : points.back().y;
  };
  std::mt19937 random(3);
  for (int n = 0; n < 60; ++n) {
    cycle_header_t header{};
    header.compliance = 4;
    header.zero = n % 2 == 0 ? CYCLE_ZERO_FORCE : CYCLE_ZERO_TOUCH;
    header.zero_level = n % 2 == 0 ? 30000 : 0;
    begin(completed(
        header, {phase}, [](cycle_element_t &e) { e.y_most = INT32_MAX; }, points));
    std::int64_t zero = now_.position;
    bool zeroed = false;
    for (int i = 0; i < 40; ++i) {
      move(static_cast<int>(random() % 60));
      now_.force_q8 = static_cast<int>(random() % 60000) - 5000;
      now_.contact = i > 20;
      tick();
      const std::int64_t place = std::int64_t{now_.position} - deflection(now_.force_q8);
      if (!zeroed && (n % 2 == 0 ? now_.force_q8 >= 30000 : i > 20)) {
        zeroed = true;
        zero = place;
      }
      const auto depth = static_cast<std::int32_t>(static_cast<std::uint32_t>(place - zero));
      ASSERT_EQ(cycle_.samples[(cycle_.written - 1) & (CYCLE_SAMPLES - 1)].travel, depth)
          << n << " " << i;
      ASSERT_TRUE(cycle_.has_depth == 0 || cycle_.depth == depth);
      ASSERT_EQ(cycle_.has_depth != 0, zeroed);
    }
  }
  cycle_header_t header{};
  header.compliance = 4;
  header.zero = CYCLE_ZERO_POSITION;
  reference_ = INT32_MAX - 20;
  phase.conditions[0].level = 8;
  begin(completed(
      header, {phase}, [](cycle_element_t &) {}, points));
  now_.force_q8 = 25600;
  move(19);
  EXPECT_EQ(tick(), 0);
  move(1);
  EXPECT_EQ(tick(), CYCLE_END) << "20 less 12 is 8";
}

}  // namespace
