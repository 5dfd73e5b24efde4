// The elements of 2.7, each against a closed form: piecewise-linear springs and dampers, backlash,
// stops, friction, gravity, saturations, filters, noise.
#include <cmath>
#include <numbers>
#include <string>

#include "sim/model/elements/all.hpp"
#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

using std::numbers::pi;

std::string body(const std::string &name, double mass, double position = 0, double velocity = 0) {
  return "[[body]]\nname = \"" + name + "\"\nmass = " + number(mass) +
         "\nposition = " + number(position) + "\nvelocity = " + number(velocity) + "\n";
}

std::string to_ground(const std::string &kind, const std::string &name, const std::string &of,
                      const std::string &keys) {
  return "[[" + kind + "]]\nname = \"" + name + "\"\nbetween = [\"" + of + "\", \"ground\"]\n" +
         keys + "\n";
}

std::string perfect(const std::string &of, const std::string &more = "") {
  return "[drive]\ntype = \"perfect\"\nbody = \"" + of + "\"\nforce_per_volt = 10\n" + more;
}

// 512 codes are 2.5 V, 25 N with the drive above.
constexpr int kCodes25N = 512;

void coast(Plant &plant, int ticks) {
  for (int k = 0; k < ticks; ++k) plant.step(0, false);
}

TEST(Spring, BilinearHalfSwings) {
  // 100 N/m pulling, 400 N/m pushing: half periods pi sqrt(m/k), amplitudes v sqrt(m/k).
  const double v = 0.3;
  Plant plant(make_model(body("m", 1, 0, v) +
                         to_ground("spring", "s", "m", "stiffness = [100, 400]\nbreaks = [0]")),
              {true, 10});
  coast(plant, 1);
  EXPECT_NEAR(plant.state()[0], v / 20 * std::sin(20 * kTickS), 1e-15);
  coast(plant, 599);
  const double t = 0.4 - pi / 20;  // after the swing on the stiff side
  EXPECT_NEAR(plant.state()[0], -v / 10 * std::sin(10 * t), 1e-14);
  EXPECT_NEAR(plant.signal("s.force"), 100 * plant.state()[0], 1e-13);
  EXPECT_NEAR(plant.signal("s.spring_force_rate"), 100 * plant.state()[1], 1e-12);
  const EnergyAudit energy = plant.energy();
  EXPECT_NEAR(energy.stored + energy.kinetic, 0.5 * v * v, 1e-14);
  EXPECT_EQ(count_of(plant, "s", "segment 1", "segment 0"), 1);
}

TEST(Spring, StiffeningStoresWhatItsCurveSays) {
  // 100 N/m to 1 mm, then 1000 to 3 mm, then 50; the same below, with -2 mm and 500.
  Plant plant(make_model(body("m", 1, 4e-3) + to_ground("spring", "s", "m",
                                                        "stiffness = [500, 100, 1000, 50]\n"
                                                        "breaks = [-2e-3, 1e-3, 3e-3]")),
              {true, 10});
  EXPECT_NEAR(plant.signal("s.force"), 0.1 + 2.0 + 0.05, 1e-14);
  EXPECT_NEAR(plant.energy().initial, 0.5e-4 + 2e-4 + 2e-3 + 2.1e-3 + 0.025e-3, 1e-16);
  coast(plant, 6000);
  EXPECT_NEAR(plant.energy().residual, 0.0, 1e-15);
  EXPECT_GT(count_of(plant, "s", "segment 1", "segment 0"), 3);
}

TEST(Spring, LoadsAreBreaksWhereTheForceIsReached) {
  const auto model = make_model(body("m", 1) + to_ground("spring", "s", "m",
                                                         "stiffness = [500, 100, 1000, 50]\n"
                                                         "loads = [-0.2, 0.1, 2.1]"));
  ASSERT_EQ(model->springs[0].stiffness.breaks.size(), 3U);
  EXPECT_DOUBLE_EQ(model->springs[0].stiffness.breaks[0], -2e-3);
  EXPECT_DOUBLE_EQ(model->springs[0].stiffness.breaks[1], 1e-3);
  EXPECT_DOUBLE_EQ(model->springs[0].stiffness.breaks[2], 3e-3);
}

