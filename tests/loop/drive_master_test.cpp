// Recorded runs through the complete master of a drive: a stand-in of a drive hands the target of
// its RPDO, in whole units per code of the DAC, to the DAC of the plant.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <deque>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "firmware/port/host/firmware.hpp"
extern "C" {
#include "firmware/port/bus_drive.h"
}
#include "host/run/firmware_side.hpp"
#include "host/run/plant_side.hpp"
#include "host/run/run.hpp"
#include "sim/model/toml.hpp"
#include "tests/support/drive402_node.hpp"

namespace forceaxis::host {
namespace {

namespace fs = std::filesystem;

constexpr std::uint8_t kDrive = 9;

// With the sanitizers every fourth of the recorded experiments, without them each.
#ifdef __SANITIZE_ADDRESS__
constexpr int kEvery = 4;
#else
constexpr int kEvery = 1;
#endif

struct Bus {
  std::uint8_t mode = DRIVE402_CSV;
  int per_code = 150;  // units of the target per code of the plant's DAC
  int cycle_ticks = 3;
  int ticks_out = 0;  // by which an RPDO is late
  int ticks_in = 1;   // from a SYNC to the tick that has the count of this SYNC
  int bits = 12;      // of the plant's DAC, 12 or 16
};

// Codes of the plant's DAC in one DAC code of the firmware.
int steps_of(const Bus &bus) { return 1 << (bus.bits - 12); }

// The drive, its master, and the bus between them, in step with the ticks of a run.
class StandIn {
 public:
  explicit StandIn(const Bus &bus) : bus_(bus) {
    config_.scale_num = static_cast<std::uint32_t>(bus.per_code * steps_of(bus));
    config_.scale_den = 1;
    config_.scale_shift = bus.bits == 12 ? 0 : AXIS_FINE_BITS;
    config_.target_max = 2048 * bus.per_code * steps_of(bus);
    config_.heartbeat_ms = 20;
    config_.heartbeat_timeout_ms = 50;
    config_.sdo_timeout_ms = 30;
    config_.wait_ms = 100;
    config_.quick_stop_ms = 10;
    config_.abort_option = 3;
    config_.cycle_ms = 2;
    config_.mode = bus.mode;
    config_.rpdo_type = 255;
    config_.node_id = kDrive;
    config_.own_node_id = 1;
    EXPECT_EQ(bus_drive_init(&drive_, &config_), DRIVE402_NONE);
    drive_.master.cycle_ticks = static_cast<std::uint16_t>(bus.cycle_ticks);
  }

  // Starts the drive and enables it, as the amplifier is in the first tick of the runs. The next
  // tick begins a cycle.
  void enable(std::int32_t encoder_cnt) {
    axis_inputs_t inputs{};
    for (int i = 0; i < 600; ++i) {
      sense(inputs, encoder_cnt);
      act({0, 1, 0, 0, 0});
    }
    ASSERT_TRUE(drive402_feedback(&drive_.master).on) << reason();
    while (drive_.master.since_sync != bus_.cycle_ticks) {
      sense(inputs, encoder_cnt);
      act({0, 1, 0, 0, 0});
    }
    // In the run, too, no frame has arrived yet.
    to_drive_.clear();
    applied_ = {0, false};
  }

  // Sets what the firmware has of the drive. `encoder_cnt` is the true count of this tick.
  void sense(axis_inputs_t &inputs, std::int32_t encoder_cnt) {
    node_.Set(0x6064, static_cast<std::uint32_t>(encoder_cnt));
    if (std::exchange(syncs_late_, false)) node_.Receive({kSync, {}});
    take_answers();
    while (!to_master_.empty() && to_master_.front().first <= tick_) {
      receive(to_master_.front().second);
      to_master_.pop_front();
    }
    bus_drive_sample(&drive_, &inputs);
  }

  struct Applied {
    std::int32_t code;
    bool enabled;
  };

  // Takes the outputs of the firmware. Returns what the plant has of the drive in this tick.
  Applied act(const axis_outputs_t &outputs) {
    bus_drive_act(&drive_, &outputs);
    for (can_frame_t f{}; drive402_transmit(&drive_.master, &f);)
      send({f.id, {f.data, f.data + f.length}});
    for (; !to_drive_.empty() && to_drive_.front().first <= tick_; to_drive_.pop_front())
      apply(to_drive_.front().second);
    node_.Tick();
    ++tick_;
    take_answers();
    return applied_;
  }

  const char *reason() const {
    return drive402_reason_text(drive402_feedback(&drive_.master).reason);
  }

 private:
  static constexpr std::uint16_t kSync = 0x80, kRpdo = 0x200 + kDrive, kTpdo = 0x180 + kDrive;

  void send(const Frame &frame) {
    if (frame.id == kRpdo) {
      to_drive_.emplace_back(tick_ + bus_.ticks_out, frame);
    } else if (frame.id == kSync && bus_.ticks_in == 0) {
      syncs_late_ = true;  // the drive measures at the begin of the next tick
    } else {
      node_.Receive(frame);
    }
  }

