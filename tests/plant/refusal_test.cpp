// Bad input for every key of every element: one line that names file and key.
#include <string>
#include <vector>

#include "sim/model/model.hpp"
#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

enum class Value { any, not_zero, not_negative, positive };

struct Key {
  std::string name;
  std::string good;
  Value value;
  bool required = true;
  bool list = false;  // may be a list too
};

struct Element {
  std::string head;   // [[friction]]
  std::string path;   // friction[0]
  std::string fixed;  // keys that are not numbers
  std::vector<Key> keys;
  std::string text(const std::string &key = "", const std::string &value = "") const {
    std::string lines = head + "\n" + fixed;
    for (const Key &k : keys) {
      const std::string &now = k.name == key ? value : k.good;
      if (!now.empty()) lines += k.name + " = " + now + "\n";
    }
    return lines;
  }
};

const std::string kBodies =
    "[[body]]\nname = \"a\"\nmass = 1\n[[body]]\nname = \"b\"\nmass = 1\n[[body]]\nname = \"c\"\n"
    "mass = 1\n"
    "[[spring]]\nname = \"s\"\nbetween = [\"a\", \"ground\"]\nstiffness = 1\n"
    "[[spring]]\nname = \"t\"\nbetween = [\"a\", \"b\"]\nstiffness = 1\n"
    "[[spring]]\nname = \"u\"\nbetween = [\"b\", \"c\"]\nstiffness = 1\n";
const std::string kLink = "name = \"x\"\nbetween = [\"a\", \"b\"]\n";

