// Contacts: instants, rebounds, dips and grazes against closed forms.
#include <cmath>
#include <cstdio>
#include <map>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

std::string ball(double mass, double velocity, double stiffness, double damping, double gap) {
  return "[[body]]\nname = \"ball\"\nmass = " + number(mass) + "\nvelocity = " + number(velocity) +
         "\n[[contact]]\nname = \"wall\"\nbetween = [\"ball\", \"ground\"]\nstiffness = " +
         number(stiffness) + "\ndamping = " + number(damping) + "\ngap = " + number(gap) + "\n";
}

TEST(ElasticContact, DurationAndRebound) {
  Plant plant(make_model(ball(2.0, 0.25, 8e6, 0.0, 1e-3)), {true, 100});  // w = 2000 rad/s
  for (int k = 0; k < 30; ++k) plant.step(0, false);
  const auto events = plant.events();
  ASSERT_EQ(events.size(), 2U);
  const double touch = 1e-3 / 0.25;
  EXPECT_NEAR(events[0].time_s, touch, 1e-17 * 100);
  EXPECT_EQ(events[0].element, "wall");
  EXPECT_EQ(events[0].from, "apart");
  EXPECT_EQ(events[0].to, "pressed");
  EXPECT_NEAR(events[1].time_s, touch + std::acos(-1.0) / 2000.0, 1e-15);
  EXPECT_EQ(events[1].to, "apart");
  EXPECT_NEAR(plant.signal("ball.velocity"), -0.25, 1e-13);
  EXPECT_NEAR(plant.signal("ball.position"),
              1e-3 - 0.25 * (30 * kTickS - touch - std::acos(-1.0) / 2000.0), 1e-15);
  EXPECT_NEAR(plant.energy().residual, 0.0, 1e-15);
}

TEST(ElasticContact, ForceWhilePressedIsTheHalfSine) {
  Plant plant(make_model(ball(2.0, 0.25, 2e4, 0.0, 0.0)));  // w = 100 rad/s: some 47 ticks
  for (int k = 1; k <= 47; ++k) {
    plant.step(0, false);
    const long double x = 0.25L / 100 * std::sin(100 * (k / 1500.0L));
    ASSERT_NEAR(plant.signal("wall.force"), static_cast<double>(2e4L * x), 2e-12);
    ASSERT_NEAR(plant.signal("wall.spring_force"), static_cast<double>(2e4L * x), 2e-12);
  }
  plant.step(0, false);
  EXPECT_EQ(plant.signal("wall.force"), 0.0);
  EXPECT_LT(plant.signal("wall.deflection"), 0.0);
}

struct DampedImpact {
  double mass, speed, stiffness, damping;
};

class DampedContact : public testing::TestWithParam<DampedImpact> {};

// From touch-down at t = 0: x = v/wd e^(-st) sin(wd t); the force is -m x'', so it reaches 0 where
// tan(wd t) = 2 s wd / (s^2 - wd^2); from there the ball flies out of the overlap at that speed.
TEST_P(DampedContact, TouchReleaseAndSeparation) {
  const auto [mass, speed, stiffness, damping] = GetParam();
  Plant plant(make_model(ball(mass, speed, stiffness, damping, 2e-3)), {true, 100});
  const double s = damping / (2 * mass);
  const double wd = std::sqrt(stiffness / mass - s * s);
  const double touch = 2e-3 / speed;
  const double release = (std::acos(-1.0) - std::atan2(2 * s * wd, wd * wd - s * s)) / wd;
  const double decay = std::exp(-s * release);
  const double x = speed / wd * decay * std::sin(wd * release);
  const double v = speed * decay * (std::cos(wd * release) - s / wd * std::sin(wd * release));
  ASSERT_GT(x, 0.0);
  ASSERT_LT(v, 0.0);
  const double apart = touch + release + x / -v;
  while (plant.time_s() < apart + kTickS) plant.step(0, false);
  const auto events = plant.events();
  ASSERT_EQ(events.size(), 3U);
  EXPECT_NEAR(events[0].time_s, touch, 1e-15);
  EXPECT_EQ(events[1].from, "pressed");
  EXPECT_EQ(events[1].to, "overlap");
  EXPECT_NEAR(events[1].time_s, touch + release, 1e-13 * apart);
  EXPECT_EQ(events[2].to, "apart");
  EXPECT_NEAR(events[2].time_s, apart, 1e-12 * apart);
  EXPECT_NEAR(plant.signal("ball.velocity") / v, 1.0, 1e-12);
  const EnergyAudit energy = plant.energy();
  EXPECT_NEAR(energy.discarded, 0.5 * stiffness * x * x, 1e-12 * energy.initial);
  // The energy of a contact with 1e5 rad/s is the sum of quadratic forms over pieces of a tick.
  // These forms multiply positions, which are 200 times the deflection.
  EXPECT_NEAR(energy.residual, 0.0, (stiffness < 1e8 ? 1e-13 : 1e-12) * energy.initial);
}

