// Torque, velocity and stepper drives against closed forms.
#include <Eigen/LU>
#include <cmath>
#include <complex>
#include <string>

#include "sim/linear/linear.hpp"
#include "sim/model/elements/all.hpp"
#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

constexpr double kVolt = 20.0 / 4096.0;

std::string body(const std::string &mass) {
  return "[[body]]\nname = \"axis\"\nmass = " + mass + "\n";
}

std::string drive(const std::string &type, const std::string &keys) {
  return "[drive]\ntype = \"" + type + "\"\nbody = \"axis\"\n" + keys;
}

const std::string kLocked = body("1e20");
const std::string kLinear = "k_force = 25\ncurrent_bandwidth = 3000\n";

// i = g u (1 - e^(-w t)), F = k i.
TEST(Torque, LockedLag) {
  Plant plant(make_model(kLocked + drive("torque", kLinear + "current_per_volt = 0.6\n")));
  for (int k = 1; k <= 40; ++k) {
    plant.step(500, true);
    const double i = 0.6 * 500 * kVolt * -std::expm1(-3000 * (k * kTickS));
    ASSERT_NEAR(plant.signal("drive.current") / i, 1.0, 1e-12) << "tick " << k;
    ASSERT_NEAR(plant.signal("drive.force") / (25 * i), 1.0, 1e-12);
    ASSERT_DOUBLE_EQ(plant.signal("drive.target_current"), 0.6 * 500 * kVolt);
  }
  plant.step(500, false);
  EXPECT_EQ(plant.signal("drive.current"), 0.0);
  EXPECT_EQ(plant.signal("drive.target_current"), 0.0);
  EXPECT_EQ(plant.signal("drive.force"), 0.0);
}

// A lead of 10 mm/rev turns 0.9 N m/A into 0.9 2 pi / 0.01 N/A.
TEST(Torque, ScrewLeadAndQuantities) {
  Plant plant(
      make_model(kLocked + drive("torque",
                                 "current_per_volt = \"600 mA/V\"\nk_torque = \"90 cN m/A\"\n"
                                 "r_trans = \"10 mm/rev\"\ncurrent_bandwidth = \"1 kHz\"\n")));
  for (int k = 0; k < 100; ++k) plant.step(-1000, true);
  const double force = -0.6 * 1000 * kVolt * 0.9 * 2 * 3.14159265358979323846 / 0.01;
  EXPECT_NEAR(plant.signal("drive.force") / force, 1.0, 1e-12);
}

// v' = (k g u - d v) / m beside the lag: two real poles p q of w m s^2 + ...
TEST(Torque, DampingActsThroughTheCurrentLoop) {
  Plant plant(make_model(body("4") + drive("torque", kLinear + "current_per_volt = 0.6\n"
                                                               "damping = 800\n")),
              {.audit = true});
  // m s^2 / w + m s + d = 0
  const double m = 4;
  const double w = 3000;
  const double d = 800;
  const double root = std::sqrt(w * w / 4 - w * d / m);
  const double p = w / 2 - root;
  const double q = w / 2 + root;
  const double end = 25 * 0.6 * 300 * kVolt / d;
  for (int k = 1; k <= 200; ++k) {
    plant.step(300, true);
    const double t = k * kTickS;
    const double v = end * (1 - (q * std::exp(-p * t) - p * std::exp(-q * t)) / (q - p));
    ASSERT_NEAR(plant.signal("axis.velocity") / v, 1.0, 1e-11) << "tick " << k;
  }
  const EnergyAudit energy = plant.energy();
  EXPECT_LT(std::fabs(energy.residual), 1e-12 * energy.supplied);
}

TEST(Torque, PeakCurrentLimitsTheTarget) {
  Plant plant(make_model(kLocked + drive("torque", kLinear + "current_per_volt = 2\n"
                                                             "peak_current = 9\n")));
  plant.step(2047, true);
  EXPECT_DOUBLE_EQ(plant.signal("drive.target_current"), 9.0);
  EXPECT_NEAR(plant.signal("drive.current"), 9 * -std::expm1(-3000 * kTickS), 1e-12);
  EXPECT_EQ(plant.mode()[0], "drive.peak: high limit");
  plant.step(-2048, true);
  EXPECT_DOUBLE_EQ(plant.signal("drive.target_current"), -9.0);
}

