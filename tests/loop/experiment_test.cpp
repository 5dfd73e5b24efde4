// Every mistake in an experiment is one line: file, key, what was expected.
#include "host/run/experiment.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "firmware/objects/generated/axis_objects.h"
#include "host/run/objects.hpp"
#include "host/run/plant_side.hpp"
#include "host/run/run.hpp"
#include "sim/model/elements/all.hpp"

namespace forceaxis::host {
namespace {

const char *const kGood = R"(title = "t"
model = "MODEL"
duration_s = 1.0
[set]
b_w = 363.0
[firmware]
mode = "force"
force_gain = 5.0
[[at]]
time_s = 0.5
firmware = { force_setpoint = 10.0 }
impulse = { body = "workpiece", N_s = "strike" }
[verdict]
window_s = 0.05
contact_held = true
)";

double parameter(const Experiment &experiment, std::string_view name) {
  for (const sim::Parameter &p : experiment.model->parameters)
    if (p.name == name) return p.value;
  return 0.0;
}

class Files : public testing::Test {
 protected:
  std::filesystem::path write(std::string text) {
    const auto at = text.find("MODEL");
    if (at != std::string::npos) text.replace(at, 5, SIM_DIR "/models/laboratory.toml");
    // Tests run side by side, each in a process of its own.
    const std::string name = testing::UnitTest::GetInstance()->current_test_info()->name();
    const auto path =
        std::filesystem::path(testing::TempDir()) / (name + std::to_string(::getpid()) + ".toml");
    std::ofstream(path) << text;
    return path;
  }
  static std::string with(const std::string &from, const std::string &to) {
    std::string text = kGood;
    const auto at = text.find(from);
    EXPECT_NE(at, std::string::npos);
    return text.replace(at, from.size(), to);
  }
  std::string refusal(const std::string &text, std::vector<std::string> overrides = {}) {
    const std::string line = message(text, std::move(overrides));
    return line.substr(0, line.find(": "));
  }
  // "KEY: MESSAGE" of what is refused.
  std::string message(const std::string &text, std::vector<std::string> overrides = {}) {
    try {
      load_experiment(write(text), overrides);
    } catch (const sim::InputError &error) {
      const std::string what = error.what();
      EXPECT_EQ(what.find('\n'), std::string::npos) << what;
      EXPECT_NE(what.find("expected"), std::string::npos) << what;
      return error.key + ": " + error.message;
    }
    return "accepted";
  }
};

TEST_F(Files, AGoodOneIsReadInRawUnitsWithTheModeLast) {
  const Experiment e = load_experiment(write(kGood));
  EXPECT_EQ(e.ticks, 1500);
  ASSERT_EQ(e.initial.size(), 2U);
  EXPECT_EQ(e.initial[0].object, AXIS_OBJ_FORCE_GAIN);
  EXPECT_EQ(e.initial[0].raw, 1280);
  EXPECT_EQ(e.initial[1].object, AXIS_OBJ_MODE);
  EXPECT_EQ(e.initial[1].raw, AXIS_MODE_FORCE);
  ASSERT_EQ(e.actions.size(), 1U);
  EXPECT_EQ(e.actions[0].tick, 750);
  EXPECT_EQ(e.actions[0].writes[0].raw, 2560);
  EXPECT_EQ(e.actions[0].impulse->body, "workpiece");
}

TEST_F(Files, ContactsThatMustHoldAreNamed) {
  const Experiment all = load_experiment(write(kGood));
  ASSERT_TRUE(all.criterion->contact_held);
  EXPECT_TRUE(all.criterion->contact_held->names.empty());
  for (const char *const one : {"contact_held = \"sensor\"", "contact_held = [\"sensor\"]"}) {
    const Experiment e = load_experiment(write(with("contact_held = true", one)));
    ASSERT_TRUE(e.criterion->contact_held);
    EXPECT_EQ(e.criterion->contact_held->names, std::vector<std::string>{"sensor"});
  }
}

TEST_F(Files, AModelOrAMeasurementIsNoExperiment) {
  EXPECT_EQ(refusal("[[body]]\nname = \"b\"\nmass = 1.0\n"), "body");
  EXPECT_EQ(refusal("model = \"m.toml\"\noutput = \"drive.tach\"\n"), "output");
}

TEST_F(Files, EachMistakeIsNamed) {
  EXPECT_EQ(refusal(with("title", "titel")), "titel");
  EXPECT_EQ(refusal(with("title = \"t\"\n", "")), "title");
  EXPECT_EQ(refusal(with("duration_s = 1.0", "duration_s = nan")), "duration_s");
  EXPECT_EQ(refusal(with("duration_s = 1.0", "duration_s = -1.0")), "duration_s");
  EXPECT_EQ(refusal(with("force_gain = 5.0", "force_gain = 256.0")), "firmware.force_gain");
  EXPECT_EQ(refusal(with("force_gain = 5.0", "force_gain = -1.0")), "firmware.force_gain");
  EXPECT_EQ(refusal(with("force_gain = 5.0", "force_gain = inf")), "firmware.force_gain");
  EXPECT_EQ(refusal(with("force_gain", "force_gian")), "firmware.force_gian");
  EXPECT_EQ(refusal(with("force_gain = 5.0", "fault = 1")), "firmware.fault");
  EXPECT_EQ(refusal(with("\"force\"", "\"forc\"")), "firmware.mode");
  EXPECT_EQ(refusal(with("\"workpiece\"", "\"wall\"")), "at[0].impulse.body");
  EXPECT_EQ(refusal(with("\"strike\"", "\"punch\"")), "at[0].impulse.N_s");
  EXPECT_EQ(refusal(with("window_s", "window")), "verdict.window");
  EXPECT_EQ(refusal(with("window_s = 0.05", "window_s = 2.0")), "verdict.window_s");
  EXPECT_EQ(refusal(with("contact_held = true\n", "")), "verdict.contact_held");
  EXPECT_EQ(refusal(with("contact_held = true", "contact_held = \"wall\"")),
            "verdict.contact_held");
  EXPECT_EQ(refusal(with("contact_held = true", "contact_held = []")), "verdict.contact_held");
  EXPECT_EQ(refusal(with("time_s = 0.5", "time_s = 1.5")), "at[0].time_s");
  EXPECT_EQ(refusal(with("{ force_setpoint = 10.0 }", "5")), "at[0].firmware");
  EXPECT_EQ(refusal(with("force_setpoint = 10.0", "force_setpoint = 1e9")),
            "at[0].firmware.force_setpoint");
  EXPECT_EQ(refusal(with("body = \"workpiece\", ", "")), "at[0].impulse.body");
  // Units of parameters that stand for a value.
  EXPECT_EQ(refusal(with("b_w = 363.0", "m_w = \"k_w\"")), "set.m_w");
  EXPECT_EQ(refusal(with("\"strike\"", "\"m_r1\"")), "at[0].impulse.N_s");
  EXPECT_EQ(refusal(with("force_gain = 5.0", "force_gain = \"m_r1\"")), "firmware.force_gain");
  // Objects that are whole numbers, enums or flags.
  EXPECT_EQ(refusal(with("force_gain = 5.0", "latency_ticks = 0.6")), "firmware.latency_ticks");
  EXPECT_EQ(refusal(with("force_gain = 5.0", "force_gain = true")), "firmware.force_gain");
  EXPECT_EQ(refusal(with("mode = \"force\"", "mode = 2.6")), "firmware.mode");
  EXPECT_EQ(refusal(with("force_gain = 5.0", "adc_bits = 12")), "firmware.adc_bits");
  EXPECT_EQ(refusal(with("b_w = 363.0", "b_w = \"363\"")), "set.b_w");
  EXPECT_EQ(refusal(std::string(kGood).substr(0, 40)).rfind("line ", 0), 0U);
}

TEST_F(Files, OverridesWinAndAreChecked) {
  const std::vector<std::string> overrides{"firmware.force_gain=7", "experiment.duration_s=2"};
  const Experiment e = load_experiment(write(kGood), overrides);
  EXPECT_EQ(e.initial[0].raw, 1792);
  EXPECT_EQ(e.ticks, 3000);
  EXPECT_EQ(refusal(kGood, {"force_gain"}), "force_gain");
  EXPECT_EQ(refusal(kGood, {"plant.x=1"}), "plant.x");
  EXPECT_EQ(refusal(kGood, {"firmware.force_gain=300"}), "firmware.force_gain");
  EXPECT_NE(refusal(kGood, {"no_such_parameter=1"}), "accepted");
  EXPECT_NE(refusal(kGood, {"m_w=-1"}), "accepted");
}

TEST_F(Files, ASetThatNothingUsesIsKnown) {
  EXPECT_TRUE(load_experiment(write(kGood)).unused.empty());
  const Experiment e = load_experiment(write(with("b_w = 363.0", "m_b = 1.0")));
  EXPECT_EQ(e.unused, std::vector<std::string>{"m_b"});
  // `strike` is no part of the model, but the experiment refers to it.
  EXPECT_TRUE(load_experiment(write(with("b_w = 363.0", "strike = 1.0"))).unused.empty());
}

TEST_F(Files, CommandsComeAfterParametersAndModeLast) {
  const Experiment e =
      load_experiment(write(with("force_gain = 5.0", "recorder_arm = 1\nrecorder_signal_1 = 30")));
  ASSERT_EQ(e.initial.size(), 3U);
  EXPECT_EQ(e.initial[0].object, AXIS_OBJ_RECORDER_SIGNAL_1);
  EXPECT_EQ(e.initial[1].object, AXIS_OBJ_RECORDER_ARM);
  EXPECT_EQ(e.initial[2].object, AXIS_OBJ_MODE);
}

TEST_F(Files, AMissingFileIsNamed) {
  EXPECT_THROW(load_experiment(std::string(5000, 'x')), sim::InputError);
  EXPECT_THROW(load_experiment("no/such/experiment.toml"), sim::InputError);
}

// Values of b_w one rounding apart make two models; writes to the firmware make none.
TEST_F(Files, VariantsShareTheModelThatTheyHaveInCommon) {
  ExperimentFile file(write(kGood));
  using Overrides = std::vector<std::string>;
  const Experiment five = file.with(Overrides{});
  const Experiment seven = file.with(Overrides{"firmware.force_gain=7"});
  EXPECT_EQ(seven.initial[0].raw, 1792);
  EXPECT_EQ(seven.model, five.model);
  EXPECT_EQ(seven.modes, five.modes);
  const Experiment other = file.with(Overrides{"b_w=363.00000000000006"});
  ASSERT_NE(other.model, five.model);
  EXPECT_EQ(parameter(five, "b_w"), 363.0);
  EXPECT_EQ(parameter(other, "b_w"), 363.00000000000006);
  EXPECT_THROW(file.with(Overrides{"m_w=-1"}), sim::InputError);
  EXPECT_THROW(file.with(Overrides{"m_w=-1"}), sim::InputError);
  EXPECT_TRUE(file.with(Overrides{"m_b=1"}).unused == Overrides{"m_b"});
}

TEST_F(Files, OnlyTheModelsMetLastAreKept) {
  ExperimentFile file(write(kGood));
  const std::weak_ptr<const sim::Model> first = file.with({}).model;
  std::vector<std::string> overrides{""};
  for (std::size_t i = 1; i < ExperimentFile::kKeptModels; ++i) {
    overrides[0] = "b_w=" + std::to_string(i);
    file.with(overrides);
  }
  EXPECT_FALSE(first.expired());
  overrides[0] = "b_w=0.5";
  file.with(overrides);
  EXPECT_TRUE(first.expired());
}

// What the laboratory's converters make of a quantity: 2.5 N a count, 4000 counts an inch, 4096
// codes of 20 V, 1500 ticks a second.
TEST_F(Files, QuantitiesAreConvertedByTheModel) {
  struct Row {
    const char *object;
    const char *text;
    std::int32_t raw;
  };
  const std::vector<Row> rows = {
      {"force_setpoint", "75 N", 30 * 256},
      {"force_setpoint", "0.075 kN", 30 * 256},
      {"force_setpoint", "59 N", 6042},  // 23.6 counts, 6041.6
      {"force_setpoint", "-2.5 N", -256},
      {"force_setpoint", "30 count", 30 * 256},
      {"force_tare", "5 N", 2 * 256},
      {"contact_force", "5 N", 2 * 256},
      {"position_setpoint", "25.4 mm", 4000},
      {"position_setpoint", "-1.27 cm", -2000},
      {"position_setpoint", "approach", 1575},  // a parameter, 0.01 m: 1574.8 counts
      {"target_position", "25.4 mm", 4000},
      {"following_error_window", "2.54 mm", 400},
      {"speed_max", "38.1 mm/s", 4},                     // 6000 counts a second
      {"profile_velocity_max", "12.7 mm/s", 87381},      // 2000/1500 counts a tick, of 1/65536
      {"profile_acceleration_max", "25.4 mm/s^2", 117},  // 4000/1500^2 counts/tick^2: 116.5
      {"trajectory_velocity", "25.4 mm/s", 4000},
      {"trajectory_acceleration", "0.254 m/s^2", 40000},
      {"open_loop_code", "-0.5 V", -102},  // 102.4 codes
      {"excitation_amplitude", "1000 mV", 205},
      {"force_gain", "19.53125 mV/N", 10 * 256},  // 4 codes a newton, 2.5 N a count
      {"force_gain", "5 code/count", 5 * 256},
      {"position_gain", "1 V/mm", 333},       // 204.8 codes, 157.48 counts: 1.30048
      {"velocity_gain", "10 mV s/mm", 4994},  // 2.048 codes, 0.104987 counts a tick: 19.5072
      {"stiffness", "400 kN/m", 66585},       // 160 counts of force, 157.48 of position: 1.016
      {"damping", "363 N s/m", 354},          // 145.2 counts, 104.987 counts a tick: 1.38303
      {"watchdog", "0.25 s", 250},
      {"emcy_inhibit_time", "2 ms", 20},
      {"latency_ticks", "0.7 ms", 1},
      {"excitation_hold", "2 ms", 3},
      {"excitation_hold", "3 tick", 3},
      {"excitation_frequency", "0.04 kHz", 114532461},  // 40 of 750 Hz, of 2^31
      {"rated_force", "75 N", 75000},
      {"force_scale", "2.5 N", 2500000},
      {"target_force", "500 per mille", 500},
  };
  for (const Row &row : rows) {
    const Experiment e = load_experiment(
        write(with("force_gain = 5.0", std::string(row.object) + " = \"" + row.text + "\"")));
    ASSERT_EQ(e.initial.size(), 2U);
    const ObjectWrite &w = e.initial[e.initial[0].object == AXIS_OBJ_MODE ? 1 : 0];
    EXPECT_EQ(w.raw, row.raw) << row.object << " = " << row.text;
  }
}

TEST_F(Files, QuantitiesStandForTimesAndImpulses) {
  std::string text = with("duration_s = 1.0", "duration_s = \"1500 ms\"");
  for (const auto &[from, to] :
       std::vector<std::pair<std::string, std::string>>{{"time_s = 0.5", "time_s = \"2 ms\""},
                                                        {"\"strike\"", "\"8300 mN s\""},
                                                        {"window_s = 0.05", "window_s = \"50 ms\""},
                                                        {"b_w = 363.0", "b_w = \"0.4 N s/mm\""}})
    text.replace(text.find(from), from.size(), to);
  const Experiment e = load_experiment(
      write(text + "[plot]\nrows = [[\"adc0\", \"sensor.force\"]]\nto_s = \"300 ms\"\n"));
  EXPECT_EQ(e.ticks, 2250);
  EXPECT_EQ(e.actions[0].tick, 3);
  EXPECT_EQ(e.actions[0].impulse->impulse_N_s, 8.3);
  EXPECT_EQ(e.criterion->window_s, 0.05);
  EXPECT_EQ(*e.plot.to_s, 0.3);
  EXPECT_FALSE(e.plot.from_s.has_value());
  EXPECT_EQ(e.plot.diagrams, (std::vector<std::vector<std::string>>{{"adc0", "sensor.force"}}));
  EXPECT_EQ(parameter(e, "b_w"), 400.0);
}

// The reading that the firmware receives: the plant's, until the sensor fails, and after it is
// repaired.
TEST_F(Files, AForceSensorFailsAndIsRepaired) {
  const auto readings = [this](const std::string &events) {
    const std::vector<std::string> overrides{"firmware.force_setpoint=30",
                                             "experiment.duration_s=2"};
    const Experiment e = load_experiment(write(with("[[at]]", events + "[[at]]")), overrides);
    RunOptions options;
    options.trace = true;
    std::vector<int> codes;
    for (const TickRecord &r : run(e, options).records) codes.push_back(r.adc0_code);
    return codes;
  };
  const auto at = [](double time_s, const std::string &reading) {
    return "[[at]]\ntime_s = " + std::to_string(time_s) + "\nsensor = { force = \"" + reading +
           "\" }\n";
  };
  const std::vector<int> live = readings("");
  const auto touch = std::find_if(live.begin(), live.end(), [](int code) { return code > 5; });
  ASSERT_NE(touch, live.end());
  const std::size_t tick = static_cast<std::size_t>(touch - live.begin());
  const double time_s = static_cast<double>(tick) / 1500;
  const std::vector<std::pair<std::string, int>> rows = {
      {"held", live[tick - 1]}, {"high", 255}, {"low", 0}, {"zero", 0}};
  for (const auto &[reading, code] : rows) {
    const std::vector<int> codes = readings(at(time_s, reading) + at(time_s + 0.02, "live"));
    for (std::size_t i = 0; i < tick; ++i) ASSERT_EQ(codes[i], live[i]) << reading << i;
    for (std::size_t i = tick; i < tick + 30; ++i) ASSERT_EQ(codes[i], code) << reading << i;
    EXPECT_GT(
        *std::max_element(codes.begin() + static_cast<std::ptrdiff_t>(tick) + 30, codes.end()), 5)
        << reading;
  }
}

TEST_F(Files, AFailureOfTheSensorIsNamed) {
  const auto refused = [this](const std::string &value) {
    return message(with("[[at]]", "[[at]]\ntime_s = 0.1\nsensor = " + value + "\n[[at]]"));
  };
  EXPECT_NE(refused("{ force = \"hold\" }").find("sensor.force: expected one of live, held"),
            std::string::npos)
      << refused("{ force = \"hold\" }");
  EXPECT_NE(refused("{ current = \"high\" }").find("expected"), std::string::npos);
}

// No new code of a silent sensor arrives: the last one stays, and its age grows.
TEST_F(Files, ASilentForceSensorBecomesOlder) {
  const std::string event =
      "[[at]]\ntime_s = 0.1\nsensor = { force = \"silent\" }\n[[at]]\n"
      "time_s = 0.4\nsensor = { force = \"live\" }\n[[at]]";
  const Experiment e = load_experiment(write(with("[[at]]", event)));
  PlantSide plant(e, {});
  std::uint16_t last = 0;
  while (plant.running()) {
    const std::int64_t tick = plant.tick();
    const LinkInputs &in = plant.sense();
    const bool silent = tick >= 150 && tick < 600;
    ASSERT_EQ(in.force_age, silent ? std::min<std::int64_t>(tick - 149, 255) : 0) << tick;
    ASSERT_TRUE(!silent || in.adc0_code == last) << tick;
    last = in.adc0_code;
    plant.act({tick, 0, 0, 0, 0, 1});
  }
}

TEST_F(Files, AFailureOfTheDriveNeedsADriveThatReports) {
  const auto refused = [this](const std::string &value) {
    return message(with("[[at]]", "[[at]]\ntime_s = 0.1\ndrive = " + value + "\n[[at]]"));
  };
  const std::string silent = refused("{ failure = \"silent\" }");
  EXPECT_NE(silent.find("drive.failure: expected a model whose [drive] has enable_ticks"),
            std::string::npos)
      << silent;
  EXPECT_NE(refused("{ failure = \"dead\" }").find("drive.failure: expected one of none, off"),
            std::string::npos);
  EXPECT_NE(refused("{ }").find("drive.failure"), std::string::npos);
  EXPECT_NE(refused("{ failure = \"off\", more = 1 }").find("more"), std::string::npos);
}

TEST_F(Files, OverridesMayBeQuantities) {
  const std::vector<std::string> overrides{"firmware.force_gain=19.53125 mV/N",
                                           "experiment.duration_s=2 s", "m_w=3.5 kg"};
  const Experiment e = load_experiment(write(kGood), overrides);
  EXPECT_EQ(e.initial[0].raw, 2560);
  EXPECT_EQ(e.ticks, 3000);
  EXPECT_EQ(parameter(e, "m_w"), 3.5);
}

// An ADC of 12 bits that counts down, and an encoder that does.
TEST_F(Files, SignsAndWidthsOfTheConvertersCount) {
  const std::string model = R"([[body]]
name = "a"
mass = 1
[[spring]]
name = "s"
between = ["a", "ground"]
stiffness = 100
[encoder]
body = "a"
scale = -1000
[[adc]]
channel = 0
signal = "s.force"
per_count = -0.125
bits = 12
zero_code = 2048
)";
  const auto path = write(model);
  const auto plant = path.parent_path() / ("plant_" + path.filename().string());
  std::filesystem::rename(path, plant);
  const auto raw = [&](const std::string &more, const std::string &object,
                       const std::string &value) {
    const Experiment e = load_experiment(write("title = \"t\"\nmodel = \"" + plant.string() +
                                               "\"\nduration_s = 1.0\n[firmware]\nadc_bits = 12\n" +
                                               more + object + " = \"" + value + "\"\n"));
    for (const ObjectWrite &w : e.initial)
      if (object_meta(w.object).name == object) return w.raw;
    return INT32_MIN;
  };
  // 2 N is a count of 8 bits.
  EXPECT_EQ(raw("", "force_setpoint", "16 N"), -8 * 256);
  EXPECT_EQ(raw("force_sign = -1\n", "force_setpoint", "16 N"), 8 * 256);
  EXPECT_EQ(raw("", "contact_force", "16 N"), 8 * 256);
  EXPECT_EQ(raw("", "position_setpoint", "5 mm"), -5);
  EXPECT_EQ(raw("", "following_error_max", "5 mm"), 5);
  EXPECT_EQ(raw("", "target_velocity", "5 mm/s"), -5);
}

