// Light bodies between heavy ones, whose motion is up to a million times faster than a tick,
// against an integration in 113 bits that is written here and shares no code with the simulator.
#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "sim/hybrid/detector.hpp"
#include "sim/hybrid/stepper.hpp"
#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

__extension__ typedef __float128 Quad;

// A carriage presses a tip against a workpiece. The finger between carriage and tip is stiff.
struct Press {
  double carriage_kg = 10, tip_kg = 1e-5, workpiece_kg = 5;
  double slide_N_m = 4e4;
  double finger_N_m = 1e6, finger_Ns_m = 3;
  double support_N_m = 1e5, support_Ns_m = 50;
  double sensor_N_m = 5e5;
  double gap_m = 1e-4;
  double speed_m_s = 0.05;
};

std::string text_of(const Press &p) {
  const auto body = [](const char *name, double mass, double speed) {
    return std::string("[[body]]\nname = \"") + name + "\"\nmass = " + number(mass) +
           "\nvelocity = " + number(speed) + "\n";
  };
  const auto link = [](const char *kind, const char *name, const char *a, const char *b,
                       double stiffness, double damping) {
    return std::string("[[") + kind + "]]\nname = \"" + name + "\"\nbetween = [\"" + a + "\", \"" +
           b + "\"]\nstiffness = " + number(stiffness) + "\ndamping = " + number(damping) + "\n";
  };
  return body("carriage", p.carriage_kg, p.speed_m_s) + body("tip", p.tip_kg, p.speed_m_s) +
         body("workpiece", p.workpiece_kg, 0) +
         link("spring", "slide", "carriage", "ground", p.slide_N_m, 0) +
         link("spring", "finger", "carriage", "tip", p.finger_N_m, p.finger_Ns_m) +
         link("spring", "support", "workpiece", "ground", p.support_N_m, p.support_Ns_m) +
         link("contact", "sensor", "tip", "workpiece", p.sensor_N_m, 0) +
         "gap = " + number(p.gap_m) + "\n";
}

// Positions and velocities of carriage, tip and workpiece, and the constant 1.
constexpr std::size_t kSize = 7;
using State = std::array<Quad, kSize>;
using Matrix = std::array<std::array<Quad, kSize>, kSize>;

Matrix multiply(const Matrix &a, const Matrix &b) {
  Matrix c{};
  for (std::size_t i = 0; i < kSize; ++i)
    for (std::size_t k = 0; k < kSize; ++k)
      for (std::size_t j = 0; j < kSize; ++j) c[i][j] += a[i][k] * b[k][j];
  return c;
}

State advanced(const Matrix &a, const State &x) {
  State y{};
  for (std::size_t i = 0; i < kSize; ++i)
    for (std::size_t j = 0; j < kSize; ++j) y[i] += a[i][j] * x[j];
  return y;
}

Matrix rates(const Press &p, bool touching) {
  Matrix a{};
  a[0][1] = a[2][3] = a[4][5] = 1;
  const auto pull = [&a](std::size_t velocity, Quad mass, std::size_t from, Quad factor) {
    a[velocity][from] += factor / mass;
  };
  const Quad mc = p.carriage_kg;
  const Quad mt = p.tip_kg;
  const Quad mw = p.workpiece_kg;
  pull(1, mc, 0, -static_cast<Quad>(p.slide_N_m));
  for (const auto &[velocity, mass, sign] : {std::tuple{std::size_t{1}, mc, -1}, {3, mt, 1}}) {
    pull(velocity, mass, 0, sign * static_cast<Quad>(p.finger_N_m));
    pull(velocity, mass, 2, -sign * static_cast<Quad>(p.finger_N_m));
    pull(velocity, mass, 1, sign * static_cast<Quad>(p.finger_Ns_m));
    pull(velocity, mass, 3, -sign * static_cast<Quad>(p.finger_Ns_m));
  }
  pull(5, mw, 4, -static_cast<Quad>(p.support_N_m));
  pull(5, mw, 5, -static_cast<Quad>(p.support_Ns_m));
  if (touching)
    for (const auto &[velocity, mass, sign] : {std::tuple{std::size_t{3}, mt, -1}, {5, mw, 1}}) {
      pull(velocity, mass, 2, sign * static_cast<Quad>(p.sensor_N_m));
      pull(velocity, mass, 4, -sign * static_cast<Quad>(p.sensor_N_m));
      pull(velocity, mass, 6, -sign * static_cast<Quad>(p.sensor_N_m) * p.gap_m);
    }
  return a;
}