// The current follows at once: h rises from 2 A as 9 - 7 e^(-t/T) and reaches 4 A at peak_time.
TEST(Torque, PeakLastsForItsTime) {
  const std::string keys =
      "k_force = 25\ncurrent_bandwidth = 1e5\ncurrent_per_volt = 2\npeak_current = 9\n"
      "rated_current = 4\npeak_time = 0.05\n";
  Plant plant(make_model(kLocked + drive("torque", keys)));
  for (int k = 0; k < 90; ++k) plant.step(2047, true);
  const auto of = [&](const std::string &to) {
    for (const Event &event : plant.events())
      if (event.element == "drive.foldback" && event.to == to) return event.time_s;
    return -1.0;
  };
  // The rise of the current takes e^(-1e5 t): the mean lags by the area of 1e-5 s.
  EXPECT_NEAR(of("rated"), 0.05 + 1e-5, 1e-5);
  for (int k = 0; k < 60; ++k) plant.step(2047, true);
  EXPECT_NEAR(plant.signal("drive.current"), 4.0, 1e-12);
  EXPECT_DOUBLE_EQ(plant.signal("drive.target_current"), 4.0);
  EXPECT_GE(plant.signal("drive.mean_current"), 4.0);
  const double mean = plant.signal("drive.mean_current");
  const double start = plant.time_s();
  // Off: h falls from its value to 2 A; the peak is available below 3 A.
  for (int k = 0; k < 600; ++k) plant.step(2047, false);
  const double time = 0.05 / std::log(7.0 / 5.0);
  EXPECT_NEAR(of("peak"), start + time * std::log((mean - 2) / (3 - 2)), 1e-12);
  plant.step(2047, true);
  EXPECT_DOUBLE_EQ(plant.signal("drive.target_current"), 9.0);
}

// Below half of the rated current nothing of the limit moves.
TEST(Torque, SmallCurrentsLeaveTheMeanAlone) {
  Plant plant(
      make_model(kLocked + drive("torque", kLinear + "current_per_volt = 2\npeak_current = 9\n"
                                                     "rated_current = 4\npeak_time = 0.05\n")));
  for (int k = 0; k < 300; ++k) plant.step(k % 2 == 0 ? 150 : -150, true);
  EXPECT_EQ(plant.signal("drive.mean_current"), 2.0);
  EXPECT_EQ(plant.crossings(), 0);
}

// PI and lag on a locked shaft: c = k/K V + k/K V t/T, i lags behind it by 1/w.
TEST(Velocity, LockedRamp) {
  Plant plant(make_model(kLocked + drive("velocity", kLinear + "velocity_per_volt = 0.02\n"
                                                               "k_velocity = 900\n"
                                                               "integral_time = 0.03\n")));
  const double first = 900.0 / 25 * 0.02 * 400 * kVolt;
  for (int k = 1; k <= 100; ++k) {
    plant.step(400, true);
    const double t = k * kTickS;
    const double lag = -std::expm1(-3000 * t);
    const double i = first * lag + first / 0.03 * (t - lag / 3000);
    ASSERT_NEAR(plant.signal("drive.current") / i, 1.0, 1e-12) << "tick " << k;
    ASSERT_NEAR(plant.signal("drive.target_current") / (first + first * t / 0.03), 1.0, 1e-12);
    ASSERT_NEAR(plant.signal("drive.integral") / (first * t / 0.03), 1.0, 1e-12);
  }
  plant.step(400, false);
  EXPECT_EQ(plant.signal("drive.integral"), 0.0);
}

// At the limit the integral goes to the limit with its time: q = 2 - 2 e^(-t/T), and no further.
TEST(Velocity, IntegralDoesNotWindUp) {
  Plant plant(make_model(kLocked + drive("velocity", kLinear + "velocity_per_volt = 0.02\n"
                                                               "k_velocity = 900\n"
                                                               "integral_time = 0.03\n"
                                                               "peak_current = 2\n")));
  for (int k = 1; k <= 300; ++k) {
    plant.step(1000, true);
    const double q = 2 * -std::expm1(-k * kTickS / 0.03);
    ASSERT_NEAR(plant.signal("drive.integral"), q, 1e-12) << "tick " << k;
    ASSERT_DOUBLE_EQ(plant.signal("drive.target_current"), 2.0);
  }
  // The target turns as soon as the command does.
  plant.step(-1000, true);
  EXPECT_LT(plant.signal("drive.target_current"), 0.0);
}

std::complex<double> closed_loop(const Model &model, double w) {
  const std::string inputs[] = {"drive.command"};
  const std::string outputs[] = {"axis.velocity"};
  const Linear plant = linearise(model, {}, inputs, outputs);
  const auto n = plant.A.rows();
  const Eigen::MatrixXcd shifted =
      std::complex<double>(0, w) * Eigen::MatrixXcd::Identity(n, n) - plant.A;
  return (plant.C * shifted.fullPivLu().solve(plant.B.cast<std::complex<double>>()))(0, 0);
}

