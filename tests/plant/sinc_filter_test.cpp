// The filter of a sigma-delta converter, against the truncated powers of its B-spline and its
// published response; creep and drift of a sensor against closed forms.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "sim/model/elements/all.hpp"
#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

constexpr int kZero = 1 << 23;  // zero code of 24 bits

std::string filtered(int order, double rate_hz, double phase_s, double latency_s) {
  std::string keys = "sample_rate = " + number(rate_hz) + "\nsample_phase = " + number(phase_s) +
                     "\nlatency = " + number(latency_s) + "\n";
  if (order > 0) keys += "converter_filter = \"sinc" + std::to_string(order) + "\"\n";
  return keys;
}

std::string adc(const std::string &signal, double per_count, const std::string &keys) {
  return "[[adc]]\nchannel = 0\nsignal = \"" + signal + "\"\nper_count = " + number(per_count) +
         "\nbits = 24\nzero_code = " + std::to_string(kZero) + "\n" + keys;
}

// The command of a drive, a signal that steps at the ticks: 10 V are 2^23 codes.
const double kVoltPerCode = 10.0 / kZero;

std::string stepped(const std::string &keys) {
  return "[[body]]\nname = \"m\"\nmass = 2\n[[damper]]\nname = \"d\"\nbetween = [\"m\", "
         "\"ground\"]\ndamping = 30\n[drive]\ntype = \"perfect\"\nbody = "
         "\"m\"\nforce_per_volt = 40\n" +
         adc("drive.command", kVoltPerCode, keys);
}

// An undamped mass on a spring that moves as amplitude * cos(w t), w in rad/s.
std::string vibrating(double w, double amplitude, double per_count, const std::string &keys) {
  return "[[body]]\nname = \"m\"\nmass = 2\nposition = " + number(amplitude) +
         "\n[[spring]]\nname = \"s\"\nbetween = [\"m\", \"ground\"]\nstiffness = " +
         number(2 * w * w) + "\n" + adc("m.position", per_count, keys);
}

double choose(int n, int k) {
  double value = 1.0;
  for (int i = 1; i <= k; ++i) value = value * (n - k + i) / i;
  return value;
}

// Integral up to x of the B-spline of an order, by truncated powers.
double spline_integral(int order, double x) {
  if (x >= order) return 1.0;
  double sum = 0.0;
  double factorial = 1.0;
  for (int i = 1; i <= order; ++i) factorial *= i;
  for (int i = 0; i <= order && i < x; ++i)
    sum += (i % 2 == 0 ? 1.0 : -1.0) * choose(order, i) * std::pow(x - i, order);
  return sum / factorial;
}

// The B-spline itself.
double spline(int order, double x) {
  double sum = 0.0;
  double factorial = 1.0;
  for (int i = 1; i < order; ++i) factorial *= i;
  for (int i = 0; i <= order && i < x; ++i)
    sum += (i % 2 == 0 ? 1.0 : -1.0) * choose(order, i) * std::pow(x - i, order - 1);
  return x >= order ? 0.0 : sum / factorial;
}

// Whether a code of 16 bits is that of a value, or the value is at an edge between two codes.
testing::AssertionResult is_code_of(int code, double value, double per_count) {
  const double y = value / per_count + 0.5 + kZero;
  const double expected = std::floor(y / 256);
  const double past = y / 256 - expected;
  const bool at_edge = std::min(past, 1 - past) < 1e-5 && std::fabs(code - y / 256) < 1.1;
  if (code == expected || at_edge) return testing::AssertionSuccess();
  return testing::AssertionFailure() << "code " << code << ", expected " << y / 256;
}

