// Cogging, external forces, inertias, stiffening contacts and standard linear solids against closed
// forms and an integration that this file writes for itself.
#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <string>
#include <vector>

#include "sim/linear/linear.hpp"
#include "sim/model/elements/all.hpp"
#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

constexpr double kPi = std::numbers::pi;

std::string body(const std::string &keys) { return "[[body]]\nname = \"axis\"\n" + keys; }

const std::string kGuide =
    "[[damper]]\nname = \"guide\"\nbetween = [\"axis\", \"ground\"]\ndamping = 0\n";

double residual(const Plant &plant) {
  const EnergyAudit energy = plant.energy();
  double turned = energy.initial + std::fabs(energy.supplied) + energy.kinetic;
  for (const auto &damper : energy.dissipated) turned += damper.energy;
  return std::fabs(energy.residual) / turned;
}

// Position and velocity of a mass under a force, by the classical Runge-Kutta method in extended
// precision with 400 steps a tick.
struct Mass {
  long double x, v, mass;
  void tick(const std::function<long double(long double, long double)> &force) {
    constexpr int kSteps = 400;
    const long double h = 1.0L / 1500 / kSteps;
    for (int k = 0; k < kSteps; ++k) {
      const long double a1 = force(x, v) / mass;
      const long double v2 = v + h / 2 * a1;
      const long double a2 = force(x + h / 2 * v, v2) / mass;
      const long double v3 = v + h / 2 * a2;
      const long double a3 = force(x + h / 2 * v2, v3) / mass;
      const long double v4 = v + h * a3;
      const long double a4 = force(x + h * v3, v4) / mass;
      x += h / 6 * (v + 2 * v2 + 2 * v3 + v4);
      v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
    }
  }
};

const std::string kCogging =
    "[[cogging]]\nname = \"magnets\"\nbetween = [\"axis\", \"ground\"]\nperiod = 0.03\n"
    "position = 0.004\nfrom = -0.05\nto = 0.12\n";

// Linear between its values, which lie on the sine; at most 1 - cos(pi / n) of the amplitude less.
TEST(Cogging, MeetsTheSineAndIsAtMostThatMuchLess) {
  for (const int n : {4, 8, 16, 24}) {
    Plant plant(make_model(body("mass = 1e9\nvelocity = 0.1\n") + kCogging +
                           "force = 20\nsegments = " + std::to_string(n) + "\n"));
    double worst = 0.0;
    for (int k = 0; k < 1500; ++k) {
      plant.step(0, false);
      const double d = plant.signal("axis.position") - 0.004;
      if (d > 0.116) break;
      const double sine = 20 * std::sin(2 * kPi * d / 0.03);
      const double less = std::fabs(sine) - std::fabs(plant.signal("magnets.force"));
      ASSERT_GT(less, -1e-5);
      worst = std::max(worst, less);
      const double from = std::floor(d / (0.03 / n)) * 0.03 / n;
      const double share = (d - from) / (0.03 / n);
      const double line = 20 * ((1 - share) * std::sin(2 * kPi * from / 0.03) +
                                share * std::sin(2 * kPi * (from + 0.03 / n) / 0.03));
      ASSERT_NEAR(plant.signal("magnets.force"), line, 1e-9) << d;
    }
    EXPECT_LE(worst, 20 * (1 - std::cos(kPi / n)) * (1 + 1e-9));
    EXPECT_GT(worst, 20 * (1 - std::cos(kPi / n)) * 0.7);
  }
}

// Oscillation about a rest and travel over the tops, against an integration.
TEST(Cogging, MovesAsAnIntegration) {
  const std::vector<double> forces = {0, 9, 14, -3, -12, -6};
  for (const double speed : {0.05, 0.4}) {
    const std::string text = body("mass = 2\nvelocity = " + number(speed) + "\n") + kCogging +
                             "force = [0, 9, 14, -3, -12, -6]\n[[damper]]\nname = \"oil\"\n"
                             "between = [\"axis\", \"ground\"]\ndamping = 1.5\n";
    Plant plant(make_model(text), {.audit = true});
    Mass mass{0.0L, speed, 2.0L};
    for (int k = 0; k < 300; ++k) {
      plant.step(0, false);
      mass.tick([&](long double x, long double v) {
        const long double cell = (x - 0.004L) / 0.005L;
        const long double down = std::floor(cell);
        const auto at = [&](long i) { return forces[static_cast<std::size_t>(((i % 6) + 6) % 6)]; };
        const auto i = static_cast<long>(down);
        return -((1 - (cell - down)) * at(i) + (cell - down) * at(i + 1)) - 1.5L * v;
      });
      if (mass.x > 0.115L) break;
      ASSERT_NEAR(plant.signal("axis.position"), static_cast<double>(mass.x), 1e-9) << "tick " << k;
      ASSERT_NEAR(plant.signal("axis.velocity"), static_cast<double>(mass.v), 1e-7);
    }
    EXPECT_GE(plant.crossings(), 2);
    EXPECT_LT(residual(plant), 1e-12);
  }
}

