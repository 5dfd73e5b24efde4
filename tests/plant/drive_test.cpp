// Drives against closed forms: a body of 1e20 kg stands for a locked shaft.
#include <cmath>
#include <string>

#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

constexpr double kVolt = 20.0 / 4096.0;

std::string body(const std::string &mass) {
  return "[[body]]\nname = \"axis\"\nmass = " + mass + "\n";
}

const std::string kLocked = body("1e20");

TEST(DcMotor, LockedShaftLinear) {
  Plant plant(make_model(kLocked + motor_drive("axis")));
  const double u = 50 * kVolt;  // e = 0.95 V at first: inner slope
  const double total = 4.5 + 15.0 / 3.0;
  for (int k = 1; k <= 60; ++k) {
    plant.step(50, true);
    const double i = 15 * 3.9 * u / total * -std::expm1(-total / 0.0158 * (k * kTickS));
    ASSERT_NEAR(plant.signal("drive.current") / i, 1.0, 1e-12) << "tick " << k;
    ASSERT_NEAR(plant.signal("drive.force") / (0.5 / 0.004043 * i), 1.0, 1e-12);
    ASSERT_NEAR(plant.signal("drive.current_command"), 3.9 * u, 1e-11);
    ASSERT_NEAR(plant.signal("drive.voltage"), 15 * (3.9 * u - i / 3), 1e-11);
  }
  EXPECT_EQ(plant.signal("drive.command"), u);
}

// c = 8 V: the supply limits until i = 3 (8 - 6) = 6 A, then the outer slope takes over.
TEST(DcMotor, SupplyLimitThenOuterSlope) {
  const std::string text = kLocked + motor_drive("axis");
  Plant plant(make_model(text + "[dac]\nrange = 10\n"));
  const int code = static_cast<int>(8.0 / 3.9 / kVolt);
  const double c = 3.9 * (code * kVolt);
  const double i_break = 3 * (c - 6);
  const double t_break = -0.0158 / 4.5 * std::log1p(-i_break * 4.5 / 60.0);
  const double total = 4.5 + 2.5;
  const double i_end = (7.5 * c + 15) / total;
  for (int k = 1; k <= 60; ++k) {
    plant.step(code, true);
    const double t = k * kTickS;
    const double i = t < t_break
                         ? 60 / 4.5 * -std::expm1(-4.5 / 0.0158 * t)
                         : i_end + (i_break - i_end) * std::exp(-total / 0.0158 * (t - t_break));
    ASSERT_NEAR(plant.signal("drive.current") / i, 1.0, 1e-12) << "tick " << k;
  }
  const auto events = plant.events();
  ASSERT_EQ(events.size(), 1U);
  EXPECT_EQ(events[0].element, "drive.amplifier");
  EXPECT_EQ(events[0].from, "high limit");
  EXPECT_EQ(events[0].to, "high outer");
  EXPECT_FALSE(events[0].jump);
  EXPECT_NEAR(events[0].time_s, t_break, 1e-14);
}

TEST(DcMotor, CurveIsOdd) {
  const auto model = make_model(kLocked + motor_drive("axis"));
  Plant up(model);
  Plant down(model);
  for (int k = 0; k < 300; ++k) {
    const int code = (k * 7919) % 2048;
    up.step(code, true);
    down.step(-code, true);
    ASSERT_EQ(up.signal("drive.current"), -down.signal("drive.current"));
  }
  EXPECT_GT(up.crossings() + up.jumps(), 10);
}

