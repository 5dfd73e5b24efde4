// The benchmark plant through the whole loop, firmware and all, against an integration that shares
// no code with it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "host/run/run.hpp"
#include "tests/loop/axis_contact_reference.hpp"

namespace forceaxis::host {
namespace {

std::size_t column(const RunResult &run, const std::string &name) {
  const auto at = std::find(run.signal_names.begin(), run.signal_names.end(), name);
  EXPECT_NE(at, run.signal_names.end()) << name;
  return static_cast<std::size_t>(at - run.signal_names.begin());
}

struct Case {
  const char *name;
  const char *file;
  int gain;
  long double setpoint_N;
  double tolerance_N;
  int touch_downs;
  int contact_crossings;
};

class AxisContact : public testing::TestWithParam<Case> {};

TEST_P(AxisContact, AgreesWithAnIndependentIntegrationAtEveryTick) {
  const Case &c = GetParam();
  const axis_contact::Reference want = axis_contact::simulate(c.gain, c.setpoint_N, 16);
  const RunResult got = run(load_experiment(std::string(SIM_DIR "/experiments/") + c.file));
  ASSERT_EQ(got.records.size(), want.force_N.size());
  const std::size_t force = column(got, "tip.force");
  const std::size_t robot = column(got, "robot.position");
  double worst_N = 0, worst_m = 0;
  for (std::size_t k = 0; k < want.force_N.size(); ++k) {
    const double *row = &got.signals[k * got.signal_names.size()];
    worst_N = std::max(worst_N, std::fabs(row[force] - want.force_N[k]));
    worst_m = std::max(worst_m, std::fabs(row[robot] - want.robot_m[k]));
    ASSERT_EQ(got.records[k].adc0_code - 128, want.adc_count[k]) << "tick " << k;
    ASSERT_EQ(got.records[k].dac_code, want.dac_code[k]) << "tick " << k;
  }
  RecordProperty("force_error_N", std::to_string(worst_N));
  std::printf("case %s: force error %.3g N, position error %.3g m\n", c.name, worst_N, worst_m);
  EXPECT_LE(worst_N, c.tolerance_N);
  EXPECT_LE(worst_m, 1e-13);

  int touch_downs = 0, contact_crossings = 0;
  for (const sim::Event &e : got.events) {
    contact_crossings += e.element == "tip";
    touch_downs += e.element == "tip" && e.from == "apart";
  }
  EXPECT_EQ(touch_downs, c.touch_downs);
  EXPECT_EQ(contact_crossings, c.contact_crossings);
  EXPECT_EQ(want.touch_downs, c.touch_downs);
  EXPECT_LE(std::fabs(got.energy.residual), 1e-9 * got.energy.supplied);
}

INSTANTIATE_TEST_SUITE_P(Cases, AxisContact,
                         testing::Values(Case{"A", "axis_contact_a.toml", 4, 59, 1e-9, 1, 1},
                                         Case{"B", "axis_contact_b.toml", 15, 100, 1e-8, 46, 136}),
                         [](const auto &each) { return each.param.name; });

// A reference that moved with its step size would be none.
TEST(AxisContactReference, DoesNotDependOnItsStep) {
  const auto coarse = axis_contact::simulate(15, 100, 8);
  const auto fine = axis_contact::simulate(15, 100, 24);
  for (std::size_t k = 0; k < fine.force_N.size(); ++k) {
    ASSERT_NEAR(coarse.force_N[k], fine.force_N[k], 1e-11) << "tick " << k;
  }
  EXPECT_EQ(fine.crossings, 335);
}

// The published check values of case A, from a 113-bit integration.
TEST(AxisContactReference, MeetsTheCheckValuesOfCaseA) {
  const auto a = axis_contact::simulate(4, 59, 16);
  EXPECT_NEAR(a.first_touch_s, 0.126660144603405, 1e-15);
  EXPECT_NEAR(a.force_N[300], 52.7598796438, 5e-11);
  EXPECT_NEAR(a.force_N[600], 54.0740907746, 5e-11);
  EXPECT_NEAR(a.force_N[1500], 51.6981084607, 5e-11);
  EXPECT_NEAR(a.force_N[3000], 52.053813653183, 5e-13);
}

}  // namespace
}  // namespace forceaxis::host
