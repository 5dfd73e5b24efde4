// Long chains: springs against their closed-form modes, contacts that touch at rest against
// conservation laws and against a plain Runge-Kutta integration written here.
#include <cmath>
#include <cstdio>
#include <string>
#include <tuple>
#include <vector>

#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

std::string body(int i, double position, double velocity) {
  return "[[body]]\nname = \"" + indexed('b', i) + "\"\nmass = 1\nposition = " + number(position) +
         "\nvelocity = " + number(velocity) + "\n";
}

std::string ends(int a, int b) {
  const auto name = [](int i) { return i < 0 ? std::string("ground") : indexed('b', i); };
  return "between = [\"" + name(a) + "\", \"" + name(b) + "\"]\n";
}

// n bodies of 1 kg, the first tied to ground, the last one free.
std::string springs(int n, double stiffness, double damping) {
  std::string text;
  for (int i = 0; i < n; ++i)
    text += "[[spring]]\nname = \"" + indexed('s', i) + "\"\n" + ends(i - 1, i) +
            "stiffness = " + number(stiffness) + "\ndamping = " + number(damping) + "\n";
  return text;
}

struct ChainMode {
  long double frequency;
  std::vector<long double> shape;
};

// Fixed-free chain: w = 2 sqrt(k / m) sin(q / 2), shape sin(q i), q = (2 j - 1) pi / (2 n + 1).
ChainMode chain_mode(int n, int j, long double stiffness) {
  const long double q = (2 * j - 1) * std::acos(-1.0L) / (2 * n + 1);
  ChainMode mode{2 * std::sqrt(stiffness) * std::sin(q / 2), {}};
  for (int i = 1; i <= n; ++i) mode.shape.push_back(std::sin(q * i));
  return mode;
}

const Mode &first_mode(ModeCache &cache) { return cache.mode(cache.network().home_key(false)); }

class SpringChain : public testing::TestWithParam<int> {};

// The slowest, a middle and the fastest mode at once, 1 mm each, for 2 s.
TEST_P(SpringChain, FollowsItsClosedFormModes) {
  const int n = GetParam();
  const long double k = 1e4L;
  for (const double damping : {0.0, 0.1}) {
    std::vector<ChainMode> modes;
    for (const int j : {1, n / 2, n}) modes.push_back(chain_mode(n, j, k));
    std::string text;
    for (int i = 0; i < n; ++i) {
      long double x = 0;
      for (const ChainMode &mode : modes) x += 1e-3L * mode.shape[static_cast<std::size_t>(i)];
      text += body(i, static_cast<double>(x), 0.0);
    }
    Plant plant(make_model(text + springs(n, static_cast<double>(k), damping)), {true, 10});
    for (int tick = 1; tick <= 3000; ++tick) {
      plant.step(0, false);
      if (tick % 50 != 0 && tick > 20) continue;
      const long double t = tick / 1500.0L;
      for (int i = 0; i < n; ++i) {
        long double x = 0;
        long double v = 0;
        for (const ChainMode &mode : modes) {
          const long double w = mode.frequency;
          const long double s = static_cast<long double>(damping) / k * w * w / 2;
          const long double wd = std::sqrt(w * w - s * s);
          const long double amplitude =
              1e-3L * mode.shape[static_cast<std::size_t>(i)] * std::exp(-s * t);
          x += amplitude * (std::cos(wd * t) + s / wd * std::sin(wd * t));
          v -= amplitude * w * w / wd * std::sin(wd * t);
        }
        const auto at = static_cast<std::size_t>(2 * i);
        ASSERT_NEAR(plant.state()[at], static_cast<double>(x), 1e-12 * 1e-3) << tick << " " << i;
        ASSERT_NEAR(plant.state()[at + 1], static_cast<double>(v), 1e-12 * 0.2) << tick << " " << i;
      }
    }
    EXPECT_LE(std::fabs(plant.energy().residual), 1e-12 * plant.energy().initial);
  }
}

// The part of a tick depends on the fastest rate, not on the number of bodies.
TEST_P(SpringChain, IsCutAsFineAsItsDynamicsAsks) {
  const int n = GetParam();
  for (const double stiffness : {1.0, 1e4, 1e6, 1e8, 1e10}) {
    std::string text;
    for (int i = 0; i < n; ++i) text += body(i, 0.0, 0.0);
    ModeCache cache(make_model(text + springs(n, stiffness, 0.0)));
    const Mode &mode = first_mode(cache);
    const double rate = 2 * std::sqrt(stiffness) / kTickRateHz;
    if (rate <= 1)
      EXPECT_EQ(mode.reach, 1.0 / 8) << stiffness;
    else
      EXPECT_GE(mode.reach * rate, 0.06) << stiffness;
    EXPECT_LE(mode.reach * rate, 0.26) << stiffness;
    EXPECT_EQ(mode.samples > 0, mode.reach >= 1.0 / 128) << stiffness;
  }
}