// Random rates, phases, latencies and filters under a command that changes at random in each tick.
// A filter whose error were 1e-3 codes of 16 bits, 1.5e-8 of the range, would give some of the
// 25,000 codes wrong.
TEST(SincFilter, SamplesAreTheSplineOverACommandThatStepsAtRandom) {
  std::mt19937 random(3);
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int model = 0; model < 50; ++model) {
    const int order = std::vector<int>{0, 3, 4, 5}[static_cast<std::size_t>(model) % 4];
    const double rate_hz = 50.0 * std::pow(600.0, between(0, 1));
    const double phase_s = between(0, 1) < 0.2 ? 0.0 : between(0, 0.999) / rate_hz;
    const double latency_s = between(0, 1) < 0.2 ? 0.0 : between(0, 0.02);
    Plant plant(make_model(stepped(filtered(order, rate_hz, phase_s, latency_s))));
    std::vector<double> volts;  // of each tick
    const auto at = [&](double ticks) {
      return ticks <= 1e-9 ? 0.0 : volts[static_cast<std::size_t>(std::ceil(ticks - 1e-9)) - 1];
    };
    for (int n = 0; n < 500; ++n) {
      double expected = 0.0;  // the command before tick 0
      const double newest = std::floor((n * kTickS - latency_s - phase_s) * rate_hz + 1e-9);
      const double sampled = (phase_s + newest / rate_hz) / kTickS;  // in ticks
      if (newest >= 0 && order == 0) expected = at(sampled);
      if (newest >= 0 && order > 0)
        for (int tick = 0; tick < sampled; ++tick) {
          const auto age = [&](double ticks) {
            return std::max(0.0, (sampled - ticks) * kTickS * rate_hz);
          };
          expected += volts[static_cast<std::size_t>(tick)] *
                      (spline_integral(order, age(tick)) - spline_integral(order, age(tick + 1)));
        }
      ASSERT_TRUE(is_code_of(plant.codes().adc[0], expected, kVoltPerCode))
          << "model " << model << ", tick " << n << ", sinc" << order << ", " << rate_hz
          << " Hz, phase " << phase_s << ", latency " << latency_s;
      const int code = std::uniform_int_distribution<int>(-2000, 2000)(random);
      volts.push_back(code * (20.0 / 4096.0));
      plant.step(code, true);
    }
  }
}

// A step directly after a sample: N - 1 samples in between, and the final value from sample N on.
TEST(SincFilter, AStepSettlesInNSamples) {
  for (const int order : {3, 4, 5}) {
    Plant plant(make_model(stepped(filtered(order, 500, 0, 0))));
    for (int n = 0; n < 60; ++n) {
      const int sample = n < 15 ? 0 : (n - 15) / 3;  // the newest one, since the step
      const int code = plant.codes().adc[0] - kZero / 256;
      // The final value has 16000 codes, and of 24 bits half a code more than it needs for them.
      const double share = spline_integral(order, sample);
      ASSERT_NEAR(code, 16000 * share, 1.0) << order << ", " << n;
      ASSERT_EQ(code == 16000, sample >= order) << order << ", " << n;
      ASSERT_EQ(code == 0, sample == 0) << order << ", " << n;
      plant.step(n < 15 ? 0 : 1000, true);
    }
  }
}

// A vibration keeps |sin(pi f T) / (pi f T)|^N of its amplitude and is late by N T / 2, from the
// sample on whose N periods begin after tick 0.
TEST(SincFilter, AVibrationHasThePublishedMagnitudeAndDelay) {
  for (const int order : {3, 4, 5})
    for (const double share : {0.03, 0.2, 0.5, 0.9, 1.0, 1.4, 2.6}) {
      const double rate_hz = 400;
      const double w = 2 * std::numbers::pi * share * rate_hz;
      const double size = std::sin(w / rate_hz / 2) / (w / rate_hz / 2);
      const double amplitude = 1e-3;
      const double magnitude = std::pow(size, order) * amplitude;
      const double per_count = 1.2 * amplitude / kZero;
      Plant plant(make_model(vibrating(w, amplitude, per_count, filtered(order, rate_hz, 0, 0))));
      for (int n = 0; n < 150; ++n) {
        const double sampled_s = std::floor(n * kTickS * rate_hz + 1e-9) / rate_hz;
        const int code = plant.codes().adc[0];
        if (sampled_s * rate_hz > order - 0.5) {
          const double expected = magnitude * std::cos(w * (sampled_s - order / rate_hz / 2));
          ASSERT_TRUE(is_code_of(code, expected, per_count))
              << order << ", " << share << ", tick " << n;
        }
        plant.step(0, false);
      }
    }
}

