// Friction, backlash and stops against closed forms, and what ends with an error instead of a hang.
#include <chrono>
#include <cmath>
#include <string>
#include <vector>

#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

const double kPi = std::acos(-1.0);

std::string body(const std::string &name, double mass, double position, double velocity) {
  return "[[body]]\nname = \"" + name + "\"\nmass = " + number(mass) +
         "\nposition = " + number(position) + "\nvelocity = " + number(velocity) + "\n";
}

std::string link(const std::string &kind, const std::string &name, const std::string &a,
                 const std::string &b, const std::string &more) {
  return "[[" + kind + "]]\nname = \"" + name + "\"\nbetween = [\"" + a + "\", \"" + b + "\"]\n" +
         more;
}

// 2 kg on 5000 N/m from 12.3 mm: each turn lies 2 F_c / k = 4 mm nearer to the middle, until the
// spring's 21.5 N at the second one are less than the stiction.
TEST(Friction, StictionHoldsWhereCoulombFrictionWouldNot) {
  Plant plant(
      make_model(body("mass", 2, 0.0123, 0) +
                 link("spring", "spring", "mass", "ground", "stiffness = 5000\n") +
                 link("friction", "rail", "mass", "ground", "coulomb = 10\nstiction = 25\n")));
  for (int k = 0; k < 600; ++k) plant.step(0, false);
  EXPECT_NEAR(plant.signal("mass.position"), 0.0043, 1e-16);
  EXPECT_NEAR(plant.signal("rail.force"), -21.5, 1e-12);
  EXPECT_EQ(plant.signal("mass.acceleration"), 0.0);
  const auto events = plant.events();
  ASSERT_EQ(events.size(), 3U);  // stuck, forward, stuck
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_NEAR(events[i].time_s, static_cast<double>(i / 2 + 1) * kPi / 50, 1e-15);
}

// A drive behind a screw presses a load on a stiff tool. It comes to rest ever more slowly, while
// all forces at the load approach its friction: within rounding the load neither slides nor sticks.
struct AtRest {
  double position, velocity, coulomb, damping, acceleration;
};

std::string pressing(const AtRest &one, bool rubs) {
  return body("motor", 20, one.position, one.velocity) +
         body("load", 10, one.position, one.velocity) +
         link("spring", "screw", "motor", "load", "stiffness = 2e6\ndamping = 1000\n") +
         link("spring", "tool", "load", "ground", "stiffness = 1e6\n") +
         link("damper", "loop", "motor", "ground", "damping = " + number(one.damping) + "\n") +
         "[[gravity]]\nname = \"weight\"\nbody = \"motor\"\nacceleration = " +
         number(one.acceleration) + "\n" +
         (rubs ? link("friction", "rail", "load", "ground",
                      "coulomb = " + number(one.coulomb) + "\n")
               : "");
}

TEST(Friction, ALoadWhoseForcesApproachItsFrictionComesToRest) {
  const AtRest every[] = {
      {0.0091, 0, 4, 8755, -8.9},  {-0.0055, 0, 4, 8823, -7.5}, {0.0085, 0, 4, 8758, 7.8},
      {-0.0082, 0, 4, 8768, -7.0}, {-0.0055, 0, 4, 8683, 8.9},  {-0.0001, 0, 4, 8327, -8.2},
      {0.0046, 0, 4, 8596, -9.3},  {0.0092, 0, 4, 8398, 4.6},   {-0.0089, 0, 4, 8544, -5.9},
  };
  for (const AtRest &one : every) {
    Plant plant(make_model(pressing(one, true)), {true, 10});
    ASSERT_NO_THROW(for (int k = 0; k < 2000; ++k) plant.step(0, false)) << one.damping;
    // All that the friction can bear.
    const double left = 20 * one.acceleration - 1e6 * plant.signal("load.position");
    EXPECT_NEAR(std::abs(left), 4.0, 1e-8);
    EXPECT_NEAR(plant.signal("load.velocity"), 0.0, 1e-13);
    EXPECT_NEAR(plant.energy().residual, 0.0, 1e-12);
  }
}