TEST_F(Files, WhatCannotBeConvertedIsRefusedByName) {
  const auto firmware = [&](const std::string &lines) {
    return message(with("force_gain = 5.0", lines));
  };
  const std::string advice = "; correct the value or its unit";
  EXPECT_EQ(firmware("force_setpoint = \"12 mm/s\""),
            "firmware.force_setpoint: expected a force in N, got \"12 mm/s\", a velocity" + advice);
  EXPECT_EQ(firmware("position_setpoint = \"12 N\""),
            "firmware.position_setpoint: expected a length in m, got \"12 N\", a force" + advice);
  EXPECT_EQ(firmware("latency_ticks = \"1 lightyear\""),
            "firmware.latency_ticks: expected a time in s, got \"1 lightyear\", whose unit is not "
            "known" +
                advice);
  EXPECT_EQ(firmware("force_setpoint = \"700 N\""),
            "firmware.force_setpoint: expected a number -256 to 256 count, got 280 (\"700 N\"); "
            "choose a value in that range");
  EXPECT_EQ(firmware("force_setpoint = nan"),
            "firmware.force_setpoint: expected a number -256 to 256 count, got nan; choose a value "
            "in that range");
  EXPECT_EQ(firmware("latency_ticks = 0.5"),
            "firmware.latency_ticks: expected a whole number 0 to 1 tick, got 0.5; choose a value "
            "in that range");
  EXPECT_EQ(firmware("uncertified_force = \"75 N\""),
            "firmware.uncertified_force: expected a number in per mille, got \"75 N\", and the "
            "object measures no quantity of the model; write a number in per mille");
  EXPECT_EQ(firmware("encoder_increments = \"1 mm\""),
            "firmware.encoder_increments: expected a number in count, got \"1 mm\", and the "
            "object is not a position; write a number in count");
  EXPECT_EQ(firmware("polarity = 128\ntarget_position = \"1 mm\""),
            "firmware.target_position: expected a number in count, got \"1 mm\", and polarity or "
            "home_offset is not 0, so the object differs from the position of the model; write a "
            "number in count");
  EXPECT_EQ(message(with("b_w = 363.0", "b_w = \"363\"")),
            "set.b_w: expected a damping in N s/m, got \"363\" without a unit" + advice);
  EXPECT_EQ(message(with("time_s = 0.5", "time_s = \"0.5 m\"")),
            "at[0].time_s: expected a time in s, got \"0.5 m\", a length" + advice);
  EXPECT_EQ(message(with("\"strike\"", "\"8 N\"")),
            "at[0].impulse.N_s: expected an impulse in N s, got \"8 N\", a force" + advice);
}

