// What a model file may say, and the one line that answers everything else.
#include "sim/model/model.hpp"

#include <limits>
#include <string>
#include <vector>

#include "sim/model/elements/all.hpp"
#include "sim/model/section.hpp"
#include "sim/model/toml.hpp"
#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

const std::string kAxis = R"(title = "t"
[parameters]
m = { value = 2, unit = "kg", source = "scale" }
k = { value = 100, unit = "N/m" }
[[body]]
name = "robot"
mass = "m"
[[spring]]
name = "post"
between = ["robot", "ground"]
stiffness = "k"
)";

// The text with one part replaced.
std::string with(std::string text, const std::string &part, const std::string &by) {
  const auto at = text.find(part);
  EXPECT_NE(at, std::string::npos) << part;
  return text.replace(at, part.size(), by);
}

struct Refusal {
  std::string key;
  std::string message;
};

void expect_refusal(const std::string &text, const Refusal &expected,
                    const std::vector<Override> &overrides = {}) {
  const auto path = write_model(text);
  try {
    (void)load_model(path, overrides);
    ADD_FAILURE() << "accepted:\n" << text;
  } catch (const InputError &error) {
    EXPECT_EQ(error.file, path.string());
    EXPECT_EQ(error.key, expected.key);
    EXPECT_EQ(error.message, expected.message);
    EXPECT_EQ(std::string(error.what()),
              path.string() + ": " + expected.key + ": " + expected.message);
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
  }
}

TEST(Model, ReadsWhatItSays) {
  const Model model = load_model(write_model(kAxis));
  EXPECT_EQ(model.title, "t");
  ASSERT_EQ(model.bodies.size(), 1U);
  EXPECT_EQ(model.bodies[0].mass, 2.0);
  EXPECT_EQ(model.springs[0].ends.a, 0);
  EXPECT_EQ(model.springs[0].ends.b, kGround);
  EXPECT_EQ(model.springs[0].stiffness.slopes, std::vector<double>{100.0});
  EXPECT_EQ(model.springs[0].damping, 0.0);
  ASSERT_EQ(model.parameters.size(), 2U);
  EXPECT_FALSE(model.drive.has_value());
  EXPECT_EQ(model.dac->volts_per_code(), 20.0 / 4096.0);
  EXPECT_EQ(model.point_index("robot"), 0);
  EXPECT_THROW((void)model.point_index("rabbit"), std::invalid_argument);
}

TEST(Model, ParameterSigns) {
  const Model model = load_model(write_model(
      with(with(kAxis, "k = { value", "x = { value = 0.25, unit = \"m\" }\nk = { value"),
           "mass = \"m\"", "mass = \"m\"\nposition = \"-x\"")));
  EXPECT_EQ(model.bodies[0].position, -0.25);
}

TEST(Model, Overrides) {
  const auto path = write_model(kAxis);
  const std::vector<Override> overrides = {{"m", 3.5}};
  const Model model = load_model(path, overrides);
  EXPECT_EQ(model.bodies[0].mass, 3.5);
  for (const Parameter &parameter : model.parameters) {
    EXPECT_EQ(parameter.overridden, parameter.name == "m");
    EXPECT_TRUE(parameter.used);
  }
  expect_refusal(kAxis,
                 {"parameters.mm",
                  "expected one of the parameters k, m, got \"mm\"; correct the "
                  "override's name"},
                 {{"mm", 1.0}});
  expect_refusal(
      kAxis,
      {"parameters.m", "expected a finite number in kg, got nan; correct the override's value"},
      {{"m", std::numeric_limits<double>::quiet_NaN()}});
  expect_refusal(kAxis,
                 {"body[0].mass",
                  "expected a finite number > 0 in kg, got -1 (parameter m); "
                  "correct the value or its sign"},
                 {{"m", -1.0}});
}