// On the mass of the tuning the closed loop has -3 dB at the bandwidth, and its slow poles have the
// damping ratio.
TEST(Velocity, BandwidthAndDampingOfTheTunedMass) {
  for (const double ratio : {0.5, 0.7071, 1.2})
    for (const double bandwidth : {100.0, 300.0, 600.0}) {
      const auto model = make_model(
          body("3") + drive("velocity", kLinear + "velocity_per_volt = 0.02\ntuned_mass = 3\n" +
                                            "damping_ratio = " + number(ratio) +
                                            "\nbandwidth = " + number(bandwidth) + "\n"));
      EXPECT_NEAR(std::abs(closed_loop(*model, bandwidth)) / 0.02, std::sqrt(0.5), 1e-9);
      EXPECT_NEAR(std::abs(closed_loop(*model, 1e-3)) / 0.02, 1.0, 1e-6);
      EXPECT_GT(std::abs(closed_loop(*model, 0.5 * bandwidth)) / 0.02, std::sqrt(0.5));
      const auto &found = std::get<VelocityDrive>(model->drive->type);
      // m s^3 / w + m s^2 + k s + k / T, divided by m / w.
      const double w = 3000;
      const double b = found.k_velocity * w / 3;
      const double c = b / *found.integral_time;
      // A pole with the damping ratio z is s = a (-z + j sqrt(1 - z^2)).
      const auto value = [&](double a) {
        const std::complex<double> s =
            a * std::complex<double>(-ratio, std::sqrt(std::max(0.0, 1 - ratio * ratio)));
        return ((s + w) * s + b) * s + c;
      };
      if (ratio >= 1) continue;
      double least = 1e300;
      for (double a = 1; a < w; a *= 1.0001) least = std::min(least, std::abs(value(a)) / c);
      EXPECT_LT(least, 1e-3) << ratio << " at " << bandwidth;
    }
}

TEST(Velocity, InertiaOfTheTuningCountsThroughTheScrew) {
  const auto by = [](const std::string &key) {
    const auto model =
        make_model(body("3") + drive("velocity",
                                     "k_torque = 0.5\nr_trans = 0.002\ncurrent_bandwidth = 4000\n"
                                     "velocity_per_volt = 0.02\nbandwidth = 300\n" +
                                         key));
    return std::get<VelocityDrive>(model->drive->type).k_velocity;
  };
  EXPECT_NEAR(by("tuned_mass = 25\n") / by("tuned_inertia = 1e-4\n"), 1.0, 1e-14);
}

TEST(Velocity, EnergyBalances) {
  Plant plant(
      make_model(body("3") +
                 "[[contact]]\nname = \"wall\"\nbetween = [\"axis\", \"ground\"]\n"
                 "stiffness = 4e5\ndamping = 60\ngap = 0.0005\n" +
                 drive("velocity", kLinear +
                                       "velocity_per_volt = 0.02\ntuned_mass = 3\nbandwidth = 400\n"
                                       "peak_current = 8\nrated_current = 3\npeak_time = 0.02\n")),
      {.audit = true});
  for (int k = 0; k < 900; ++k) plant.step((k * 7919) % 3601 - 1600, true);
  EXPECT_GT(plant.crossings(), 20);
  EXPECT_GT(count_of(plant, "drive.foldback", "peak", "rated"), 0);
  const EnergyAudit energy = plant.energy();
  EXPECT_LT(std::fabs(energy.residual), 1e-11 * (energy.kinetic + energy.dissipated[0].energy));
}

// A stepper whose force repeats after 4 x 25 um and whose field moves 1 mm/s at 1 V.
std::string stepper(const std::string &keys) {
  return drive("stepper",
               "velocity_per_volt = 0.001\nholding_force = 80\nfull_step = 25e-6\n" + keys);
}

