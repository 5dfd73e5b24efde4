// The benchmark plant in its two closed loops. Expected values: an independent 113-bit integration
// (case A) and an independent count of events (case B).
#include <cmath>
#include <cstdio>
#include <string>
#include <thread>
#include <vector>

#include "sim/model/elements/all.hpp"
#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

struct Trace {
  std::vector<double> force;
  std::vector<int> count;
  std::uint64_t hash = kHashStart;
  double peak = 0.0;
  int peak_tick = 0;
  int changes = 0;
  int last_change = 0;
};

// Explicit force law in DAC codes: gain K, set-point in newtons at 2 N per count.
int law(int n, int gain, int setpoint_N) {
  const double code = std::floor(gain * (setpoint_N / 2.0 - n) + 0.5);
  return static_cast<int>(std::fmin(std::fmax(code, -2048.0), 2047.0));
}

Trace run(Plant &plant, int gain, int setpoint_N) {
  Trace result;
  for (int k = 0; k <= 3000; ++k) {
    const int n = plant.codes().adc[0] - 128;
    const double force = plant.signal("tip.force");
    if (k > 0 && n != result.count.back()) {
      ++result.changes;
      result.last_change = k;
    }
    if (force > result.peak) {
      result.peak = force;
      result.peak_tick = k;
    }
    result.force.push_back(force);
    result.count.push_back(n);
    result.hash = hash_state(result.hash, plant);
    if (k < 3000) plant.step(law(n, gain, setpoint_N), true);
  }
  return result;
}

std::shared_ptr<const Model> axis_model() {
  return std::make_shared<const Model>(load_model(FORCEAXIS_MODELS "/axis_contact.toml"));
}

TEST(AxisContact, CaseA) {
  Plant plant(axis_model(), {true, 4096});
  const Trace a = run(plant, 4, 59);
  EXPECT_NEAR(a.force[300], 52.7598796438, 1e-10);
  EXPECT_NEAR(a.force[600], 54.0740907746, 1e-10);
  EXPECT_NEAR(a.force[1500], 51.6981084607, 1e-10);
  EXPECT_NEAR(a.force[3000], 52.053813653183, 1e-11);
  EXPECT_NEAR(a.peak, 69.69030030811, 1e-10);
  EXPECT_EQ(a.peak_tick, 233);
  EXPECT_EQ(a.changes, 264);
  EXPECT_EQ(a.last_change, 1873);
  EXPECT_EQ(a.count.back(), 26);
  const auto events = plant.events();
  ASSERT_EQ(events.size(), 2U);
  EXPECT_EQ(events[1].element, "tip");
  EXPECT_NEAR(events[1].time_s, 0.126660144603405, 1e-15);
  EXPECT_EQ(events[0].element, "drive.amplifier");
  const EnergyAudit energy = plant.energy();
  EXPECT_LE(std::fabs(energy.residual), 1e-9 * energy.supplied);
  std::printf("case A: residual %.2g of the supplied %.6g J, edge margin %.3g LSB\n",
              energy.residual / energy.supplied, energy.supplied, plant.edge_margin());
}

TEST(AxisContact, CaseB) {
  Plant plant(axis_model(), {true, 4096});
  run(plant, 15, 100);
  EXPECT_EQ(count_of(plant, "tip", "apart", "pressed"), 46);
  EXPECT_EQ(count_of(plant, "tip", "pressed", "overlap"), 45);
  EXPECT_EQ(count_of(plant, "tip", "overlap", "apart"), 45);
  EXPECT_EQ(plant.crossings(), 335);
  const EnergyAudit energy = plant.energy();
  EXPECT_LE(std::fabs(energy.residual), 1e-9 * energy.supplied);
  std::printf("case B: residual %.2g of the supplied %.6g J\n", energy.residual / energy.supplied,
              energy.supplied);
}

TEST(AxisContact, RunsRepeatInAnyCompany) {
  const auto cache = std::make_shared<ModeCache>(axis_model());
  Plant fresh(axis_model());
  const std::uint64_t expected = run(fresh, 15, 100).hash;
  std::vector<std::uint64_t> hashes(4);
  std::vector<std::thread> threads;
  for (auto &hash : hashes)
    threads.emplace_back([&hash, cache] {
      for (int repeat = 0; repeat < 3; ++repeat) {
        Plant plant(cache);
        hash = run(plant, 15, 100).hash;
      }
    });
  for (auto &thread : threads) thread.join();
  for (const auto hash : hashes) EXPECT_EQ(hash, expected);
}

TEST(AxisContact, CopiesNeverDiverge) {
  Plant plant(axis_model());
  for (int k = 0; k < 700; ++k) plant.step(law(plant.codes().adc[0] - 128, 15, 100), true);
  Plant copy = plant;
  Plant other = plant;
  for (int k = 0; k < 700; ++k) {
    const int n = plant.codes().adc[0] - 128;
    ASSERT_EQ(copy.codes().adc[0] - 128, n);
    plant.step(law(n, 15, 100), true);
    copy.step(law(n, 15, 100), true);
    other.step(0, false);
    ASSERT_EQ(hash_state(kHashStart, plant), hash_state(kHashStart, copy)) << "tick " << k;
  }
  EXPECT_NE(hash_state(kHashStart, plant), hash_state(kHashStart, other));
}

}  // namespace
}  // namespace forceaxis::sim::test