// e^(a t) - 1 by a Taylor series for a part of t that is doubled again.
Matrix flow(const Matrix &a, Quad t) {
  constexpr int kDoublings = 24;
  Matrix part = a;
  for (auto &row : part)
    for (Quad &value : row) value *= t / (1 << kDoublings);
  Matrix term = part;
  Matrix less = part;
  for (int k = 2; k <= 24; ++k) {
    term = multiply(term, part);
    for (std::size_t i = 0; i < kSize; ++i)
      for (std::size_t j = 0; j < kSize; ++j) {
        term[i][j] /= k;
        less[i][j] += term[i][j];
      }
  }
  for (int k = 0; k < kDoublings; ++k) {
    const Matrix square = multiply(less, less);
    for (std::size_t i = 0; i < kSize; ++i)
      for (std::size_t j = 0; j < kSize; ++j) less[i][j] = 2 * less[i][j] + square[i][j];
  }
  for (std::size_t i = 0; i < kSize; ++i) less[i][i] += 1;
  return less;
}

struct Reference {
  std::vector<State> at_ticks;
  std::vector<double> changes_s;
};

// The contact force is tested at the ends of 1024 steps in a tick. A step in which its sign changes
// is halved 60 times.
Reference integrate(const Press &press, int ticks) {
  constexpr int kSteps = 1024;
  constexpr int kHalvings = 60;
  const Quad step = static_cast<Quad>(1) / 1500 / kSteps;
  std::array<std::vector<Matrix>, 2> flows;
  for (const bool touching : {false, true}) {
    Quad t = step;
    for (int k = 0; k <= kHalvings; ++k, t /= 2)
      flows[touching].push_back(flow(rates(press, touching), t));
  }
  const auto touches = [&press](const State &x) { return x[2] - x[4] > press.gap_m; };
  Reference result;
  State x{0, press.speed_m_s, 0, press.speed_m_s, 0, 0, 1};
  bool touching = false;
  for (int tick = 0; tick < ticks; ++tick) {
    for (int i = 0; i < kSteps; ++i) {
      const State end = advanced(flows[touching][0], x);
      if (touches(end) == touching) {
        x = end;
        continue;
      }
      // The state just before the change, and the time that is left in the step.
      Quad left = step;
      Quad length = step;
      for (int k = 1; k <= kHalvings; ++k) {
        length /= 2;
        const State middle = advanced(flows[touching][static_cast<std::size_t>(k)], x);
        if (touches(middle) != touching) continue;
        x = middle;
        left -= length;
      }
      result.changes_s.push_back(static_cast<double>((tick * kSteps + i + 1) * step - left));
      touching = !touching;
      length = step;
      for (int k = 1; k <= kHalvings; ++k) {
        length /= 2;
        if (left < length) continue;
        x = advanced(flows[touching][static_cast<std::size_t>(k)], x);
        left -= length;
      }
    }
    result.at_ticks.push_back(x);
  }
  return result;
}

class LightTip : public testing::TestWithParam<double> {};

// From 0.3 N s/m (4e5 rad/s, damping ratio 0.04) to 300 N s/m (3e7 1/s).
TEST_P(LightTip, FollowsTheIntegrationIn113Bits) {
  Press press;
  press.finger_Ns_m = GetParam();
  constexpr int kTicks = 240;
  const Reference reference = integrate(press, kTicks);
  Plant plant(make_model(text_of(press)), {true, 1000});
  double worst = 0;
  for (int tick = 0; tick < kTicks; ++tick) {
    plant.step(0, false);
    const auto state = plant.state();
    for (std::size_t j = 0; j < 6; ++j)
      worst =
          std::max(worst, std::fabs(static_cast<double>(
                              state[j] - reference.at_ticks[static_cast<std::size_t>(tick)][j])) /
                              (j % 2 == 0 ? 1e-3 : 0.05));
  }
  EXPECT_LT(worst, 5e-12);
  const auto events = plant.events();
  ASSERT_EQ(events.size(), reference.changes_s.size());
  EXPECT_GE(events.size(), 6U);
  for (std::size_t i = 0; i < events.size(); ++i)
    EXPECT_NEAR(events[i].time_s, reference.changes_s[i], 1e-13) << i;
  EXPECT_LE(std::fabs(plant.energy().residual), 1e-11 * plant.energy().initial);
}

// The fast motion decays within some microseconds after a change. A tick without a change is then
// one piece, as for a heavy body: the quiet test passes.
TEST_P(LightTip, NeedsOnePieceForATickWithoutAChange) {
  Press press;
  press.finger_Ns_m = GetParam();
  Stepper stepper(std::make_shared<ModeCache>(make_model(text_of(press))), false, 1000);
  Detector detector;
  int quiet = 0;
  int without_change = 0;
  for (int tick = 0; tick < 1500; ++tick) {
    detector.enter(stepper.mode());
    const bool passes = detector.quiet(stepper.z().data());
    const auto before = stepper.crossings();
    stepper.step(0, false);
    if (stepper.crossings() != before) continue;
    ++without_change;
    quiet += passes ? 1 : 0;
  }
  EXPECT_GT(without_change, 1300);
  EXPECT_GT(quiet, 0.9 * without_change);
}

INSTANTIATE_TEST_SUITE_P(Damping, LightTip, testing::Values(0.3, 3.0, 30.0, 100.0, 300.0));

}  // namespace
}  // namespace forceaxis::sim::test