INSTANTIATE_TEST_SUITE_P(All, DampedContact,
                         testing::Values(DampedImpact{2.0, 0.25, 2e4, 16.5},
                                         DampedImpact{2.0, 0.25, 2e4, 200.0},
                                         DampedImpact{0.14, 0.1, 1e7, 30.0},
                                         DampedImpact{0.01, 1.0, 1e8, 100.0}));

// w = 1e5 rad/s: pressed for 31 us, a twentieth of a tick, between two samples that see nothing.
TEST(ShortContact, IsFoundInsideATick) {
  Plant plant(make_model(ball(0.1, 0.3, 1e9, 0.0, 3e-4)));
  plant.step(0, false);
  plant.step(0, false);
  const auto events = plant.events();
  ASSERT_EQ(events.size(), 2U);
  EXPECT_NEAR(events[0].time_s, 1e-3, 1e-16);
  EXPECT_NEAR(events[1].time_s, 1e-3 + std::acos(-1.0) / 1e5, 1e-15);
  EXPECT_NEAR(plant.signal("ball.velocity"), -0.3, 1e-12);
}

// Between two walls, both reached again and again inside single ticks.
TEST(ShortContact, ManyCrossingsInsideOneTick) {
  const double w = 1e6;  // 1e9 N/m on 1 g
  Plant plant(make_model(ball(1e-3, 1.0, 1e9, 0.0, 2e-5) +
                         "[[contact]]\nname = \"back\"\nbetween = [\"ground\", \"ball\"]\n"
                         "stiffness = 1e9\ngap = 2e-5\n"));
  for (int k = 0; k < 30; ++k) plant.step(0, false);
  const auto events = plant.events();
  const double press = std::acos(-1.0) / w;
  double t = 2e-5;
  std::size_t i = 0;
  while (t < 30 * kTickS) {
    ASSERT_LT(i, events.size());
    const bool touching = i % 2 == 0;
    ASSERT_EQ(events[i].element, i % 4 < 2 ? "wall" : "back");
    ASSERT_EQ(events[i].to, touching ? "pressed" : "apart");
    ASSERT_NEAR(events[i].time_s, t, 1e-12);
    t += touching ? press : 4e-5;
    ++i;
  }
  EXPECT_EQ(events.size(), i);
  EXPECT_GT(i, 800U);
}

// Thrown against a constant pull of 10 m/s^2 at 0.01 m/s, the body turns round after 1 ms, inside
// the second tick, at 5e-6 m.
std::string thrown(double gap, double damping) {
  return "[[body]]\nname = \"ball\"\nmass = 1\nvelocity = 0.01\n[drive]\ntype = \"perfect\"\n"
         "body = \"ball\"\nforce_per_volt = 1\n[[contact]]\nname = \"wall\"\nbetween = [\"ball\", "
         "\"ground\"]\nstiffness = 1000\ndamping = " +
         number(damping) + "\ngap = " + number(gap) + "\n";
}

TEST(Graze, DipsDownTo1e15AreFoundAndClearancesAreNot) {
  for (const double damping : {0.0, 5.0})
    for (const double depth : {1e-9, 1e-12, 1e-14, 1e-15}) {
      Plant hit(make_model(thrown(5e-6 - depth, damping)));
      Plant miss(make_model(thrown(5e-6 + depth, damping)));
      for (int k = 0; k < 10; ++k) hit.step(-2048, true), miss.step(-2048, true);
      EXPECT_EQ(count_of(hit, "wall", "apart", "pressed"), 1) << depth << " " << damping;
      EXPECT_EQ(hit.mode()[0], "wall: apart") << depth << " " << damping;
      EXPECT_EQ(miss.crossings(), 0) << depth << " " << damping;
      // Half the time above the gap is sqrt(2 depth / a).
      const double half = std::sqrt(2 * depth / 10.0);
      EXPECT_NEAR(hit.events()[0].time_s, 1e-3 - half, 1e-8 * 1e-3 + 1e-2 * half);
    }
}