// On a locked shaft the field turns through the sine of F = 80 N sin(2 pi w / 100 um). A chord of
// n in a period is at most 1 - cos(pi / n) of the amplitude less. After 8 periods nothing is left.
TEST(Stepper, LockedForceIsTheSineOfTheLoadAngle) {
  for (const int n : {4, 8, 16, 32})
    for (const int code : {150, -150}) {
      Plant plant(make_model(kLocked + stepper("segments = " + std::to_string(n) + "\n")));
      double worst = 0.0;
      for (int k = 1; k <= 2000; ++k) {
        plant.step(code, true);
        const double w = 0.001 * code * kVolt * k * kTickS;
        ASSERT_NEAR(plant.signal("drive.load_angle"), w, 1e-15);
        const double sine = 80 * std::sin(2 * 3.14159265358979323846 * w / 1e-4);
        const double force = plant.signal("drive.force");
        if (std::fabs(w) >= 8e-4) {
          ASSERT_EQ(force, 0.0) << w;
          continue;
        }
        const double less = (std::fabs(sine) - std::fabs(force)) / 80;
        ASSERT_GT(force * sine, -1e-9);
        ASSERT_GT(less, -1e-9);
        worst = std::max(worst, less);
      }
      EXPECT_LE(worst, (1 - std::cos(3.14159265358979323846 / n)) * (1 + 1e-9));
      EXPECT_GT(worst, (1 - std::cos(3.14159265358979323846 / n)) * 0.7);
    }
}

TEST(Stepper, AStalledMotorHasNoForce) {
  Plant plant(make_model(kLocked + stepper("damping = 3000\n")), {.audit = true});
  const double field = 0.001 * 150 * kVolt;  // m/s
  double stalled = 0;
  for (int k = 1; k <= 2000; ++k) {
    plant.step(150, true);
    const double w = field * k * kTickS;
    const double sine = 80 * std::sin(2 * 3.14159265358979323846 * w / 1e-4);
    const double force = plant.signal("drive.force");
    if (w > 8e-4) {
      ASSERT_EQ(force, 0.0) << w;
      stalled += 1;
    } else {
      ASSERT_NEAR(force, sine + 3000 * field, 80 * 0.02 + 1e-9) << w;
    }
  }
  EXPECT_GT(stalled, 300);
  const EnergyAudit energy = plant.energy();
  EXPECT_LT(std::fabs(energy.residual), 1e-9 * energy.dissipated[0].energy);
}

// At rest the motor is a spring of the chord beside 0: w'' = -k w / m - d w' / m after a step of
// the field within one tick.
TEST(Stepper, OscillatesAboutItsStepAsASpring) {
  const auto model = make_model(body("2") + stepper("damping = 40\n"));
  Plant plant(model, {.audit = true});
  const double stiffness = 80 * std::sin(2 * 3.14159265358979323846 / 16) / (1e-4 / 16);
  const double decay = 40.0 / 2 / 2;
  const double rate = std::sqrt(stiffness / 2 - decay * decay);
  plant.step(1500, true);
  double w = plant.signal("drive.load_angle");
  ASSERT_LT(w, 1e-4 / 16);
  double dw = -plant.signal("axis.velocity");
  for (int k = 1; k <= 600; ++k) {
    plant.step(0, true);
    const double t = k * kTickS;
    const double wave = std::exp(-decay * t) *
                        (w * std::cos(rate * t) + (dw + decay * w) / rate * std::sin(rate * t));
    ASSERT_NEAR(plant.signal("drive.load_angle"), wave, 1e-11 * w) << "tick " << k;
  }
  const EnergyAudit energy = plant.energy();
  EXPECT_LT(std::fabs(energy.residual), 1e-11 * energy.supplied);
  const std::string inputs[] = {"axis.force"};
  const std::string outputs[] = {"drive.load_angle"};
  const Linear linear = linearise(*model, {}, inputs, outputs);
  // A force of 1 N at rest moves the body by the compliance before the field.
  const Eigen::VectorXd still = linear.A.fullPivLu().solve(-linear.B);
  EXPECT_NEAR((linear.C * still)(0, 0) * stiffness, -1.0, 1e-9);
}

// A load acts and ends. After a load above the holding force the body comes to rest whole periods
// away from its start; after a smaller load it comes to rest where it started.
TEST(Stepper, AnOverloadLosesWholePeriods) {
  for (const double load : {70.0, 95.0}) {
    Plant plant(make_model(body("2") + stepper("damping = 3000\n") +
                           "[[external]]\nname = \"load\"\nbody = \"axis\"\ntimes = [0, 0.05, "
                           "0.06, 0.061]\nforces = [0, " +
                           number(load) + ", " + number(load) + ", 0]\n"),
                {.audit = true});
    for (int k = 0; k < 900; ++k) plant.step(0, true);
    const double lost = plant.signal("axis.position") / 1e-4;
    EXPECT_NEAR(lost, std::round(lost), 1e-6);
    if (load < 80)
      EXPECT_EQ(std::round(lost), 0.0);
    else
      EXPECT_GE(std::round(lost), 1.0);
    EXPECT_LT(std::round(lost), 8.0);
    const EnergyAudit energy = plant.energy();
    EXPECT_LT(std::fabs(energy.residual), 1e-11 * energy.dissipated[0].energy);
  }
}

