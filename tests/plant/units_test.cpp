// Quantities: every unit with and without prefixes, against values worked out by hand.
#include "sim/model/units.hpp"

#include <set>
#include <string>
#include <vector>

#include "sim/model/elements/all.hpp"
#include "sim/model/model.hpp"
#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

struct Case {
  const char *text;
  Dimension dimension;
  double value;  // in the unit that the header names first
};

const std::vector<Case> kExact = {
    {"15 V/V", Dimension::ratio, 15.0},
    {"2.5 1", Dimension::ratio, 2.5},
    {"7 count", Dimension::count, 7.0},
    {"3.5 kg", Dimension::mass, 3.5},
    {"120 g", Dimension::mass, 0.12},
    {"1.5 Mg", Dimension::mass, 1500.0},
    {"80 mg", Dimension::mass, 0.00008},
    {"12.3 mm", Dimension::length, 0.0123},
    {"0.5 mm", Dimension::length, 0.0005},
    {"-30 um", Dimension::length, -0.00003},
    {"4 nm", Dimension::length, 0.000000004},
    {"7 cm", Dimension::length, 0.07},
    {"1.25 km", Dimension::length, 1250.0},
    {"2 ms", Dimension::time, 0.002},
    {"1.5 min", Dimension::time, 90.0},
    {"12 mm/s", Dimension::velocity, 0.012},
    {"0.003 m / s", Dimension::velocity, 0.003},
    {"6 m/min", Dimension::velocity, 0.1},
    {"75 N", Dimension::force, 75.0},
    {"+75N", Dimension::force, 75.0},
    {"1.2e3 mN", Dimension::force, 1.2},
    {".4 kN", Dimension::force, 400.0},
    {"8.3 J", Dimension::energy, 8.3},
    {"250 mJ", Dimension::energy, 0.25},
    {"8.3 N m", Dimension::energy, 8.3},
    {"8.3 N*m", Dimension::energy, 8.3},
    {"8.3 N s", Dimension::impulse, 8.3},
    {"8.3 mN*s", Dimension::impulse, 0.0083},
    {"2 kg m/s", Dimension::impulse, 2.0},
    {"2 g m/s", Dimension::impulse, 0.002},
    {"400 kN/m", Dimension::stiffness, 400000.0},
    {"0.7 N/mm", Dimension::stiffness, 700.0},
    {"3 N/um", Dimension::stiffness, 3000000.0},
    {"363 N s/m", Dimension::damping, 363.0},
    {"0.4 N*s/mm", Dimension::damping, 400.0},
    {"5 kg/s", Dimension::damping, 5.0},
    {"250 mV", Dimension::voltage, 0.25},
    {"1.2 kV", Dimension::voltage, 1200.0},
    {"30 uA", Dimension::current, 0.00003},
    {"4.7 kohm", Dimension::resistance, 4700.0},
    {"2 Mohm", Dimension::resistance, 2000000.0},
    {"15.8 mH", Dimension::inductance, 0.0158},
    {"330 mV/A", Dimension::volt_per_amp, 0.33},
    {"50 mN m/A", Dimension::torque_constant, 0.05},
    {"0.5 N*m/A", Dimension::torque_constant, 0.5},
    {"60 mV s/rad", Dimension::speed_constant, 0.06},
    {"0.06 V*s/rad", Dimension::speed_constant, 0.06},
    {"4 mm/rad", Dimension::transmission, 0.004},
    {"2 A/V", Dimension::current_per_volt, 2.0},
    {"600 mA/V", Dimension::current_per_volt, 0.6},
    {"25 N/A", Dimension::force_per_current, 25.0},
    {"628 rad/s", Dimension::rate, 628.0},
    {"1 rad/ms", Dimension::rate, 1000.0},
    {"40 1/s", Dimension::rate, 40.0},
    {"0.02 N m s/rad", Dimension::rotary_damping, 0.02},
    {"20 mN*m*s/rad", Dimension::rotary_damping, 0.02},
    {"0.0013 kg m^2", Dimension::inertia, 0.0013},
    {"13 kg cm^2", Dimension::inertia, 0.0013},
    {"13 kg*cm^2", Dimension::inertia, 0.0013},
    {"50 N/V", Dimension::force_per_volt, 50.0},
    {"50 mm/s/V", Dimension::velocity_per_volt, 0.05},
    {"50 mm/(s V)", Dimension::velocity_per_volt, 0.05},
    {"0.05 m/( s*V )", Dimension::velocity_per_volt, 0.05},
    {"10 count/mm", Dimension::count_per_length, 10000.0},
    {"9.81 m/s^2", Dimension::acceleration, 9.81},
    {"1 mm/ms^2", Dimension::acceleration, 1000.0},
    {"2 kN/s", Dimension::force_rate, 2000.0},
    {"40 Hz", Dimension::frequency, 40.0},
    {"0.5 kHz", Dimension::frequency, 500.0},
    {"3 Hz/s", Dimension::sweep, 3.0},
    {"12 mV/N", Dimension::volt_per_force, 0.012},
    {"2 V/mm", Dimension::volt_per_length, 2000.0},
    {"30 V s/m", Dimension::volt_per_velocity, 30.0},
    {"30 mV*s/mm", Dimension::volt_per_velocity, 30.0},
    {"2.5 N/count", Dimension::force_per_count, 2.5},
    {"20 mA/count", Dimension::current_per_count, 0.02},
    {"5 mV/count", Dimension::voltage_per_count, 0.005},
    {"1 um/count", Dimension::length_per_count, 0.000001},
    {"1 mm/s/count", Dimension::velocity_per_count, 0.001},
    {"1 mm/s^2/count", Dimension::acceleration_per_count, 0.001},
    {"1 kN/s/count", Dimension::force_rate_per_count, 1000.0},
};