// Feedback limited to 1 V: from i = 3 A on the error stays at c - 1.
TEST(DcMotor, CurrentFeedbackSaturates) {
  Plant plant(make_model(kLocked + motor_drive("axis", "current_feedback_limit = 1\n")));
  const int code = static_cast<int>(1.5 / 3.9 / kVolt);
  const double c = 3.9 * (code * kVolt);
  const double total = 4.5 + 5.0;
  // Inner slope throughout: i' L = 15 (c - i/3) - 4.5 i, then 15 (c - 1) - 4.5 i.
  const double first_end = 15 * c / total;
  ASSERT_LT(first_end, 3.0);
  Plant strong(
      make_model(kLocked + motor_drive("axis", "current_feedback_limit = 0.5\n")));  // 1.5 A
  const double t_sat = -0.0158 / total * std::log1p(-1.5 / first_end);
  const double second_end = 15 * (c - 0.5) / 4.5;
  for (int k = 1; k <= 90; ++k) {
    plant.step(code, true);
    strong.step(code, true);
    const double t = k * kTickS;
    ASSERT_NEAR(plant.signal("drive.current"), first_end * -std::expm1(-total / 0.0158 * t), 1e-12);
    const double i = t < t_sat
                         ? first_end * -std::expm1(-total / 0.0158 * t)
                         : second_end + (1.5 - second_end) * std::exp(-4.5 / 0.0158 * (t - t_sat));
    ASSERT_NEAR(strong.signal("drive.current"), i, 1e-12) << "tick " << k;
  }
  EXPECT_EQ(plant.crossings(), 0);
  ASSERT_EQ(strong.events().size(), 1U);
  EXPECT_EQ(strong.events()[0].element, "drive.current_feedback");
  EXPECT_NEAR(strong.events()[0].time_s, t_sat, 1e-14);
}

TEST(DcMotor, PreampSaturates) {
  Plant plant(make_model(kLocked + motor_drive("axis", "preamp_limit = 1.25\n")));
  plant.step(2047, true);
  EXPECT_DOUBLE_EQ(plant.signal("drive.current_command"), 1.25);
  plant.step(-2048, true);
  EXPECT_DOUBLE_EQ(plant.signal("drive.current_command"), -1.25);
  EXPECT_EQ(plant.mode()[0], "drive.preamp: low limit");
  for (int k = 0; k < 100; ++k) plant.step(-2048, true);
  EXPECT_NEAR(plant.signal("drive.current"), -15 * 1.25 / 9.5, 1e-12);
}

TEST(DcMotor, SupplyLimitsBeforeTheCorner) {
  std::string text = motor_drive("axis");
  text.replace(text.find("supply_limit = 60"), 17, "supply_limit = 20");  // reached at e = 4/3 V
  Plant plant(make_model(kLocked + text));
  plant.step(2047, true);
  EXPECT_DOUBLE_EQ(plant.signal("drive.voltage"), 20.0);
  EXPECT_EQ(plant.mode()[0], "drive.amplifier: high limit");
  EXPECT_NEAR(plant.signal("drive.current"), 20 / 4.5 * -std::expm1(-4.5 / 0.0158 * kTickS), 1e-12);
}

// Unloaded and small: tach lag, back EMF and velocity are linear; the DC gain is a closed form.
TEST(DcMotor, SteadySpeed) {
  Plant plant(make_model(body("0.5") + motor_drive("axis", "b_m = 0.02\n")), {true, 100});
  for (int k = 0; k < 6000; ++k) plant.step(20, true);
  const double u = 20 * kVolt;
  // k_t i = b_m w; 15 (3.9 u - 4.2 k_tach w - i/3) = R i + k_e w.
  const double w = 15 * 3.9 * u / ((4.5 + 5.0) * 0.02 / 0.5 + 0.5 + 15 * 4.2 * 0.039);
  EXPECT_NEAR(plant.signal("axis.velocity"), 0.004043 * w, 1e-12);
  EXPECT_NEAR(plant.signal("drive.tach"), 0.039 * w, 1e-11);
  EXPECT_NEAR(plant.signal("drive.tach_filtered"), 4.2 * 0.039 * w, 1e-10);
  EXPECT_NEAR(plant.signal("drive.force"), 0.0, 1e-9);  // b_m takes all of the torque
  const EnergyAudit energy = plant.energy();
  ASSERT_EQ(energy.dissipated.size(), 1U);
  EXPECT_EQ(energy.dissipated[0].element, "drive");
  EXPECT_LT(std::fabs(energy.residual), 1e-11 * energy.supplied);
}