TEST(Damper, TwoSlopesDecayOneAfterTheOther) {
  // m v' = -(b1 v + (b0 - b1) v_b) above the break, -b0 v below.
  const double b0 = 10, b1 = 40, at = 0.1, v0 = 1;
  Plant plant(
      make_model(body("m", 2, 0, v0) +
                 to_ground("damper", "d", "m", "damping = [40, 10, 40]\nbreaks = [-0.1, 0.1]")),
      {true, 10});
  coast(plant, 300);
  const double rest = (b1 - b0) * at / b1;  // what the upper line would tend to
  const double crossing = 2 / b1 * std::log((v0 - rest) / (at - rest));
  EXPECT_NEAR(plant.state()[1], at * std::exp(-b0 / 2 * (0.2 - crossing)), 1e-15);
  ASSERT_EQ(plant.events().size(), 1U);
  EXPECT_NEAR(plant.events()[0].time_s, crossing, 1e-15);
  EXPECT_NEAR(plant.energy().residual, 0.0, 1e-14);
}

TEST(Backlash, CrossesThePlayFreely) {
  // From the middle of 2 mm at 0.1 m/s: 10 ms to a flank, half a period there, 20 ms back.
  const double k = 1e6, v = 0.1;
  Plant plant(make_model(body("m", 1, 0, v) +
                         to_ground("backlash", "gear", "m", "stiffness = 1e6\nwidth = 2e-3")),
              {true, 10});
  coast(plant, 75);
  const auto events = plant.events();
  ASSERT_EQ(events.size(), 4U);
  const double press = pi * std::sqrt(1 / k);
  EXPECT_EQ(events[0].element, "gear.high");
  EXPECT_NEAR(events[0].time_s, 0.01, 1e-15);
  EXPECT_NEAR(events[1].time_s, 0.01 + press, 1e-15);
  EXPECT_EQ(events[2].element, "gear.low");
  EXPECT_NEAR(events[2].time_s, 0.03 + press, 1e-15);
  EXPECT_NEAR(plant.energy().residual, 0.0, 1e-16);
}

TEST(Stop, ReturnsWithTheSpeedItsDampingLeaves) {
  const double m = 2, k = 2e5, b = 200, v = 0.5, low = -0.01;
  Plant plant(
      make_model(body("m", m, 0, -v) +
                 to_ground("stop", "end", "m", "stiffness = 2e5\ndamping = 200\nlow = -0.01")),
      {true, 10});
  coast(plant, 60);
  // The force k d + b d' ends at tan(wd t) = -2 s wd / (s^2 - wd^2), as for a contact.
  const double s = b / (2 * m), wd = std::sqrt(k / m - s * s);
  const double t = (pi - std::atan2(2 * s * wd, wd * wd - s * s)) / wd;
  const double out = v * std::exp(-s * t) * (s / wd * std::sin(wd * t) - std::cos(wd * t));
  EXPECT_NEAR(plant.state()[1], out, 1e-13);
  EXPECT_NEAR(plant.state()[0] - low,
              out * (0.04 - 0.02 - t) + -v * std::exp(-s * t) * std::sin(wd * t) / wd, 1e-14);
  EXPECT_NEAR(plant.energy().residual, 0.0, 1e-14);
}

TEST(Friction, ASlidingBlockComesToRestAndStays) {
  const double v = 0.4, force = 30, m = 4;
  Plant plant(make_model(body("m", m, 0, -v) +
                         to_ground("friction", "guide", "m", "coulomb = 30\nstiction = 50")),
              {true, 10});
  coast(plant, 40);
  EXPECT_EQ(plant.signal("guide.force"), -force);
  coast(plant, 60);
  EXPECT_NEAR(plant.state()[0], -v * v * m / (2 * force), 1e-16);
  EXPECT_EQ(plant.state()[1], 0.0);
  EXPECT_EQ(plant.signal("guide.force"), 0.0);
  ASSERT_EQ(plant.events().size(), 1U);
  EXPECT_EQ(plant.events()[0].to, "stuck");
  EXPECT_NEAR(plant.events()[0].time_s, m * v / force, 1e-15);
  EXPECT_NEAR(plant.energy().dissipated[0].energy, 0.5 * m * v * v, 1e-15);
}

