// A million random frames to the master of a drive, from a drive that behaves and from one that
// does not, against the model of drive402_model.hpp.

#include "tests/firmware/unit/drive402_model.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "tests/support/drive402_node.hpp"

namespace {

constexpr uint8_t kDrive = 9, kMaster = 1;

// With sanitizers, which look at memory and not at answers, a fifth is enough.
#ifdef __SANITIZE_ADDRESS__
constexpr long kFrames = 200'000;
#else
constexpr long kFrames = 1'000'000;
#endif

std::array<long, 16> Fields(const drive402_feedback_t &f) {
  return {f.position_cnt, f.torque,       f.age_ticks,  f.statusword, f.error_code, f.fitted,
          f.on,           f.fault,        f.limit,      f.saturated,  f.phase,      f.state,
          f.reason,       f.failed_index, f.failed_sub, f.abort_code};
}

class Flood {
 public:
  explicit Flood(uint32_t seed) : random_(seed) {}

  bool Chance(uint32_t one_in) { return random_() % one_in == 0; }

  void Configure() {
    static const drive402_entry_t extra[] = {{0x605A, 0, 2, 0xABCD0006}, {0x60FF, 0, 4, 0}};
    config_ = {};
    config_.extra = extra;
    config_.extra_count = static_cast<uint8_t>(random_() % 3);
    config_.mode = static_cast<uint8_t>(8 + random_() % 3);
    config_.scale_num = 1 + random_() % 100000;
    config_.scale_den = 1 + random_() % 1000;
    config_.target_max =
        1 + static_cast<int32_t>(random_() % (config_.mode == 10 ? 32767 : 2000000000));
    config_.heartbeat_ms = static_cast<uint16_t>(5 + random_() % 20);
    config_.heartbeat_timeout_ms = static_cast<uint16_t>(config_.heartbeat_ms * 2 + random_() % 30);
    config_.sdo_timeout_ms = static_cast<uint16_t>(1 + random_() % 20);
    config_.wait_ms = static_cast<uint16_t>(20 + random_() % 60);
    config_.quick_stop_ms = static_cast<uint16_t>(random_() % 20);
    config_.abort_option = static_cast<int16_t>(random_() % 4);
    config_.cycle_ms = static_cast<uint8_t>(2 * (1 + random_() % 3));
    config_.rpdo_type = Chance(2) ? 1 : 255;
    config_.node_id = kDrive;
    config_.own_node_id = kMaster;
    config_.without = static_cast<uint16_t>(Chance(5) ? random_() & 0x7FFF : random_() % 16);
    config_.differs = static_cast<uint16_t>(Chance(4) ? random_() & DRIVE402_DIFFERS_ALL : 0);
  }

  // A frame that no drive would send now.
  Frame Any() {
    static const uint16_t ids[] = {0x80,  0x180, 0x180, 0x580, 0x580, 0x700, 0x700,
                                   0x000, 0x081, 0x200, 0x600, 0x7E5, 0x008, 0x701 - kDrive};
    static const uint8_t firsts[] = {0x40, 0x21, 0x23, 0x27, 0x07, 0x08, 0x60, 0x4F, 0x80, 5, 0};
    Bytes data(Chance(3) ? random_() % 9 : Chance(2) ? 8 : 1);
    for (uint8_t &byte : data) byte = static_cast<uint8_t>(random_());
    if (!data.empty() && !Chance(4)) data[0] = firsts[random_() % std::size(firsts)];
    return {static_cast<uint16_t>(ids[random_() % std::size(ids)] + kDrive), data};
  }

  // What the bus makes of the frames of the drive: lost, doubled, late, changed.
  std::vector<Frame> Disturbed(std::vector<Frame> from_drive, uint32_t one_in) {
    std::vector<Frame> out = std::exchange(late_, {});
    for (Frame &f : from_drive) {
      if (!Chance(one_in)) {
        out.push_back(f);
        continue;
      }
      switch (random_() % 5) {
        case 0:
          break;
        case 1:
          out.insert(out.end(), 1 + random_() % 3, f);
          break;
        case 2:
          late_.push_back(f);
          break;
        case 3:
          if (!f.data.empty()) f.data[random_() % f.data.size()] ^= 1u << random_() % 8;
          out.push_back(f);
          break;
        default:
          out.push_back(Any());
          break;
      }
    }
    return out;
  }