TEST_F(Files, EveryUnknownNameIsReportedAtOnce) {
  EXPECT_EQ(message(with("force_gain", "a = 1\nforce_gian = 3\nforce_setpiont")),
            "firmware.a: expected the name of a firmware object, got \"a\", \"force_gian\", "
            "\"force_setpiont\"; did you mean force_gain, force_setpoint?; `list_objects` lists "
            "them");
  EXPECT_EQ(
      message(with("title", "figur = \"1\"\ntitel")),
      "figur: expected one of the keys title, figure, shows, model, duration_s, seed, cycle, set, "
      "firmware, at, verdict, trace, plot, expect, got \"figur\", \"titel\"; did you mean figure, "
      "title?; remove or rename these keys");
  std::string modes;
  for (int mode = 0; mode < AXIS_MODE_COUNT; ++mode)
    modes += (mode > 0 ? "," : "") + std::string(enum_text(AXIS_OBJ_MODE, mode));
  EXPECT_EQ(message(with("\"force\"", "\"forse\"")),
            "firmware.mode: expected one of " + modes +
                ", got \"forse\"; did you mean force?; choose one of these texts");
  EXPECT_EQ(message(with("\"workpiece\"", "\"workpeice\"")),
            "at[0].impulse.body: expected one of robot, tip, workpiece, got \"workpeice\"; did you "
            "mean workpiece?; give one of these names");
  const std::string set = message(with("b_w = 363.0", "b_v = 1\nm_W = 1"));
  EXPECT_EQ(set.rfind("set.b_v: expected one of the parameters ", 0), 0U) << set;
  EXPECT_NE(set.find(", got \"b_v\", \"m_W\"; did you mean "), std::string::npos) << set;
}

