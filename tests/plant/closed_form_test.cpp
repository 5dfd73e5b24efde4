// Free responses against their closed forms.
#include <cmath>
#include <string>

#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

std::string oscillator(const std::string &damping, const std::string &velocity) {
  return "[[body]]\nname = \"mass\"\nmass = 2\nposition = 0.01\nvelocity = " + velocity +
         "\n[[spring]]\nname = \"spring\"\nbetween = [\"mass\", \"ground\"]\nstiffness = 5000\n"
         "damping = " +
         damping + "\n";
}

// m = 2 kg, k = 5000 N/m: w = 50 rad/s. x0 = 0.01 m; the amplitude scales the error.
TEST(FreeOscillator, UndampedStaysExactOverManyPeriods) {
  Plant plant(make_model(oscillator("0", "0.3")));
  for (int k = 1; k <= 15000; ++k) {
    plant.step(0, false);
    const long double t = k / 1500.0L;
    const long double x = 0.01L * std::cos(50 * t) + 0.3L / 50 * std::sin(50 * t);
    const long double v = -0.5L * std::sin(50 * t) + 0.3L * std::cos(50 * t);
    ASSERT_NEAR(plant.signal("mass.position"), static_cast<double>(x), 1e-14) << "tick " << k;
    ASSERT_NEAR(plant.signal("mass.velocity"), static_cast<double>(v), 1e-12 * 0.5) << "tick " << k;
  }
}

TEST(FreeOscillator, Underdamped) {
  Plant plant(make_model(oscillator("40", "0")));  // sigma = 10 / s
  const long double sigma = 10.0L;
  const long double wd = std::sqrt(2500.0L - 100.0L);
  for (int k = 1; k <= 1500; ++k) {
    plant.step(0, false);
    const long double t = k / 1500.0L;
    const long double x =
        0.01L * std::exp(-sigma * t) * (std::cos(wd * t) + sigma / wd * std::sin(wd * t));
    ASSERT_NEAR(plant.signal("mass.position"), static_cast<double>(x), 1e-14) << "tick " << k;
  }
}

TEST(FreeOscillator, CriticallyDamped) {
  Plant plant(make_model(oscillator("200", "0")));  // sigma = w = 50 / s
  for (int k = 1; k <= 1500; ++k) {
    plant.step(0, false);
    const long double t = k / 1500.0L;
    const long double x = 0.01L * (1 + 50 * t) * std::exp(-50 * t);
    ASSERT_NEAR(plant.signal("mass.position"), static_cast<double>(x), 1e-14) << "tick " << k;
  }
}

TEST(FreeOscillator, Overdamped) {
  Plant plant(make_model(oscillator("2000", "0")));
  const long double root = std::sqrt(500.0L * 500.0L - 2500.0L);
  const long double slow = 500.0L - root;
  const long double fast = 500.0L + root;
  for (int k = 1; k <= 1500; ++k) {
    plant.step(0, false);
    const long double t = k / 1500.0L;
    const long double x =
        0.01L * (fast * std::exp(-slow * t) - slow * std::exp(-fast * t)) / (fast - slow);
    ASSERT_NEAR(plant.signal("mass.position") / static_cast<double>(x), 1.0, 1e-12) << "tick " << k;
  }
}

// Two bodies: the mode along the chain of two equal masses and three equal springs.
TEST(FreeOscillator, TwoBodiesInTheirHigherMode) {
  Plant plant(make_model(R"(
[[body]]
name = "a"
mass = 1
position = 1e-3
[[body]]
name = "b"
mass = 1
position = -1e-3
[[spring]]
name = "left"
between = ["a", "ground"]
stiffness = 1e4
[[spring]]
name = "middle"
between = ["a", "b"]
stiffness = 1e4
[[spring]]
name = "right"
between = ["ground", "b"]
stiffness = 1e4
)"));
  const long double w = std::sqrt(3e4L);
  for (int k = 1; k <= 1500; ++k) {
    plant.step(0, false);
    const double x = static_cast<double>(1e-3L * std::cos(w * (k / 1500.0L)));
    ASSERT_NEAR(plant.signal("a.position"), x, 1e-15);
    ASSERT_NEAR(plant.signal("b.position"), -x, 1e-15);
    ASSERT_NEAR(plant.signal("middle.force"), 2e4 * x, 2e-11);
    ASSERT_NEAR(plant.signal("right.deflection"), x, 1e-15);
  }
}

// A stiff mode that turns 5.6 rad per tick (the hard grip of Fig 5.2: 1e7 N/m on 0.14 kg).
TEST(FreeOscillator, FasterThanTheTick) {
  Plant plant(make_model(R"(
[[body]]
name = "pad"
mass = 0.14
position = 1e-5
[[spring]]
name = "grip"
between = ["pad", "ground"]
stiffness = 1e7
[[contact]]
name = "far"
between = ["pad", "ground"]
stiffness = 1e6
gap = 1.1e-5
)"));
  const long double w = std::sqrt(1e7L / 0.14L);
  for (int k = 1; k <= 1500; ++k) {
    plant.step(0, false);
    const double x = static_cast<double>(1e-5L * std::cos(w * (k / 1500.0L)));
    ASSERT_NEAR(plant.signal("pad.position"), x, 1e-12 * 1e-5) << "tick " << k;
  }
  EXPECT_EQ(plant.crossings(), 0);
}

TEST(FreeBody, DamperAloneSlowsItExponentially) {
  Plant plant(make_model(R"(
[[body]]
name = "sled"
mass = 4
velocity = 0.5
[[damper]]
name = "oil"
between = ["sled", "ground"]
damping = 12
)"));
  for (int k = 1; k <= 1500; ++k) {
    plant.step(0, false);
    const long double decay = std::exp(-3.0L * (k / 1500.0L));
    ASSERT_NEAR(plant.signal("sled.velocity"), static_cast<double>(0.5L * decay), 1e-14);
    ASSERT_NEAR(plant.signal("sled.position"), static_cast<double>(0.5L / 3 * (1 - decay)), 1e-14);
    ASSERT_NEAR(plant.signal("oil.force"), static_cast<double>(6.0L * decay), 1e-12);
  }
  EXPECT_DOUBLE_EQ(plant.signal("oil.spring_force"), 0.0);
}

}  // namespace
}  // namespace forceaxis::sim::test
