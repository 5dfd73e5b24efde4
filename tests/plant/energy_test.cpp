// The energy balance: each entry against a closed form, then the sum over long runs.
#include <cmath>
#include <string>

#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

TEST(Energy, DampedOscillatorEntries) {
  Plant plant(make_model("[[body]]\nname = \"m\"\nmass = 2\nvelocity = 0.5\n[[spring]]\n"
                         "name = \"s\"\nbetween = [\"m\", \"ground\"]\nstiffness = 5000\n"
                         "damping = 40\n[[damper]]\nname = \"d\"\nbetween = [\"ground\", \"m\"]\n"
                         "damping = 20\n"),
              {true, 10});
  for (int k = 0; k < 3000; ++k) plant.step(0, false);
  const EnergyAudit energy = plant.energy();
  EXPECT_DOUBLE_EQ(energy.initial, 0.25);
  EXPECT_EQ(energy.supplied, 0.0);
  ASSERT_EQ(energy.dissipated.size(), 2U);
  EXPECT_EQ(energy.dissipated[0].element, "s");
  EXPECT_NEAR(energy.dissipated[0].energy, 0.25 * 2 / 3, 1e-13);  // all of it, 40 : 20
  EXPECT_NEAR(energy.dissipated[1].energy, 0.25 / 3, 1e-13);
  EXPECT_NEAR(energy.residual, 0.0, 1e-15);
}

TEST(Energy, PerfectDriveWork) {
  Plant plant(make_model("[[body]]\nname = \"m\"\nmass = 8\n[drive]\ntype = \"perfect\"\n"
                         "body = \"m\"\nforce_per_volt = 4\n"),
              {true, 10});
  for (int k = 0; k < 300; ++k) plant.step(1024, true);
  EXPECT_NEAR(plant.energy().supplied, 20.0 * 1.25 * 0.2 * 0.2, 1e-13);
  plant.apply_impulse("m", 4.0);
  EXPECT_NEAR(plant.energy().impulses, 4.0 * 0.5 + 16.0 / 16.0, 1e-13);
  EXPECT_NEAR(plant.energy().residual, 0.0, 1e-14);
}

TEST(Energy, HardContactsInsideTicks) {
  Plant plant(make_model("[[body]]\nname = \"m\"\nmass = 0.14\nvelocity = 1\n[[contact]]\n"
                         "name = \"front\"\nbetween = [\"m\", \"ground\"]\nstiffness = 1e7\n"
                         "damping = 20\ngap = 1e-4\n[[contact]]\nname = \"back\"\n"
                         "between = [\"ground\", \"m\"]\nstiffness = 1e6\ndamping = 5\n"
                         "gap = 1e-4\n"),
              {true, 10});
  for (int k = 0; k < 1500; ++k) plant.step(0, false);
  const EnergyAudit energy = plant.energy();
  EXPECT_GT(plant.crossings(), 100);
  EXPECT_GT(energy.discarded, 0.0);
  EXPECT_LT(std::fabs(energy.residual), 1e-12 * energy.initial);
}

TEST(Energy, NeedsTheOption) {
  Plant plant(
      make_model("[[body]]\nname = \"m\"\nmass = 8\n[drive]\ntype = \"perfect\"\n"
                 "body = \"m\"\nforce_per_volt = 4\n"));
  EXPECT_THROW(plant.energy(), std::logic_error);
}

TEST(Energy, TheAuditDoesNotTouchTheMotion) {
  const auto model = make_model(
      "[[body]]\nname = \"m\"\nmass = 0.14\nvelocity = 1\n[[contact]]\n"
      "name = \"front\"\nbetween = [\"m\", \"ground\"]\n"
      "stiffness = 1e7\ndamping = 20\ngap = 1e-4\n[[spring]]\n"
      "name = \"s\"\nbetween = [\"m\", \"ground\"]\nstiffness = 1e4\n");
  Plant with(model, {true, 0});
  Plant without(model);
  for (int k = 0; k < 500; ++k) {
    with.step(0, false);
    without.step(0, false);
    ASSERT_EQ(hash_state(kHashStart, with), hash_state(kHashStart, without)) << "tick " << k;
  }
}

}  // namespace
}  // namespace forceaxis::sim::test