std::vector<Element> elements() {
  const Key stiff{"stiffness", "100", Value::positive};
  const Key stiffs{"stiffness", "100", Value::positive, true, true};
  const Key damped{"damping", "1", Value::not_negative, false};
  const Key limit{"force_limit", "3", Value::positive, false};
  const std::string drive = "type = \"perfect\"\nbody = \"a\"\n";
  const std::string simple = "type = \"first_order\"\nbody = \"a\"\nreaction = \"b\"\n";
  return {
      {"[[spring]]",
       "spring[3]",
       kLink,
       {{"stiffness", "100", Value::not_negative, true, true}, damped}},
      {"[[damper]]", "damper[0]", kLink, {{"damping", "1", Value::not_negative, true, true}}},
      {"[[contact]]", "contact[0]", kLink, {stiffs, damped, {"gap", "0.1", Value::any, false}}},
      {"[[contact]]",
       "contact[0]",
       kLink,
       {stiffs,
        {"maxwell_stiffness", "10", Value::positive, false},
        {"maxwell_time", "0.1", Value::positive}}},
      {"[[contact]]",
       "contact[0]",
       kLink,
       {stiffs,
        {"hysteresis_stiffness", "10", Value::positive, false},
        {"hysteresis_force", "0.1", Value::positive}}},
      {"[[structure]]",
       "structure[0]",
       "name = \"x\"\nports = [\"p\"]\nmode = [{ frequency = 1, shape = 1 }]\n",
       {}},
      {"[[structure]]\nname = \"y\"\nports = [\"p\", \"q\"]\n[[structure.mode]]",
       "structure[0].mode[0]",
       "",
       {{"frequency", "31", Value::not_negative},
        {"damping_ratio", "0.01", Value::not_negative, false},
        {"modal_mass", "2", Value::positive, false},
        {"shape", "[1, -0.5]", Value::any, true, true}}},
      {"[[cogging]]",
       "cogging[0]",
       kLink,
       {{"force", "3", Value::any, true, true},
        {"period", "0.03", Value::positive},
        {"position", "0.01", Value::any, false},
        {"from", "-0.1", Value::any},
        {"to", "0.1", Value::any}}},
      {"[[backlash]]",
       "backlash[0]",
       kLink,
       {stiff, damped, {"width", "0.1", Value::not_negative}}},
      {"[[stop]]",
       "stop[0]",
       kLink,
       {stiff, damped, {"low", "-0.1", Value::any, false}, {"high", "0.1", Value::any, false}}},
      {"[[friction]]",
       "friction[0]",
       kLink,
       {{"coulomb", "3", Value::not_negative}, {"stiction", "4", Value::not_negative, false}}},
      {"[[brake]]",
       "brake[0]",
       kLink,
       {{"holding", "3", Value::positive},
        {"release", "0.05", Value::not_negative, false},
        {"engage", "0.03", Value::not_negative, false}}},
      {"[[gravity]]",
       "gravity[0]",
       "name = \"x\"\nbody = \"a\"\n",
       {{"acceleration", "-9.81", Value::any, true, true}}},
      {"[drive]", "drive", drive, {{"force_per_volt", "2", Value::not_zero}, limit}},
      {"[drive]",
       "drive",
       simple,
       {{"k_act", "2", Value::positive},
        {"a_act", "2", Value::positive},
        {"velocity_per_volt", "2", Value::not_zero},
        limit}},
      {"[drive]",
       "drive",
       "type = \"torque\"\nbody = \"a\"\n",
       {{"current_per_volt", "2", Value::not_zero},
        {"k_force", "2", Value::positive},
        {"current_bandwidth", "2", Value::positive},
        {"peak_current", "2", Value::positive, false},
        {"rated_current", "1", Value::positive, false},
        {"peak_time", "2", Value::positive},
        {"damping", "2", Value::not_negative, false}}},
      {"[drive]",
       "drive",
       "type = \"velocity\"\nbody = \"a\"\nk_torque = 1\ntuned_inertia = 1\n",
       {{"velocity_per_volt", "2", Value::not_zero},
        {"r_trans", "2", Value::positive},
        {"current_bandwidth", "2000", Value::positive},
        {"bandwidth", "2", Value::positive, false}}},
      {"[drive]",
       "drive",
       "type = \"velocity\"\nbody = \"a\"\nk_force = 1\n",
       {{"velocity_per_volt", "2", Value::not_zero},
        {"current_bandwidth", "2000", Value::positive},
        {"k_velocity", "2", Value::positive},
        {"integral_time", "2", Value::positive, false}}},
      {"[drive]",
       "drive",
       "type = \"stepper\"\nbody = \"a\"\n",
       {{"velocity_per_volt", "2", Value::not_zero},
        {"holding_force", "100", Value::positive},
        {"full_step", "2.5e-5", Value::positive},
        {"damping", "2", Value::not_negative, false}}},
      {"[encoder]",
       "encoder",
       "body = \"a\"\nreference = \"b\"\n",
       {{"scale", "1000", Value::not_zero}}},
      {"[encoder]\nbody=\"c\"\nscale = 1000\n[switches]",
       "switches",
       "",
       {{"limit_neg", "-1", Value::any, false},
        {"limit_pos", "1e30", Value::any, false},
        {"home_from", "-1", Value::any, false},
        {"home_to", "1e30", Value::any, false},
        {"index", "0.1", Value::any, false},
        {"index_every", "0.01", Value::positive, false}}},
      {"[[adc]]",
       "adc[0]",
       "channel = 1\nsignal = \"s.force\"\ncreep = 0.001\n",
       {{"per_count", "2", Value::not_zero},
        {"zero_code", "128", Value::not_negative, false},
        {"sensor_limit", "50", Value::positive, false},
        {"filter", "600", Value::positive, false},
        {"conditioning_limit", "40", Value::positive, false},
        {"noise", "0.5", Value::not_negative, false},
        {"creep_time", "600", Value::positive},
        {"drift", "2", Value::any, false},
        {"drift_time", "600", Value::positive},
        {"sample_rate", "1000", Value::positive, false}}},
      {"[dac]",
       "dac",
       "bits = 12\n",
       {{"range", "10", Value::positive, false},
        {"offset", "0.1", Value::any, false},
        {"noise", "0.01", Value::not_negative, false}}},
  };
}