// Disabled, it has neither force nor angle; the energy of the angle is discarded.
TEST(Stepper, DisablingSetsTheAngleFree) {
  Plant plant(make_model(kLocked + stepper("segments = 4\n")), {.audit = true});
  for (int k = 0; k < 50; ++k) plant.step(100, true);
  const double w = 0.001 * 100 * kVolt * 50 * kTickS;
  ASSERT_LT(w, 1e-4 / 4);
  plant.step(100, false);
  EXPECT_EQ(plant.signal("drive.force"), 0.0);
  EXPECT_EQ(plant.signal("drive.load_angle"), 0.0);
  const EnergyAudit energy = plant.energy();
  EXPECT_NEAR(energy.discarded / (0.5 * 80 / (1e-4 / 4) * w * w), 1.0, 1e-12);
  EXPECT_LT(std::fabs(energy.residual), 1e-12 * energy.supplied);
  plant.step(100, true);
  EXPECT_NEAR(plant.signal("drive.load_angle"), w / 50, 1e-18);
}

// What is refused, with the key that it names.
TEST(MotorDrive, RefusesKeysThatDoNotBelongTogether) {
  const auto refusal = [](const std::string &type, const std::string &keys) {
    try {
      (void)load_model(write_model(body("3") + drive(type, keys)));
    } catch (const InputError &error) {
      EXPECT_EQ(error.message.rfind("expected ", 0), 0U) << error.what();
      EXPECT_NE(error.message.find("; "), std::string::npos) << error.what();
      return error.key;
    }
    return std::string();
  };
  const std::string torque = "current_per_volt = 1\ncurrent_bandwidth = 3000\n";
  EXPECT_EQ(refusal("torque", torque), "drive.k_force");
  EXPECT_EQ(refusal("torque", torque + "k_force = 1\nk_torque = 1\n"), "drive.k_force");
  EXPECT_EQ(refusal("torque", torque + "k_torque = 1\n"), "drive.r_trans");
  EXPECT_EQ(refusal("torque", torque + "k_force = 1\nr_trans = 1\n"), "drive.r_trans");
  const std::string direct = torque + "k_force = 1\n";
  EXPECT_EQ(refusal("torque", direct + "rated_current = 1\n"), "drive.rated_current");
  EXPECT_EQ(refusal("torque", direct + "peak_time = 1\n"), "drive.peak_time");
  EXPECT_EQ(refusal("torque", direct + "peak_current = 2\nrated_current = 1\n"), "drive.peak_time");
  EXPECT_EQ(refusal("torque", direct + "peak_current = 2\nrated_current = 2\npeak_time = 1\n"),
            "drive.rated_current");
  const std::string step = "velocity_per_volt = 1\nholding_force = 1\nfull_step = 1\n";
  EXPECT_EQ(refusal("stepper", step + "segments = 6\n"), "drive.segments");
  EXPECT_EQ(refusal("stepper", step + "segments = 36\n"), "drive.segments");
  EXPECT_EQ(refusal("stepper", step + "damping = -1\n"), "drive.damping");
  const std::string velocity = kLinear + "velocity_per_volt = 0.1\n";
  EXPECT_EQ(refusal("velocity", velocity), "drive.k_velocity");
  EXPECT_EQ(refusal("velocity", velocity + "k_velocity = 1\nbandwidth = 1\n"), "drive.k_velocity");
  EXPECT_EQ(refusal("velocity", velocity + "k_velocity = 1\ntuned_mass = 1\n"), "drive.tuned_mass");
  EXPECT_EQ(refusal("velocity", velocity + "bandwidth = 100\nintegral_time = 1\n"),
            "drive.integral_time");
  EXPECT_EQ(refusal("velocity", velocity + "bandwidth = 100\n"), "drive.tuned_mass");
  EXPECT_EQ(refusal("velocity", velocity + "bandwidth = 100\ntuned_inertia = 1\n"),
            "drive.r_trans");
  EXPECT_EQ(refusal("velocity", velocity + "bandwidth = 100\ntuned_mass = 1\ndamping_ratio = 3\n"),
            "drive.damping_ratio");
  EXPECT_EQ(refusal("velocity", velocity + "bandwidth = 1e5\ntuned_mass = 1\n"), "drive.bandwidth");
}

}  // namespace
}  // namespace forceaxis::sim::test
