// Every mistake in an experiment is one line: file, key, what was expected.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "firmware/objects/generated/axis_objects.h"
#include "host/run/experiment.hpp"

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
    try {
      load_experiment(write(text), overrides);
    } catch (const sim::InputError &error) {
      const std::string what = error.what();
      EXPECT_EQ(what.find('\n'), std::string::npos) << what;
      EXPECT_NE(what.find("expected"), std::string::npos) << what;
      return error.key;
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
  EXPECT_EQ(e.actions[0].impulses[0].body, "workpiece");
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

// b_w one rounding apart makes two models; what the firmware is told makes none.
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
  const auto b_w = [](const Experiment &e) {
    for (const auto &p : e.model->parameters)
      if (p.name == "b_w") return p.value;
    return 0.0;
  };
  EXPECT_EQ(b_w(five), 363.0);
  EXPECT_EQ(b_w(other), 363.00000000000006);
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

// A time that is not a whole number of ticks rounds up; one that is, does not.
TEST_F(Files, TimesRoundUpToTicks) {
  EXPECT_EQ(load_experiment(write(with("duration_s = 1.0", "duration_s = 0.5667"))).ticks, 851);
  EXPECT_EQ(load_experiment(write(with("duration_s = 1.0", "duration_s = 0.502"))).ticks, 753);
}

}  // namespace
}  // namespace forceaxis::host