TEST(Cogging, IsASpringAtRest) {
  const auto model = make_model(body("mass = 2\n") + kCogging + "force = 20\nsegments = 8\n");
  const std::string inputs[] = {"axis.force"};
  const std::string outputs[] = {"axis.position"};
  const Linear at_start = linearise(*model, {}, inputs, outputs);
  // The start, x = 0, lies between -1/8 and -2/8 of the period before the rest at 4 mm.
  const double rise = 20 * (std::sin(2 * kPi / 8) - 1.0) / (0.03 / 8);
  EXPECT_NEAR(at_start.A(1, 0), rise / 2, 1e-9);
}

// A triangle of force: v = integral / m, exactly at the ticks and where breaks lie between them.
TEST(External, GivesTheImpulseOfItsTable) {
  Plant plant(make_model(body("mass = 4\n") + kGuide +
                         "[[external]]\nname = \"push\"\nbody = \"axis\"\n"
                         "times = [\"10 ms\", \"15.5 ms\", \"40.3 ms\"]\nforces = [0, 60, -20]\n"),
              {.audit = true});
  const auto at = [](double t) {  // integral of the force
    const double rise = 0.0055;
    const double fall = 0.0248;
    if (t <= 0.010) return 0.0;
    if (t <= 0.0155) return 60 * (t - 0.01) * (t - 0.01) / rise / 2;
    const double full = 60 * rise / 2;
    const double s = std::min(t, 0.0403) - 0.0155;
    return full + 60 * s - 80 * s * s / fall / 2;
  };
  for (int k = 1; k <= 150; ++k) {
    plant.step(0, false);
    ASSERT_NEAR(plant.signal("axis.velocity"), at(k * kTickS) / 4, 1e-13) << "tick " << k;
  }
  EXPECT_EQ(plant.signal("push.force"), 0.0);
  ASSERT_EQ(plant.crossings(), 3);
  EXPECT_NEAR(plant.events()[1].time_s, 0.0155, 1e-15);
  EXPECT_LT(residual(plant), 1e-12);
}

TEST(External, ARectangleBeginsAndEndsAtOnce) {
  Plant plant(make_model(body("mass = 4\n") + kGuide +
                         "[[external]]\nname = \"push\"\nbody = \"axis\"\ntimes = [0, 0.02]\n"
                         "forces = [30, 30]\n"));
  for (int k = 0; k < 60; ++k) plant.step(0, false);
  EXPECT_NEAR(plant.signal("axis.velocity"), 30 * 0.02 / 4, 1e-13);
  // After a million ticks the time is as exact as at the start.
  Plant late(make_model(body("mass = 4\n") + kGuide +
                        "[[external]]\nname = \"push\"\nbody = \"axis\"\n"
                        "times = [120, 120.0001]\nforces = [30, 30]\n"));
  for (int k = 0; k < 180003; ++k) late.step(0, false);
  EXPECT_NEAR(late.signal("axis.velocity"), 30 * 0.0001 / 4, 1e-13);
}

TEST(External, IsNoStateOfTheLinearModel) {
  const auto model = make_model(body("mass = 4\n") + kGuide +
                                "[[external]]\nname = \"push\"\nbody = \"axis\"\n"
                                "times = [1, 2]\nforces = [30, 30]\n");
  const std::string inputs[] = {"axis.force"};
  const std::string outputs[] = {"axis.position"};
  const Linear linear = linearise(*model, {}, inputs, outputs);
  EXPECT_EQ(linear.states, (std::vector<std::string>{"axis.position", "axis.velocity"}));
  EXPECT_EQ(linear.A.rows(), 2);
  EXPECT_EQ(linear.B.rows(), 2);
  EXPECT_DOUBLE_EQ(linear.B(1, 0), 0.25);
  EXPECT_EQ(linear.C.cols(), 2);
}

