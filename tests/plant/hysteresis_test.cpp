// Contacts with hysteresis, a spring beside a spring and dry slider in series, against closed
// forms.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "sim/linear/linear.hpp"
#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

constexpr double kStiffness = 2e4;
constexpr double kHysteresis = 6e4;  // stiffness of the spring of the slider
constexpr double kSlip = 9.0;        // force at which the slider slips
constexpr double kStretch = kSlip / kHysteresis;

std::string axis(const std::string &keys) { return "[[body]]\nname = \"axis\"\n" + keys; }

std::string pad(double gap = 0.0) {
  return "[[contact]]\nname = \"pad\"\nbetween = [\"axis\", \"ground\"]\nstiffness = " +
         number(kStiffness) + "\nhysteresis_stiffness = " + number(kHysteresis) +
         "\nhysteresis_force = " + number(kSlip) + "\ngap = " + number(gap) + "\n";
}

double residual(const Plant &plant) {
  const EnergyAudit energy = plant.energy();
  double turned = energy.initial + std::fabs(energy.supplied) + energy.kinetic;
  for (const auto &damper : energy.dissipated) turned += damper.energy;
  return std::fabs(energy.residual) / turned;
}

double lost(const Plant &plant) {
  for (const auto &damper : plant.energy().dissipated)
    if (damper.element == "pad") return damper.energy;
  return 0.0;
}

// A mass so large that the pad does not disturb its oscillation of 300 ticks, begun at its largest
// overlap. The slider slips by 2 D - 2 F / h in each direction of a closed cycle, so that a cycle
// loses 4 F (D - F / h).
TEST(Hysteresis, ClosedCycleLosesFourSlipForcesTimesTheSlippedAmplitude) {
  constexpr double kTicks = 300;
  const double w = 2 * std::numbers::pi / (kTicks * kTickS);
  for (const double amplitude : {0.9 * kStretch, 1.001 * kStretch, 2 * kStretch, 30 * kStretch}) {
    const std::string text =
        axis("mass = 1e15\nposition = " + number(amplitude) + "\n") +
        "[[spring]]\nname = \"swing\"\nbetween = [\"axis\", \"ground\"]\nstiffness = " +
        number(1e15 * w * w) + "\n" + pad(-0.02);
    Plant plant(make_model(text), {.audit = true});
    double before = 0.0;
    for (int k = 0; k < 12 * 300; ++k) {
      if (k == 2 * 300) before = lost(plant);
      plant.step(0, false);
    }
    const double cycle = amplitude > kStretch ? 4 * kSlip * (amplitude - kStretch) : 0.0;
    EXPECT_NEAR(lost(plant) - before, 10 * cycle, 1e-9 * kSlip * amplitude) << amplitude;
    EXPECT_EQ(count_of(plant, "pad.hysteresis", "stuck", "forward"), cycle > 0 ? 12 : 0);
    EXPECT_EQ(count_of(plant, "pad", "pressed", "apart"), 0);
    EXPECT_LT(residual(plant), 1e-12);
  }
}

// An impact of a body with the speed v, until the contact is lost and again after the body has
// turned. Each phase is an oscillation about a point of rest; the kinetic energy changes by what
// the springs take and the slider loses.
class Impact {
 public:
  Impact(double mass, double v) : mass_(mass) {
    const double energy = 0.5 * mass * v * v;
    // deepest overlap: 1/2 k D^2 + F^2 / (2 h) + F (D - F / h) = energy
    const double rest = energy + 0.5 * kSlip * kStretch;
    deepest = (-kSlip + std::sqrt(kSlip * kSlip + 2 * kStiffness * rest)) / kStiffness;
    dent = kSlip / kStiffness;
    lost = kSlip * (deepest - kStretch) + kSlip * (deepest - 2 * kStretch - dent);
    locked = 0.5 * kSlip * dent + 0.5 * kSlip * kStretch;
    speed = std::sqrt(2 * (energy - lost - locked) / mass);
    const double stuck = std::sqrt((kStiffness + kHysteresis) / mass);
    const double slips = std::sqrt(kStiffness / mass);
    // until the slider slips: x = v / w sin w t
    slip_s = std::asin(kStretch * stuck / v) / stuck;
    // to the deepest point: about the rest at -F / k
    const double there = speed_at(energy, 0.5 * (kStiffness + kHysteresis) * kStretch * kStretch);
    deepest_s = slip_s + std::atan2(there / slips, kStretch + dent) / slips;
    // until the slider slips back: the force falls by 2 F at the stiffness k + h
    const double force = kStiffness * deepest + kSlip;
    const double rests = force / (kStiffness + kHysteresis);  // overlap down to the point of rest
    slips_back_s = deepest_s + std::acos((rests - 2 * kStretch) / rests) / stuck;
    const double back = stuck * std::sqrt(rests * rests - std::pow(rests - 2 * kStretch, 2));
    // until the force k x - F is 0
    const double above = deepest - 2 * kStretch - dent;
    loss_s = slips_back_s + std::atan2(above * slips, back) / slips;
  }
  double speed_at(double energy, double taken) const {
    return std::sqrt(2 * (energy - taken) / mass_);
  }