// Sensor and electronics limit a vibration before the filter: a dense sum over the limited signal.
TEST(SincFilter, LimitsActBeforeTheFilter) {
  const double w = 2 * std::numbers::pi * 170;
  const double amplitude = 1e-3;
  const double per_count = amplitude / kZero;
  const std::string limits[] = {"sensor_limit = 6e-4\n", "conditioning_limit = 6e-4\n",
                                "sensor_limit = 8e-4\nconditioning_limit = 6e-4\n"};
  for (const std::string &limit : limits) {
    Plant plant(
        make_model(vibrating(w, amplitude, per_count, limit + filtered(3, 1000, 0.0002, 0))));
    for (int n = 0; n < 60; ++n) {
      const double newest = std::floor((n * kTickS - 0.0002) * 1000 + 1e-9);
      const double sampled_s = 0.0002 + newest / 1000;
      const int code = plant.codes().adc[0];
      if (newest >= 3) {
        double sum = 0.0;
        constexpr int kParts = 20000;
        for (int k = 0; k < kParts; ++k) {
          const double age = 3 * (k + 0.5) / kParts;
          const double x = amplitude * std::cos(w * (sampled_s - age / 1000));
          sum += spline(3, age) * std::clamp(x, -6e-4, 6e-4) * 3 / kParts;
        }
        const double y = (sum / per_count + 0.5 + kZero) / 256;
        ASSERT_NEAR(code + 0.5, y, 0.5 + 1e-3) << limit << n;
      }
      plant.step(0, false);
    }
    EXPECT_GT(count_of(plant, limit[0] == 's' ? "adc0.sensor" : "adc0.conditioning", "linear",
                       "high limit"),
              3)
        << limit;
  }
}

// The noise is that of the sample and is added after the filter: a constant signal has the rms.
TEST(SincFilter, NoiseIsAddedAfterTheFilter) {
  const std::string keys = "noise = 0.01\n" + filtered(3, 1500, 0, 0);
  Plant plant(make_model(stepped(keys)));
  double square = 0.0;
  constexpr int kTicks = 6000;
  for (int n = 0; n < kTicks; ++n) {
    const double volts = (plant.codes().adc[0] + 0.5 - kZero / 256) * 256 * kVoltPerCode;
    square += volts * volts;
    plant.step(0, true);
  }
  EXPECT_NEAR(std::sqrt(square / kTicks), 0.01, 0.0005);
}

// A ball that bounces: the same motion and events with the filter, and the energy is balanced.
TEST(SincFilter, DoesNotChangeThePlant) {
  const std::string ball =
      "[[body]]\nname = \"b\"\nmass = 0.5\nposition = -0.001\nvelocity = 0.4\n[[contact]]\nname = "
      "\"c\"\nbetween = [\"b\", \"ground\"]\nstiffness = 1e6\ndamping = 20\n[[gravity]]\nname = "
      "\"g\"\nbody = \"b\"\nacceleration = 9.81\n" +
      adc("c.force", 1e-3, "");
  PlantOptions options;
  options.audit = true;
  Plant plain(make_model(ball), options);
  Plant sampled(make_model(ball + "creep = 5e-4\ncreep_time = 600\ndrift = 2\ndrift_time = 300\n" +
                           filtered(5, 7500, 0.00003, 0.001)),
                options);
  for (int n = 0; n < 1500; ++n) {
    plain.step(0, false);
    sampled.step(0, false);
    ASSERT_NEAR(plain.state()[0], sampled.state()[0], 1e-12) << n;
    ASSERT_NEAR(plain.state()[1], sampled.state()[1], 1e-9) << n;
  }
  ASSERT_EQ(plain.events().size(), sampled.events().size());
  EXPECT_GT(plain.events().size(), 10U);
  for (std::size_t i = 0; i < plain.events().size(); ++i)
    EXPECT_NEAR(plain.events()[i].time_s, sampled.events()[i].time_s, 1e-11);
  const EnergyAudit energy = sampled.energy();
  EXPECT_LT(std::fabs(energy.residual), 1e-9 * energy.initial);
}