TEST(DcMotor, DisabledCoasts) {
  Plant plant(make_model(body("100") +
                         "[[damper]]\nname = \"guide\"\nbetween = [\"axis\", "
                         "\"ground\"]\ndamping = 200\n" +
                         motor_drive("axis")));
  for (int k = 0; k < 100; ++k) plant.step(800, true);
  const double v0 = plant.signal("axis.velocity");
  EXPECT_GT(v0, 0.01);
  for (int k = 1; k <= 300; ++k) {
    plant.step(800, false);
    ASSERT_EQ(plant.signal("drive.current"), 0.0);
    ASSERT_EQ(plant.signal("drive.force"), 0.0);
    ASSERT_NEAR(plant.signal("axis.velocity") / (v0 * std::exp(-2.0 * k * kTickS)), 1.0, 1e-12);
  }
  EXPECT_EQ(plant.mode()[0], "drive.amplifier: off");
  EXPECT_NEAR(plant.signal("drive.voltage"), 0.5 / 0.004043 * plant.signal("axis.velocity"), 1e-11);
  plant.step(800, true);
  EXPECT_GT(plant.signal("drive.current"), 0.0);
}

TEST(DcMotor, PushesAgainstItsReactionBody) {
  Plant plant(
      make_model("[[body]]\nname = \"axis\"\nmass = 60\n[[body]]\nname = \"base\"\nmass = 90\n"
                 "[[damper]]\nname = \"floor\"\nbetween = [\"base\", \"ground\"]\n"
                 "damping = 0\n" +
                 motor_drive("axis", "reaction = \"base\"\nb_m = 0.01\n")));
  for (int k = 0; k < 500; ++k) plant.step(30, true);
  EXPECT_GT(plant.signal("axis.velocity"), 1e-3);
  EXPECT_NEAR(60 * plant.signal("axis.velocity") + 90 * plant.signal("base.velocity"), 0.0, 1e-12);
  EXPECT_NEAR(plant.signal("drive.tach"),
              0.039 / 0.004043 * (plant.signal("axis.velocity") - plant.signal("base.velocity")),
              1e-12);
}

TEST(FirstOrder, LockedLag) {
  Plant plant(make_model(kLocked +
                         "[drive]\ntype = \"first_order\"\nbody = \"axis\"\nk_act = 2000\n"
                         "a_act = 300\nvelocity_per_volt = 0.05\n"));
  for (int k = 1; k <= 100; ++k) {
    plant.step(1024, true);
    const double force = 2000 * 0.05 * 5.0 * -std::expm1(-300 * (k * kTickS));
    ASSERT_NEAR(plant.signal("drive.force") / force, 1.0, 1e-12);
  }
  plant.step(1024, false);
  EXPECT_EQ(plant.signal("drive.force"), 0.0);
}

// v'' + a v' + a k/m v = a k V/m with a = 300, k/m = 50: two real poles.
TEST(FirstOrder, FreeBody) {
  Plant plant(make_model(body("40") +
                         "[drive]\ntype = \"first_order\"\nbody = \"axis\"\nk_act = 2000\n"
                         "a_act = 300\nvelocity_per_volt = 0.05\n"));
  const double root = std::sqrt(150.0 * 150.0 - 300.0 * 50.0);
  const double p = 150.0 - root;
  const double q = 150.0 + root;
  for (int k = 1; k <= 300; ++k) {
    plant.step(1024, true);
    const double t = k * kTickS;
    const double v = 0.25 * (1 - (q * std::exp(-p * t) - p * std::exp(-q * t)) / (q - p));
    ASSERT_NEAR(plant.signal("axis.velocity"), v, 1e-14) << "tick " << k;
  }
}

TEST(Perfect, ConstantForce) {
  Plant plant(make_model(body("8") + "[drive]\ntype = \"perfect\"\nbody = \"axis\"\n"
                                     "force_per_volt = -4\n"));
  for (int k = 1; k <= 300; ++k) {
    plant.step(-1024, true);  // -5 V: +20 N
    const double t = k * kTickS;
    ASSERT_NEAR(plant.signal("axis.velocity"), 2.5 * t, 1e-14);
    ASSERT_NEAR(plant.signal("axis.position"), 1.25 * t * t, 1e-14);
  }
  EXPECT_EQ(plant.signal("drive.force"), 20.0);
  const double v = plant.signal("axis.velocity");
  for (int k = 0; k < 10; ++k) plant.step(-1024, false);
  EXPECT_EQ(plant.signal("axis.velocity"), v);
}

TEST(Dac, OffsetIsAddedToTheVoltageOfTheCode) {
  Plant plant(make_model(body("1") + "[drive]\ntype = \"perfect\"\nbody = \"axis\"\n" +
                         "force_per_volt = 3\n[dac]\noffset = -0.25\n"));
  plant.step(0, true);
  EXPECT_EQ(plant.signal("drive.command"), -0.25);
  EXPECT_EQ(plant.signal("drive.force"), -0.75);
  plant.step(1024, true);
  EXPECT_EQ(plant.signal("drive.command"), 4.75);
}