TEST(Model, SharedParameters) {
  const auto shared = write_model(
      "title = \"all\"\n[parameters]\nm = { value = 9, unit = \"kg\", source = \"a\" }\n"
      "k = { value = 7, unit = \"N/m\", source = \"b\" }\n"
      "spare = { value = 1, unit = \"V\", source = \"c\" }\n",
      "shared");
  const std::string own = with(with(kAxis, "title = \"t\"", "parameters_file = \"shared.toml\""),
                               "k = { value = 100, unit = \"N/m\" }\n", "");
  const Model model = load_model(write_model(own));
  EXPECT_EQ(model.bodies[0].mass, 2.0);                                    // its own wins
  EXPECT_EQ(model.springs[0].stiffness.slopes, std::vector<double>{7.0});  // from the shared file
  for (const Parameter &parameter : model.parameters)
    EXPECT_EQ(parameter.used, parameter.name != "spare");

  expect_refusal(with(own, "shared.toml", "missing.toml"),
                 {"parameters_file",
                  "expected a readable file in the folder of this file, got "
                  "\"missing.toml\"; check the path"});
  // A fault in the shared file is reported there.
  write_model("[parameters]\nm = { value = 9, unit = \"kgs\" }\n", "shared");
  try {
    (void)load_model(write_model(own));
    FAIL();
  } catch (const InputError &error) {
    EXPECT_EQ(error.file, shared.string());
    EXPECT_EQ(error.key, "parameters.m.unit");
  }
}

TEST(ModelRefuses, UnknownKeysAnywhere) {
  expect_refusal(
      "weight = 1\n" + kAxis,
      {"weight",
       "expected one of the keys title, shows, parameters_file, parameters, body, structure, "
       "spring, damper, contact, backlash, stop, friction, brake, gravity, cogging, "
       "external, drive, machine_controller, encoder, "
       "switches, adc, dac, got \"weight\"; remove or "
       "rename this key"});
  expect_refusal(with(kAxis, "mass =", "mess = 1\nmass ="),
                 {"body[0].mess",
                  "expected one of the keys name, mass, inertia, r_trans, position, velocity, got "
                  "\"mess\"; did you "
                  "mean mass?; remove or rename this key"});
  expect_refusal(with(kAxis, "stiffness = \"k\"", "stiffness = \"k\"\nstifness = 1"),
                 {"spring[0].stifness",
                  "expected one of the keys name, between, stiffness, loads, breaks, damping, "
                  "maxwell_stiffness, maxwell_time, got "
                  "\"stifness\"; "
                  "did you mean stiffness?; remove or rename this key"});
  expect_refusal(with(kAxis, ", source = \"scale\"", ", origin = \"scale\""),
                 {"parameters.m.origin",
                  "expected one of the keys value, unit, source, documentation, got \"origin\"; "
                  "remove or rename "
                  "this key"});
  expect_refusal(kAxis + "[dac]\nbit = 12\n",
                 {"dac.bit",
                  "expected one of the keys bits, range, offset, noise, got \"bit\"; did you mean "
                  "bits?; remove or rename this key"});
  const std::string structure = "[[structure]]\nname = \"x\"\nports = [\"p\"]\n";
  expect_refusal(
      kAxis + structure,
      {"structure[0].mode", "expected at least one mode, got none; add [[structure.mode]]"});
  expect_refusal(kAxis + structure + "prots = 1\n",
                 {"structure[0].prots",
                  "expected one of the keys name, ports, mode, got \"prots\"; did you mean ports?; "
                  "remove or rename this key"});
  expect_refusal(kAxis + structure + "[[structure.mode]]\nfrequency = 1\nshape = 1\nmass = 2\n",
                 {"structure[0].mode[0].mass",
                  "expected one of the keys frequency, damping_ratio, modal_mass, shape, got "
                  "\"mass\"; remove or rename this key"});
  expect_refusal(kAxis + "\"two\\nlines\" = 1\n",
                 {"spring[0].two lines",
                  "expected one of the keys name, between, stiffness, loads, breaks, damping, "
                  "maxwell_stiffness, maxwell_time, got "
                  "\"two lines\"; "
                  "remove or rename this key"});
}

