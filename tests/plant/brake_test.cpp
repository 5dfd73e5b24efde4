// A brake against closed forms: how far a vertical axis sags until it holds, and what that costs.
#include <cmath>
#include <string>

#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

constexpr double kG = 9.81;

// A mass on a vertical guide, tied to ground by a spring without stiffness; gravity pulls it back.
std::string hanging(double mass, const std::string &brake, const std::string &more = "") {
  return "[[body]]\nname = \"m\"\nmass = " + number(mass) +
         "\n[[spring]]\nname = \"none\"\nbetween = [\"m\", \"ground\"]\nstiffness = 0\n"
         "[[gravity]]\nname = \"weight\"\nbody = \"m\"\nacceleration = -9.81\n"
         "[[brake]]\nname = \"brake\"\nbetween = [\"m\", \"ground\"]\n" +
         brake + more;
}

// Ticks with the amplifier off, so that nothing but brake and weight acts.
void ticks(Plant &plant, int count, bool release) {
  for (int k = 0; k < count; ++k) plant.step(0, false, release);
}

TEST(Brake, HoldsFromTheStart) {
  Plant plant(make_model(hanging(3, "holding = 30\n")), {true, 10});
  EXPECT_EQ(plant.mode()[0], "brake: stuck");
  ticks(plant, 100, false);
  EXPECT_EQ(plant.state()[0], 0.0);
  EXPECT_EQ(plant.state()[1], 0.0);
  EXPECT_NEAR(plant.signal("brake.force"), -3 * kG, 1e-14);
  EXPECT_TRUE(plant.events().empty());
}

TEST(Brake, SlidesWhereTheWeightIsMoreThanItHolds) {
  Plant plant(make_model(hanging(3, "holding = 20\n")), {true, 10});
  ticks(plant, 150, false);
  EXPECT_NEAR(plant.state()[0], -(kG - 20.0 / 3) * 0.1 * 0.1 / 2, 1e-16);
  EXPECT_NEAR(plant.energy().residual, 0.0, 1e-14);
}

TEST(Brake, LetsGoAfterItsTimeBetweenTwoTicks) {
  const double release = 0.0203;
  Plant plant(make_model(hanging(3, "holding = 100\nrelease = \"20.3 ms\"\n")), {true, 10});
  ticks(plant, 30, true);  // 20 ms
  EXPECT_EQ(plant.state()[0], 0.0);
  ticks(plant, 120, true);
  const double t = 150 * kTickS - release;
  EXPECT_NEAR(plant.state()[0], -kG * t * t / 2, 1e-16);
  EXPECT_NEAR(plant.state()[1], -kG * t, 1e-15);
  ASSERT_EQ(plant.events().size(), 1U);
  EXPECT_EQ(plant.events()[0].element, "brake");
  EXPECT_EQ(plant.events()[0].to, "released");
  EXPECT_NEAR(plant.events()[0].time_s, release, 1e-17);
  EXPECT_EQ(plant.signal("brake.force"), 0.0);
}

TEST(Brake, AnAxisSagsUntilItHoldsAgain) {
  const double m = 3, holding = 90, engage = 0.0311;
  Plant plant(make_model(hanging(m, "holding = 90\nengage = 0.0311\n")), {true, 10});
  ticks(plant, 15, true);  // it lets go at once: 10 ms of falling
  ticks(plant, 400, false);
  const double falling = 15 * kTickS + engage;
  const double speed = kG * falling;
  const double deceleration = holding / m - kG;
  const double sag = kG * falling * falling / 2;
  const double slid = speed * speed / (2 * deceleration);
  EXPECT_NEAR(plant.state()[0], -(sag + slid), 1e-16);
  EXPECT_EQ(plant.state()[1], 0.0);
  const auto events = plant.events();
  ASSERT_EQ(events.size(), 3U);
  EXPECT_EQ(events[1].to, "backward");
  EXPECT_NEAR(events[1].time_s, falling, 1e-17);
  EXPECT_EQ(events[2].to, "stuck");
  EXPECT_NEAR(events[2].time_s, falling + speed / deceleration, 1e-15);
  const EnergyAudit energy = plant.energy();
  EXPECT_NEAR(energy.dissipated.back().energy, holding * slid, 1e-14);
  EXPECT_NEAR(energy.residual, 0.0, 1e-14);
}