TEST(Friction, BreaksLooseAtItsStiction) {
  Plant plant(
      make_model(body("m", 5) + to_ground("friction", "guide", "m", "coulomb = 10\nstiction = 25") +
                 perfect("m")),
      {true, 10});
  plant.step(kCodes25N, true);  // 25 N: holds
  EXPECT_EQ(plant.state()[1], 0.0);
  EXPECT_EQ(plant.signal("guide.force"), 25.0);
  plant.step(kCodes25N + 1, true);
  EXPECT_EQ(count_of(plant, "guide", "stuck", "forward"), 1);
  const double pull = 25 + 10 * 20.0 / 4096;
  EXPECT_NEAR(plant.state()[1], (pull - 10) / 5 * kTickS, 1e-17);
  for (int k = 0; k < 100; ++k) plant.step(-kCodes25N, true);
  EXPECT_EQ(count_of(plant, "guide", "forward", "stuck"), 1);
  EXPECT_EQ(plant.state()[1], 0.0);  // -25 N: holds again
}

TEST(Friction, WithoutAHoldItTurnsRound) {
  // Slides on under 40 N against 10: through rest at once.
  Plant plant(make_model(body("m", 5, 0, -0.01) +
                         to_ground("friction", "guide", "m", "coulomb = 10") + perfect("m")));
  for (int k = 0; k < 3; ++k) plant.step(2 * kCodes25N, true);
  const double stop = 0.01 * 5 / 60;
  EXPECT_NEAR(plant.state()[1], 40.0 / 5 * (3 * kTickS - stop), 1e-16);
  EXPECT_EQ(count_of(plant, "guide", "backward", "stuck"), 1);
  EXPECT_EQ(count_of(plant, "guide", "stuck", "forward"), 1);
}

TEST(Friction, WhatSticksMovesAsOne) {
  // 25 N on 3 kg that carries 2 kg by friction: 5 m/s^2 together, 10 N through the friction.
  const std::string text = body("lower", 3) + body("upper", 2) +
                           "[[friction]]\nname = \"top\"\nbetween = [\"upper\", \"lower\"]\n"
                           "coulomb = 8\nstiction = 12\n" +
                           to_ground("spring", "none", "lower", "stiffness = 0") + perfect("lower");
  Plant plant(make_model(text), {true, 10});
  for (int k = 0; k < 300; ++k) plant.step(kCodes25N, true);
  EXPECT_NEAR(plant.state()[1], 1.0, 1e-14);
  EXPECT_NEAR(plant.state()[3], 1.0, 1e-14);
  EXPECT_NEAR(plant.signal("top.force"), -10.0, 1e-13);
  EXPECT_NEAR(plant.signal("upper.acceleration"), 5.0, 1e-13);
  // A blow on one of them: it slides, and the other follows with 8 N.
  plant.apply_impulse("upper", 1.0);
  EXPECT_EQ(count_of(plant, "top", "stuck", "forward"), 1);
  plant.step(kCodes25N, true);
  EXPECT_NEAR(plant.signal("lower.acceleration"), (25.0 + 8) / 3, 1e-13);
  EXPECT_NEAR(plant.signal("upper.acceleration"), -4.0, 1e-13);
  for (int k = 0; k < 300; ++k) plant.step(kCodes25N, true);
  EXPECT_EQ(count_of(plant, "top", "forward", "stuck"), 1);
  EXPECT_NEAR(plant.energy().residual, 0.0, 1e-12);
}

TEST(Friction, CoulombTakesFourTimesForceOverStiffnessAPeriod) {
  // x0 = 10 mm, F/k = 1 mm: extremes at -8, 6, -4, 2 mm, and there it holds: 2 > 1 goes on to 0.
  Plant plant(make_model(body("m", 1, 10e-3) + to_ground("spring", "s", "m", "stiffness = 1000") +
                         to_ground("friction", "guide", "m", "coulomb = 1")),
              {true, 20});
  const double half = pi / std::sqrt(1000.0);
  coast(plant, static_cast<int>(6 * half / kTickS));
  EXPECT_NEAR(plant.state()[0], 0.0, 1e-15);
  EXPECT_EQ(plant.state()[1], 0.0);
  EXPECT_EQ(plant.mode()[0], "guide: stuck");
  EXPECT_NEAR(plant.energy().dissipated[0].energy, 0.5 * 1000 * 1e-4, 1e-15);
  const auto events = plant.events();
  for (std::size_t k = 0; k < events.size(); ++k)
    EXPECT_NEAR(events[k].time_s, static_cast<double>(k / 2 + 1) * half, 1e-14) << k;
}