  double deepest, dent, lost, locked, speed;
  double slip_s, deepest_s, slips_back_s, loss_s;

 private:
  double mass_;
};

TEST(Hysteresis, ImpactHasTheInstantsAndTheSpeedOfTheClosedForm) {
  constexpr double kMass = 2, kSpeed = 0.5;
  Plant plant(make_model(axis("mass = 2\nvelocity = 0.5\n") + pad()), {.audit = true});
  const Impact impact(kMass, kSpeed);
  ASSERT_GT(impact.deepest - 2 * kStretch, impact.dent);
  int ticks = 0;
  while (plant.signal("pad.force") > 0 || ticks == 0) {
    plant.step(0, false);
    ASSERT_LT(++ticks, 200);
  }
  const auto events = plant.events();
  std::vector<std::pair<std::string, double>> expected = {{"pressed", 0.0},
                                                          {"forward", impact.slip_s},
                                                          {"stuck", impact.deepest_s},
                                                          {"backward", impact.slips_back_s},
                                                          {"apart", impact.loss_s},
                                                          {"stuck", impact.loss_s}};
  ASSERT_EQ(events.size(), expected.size());
  for (std::size_t i = 0; i < events.size(); ++i) {
    EXPECT_EQ(events[i].to, expected[i].first);
    EXPECT_NEAR(events[i].time_s, expected[i].second, 1e-14) << i;
  }
  EXPECT_NEAR(plant.signal("axis.velocity"), -impact.speed, 1e-13);
  EXPECT_NEAR(lost(plant), impact.lost, 1e-14);
  EXPECT_NEAR(plant.energy().stored, impact.locked, 1e-15);
  EXPECT_NEAR(plant.energy().discarded, 0.0, 1e-17);
  EXPECT_LT(residual(plant), 1e-13);

  // The surface keeps its dent while nothing touches it, and is met there.
  for (int k = 0; k < 20; ++k) plant.step(0, false);
  EXPECT_EQ(plant.signal("pad.force"), 0.0);
  EXPECT_NEAR(plant.energy().stored, impact.locked, 1e-15);
  const double from = plant.signal("axis.position");
  plant.apply_impulse("axis", kMass * (impact.speed + 0.1));
  const double turned_s = plant.time_s();
  while (plant.signal("pad.force") == 0.0) plant.step(0, false);
  EXPECT_EQ(plant.events().back().to, "pressed");
  EXPECT_NEAR(plant.events().back().time_s, turned_s + (impact.dent - from) / 0.1, 1e-13);
  // It is pressed with k + h until the slider slips forward after 2 F / h.
  EXPECT_NEAR(plant.signal("pad.force"),
              (kStiffness + kHysteresis) * (plant.signal("axis.position") - impact.dent), 1e-10);
  EXPECT_LT(residual(plant), 1e-13);
}

// The slider of a strong contact never slips: it is a contact of both stiffnesses.
TEST(Hysteresis, ThatNeverSlipsIsAContactOfBothStiffnesses) {
  const std::string wall =
      "[[spring]]\nname = \"back\"\nbetween = [\"axis\", \"ground\"]\n"
      "stiffness = 3000\n";
  const std::string ends = "[[contact]]\nname = \"pad\"\nbetween = [\"axis\", \"ground\"]\n";
  const std::string body = axis("mass = 2\nvelocity = 0.3\n") + wall + ends;
  Plant strong(make_model(body + "stiffness = 2e4\nhysteresis_stiffness = 6e4\n"
                                 "hysteresis_force = 1e6\n"),
               {.audit = true});
  Plant plain(make_model(body + "stiffness = 8e4\n"), {.audit = true});
  for (int k = 0; k < 3000; ++k) {
    strong.step(0, false);
    plain.step(0, false);
    ASSERT_NEAR(strong.signal("axis.position"), plain.signal("axis.position"), 1e-12);
    ASSERT_NEAR(strong.signal("pad.force"), plain.signal("pad.force"), 1e-8);
  }
  EXPECT_GT(count_of(strong, "pad", "pressed", "apart"), 10);
  EXPECT_NEAR(lost(strong), 0.0, 1e-18);
}