  void apply(const Frame &frame) {
    node_.Receive(frame);
    const std::int32_t target = bus_.mode == DRIVE402_CST
                                    ? static_cast<std::int16_t>(node_.Get(0x6071))
                                    : static_cast<std::int32_t>(node_.Get(0x60FF));
    EXPECT_EQ(target % bus_.per_code, 0);
    applied_ = {target / bus_.per_code, node_.state == DriveNode::kOperationEnabled};
  }

  // Puts the frames of the drive on the bus. The answer to a SYNC of tick n is made in tick n, and
  // counted from n + 1 here.
  void take_answers() {
    for (const Frame &frame : std::exchange(node_.out, {}))
      to_master_.emplace_back(frame.id == kTpdo ? tick_ + std::max(bus_.ticks_in - 1, 0) : tick_,
                              frame);
  }

  void receive(const Frame &frame) {
    can_frame_t f{};
    f.id = frame.id;
    f.length = static_cast<std::uint8_t>(frame.data.size());
    std::copy(frame.data.begin(), frame.data.end(), f.data);
    drive402_receive(&drive_.master, &f);
  }

  Bus bus_;
  drive402_config_t config_{};
  bus_drive_t drive_{};
  DriveNode node_{kDrive};
  std::int64_t tick_ = 0;
  Applied applied_{0, false};
  bool syncs_late_ = false;
  std::deque<std::pair<std::int64_t, Frame>> to_drive_;   // RPDOs, each with its tick
  std::deque<std::pair<std::int64_t, Frame>> to_master_;  // frames of the drive
};

struct Hashes {
  std::string plant, firmware;
  int enablings = 0;  // in the run, of an amplifier that was off
};

// Runs an experiment whose amplifier is the stand-in.
Hashes run_through(const Experiment &experiment, const Bus &bus) {
  PlantSide plant(experiment, {.trace = false, .audit = false});
  FirmwareSide firmware(experiment, {.hash = true});
  StandIn drive(bus);
  Hashes hashes;
  bool was_enabled = true;
  while (plant.running()) {
    LinkInputs in = plant.sense();
    if (in.tick == 0) drive.enable(in.encoder_cnt);
    axis_inputs_t inputs{};
    drive.sense(inputs, in.encoder_cnt);
    in.encoder_cnt = inputs.encoder_cnt;
    in.drive = inputs.drive;
    in.position_age = inputs.position_age;
    LinkOutputs out = firmware.tick(in);
    const bool is_enabled = (out.out & 1) != 0;
    hashes.enablings += is_enabled && !was_enabled;
    was_enabled = is_enabled;
    // With 16 bits, the code of the plant's DAC is the output in 1/16 code.
    const std::int16_t code = bus.bits == 12 ? out.dac_code : std::int16_t{0};
    const StandIn::Applied applied =
        drive.act({code, static_cast<std::uint8_t>(out.out & 1),
                   static_cast<std::uint8_t>(out.out >> 1), out.dac_code, 0});
    out.dac_code = static_cast<std::int16_t>(applied.code);
    out.out = static_cast<std::uint8_t>((out.out & 2) | (applied.enabled ? 1 : 0));
    plant.act(out);
  }
  hashes.plant = plant.finish().trace_hash;
  hashes.firmware = firmware.hash();
  return hashes;
}

// Calls use(file, hash) for every kEvery-th recorded experiment of this repository, from the one
// with the number `first` on.
template <class Use>
void for_each_recorded(const Use &use, int first = 0) {
  std::set<fs::path> files;  // in the order of their names
  for (const auto &entry : fs::directory_iterator(SIM_DIR "/experiments"))
    if (entry.path().extension() == ".toml") files.insert(entry.path());
  int number = 0;
  for (const fs::path &file : files) {
    const toml::table table = toml::parse_file(file.string());
    const auto hash = table["expect"]["trace_hash"].value<std::string>();
    if (hash && number++ % kEvery == first % kEvery) use(file, *hash);
  }
}

// Runs that enable the amplifier later are left out, because a drive comes on some ticks after it.
TEST(DriveMaster, RecordedRunsHaveTheirHashes) {
  // No bus has a cycle of one tick, but an amplifier for +-10 V is commanded in each tick.
  const Bus buses[] = {{.mode = DRIVE402_CSV, .cycle_ticks = 1, .ticks_in = 0},
                       {.mode = DRIVE402_CST, .per_code = 15, .cycle_ticks = 1, .ticks_in = 0}};
  int equal = 0;
  for_each_recorded([&](const fs::path &file, const std::string &recorded) {
    const Experiment experiment = load_experiment(file, {});
    for (const Bus &bus : buses) {
      const Hashes hashes = run_through(experiment, bus);
      if (hashes.enablings > 0) continue;
      EXPECT_EQ(hashes.plant, recorded) << file;
      EXPECT_EQ(hashes.firmware, recorded) << file;
      ++equal;
    }
  });
  EXPECT_GT(equal, 100 / kEvery);
}

// The models of this repository with a bus in the table [drive], and with a DAC of its resolution.
class Delayed {
 public:
  explicit Delayed(const Bus &bus)
      : folder_(fs::path(::testing::TempDir()) /
                ("delayed" + std::to_string(getpid()) + "_" + std::to_string(bus.cycle_ticks))) {
    fs::create_directories(folder_ / "experiments");
    for (const char *kind : {"models", "cycles"}) {
      fs::copy(fs::path(SIM_DIR) / kind, folder_ / kind, fs::copy_options::recursive);
    }
    for (const auto &entry : fs::directory_iterator(folder_ / "models")) {
      std::string text = text_of(entry.path());
      const auto drive = text.find("[drive]\n");
      if (drive == std::string::npos) continue;
      text.insert(drive + 8, "cycle_ticks = " + std::to_string(bus.cycle_ticks) +
                                 "\ndelay_ticks_out = " + std::to_string(bus.ticks_out) +
                                 "\ndelay_ticks_in = " + std::to_string(bus.ticks_in) + "\n");
      const auto dac = text.find("[dac]\n");
      const bool is_given = text.find("bits", dac) != std::string::npos;
      if (bus.bits != 12 && (dac == std::string::npos || is_given)) continue;
      if (bus.bits != 12) text.insert(dac + 6, "bits = " + std::to_string(bus.bits) + "\n");
      std::ofstream(entry.path()) << text;
      changed_.insert(entry.path().filename());
    }
  }
  ~Delayed() { fs::remove_all(folder_); }
  Delayed(const Delayed &) = delete;
  Delayed &operator=(const Delayed &) = delete;