TEST(Brake, ACommandThatIsTakenBackInTimeMovesNothing) {
  Plant plant(make_model(hanging(3, "holding = 60\nrelease = 0.02\nengage = 0.02\n")), {true, 10});
  ticks(plant, 29, true);
  ticks(plant, 100, false);
  EXPECT_EQ(plant.state()[0], 0.0);
  ticks(plant, 31, true);  // released for the last tick
  ticks(plant, 29, false);
  ticks(plant, 60, true);  // it never held
  const double t = 90 * kTickS;
  EXPECT_NEAR(plant.state()[0], -kG * t * t / 2, 1e-15);
  EXPECT_EQ(plant.events().size(), 1U);
}

TEST(Brake, AFrictionBesideItAddsToIt) {
  const std::string friction =
      "[[friction]]\nname = \"guide\"\nbetween = [\"m\", \"ground\"]\ncoulomb = 5\nstiction = 8\n";
  // 29.43 N of weight: held by 24 + 8, not by 20 + 8.
  Plant holds(make_model(hanging(3, "holding = 24\n", friction)), {true, 10});
  ticks(holds, 100, false);
  EXPECT_EQ(holds.state()[0], 0.0);
  EXPECT_NEAR(holds.signal("brake.force") + holds.signal("guide.force"), -3 * kG, 1e-14);
  ticks(holds, 150, true);
  EXPECT_NEAR(holds.state()[0], -(kG - 5.0 / 3) * 0.1 * 0.1 / 2, 1e-16);
  EXPECT_NEAR(holds.energy().residual, 0.0, 1e-13);

  // Both slide until the axis stands: v^2 / 2 (35 + 5 - 29.43) / 3.
  Plant stops(make_model(hanging(3, "holding = 35\n", friction)), {true, 20});
  ticks(stops, 15, true);
  const double speed = (kG - 5.0 / 3) * 15 * kTickS;
  const double fallen = -stops.state()[0];
  ticks(stops, 300, false);
  EXPECT_EQ(stops.state()[1], 0.0);
  EXPECT_NEAR(-stops.state()[0] - fallen, speed * speed / (2 * (40.0 / 3 - kG)), 1e-16);
  EXPECT_NEAR(stops.energy().residual, 0.0, 1e-14);

  Plant slides(make_model(hanging(3, "holding = 20\n", friction)), {true, 10});
  ticks(slides, 150, false);
  EXPECT_NEAR(slides.state()[0], -(kG - 25.0 / 3) * 0.1 * 0.1 / 2, 1e-16);
}

TEST(Brake, ABlowMovesWhatItHoldsAndNotAReleasedOne) {
  Plant plant(make_model(hanging(2, "holding = 50\n")), {true, 20});
  plant.apply_impulse("m", 0.1);
  EXPECT_EQ(count_of(plant, "brake", "stuck", "forward"), 1);
  ticks(plant, 200, false);
  EXPECT_EQ(plant.mode()[0], "brake: stuck");
  ticks(plant, 1, true);
  plant.apply_impulse("m", 0.1);
  EXPECT_EQ(plant.mode()[0], "brake: released");
  EXPECT_NEAR(plant.energy().residual, 0.0, 1e-14);
}

TEST(Brake, TwoAtOneTickAndACopyAreTheSame) {
  const std::string two =
      "[[body]]\nname = \"n\"\nmass = 1\n[[spring]]\nname = \"tie\"\n"
      "between = [\"n\", \"m\"]\nstiffness = 4000\ndamping = 2\n[[brake]]\nname = \"other\"\n"
      "between = [\"n\", \"ground\"]\nholding = 40\nrelease = 0.0101\nengage = 0.0102\n";
  Plant plant(make_model(hanging(3, "holding = 50\nrelease = 0.0104\nengage = 0.01\n", two)),
              {true, 100});
  ticks(plant, 10, true);
  Plant copy = plant;
  for (Plant *p : {&plant, &copy}) {
    ticks(*p, 100, true);
    ticks(*p, 300, false);
  }
  EXPECT_EQ(hash_state(kHashStart, plant), hash_state(kHashStart, copy));
  EXPECT_EQ(count_of(plant, "brake", "stuck", "released"), 1);
  EXPECT_EQ(count_of(plant, "other", "stuck", "released"), 1);
  EXPECT_NEAR(plant.energy().residual, 0.0, 1e-12);
}

}  // namespace
}  // namespace forceaxis::sim::test
