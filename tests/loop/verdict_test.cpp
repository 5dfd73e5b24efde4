// The four words of a verdict, from what its user asks for: a run that oscillates, bounces on or
// latches a fault is unstable; one that is calm and still not what was asked for is not met, with
// the limit, its number and unit; one that never pressed was never in contact.
#include "host/run/verdict.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <string>

#include "host/run/experiment.hpp"
#include "host/run/result.hpp"
#include "sim/model/elements/all.hpp"

namespace {

using namespace forceaxis::host;

Criterion held() {
  Criterion c;
  c.contact_held.emplace();
  c.force_ripple_max_count = 10;
  return c;
}

// One second judged after one second of approach, pressed from 0.5 s on and calm.
Metrics calm() {
  Metrics m;
  m.window_ticks = 1501;
  m.window_start_s = 1.0;
  m.contacts = 1;
  m.first_contact_s = 0.5;
  m.contact_at_window = m.in_contact = true;
  m.peak_force_N = 60.0;
  m.held_force = HeldForce{.setpoint_N = 50.0, .held_N = 50.0, .settle_s = 0.2};
  return m;
}

// The verdict, and behind it each missed limit: "not_met settle_max_s 0.2>0.1 s".
std::string text(const Criterion &c, const Metrics &m, bool faulted = false) {
  const Evaluation evaluated = evaluate(c, m, faulted);
  std::string text = evaluated.verdict;
  for (const Missed &one : evaluated.missed) {
    char line[128];
    std::snprintf(line, sizeof line, " %s %g>%g%s%s", one.limit.c_str(), one.value, one.bound,
                  one.unit.empty() ? "" : " ", one.unit.c_str());
    text += line;
  }
  return text;
}

TEST(Verdict, CalmAndHeldIsStable) { EXPECT_EQ(text(held(), calm()), "stable"); }

TEST(Verdict, AFaultIsUnstable) { EXPECT_EQ(text(held(), calm(), true), "unstable fault 1>0"); }

TEST(Verdict, ARippleThatStaysIsUnstableAndOneThatDiesIsNotMet) {
  Metrics m = calm();
  m.force_ripple = {10.0, 10.0};
  EXPECT_EQ(text(held(), m), "stable");
  m.force_ripple = {10.5, 10.5};
  EXPECT_EQ(text(held(), m), "unstable force_ripple_max_count 10.5>10 count");
  m.force_ripple = {10.5, 5.0};  // a drift at constant rate has half of it in half of the window
  EXPECT_EQ(text(held(), m), "not_met force_ripple_max_count 10.5>10 count");
  Criterion c = held();
  c.position_ripple_max_count = 2;
  m = calm();
  m.position_ripple = {3.0, 2.5};
  EXPECT_EQ(text(c, m), "unstable position_ripple_max_count 3>2 count");
}

// Beside its target an axis may stand still, which is not unstable.
TEST(Verdict, AMoveArrivesAtItsSetpoint) {
  Criterion c;
  c.position_error_max_count = 10;
  Metrics m = calm();
  EXPECT_EQ(text(c, m), "not_met position_setpoint 0>10 count");
  for (const double error : {-10.0, 0.0, 10.0}) {
    m.position_error_count = error;
    EXPECT_EQ(text(c, m), "stable") << error;
  }
  for (const double error : {-480.0, 480.0}) {
    m.position_error_count = error;
    EXPECT_EQ(text(c, m), "not_met position_error_max_count 480>10 count");
  }
}

TEST(Verdict, ContactLostInTheWindowIsUnstable) {
  Metrics m = calm();
  m.contact_losses = 2;
  EXPECT_EQ(text(held(), m), "unstable contact_losses 2>0");
  m = calm();
  m.in_contact = false;
  EXPECT_EQ(text(held(), m), "unstable contact_held 0>1");
}

// Without contact_held too: an integral gives the mean force of a bounce, which is no held force.
TEST(Verdict, ContactLostWhereForceIsControlledIsUnstable) {
  Criterion c;
  c.held_force_error_max_percent = 2;
  Metrics m = calm();
  m.contact_losses = 2;
  EXPECT_EQ(text(c, m), "unstable contact_losses 2>0");
  m.held_force.reset();  // an axis in a position loop that bounces on purpose
  c = Criterion{};
  c.position_ripple_max_count = 2;
  EXPECT_EQ(text(c, m), "stable");
}

TEST(Verdict, NeverPressedIsNeverInContactWhateverElseIsMissed) {
  Metrics m = calm();
  m.first_contact_s.reset();
  m.contact_at_window = m.in_contact = false;
  m.held_force->error_percent = 100;
  Criterion c = held();
  c.held_force_error_max_percent = 2;
  EXPECT_EQ(text(c, m), "never_in_contact contact_held 0>1 held_force_error_max_percent 100>2 %");
  c.contact_held.reset();  // the force is controlled all the same
  EXPECT_EQ(evaluate(c, m, false).verdict, kNeverInContact);
  m.contacts = 0;  // a sensor that is fixed to the workpiece
  EXPECT_EQ(evaluate(c, m, false).verdict, kNotMet);
}

TEST(Verdict, AnApproachThatEndsInTheWindowIsNotMetWhateverTheImpactDoes) {
  Metrics m = calm();
  m.first_contact_s = 1.25;
  m.contact_at_window = false;
  m.force_ripple = {40.0, 40.0};
  m.contact_losses = 1;
  EXPECT_EQ(text(held(), m),
            "not_met contact_made_s 1.25>1 s contact_losses 1>0 force_ripple_max_count 40>10 "
            "count");
  m.window_start_s = 0.0;  // the whole run is judged, and contact is made in it
  EXPECT_EQ(evaluate(held(), m, false).verdict, kUnstable);
}

TEST(Verdict, ContactRegainedInTheWindowIsNotMet) {
  Metrics m = calm();
  m.contact_at_window = false;
  EXPECT_EQ(text(held(), m), "not_met contact_held 0>1");
}

TEST(Verdict, EachLimitOfForceIsNotMetWithNumberLimitAndUnit) {
  Metrics m = calm();
  *m.held_force = {.setpoint_N = 50.0,
                   .held_N = 47.0,
                   .error_N = 3.0,
                   .error_percent = 6.0,
                   .overshoot_percent = 20.0,
                   .settle_s = 0.4};
  Criterion c = held();
  c.held_force_error_max_N = 1;
  EXPECT_EQ(text(c, m), "not_met held_force_error_max_N 3>1 N");
  c = held();
  c.held_force_error_max_percent = 2;
  EXPECT_EQ(text(c, m), "not_met held_force_error_max_percent 6>2 %");
  c = held();
  c.overshoot_max_percent = 19;
  EXPECT_EQ(text(c, m), "not_met overshoot_max_percent 20>19 %");
  c = held();
  c.settle_max_s = 0.3;
  EXPECT_EQ(text(c, m), "not_met settle_max_s 0.4>0.3 s");
  m.held_force->settle_s = std::numeric_limits<double>::infinity();
  EXPECT_EQ(text(c, m), "not_met settle_max_s inf>0.3 s");
}

TEST(Verdict, PeakLossesAndSaturationOfTheWholeRunAreNotMet) {
  Metrics m = calm();
  m.contact_losses_run = 14;
  m.saturated_run_ticks = 30;
  Criterion c = held();
  c.peak_force_max_N = 59;
  EXPECT_EQ(text(c, m), "not_met peak_force_max_N 60>59 N");
  c = held();
  c.peak_force_max_percent = 110;
  EXPECT_EQ(text(c, m), "not_met peak_force_max_percent 120>110 %");
  c = held();
  c.contact_losses_max = 1;
  EXPECT_EQ(text(c, m), "not_met contact_losses_max 14>1");
  c = held();
  c.saturated_max_s = 0.01;
  EXPECT_EQ(text(c, m), "not_met saturated_max_s 0.02>0.01 s");
  c.peak_force_max_percent = 120;
  c.contact_losses_max = 14;
  c.saturated_max_s = 0.02;
  EXPECT_EQ(text(c, m), "stable");
}

// A calm reading at its end says nothing of the force behind it.
TEST(Verdict, AnEndOfARangeInTheWindowIsNeverStable) {
  Metrics m = calm();
  m.reading_range_ticks = 7;
  EXPECT_EQ(text(held(), m), "not_met reading_range 7>0 tick");
  Criterion position;
  position.position_ripple_max_count = 1;
  EXPECT_EQ(text(position, m), "stable");  // does not use the reading
  m = calm();
  m.saturated_ticks = 1;
  EXPECT_EQ(text(position, m), "not_met output_range 1>0 tick");
  m = calm();
  m.setpoint_beyond_N = 400;
  m.reading_end_N = 300;
  EXPECT_EQ(text(held(), m), "not_met setpoint_range 400>300 N");
}

}  // namespace