  // Returns the copy of an experiment, or nothing if its model has no drive.
  std::optional<Experiment> experiment(const fs::path &file) const {
    const toml::table table = toml::parse_file(file.string());
    if (!changed_.contains(fs::path(table["model"].value_or("")).filename())) return std::nullopt;
    const fs::path copy = folder_ / "experiments" / file.filename();
    fs::copy_file(file, copy, fs::copy_options::overwrite_existing);
    return load_experiment(copy, {});
  }

 private:
  static std::string text_of(const fs::path &file) {
    std::ifstream in(file);
    return {std::istreambuf_iterator<char>(in), {}};
  }

  fs::path folder_;
  std::set<fs::path> changed_;
};

TEST(DriveMaster, ABusGivesTheTraceOfAPortThatDelaysAlike) {
  const Bus buses[] = {
      {.cycle_ticks = 3, .ticks_out = 0, .ticks_in = 1},
      {.cycle_ticks = 3, .ticks_out = 1, .ticks_in = 2},
      {.cycle_ticks = 3, .ticks_out = 3, .ticks_in = 3},
      {.mode = DRIVE402_CST, .per_code = 15, .cycle_ticks = 6, .ticks_out = 2, .ticks_in = 4}};
  int changed = 0;
  int first = 0;
  for (const Bus &bus : buses) {
    const Delayed delayed(bus);
    const auto compare = [&](const fs::path &file, const std::string &recorded) {
      const auto port = delayed.experiment(file);
      if (!port) return;
      const Hashes through = run_through(load_experiment(file, {}), bus);
      if (through.enablings > 0) return;
      const RunResult result = run(*port, {.trace = false, .audit = false, .firmware_hash = true});
      EXPECT_EQ(through.firmware, result.firmware_hash) << file << ": " << bus.ticks_out;
      changed += through.firmware != recorded;
    };
    for_each_recorded(compare, first++);
  }
  // In two runs nothing moves.
  EXPECT_GT(changed, 100 / kEvery);
}

// The target of a drive has the fraction of a code.
TEST(DriveMaster, AnOutputOf16BitsReachesTheDrive) {
  const Bus bus{.per_code = 9, .cycle_ticks = 3, .ticks_out = 1, .ticks_in = 2, .bits = 16};
  const Delayed fine(bus);
  Bus none = bus;
  none.cycle_ticks = 1;
  none.ticks_out = none.ticks_in = 0;
  const Delayed unchanged(none);
  int equal = 0;
  for_each_recorded([&](const fs::path &file, const std::string &) {
    const auto port = fine.experiment(file);
    const auto direct = unchanged.experiment(file);
    if (!port || !direct) return;
    const Hashes through = run_through(*direct, bus);
    if (through.enablings > 0) return;
    const RunResult result = run(*port, {.trace = false, .audit = false, .firmware_hash = true});
    EXPECT_EQ(through.firmware, result.firmware_hash) << file;
    ++equal;
  });
  EXPECT_GT(equal, 20 / kEvery);
}

}  // namespace
}  // namespace forceaxis::host