// Empty if it is refused as it should be.
std::string complaint(const std::string &text, const std::string &key) {
  const auto path = write_model(kBodies + text);
  try {
    (void)load_model(path);
    return "accepted";
  } catch (const InputError &error) {
    const std::string line = error.what();
    if (error.file != path.string()) return "names file " + error.file;
    if (error.key != key) return "names key " + error.key + ": " + line;
    if (line.find('\n') != std::string::npos) return "more than a line: " + line;
    if (error.message.rfind("expected ", 0) != 0) return "does not say what was expected: " + line;
    if (error.message.find(", got ") == std::string::npos)
      return "does not say what it got: " + line;
    if (error.message.find("; ") == std::string::npos) return "does not say what to do: " + line;
    return "";
  }
}

TEST(ElementRefuses, EveryWrongNumber) {
  int cases = 0;
  for (const Element &element : elements()) {
    ASSERT_NO_THROW((void)load_model(write_model(kBodies + element.text()))) << element.text();
    for (const Key &key : element.keys) {
      std::vector<std::string> wrong = {"nan",  "inf",        "-inf", "true",  "{}",   "1979-05-27",
                                        "\"\"", "\"nosuch\"", "1e31", "1e-31", "-1e31"};
      if (key.value != Value::any && key.value != Value::not_zero) {
        wrong.emplace_back("-1");
        wrong.emplace_back("-1e-3");
      }
      if (key.value == Value::not_zero || key.value == Value::positive) wrong.emplace_back("0");
      if (!key.list) {
        wrong.emplace_back("[1]");
        wrong.emplace_back("[]");
      }
      if (key.required) wrong.emplace_back("");
      for (const std::string &value : wrong) {
        EXPECT_EQ(complaint(element.text(key.name, value), element.path + "." + key.name), "")
            << element.text(key.name, value);
        ++cases;
      }
      if (!key.list) continue;
      EXPECT_EQ(complaint(element.text(key.name, "[]"), element.path + "." + key.name), "");
      for (const std::string &value : wrong) {
        if (value.empty()) continue;
        EXPECT_EQ(complaint(element.text(key.name, "[5, " + value + "]"),
                            element.path + "." + key.name + "[1]"),
                  "")
            << element.text(key.name, "[5, " + value + "]");
        ++cases;
      }
    }
    EXPECT_EQ(complaint(element.text() + "nonsense = 1\n", element.path + ".nonsense"), "");
  }
  EXPECT_GT(cases, 400);
}

TEST(ElementRefuses, EveryWrongNameAndEnd) {
  for (const Element &element : elements()) {
    const auto with = [&element](const std::string &part, const std::string &by) {
      std::string text = element.text();
      const auto at = text.find(part);
      return at == std::string::npos ? "" : text.replace(at, part.size(), by);
    };
    const auto refused = [&](const std::string &part, const std::string &by,
                             const std::string &key) {
      const std::string text = with(part, by);
      if (!text.empty()) {
        EXPECT_EQ(complaint(text, element.path + "." + key), "") << text;
      }
    };
    for (const char *name : {"name = \"a\"", "name = \"ground\"", "name = \"drive\"", "name = \"\"",
                             "name = \"two words\"", "name = 3", "name = \"x.low\"", ""})
      refused("name = \"x\"", name, "name");
    for (const char *ends : {"[\"a\"]", "[\"a\", \"b\", \"c\"]", "[]", "\"a\"", "3", "true", "{}",
                             "[\"a\", \"a\"]", "[\"ground\", \"ground\"]"})
      refused("[\"a\", \"b\"]", ends, "between");
    refused("between = [\"a\", \"b\"]\n", "", "between");
    refused("[\"a\", \"b\"]", "[\"nobody\", \"b\"]", "between[0]");
    refused("[\"a\", \"b\"]", "[\"a\", 3]", "between[1]");
    refused("[\"a\", \"b\"]", "[\"a\", \"s\"]", "between[1]");
    for (const char *body : {"body = \"nobody\"", "body = \"ground\"", "body = 3", ""})
      refused("body = \"a\"", body, "body");
    for (const char *body : {"reference = \"nobody\"", "reference = \"a\"", "reference = 3"})
      refused("reference = \"b\"", body, "reference");
    for (const char *body : {"reaction = \"nobody\"", "reaction = \"a\"", "reaction = 3"})
      refused("reaction = \"b\"", body, "reaction");
    // A table in place of a list, a list in place of a table, a number in place of either.
    const std::string kind = element.path.substr(0, element.path.find('['));
    const bool list = element.head[1] == '[';
    const std::string top = kind + " = 3\n";
    const auto path = write_model(top + kBodies);
    if (kind == "spring") continue;  // is there already: no valid TOML
    try {
      (void)load_model(path);
      ADD_FAILURE() << top;
    } catch (const InputError &error) {
      EXPECT_EQ(error.key, kind);
    }
    if (list) {
      EXPECT_EQ(complaint("[" + kind + "]\nname = \"x\"\n", kind), "") << kind;
    } else {
      EXPECT_EQ(complaint("[[" + kind + "]]\nbody = \"a\"\n", kind), "") << kind;
    }
  }
}