// Driven for 40 s, the slider slips twice in each of 400 cycles.
TEST(Hysteresis, ManyCyclesKeepTheBalance) {
  const std::string rest =
      "[[spring]]\nname = \"guide\"\nbetween = [\"axis\", \"ground\"]\nstiffness = 1e4\n"
      "damping = 50\n[drive]\ntype = \"perfect\"\nbody = \"axis\"\nforce_per_volt = 10\n";
  Plant plant(make_model(axis("mass = 3\n") + pad(-0.04) + rest), {.audit = true});
  constexpr int kCycles = 400, kTicks = 150;
  double before = 0.0;
  std::vector<double> overlap;
  for (int k = 0; k < kCycles * kTicks; ++k) {
    const double angle = 2 * std::numbers::pi * k / kTicks;
    plant.step(static_cast<int>(std::lround(700 * std::sin(angle))), true);
    if (k >= (kCycles - 1) * kTicks) overlap.push_back(plant.signal("pad.deflection"));
    if (k == (kCycles - 1) * kTicks - 1) before = lost(plant);
  }
  // Each cycle loses the same. The slider slips in both directions of a cycle by the way between
  // its turning points, which are near the largest and the smallest overlap of the ticks.
  const auto [low, high] = std::minmax_element(overlap.begin(), overlap.end());
  const double amplitude = 0.5 * (*high - *low);
  EXPECT_NEAR(lost(plant) - before, 4 * kSlip * (amplitude - kStretch),
              0.01 * 4 * kSlip * amplitude);
  EXPECT_GE(count_of(plant, "pad.hysteresis", "stuck", "forward"), kCycles);
  EXPECT_LT(residual(plant), 1e-10);
}

// Two free bodies meet, and a friction between them stops their relative motion while the slider
// slips. The slider then rests, whatever moves both bodies.
TEST(Hysteresis, SliderRestsWhileAFrictionHoldsItsEnds) {
  const auto guided = [](const std::string &name, double mass, const std::string &keys) {
    return "[[body]]\nname = \"" + name + "\"\nmass = " + number(mass) + "\n" + keys +
           "[[spring]]\nname = \"guide_" + name + "\"\nbetween = [\"" + name +
           "\", \"ground\"]\nstiffness = " + number(700 * mass) + "\n";
  };
  const std::string ends = "between = [\"axis\", \"part\"]\n";
  for (int i = 0; i < 20; ++i) {
    Plant plant(
        make_model(guided("axis", 0.6 + 0.17 * i, "velocity = 0.6\n") +
                   guided("part", 0.7 + 0.03 * i, "") + "[[contact]]\nname = \"pad\"\n" + ends +
                   "stiffness = 2e4\nhysteresis_stiffness = 6e4\nhysteresis_force = 9\n" +
                   "[[friction]]\nname = \"grip\"\n" + ends + "coulomb = 80\n"),
        {.audit = true});
    for (int k = 0; k < 600; ++k) plant.step(0, false);
    EXPECT_EQ(count_of(plant, "grip", "forward", "stuck"), 1) << i;
    EXPECT_EQ(count_of(plant, "pad.hysteresis", "stuck", "forward"), 1) << i;
    EXPECT_LE(count_of(plant, "pad.hysteresis", "forward", "stuck"), 1) << i;
    EXPECT_NEAR(plant.signal("pad.force"), kStiffness * plant.signal("pad.deflection") + kSlip,
                1e-9);
    EXPECT_LT(residual(plant), 1e-12);
  }
}

TEST(Hysteresis, LinearFiguresAreThoseOfTheStuckSlider) {
  const auto model = make_model(axis("mass = 2\n") + pad());
  const std::string inputs[] = {"axis.force"};
  const std::string outputs[] = {"pad.force", "pad.spring_force_rate"};
  const std::vector<std::string> states = {"axis.position", "axis.velocity"};
  const Linear stuck = linearise(*model, {}, inputs, outputs);
  EXPECT_EQ(stuck.states, states);
  ASSERT_EQ(stuck.A.rows(), 2);
  EXPECT_DOUBLE_EQ(stuck.A(1, 0), -4e4);
  EXPECT_DOUBLE_EQ(stuck.A(1, 1), 0.0);
  EXPECT_DOUBLE_EQ(stuck.C(0, 0), 8e4);
  EXPECT_DOUBLE_EQ(stuck.C(1, 1), 8e4);
  EXPECT_DOUBLE_EQ(stuck.B(1, 0), 0.5);
  for (const char *direction : {"forward", "backward"}) {
    LinearMode mode;
    mode.states = {{"pad.hysteresis", direction}};
    const Linear slips = linearise(*model, mode, inputs, outputs);
    EXPECT_EQ(slips.states, states);
    EXPECT_DOUBLE_EQ(slips.A(1, 0), -1e4);
    EXPECT_DOUBLE_EQ(slips.C(0, 0), 2e4);
    EXPECT_DOUBLE_EQ(slips.C(1, 1), 2e4);
  }
  LinearMode free;
  free.free = true;
  EXPECT_EQ(linearise(*model, free, inputs, outputs).A(1, 0), 0.0);
}

}  // namespace
}  // namespace forceaxis::sim::test