// Both channels have filters of their own, and a plant with more steps in a tick has the samples of
// one with one step in a tick.
TEST(SincFilter, ChannelsAndPartsOfATickAreIndependent) {
  const double w = 2 * std::numbers::pi * 130;
  const double per_count = 1.2e-3 / kZero;
  std::string text = vibrating(w, 1e-3, per_count, filtered(3, 1234, 0.0001, 0.0005));
  std::string second = adc("m.position", per_count, filtered(4, 700, 0.0007, 0));
  second.replace(second.find("channel = 0"), 11, "channel = 1");
  text += second;
  const auto model = make_model(text);
  Plant one(model);
  Plant parts(std::make_shared<ModeCache>(model, 7));
  Plant copy = one;
  for (int n = 0; n < 300; ++n) {
    for (const int channel : {0, 1}) {
      ASSERT_NEAR(one.codes().adc[channel], parts.codes().adc[channel], 1) << n;
      ASSERT_EQ(one.codes().adc[channel], copy.codes().adc[channel]) << n;
    }
    one.step(0, false);
    copy.step(0, false);
    for (int part = 0; part < 7; ++part) parts.step(0, false);
  }
}

// Under a load that steps at tick 0 and a load that rises: the closed forms of creep and drift.
TEST(SlowErrors, CreepAndDriftHaveTheirClosedForms) {
  const double creep = 0.02;
  const double creep_s = 0.3;
  const double drift_s = 0.2;
  const std::string keys = "creep = 0.02\ncreep_time = 0.3\ndrift = {}\ndrift_time = 0.2\n";
  const auto with = [&](const std::string &drift) {
    std::string text = keys;
    return text.replace(text.find("{}"), 2, drift);
  };
  Plant load(make_model(stepped(with("-0.5"))));
  const double per_count = 1e-6;
  Plant rising(make_model(
      "[[body]]\nname = \"m\"\nmass = 2\nvelocity = 1\n[[damper]]\nname = \"d\"\nbetween = [\"m\", "
      "\"ground\"]\ndamping = 0\n" +
      adc("m.position", per_count, with("0.1"))));
  for (int n = 0; n < 1500; ++n) {
    const double t = n * kTickS;
    const double crept = 1 - std::exp(-t / creep_s);
    const double drifted = 1 - std::exp(-t / drift_s);
    const double volts = n == 0 ? 0.0 : 5.0;
    ASSERT_TRUE(
        is_code_of(load.codes().adc[0], volts * (1 + creep * crept) - 0.5 * drifted, kVoltPerCode))
        << n;
    ASSERT_TRUE(is_code_of(rising.codes().adc[0], t + creep * (t - creep_s * crept) + 0.1 * drifted,
                           per_count))
        << n;
    load.step(1024, true);
    rising.step(0, false);
  }
}

// A phase or a latency below 1 ns is 0.
TEST(SincFilter, TimesBelow1nsCountAs0) {
  for (const char *tiny : {"1e-30", "1e-12", "9e-10"}) {
    const std::string keys = std::string("sample_phase = ") + tiny + "\nlatency = " + tiny + "\n";
    const auto plain = make_model(stepped(""));
    const auto immediate = make_model(stepped(keys));
    EXPECT_FALSE(immediate->adc[0]->sampling) << tiny;
    const auto sampled = make_model(stepped("sample_rate = 700\n" + keys));
    EXPECT_EQ(sampled->adc[0]->sampling->phase_s, 0.0) << tiny;
    EXPECT_TRUE(sampled->adc[0]->sampling->phase_known) << tiny;
    EXPECT_EQ(sampled->adc[0]->sampling->latency_s, 0.0) << tiny;
  }
  EXPECT_EQ(make_model(stepped("latency = 1e-9\n"))->adc[0]->sampling->latency_s, 1e-9);
}

}  // namespace
}  // namespace forceaxis::sim::test