TEST_F(Files, OverridesAreGivenOnceAndSpelledRight) {
  EXPECT_EQ(message(kGood, {"m_w=1", "b_w=2", "m_w=3"}),
            "m_w: expected one value, got 1 and 3; remove one value");
  EXPECT_EQ(message(kGood, {"firmwear.force_gain=1"}),
            "firmwear.force_gain: expected a model parameter, firmware.OBJECT, experiment.KEY or "
            "verdict.KEY; did you mean firmware?");
  EXPECT_EQ(message(kGood, {"b_w=nan"}),
            "set.b_w: expected a finite number in N s/m, got nan; correct the override's value");
}

TEST_F(Files, EverySetThatNothingUsesIsReportedAtOnce) {
  const Experiment e = load_experiment(write(with("b_w = 363.0", "m_b = 1.0\nk_b = 1.0")));
  try {
    expect_used(e);
    FAIL();
  } catch (const sim::InputError &error) {
    EXPECT_EQ(error.key + ": " + error.message,
              "set.k_b: expected parameters that the model or the experiment uses, got k_b, m_b, "
              "which have no effect; remove these parameters");
  }
}

TEST_F(Files, APlotIsCheckedBeforeTheRun) {
  const auto plot = [&](const std::string &lines) {
    return message(std::string(kGood) + "[plot]\n" + lines + "\n");
  };
  EXPECT_EQ(plot("rows = [[\"tick\", \"time_s\", \"drive.current\"]]\nfrom_s = 0.1"), "accepted");
  EXPECT_EQ(plot("from_s = 2\nto_s = 1"),
            "plot.from_s: expected a time before to_s, got 2; correct from_s or to_s");
  EXPECT_EQ(plot("rows = []"),
            "plot.rows: expected a list of lists of columns, got an empty list; write "
            "[[\"encoder\"], [\"adc0\"]]");
  EXPECT_EQ(plot("rows = [\"adc0\"]").substr(0, 80),
            "plot.rows: expected a list of lists of columns, got a row without columns; write");
  const std::string column = plot("rows = [[\"encoder\", \"adc2\"]]");
  EXPECT_EQ(column.rfind("plot.rows: expected columns of the trace (tick, time_s, encoder, ", 0),
            0U);
  EXPECT_NE(column.find("), got \"adc2\"; did you mean adc0?; name a column"), std::string::npos);
}

