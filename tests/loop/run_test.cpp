#include "host/run/run.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <string>

#include "firmware/objects/generated/axis_objects.h"
#include "firmware/port/host/store_file.h"
#include "host/run/firmware_side.hpp"
#include "host/run/objects.hpp"
#include "host/run/plant_side.hpp"
#include "host/run/sha256.hpp"

namespace forceaxis::host {
namespace {

const std::string kContact = SIM_DIR "/experiments/contact.toml";

RunResult run_with(const std::string &file, std::vector<std::string> overrides) {
  return run(load_experiment(file, overrides));
}

// Adds `text` in parts of `part` bytes.
std::string sha256(const std::string &text, std::size_t part) {
  Sha256 hash;
  for (std::size_t at = 0; at < text.size(); at += part)
    hash.update(text.data() + at, std::min(part, text.size() - at));
  return hash.hex();
}

TEST(Sha256, KnownAnswers) {
  const std::string two_blocks = "abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq";
  for (const std::size_t part : {1, 3, 63, 64, 65, 127, 200, 1 << 20}) {  // FIPS 180-2, B.1 to B.3
    EXPECT_EQ(sha256("abc", part),
              "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    EXPECT_EQ(sha256(two_blocks, part),
              "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
    EXPECT_EQ(sha256(std::string(1'000'000, 'a'), part),
              "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
  }
  // The end of the data beside a block, by sha256sum.
  EXPECT_EQ(sha256("", 1), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256(std::string(55, 'a'), 9),
            "9f4390f8d30c2dd92ec9f095b65e2b9ae9b0a925a5258e241c9f1e910f734318");
  EXPECT_EQ(sha256(std::string(64, 'a'), 9),
            "ffe054fe7ae0cb6dc65c3af9b61d5209f439851db43d0ba5997337df154668eb");
}

TEST(Run, TwiceGivesTheSameHashAndAnotherGainAnother) {
  const std::string once = run_with(kContact, {"experiment.duration_s=1"}).trace_hash;
  EXPECT_EQ(run_with(kContact, {"experiment.duration_s=1"}).trace_hash, once);
  EXPECT_NE(run_with(kContact, {"experiment.duration_s=1", "firmware.force_gain=5.25"}).trace_hash,
            once);
}

// Above 2^31 - 1 a conversion by way of int32 gives 2147483648, or whatever the machine does.
TEST(Run, AnUnsignedObjectTakesItsWholeRange) {
  const std::pair<const char *, std::uint32_t> values[] = {
      {"2147483647", 2147483647U}, {"2147483648", 2147483648U}, {"3e9", 3000000000U},
      {"4294967294", 4294967294U}, {"4294967295", 4294967295U}, {"0", 0U}};
  for (const auto &[text, expected] : values) {
    const std::vector<std::string> overrides{
        "experiment.duration_s=0.01", "verdict.window_s=0.01",
        std::string("firmware.following_error_window=") + text};
    const Experiment experiment = load_experiment(kContact, overrides);
    FirmwareSide firmware(experiment, {});
    PlantSide plant(experiment, {});
    while (plant.running()) plant.act(firmware.tick(plant.sense()));
    EXPECT_EQ(static_cast<std::uint32_t>(firmware.read(AXIS_OBJ_FOLLOWING_ERROR_WINDOW)), expected)
        << text;
  }
  for (const char *text : {"4294967296", "-1"}) {
    const std::vector<std::string> overrides{std::string("firmware.following_error_window=") +
                                             text};
    EXPECT_THROW(load_experiment(kContact, overrides), sim::InputError) << text;
  }
}

// One power-up of an axis on a bus whose parameters are in a file.
struct StoredAxis {
  StoredAxis(const Experiment &experiment, const std::string &path) : plant(experiment, {}) {
    EXPECT_EQ(store_file_open(&store, path.c_str()), nullptr);
    config.memory = &store.memory;
    config.buses = 1;
    config.node_id = FW_NODE_ID_BY_LSS;
    config.hardware = "host";
    firmware.emplace(experiment, FirmwareOptions{.config = &config});
  }
  ~StoredAxis() { store_file_close(&store); }
  void run(int ticks) {
    for (int i = 0; i < ticks; ++i) {
      plant.act(firmware->tick(plant.sense()));
      firmware->discard_output();
    }
  }
  void lss(std::uint8_t service, std::uint8_t value) {
    can_frame_t frame{};
    frame.id = 0x7E5;
    frame.length = 8;
    frame.data[0] = service;
    frame.data[1] = value;
    fw_can_receive(firmware->axis(), &frame);
    run(100);
  }
  // Configures node id 5 and stores it, by CiA 305.
  void store_node_id() {
    lss(0x04, 1);
    lss(0x11, 5);
    lss(0x17, 0);
    run(1000);
    EXPECT_EQ(firmware->read(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_SAVED);
  }
  store_file_t store{};
  fw_config_t config{};
  PlantSide plant;
  std::optional<FirmwareSide> firmware;
};

struct FirmwareStore : testing::Test {
  ~FirmwareStore() override { std::remove(path.c_str()); }
  std::string path =
      testing::TempDir() + testing::UnitTest::GetInstance()->current_test_info()->name() + ".store";
};

TEST_F(FirmwareStore, ANodeIdThatLssStoresLeavesTheValuesOfTheExperiment) {
  const std::vector<std::string> disabled{"firmware.mode=disabled"};  // LSS stores in this state
  const Experiment experiment = load_experiment(kContact, disabled);
  std::vector<std::int32_t> given;
  {
    StoredAxis axis(experiment, path);
    for (const ObjectWrite &w : experiment.initial) given.push_back(axis.firmware->read(w.object));
    axis.store_node_id();
  }
  StoredAxis axis(experiment, path);
  EXPECT_EQ(axis.firmware->read(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_LOADED);
  EXPECT_EQ(axis.firmware->read(AXIS_OBJ_STORED_NODE_ID), 5);
  for (std::size_t i = 0; i < given.size(); ++i) {
    const ObjectWrite &w = experiment.initial[i];
    EXPECT_EQ(axis.firmware->read(w.object), given[i]) << object_meta(w.object).name;
  }
}

// LSS saves two parameters alone: a value that is set and not saved ends with the power.
TEST_F(FirmwareStore, ANodeIdThatLssStoresLeavesAStoredSet) {
  const Experiment experiment = load_experiment(kContact);
  {
    StoredAxis axis(experiment, path);
    axis.run(10);
    const auto write = [&axis](std::uint16_t object, std::int32_t value) {
      EXPECT_EQ(fw_object_write(axis.firmware->axis(), FW_SOURCE_LOCAL, object, value), FW_OK);
    };
    write(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
    axis.run(10);
    write(AXIS_OBJ_FORCE_GAIN, 700);
    write(AXIS_OBJ_STORE_ALL, 0x65766173);
    axis.run(1000);
    write(AXIS_OBJ_FORCE_GAIN, 900);
    axis.store_node_id();
  }
  StoredAxis axis(experiment, path);
  EXPECT_EQ(axis.firmware->read(AXIS_OBJ_STORED_NODE_ID), 5);
  EXPECT_EQ(axis.firmware->read(AXIS_OBJ_FORCE_GAIN), 700);
}

// A client of a bus may select another program, whose phases and elements have no names in this
// experiment.
TEST(Run, ACycleOfAnotherProgramHasAVerdictAndNoFigures) {
  const Experiment experiment = load_experiment(SIM_DIR "/experiments/press_fit.toml");
  const Experiment other = load_experiment(SIM_DIR "/experiments/snap_fit.toml");
  FirmwareSide firmware(experiment, {});
  PlantSide plant(experiment, {});
  const auto write = [&firmware](std::size_t object, std::size_t value) {
    EXPECT_EQ(fw_object_write(firmware.axis(), FW_SOURCE_LOCAL, static_cast<std::uint16_t>(object),
                              static_cast<std::int32_t>(value)),
              FW_OK);
  };
  const std::vector<std::uint32_t> &record = other.cycle->record;
  for (std::size_t i = 0; i < record.size(); ++i) {
    if (i % 16 == 0) write(AXIS_OBJ_CYCLE_DATA_OFFSET, 4 * i);
    write(AXIS_OBJ_CYCLE_DATA_1 + i % 16, record[i]);
  }
  write(AXIS_OBJ_CYCLE_DATA_END, 4 * record.size());
  write(AXIS_OBJ_CYCLE_PROGRAM, 3);  // its number
  while (plant.running()) plant.act(firmware.tick(plant.sense()));
  const auto found = firmware.cycle();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->state, "bad") << "a bearing is no snap fit";
  EXPECT_EQ(found->cycles, 1);
  EXPECT_TRUE(found->figures.empty());
  EXPECT_EQ(found->failed_phase, "");
}

TEST(Run, WithoutTraceAndAuditNothingElseChanges) {
  const std::vector<std::string> overrides{"experiment.duration_s=1"};
  const Experiment e = load_experiment(kContact, overrides);
  const RunResult full = run(e);
  const RunResult lean = run(e, {.trace = false, .audit = false});
  EXPECT_EQ(lean.trace_hash, full.trace_hash);
  EXPECT_EQ(lean.verdict, full.verdict);
  EXPECT_EQ(lean.metrics.peak_force_N, full.metrics.peak_force_N);
  EXPECT_EQ(lean.edge_margin, full.edge_margin);
  EXPECT_TRUE(lean.records.empty());
}

TEST(Run, RecordsEveryTickFromZeroToTheEnd) {
  const RunResult r = run_with(kContact, {"experiment.duration_s=0.1", "verdict.window_s=0.1"});
  ASSERT_EQ(r.records.size(), 151U);
  for (std::size_t k = 0; k < r.records.size(); ++k) EXPECT_EQ(r.records[k].tick, k);
  EXPECT_EQ(r.signals.size(), r.records.size() * r.signal_names.size());
}

// The reading is 0 until contact, so its last change is found again in the records.
TEST(Run, TheLastChangeOfTheForceCodeIsInTheTrace) {
  const RunResult r = run_with(kContact, {"experiment.duration_s=2"});
  std::size_t last = r.records.size() - 1;
  while (last > 0 && r.records[last].adc0_code == r.records[last - 1].adc0_code) --last;
  EXPECT_GT(last, 0U);
  EXPECT_EQ(r.metrics.last_adc_change_tick, static_cast<std::int64_t>(last));
}

// Out of contact the first code is k_f f_d exactly: 5 x 30.
TEST(Run, FirstCodeIsTheLawByHand) {
  const RunResult r = run_with(kContact, {"experiment.duration_s=0.01", "verdict.window_s=0.01"});
  EXPECT_EQ(r.records.front().dac_code, 150);
  EXPECT_EQ(r.records.front().out & 1, 1);
}

// latency_ticks = 1 puts out the same codes one tick later while the force reads 0.
TEST(Run, LatencyDelaysTheCodeByOneTick) {
  const RunResult r = run_with(kContact, {"experiment.duration_s=0.01", "verdict.window_s=0.01",
                                          "firmware.latency_ticks=1"});
  EXPECT_EQ(r.records[0].dac_code, 0);
  EXPECT_EQ(r.records[1].dac_code, 150);
}

// Statics by hand: the motor must hold F = n c (n the reading, c newtons a count) through
// i = F r / k_t, the winding wants R i = 15 e, the preamplifier gives e = 3.9 (20/4096) u - .333 i
// and the law u = 5 (30 - n). With c = 2.437: .095215 (30 - n) = .633 i = .012474 n, n = 26.5.
TEST(Run, AtRestInContactTheReadingIsThatOfTheStatics) {
  const RunResult r = run_with(kContact, {"force_per_count=2.437"});
  EXPECT_EQ(r.verdict, "stable");
  EXPECT_NEAR(r.records.back().adc0_code, 26.5, 0.6);
}

TEST(Run, AnImpulseMovesItsBodyByImpulseOverMass) {
  const std::string strike = SIM_DIR "/experiments/strike.toml";
  const RunResult with = run_with(strike, {"experiment.duration_s=5"});
  const RunResult without = run_with(strike, {"experiment.duration_s=5", "strike=0"});
  const auto &names = with.signal_names;
  const auto v = static_cast<std::size_t>(
      std::find(names.begin(), names.end(), "workpiece.velocity") - names.begin());
  const std::size_t last = with.records.size() - 1;  // tick 7500 = 5 s, recorded after the strike
  double impulse_N_s = 0;
  const Experiment experiment = load_experiment(strike);
  for (const auto &p : experiment.model->parameters) {
    if (p.name == "strike") impulse_N_s = p.value;
  }
  const double jump =
      with.signals[last * names.size() + v] - without.signals[last * names.size() + v];
  EXPECT_NEAR(jump, impulse_N_s / 6.6, 1e-12);
}

// A fault in the middle of a run: code 0 and a disabled amplifier in that very tick, and an
// unstable verdict whatever the metrics.
TEST(Run, AFaultStopsTheAxisAndTheVerdict) {
  const RunResult r = run_with(kContact, {"firmware.force_max=10"});
  EXPECT_EQ(r.fault, "force_max");
  EXPECT_EQ(r.verdict, "unstable");
  bool seen = false;
  for (std::size_t k = 0; k < r.records.size(); ++k) {
    seen = seen || r.firmware[k].fault != 0;
    if (!seen) continue;
    EXPECT_EQ(r.records[k].dac_code, 0);
    EXPECT_EQ(r.records[k].out, 0);
  }
  EXPECT_TRUE(seen);
}

// Limits that bound each other go in, whichever comes first in the file.
TEST(Run, InitialWritesAreTakenInAnOrderThatWorks) {
  EXPECT_NO_THROW(run_with(kContact, {"experiment.duration_s=0.01", "verdict.window_s=0.01",
                                      "firmware.position_max=-100", "firmware.position_min=-200",
                                      "firmware.position_setpoint=-150"}));
  EXPECT_THROW(run_with(kContact, {"experiment.duration_s=0.01", "verdict.window_s=0.01",
                                   "firmware.position_max=-300", "firmware.position_min=-200"}),
               sim::InputError);
}

TEST(Run, CanBeStopped) {
  const Experiment e = load_experiment(kContact);
  int asked = 0;
  EXPECT_THROW(run(e, {.stop = [&asked] { return ++asked == 3; }}), RunStopped);
  EXPECT_EQ(asked, 3);
}

TEST(Objects, ByNameAndByText) {
  EXPECT_EQ(find_object("force_gain"), std::uint16_t{AXIS_OBJ_FORCE_GAIN});
  EXPECT_FALSE(find_object("force_gian").has_value());
  EXPECT_EQ(enum_value(AXIS_OBJ_MODE, "force"), AXIS_MODE_FORCE);
  EXPECT_FALSE(enum_value(AXIS_OBJ_MODE, "forc").has_value());
  EXPECT_EQ(enum_text(AXIS_OBJ_MODE, AXIS_MODE_POSITION), "position");
  EXPECT_EQ(enum_text(AXIS_OBJ_FORCE_GAIN, 5), "5");
}

}  // namespace
}  // namespace forceaxis::host