TEST(ModelRefuses, WrongUnits) {
  expect_refusal(with(kAxis, "stiffness = \"k\"", "stiffness = \"m\""),
                 {"spring[0].stiffness",
                  "expected a parameter in N/m, got m in kg; correct parameters.m.unit or refer to "
                  "another parameter"});
  const auto path = write_model(with(kAxis, "unit = \"kg\"", "unit = \"lb\""));
  try {
    (void)load_model(path);
    FAIL();
  } catch (const InputError &error) {
    EXPECT_EQ(error.key, "parameters.m.unit");
    EXPECT_EQ(error.message.rfind("expected one of 1, V/V, count, kg, m, s, m/s, N, J, N m,", 0),
              0U);
    EXPECT_NE(error.message.find("got \"lb\"; use one of these spellings"), std::string::npos);
  }
}

TEST(ModelRefuses, ValuesOutOfRange) {
  const std::string mass = "; correct the value or its sign";
  expect_refusal(
      with(kAxis, "value = 2,", "value = 0,"),
      {"body[0].mass", "expected a finite number > 0 in kg, got 0 (parameter m)" + mass});
  expect_refusal(with(kAxis, "mass = \"m\"", "mass = -3.5"),
                 {"body[0].mass", "expected a finite number > 0 in kg, got -3.5" + mass});
  expect_refusal(with(kAxis, "mass = \"m\"", "mass = nan"),
                 {"body[0].mass", "expected a finite number > 0 in kg, got nan" + mass});
  expect_refusal(with(kAxis, "mass = \"m\"", "mass = inf"),
                 {"body[0].mass", "expected a finite number > 0 in kg, got inf" + mass});
  expect_refusal(
      with(kAxis, "mass = \"m\"", "mass = 1e40"),
      {"body[0].mass", "expected a size between 1e-30 and 1e30, got 1e+40; check the exponent"});
  expect_refusal(with(kAxis, "stiffness = \"k\"", "stiffness = \"-k\""),
                 {"spring[0].stiffness",
                  "expected a finite number >= 0 in N/m, got -100 (parameter k)" + mass});
  expect_refusal(with(kAxis, "stiffness = \"k\"", "stiffness = \"k\"\ndamping = -1"),
                 {"spring[0].damping", "expected a finite number >= 0 in N s/m, got -1" + mass});
  expect_refusal(
      with(kAxis, "value = 2,", "value = nan,"),
      {"parameters.m.value", "expected a finite number, got nan; give the parameter's value"});
  expect_refusal(with(kAxis, "mass = \"m\"", "mass = true"),
                 {"body[0].mass",
                  "expected a finite number > 0 in kg or a parameter's name, got "
                  "true; give a number or a string"});
  expect_refusal(kAxis + "[dac]\nbits = 20\n",
                 {"dac.bits", "expected an integer 8..16, got 20; choose a value in that range"});
  const std::string adc = "[[adc]]\nchannel = 0\nsignal = \"robot.position\"\nper_count = 1\n";
  for (const std::string zero : {"256", "-1", "0.5"})
    expect_refusal(kAxis + adc + "zero_code = " + zero + "\n",
                   {"adc[0].zero_code",
                    "expected a whole number 0..255, got " + zero + "; choose a code of this ADC"});
  expect_refusal(kAxis + "[dac]\nbits = 12.0\n",
                 {"dac.bits", "expected an integer 8..16, got 12; give an integer"});
}

TEST(ModelRefuses, UnknownNames) {
  expect_refusal(with(kAxis, "[\"robot\", \"ground\"]", "[\"robott\", \"ground\"]"),
                 {"spring[0].between[0]",
                  "expected one of robot, ground, got \"robott\"; did you mean robot?; give one of "
                  "these names"});
  expect_refusal(with(kAxis, "mass = \"m\"", "mass = \"mass_r\""),
                 {"body[0].mass",
                  "expected a finite number > 0 in kg or a parameter out of k, m, got \"mass_r\"; "
                  "define the parameter or correct its name"});
  expect_refusal(kAxis + "[[adc]]\nchannel = 0\nsignal = \"post.farce\"\nper_count = 1\n",
                 {"adc[0].signal",
                  "expected one of robot.position, robot.velocity, robot.acceleration, post.force, "
                  "post.spring_force, "
                  "post.spring_force_rate, post.deflection, got \"post.farce\"; did you mean "
                  "post.force?; name a signal of "
                  "this model"});
  expect_refusal(
      kAxis + "[drive]\ntype = \"steam\"\nbody = \"robot\"\n",
      {"drive.type",
       "expected one of dc_motor, first_order, perfect, torque, velocity, stepper, got \"steam\"; "
       "choose a drive type"});
  expect_refusal(
      kAxis + "[encoder]\nbody = \"ground\"\nscale = 1\n",
      {"encoder.body", "expected one of robot, got \"ground\"; give one of these names"});
}