TEST(Graze, LeavesTheFlightAlone) {
  Plant plant(make_model(thrown(5e-6 - 1e-12, 0.0)));
  for (int k = 0; k < 3; ++k) plant.step(-2048, true);
  // 2 ms: back at the start, but for the impulse of a contact 1e-12 m deep and 0.9 us long.
  EXPECT_NEAR(plant.signal("ball.position"), 0.0, 1e-17);
  EXPECT_NEAR(plant.signal("ball.velocity"), -0.01, 1e-14);
}

// A mass that falls on a damped contact, bounce by bounce in closed form: when it touches down.
class Falling {
 public:
  Falling(double mass, double stiffness, double damping, double gravity, double height,
          double speed)
      : s_(damping / (2 * mass)),
        w_(std::sqrt(stiffness / mass - s_ * s_)),
        rate_(damping / stiffness),
        g_(gravity),
        sag_(mass * gravity / stiffness),
        speed_(std::sqrt(speed * speed + 2 * gravity * height)),
        touch_s_((speed_ - speed) / gravity) {}

  double touch_s() const { return touch_s_; }
  double speed() const { return speed_; }

  /// To the next touch-down. False: the mass stays on the contact.
  bool bounce() {
    // x = sag + e^(-s t) (a cos wt + b sin wt) while pressed; released where x + rate x' = 0.
    double low = 0.0;
    double high = 0.0;
    const double step = 0.02 / w_;
    do {
      low = high;
      high += step;
      if (high * w_ > 10.0) return false;
    } while (force(high) > 0.0);
    for (int k = 0; k < 60; ++k) {
      const double middle = 0.5 * (low + high);
      (force(middle) > 0.0 ? low : high) = middle;
    }
    const auto [x, v] = at(high);
    // Free from there on; it leaves the overlap x if it rises that far.
    const double left = v * v - 2 * g_ * x;
    if (v >= 0.0 || left <= 0.0) return false;
    speed_ = std::sqrt(left);
    touch_s_ += high + (-v + speed_) / g_;
    return true;
  }

 private:
  struct Motion {
    double x, v;
  };
  Motion at(double t) const {
    const double a = -sag_;
    const double b = (speed_ + s_ * a) / w_;
    const double decay = std::exp(-s_ * t);
    const double c = std::cos(w_ * t);
    const double d = std::sin(w_ * t);
    return {sag_ + decay * (a * c + b * d),
            decay * ((b * w_ - s_ * a) * c - (a * w_ + s_ * b) * d)};
  }
  double force(double t) const {
    const auto [x, v] = at(t);
    return x + rate_ * v;
  }

  double s_, w_, rate_, g_, sag_, speed_, touch_s_;
};