INSTANTIATE_TEST_SUITE_P(All, SpringChain, testing::Values(3, 8, 16, 32));

// A grid with more parts than kMostGrid costs several searches in each tick, so that a simulation
// with a few more bodies would take ten times as long.
TEST(SpringChainAlone, TheGridOfADriveCoversATickWhateverTheNumberOfBodies) {
  // The current loop of the laboratory's amplifier has 2000 Hz.
  std::string drive = motor_drive("b0");
  drive.replace(drive.find("k_amp = 15"), 10, "k_amp = 582");
  for (const int n : {1, 8, 20, 32}) {
    std::string text;
    for (int i = 0; i < n; ++i) text += body(i, 0.0, 0.0);
    ModeCache cache(make_model(text + springs(n, 2e5, 100.0) + drive));
    const Mode &mode = cache.mode(cache.network().analysed_key());
    EXPECT_EQ(mode.reach, 1.0 / 64) << n;
    EXPECT_EQ(mode.grid, 64U) << n;
  }
}

TEST(SpringChainAlone, WhatIsFarAwayStirsAsItsSeriesSays) {
  // The last of 8 bodies starts at 1 m/s; after t body 8 - d has moved by (k/m)^d t^(2d+1)/(2d+1)!
  // times 1 + O(k t^2).
  const int n = 8;
  std::string text;
  for (int i = 0; i < n; ++i) text += body(i, 0.0, i + 1 == n ? 1.0 : 0.0);
  Plant plant(make_model(text + springs(n, 1.0, 0.0)));
  plant.step(0, false);
  double expected = kTickS;
  for (int d = 0; d <= 3; ++d) {
    if (d > 0) expected *= kTickS * kTickS / (2 * d * (2 * d + 1));
    EXPECT_NEAR(plant.state()[static_cast<std::size_t>(2 * (n - 1 - d))] / expected, 1.0, 1e-6);
  }
}

struct Line {
  std::vector<double> x, v;  // displacements from the places where neighbours just touch
  double spring = 0.0;       // of each body to the one before it, the first one's to ground
  double contact = 0.0;      // between neighbours, undamped
  double wall = 0.0;         // of the last body
  double wall_gap = 0.0;

  void forces(const std::vector<double> &at, std::vector<double> &f) const {
    const std::size_t n = at.size();
    f.assign(n, 0.0);
    for (std::size_t i = 0; i < n; ++i) {
      const double pull = spring * (at[i] - (i > 0 ? at[i - 1] : 0.0));
      f[i] -= pull;
      if (i == 0) continue;
      f[i - 1] += pull;
      const double push = contact * std::fmax(at[i - 1] - at[i], 0.0);
      f[i - 1] -= push;
      f[i] += push;
    }
    f[n - 1] -= wall * std::fmax(at[n - 1] - wall_gap, 0.0);
  }
  void run(double time, int steps) {
    const double h = time / steps;
    const std::size_t n = x.size();
    std::vector<double> f1, f2, f3, f4, at(n);
    for (int k = 0; k < steps; ++k) {
      forces(x, f1);
      for (std::size_t i = 0; i < n; ++i) at[i] = x[i] + h / 2 * v[i];
      forces(at, f2);
      for (std::size_t i = 0; i < n; ++i) at[i] = x[i] + h / 2 * (v[i] + h / 2 * f1[i]);
      forces(at, f3);
      for (std::size_t i = 0; i < n; ++i) at[i] = x[i] + h * (v[i] + h / 2 * f2[i]);
      forces(at, f4);
      for (std::size_t i = 0; i < n; ++i) {
        x[i] += h * (v[i] + h / 6 * (f1[i] + f2[i] + f3[i]));
        v[i] += h / 6 * (f1[i] + 2 * f2[i] + 2 * f3[i] + f4[i]);
      }
    }
  }
};