TEST(Gravity, ConstantAndByPosition) {
  Plant falling(make_model(body("m", 3) +
                           "[[gravity]]\nname = \"g\"\nbody = \"m\"\n"
                           "acceleration = -9.81\n" +
                           to_ground("spring", "none", "m", "stiffness = 0")),
                {true, 10});
  coast(falling, 150);
  EXPECT_NEAR(falling.state()[0], -0.5 * 9.81 * 0.01, 1e-15);
  EXPECT_NEAR(falling.signal("g.force"), -29.43, 1e-14);
  EXPECT_NEAR(falling.energy().residual, 0.0, 1e-14);

  // a = -100 x between -10 and 10 mm: a pendulum at 10 rad/s; beyond, 1 m/s^2.
  Plant swing(make_model(body("m", 3, 0.01, 0) +
                         "[[gravity]]\nname = \"g\"\nbody = \"m\"\nacceleration = [1, -1]\n"
                         "positions = [-0.01, 0.01]\n" +
                         to_ground("spring", "none", "m", "stiffness = 0")),
              {true, 10});
  coast(swing, 300);
  EXPECT_NEAR(swing.state()[0], 0.01 * std::cos(2.0), 1e-15);
  swing.apply_impulse("m", 3 * 10);
  coast(swing, 60);
  EXPECT_EQ(swing.signal("g.force"), -3.0);
  EXPECT_NEAR(swing.energy().residual, 0.0, 1e-11);
}

TEST(Drive, ForceLimits) {
  Plant plant(make_model(body("m", 5) + perfect("m", "force_limit = 20\n")));
  plant.step(kCodes25N, true);
  EXPECT_DOUBLE_EQ(plant.state()[1], 20.0 / 5 * kTickS);
  EXPECT_EQ(plant.signal("drive.force"), 20.0);
  plant.step(kCodes25N, false);
  EXPECT_EQ(plant.signal("drive.force"), 0.0);

  // F' = a (k v_cmd - F), stalled: saturates when k v_cmd (1 - e^{-a t}) reaches the limit.
  Plant stalled(make_model(body("m", 1e9) +
                           "[drive]\ntype = \"first_order\"\nbody = \"m\"\nk_act = 100\n"
                           "a_act = 50\nvelocity_per_volt = 0.2\nforce_limit = 20\n"));
  for (int k = 0; k < 60; ++k) stalled.step(kCodes25N, true);
  ASSERT_EQ(stalled.crossings(), 1);
  EXPECT_NEAR(stalled.events()[0].time_s, std::log(50.0 / 30) / 50, 1e-9);
  EXPECT_EQ(stalled.signal("drive.force"), 20.0);
}

std::string gauge(const std::string &adc) {
  // 1000 N/m held 1 mm out by an immovable body: 1 N; the encoder sees two bodies.
  return body("m", 1e12, 1e-3) + body("base", 1e12, 4e-4) +
         to_ground("spring", "s", "m", "stiffness = 1000") +
         to_ground("spring", "mount", "base", "stiffness = 1") +
         "[encoder]\nbody = \"m\"\nreference = \"base\"\nscale = 1e4\n"
         "[[adc]]\nchannel = 0\nsignal = \"s.spring_force\"\nper_count = 0.01\nbits = 12\n"
         "zero_code = 2048\n" +
         adc;
}

TEST(Sensor, EncoderCountsAgainstItsReference) {
  Plant plant(make_model(gauge("")));
  EXPECT_EQ(plant.codes().encoder, 6);
  EXPECT_EQ(plant.codes().adc[0], 2148);
}

TEST(Sensor, LimitsWithoutAFilterActAtTheConversion) {
  EXPECT_EQ(Plant(make_model(gauge("sensor_limit = 0.5\n"))).codes().adc[0], 2098);
  EXPECT_EQ(
      Plant(make_model(gauge("sensor_limit = 0.5\nconditioning_limit = 0.3\n"))).codes().adc[0],
      2078);
}