TEST(Quantity, DecimalUnitsAreExact) {
  for (const Case &c : kExact) {
    const QuantityResult result = read_quantity(c.text, c.dimension);
    ASSERT_TRUE(result.value.has_value()) << c.text << ": " << result.obtained;
    EXPECT_EQ(*result.value, c.value) << c.text;
  }
}

TEST(Quantity, EverySpellingIsAmongThoseCases) {
  std::set<std::string> missing;
  for (const std::string &unit : unit_spellings()) missing.insert(unit);
  for (const Case &c : kExact) {
    const std::string text = c.text;
    missing.erase(text.substr(text.find(' ') + 1));
  }
  // Given above with prefixes alone.
  for (const char *prefixed :
       {"N s/m",     "N*s",         "N*s/m",     "kg/s",   "m",       "s",       "m/s",
        "N/m",       "V",           "A",         "ohm",    "H",       "V/A",     "N m/A",
        "V s/rad",   "m/rad",       "N*m*s/rad", "kg*m^2", "m/s/V",   "m/(s V)", "count/m",
        "N/s",       "V/N",         "V/m",       "V*s/m",  "A/count", "V/count", "m/count",
        "m/s/count", "m/s^2/count", "N/s/count"})
    missing.erase(prefixed);
  EXPECT_TRUE(missing.empty()) << *missing.begin();
}

TEST(Quantity, AnglesAndCycles) {
  const auto value = [](const char *text, Dimension dimension) {
    return read_quantity(text, dimension).value.value_or(-1.0);
  };
  EXPECT_DOUBLE_EQ(value("25 mm/rev", Dimension::transmission), 0.0039788735772973835);
  EXPECT_DOUBLE_EQ(value("3000 rev/min", Dimension::rate), 314.1592653589793);
  EXPECT_DOUBLE_EQ(value("90 deg/s", Dimension::rate), 1.5707963267948966);
  EXPECT_DOUBLE_EQ(value("40 Hz", Dimension::rate), 251.32741228718345);
  EXPECT_DOUBLE_EQ(value("1.5 kHz", Dimension::rate), 9424.77796076938);
}

TEST(Quantity, SaysWhatItGotInstead) {
  const auto obtained = [](const char *text, Dimension dimension) {
    const QuantityResult result = read_quantity(text, dimension);
    return result.value ? "taken" : result.obtained;
  };
  EXPECT_EQ(obtained("12 mm/s", Dimension::force), "\"12 mm/s\", a velocity");
  EXPECT_EQ(obtained("12", Dimension::force), "\"12\" without a unit");
  EXPECT_EQ(obtained("40 1/s", Dimension::frequency), "\"40 1/s\", a rate");
  for (const char *text : {"12 lbf", "12 NN", "12 kkg", "12 mcount", "12 N/", "1.2.3 N", "1e N",
                           "0x10 N", "12 (N", "12 s N", "12 N^2", "12 kmin"})
    EXPECT_EQ(obtained(text, Dimension::force),
              '"' + std::string(text) + "\", whose unit is not known");
}

TEST(Quantity, NoDoubleIsNoNumber) {
  EXPECT_FALSE(std::isfinite(*read_quantity("1e400 N", Dimension::force).value));
  EXPECT_FALSE(std::isfinite(*read_quantity("1e99999999999 N", Dimension::force).value));
  EXPECT_FALSE(std::isfinite(*read_quantity("1e306 kN", Dimension::force).value));
  EXPECT_EQ(*read_quantity("1e305 kN", Dimension::force).value, 1e308);
}

TEST(Quantity, IsDistinguishedFromANameByItsFirstDigit) {
  for (const char *text : {"1", "-1 N", "+.5 m", ".5 m", "0"}) EXPECT_TRUE(is_quantity(text));
  for (const char *text : {"", "-", "k", "-k_w", "e5", "_1", "nan N", "-inf N", ".", "-."})
    EXPECT_FALSE(is_quantity(text)) << text;
}

const std::string kPlant = R"([parameters]
m = { value = "2500 g", unit = "kg" }
k = { value = 100, unit = "N/m" }
[[body]]
name = "a"
mass = "m"
position = "-2 mm"
[[spring]]
name = "s"
between = ["a", "ground"]
stiffness = ["k", "400 N/mm"]
breaks = "0.5 mm"
[[adc]]
channel = 0
signal = "s.force"
per_count = "25 mN/count"
filter = "1 krad/s"
)";