TEST(SpringChainAlone, MeetsAWallAgainAndAgain) {
  for (const int n : {6, 16}) {
    std::string text;
    Line line;
    line.spring = 1e4;
    line.wall = 3e4;
    line.wall_gap = 1e-3;
    for (int i = 0; i < n; ++i) {
      text += body(i, 0.0, 0.05 * (i + 1));
      line.x.push_back(0.0);
      line.v.push_back(0.05 * (i + 1));
    }
    text += springs(n, 1e4, 0.0) + "[[contact]]\nname = \"wall\"\n" + ends(n - 1, -1) +
            "stiffness = 3e4\ngap = 1e-3\n";
    Plant plant(make_model(text), {true, 1000});
    for (int block = 0; block < 10; ++block) {
      for (int k = 0; k < 45; ++k) plant.step(0, false);
      line.run(0.03, 6000);
      for (std::size_t i = 0; i < line.x.size(); ++i) {
        ASSERT_NEAR(plant.state()[2 * i], line.x[i], 1e-8) << n << " " << block << " " << i;
        ASSERT_NEAR(plant.state()[2 * i + 1], line.v[i], 1e-6) << n << " " << block << " " << i;
      }
    }
    EXPECT_GE(plant.crossings(), 3);
    EXPECT_LE(std::fabs(plant.energy().residual), 1e-12 * plant.energy().initial);
  }
}

// Bodies at spacing * i, the first at 1 m/s toward the others; hardly damped, so that the loader
// finds a way to ground.
std::string touching(int n, double spacing, double more_gap) {
  std::string text;
  for (int i = 0; i < n; ++i)
    text += body(i, spacing * i, i == 0 ? 1.0 : 0.0) + "[[damper]]\nname = \"" + indexed('d', i) +
            "\"\n" + ends(i, -1) + "damping = 1e-12\n";
  for (int i = 1; i < n; ++i)
    text += "[[contact]]\nname = \"" + indexed('c', i) + "\"\n" + ends(i - 1, i) +
            "stiffness = 1e6\ngap = " + number(-spacing + more_gap) + "\n";
  return text;
}

class TouchingLine : public testing::TestWithParam<std::tuple<int, double>> {};

TEST_P(TouchingLine, PassesTheBlowOn) {
  const auto [n, spacing] = GetParam();
  Plant plant(make_model(touching(n, spacing, 0.0)), {true, 100});
  Line line;
  line.contact = 1e6;
  for (int i = 0; i < n; ++i) {
    line.x.push_back(0.0);
    line.v.push_back(i == 0 ? 1.0 : 0.0);
  }
  for (int block = 0; block < 6; ++block) {
    for (int k = 0; k < 3; ++k) plant.step(0, false);
    line.run(2e-3, 4000);
    double momentum = 0.0;
    for (int i = 0; i < n; ++i) {
      const auto at = static_cast<std::size_t>(i);
      ASSERT_NEAR(plant.state()[2 * at], spacing * i + line.x[at], 1e-9) << block << " " << i;
      ASSERT_NEAR(plant.state()[2 * at + 1], line.v[at], 1e-6) << block << " " << i;
      momentum += plant.state()[2 * at + 1];
    }
    // Places of 8 m, rounded to 1e-15 m, against 1e6 N/m for 12 ms.
    EXPECT_NEAR(momentum, 1.0, 1e-11);
    const EnergyAudit energy = plant.energy();
    EXPECT_NEAR(energy.kinetic + energy.stored, 0.5, 1e-11);
    EXPECT_LE(std::fabs(energy.residual), 1e-11);
  }
  // Every contact is pressed once and lets go once.
  for (int k = 0; k < 60; ++k) plant.step(0, false);
  EXPECT_EQ(plant.crossings(), 2 * (n - 1));
  for (int i = 1; i < n; ++i) {
    EXPECT_EQ(count_of(plant, indexed('c', i), "apart", "pressed"), 1) << i;
    EXPECT_EQ(count_of(plant, indexed('c', i), "pressed", "apart"), 1) << i;
  }
}

INSTANTIATE_TEST_SUITE_P(All, TouchingLine,
                         testing::Combine(testing::Values(3, 5, 8, 12),
                                          testing::Values(0.0078125, 0.01, 0.03, 0.1 / 3, 0.7)));

TEST(TouchingLineAlone, DoesNotDependOnRoundingOfTheGaps) {
  for (const int n : {5, 8}) {
    std::vector<double> expected;
    for (const double more : {0.0, 1e-18, -1e-18, 1e-15, -1e-15, 1e-13, -1e-13}) {
      Plant plant(make_model(touching(n, 0.01, more)));
      for (int k = 0; k < 60; ++k) plant.step(0, false);
      for (int i = 0; i < n; ++i) {
        const double v = plant.state()[static_cast<std::size_t>(2 * i + 1)];
        if (more == 0.0)
          expected.push_back(v);
        else
          EXPECT_NEAR(v, expected[static_cast<std::size_t>(i)], 1e-9) << n << " " << more;
      }
    }
  }
}

}  // namespace
}  // namespace forceaxis::sim::test