// 3e-5 kg m^2 at 10 mm/rev and a pulley of 20 mm with 1e-3 kg m^2.
TEST(Body, InertiasAddToItsMass) {
  const double screw = 0.01 / (2 * kPi);
  const auto model = make_model(body("mass = 2\ninertia = [3e-5, 1e-3]\n"
                                     "r_trans = [\"10 mm/rev\", 0.02]\n") +
                                kGuide);
  EXPECT_NEAR(model->bodies[0].mass / (2 + 3e-5 / (screw * screw) + 1e-3 / 4e-4), 1.0, 1e-14);
  const auto rotor = make_model(body("inertia = 3e-5\nr_trans = 0.002\n") + kGuide);
  EXPECT_NEAR(rotor->bodies[0].mass, 7.5, 1e-14);
}

std::string refusal(const std::string &text) {
  try {
    (void)load_model(write_model(text));
  } catch (const InputError &error) {
    EXPECT_EQ(error.message.rfind("expected ", 0), 0U) << error.what();
    EXPECT_NE(error.message.find(", got "), std::string::npos) << error.what();
    return error.key;
  }
  return "";
}

TEST(Body, RefusesInertiasWithoutTravel) {
  EXPECT_EQ(refusal(body("") + kGuide), "body[0].mass");
  EXPECT_EQ(refusal(body("inertia = 1\n") + kGuide), "body[0].r_trans");
  EXPECT_EQ(refusal(body("mass = 1\nr_trans = 1\n") + kGuide), "body[0].r_trans");
  EXPECT_EQ(refusal(body("inertia = [1, 2]\nr_trans = 1\n") + kGuide), "body[0].r_trans");
  EXPECT_EQ(refusal(body("inertia = [1, -2]\nr_trans = [1, 1]\n") + kGuide), "body[0].inertia[1]");
}

std::string wall(const std::string &keys) {
  return "[[contact]]\nname = \"wall\"\nbetween = [\"axis\", \"ground\"]\ngap = 0.001\n" + keys;
}

TEST(TableElements, RefuseWhatTheyCannotMean) {
  const std::string axis = body("mass = 1\n") + kGuide;
  const std::string cogging =
      axis + "[[cogging]]\nname = \"x\"\nbetween = [\"axis\", \"ground\"]\nperiod = 0.03\n";
  EXPECT_EQ(refusal(cogging + "force = 1\nfrom = 1\nto = 1\n"), "cogging[0].to");
  EXPECT_EQ(refusal(cogging + "force = 1\nfrom = 0\nto = 2\n"), "cogging[0].period");
  EXPECT_EQ(refusal(cogging + "force = [1, 2]\nsegments = 4\nfrom = 0\nto = 0.1\n"),
            "cogging[0].segments");
  EXPECT_EQ(refusal(cogging + "force = 1\nsegments = 3\nfrom = 0\nto = 0.1\n"),
            "cogging[0].segments");
  EXPECT_EQ(refusal(cogging + "force = 1\nposition = 1e20\nfrom = 1e20\nto = 2e20\n"),
            "cogging[0].period");
  const std::string external = axis + "[[external]]\nname = \"x\"\nbody = \"axis\"\n";
  EXPECT_EQ(refusal(external + "times = 1\nforces = 1\n"), "external[0].times");
  EXPECT_EQ(refusal(external + "times = [1, 2]\nforces = 1\n"), "external[0].forces");
  EXPECT_EQ(refusal(external + "times = [-1, 2]\nforces = [1, 1]\n"), "external[0].times[0]");
  EXPECT_EQ(refusal(external + "times = [2, 2]\nforces = [1, 1]\n"), "external[0].times[1]");
  EXPECT_EQ(refusal(axis + wall("stiffness = [1, 2]\nbreaks = [-1]\n")), "contact[0].breaks[0]");
  EXPECT_EQ(refusal(axis + wall("stiffness = [1, 0]\nbreaks = [1]\n")), "contact[0].stiffness[1]");
  EXPECT_EQ(refusal(axis + wall("stiffness = [1, 2]\n")), "contact[0].stiffness");
  EXPECT_EQ(refusal(axis + wall("stiffness = 1\nmaxwell_stiffness = 1\n")),
            "contact[0].maxwell_time");
  EXPECT_EQ(refusal(axis + wall("stiffness = 1\nmaxwell_time = 1\n")), "contact[0].maxwell_time");
  const std::string solid = "maxwell_stiffness = 1\nmaxwell_time = 1\n";
  EXPECT_EQ(refusal(axis + wall("stiffness = 1\ndamping = 1\n" + solid)),
            "contact[0].maxwell_stiffness");
  EXPECT_EQ(refusal(axis + wall("stiffness = [1, 2]\nbreaks = [1]\n" + solid)),
            "contact[0].maxwell_stiffness");
}

