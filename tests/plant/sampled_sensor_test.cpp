// A converter with a clock of its own: samples at its own instants, latency, age, noise, longer
// codes, and refusals.
#include <cmath>
#include <string>
#include <utility>

#include "sim/model/elements/all.hpp"
#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

// A free mass of 2 kg at a constant velocity of 1 m/s, or with a constant force on it. One code is
// 1 um.
std::string mass(const std::string &adc, const std::string &drive = "") {
  return "[[body]]\nname = \"m\"\nmass = 2\nvelocity = 1\n[[damper]]\nname = \"d\"\nbetween = "
         "[\"m\", \"ground\"]\ndamping = 0\n" +
         drive + "[[adc]]\nchannel = 0\nsignal = \"m.position\"\nper_count = 1e-6\nbits = 24\n" +
         adc;
}

std::string sampling(double rate_hz, double phase_s, double latency_s) {
  return "sample_rate = " + number(rate_hz) + "\nsample_phase = " + number(phase_s) +
         "\nlatency = " + number(latency_s) + "\n";
}

// Time of the newest sample that is at least `latency_s` old at `now_s`; 0 if there is none. The
// tolerance stands for exact arithmetic: none of the tested times lies so close to another one.
double newest_s(double now_s, double rate_hz, double phase_s, double latency_s) {
  double found = 0.0;
  for (int k = 0; phase_s + k / rate_hz + latency_s <= now_s + 1e-9; ++k)
    found = phase_s + k / rate_hz;
  return found;
}

// The position is that of the sample, between the ticks too, and the age is that of the sample in
// ticks, rounded up.
TEST(SampledSensor, GivesTheNewestSampleThatHasArrived) {
  const double cases[][3] = {{1000, 0, 0},       {1000, 0, 0.002},   {1000, 0.0003, 0.002},
                             {1500, 0, 0.002},   {1500, 0, 0.0025},  {500, 0.001, 0},
                             {80, 0.004, 0.05},  {4800, 0, 0.00063}, {7500, 0.0001, 0},
                             {1234.5, 0, 0.001}, {1500, 0.0005, 0}};
  for (const auto &[rate_hz, phase_s, latency_s] : cases) {
    Plant plant(make_model(mass(sampling(rate_hz, phase_s, latency_s))));
    for (int n = 0; n < 300; ++n) {
      const double sampled_s = newest_s(n * kTickS, rate_hz, phase_s, latency_s);
      const SensorCodes codes = plant.codes();
      const int age = static_cast<int>(std::ceil((n * kTickS - sampled_s) / kTickS - 1e-6));
      // The code of 24 bits is in um; the firmware has its upper 16 bits.
      ASSERT_EQ(codes.adc[0], static_cast<int>(std::floor((sampled_s * 1e6 + 0.5) / 256)))
          << rate_hz << " Hz, phase " << phase_s << ", latency " << latency_s << ", tick " << n;
      ASSERT_EQ(codes.force_age, age)
          << rate_hz << ", " << phase_s << ", " << latency_s << ", " << n;
      ASSERT_EQ(plant.codes().adc[0], codes.adc[0]) << "second reading in a tick";
      plant.step(0, false);
    }
  }
}

// A sample that is taken a moment after a tick, here 0.07 us, is not yet there at this tick, also
// at low rates: the firmware has the signal of tick 0 or the sample before.
TEST(SampledSensor, GivesNoSampleBeforeItsInstant) {
  for (const double rate_hz : {1.0, 2.0}) {
    const double phase_s = (600 + 1e-4) * kTickS;
    Plant plant(make_model(mass(sampling(rate_hz, phase_s, 0) + "zero_code = 8388608\n")));
    for (int n = 0; n < 3000; ++n) {
      const double since_s = n * kTickS - phase_s;
      const double sampled_s = since_s < 0 ? 0 : phase_s + std::floor(since_s * rate_hz) / rate_hz;
      const int code = static_cast<int>(std::floor((sampled_s * 1e6 + 0.5) / 256)) + 32768;
      ASSERT_EQ(plant.codes().adc[0], code) << rate_hz << ", " << n;
      plant.step(0, false);
    }
  }
}

