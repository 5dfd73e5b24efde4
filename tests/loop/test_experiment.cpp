// Every mistake in an experiment is one line: file, key, what was expected.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "firmware/objects/generated/axis_objects.h"
#include "host/link/experiment.hpp"

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
window_s = 0.2
)";

class Files : public testing::Test {
 protected:
  std::filesystem::path write(std::string text) {
    const auto at = text.find("MODEL");
    if (at != std::string::npos) text.replace(at, 5, SIM_DIR "/models/laboratory.toml");
    const auto path = std::filesystem::path(testing::TempDir()) / "experiment_under_test.toml";
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

TEST_F(Files, AMissingFileIsNamed) {
  EXPECT_THROW(load_experiment("no/such/experiment.toml"), sim::InputError);
}

// A time that is not a whole number of ticks rounds up; one that is, does not.
TEST_F(Files, TimesRoundUpToTicks) {
  EXPECT_EQ(load_experiment(write(with("duration_s = 1.0", "duration_s = 0.0667"))).ticks, 101);
  EXPECT_EQ(load_experiment(write(with("duration_s = 1.0", "duration_s = 0.002"))).ticks, 3);
}

}  // namespace
}  // namespace forceaxis::host