TEST(Friction, OfNoForceLeavesTheMotionAsItIs) {
  const AtRest every[] = {
      {-0.0098, 0.05, 0, 4550, 9.7},
      {-0.0006, 0.05, 0, 4374, -9.1},
      {-0.0069, -0.09, 0, 4688, -9.2},
  };
  for (const AtRest &one : every)
    for (const double coulomb : {0.0, 1e-13, 1e-10}) {
      Plant plant(make_model(pressing(
                      {one.position, one.velocity, coulomb, one.damping, one.acceleration}, true)),
                  {true, 10});
      Plant without(make_model(pressing(one, false)));
      for (int k = 0; k < 3000; ++k) {
        ASSERT_NO_THROW(plant.step(0, false)) << one.damping << " " << coulomb;
        without.step(0, false);
        ASSERT_NEAR(plant.signal("load.position"), without.signal("load.position"), 3e-15);
        ASSERT_NEAR(plant.signal("load.velocity"), without.signal("load.velocity"), 1e-12);
        ASSERT_NEAR(plant.signal("motor.velocity"), without.signal("motor.velocity"), 1e-12);
      }
      EXPECT_NEAR(plant.energy().residual, 0.0, 1e-12);
    }
}

TEST(Friction, AnImpulseBreaksItLooseAndItStopsAgain) {
  Plant plant(make_model(body("sled", 2, 0, 0) +
                         link("friction", "rail", "ground", "sled", "coulomb = 6\n")),
              {true, 10});
  for (int k = 0; k < 30; ++k) plant.step(0, false);
  plant.apply_impulse("sled", 1.0);  // 0.5 m/s; the rail sees the sled go backward
  EXPECT_EQ(plant.mode()[0], "rail: backward");
  EXPECT_EQ(plant.signal("rail.force"), -6.0);
  EXPECT_EQ(plant.signal("sled.acceleration"), -3.0);
  for (int k = 0; k < 300; ++k) plant.step(0, false);
  const auto events = plant.events();
  ASSERT_EQ(events.size(), 2U);
  EXPECT_TRUE(events[0].jump);
  EXPECT_NEAR(events[1].time_s, 0.02 + 0.5 / 3, 1e-15);
  EXPECT_EQ(events[1].to, "stuck");
  EXPECT_NEAR(plant.signal("sled.position"), 0.25 / 6, 1e-15);
  plant.apply_impulse("sled", -1.0);
  EXPECT_EQ(plant.mode()[0], "rail: forward");
  plant.apply_impulse("sled", 3.0);  // sliding reversed at once
  EXPECT_EQ(plant.mode()[0], "rail: backward");
  EXPECT_NEAR(plant.energy().residual, 0.0, 1e-13);
}

// Pulled through a spring by a body so heavy that its speed does not change. With y the spring's
// extension, c = F_c / k, a = (F_s - F_c) / k: it breaks loose at y = c + a, slides as
// y = c + a cos(w t) + (V / w) sin(w t) until y' = V again, at y = c - a, and sticks for 2 a / V.
TEST(StickSlip, EveryBreakawayAndStop) {
  const double speed = 0.01, stiffness = 2e4, mass = 0.5, w = 200;  // sqrt(k / m)
  const double coulomb = 4, stiction = 9;
  Plant plant(make_model(
      body("puller", 1e20, 0, speed) + body("block", mass, 0, 0) +
      link("spring", "rope", "puller", "block", "stiffness = " + number(stiffness) + "\n") +
      link("friction", "table", "block", "ground",
           "coulomb = " + number(coulomb) + "\nstiction = " + number(stiction) + "\n")));
  for (int k = 0; k < 1500; ++k) plant.step(0, false);
  const double a = (stiction - coulomb) / stiffness;
  const double slip = (2 * kPi - 2 * std::atan(a * w / speed)) / w;
  const double stick = 2 * a / speed;
  const auto events = plant.events();
  double t = stiction / (stiffness * speed);
  std::size_t i = 0;
  for (; t < 1.0; ++i) {
    ASSERT_LT(i, events.size());
    const bool loose = i % 2 == 0;
    EXPECT_EQ(events[i].to, loose ? "forward" : "stuck");
    EXPECT_NEAR(events[i].time_s, t, 1e-13);
    t += loose ? slip : stick;
  }
  EXPECT_EQ(events.size(), i);
  EXPECT_GT(i, 20U);
}