std::string refusal(const std::string &from, const std::string &to,
                    const std::vector<Override> &overrides = {}) {
  std::string text = kPlant;
  text.replace(text.find(from), from.size(), to);
  try {
    (void)load_model(write_model(text), overrides, overrides.empty() ? "" : "e.toml");
  } catch (const InputError &error) {
    return error.key + ": " + error.message;
  }
  return "accepted";
}

TEST(ModelQuantities, StandForNumbers) {
  const Model model = load_model(write_model(kPlant));
  EXPECT_EQ(model.bodies[0].mass, 2.5);
  EXPECT_EQ(model.bodies[0].position, -0.002);
  EXPECT_EQ(model.springs[0].stiffness.slopes, (std::vector<double>{100.0, 400000.0}));
  EXPECT_EQ(model.springs[0].stiffness.breaks, std::vector<double>{0.0005});
  EXPECT_EQ(model.adc[0]->per_count, 0.025);
  EXPECT_EQ(*model.adc[0]->filter, 1000.0);
}

TEST(ModelQuantities, OverrideParameters) {
  const std::vector<Override> overrides = {{"m", "3.5 kg"}, {"k", "0.2 N/mm"}};
  const Model model = load_model(write_model(kPlant), overrides);
  EXPECT_EQ(model.bodies[0].mass, 3.5);
  EXPECT_EQ(model.springs[0].stiffness.slopes[0], 200.0);
}

// A name stands for what the other overrides make of it, wherever it stands among them.
TEST(ModelQuantities, AnOverrideMayNameAParameter) {
  const auto path = write_model("[parameters]\nspare = { value = 1, unit = \"kg\" }\n", "shared");
  const std::string text = "parameters_file = \"" + path.filename().string() + "\"\n" + kPlant;
  const std::vector<Override> overrides = {{"m", "spare"}, {"spare", 7.0}};
  const Model model = load_model(write_model(text), overrides);
  EXPECT_EQ(model.bodies[0].mass, 7.0);
}

TEST(ModelQuantities, OfAnotherDimensionAreRefused) {
  const std::string advice = "; correct the value or its unit";
  EXPECT_EQ(refusal("\"-2 mm\"", "\"-2 N\""),
            "body[0].position: expected a length in m, got \"-2 N\", a force" + advice);
  EXPECT_EQ(refusal("\"-2 mm\"", "\"2\""),
            "body[0].position: expected a length in m, got \"2\" without a unit" + advice);
  EXPECT_EQ(refusal("\"2500 g\"", "\"2500 lb\""),
            "parameters.m.value: expected a mass in kg, got \"2500 lb\", whose unit is not known" +
                advice);
  EXPECT_EQ(refusal("mass = \"m\"", "mass = \"-3 kg\""),
            "body[0].mass: expected a finite number > 0 in kg, got -3 (\"-3 kg\"); correct the "
            "value or its sign");
  EXPECT_EQ(refusal("mass", "mass", {{"m", "3 N"}}),
            "set.m: expected a mass in kg, got \"3 N\", a force" + advice);
  EXPECT_EQ(refusal("mass", "mass", {{"m", "k"}}),
            "set.m: expected a parameter in kg, got k in N/m; refer to another parameter");
  EXPECT_EQ(refusal("mass", "mass", {{"m", "mm"}}),
            "set.m: expected a mass in kg or a parameter out of k, m, got \"mm\"; correct the "
            "override's value");
}

TEST(ModelRefusesAtOnce, EveryNameThatIsWrong) {
  EXPECT_EQ(refusal("mass", "mass", {{"mm", 1.0}, {"kk", 1.0}, {"stiffness", 1.0}}),
            "set.mm: expected one of the parameters k, m, got \"mm\", \"kk\", \"stiffness\"; "
            "correct the override's name");
  EXPECT_EQ(refusal("position", "pos = 1\nposi = 2\npositoin"),
            "body[0].pos: expected one of the keys name, mass, inertia, r_trans, position, "
            "velocity, got \"pos\", "
            "\"posi\", \"positoin\"; did you mean position?; remove or rename these keys");
  EXPECT_EQ(refusal("mass =", "mas ="),
            "body[0].mas: expected one of the keys name, mass, inertia, r_trans, position, "
            "velocity, got \"mas\"; did you mean mass?; remove or rename this key");
}

TEST(ModelRefusesAtOnce, EveryParameterThatIsNotUsed) {
  const std::string spare = "[parameters]\nx = { value = 1, unit = \"kg\" }\n";
  EXPECT_EQ(refusal("[parameters]\n", spare),
            "parameters.x: expected a parameter that this model uses, got an unused parameter; "
            "remove the parameter, use its name, or mark it with documentation = true");
  EXPECT_EQ(
      refusal("[parameters]\n", spare + "y = { value = 1, unit = \"kg\" }\n"),
      "parameters.x: expected parameters that this model uses, got x, y, which are "
      "unused; remove these parameters, use their names, or mark them with documentation = true");
}

}  // namespace
}  // namespace forceaxis::sim::test
