// The bus between firmware and drive: a perfect drive on a free mass against its closed form, a
// port that delays alike, and refusals.
#include <algorithm>
#include <deque>
#include <string>
#include <utility>

#include "sim/model/elements/all.hpp"
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
  EXPECT_NE(message("enable_ticks = -1\n").find("drive.enable_ticks: expected an integer 0..65535"),
            std::string::npos);
  EXPECT_NE(message("enable_ticks = 65536\n"), "");
  EXPECT_NE(message("enable_ticks = 1.5\n"), "");
  EXPECT_EQ(message("enable_ticks = 0\n"), "");
  EXPECT_EQ(message("enable_ticks = 65535\n"), "");
}

std::string enabling(int ticks) { return "enable_ticks = " + std::to_string(ticks) + "\n"; }

// The drive follows the code `enable_ticks` ticks after the frame that enables it has arrived, and
// says so with the next count that arrives. A frame that disables it acts at once, and the time
// starts anew.
TEST(DriveBus, DriveIsOnAfterItsTimeAndReportsIt) {
  struct Case {
    int cycle, out, in, enable;
  };
  for (const auto &[cycle, out, in, enable] :
       {Case{1, 0, 0, 0}, {1, 0, 0, 1}, {1, 0, 0, 7}, {3, 0, 0, 7}, {3, 3, 3, 7}, {6, 4, 2, 20}}) {
    Plant plant(make_model(free_mass(bus(cycle, out, in) + enabling(enable))));
    const auto wanted = [](int n) { return (n >= 5 && n < 90) || n >= 120; };
    const auto arrived = [&, cycle = cycle, out = out](int n) {
      return n >= out && wanted((n - out) / cycle * cycle);
    };
    // In tick n the drive has been enabled for so many ticks in succession, this one included.
    const auto enabled_for = [&](int n) {
      int ticks = 0;
      while (n - ticks >= 0 && arrived(n - ticks)) ++ticks;
      return ticks;
    };
    int follows = 0;
    for (int n = 0; n < 200; ++n) {
      const int sampled = n < in ? 0 : (n - in) / cycle * cycle;
      const bool on = sampled > 0 && enabled_for(sampled - 1) >= std::max(enable, 1);
      ASSERT_EQ(plant.codes().drive, on ? kDriveFitted | kDriveOn : kDriveFitted)
          << "cycle " << cycle << ", enable " << enable << ", tick " << n;
      plant.step(100, wanted(n));
      const bool acts = enabled_for(n) > enable;
      ASSERT_EQ(plant.signal("drive.force") != 0.0, acts) << "enable " << enable << ", tick " << n;
      follows += acts;
    }
    EXPECT_GT(follows, 100);
  }
}

TEST(DriveBus, WithoutEnableTicksTheDriveReportsNothing) {
  for (const std::string &keys : {std::string(), bus(3, 3, 3)}) {
    Plant plant(make_model(free_mass(keys)));
    plant.fail_drive(DriveFailure::fault);
    for (int n = 0; n < 20; ++n) {
      ASSERT_EQ(plant.codes().drive, 0);
      plant.step(100, true);
    }
    EXPECT_NE(plant.signal("drive.force"), 0.0);
  }
}

// A drive that reports and needs no time computes the same states as one that reports nothing.
TEST(DriveBus, EnableTicksOfZeroChangeNoState) {
  for (const std::string &keys : {std::string(), bus(3, 4, 2)}) {
    Plant with(make_model(free_mass(keys + enabling(0))));
    Plant without(make_model(free_mass(keys)));
    for (int n = 0; n < 300; ++n) {
      ASSERT_EQ(with.codes().encoder, without.codes().encoder);
      ASSERT_EQ(with.codes().encoder_age, without.codes().encoder_age);
      with.step(code_of(n), n % 50 > 4);
      without.step(code_of(n), n % 50 > 4);
      ASSERT_EQ(hash_state(kHashStart, with), hash_state(kHashStart, without)) << n;
    }
  }
}

TEST(DriveBus, AModelWithoutEncoderHasTheReportToo) {
  std::string text = free_mass(enabling(2));
  Plant plant(make_model(text.substr(0, text.find("[encoder]"))));
  for (int n = 0; n < 6; ++n) {
    ASSERT_EQ(plant.codes().drive, n >= 2 ? kDriveFitted | kDriveOn : kDriveFitted) << n;
    plant.step(0, true);
  }
}

// A drive that has failed does not follow the code, says why, and is on again after its time.
TEST(DriveBus, DriveThatSwitchesItselfOff) {
  for (const auto &[failure, report] :
       {std::pair<DriveFailure, int>{DriveFailure::off, kDriveFitted},
        {DriveFailure::fault, kDriveFitted | kDriveFault}}) {
    Plant plant(make_model(free_mass(enabling(4))));
    for (int n = 0; n < 60; ++n) {
      if (n == 20) plant.fail_drive(failure);
      if (n == 30) plant.fail_drive(DriveFailure::none);
      const bool failed = n >= 20 && n < 30;
      const bool on = (n >= 4 && n < 20) || n >= 34;
      ASSERT_EQ(plant.codes().drive, failed ? report
                                     : on   ? kDriveFitted | kDriveOn
                                            : kDriveFitted)
          << n;
      plant.step(100, true);
      ASSERT_EQ(plant.signal("drive.force") != 0.0, on) << n;
    }
  }
}

// The frames of a silent drive do not arrive: count and report stay, and become older. The drive
// still follows the code.
TEST(DriveBus, SilentDriveGivesAnOldCount) {
  Plant plant(make_model(free_mass(bus(3, 0, 2) + enabling(0), 1.5)));  // 1000 count a tick
  for (int n = 0; n < 400; ++n) {
    if (n == 30) plant.fail_drive(DriveFailure::silent);
    if (n == 330) plant.fail_drive(DriveFailure::none);
    const int newest = n < 2 ? 0 : (n - 2) / 3 * 3;
    const int seen = newest >= 30 && newest < 330 ? 27 : newest;
    const SensorCodes &codes = plant.codes();
    ASSERT_EQ(codes.encoder, 1000 * seen) << n;
    ASSERT_EQ(codes.encoder_age, std::min(n - seen, 255)) << n;
    plant.step(0, true);
    ASSERT_EQ(codes.drive & kDriveFitted, kDriveFitted);
  }
  plant.fail_drive(DriveFailure::silent);
  for (int n = 0; n < 3; ++n) plant.step(100, true);
  EXPECT_NE(plant.signal("drive.force"), 0.0);
}

}  // namespace
}  // namespace forceaxis::sim::test