// The value of an override gets the type that the format declares for its key.
TEST_F(Files, AnOverrideOfATextIsATextAlsoIfItLooksLikeANumber) {
  const std::vector<std::string> overrides{"experiment.title=2", "experiment.shows=true"};
  const Experiment e = load_experiment(write(kGood), overrides);
  EXPECT_EQ(e.title, "2");
  EXPECT_EQ(e.shows, "true");
  const std::string cycle = message(kGood, {"experiment.cycle=7"});
  EXPECT_NE(cycle.find("expected a readable file"), std::string::npos) << cycle;
  const std::vector<std::string> seed{"experiment.seed=3.0"};
  EXPECT_EQ(load_experiment(write(kGood), seed).seed, 3);
  EXPECT_EQ(message(kGood, {"experiment.seed=1.5"}),
            "seed: expected an integer 0..2147483647, got 1.5; give an integer");
}

TEST_F(Files, ATextMustNotBeEmpty) {
  EXPECT_EQ(message(with("title = \"t\"", "title = \"\"")),
            "title: expected a text, got an empty text; write a text");
  EXPECT_EQ(message(with("title = \"t\"", "title = \"t\"\ncycle = \"\"")),
            "cycle: expected a text, got an empty text; write a text");
}

// A misspelled key is named, and not the rule between keys that fails without it.
TEST_F(Files, AnUnknownKeyIsNamedBeforeAMissingOne) {
  const std::string verdict = message(with("contact_held = true\n", "force_ripple_max_cout = 3\n"));
  EXPECT_EQ(verdict.rfind("verdict.force_ripple_max_cout: ", 0), 0U) << verdict;
  const std::string at =
      message(with("firmware = { force_setpoint = 10.0 }\nimpulse = {", "impulze = {"));
  EXPECT_EQ(at.rfind("at[0].impulze: ", 0), 0U) << at;
}

// A time that is not a whole number of ticks rounds up; one that is, does not.
TEST_F(Files, TimesRoundUpToTicks) {
  EXPECT_EQ(load_experiment(write(with("duration_s = 1.0", "duration_s = 0.5667"))).ticks, 851);
  EXPECT_EQ(load_experiment(write(with("duration_s = 1.0", "duration_s = 0.502"))).ticks, 753);
}

}  // namespace
}  // namespace forceaxis::host