// Every bounce is one touch-down, one release and one separation, one after the other.
TEST(Bouncing, EachBounceIsOneTouchDown) {
  std::mt19937 random(5);
  const auto within = [&random](double low, double high) {  // logarithmic
    return low * std::pow(high / low, std::uniform_real_distribution<double>(0, 1)(random));
  };
  constexpr double kEndS = 1.0;
  std::size_t bounces = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const double mass = within(0.01, 50);
    const double rate = within(100, 2e4);
    const double stiffness = mass * rate * rate;
    const double damping = 2 * within(0.003, 0.3) * mass * rate;
    const double height = within(1e-5, 1e-2);
    const double speed = within(0.01, 1.0);
    const double gravity = within(1.0, 100.0);
    const double wall = trial % 2 == 0 ? 0.0 : within(1e-6, 1.0);
    const std::string text =
        "[[body]]\nname = \"ball\"\nmass = " + number(mass) +
        "\nposition = " + number(wall - height) + "\nvelocity = " + number(speed) +
        "\n[[gravity]]\nname = \"weight\"\nbody = \"ball\"\nacceleration = " + number(gravity) +
        "\n[[contact]]\nname = \"wall\"\nbetween = [\"ball\", \"ground\"]\n"
        "stiffness = " +
        number(stiffness) + "\ndamping = " + number(damping) + "\ngap = " + number(wall) + "\n";
    SCOPED_TRACE("trial " + std::to_string(trial) + "\n" + text);
    PlantOptions options;
    options.listed_events = 100000;
    Plant plant(make_model(text), options);
    while (plant.time_s() < kEndS) plant.step(0, false);
    const auto events = plant.events();
    Falling expected(mass, stiffness, damping, gravity, height, speed);
    const char *const phases[] = {"apart", "pressed", "overlap"};
    std::size_t i = 0;
    bool leaves = true;
    for (; leaves && expected.touch_s() < kEndS - 1e-6; ++bounces) {
      ASSERT_LT(i, events.size());
      ASSERT_NEAR(events[i].time_s, expected.touch_s(), 1e-9);
      leaves = expected.bounce();
      for (std::size_t k = 0; k < 3 && i < events.size(); ++k, ++i) {
        ASSERT_EQ(events[i].from, phases[k]) << "event " << i;
        ASSERT_EQ(events[i].to, phases[(k + 1) % 3]) << "event " << i;
        ASSERT_GT(events[i].time_s, i > 0 ? events[i - 1].time_s : 0.0) << "event " << i;
        if (!leaves) break;
      }
    }
    // Afterwards it may let go of the wall for a moment, but never leaves it.
    if (leaves) {
      EXPECT_LE(events.size(), i + 1);
    }
    for (; i < events.size(); ++i) ASSERT_NE(events[i].to, "apart") << "event " << i;
  }
  EXPECT_GT(bounces, 5000U);
}

TEST(Rest, OnTheBoundaryIsStable) {
  // Touching without overlap and without force: nothing may happen, nothing may hang.
  Plant plant(make_model(ball(1.0, 0.0, 1e5, 10.0, 0.0)));
  for (int k = 0; k < 100; ++k) plant.step(0, false);
  EXPECT_EQ(plant.crossings(), 0);
  EXPECT_EQ(plant.signal("ball.position"), 0.0);
}

TEST(Rest, PushedOffTheBoundaryGoesTheRightWay) {
  for (const int code : {-100, 100}) {
    const std::string text =
        "[[body]]\nname = \"ball\"\nmass = 1\n[drive]\ntype = \"perfect\"\nbody = \"ball\"\n"
        "force_per_volt = 1\n[[contact]]\nname = \"wall\"\nbetween = [\"ball\", \"ground\"]\n"
        "stiffness = 1000\ndamping = 5\n";
    Plant pushed(make_model(text));
    for (int k = 0; k < 10; ++k) pushed.step(code, true);
    EXPECT_EQ(pushed.crossings(), code > 0 ? 1 : 0);
    EXPECT_EQ(pushed.mode()[0], code > 0 ? "wall: pressed" : "wall: apart");
  }
}

TEST(Start, OverlappingBodiesStartPressed) {
  Plant plant(make_model(ball(1.0, 0.0, 1e4, 10.0, -1e-3)));
  EXPECT_EQ(plant.mode()[0], "wall: pressed");
  EXPECT_DOUBLE_EQ(plant.signal("wall.force"), 10.0);
  EXPECT_EQ(plant.crossings() + plant.jumps(), 0);
  // Damping would pull: no force.
  Plant leaving(make_model(ball(1.0, -2.0, 1e4, 10.0, -1e-3)));
  EXPECT_EQ(leaving.mode()[0], "wall: overlap");
  EXPECT_EQ(leaving.signal("wall.force"), 0.0);
  EXPECT_DOUBLE_EQ(leaving.signal("wall.deflection"), 1e-3);
}

TEST(Impulse, ChangesTheVelocityAtOnce) {
  Plant plant(make_model(ball(2.0, 0.0, 1e4, 10.0, -1e-3)), {true, 100});
  plant.apply_impulse("ball", -4.0);  // pulls away: the damper would pull
  EXPECT_DOUBLE_EQ(plant.signal("ball.velocity"), -2.0);
  EXPECT_EQ(plant.mode()[0], "wall: overlap");
  const auto events = plant.events();
  ASSERT_EQ(events.size(), 1U);
  EXPECT_TRUE(events[0].jump);
  EXPECT_EQ(events[0].time_s, 0.0);
  EXPECT_DOUBLE_EQ(plant.energy().impulses, 4.0);
  EXPECT_DOUBLE_EQ(plant.energy().discarded, 0.5 * 1e4 * 1e-6);
  EXPECT_NEAR(plant.energy().residual, 0.0, 1e-15);
  EXPECT_THROW(plant.apply_impulse("bell", 1.0), std::invalid_argument);
  EXPECT_THROW(plant.apply_impulse("ball", std::nan("")), std::invalid_argument);
}