// Two bodies with 1 mm of play. Their relative motion is that of the reduced mass, 0.75 kg: flights
// at constant speed, and on either flank half a sine at 400 rad/s.
TEST(Backlash, FlightsAcrossThePlayAndElasticReturns) {
  Plant plant(make_model(body("a", 1, 0, 0.3) + body("b", 3, 0, 0.1) +
                         link("backlash", "gear", "a", "b", "stiffness = 120000\nwidth = 1e-3\n") +
                         link("damper", "air", "b", "ground", "damping = 0\n")),
              {true, 100});
  for (int k = 0; k < 150; ++k) plant.step(0, false);
  const auto events = plant.events();
  double t = 0.5e-3 / 0.2;  // from the middle
  std::size_t i = 0;
  for (; t < 0.1; ++i) {
    ASSERT_LT(i, events.size());
    const bool touches = i % 2 == 0;
    EXPECT_EQ(events[i].element, i % 4 < 2 ? "gear.high" : "gear.low");
    EXPECT_EQ(events[i].to, touches ? "pressed" : "apart");
    EXPECT_NEAR(events[i].time_s, t, 1e-14);
    t += touches ? kPi / 400 : 1e-3 / 0.2;
  }
  EXPECT_EQ(events.size(), i);
  EXPECT_GT(i, 10U);
  // Nothing acts on both together.
  const double place = (plant.signal("a.position") + 3 * plant.signal("b.position")) / 4;
  EXPECT_NEAR(place, 0.15 * 0.1, 1e-15);
  EXPECT_NEAR(plant.energy().residual, 0.0, 1e-13);
}

TEST(Backlash, ForceOnEitherFlankPushesTheEndsApart) {
  for (const double sign : {1.0, -1.0}) {
    Plant plant(
        make_model(body("a", 1, sign * 0.7e-3, 0) +
                   link("backlash", "gear", "a", "ground", "stiffness = 1000\nwidth = 1e-3\n")));
    EXPECT_NEAR(plant.signal("gear.force"), sign * 0.2, 1e-15);
    EXPECT_NEAR(plant.signal("gear.spring_force"), sign * 0.2, 1e-15);
    EXPECT_EQ(plant.signal("gear.deflection"), sign * 0.7e-3);
    EXPECT_NEAR(plant.signal("a.acceleration"), -sign * 0.2, 1e-15);
    EXPECT_EQ(plant.mode()[0], sign > 0 ? "gear.low: apart" : "gear.low: pressed");
    EXPECT_EQ(plant.mode()[1], sign > 0 ? "gear.high: pressed" : "gear.high: apart");
  }
}

