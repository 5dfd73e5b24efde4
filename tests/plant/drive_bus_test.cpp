// The bus between firmware and drive: a perfect drive on a free mass against its closed form, a
// port that delays alike, and refusals.
#include <algorithm>
#include <deque>
#include <string>
#include <utility>

#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

constexpr double kVolt = 20.0 / 4096.0;

std::string free_mass(const std::string &bus, double velocity = 0.0) {
  return "[[body]]\nname = \"axis\"\nmass = 2\nvelocity = " + number(velocity) +
         "\n[drive]\ntype = \"perfect\"\nbody = \"axis\"\nforce_per_volt = 5\n" + bus +
         "[encoder]\nbody = \"axis\"\nscale = 1e6\n";
}

std::string bus(int cycle, int out, int in) {
  return "cycle_ticks = " + std::to_string(cycle) + "\ndelay_ticks_out = " + std::to_string(out) +
         "\ndelay_ticks_in = " + std::to_string(in) + "\n";
}

int code_of(int tick) { return (tick * 37) % 101 - 50; }

// The velocity of a free mass is the sum of all forces times the tick. The frame of the tick c is
// applied in the ticks c + delay to c + delay + cycle - 1 of the run.
TEST(DriveBus, FreeMassFeelsTheCodesOfTheFramesOnly) {
  for (const auto &[cycle, delay] : {std::pair{1, 0}, {1, 2}, {3, 0}, {3, 3}, {3, 4}, {6, 11}}) {
    Plant plant(make_model(free_mass(bus(cycle, delay, 0))));
    double velocity = 0.0;
    for (int n = 0; n < 60; ++n) {
      double volts = 0.0;
      for (int sent = 0; sent <= n; sent += cycle)
        if (sent + delay <= n && n < sent + delay + cycle) volts = code_of(sent) * kVolt;
      plant.step(code_of(n), true);
      velocity += 5 * volts / 2 * kTickS;
      ASSERT_NEAR(plant.signal("axis.velocity"), velocity, 1e-12)
          << "cycle " << cycle << ", delay " << delay << ", tick " << n;
    }
  }
}

// A mass with constant velocity: the count of a tick is that of the last measurement which has
// arrived, and that of tick 0 before.
TEST(DriveBus, EncoderIsThatOfTheLastCycleAndLate) {
  for (const auto &[cycle, delay] : {std::pair{1, 0}, {1, 3}, {3, 0}, {3, 2}, {3, 7}, {9, 9}}) {
    Plant plant(make_model(free_mass(bus(cycle, 0, delay), 1.5)));  // 1000 count a tick
    for (int n = 0; n < 60; ++n) {
      int measured = 0;
      for (int start = 0; start + delay <= n; start += cycle) measured = start;
      ASSERT_EQ(plant.codes().encoder, 1000 * measured) << cycle << ", " << delay << ", " << n;
      ASSERT_EQ(plant.codes().encoder, 1000 * measured) << "second reading in a tick";
      plant.step(0, false);
    }
  }
}

// The count also comes if nobody reads the encoder in the tick of its measurement.
TEST(DriveBus, DriveMeasuresWithoutReader) {
  Plant plant(make_model(free_mass(bus(3, 0, 1), 1.5)));
  for (int n = 0; n < 8; ++n) plant.step(0, false);
  EXPECT_EQ(plant.codes().encoder, 6000);
}

TEST(DriveBus, EnableTravelsWithTheCode) {
  Plant plant(make_model(free_mass(bus(3, 2, 0))));
  for (int n = 0; n < 20; ++n) {
    plant.step(100, n >= 4 && n < 10);  // frames of the ticks 6 and 9 are enabled
    EXPECT_EQ(plant.signal("drive.force") != 0.0, n >= 8 && n < 14) << n;
  }
}

// A port that delays and holds gives an immediate plant the same codes and states, bit for bit.
TEST(DriveBus, SameAsAPortThatDelaysAlike) {
  const int cycle = 3, out = 4, in = 2;
  Plant with_bus(make_model(free_mass(bus(cycle, out, in))));
  Plant immediate(make_model(free_mass("")));
  std::deque<DriveBus::Frame> frames(out + 1);
  std::deque<int> counts(in + 1, 0);
  DriveBus::Frame latched;
  int measured = 0, last = 0;
  for (int n = 0; n < 3000; ++n) {
    if (n % cycle == 0) measured = immediate.codes().encoder;
    counts.push_back(measured);
    counts.pop_front();
    const int seen = with_bus.codes().encoder;
    ASSERT_EQ(seen, counts.front()) << n;
    // a law of the firmware: position with damping
    const int code = std::clamp((400 - seen) / 4 - (seen - last) / 2, -2048, 2047);
    last = seen;
    if (n % cycle == 0) latched = {code, n > 5};
    frames.push_back(latched);
    frames.pop_front();
    with_bus.step(code, n > 5);
    immediate.step(frames.front().dac_code, frames.front().amp_enable);
    ASSERT_EQ(hash_state(kHashStart, with_bus), hash_state(kHashStart, immediate)) << n;
  }
}

TEST(DriveBus, RefusesOtherCyclesInOneLine) {
  const auto message = [](const std::string &keys) {
    try {
      load_model(write_model(free_mass(keys)));
    } catch (const InputError &error) {
      return std::string(error.what());
    }
    return std::string();
  };
  const std::string found = message("cycle_ticks = 2\n");
  EXPECT_NE(found.find("drive.cycle_ticks: expected 1, or a multiple of 3"), std::string::npos)
      << found;
  EXPECT_EQ(found.find('\n'), std::string::npos);
  EXPECT_NE(message("cycle_ticks = 0\n"), "");
  EXPECT_NE(message("cycle_ticks = 301\n"), "");
  EXPECT_NE(message("delay_ticks_out = 31\n"), "");
  EXPECT_NE(message("delay_ticks_in = -1\n"), "");
  EXPECT_EQ(message("cycle_ticks = 300\ndelay_ticks_out = 30\ndelay_ticks_in = 30\n"), "");
}

}  // namespace
}  // namespace forceaxis::sim::test