TEST(ElementRefuses, WhatDoesNotFitTogether) {
  const std::string spring = "[[spring]]\n" + kLink;
  const std::string damper = "[[damper]]\n" + kLink;
  const std::string stop = "[[stop]]\nstiffness = 1\n" + kLink;
  const std::string friction = "[[friction]]\n" + kLink;
  const std::string gravity = "[[gravity]]\nname = \"x\"\nbody = \"a\"\n";
  const std::string contact = "[[contact]]\nstiffness = 1\n" + kLink;
  const std::string jenkins = "hysteresis_stiffness = 1\nhysteresis_force = 1\n";
  const auto structure = [](const std::string &ports, const std::string &modes) {
    return "[[structure]]\nname = \"x\"\nports = " + ports + "\nmode = [" + modes + "]\n";
  };
  const std::string pair = "[\"p\", \"q\"]";
  const std::string mode = "{ frequency = 5, shape = [1, 2] }";
  const std::string held = structure(pair, mode);
  const auto rubs = [](const std::string &name, const std::string &port) {
    return "[[friction]]\nname = \"" + name + "\"\nbetween = [\"" + port +
           "\", \"ground\"]\ncoulomb = 1\n";
  };
  std::string many = mode;
  for (int i = 0; i < 32; ++i) many += ", " + mode;
  const std::string stepper =
      "[drive]\ntype = \"stepper\"\nbody = \"a\"\nvelocity_per_volt = 1\nholding_force = 1\n"
      "full_step = 1\n";
  const std::string adc = "[[adc]]\nchannel = 0\nsignal = \"s.force\"\nper_count = 1\n";
  const std::string encoder = "[encoder]\nbody = \"a\"\nscale = 1000\n";
  const std::vector<std::pair<std::string, std::string>> cases = {
      // piecewise-linear springs
      {spring + "stiffness = [1, 2]\n", "spring[3].stiffness"},
      {spring + "stiffness = 1\nbreaks = [1]\n", "spring[3].breaks"},
      {spring + "stiffness = [1, 2]\nbreaks = [1, 2]\n", "spring[3].breaks"},
      {spring + "stiffness = [1, 2, 3]\nbreaks = [1]\n", "spring[3].breaks"},
      {spring + "stiffness = [1, 2, 3]\nbreaks = [2, 1]\n", "spring[3].breaks[1]"},
      {spring + "stiffness = [1, 2, 3]\nbreaks = [1, 1]\n", "spring[3].breaks[1]"},
      {spring + "stiffness = [1, 2]\nbreaks = [nan]\n", "spring[3].breaks[0]"},
      {spring + "stiffness = [1, 2]\nbreaks = [\"nosuch\"]\n", "spring[3].breaks[0]"},
      {spring + "stiffness = [1, 2]\nbreaks = []\n", "spring[3].breaks"},
      {spring + "stiffness = [1, 2]\nbreaks = {}\n", "spring[3].breaks"},
      {spring + "stiffness = [1, 2]\nbreaks = [1]\nloads = [1]\n", "spring[3].loads"},
      {spring + "stiffness = [1, 0]\nloads = [1]\n", "spring[3].stiffness"},
      {spring + "stiffness = [1, 2]\nloads = [1, 2]\n", "spring[3].loads"},
      {spring + "stiffness = [1, 2, 3]\nloads = [2, 1]\n", "spring[3].loads[1]"},
      {spring + "stiffness = [1, 2]\nloads = [inf]\n", "spring[3].loads[0]"},
      {spring + "stiffness = [[1, 2], 3]\nbreaks = [1]\n", "spring[3].stiffness[0]"},
      {spring + "stiffness = 1\ndamping = [1, 2]\n", "spring[3].damping"},
      // and dampers
      {damper + "damping = [1, 2]\n", "damper[0].damping"},
      {damper + "damping = [1, 2]\nbreaks = [1, 2]\n", "damper[0].breaks"},
      {damper + "damping = [1, 2, 3]\nbreaks = [0, -1]\n", "damper[0].breaks[1]"},
      {damper + "damping = [1, -2]\nbreaks = [1]\n", "damper[0].damping[1]"},
      {damper + "damping = [1, 2]\nloads = [1]\n", "damper[0].loads"},
      // contacts with hysteresis
      {contact + "hysteresis_force = 1\n", "contact[0].hysteresis_force"},
      {contact + "hysteresis_stiffness = 1\n", "contact[0].hysteresis_force"},
      {contact + jenkins + "damping = 1\n", "contact[0].hysteresis_stiffness"},
      {contact + jenkins + "maxwell_stiffness = 1\nmaxwell_time = 1\n",
       "contact[0].hysteresis_stiffness"},
      {"[[contact]]\nstiffness = [1, 2]\nbreaks = [1]\n" + kLink + jenkins,
       "contact[0].hysteresis_stiffness"},
      // structures
      {structure(pair, ""), "structure[0].mode"},
      {"[[structure]]\nname = \"x\"\nports = [\"p\"]\n", "structure[0].mode"},
      {"[[structure]]\nname = \"x\"\nmode = [" + mode + "]\n", "structure[0].ports"},
      {structure("[]", mode), "structure[0].ports"},
      {structure("\"p\"", mode), "structure[0].ports"},
      {structure("[\"p\", 3]", mode), "structure[0].ports[1]"},
      {structure("[\"p\", \"p\"]", mode), "structure[0].ports[1]"},
      {structure("[\"p\", \"a\"]", mode), "structure[0].ports[1]"},
      {structure("[\"p\", \"x\"]", mode), "structure[0].ports[1]"},
      {structure("[\"two words\", \"q\"]", mode), "structure[0].ports[0]"},
      {structure("[\"ground\", \"q\"]", mode), "structure[0].ports[0]"},
      {structure(pair, "{ frequency = 5, shape = 1 }"), "structure[0].mode[0].shape"},
      {structure(pair, "{ frequency = 5, shape = [1, 2, 3] }"), "structure[0].mode[0].shape"},
      {structure(pair, mode + ", { frequency = -5, shape = [1, 2] }"),
       "structure[0].mode[1].frequency"},
      {structure(pair, "{ frequency = \"5 s\", shape = [1, 2] }"),
       "structure[0].mode[0].frequency"},
      {structure(pair, "{ frequency = 0, damping_ratio = 0.1, shape = [1, 2] }"),
       "structure[0].mode[0].damping_ratio"},
      {structure(pair, "{ frequency = 5, shape = [1, 0] }"), "structure[0].ports[1]"},
      {structure(pair, "{ frequency = 0, shape = [1, 2] }"), "structure[0].ports"},
      {structure(pair, many), "structure"},
      {held + "[[gravity]]\nname = \"g\"\nbody = \"p\"\nacceleration = 1\n", "gravity[0].body"},
      {held + "[[gravity]]\nname = \"g\"\nbody = \"x\"\nacceleration = 1\n", "gravity[0].body"},
      {held + "[[spring]]\nname = \"z\"\nbetween = [\"p\", \"x\"]\nstiffness = 1\n",
       "spring[3].between[1]"},
      {held + rubs("f", "p") + rubs("g", "q"), "friction[1].between"},
      {held + rubs("f", "p") + "[[brake]]\nname = \"g\"\nholding = 1\nbetween = " + pair + "\n",
       "brake[0].between"},
      // stops
      {stop, "stop[0].low"},
      {stop + "low = 1\nhigh = -1\n", "stop[0].high"},
      {stop + "low = 1\nhigh = 1\n", "stop[0].high"},
      // frictions
      {friction + "coulomb = 3\nstiction = 2\n", "friction[0].stiction"},
      {friction +
           "coulomb = 3\n[[friction]]\nname = \"y\"\nbetween = [\"b\", \"a\"]\ncoulomb = 1\n",
       "friction[1].between"},
      {friction + "coulomb = 3\n[[friction]]\nname = \"y\"\nbetween = [\"b\", \"ground\"]\n"
                  "coulomb = 1\n[[friction]]\nname = \"z\"\nbetween = [\"a\", \"ground\"]\n"
                  "coulomb = 1\n",
       "friction[2].between"},
      // brakes: one between two ends, beside at most one friction there
      {"[[brake]]\nholding = 3\nrelease = -1\n" + kLink, "brake[0].release"},
      {"[[brake]]\nholding = 3\n" + kLink +
           "[[brake]]\nname = \"y\"\nbetween = [\"b\", \"a\"]\nholding = 1\n",
       "brake[1].between"},
      {friction + "coulomb = 3\n[[friction]]\nname = \"y\"\nbetween = [\"b\", \"ground\"]\n"
                  "coulomb = 1\n[[brake]]\nname = \"z\"\nbetween = [\"a\", \"ground\"]\n"
                  "holding = 1\n",
       "brake[0].between"},
      // gravity
      {gravity + "acceleration = [1, 2]\n", "gravity[0].positions"},
      {gravity + "acceleration = 1\npositions = [1]\n", "gravity[0].positions"},
      {gravity + "acceleration = [1, 2]\npositions = [1, 2, 3]\n", "gravity[0].positions"},
      {gravity + "acceleration = [1, 2]\npositions = [2, 1]\n", "gravity[0].positions[1]"},
      {gravity + "acceleration = [1, 2]\npositions = [1, nan]\n", "gravity[0].positions[1]"},
      {gravity + "acceleration = [1, 2]\npositions = 3\n", "gravity[0].positions"},
      // sensors
      {adc + "zero_code = 256\n", "adc[0].zero_code"},
      {adc + "zero_code = 0.5\n", "adc[0].zero_code"},
      {adc + "bits = 7\n", "adc[0].bits"},
      {adc + "bits = 25\n", "adc[0].bits"},
      {adc + "bits = \"8\"\n", "adc[0].bits"},
      {adc + "bits = 24.5\n", "adc[0].bits"},
      {adc + "bits = 17\nzero_code = 131072\n", "adc[0].zero_code"},
      {adc + "bits = 24\nzero_code = 16777216\n", "adc[0].zero_code"},
      {adc + "sample_rate = 0.99\n", "adc[0].sample_rate"},
      {adc + "sample_rate = 30001\n", "adc[0].sample_rate"},
      {adc + "sample_rate = \"1 ms\"\n", "adc[0].sample_rate"},
      {adc + "sample_phase = 0.000667\n", "adc[0].sample_phase"},
      {adc + "sample_rate = 2000\nsample_phase = 5e-4\n", "adc[0].sample_phase"},
      {adc + "sample_rate = 1\nsample_phase = 1\n", "adc[0].sample_phase"},
      {adc + "sample_phase = \"1 Hz\"\n", "adc[0].sample_phase"},
      {adc + "latency = 0.1001\n", "adc[0].latency"},
      {adc + "latency = \"0.1 m\"\n", "adc[0].latency"},
      {adc + "converter_filter = \"sinc3\"\n", "adc[0].converter_filter"},
      {adc + "sample_rate = 1000\nconverter_filter = \"sinc2\"\n", "adc[0].converter_filter"},
      {adc + "sample_rate = 1000\nconverter_filter = 3\n", "adc[0].converter_filter"},
      {adc + "creep = 0.101\ncreep_time = 600\n", "adc[0].creep"},
      {adc + "creep = \"5 N\"\ncreep_time = 600\n", "adc[0].creep"},
      {adc + "creep = nan\ncreep_time = 600\n", "adc[0].creep"},
      {adc + "creep = 0.001\ncreep_time = 0.009\n", "adc[0].creep_time"},
      {adc + "creep_time = 600\n", "adc[0].creep_time"},
      {adc + "drift = \"1 mm\"\ndrift_time = 600\n", "adc[0].drift"},
      {adc + "drift = 1\ndrift_time = \"2 N\"\n", "adc[0].drift_time"},
      {adc + "drift_time = 600\n", "adc[0].drift_time"},
      {"[[adc]]\nchannel = 2\nsignal = \"s.force\"\nper_count = 1\n", "adc[0].channel"},
      {"[[adc]]\nchannel = -1\nsignal = \"s.force\"\nper_count = 1\n", "adc[0].channel"},
      {"[[adc]]\nchannel = 0\nsignal = \"s.farce\"\nper_count = 1\n", "adc[0].signal"},
      {"[[adc]]\nchannel = 0\nsignal = 3\nper_count = 1\n", "adc[0].signal"},
      {adc + adc, "adc[1].channel"},
      {encoder + "[switches]\nlimit_neg = 1\nlimit_pos = 1\n", "switches.limit_pos"},
      {encoder + "[switches]\nhome_from = 1\nhome_to = -1\n", "switches.home_to"},
      {encoder + "[switches]\nindex_every = 1\n", "switches.index_every"},
      {encoder + "[switches]\nlimit = 1\n", "switches.limit"},
      {"[switches]\nlimit_pos = 1\n", "switches"},
      {"[dac]\nbits = 7\n", "dac.bits"},
      {"[dac]\nbits = 17\n", "dac.bits"},
      {"[drive]\ntype = \"perfect\"\nbody = \"a\"\nforce_per_volt = 1\namp_break = 1\n",
       "drive.amp_break"},
      {motor_drive("a", "force_limit = 3\n"), "drive.force_limit"},
      {stepper + "segments = 0\n", "drive.segments"},
      {stepper + "segments = 3\n", "drive.segments"},
      {stepper + "segments = 30\n", "drive.segments"},
      {stepper + "segments = 16.0\n", "drive.segments"},
      {stepper + "segments = \"16\"\n", "drive.segments"},
      {stepper + "force_limit = 3\n", "drive.force_limit"},
      {stepper + "k_torque = 3\n", "drive.k_torque"},
      {stepper + "enable_ticks = -1\n", "drive.enable_ticks"},
      {motor_drive("a", "preamp_limit = 0\n"), "drive.preamp_limit"},
      {motor_drive("a", "current_feedback_limit = -1\n"), "drive.current_feedback_limit"},
  };
  for (const auto &[text, key] : cases) EXPECT_EQ(complaint(text, key), "") << text;
  for (const char *time : {"sample_phase", "latency"})
    for (const char *value : {"nan", "inf", "-inf", "-1e-3", "true", "{}", "[1]", "\"\"", "2"}) {
      const std::string text = adc + time + " = " + value + "\n";
      EXPECT_EQ(complaint(text, std::string("adc[0].") + time), "") << text;
    }
}

// The right parameter in the wrong unit, for every number that may be a parameter.
TEST(ElementRefuses, ParametersOfAnotherKind) {
  for (const Element &element : elements())
    for (const Key &key : element.keys) {
      const std::string unit = "[parameters]\np = { value = 1, unit = \"ohm\" }\n";
      EXPECT_EQ(complaint(element.text(key.name, "\"p\"") + unit, element.path + "." + key.name),
                "");
      EXPECT_EQ(complaint(element.text(key.name, "\"-p\"") + unit, element.path + "." + key.name),
                "");
    }
}

}  // namespace
}  // namespace forceaxis::sim::test