// Without damping a bounce gives all of the energy back, and the deepest overlap follows from it:
// 1/2 m v^2 = 1/2 k1 b^2 + k1 b y + 1/2 k2 y^2.
TEST(StiffeningContact, BounceGivesTheEnergyBack) {
  Plant plant(make_model(body("mass = 2\nvelocity = 0.5\n") +
                         wall("stiffness = [1e4, 8e4]\nbreaks = [0.002]\n")),
              {.audit = true});
  double deepest = 0.0;
  double force = 0.0;
  for (int k = 0; k < 64 * 100; ++k) {
    if (k == 0)
      plant = Plant(std::make_shared<ModeCache>(
                        make_model(body("mass = 2\nvelocity = 0.5\n") +
                                   wall("stiffness = [1e4, 8e4]\nbreaks = [0.002]\n")),
                        64),
                    {.audit = true});
    plant.step(0, false);
    deepest = std::max(deepest, plant.signal("wall.deflection"));
    force = std::max(force, plant.signal("wall.force"));
  }
  const double energy = 0.25 - 0.5 * 1e4 * 4e-6;
  const double y = (-1e4 * 0.002 + std::sqrt(400 + 2 * 8e4 * energy)) / 8e4;
  EXPECT_NEAR(deepest, 0.002 + y, 1e-8);
  EXPECT_NEAR(force, 20 + 8e4 * y, 1e-3);
  EXPECT_NEAR(plant.signal("axis.velocity"), -0.5, 1e-12);
  EXPECT_NEAR(plant.energy().discarded, 0.0, 1e-20);
  EXPECT_LT(residual(plant), 1e-13);
}

// Damped, with a curve given by loads, and separating before the surfaces part.
TEST(StiffeningContact, MovesAsAnIntegration) {
  Plant plant(make_model(body("mass = 2\nvelocity = 0.5\n") +
                         wall("stiffness = [1e4, 3e4, 8e4]\nloads = [20, 80]\ndamping = 90\n")),
              {.audit = true});
  const auto curve = [](long double d) {
    return d < 0.002L ? 1e4L * d : d < 0.004L ? 20 + 3e4L * (d - 0.002L) : 80 + 8e4L * (d - 0.004L);
  };
  Mass mass{0.0L, 0.5L, 2.0L};
  for (int k = 0; k < 60; ++k) {
    plant.step(0, false);
    mass.tick([&](long double x, long double v) {
      const long double d = x - 0.001L;
      const long double force = curve(d) + 90 * v;
      return d > 0 && force > 0 ? -force : 0.0L;
    });
    // The integration does not stop where the force jumps by 45 N, in a step of 1.7 us. The second
    // simulator of random_models.py does.
    ASSERT_NEAR(plant.signal("axis.position"), static_cast<double>(mass.x), 1e-6) << "tick " << k;
    ASSERT_NEAR(plant.signal("axis.velocity"), static_cast<double>(mass.v), 4e-5);
  }
  EXPECT_LT(plant.signal("axis.velocity"), 0.0);
  EXPECT_GT(plant.energy().discarded, 0.0);
  EXPECT_LT(residual(plant), 1e-12);
}

TEST(StiffeningContact, LinearModelHasTheSlopeOfItsSegment) {
  const auto model =
      make_model(body("mass = 2\n") + wall("stiffness = [1e4, 8e4]\nbreaks = [0.002]\n"));
  const std::string inputs[] = {"axis.force"};
  const std::string outputs[] = {"wall.spring_force"};
  EXPECT_DOUBLE_EQ(linearise(*model, {}, inputs, outputs).C(0, 0), 1e4);
  const LinearMode deep{{{"wall.stiffness", "segment 1"}}};
  EXPECT_DOUBLE_EQ(linearise(*model, deep, inputs, outputs).C(0, 0), 8e4);
  EXPECT_DOUBLE_EQ(linearise(*model, deep, inputs, outputs).A(1, 0), -4e4);
}

const std::string kSolid = "stiffness = 2e4\nmaxwell_stiffness = 6e4\nmaxwell_time = \"12 ms\"\n";

// A surface that is pressed in at once and held: F = (k + m e^(-t/T)) d.
TEST(Solid, RelaxesAtAHeldDeflection) {
  Plant plant(make_model(body("mass = 1e12\nposition = 0.003\n") + wall(kSolid)));
  for (int k = 1; k <= 200; ++k) {
    plant.step(0, false);
    const double d = plant.signal("wall.deflection");
    const double force = (2e4 + 6e4 * std::exp(-k * kTickS / 0.012)) * d;
    ASSERT_NEAR(plant.signal("wall.force") / force, 1.0, 1e-9) << "tick " << k;
  }
}