TEST(Sensor, FilterFollowsWhatTheSensorLets) {
  Plant plant(make_model(gauge("filter = 30\nsensor_limit = 0.6\nconditioning_limit = 0.5\n")));
  EXPECT_EQ(plant.codes().adc[0], 2048);
  const auto expected = [](int tick) {
    const double y = 0.6 * (1 - std::exp(-30 * tick * kTickS));
    return 2048 + static_cast<int>(std::floor(std::min(y, 0.5) * 100 + 0.5));
  };
  for (int k = 1; k < 200; ++k) {
    plant.step(0, false);
    EXPECT_EQ(plant.codes().adc[0], expected(k)) << k;
  }
}

TEST(Sensor, AFilterThatNoTickCanTellFromNoneIsRefused) {
  EXPECT_NO_THROW(Plant(make_model(gauge("filter = 1e6\n"))).step(0, false));
  EXPECT_THROW(make_model(gauge("filter = 1.1e6\n")), InputError);
}

TEST(Sensor, NoiseHasItsVarianceAndIsOfSeedAndTickAlone) {
  const auto model = make_model(gauge("noise = 0.05\n"));
  Plant plant(model, {false, 10, 7});
  Plant again(model, {false, 10, 7});
  Plant other(model, {false, 10, 8});
  double sum = 0, squares = 0, product = 0, lag = 0, last = 0;
  const int n = 20000;
  for (int k = 0; k < n; ++k) {
    const double a = plant.codes().adc[0] - 2148;
    EXPECT_EQ(plant.codes().adc[0], a + 2148);
    ASSERT_EQ(again.codes().adc[0], a + 2148);
    sum += a;
    squares += a * a;
    product += a * (other.codes().adc[0] - 2148);
    lag += a * last;
    last = a;
    plant.step(0, false);
    again.step(0, false);
    other.step(0, false);
  }
  // 5 counts rms and 1/12 of rounding; four standard errors.
  const double variance = 25 + 1.0 / 12;
  const double error = variance / std::sqrt(n);
  EXPECT_NEAR(sum / n, 0, 4 * std::sqrt(variance / n));
  EXPECT_NEAR(squares / n, variance, 4 * std::sqrt(2.0) * error);
  EXPECT_NEAR(product / n, 0, 4 * error);
  EXPECT_NEAR(lag / n, 0, 4 * error);
}

TEST(Sensor, DacNoiseMovesThePlant) {
  const auto text = body("m", 1) + perfect("m") + "[dac]\nnoise = 0.1\n";
  Plant plant(make_model(text));
  double squares = 0, last = 0;
  for (int k = 0; k < 20000; ++k) {
    plant.step(0, true);
    const double force = (plant.state()[1] - last) / kTickS;
    last = plant.state()[1];
    squares += force * force;
  }
  EXPECT_NEAR(squares / 20000, 1.0, 4 * std::sqrt(2.0 / 20000));
}

TEST(Sensor, VelocityOfAForceSensorIsTheRateOfItsForce) {
  Plant plant(make_model(body("m", 2, -1e-3, 0.2) +
                         to_ground("contact", "wall", "m", "stiffness = 1e4\ndamping = 3") +
                         "[[adc]]\nchannel = 1\nsignal = \"wall.spring_force_rate\"\n"
                         "per_count = 20\nbits = 10\nzero_code = 512\n"));
  EXPECT_EQ(plant.signal("wall.spring_force_rate"), 0.0);  // not touched yet
  EXPECT_EQ(plant.codes().adc[1], 512);
  coast(plant, 20);
  EXPECT_DOUBLE_EQ(plant.signal("wall.spring_force_rate"), 1e4 * plant.state()[1]);
  EXPECT_EQ(plant.codes().adc[1],
            512 + static_cast<int>(std::floor(1e4 * plant.state()[1] / 20 + 0.5)));
}

TEST(Network, TooManySwitchesAreRefused) {
  std::string text = body("m", 1);
  for (int i = 0; i < 33; ++i)
    text += to_ground("contact", indexed('c', i), "m", "stiffness = 1\ndamping = 1");
  const auto model = make_model(text);
  EXPECT_THROW(Plant plant(model), InputError);
}

}  // namespace
}  // namespace forceaxis::sim::test