  // A life of a master and its drive. Quiet lives come far, wild ones have random frames.
  void Live() {
    Configure();
    drive402_t master{};
    ASSERT_EQ(drive402_init(&master, &config_), DRIVE402_NONE);
    DriveModel model(config_);
    DriveNode drive(kDrive);
    drive.answers = [this](const Bytes &, Bytes answer) -> std::optional<Bytes> {
      // Of CiA 301: no size, the size of all four bytes, a segmented upload, an abort, no answer.
      static const uint8_t firsts[] = {0x42, 0x43, 0x41, 0x40, 0x4B, 0x80, 0x60};
      if (Chance(500)) answer[0] = firsts[random_() % std::size(firsts)];
      if (Chance(2000)) return std::nullopt;
      return answer;
    };
    const uint32_t disturbed = Chance(3) ? 20 : Chance(2) ? 500 : 5000;
    const uint32_t wild = Chance(4) ? 2 : Chance(3) ? 200 : 3000;
    drive402_command_t command{0, 1, 0};
    bool kept = false;
    for (int tick = 0; tick < 3000; ++tick) {
      std::vector<Frame> received = Disturbed(std::exchange(drive.out, {}), disturbed);
      if (Chance(wild)) received.insert(received.end(), 1 + random_() % 4, Any());
      for (const Frame &f : received) {
        can_frame_t frame{};
        frame.id = f.id;
        frame.length = static_cast<uint8_t>(f.data.size());
        frame.remote = Chance(1000) ? 1 : 0;
        std::copy(f.data.begin(), f.data.end(), frame.data);
        drive402_receive(&master, &frame);
        if (!frame.remote) model.Receive(f);
        ++frames;
      }
      if (Chance(8000)) {
        const bool off = Chance(2);
        drive402_bus(&master, off ? CAN_BUS_OFF : CAN_BUS_PASSIVE, off ? 0 : 1);
        model.Bus(off, off ? 0 : 1);
      }
      ASSERT_EQ(Fields(drive402_feedback(&master)), Fields(model.Say())) << "tick " << tick;
      Disturb(drive);
      if (Chance(300)) command.enable ^= 1;
      if (!command.enable && Chance(20)) command.enable = 1;
      command.reset = Chance(20) ? 1 : 0;
      if (Chance(3)) command.target = static_cast<int32_t>(random_()) >> random_() % 31;
      drive402_tick(&master, &command);
      const drive402_feedback_t before = model.Say();
      const std::vector<Frame> expected = model.Tick(command, kept);
      kept = Chance(10000) && !expected.empty();
      std::vector<Frame> sent;
      for (can_frame_t f{}; !kept && drive402_transmit(&master, &f);) {
        sent.push_back({f.id, {f.data, f.data + f.length}});
      }
      if (!kept) {
        ASSERT_EQ(sent, expected) << "tick " << tick;
      }
      Check(drive402_feedback(&master), model.Say(), before, sent);
      for (const Frame &f : sent) drive.Receive(f);
      drive.Tick();
    }
  }

  long frames = 0, ticks = 0, on = 0, moved = 0;
  std::map<int, long> reasons;
  std::set<int> controls;

 private:
  // Something happens to the drive itself.
  void Disturb(DriveNode &drive) {
    drive.Set(0x6064, static_cast<uint32_t>(random_()) * 7);
    drive.Set(0x6077, static_cast<uint32_t>(random_()) & 0xFFFF);
    drive.extra_status = static_cast<uint16_t>(0x0200 | (random_() & 0xF990));
    if (Chance(1000)) drive.Fail(Chance(2) ? static_cast<uint16_t>(random_()) : 0);
    if (Chance(2000)) drive.state = static_cast<DriveNode::State>(random_() % 8);
    if (Chance(4000)) drive.Reset();
    if (Chance(3000)) drive.nmt = Chance(2) ? 4 : 127;
    if (Chance(3000)) {
      drive.Emergency(static_cast<uint16_t>(random_()),
                      Chance(2) ? uint8_t{0} : static_cast<uint8_t>(random_()));
    }
    const auto now_and_then = [this](bool &is, uint32_t ends, uint32_t begins) {
      is = is ? !Chance(ends) : Chance(begins);
    };
    now_and_then(drive.doubled, 100, 10000);
    now_and_then(drive.short_pdo, 300, 6000);
    now_and_then(drive.stays_disabled, 600, 3000);
    if (drive.missing_status != 0 ? Chance(200) : Chance(3000)) {
      drive.missing_status = drive.missing_status != 0 ? 0 : Chance(2) ? 0x0200 : 0x1000;
    }
    drive.dead = drive.dead ? !Chance(50) : Chance(4000);
    drive.mute_pdo = drive.mute_pdo ? !Chance(20) : Chance(2000);
    drive.mute_heartbeat = drive.mute_heartbeat ? !Chance(100) : Chance(3000);
    drive.fault_stays = drive.fault_stays ? !Chance(200) : Chance(3000);
    if (drive.mode_shown ? Chance(50) : Chance(3000)) {
      drive.mode_shown = drive.mode_shown ? std::nullopt : std::optional<uint8_t>(random_() % 16);
    }
  }

  void Check(const drive402_feedback_t &said, const drive402_feedback_t &model,
             const drive402_feedback_t &before, const std::vector<Frame> &sent) {
    ASSERT_EQ(Fields(said), Fields(model));
    ++ticks;
    on += said.on;
    ++reasons[said.reason];
    for (const Frame &f : sent) {
      if (f.id != 0x200 + kDrive) continue;
      controls.insert(f.data[0]);
      const bool moves = std::any_of(f.data.begin() + 2, f.data.end(), [](uint8_t b) { return b; });
      // Never a target but while the model is on; a failure is answered by the next frame.
      if (moves && config_.mode != DRIVE402_CSP) {
        ASSERT_EQ(f.data[0], 0x0F);
        ASSERT_EQ(before.on, 1);
        ASSERT_EQ(before.reason, 0);
        ++moved;
      }
    }
  }

  std::mt19937 random_;
  drive402_config_t config_{};
  std::vector<Frame> late_;
};

TEST(Drive402Model, AMillionFramesHaveTheAnswersOfTheModel) {
  Flood flood(31);
  while (flood.frames < kFrames && !::testing::Test::HasFatalFailure()) flood.Live();
  if (::testing::Test::HasFatalFailure()) return;
  // The drive was on and moved, and everything that can fail has failed.
  EXPECT_GT(flood.on, flood.ticks / 10);
  EXPECT_GT(flood.moved, kFrames / 100);
  EXPECT_EQ(flood.controls, (std::set<int>{0x00, 0x02, 0x06, 0x07, 0x0F, 0x80}));
  for (int reason = DRIVE402_REFUSED_LAST + 1; reason < DRIVE402_REASON_COUNT; ++reason) {
    EXPECT_GT(flood.reasons[reason], 0) << drive402_reason_text(static_cast<uint8_t>(reason));
  }
  ::testing::Test::RecordProperty("ticks", static_cast<int>(flood.ticks));
}

}  // namespace