TEST(Events, TheListIsBoundedTheCountIsNot) {
  PlantOptions options;
  options.listed_events = 10;
  Plant plant(make_model(ball(1e-3, 1.0, 1e9, 0.0, 2e-5) +
                         "[[contact]]\nname = \"back\"\nbetween = [\"ground\", \"ball\"]\n"
                         "stiffness = 1e9\ngap = 2e-5\n"),
              options);
  for (int k = 0; k < 30; ++k) plant.step(0, false);
  EXPECT_EQ(plant.events().size(), 10U);
  EXPECT_GT(plant.crossings(), 800);
}

// The line names the file, the element and the body that are too fast for each other.
TEST(Refusals, DynamicsTooFastToResolve) {
  const std::string slow =
      "[[body]]\nname = \"base\"\nmass = 10\n[[body]]\nname = \"tip\"\nmass = 1e-9\nvelocity = "
      "0.1\n[[spring]]\nname = \"frame\"\nbetween = [\"base\", \"ground\"]\nstiffness = 1e9\n"
      "[[spring]]\nname = \"arm\"\nbetween = [\"tip\", \"base\"]\nstiffness = 1000\n";
  const auto refused = [&](const std::string &more, const char *element, const char *state) {
    const auto path = write_model(slow + more);
    try {
      Plant plant(std::make_shared<const Model>(load_model(path)));
      for (int k = 0; k < 100; ++k) plant.step(100, true);
      ADD_FAILURE() << "expected InputError for " << element;
    } catch (const InputError &error) {
      EXPECT_EQ(error.file, path.string());
      EXPECT_EQ(error.key, element);
      EXPECT_EQ(error.message.rfind("expected time constants of at least 1e-8 s, got ", 0), 0U);
      EXPECT_NE(error.message.find(std::string(" s with ") + state + ";"), std::string::npos)
          << error.message;
    }
  };
  // The spring's own 1e-6 s pass; sqrt(1e-9 kg / 1e9 N/m) = 1e-9 s and 1e-9 kg / 1 N s/m do not.
  refused("[[spring]]\nname = \"glass\"\nbetween = [\"tip\", \"base\"]\nstiffness = 1e9\n", "glass",
          "tip");
  refused("[[damper]]\nname = \"oil\"\nbetween = [\"ground\", \"tip\"]\ndamping = 1\n", "oil",
          "tip");
  // Found when the contact closes, in the middle of a run.
  refused(
      "[[contact]]\nname = \"wall\"\nbetween = [\"tip\", \"ground\"]\nstiffness = 1e9\n"
      "gap = 1e-8\n",
      "wall", "tip");
  std::string motor = motor_drive("base");
  motor.replace(motor.find("L = 0.0158"), 10, "L = 1e-9  ");
  refused(motor, "drive", "drive.current");
}

TEST(Refusals, MoreChangesThanATickCanHold) {
  // 1e-10 kg between walls 1e-10 m away at 1 m/s: 8500 changes in a tick.
  Plant plant(make_model(ball(1e-10, 1.0, 4e4, 0.0, 1e-10) +
                         "[[contact]]\nname = \"back\"\nbetween = [\"ground\", \"ball\"]\n"
                         "stiffness = 4e4\ngap = 1e-10\n"));
  try {
    for (int k = 0; k < 1000; ++k) plant.step(0, false);
    FAIL() << "expected SimulationError";
  } catch (const SimulationError &error) {
    const std::string text = error.what();
    EXPECT_TRUE(text.rfind("wall ", 0) == 0 || text.rfind("back ", 0) == 0) << text;
    EXPECT_NE(text.find(" keeps switching"), std::string::npos) << text;
    EXPECT_NE(text.find(" at t = "), std::string::npos) << text;
  }
}