// A sample between two ticks is exact also when the force steps at each tick: x is the closed form
// of a mass with a constant force in each tick.
TEST(SampledSensor, IsExactBetweenTwoTicksUnderAChangingForce) {
  const std::string drive = "[drive]\ntype = \"perfect\"\nbody = \"m\"\nforce_per_volt = 400\n";
  Plant plant(make_model(mass(sampling(1000, 0.0002, 0) + "zero_code = 8388608\n", drive)));
  double x = 0.0, v = 1.0, a = 0.0, sampled = 0.0;
  int next = 0;
  for (int n = 0; n < 600; ++n) {
    const auto sample = [&](double after_s) { return x + v * after_s + a * after_s * after_s / 2; };
    const int code = plant.codes().adc[0];
    ASSERT_EQ(code, static_cast<int>(std::floor((sampled * 1e6 + 0.5) / 256)) + 32768) << n;
    const int dac = n % 7 < 3 ? 900 : -850;
    plant.step(dac, true);
    a = 400 * dac * (20.0 / 4096.0) / 2;
    for (; 0.0002 + next / 1000.0 < (n + 1) * kTickS + 1e-9; ++next)
      sampled = sample(0.0002 + next / 1000.0 - n * kTickS);
    x = sample(kTickS);
    v += a * kTickS;
  }
}

// Events between samples stay exact: a ball on a spring contact bounces with and without a sampling
// sensor to the same states within rounding, at the same instants.
TEST(SampledSensor, DoesNotChangeThePlant) {
  const std::string ball =
      "[[body]]\nname = \"b\"\nmass = 0.5\nposition = -0.001\nvelocity = 0.4\n[[contact]]\nname = "
      "\"c\"\nbetween = [\"b\", \"ground\"]\nstiffness = 1e6\ndamping = 20\n[[gravity]]\nname = "
      "\"g\"\nbody = \"b\"\nacceleration = 9.81\n[[adc]]\nchannel = 0\nsignal = "
      "\"c.force\"\nper_count = 0.1\nbits = 16\n";
  PlantOptions options;
  options.audit = true;
  Plant plain(make_model(ball), options);
  Plant sampled(make_model(ball + sampling(7500, 0.00003, 0.001)), options);
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

// Rate of the ticks, no latency: the codes of an immediate converter, noise included.
TEST(SampledSensor, AtEachTickIsAnImmediateConverter) {
  const std::string drive = "[drive]\ntype = \"perfect\"\nbody = \"m\"\nforce_per_volt = 400\n";
  Plant plain(make_model(mass("noise = 1e-5\n", drive)));
  Plant sampled(make_model(mass("noise = 1e-5\nsample_rate = 1500\n", drive)));
  for (int n = 0; n < 300; ++n) {
    ASSERT_EQ(plain.codes().adc[0], sampled.codes().adc[0]) << n;
    ASSERT_EQ(sampled.codes().force_age, 0);
    plain.step(n, true);
    sampled.step(n, true);
  }
}

// The upper 16 bits of the code of a longer converter; both directions about the zero code.
TEST(SampledSensor, LongCodesGiveTheirUpper16Bits) {
  const auto code = [](double position, int bits, double zero) {
    Plant plant(
        make_model("[[body]]\nname = \"m\"\nmass = 1\nposition = " + number(position) +
                   "\n[[damper]]\nname = \"d\"\nbetween = [\"m\", \"ground\"]\ndamping = 1\n"
                   "[[adc]]\nchannel = 0\nsignal = \"m.position\"\nper_count = 1\nbits = " +
                   std::to_string(bits) + "\nzero_code = " + number(zero) + "\n"));
    return int{plant.codes().adc[0]};
  };
  for (const int bits : {17, 20, 24}) {
    const int lost = bits - 16;
    const int top = (1 << bits) - 1;
    for (const int zero : {0, 1 << (bits - 1), 12345})
      for (const int value : {-70000, -300, -1, 0, 1, 255, 256, 12800, 99999}) {
        const int whole = std::min(std::max(value + zero, 0), top);
        EXPECT_EQ(code(value + 0.25, bits, zero), whole >> lost)
            << bits << ", " << zero << ", " << value;
      }
  }
}

TEST(SampledSensor, RefusesInOneLine) {
  const auto message = [](const std::string &keys) {
    try {
      load_model(write_model(mass(keys)));
    } catch (const InputError &error) {
      return std::string(error.what());
    }
    return std::string();
  };
  const std::string late = message("sample_rate = 1000\nsample_phase = \"1 ms\"\n");
  EXPECT_NE(late.find("adc[0].sample_phase: expected a time below one period"), std::string::npos)
      << late;
  EXPECT_EQ(late.find('\n'), std::string::npos);
  EXPECT_NE(message("sample_rate = 0.5\n"), "");
  EXPECT_NE(message("sample_rate = \"31 kHz\"\n"), "");
  EXPECT_NE(message("latency = 0.2\n"), "");
  EXPECT_NE(message("latency = -0.001\n"), "");
  EXPECT_EQ(message("sample_rate = \"1 kHz\"\nlatency = \"2 ms\"\n"), "");
}

}  // namespace
}  // namespace forceaxis::sim::test