// Between damped stops. From touch-down x = v/wd e^(-st) sin(wd t); the stop lets go where its
// force is 0, tan(wd t) = 2 s wd / (s^2 - wd^2), and the body flies out of the overlap.
TEST(Stop, EachBounceLosesSpeedAsItsDampingSays) {
  const double mass = 2, stiffness = 2e5, damping = 60, low = -1e-3, high = 3e-3;
  Plant plant(make_model(body("table", mass, 0, 0.4) +
                         link("stop", "end", "table", "ground",
                              "stiffness = 2e5\ndamping = 60\nlow = -1e-3\nhigh = 3e-3\n")),
              {true, 100});
  for (int k = 0; k < 300; ++k) plant.step(0, false);
  const double s = damping / (2 * mass), wd = std::sqrt(stiffness / mass - s * s);
  const double hold = (kPi - std::atan2(2 * s * wd, wd * wd - s * s)) / wd;
  const double decay = std::exp(-s * hold);
  const auto events = plant.events();
  double t = high / 0.4, v = 0.4, lost = 0.0;
  std::size_t i = 0;
  const auto expect = [&](const std::string &element, const char *to) {
    ASSERT_LT(i, events.size());
    EXPECT_EQ(events[i].element, element);
    EXPECT_EQ(events[i].to, to);
    EXPECT_NEAR(events[i].time_s, t, 1e-13);
    ++i;
  };
  for (int bounce = 0; t < 0.19; ++bounce) {
    const std::string side = bounce % 2 == 0 ? "end.high" : "end.low";
    expect(side, "pressed");
    t += hold;
    expect(side, "overlap");
    const double x = v / wd * decay * std::sin(wd * hold);
    v *= -decay * (std::cos(wd * hold) - s / wd * std::sin(wd * hold));
    ASSERT_GT(v, 0.0);
    lost += 0.5 * stiffness * x * x;
    t += x / v;
    expect(side, "apart");
    t += (high - low) / v;
  }
  EXPECT_GT(i, 20U);
  EXPECT_NEAR(plant.energy().residual, 0.0, 1e-13);
  EXPECT_GE(plant.energy().discarded, lost * (1 - 1e-12));
}

// Overlapping but leaving too fast for the damper to push; a constant force brings the body back,
// and the stop pushes again from where k d + b d' = 0, before the overlap has gone.
TEST(Stop, IsEnteredAgainOutOfTheOverlap) {
  const double d = 2e-4, v = 0.05, k = 1e4, b = 200, a = 40;  // k d = 2 < b v = 10
  Plant plant(make_model(
      body("table", 1, 1e-3 + d, -v) +
      link("stop", "end", "table", "ground", "stiffness = 1e4\ndamping = 200\nhigh = 1e-3\n") +
      "[drive]\ntype = \"perfect\"\nbody = \"table\"\nforce_per_volt = 32\n"));
  EXPECT_EQ(plant.mode()[0], "end.high: overlap");
  for (int i = 0; i < 3; ++i) plant.step(256, true);  // 1.25 V, 40 N
  // k (d - v t + a t^2 / 2) + b (a t - v) = 0
  const double p = k * a / 2, q = b * a - k * v, r = k * d - b * v;
  const double t = (-q + std::sqrt(q * q - 4 * p * r)) / (2 * p);
  const auto events = plant.events();
  ASSERT_GE(events.size(), 1U);
  EXPECT_EQ(events[0].element, "end.high");
  EXPECT_EQ(events[0].from, "overlap");
  EXPECT_EQ(events[0].to, "pressed");
  EXPECT_NEAR(events[0].time_s, t, 1e-16);
}

// Three small blocks on stiff ropes over one table stick and slip 1e6 times a second each.
TEST(Chattering, OfFrictionEndsWithAnError) {
  std::string text = body("puller", 1e6, 0, 1);
  for (int i = 0; i < 3; ++i) {
    const std::string name = indexed('b', i);
    text += body(name, 1e-6, 0, 0) +
            link("spring", "rope" + name, "puller", name, "stiffness = 9e7\n") +
            link("friction", "table" + name, name, "ground",
                 "coulomb = 1\nstiction = " + number(3 + 0.1 * i) + "\n");
  }
  Plant plant(make_model(text));
  const auto start = std::chrono::steady_clock::now();
  try {
    for (int k = 0; k < 100; ++k) plant.step(0, false);
    FAIL() << "expected SimulationError";
  } catch (const SimulationError &error) {
    const std::string message = error.what();
    EXPECT_EQ(message.rfind("tableb", 0), 0U) << message;
    EXPECT_NE(message.find(" keeps switching without end at t = "), std::string::npos) << message;
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
  EXPECT_LT(took.count(), 5.0);
}

}  // namespace
}  // namespace forceaxis::sim::test