// Random chains of bodies with contacts of every kind: at each tick every contact's phase must be
// the one its own deflection and rate ask for, and the energy must balance.
TEST(RandomModels, PhasesAgreeWithTheStateAndEnergyBalances) {
  std::mt19937 random(11);
  const auto within = [&random](double low, double high) {  // logarithmic
    return low * std::pow(high / low, std::uniform_real_distribution<double>(0, 1)(random));
  };
  std::int64_t changes = 0;
  for (int trial = 0; trial < 40; ++trial) {
    const int bodies = 1 + trial % 4;
    struct Link {
      std::string name;
      double stiffness, damping;
    };
    std::vector<Link> contacts;
    std::string text;
    for (int i = 0; i < bodies; ++i)
      text += "[[body]]\nname = \"" + indexed('b', i) + "\"\nmass = " + number(within(0.05, 50)) +
              "\nposition = " + number(-within(1e-5, 1e-3)) +
              "\nvelocity = " + number(within(0.01, 1.0)) + "\n";
    for (int i = 0; i < bodies; ++i) {
      const std::string here = indexed('b', i);
      const std::string next = i + 1 < bodies ? indexed('b', i + 1) : "ground";
      const double damping = i % 3 == 0 ? 0.0 : within(1.0, 300.0);
      contacts.push_back({indexed('c', i), within(1e3, 1e8), damping});
      text += "[[contact]]\nname = \"" + contacts.back().name + "\"\nbetween = [\"" + here +
              "\", \"" + next + "\"]\nstiffness = " + number(contacts.back().stiffness) +
              "\ndamping = " + number(damping) + "\ngap = " + number(within(1e-6, 1e-3)) + "\n";
      text += "[[spring]]\nname = \"" + indexed('s', i) + "\"\nbetween = [\"" + here +
              "\", \"ground\"]\nstiffness = " + number(within(1e2, 1e6)) +
              "\ndamping = " + number(within(0.1, 10.0)) + "\n";
    }
    const auto model = make_model(text);
    Plant plant(model, {true, 1U << 20});
    std::vector<double> values(plant.signal_names().size());
    const auto signal = [&](const std::string &name) {
      for (std::size_t i = 0; i < values.size(); ++i)
        if (plant.signal_names()[i] == name) return values[i];
      ADD_FAILURE() << name;
      return 0.0;
    };
    for (int k = 0; k < 400; ++k) {
      plant.step(0, false);
      plant.signals(values);
      const auto phases = plant.mode();
      for (int i = 0; i < bodies; ++i) {
        const Link &contact = contacts[static_cast<std::size_t>(i)];
        const std::string phase = phases[static_cast<std::size_t>(i)];
        const std::string here = indexed('b', i);
        const double rate = signal(here + ".velocity") -
                            (i + 1 < bodies ? signal(indexed('b', i + 1) + ".velocity") : 0.0);
        const double deflection = signal(contact.name + ".deflection");
        const double force = contact.stiffness * deflection + contact.damping * rate;
        const double slack = 1e-15;
        const double slack_N = slack * contact.stiffness + 1e-13 * contact.damping;
        if (phase == contact.name + ": apart") {
          ASSERT_LE(deflection, slack) << "trial " << trial << " tick " << k << "\n" << text;
        } else {
          ASSERT_GE(deflection, -slack) << "trial " << trial << " tick " << k << "\n" << text;
          if (phase == contact.name + ": pressed")
            ASSERT_GE(force, -slack_N) << "trial " << trial << " tick " << k << "\n" << text;
          else
            ASSERT_LE(force, slack_N) << "trial " << trial << " tick " << k << "\n" << text;
        }
      }
    }
    const EnergyAudit energy = plant.energy();
    EXPECT_LE(std::fabs(energy.residual), 1e-11 * energy.initial) << text;
    changes += plant.crossings();
    // No contact comes back to a phase that it left at the same instant.
    std::map<std::string, std::pair<double, std::set<std::string>>> left;
    for (const Event &event : plant.events()) {
      auto &[time_s, phases_left] = left[event.element];
      if (event.time_s != time_s) phases_left.clear();
      time_s = event.time_s;
      phases_left.insert(event.from);
      ASSERT_EQ(phases_left.count(event.to), 0U) << event.element << " at " << time_s << "\n"
                                                 << text;
    }
  }
  EXPECT_GT(changes, 1000);
}

}  // namespace
}  // namespace forceaxis::sim::test