TEST(ModelRefuses, DuplicatesAndReservedNames) {
  expect_refusal(with(kAxis, "name = \"post\"", "name = \"robot\""),
                 {"spring[0].name",
                  "expected a name that no other element has, got \"robot\" "
                  "again; rename one element"});
  expect_refusal(with(kAxis, "name = \"post\"", "name = \"ground\""),
                 {"spring[0].name",
                  "expected a name other than the reserved ground and drive, got "
                  "\"ground\"; rename this element"});
  expect_refusal(with(kAxis, "name = \"post\"", "name = \"a post\""),
                 {"spring[0].name",
                  "expected a name of letters, digits and _ that begins with a "
                  "letter or _ (at most 64), got \"a post\"; rename this "
                  "element"});
  const std::string adc = "[[adc]]\nchannel = 0\nsignal = \"post.force\"\nper_count = 1\n";
  expect_refusal(kAxis + adc + adc, {"adc[1].channel",
                                     "expected a channel not used before, got 0 again; there are "
                                     "channels 0 and 1"});
}

TEST(ModelRefuses, DisconnectedBodies) {
  const std::string two =
      "[[body]]\nname = \"a\"\nmass = 1\n[[body]]\nname = \"b\"\nmass = 1\n"
      "[[damper]]\nname = \"d\"\nbetween = [\"a\", \"ground\"]\ndamping = 1\n";
  expect_refusal(two, {"body[1].name",
                       "expected a body tied to ground by springs, other elements or the drive, "
                       "got \"b\" disconnected; connect or remove it"});
  // A pair that floats together is no better.
  expect_refusal(two +
                     "[[body]]\nname = \"c\"\nmass = 1\n[[spring]]\nname = \"s\"\n"
                     "between = [\"b\", \"c\"]\nstiffness = 1\n",
                 {"body[1].name",
                  "expected a body tied to ground by springs, other elements or the drive, got "
                  "\"b\" disconnected; connect or remove it"});
  expect_refusal(with(kAxis, "[\"robot\", \"ground\"]", "[\"robot\", \"robot\"]"),
                 {"spring[0].between",
                  "expected two different names out of robot, ground, got the "
                  "same name twice; connect two bodies"});
  expect_refusal("title = \"empty\"\n",
                 {"body", "expected 1..32 bodies, got 0; add or remove [[body]] tables"});
}

TEST(ModelRefuses, MissingAndUnused) {
  expect_refusal(with(kAxis, "mass = \"m\"\n", ""),
                 {"body[0].mass",
                  "expected a finite number > 0 in kg or a parameter, got nothing; "
                  "add this key"});
  expect_refusal(with(kAxis, "between = [\"robot\", \"ground\"]\n", ""),
                 {"spring[0].between",
                  "expected two different names out of robot, ground, got "
                  "nothing; add this key"});
  expect_refusal(
      with(kAxis, "k = { value", "spare = { value = 1, unit = \"V\" }\nk = { value"),
      {"parameters.spare",
       "expected a parameter that this model uses, got an unused parameter; remove the parameter, "
       "use its name, or mark it with documentation = true"});
  std::string motor = motor_drive("robot");
  expect_refusal(kAxis + with(motor, "k_torque = 0.5\n", ""),
                 {"drive.k_torque",
                  "expected a finite number > 0 in N m/A or a parameter, got "
                  "nothing; add this key"});
  expect_refusal(kAxis + motor + "input = \"brake\"\n",
                 {"drive.input",
                  "expected one of command, tach, got \"brake\"; choose the use "
                  "of the DAC voltage"});
  expect_refusal(kAxis + with(motor, "amp_break = 2\n", ""),
                 {"drive.amp_break",
                  "expected a finite number > 0 in V beside k_amp_outer, got "
                  "nothing; add this key or remove k_amp_outer"});
  expect_refusal(kAxis + with(motor, "[drive]\n", "[drive]\nreaction = \"robot\"\n"),
                 {"drive.reaction",
                  "expected another body than drive.body or ground, got "
                  "\"robot\"; choose the body on which the reaction force acts"});
}