TEST(Step, RefusesCodesBeyondTheDac) {
  Plant plant(make_model(kLocked + motor_drive("axis")));
  EXPECT_THROW(plant.step(2048, true), std::invalid_argument);
  EXPECT_THROW(plant.step(-2049, true), std::invalid_argument);
  plant.step(2047, true);
  plant.step(-2048, true);
  EXPECT_EQ(plant.tick(), 2);
}

// Fig 3.7: u behind the tachometer, 4.2 / (1 + s / 942), inverted.
TEST(DcMotor, TachometerInput) {
  Plant plant(make_model(kLocked + motor_drive("axis", "input = \"tach\"\n")));
  const double u = 10 * kVolt;
  for (int k = 1; k <= 20; ++k) {
    plant.step(10, true);
    const double filtered = 4.2 * u * -std::expm1(-942 * (k * kTickS));
    ASSERT_NEAR(plant.signal("drive.tach_filtered"), filtered, 1e-14) << "tick " << k;
    ASSERT_EQ(plant.signal("drive.current_command"), -plant.signal("drive.tach_filtered"));
    ASSERT_NEAR(plant.signal("drive.tach"), 0.0, 1e-15);
  }
}

// Finer steps are the same motion: events, energies and states of a body thrown against a contact.
TEST(Step, PartsOfATickGiveTheSameMotion) {
  const std::string text = body("8") + "velocity = 0.5\n" + motor_drive("axis") +
                           "[[contact]]\nname = \"wall\"\nbetween = [\"axis\", \"ground\"]\n"
                           "stiffness = 4e5\ndamping = 60\ngap = 0.003\n";
  const auto model = make_model(text);
  Plant whole(model, {.audit = true});
  for (int k = 0; k < 60; ++k) whole.step(k % 7 == 0 ? 300 : -40, true);
  for (const int parts : {2, 5, 64}) {
    Plant fine(std::make_shared<ModeCache>(model, parts), {.audit = true});
    for (int k = 0; k < 60; ++k)
      for (int part = 0; part < parts; ++part) fine.step(k % 7 == 0 ? 300 : -40, true);
    EXPECT_NEAR(fine.time_s(), whole.time_s(), 1e-15);
    const auto events = whole.events();
    const auto found = fine.events();
    ASSERT_EQ(found.size(), events.size());
    ASSERT_GE(events.size(), 4U);
    for (std::size_t i = 0; i < events.size(); ++i) {
      EXPECT_EQ(found[i].to, events[i].to);
      EXPECT_NEAR(found[i].time_s, events[i].time_s, 1e-12);
    }
    for (std::size_t i = 0; i < whole.state().size(); ++i)
      EXPECT_NEAR(fine.state()[i], whole.state()[i], 1e-10) << "state " << i;
    EXPECT_NEAR(fine.energy().supplied, whole.energy().supplied, 1e-10);
    EXPECT_NEAR(fine.energy().residual, 0.0, 1e-10);
  }
  EXPECT_THROW(ModeCache(model, 0), std::invalid_argument);
  EXPECT_THROW(ModeCache(model, 65), std::invalid_argument);
}

// What the drive is given shows at once; asking changes nothing of the tick that follows.
TEST(Step, InTwoHalvesIsTheSameStep) {
  const auto model = make_model(body("8") + motor_drive("axis"));
  Plant one(model);
  Plant two(model);
  for (int k = 0; k < 200; ++k) {
    const double volts = (k * 37 % 101 - 50) * 0.04;
    two.hold_volts(volts, true);
    ASSERT_EQ(two.signal("drive.command"), volts);
    ASSERT_NEAR(two.signal("drive.current_command") + two.signal("drive.tach_filtered"),
                3.9 * volts, 1e-12);
    two.step_volts(volts, true);
    one.step_volts(volts, true);
    for (std::size_t i = 0; i < one.state().size(); ++i)
      ASSERT_EQ(two.state()[i], one.state()[i]) << "tick " << k;
  }
}

}  // namespace
}  // namespace forceaxis::sim::test