// The complex stiffness k + m j w T / (1 + j w T), as a transfer function of the position.
TEST(Solid, HasTheComplexStiffnessOfZener) {
  const auto model = make_model(body("mass = 2\n") + wall(kSolid));
  const std::string inputs[] = {"axis.force"};
  const std::string outputs[] = {"axis.position"};
  const Linear linear = linearise(*model, {}, inputs, outputs);
  ASSERT_EQ(linear.states.back(), "wall.dashpot");
  // x'' = -(k + m) x / M + m w / M,  w' = (x - w) / T
  EXPECT_DOUBLE_EQ(linear.A(1, 0), -4e4);
  EXPECT_DOUBLE_EQ(linear.A(1, 2), 3e4);
  EXPECT_DOUBLE_EQ(linear.A(2, 0), 1 / 0.012);
  EXPECT_DOUBLE_EQ(linear.A(2, 2), -1 / 0.012);
}

// Pressed, lost, and met again while the surface has not yet recovered.
TEST(Solid, BouncesAsAnIntegration) {
  const std::string gravity = "[[gravity]]\nname = \"weight\"\nbody = \"axis\"\nacceleration = 9\n";
  const std::string text = body("mass = 2\nvelocity = 0.8\n") + wall(kSolid) + gravity;
  Plant plant(make_model(text), {.audit = true});
  // Three states, with steps of 1/400 tick of the classical Runge-Kutta method; the switch lies
  // where (k + m) d = m w.
  long double z[3] = {0, 0.8L, 0};
  const auto rates = [](const long double *s, long double *r) {
    const long double meeting = 8e4L * (s[0] - 0.001L) - 6e4L * s[2];
    const long double surface = meeting > 0 ? s[0] - 0.001L : 0.75L * s[2];
    r[0] = s[1];
    r[1] = 9 - (meeting > 0 ? meeting : 0) / 2;
    r[2] = (surface - s[2]) / 0.012L;
  };
  const long double h = 1.0L / 1500 / 400;
  for (int k = 0; k < 400; ++k) {
    plant.step(0, false);
    for (int n = 0; n < 400; ++n) {
      long double r[4][3];
      long double s[3];
      rates(z, r[0]);
      for (int stage = 1; stage < 4; ++stage) {
        for (int i = 0; i < 3; ++i) s[i] = z[i] + h * (stage == 3 ? 1 : 0.5L) * r[stage - 1][i];
        rates(s, r[stage]);
      }
      for (int i = 0; i < 3; ++i) z[i] += h / 6 * (r[0][i] + 2 * r[1][i] + 2 * r[2][i] + r[3][i]);
    }
    ASSERT_NEAR(plant.signal("axis.position"), static_cast<double>(z[0]), 1e-8) << "tick " << k;
    ASSERT_NEAR(plant.signal("axis.velocity"), static_cast<double>(z[1]), 1e-6) << "tick " << k;
  }
  EXPECT_GE(count_of(plant, "wall", "pressed", "apart"), 2);
  EXPECT_NEAR(plant.energy().discarded, 0.0, 1e-15);
  EXPECT_LT(residual(plant), 1e-12);
}

// A spring of the same kind, which is never lost: creep under a constant force.
// x = F/k (1 - m/(k+m) e^(-t k / ((k+m) T))) of a body without mass; here its slow part.
TEST(Solid, SpringCreepsUnderAConstantForce) {
  Plant plant(
      make_model(
          body("mass = 1e-3\n") +
          "[[spring]]\nname = \"pad\"\nbetween = [\"axis\", \"ground\"]\ndamping = 30\n" + kSolid +
          "[[external]]\nname = \"push\"\nbody = \"axis\"\ntimes = [0, 10]\nforces = [40, 40]\n"),
      {.audit = true});
  const double m = 1e-3;
  // Poles of M s^2 + b s + k + m s T / (1 + s T): the slow one by bisection.
  const auto poly = [&](double s) {
    return (m * s * s + 30 * s + 2e4) * (1 + s * 0.012) + 6e4 * s * 0.012;
  };
  double low = -1 / 0.012;
  double high = 0.0;
  for (int k = 0; k < 200; ++k) {
    const double middle = 0.5 * (low + high);
    (poly(middle) > 0 ? high : low) = middle;
  }
  double last = 0.0;
  for (int k = 1; k <= 90; ++k) {
    plant.step(0, false);
    const double left = 40 / 2e4 - plant.signal("axis.position");
    if (k > 30) {
      ASSERT_NEAR(left / last, std::exp(low * kTickS), 1e-9) << k;
    }
    last = left;
  }
  EXPECT_LT(residual(plant), 1e-12);
}

}  // namespace
}  // namespace forceaxis::sim::test