TEST(ModelRefuses, BrokenFiles) {
  const auto path = write_model(kAxis.substr(0, kAxis.find(", source")));
  try {
    (void)load_model(path);
    FAIL();
  } catch (const InputError &error) {
    EXPECT_EQ(error.key.rfind("line 3, column ", 0), 0U) << error.key;
    EXPECT_EQ(error.message.rfind("expected valid TOML, got: ", 0), 0U) << error.message;
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
  }
  expect_refusal("body = 3\n", {"body", "expected a list of tables, got 3; write [[body]]"});
  expect_refusal("parameters = 3\n",
                 {"parameters", "expected a table of parameters, got 3; write [parameters]"});
  expect_refusal("body = [3]\n", {"body[0]", "expected a table, got 3; write [body[0]]"});
  const auto missing = path.parent_path() / "nowhere.toml";
  try {
    (void)load_model(missing);
    FAIL();
  } catch (const InputError &error) {
    EXPECT_EQ(std::string(error.what()),
              missing.string() + ": file: expected a readable file, got none; check the path");
  }
}

// toml++ asserts where a value is expected and another character stands.
TEST(ModelRefuses, ACharacterThatBeginsNoValue) {
  try {
    (void)parse_toml_text("a = 1\nb = [\n  2, }\n]\nc = 3\n", "some.toml");
    FAIL();
  } catch (const InputError &error) {
    EXPECT_EQ(
        std::string(error.what()),
        "some.toml: line 3: expected a value, got a character that starts no value; correct this "
        "line");
  }
}

// Every text of up to four of these pieces is a table or an InputError.
TEST(ModelRefuses, AnyRowOfBracketsAndMarks) {
  const std::vector<std::string> pieces{"[", "]", "{",  "}",  ",", "=",
                                        "a", "1", "\"", "\n", " ", "."};
  std::size_t tables = 0, refused = 0;
  for (std::size_t count = 1; count <= 4; ++count) {
    std::size_t texts = 1;
    for (std::size_t i = 0; i < count; ++i) texts *= pieces.size();
    for (std::size_t number = 0; number < texts; ++number) {
      std::string text = "a = ";
      for (std::size_t i = 0, rest = number; i < count; ++i, rest /= pieces.size())
        text += pieces[rest % pieces.size()];
      try {
        (void)parse_toml_text(text, "some.toml");
        ++tables;
      } catch (const InputError &) {
        ++refused;
      }
    }
  }
  EXPECT_GT(tables, 100U);
  EXPECT_GT(refused, 10000U);
}

// Whatever is cut off or garbled, the answer is a model or an InputError.
TEST(ModelRefuses, AnyTruncationOrFlippedByte) {
  std::ifstream stream(FORCEAXIS_MODELS "/axis_contact.toml");
  const std::string text{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  ASSERT_GT(text.size(), 1000U);
  const auto attempt = [](const std::string &changed) {
    try {
      (void)load_model(write_model(changed));
    } catch (const InputError &error) {
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
      EXPECT_FALSE(error.key.empty());
    }
  };
  for (std::size_t length = 0; length < text.size(); length += 37) attempt(text.substr(0, length));
  for (std::size_t i = 0; i < text.size(); i += 41) {
    std::string changed = text;
    changed[i] = static_cast<char>(changed[i] ^ (1 << (i % 8)));
    attempt(changed);
  }
}

TEST(Units, EverySpellingHasADimensionAndBack) {
  EXPECT_EQ(dimension_of("kg/s"), Dimension::damping);
  EXPECT_EQ(unit_of(Dimension::damping), "N s/m");
  EXPECT_FALSE(dimension_of("furlong").has_value());
  for (int i = 0; i <= static_cast<int>(Dimension::velocity_per_count); ++i) {
    const auto dimension = static_cast<Dimension>(i);
    EXPECT_EQ(dimension_of(unit_of(dimension)), dimension);
  }
}

}  // namespace
}  // namespace forceaxis::sim::test
