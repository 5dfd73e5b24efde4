// The master of a CiA 402 drive: start, configuration, states, stop, failures; from CiA 301, from
// IEC 61800-7-201 and from the rules of the bus cycle.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <map>
#include <optional>
#include <random>
#include <set>
#include <sstream>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "tests/firmware/unit/drive402_fixture.hpp"
#include "tests/firmware/unit/wide.hpp"

namespace {

// The table "state coding" as it is printed, bits 7 to 0.
const std::vector<std::pair<std::string, int>> kTable{
    {"x0xx0000", DRIVE402_NOT_READY},
    {"x1xx0000", DRIVE402_SWITCH_ON_DISABLED},
    {"x01x0001", DRIVE402_READY},
    {"x01x0011", DRIVE402_SWITCHED_ON},
    {"x01x0111", DRIVE402_OPERATION_ENABLED},
    {"x00x0111", DRIVE402_QUICK_STOP_ACTIVE},
    {"x0xx1111", DRIVE402_FAULT_REACTION},
    {"x0xx1000", DRIVE402_FAULT},
};

int StateByTable(uint16_t word) {
  for (const auto &[pattern, state] : kTable) {
    bool matches = true;
    for (int bit = 0; bit < 8; ++bit) {
      const char wanted = pattern[static_cast<size_t>(7 - bit)];
      matches = matches && (wanted == 'x' || (wanted == '1') == ((word >> bit & 1) != 0));
    }
    if (matches) return state;
  }
  return DRIVE402_UNKNOWN;
}

TEST(Drive402Word, EveryStatuswordIsDecodedByTheTable) {
  std::set<int> seen;
  for (int word = 0; word <= 0xFFFF; ++word) {
    const int state = StateByTable(static_cast<uint16_t>(word));
    ASSERT_EQ(drive402_state_of(static_cast<uint16_t>(word)), state) << std::hex << word;
    seen.insert(state);
  }
  EXPECT_EQ(seen.size(), 9u);
}

TEST(Drive402Word, EveryNameHasAText) {
  for (int i = 0; i < DRIVE402_PHASE_COUNT; ++i)
    EXPECT_GT(std::string(drive402_phase_text(static_cast<uint8_t>(i))).size(), 10u);
  std::set<std::string> texts;
  for (int i = 0; i < DRIVE402_STATE_COUNT; ++i)
    texts.insert(drive402_state_text(static_cast<uint8_t>(i)));
  EXPECT_EQ(texts.size(), static_cast<size_t>(DRIVE402_STATE_COUNT));
  texts.clear();
  for (int i = 0; i < DRIVE402_REASON_COUNT; ++i)
    texts.insert(drive402_reason_text(static_cast<uint8_t>(i)));
  EXPECT_EQ(texts.size(), static_cast<size_t>(DRIVE402_REASON_COUNT));
}

TEST_F(Master402, ConfigurationsAreRefusedByName) {
  const drive402_config_t good = config_;
  static const drive402_entry_t wrong[] = {{0x6065, 0, 3, 0}};
  const std::vector<std::pair<int, std::function<void(drive402_config_t &)>>> cases{
      {DRIVE402_REFUSED_NODE, [](auto &c) { c.node_id = 0; }},
      {DRIVE402_REFUSED_NODE, [](auto &c) { c.node_id = 128; }},
      {DRIVE402_REFUSED_NODE, [](auto &c) { c.own_node_id = 0; }},
      {DRIVE402_REFUSED_NODE, [](auto &c) { c.own_node_id = c.node_id; }},
      {DRIVE402_REFUSED_MODE, [](auto &c) { c.mode = 7; }},
      {DRIVE402_REFUSED_MODE, [](auto &c) { c.mode = 11; }},
      {DRIVE402_REFUSED_CYCLE, [](auto &c) { c.cycle_ms = 0; }},
      {DRIVE402_REFUSED_CYCLE, [](auto &c) { c.cycle_ms = 1; }},
      {DRIVE402_REFUSED_CYCLE, [](auto &c) { c.cycle_ms = 3; }},
      {DRIVE402_REFUSED_CYCLE, [](auto &c) { c.cycle_ms = 102; }},
      {DRIVE402_REFUSED_TYPE, [](auto &c) { c.rpdo_type = 0; }},
      {DRIVE402_REFUSED_TYPE, [](auto &c) { c.rpdo_type = 2; }},
      {DRIVE402_REFUSED_TYPE, [](auto &c) { c.rpdo_type = 253; }},
      {DRIVE402_REFUSED_SCALE, [](auto &c) { c.scale_num = 0; }},
      {DRIVE402_REFUSED_SCALE, [](auto &c) { c.scale_den = 0; }},
      {DRIVE402_REFUSED_SCALE, [](auto &c) { c.scale_den = 0x80000000; }},
      {DRIVE402_REFUSED_SCALE, [](auto &c) { c.scale_shift = 17; }},
      {DRIVE402_REFUSED_SCALE, [](auto &c) { c.scale_den = 0x7FFFFFFF, c.scale_shift = 4; }},
      {DRIVE402_REFUSED_TARGET, [](auto &c) { c.target_max = 0; }},
      {DRIVE402_REFUSED_TARGET, [](auto &c) { c.target_max = -1; }},
      {DRIVE402_REFUSED_TARGET, [](auto &c) { c.target_max = INT32_MAX - 4; }},
      {DRIVE402_REFUSED_TARGET,
       [](auto &c) {
         c.mode = DRIVE402_CST;
         c.target_max = 32768;
       }},
      {DRIVE402_REFUSED_TIMES, [](auto &c) { c.heartbeat_ms = 0; }},
      {DRIVE402_REFUSED_TIMES, [](auto &c) { c.heartbeat_timeout_ms = c.heartbeat_ms; }},
      {DRIVE402_REFUSED_TIMES, [](auto &c) { c.sdo_timeout_ms = 0; }},
      {DRIVE402_REFUSED_TIMES, [](auto &c) { c.wait_ms = 0; }},
      {DRIVE402_REFUSED_ENTRIES, [](auto &c) { c.differs = DRIVE402_WITHOUT_TPDO_MAPPING; }},
      {DRIVE402_REFUSED_ENTRIES,
       [](auto &c) {
         c.extra = wrong;
         c.extra_count = 1;
       }},
  };
  for (const auto &[reason, change] : cases) {
    config_ = good;
    change(config_);
    EXPECT_EQ(Init(), reason) << drive402_reason_text(static_cast<uint8_t>(reason));
    EXPECT_EQ(Feedback().fitted, 0);
    command_ = {100, 1, 0};
    for (int i = 0; i < 300; ++i) {
      command_.reset = i % 2 == 0;
      Tick();
      ASSERT_TRUE(sent_.empty());
    }
    EXPECT_EQ(Feedback().reason, reason);
    EXPECT_EQ(Feedback().fault, 1);
  }
  for (const int ms : {2, 4, 50, 100}) {
    config_ = good;
    config_.cycle_ms = static_cast<uint8_t>(ms);
    EXPECT_EQ(Init(), DRIVE402_NONE);
  }
}

TEST_F(Master402, TheDriveIsResetConfiguredAndStarted) {
  static const drive402_entry_t extra[] = {{0x605A, 0, 2, 6}};
  config_.extra = extra;
  config_.extra_count = 1;
  Init();
  Step();
  ASSERT_EQ(sent_.front(), (Frame{0, {0x81, kDrive}}));
  EXPECT_EQ(Feedback().phase, DRIVE402_RESETTING);
  EXPECT_EQ(Feedback().age_ticks, 65535);
  Until(DRIVE402_STARTING);
  EXPECT_EQ(drive_.nmt, DriveNode::kPreOperational);
  Until(DRIVE402_RUNNING);
  EXPECT_EQ(drive_.nmt, DriveNode::kOperational);
  EXPECT_EQ(drive_.written.front(), (DriveNode::Address{0x605A, 0}));
  EXPECT_EQ(drive_.Get(0x605A), 6u);
  EXPECT_EQ(drive_.Get(0x1005), 0x80u);
  EXPECT_EQ(drive_.Get(0x1006), 2000u);
  EXPECT_EQ(drive_.Get(0x1016, 1), 0x10000u * kMaster + 50);
  EXPECT_EQ(drive_.Get(0x1017), 20u);
  EXPECT_EQ(drive_.Get(0x6007), 3u);
  EXPECT_EQ(drive_.Get(0x1400, 1), uint32_t{kRpdo});
  EXPECT_EQ(drive_.Get(0x1400, 2), 255u);
  EXPECT_EQ(drive_.Get(0x1600), 2u);
  EXPECT_EQ(drive_.Get(0x1600, 1), 0x60400010u);
  EXPECT_EQ(drive_.Get(0x1600, 2), 0x60FF0020u);
  EXPECT_EQ(drive_.Get(0x1800, 1), 0x40000000u | kTpdo);
  EXPECT_EQ(drive_.Get(0x1800, 2), 1u);
  EXPECT_EQ(drive_.Get(0x1A00), 3u);
  EXPECT_EQ(drive_.Get(0x1A00, 1), 0x60410010u);
  EXPECT_EQ(drive_.Get(0x1A00, 2), 0x60640020u);
  EXPECT_EQ(drive_.Get(0x1A00, 3), 0x60770010u);
  EXPECT_EQ(drive_.Get(0x60C2, 1), 2u);  // 2 x 10^-3 s
  EXPECT_EQ(drive_.Get(0x60C2, 2), 0xFDu);
  EXPECT_EQ(drive_.Get(0x6060), 9u);
  // Not enabled: nothing moves and the drive stays off.
  for (int i = 0; i < 100; ++i) {
    Tick();
    if (Controlword() >= 0) {
      EXPECT_EQ(Controlword(), 0);
    }
    EXPECT_EQ(Target(), 0);
  }
  EXPECT_EQ(drive_.state, DriveNode::kSwitchOnDisabled);
}

TEST_F(Master402, EachModeMapsItsTarget) {
  for (const auto &[mode, object, length] :
       {std::tuple{8, 0x607A0020u, 6}, {9, 0x60FF0020u, 6}, {10, 0x60710010u, 4}}) {
    config_.mode = static_cast<uint8_t>(mode);
    Run();
    EXPECT_EQ(drive_.Get(0x1600, 2), object);
    EXPECT_EQ(drive_.Get(0x6060), static_cast<uint32_t>(mode));
    NextRpdo();
    for (const Frame &f : sent_) {
      if (f.id == kRpdo) {
        EXPECT_EQ(f.data.size(), static_cast<size_t>(length));
      }
    }
  }
}

TEST_F(Master402, WhatADriveLacksIsLeftOut) {
  config_.without = DRIVE402_WITHOUT_SYNC_ID | DRIVE402_WITHOUT_SYNC_PERIOD |
                    DRIVE402_WITHOUT_INTERPOLATION | DRIVE402_WITHOUT_ABORT_OPTION;
  Run();
  for (const auto &[index, sub] : drive_.written) {
    EXPECT_NE(index, 0x1005);
    EXPECT_NE(index, 0x1006);
    EXPECT_NE(index, 0x6007);
    EXPECT_NE(index, 0x60C2);
  }
  EXPECT_EQ(drive_.Get(0x6060), 9u);
}

// Every request of the configuration, in turn, is answered in every way. An object that has its
// value already need not be written, nobody has to have 1019h, and whether 1006h takes the 0 that
// 1019h needs is its own affair.
TEST_F(Master402, EveryEntryThatFailsIsNamed) {
  static const drive402_entry_t extra[] = {{0x605A, 0, 2, 6}};
  config_.extra = extra;
  config_.extra_count = 1;
  size_t requests = 0;
  drive_.answers = [&](const Bytes &, const Bytes &answer) {
    ++requests;
    return answer;
  };
  Run();
  ASSERT_EQ(drive_.written.size(), 25u);
  ASSERT_EQ(requests, 2u * 26 - 3);
  enum Way { kAborted, kLost, kMute, kOtherValue, kFewerBytes, kOtherCommand, kWays };
  for (size_t n = 0; n < requests; ++n) {
    for (int way = 0; way < kWays; ++way) {
      size_t asked = 0;
      DriveNode::Address failed{};
      bool reads = false, is_small = false;
      drive_ = DriveNode(kDrive);
      drive_.out.clear();
      drive_.answers = [&](const Bytes &request, const Bytes &answer) -> std::optional<Bytes> {
        const size_t number = asked++;
        if (number != n && !(way == kMute && number == n + 1)) return answer;
        if (number == n + 1) return std::nullopt;
        failed = {static_cast<uint16_t>(request[1] | request[2] << 8), request[3]};
        reads = request[0] == 0x40;
        is_small = answer[0] == 0x4F;
        Bytes wrong = answer;
        switch (way) {
          case kAborted:
            wrong[0] = 0x80;
            PutWord(wrong, 4, 0x06090030);
            return wrong;
          case kLost:
          case kMute:
            return std::nullopt;
          case kOtherValue:
            wrong[4] ^= 1;
            return wrong;
          case kFewerBytes:
            wrong[0] = reads ? static_cast<uint8_t>(wrong[0] + 4) : wrong[0] ^ 0x20;
            return wrong;
          default:
            wrong[0] = 0xC1;  // a block upload
            return wrong;
        }
      };
      Init();
      int ticks = 0;
      for (; ticks < 2000 && Feedback().reason == 0 && Feedback().phase < 2; ++ticks) Tick();
      const bool is_optional = failed.first == 0x1019;
      int expected = DRIVE402_NONE;
      switch (way) {
        case kAborted:
          // The node has taken what it says that it has not, so it has the value.
          if (reads && !is_optional) expected = DRIVE402_SDO_ABORTED;
          break;
        case kMute:
          expected = DRIVE402_SDO_TIMEOUT;
          break;
        case kOtherValue:
          if (reads && !is_optional) expected = DRIVE402_SDO_DIFFERS;
          break;
        case kFewerBytes:
          if (!reads || !is_small) expected = DRIVE402_SDO_UNEXPECTED;
          break;
        case kOtherCommand:
          expected = DRIVE402_SDO_UNEXPECTED;
          break;
        default:
          break;
      }
      const drive402_feedback_t said = Feedback();
      ASSERT_EQ(said.reason, expected) << "request " << n << ", way " << way;
      if (expected == DRIVE402_NONE) continue;
      EXPECT_EQ(said.failed_index, failed.first);
      EXPECT_EQ(said.failed_sub, failed.second);
      if (way == kAborted) {
        EXPECT_EQ(said.abort_code, 0x06090030u);
      }
      EXPECT_EQ(said.fault, 1);
      EXPECT_EQ(said.on, 0);
      // It waits for a reset, and then succeeds.
      command_.enable = 1;
      Tick(300);
      EXPECT_EQ(drive_.nmt, DriveNode::kPreOperational);
      EXPECT_EQ(Feedback().reason, expected);
      command_.enable = 0;
      Reset();
      Until(DRIVE402_RUNNING);
      EXPECT_EQ(Feedback().failed_index, 0);
    }
  }
}

// A refused download is a failure with its abort code, unless the drive has the value.
TEST_F(Master402, ARefusedDownloadNeedsTheValue) {
  for (const bool has_value : {false, true}) {
    drive_ = DriveNode(kDrive);
    drive_.out.clear();
    drive_.read_only = {{0x1017, 0}};
    drive_.at_reset = {{{0x1017, 0}, has_value ? 20u : 25u}};
    drive_.Reset();
    Init();
    Tick(600);
    EXPECT_EQ(Feedback().reason, has_value ? DRIVE402_NONE : DRIVE402_SDO_ABORTED);
    EXPECT_EQ(Feedback().phase, has_value ? DRIVE402_RUNNING : DRIVE402_CONFIGURING);
    EXPECT_EQ(Feedback().failed_index, has_value ? 0 : 0x1017);
    EXPECT_EQ(Feedback().abort_code, has_value ? 0 : 0x06010002u);
    const drive402_feedback_t said = Feedback();
    const char *key = drive402_key(&said);
    EXPECT_EQ(std::string(key == nullptr ? "" : key), has_value ? "" : "1017h");
  }
}

// CiA 301: 1019h is changed only while 1006h is 0; both may be stored.
TEST_F(Master402, AStoredSyncCounterIsSwitchedOff) {
  drive_.at_reset = {{{0x1006, 0}, 5000u}, {{0x1019, 0}, 240u}};
  drive_.Reset();
  Run();
  EXPECT_EQ(drive_.Get(0x1019), 0u);
  EXPECT_EQ(drive_.Get(0x1006), 2000u);
}

TEST_F(Master402, AnswersAboutOtherObjectsAreIgnored) {
  drive_.answers = [this](const Bytes &request, const Bytes &answer) -> std::optional<Bytes> {
    Bytes other = answer;
    other[3] ^= 1;
    drive_.Send(kSdo, other);
    other = answer;
    other[1] ^= 1;
    drive_.Send(kSdo, other);
    drive_.Send(kSdo, Bytes(answer.begin(), answer.end() - 1));
    (void)request;
    return answer;
  };
  Run();
  EXPECT_EQ(drive_.written.size(), 24u);
}

// The bytes of an answer to the read of 6061h, with identifiers of other services.
TEST_F(Master402, FramesOfOtherServicesAreNoAnswers) {
  Run();
  drive_.answers = [](const Bytes &, const Bytes &) { return std::nullopt; };
  const Bytes answer{0x4F, 0x61, 0x60, 0x00, 0x09, 0x00, 0x00, 0x00};
  for (int i = 0; i < 200 && !HasFailure(); ++i) {
    for (const int id : {0x600 + kDrive, 0x700 + kDrive}) {
      Hand({static_cast<uint16_t>(id), answer});
    }
    Tick();
  }
  EXPECT_EQ(Feedback().reason, DRIVE402_SDO_TIMEOUT);
  EXPECT_EQ(Feedback().failed_index, 0x6061);
}

TEST_F(Master402, TheWaitForTheBootUpEnds) {
  drive_.dead = true;
  Init();
  Tick(150);  // 100 ms
  EXPECT_EQ(Feedback().reason, DRIVE402_NONE);
  Tick(2);
  EXPECT_EQ(Feedback().reason, DRIVE402_BOOT_TIMEOUT);
  drive_.dead = false;
  drive_.Reset();  // a boot-up that comes later changes nothing until a reset is asked for
  Tick(300);
  EXPECT_EQ(Feedback().phase, DRIVE402_RESETTING);
  Reset();
  Until(DRIVE402_RUNNING);
}

TEST_F(Master402, ABootUpWithinTheConfigurationStartsItAgain) {
  Init();
  Tick(20);
  ASSERT_EQ(Feedback().phase, DRIVE402_CONFIGURING);
  drive_.Reset();
  Until(DRIVE402_RUNNING);
  EXPECT_EQ(drive_.Get(0x1006), 2000u);
}

TEST_F(Master402, TheWaitForTheFirstTpdoEnds) {
  Init();
  Until(DRIVE402_STARTING);
  drive_.mute_pdo = true;
  Tick(150);
  EXPECT_EQ(Feedback().reason, DRIVE402_NONE);
  Tick(2);
  EXPECT_EQ(Feedback().reason, DRIVE402_NO_TPDO);
  EXPECT_EQ(Feedback().phase, DRIVE402_STARTING);
  drive_ = DriveNode(kDrive);
  drive_.short_pdo = true;
  Init();
  Tick(600);
  EXPECT_EQ(Feedback().reason, DRIVE402_TPDO_LENGTH);
  drive_ = DriveNode(kDrive);
  drive_.mute_heartbeat = true;
  Init();
  Tick(600);
  EXPECT_EQ(Feedback().reason, DRIVE402_START_TIMEOUT);
}

TEST_F(Master402, SyncAndRpdoComeInEachCycle) {
  for (const int ms : {2, 6, 20}) {
    config_.cycle_ms = static_cast<uint8_t>(ms);
    Run();
    NextRpdo();
    const int cycle = ms * 3 / 2;
    for (int i = 1; i <= 20 * cycle; ++i) {
      drive402_bus(&master_, CAN_BUS_PASSIVE, 0);  // nothing was lost
      Tick();
      EXPECT_EQ(Feedback().reason, DRIVE402_NONE);
      EXPECT_EQ(Count(0x80), i % cycle == 0 ? 1 : 0);
      EXPECT_EQ(Count(kRpdo), i % cycle == 0 ? 1 : 0);
      if (i % cycle == 0) {
        EXPECT_EQ(sent_[0], (Frame{0x80, {}}));
      }
    }
  }
}

TEST_F(Master402, EnablingTakesOneTransitionInACycle) {
  Run();
  NextRpdo();
  command_ = {100, 1, 0};
  std::vector<int> words;
  std::vector<int> states;
  for (int i = 0; i < 6; ++i) {
    Tick(kCycle);
    words.push_back(Controlword());
    states.push_back(drive_.state);
    if (i < 4) {
      EXPECT_EQ(Feedback().on, 0);
      EXPECT_EQ(Target(), 0);
    }
  }
  EXPECT_EQ(words, (std::vector<int>{6, 6, 7, 7, 15, 15}));
  EXPECT_EQ(states, (std::vector<int>{DriveNode::kReady, DriveNode::kReady, DriveNode::kSwitchedOn,
                                      DriveNode::kSwitchedOn, DriveNode::kOperationEnabled,
                                      DriveNode::kOperationEnabled}));
  Tick(kCycle);
  EXPECT_EQ(Feedback().on, 1);
  EXPECT_EQ(Target(), 350);  // 100 x 7/2
}

// What keeps an enabled drive from being on has a name after wait_ms; once it is gone, a reset
// needs no new start of the node.
TEST_F(Master402, ADriveThatDoesNotComeOnSaysWhy) {
  struct Case {
    int reason;
    std::function<void()> ails, heals;
    bool starts_again;
  };
  const Case cases[] = {
      {DRIVE402_MODE_LOST, [this] { drive_.mode_shown = 8; }, [this] { drive_.mode_shown.reset(); },
       true},
      {DRIVE402_NOT_REMOTE, [this] { drive_.missing_status = 0x0200; },
       [this] { drive_.missing_status = 0; }, false},
      {DRIVE402_TARGET_IGNORED, [this] { drive_.missing_status = 0x1000; },
       [this] { drive_.missing_status = 0; }, false},
      {DRIVE402_NOT_ENABLED, [this] { drive_.stays_disabled = true; },
       [this] { drive_.stays_disabled = false; }, false},
  };
  for (const Case &c : cases) {
    drive_ = DriveNode(kDrive);
    drive_.out.clear();
    command_ = {};
    Run();
    c.ails();
    Tick(400);  // the wait begins when the drive is to be enabled
    EXPECT_EQ(Feedback().reason, DRIVE402_NONE);
    command_ = {100, 1, 0};
    int ticks = 0;
    for (; Feedback().reason == 0 && ticks < 1000; ++ticks) {
      Tick();
      EXPECT_EQ(Feedback().on, 0);
      EXPECT_EQ(Target(), 0);
    }
    EXPECT_NEAR(ticks, 150, 1);  // 100 ms
    EXPECT_EQ(Feedback().reason, c.reason);
    c.heals();
    drive_.written.clear();
    Reset();
    Tick(c.starts_again ? 600 : 60);
    EXPECT_EQ(drive_.written.empty(), !c.starts_again);
    EXPECT_EQ(Feedback().on, 1);
    // And what ails a drive that is on stops it.
    c.ails();
    if (c.reason == DRIVE402_NOT_ENABLED) drive_.state = DriveNode::kSwitchOnDisabled;
    for (ticks = 0; Feedback().reason == 0 && ticks < 100; ++ticks) Tick();
    EXPECT_LE(ticks, c.reason == DRIVE402_MODE_LOST ? 20 : kCycle + 1);
    EXPECT_EQ(Feedback().reason, c.reason == DRIVE402_NOT_ENABLED ? +DRIVE402_DRIVE_OFF : c.reason);
    Tick();
    EXPECT_NE(drive_.state, DriveNode::kOperationEnabled);
  }
}

TEST_F(Master402, ABitThatADriveLacksIsNotNeeded) {
  drive_.missing_status = 0x1200;
  config_.without = DRIVE402_WITHOUT_REMOTE | DRIVE402_WITHOUT_FOLLOWS;
  Enable();
}

// In each state that a statusword can show, the next controlword is that of the standard.
TEST_F(Master402, EachStateHasItsNextTransition) {
  const std::map<int, int> up{{DRIVE402_SWITCH_ON_DISABLED, 6},
                              {DRIVE402_READY, 7},
                              {DRIVE402_SWITCHED_ON, 15},
                              {DRIVE402_OPERATION_ENABLED, 15}};
  std::mt19937 random(402);
  for (const int enable : {0, 1}) {
    drive_ = DriveNode(kDrive);
    drive_.out.clear();
    Run();
    NextRpdo();
    config_.wait_ms = 60000;
    command_ = {100, static_cast<uint8_t>(enable), 0};
    drive_.mute_pdo = true;
    drive_.out.clear();
    for (int i = 0; i < 4000 && !HasFailure(); ++i) {
      const uint16_t word = static_cast<uint16_t>(random() & 0xFFFF);
      const int state = StateByTable(word);
      if (state == DRIVE402_FAULT || state == DRIVE402_FAULT_REACTION) continue;
      if (Feedback().on != 0 && (word & 0x1200) != 0x1200) continue;
      Bytes data = LittleEndian(word, 2);
      data.resize(8);
      const bool was_on = Feedback().on != 0;
      const bool was_enabled = LastWord() == 15;
      Hand({kTpdo, data});
      EXPECT_EQ(Feedback().state, state);
      EXPECT_EQ(Feedback().statusword, word);
      EXPECT_EQ(Feedback().limit, word >> 11 & 1);
      NextRpdo();
      const auto found = up.find(state);
      if (was_on && state != DRIVE402_OPERATION_ENABLED) {
        ASSERT_TRUE(was_enabled);
        EXPECT_EQ(Feedback().reason, DRIVE402_DRIVE_OFF);
        EXPECT_EQ(Controlword(), 2);
        EXPECT_EQ(Target(), 0);
        Reset();
        Hand({kTpdo, data});
        while (Feedback().reason == 0 && LastWord() == 2) {
          Hand({kTpdo, data});
          NextRpdo();
        }
      } else {
        EXPECT_EQ(Controlword(), enable == 0 || found == up.end() ? 0 : found->second)
            << std::hex << word;
      }
    }
    EXPECT_FALSE(HasFailure()) << drive402_reason_text(Feedback().reason);
  }
}

TEST_F(Master402, DisablingIsAQuickStopAndThenNoVoltage) {
  for (int shift = 0; shift < kCycle; ++shift) {
    for (const int option : {2, 6}) {  // 605Ah: leaves quick stop by itself, or stays
      drive_ = DriveNode(kDrive);
      drive_.out.clear();
      Enable();
      Tick(shift);
      command_.enable = 0;
      Tick();
      EXPECT_EQ(Controlword(), 2) << "in the same tick";
      EXPECT_EQ(Target(), 0);
      EXPECT_EQ(Feedback().on, 0);
      EXPECT_EQ(drive_.state, DriveNode::kQuickStopActive);
      if (option == 2) drive_.state = DriveNode::kSwitchOnDisabled;
      for (int i = 1; i <= 60; ++i) {
        Tick();
        EXPECT_EQ(Target(), 0);
        // 10 ms, or until the statusword shows that the drive has left it.
        if (Controlword() >= 0 && (option == 6 || i > kCycle)) {
          EXPECT_EQ(Controlword(), option == 6 && i <= 15 ? 2 : 0) << i;
        }
      }
      EXPECT_EQ(drive_.state, DriveNode::kSwitchOnDisabled);
      EXPECT_EQ(Feedback().reason, DRIVE402_NONE);
      command_.enable = 1;
      Tick(60);
      EXPECT_EQ(Feedback().on, 1);
    }
  }
}

TEST_F(Master402, AnEnableWithinAStopWaitsForItsEnd) {
  Enable();
  command_.enable = 0;
  Tick();
  command_.enable = 1;
  for (int i = 0; i < 13; ++i) {
    Tick();
    if (Controlword() >= 0) {
      EXPECT_EQ(Controlword(), 2);
    }
  }
  std::vector<int> words;
  for (int i = 0; i < 40; ++i) {
    Tick();
    if (Controlword() >= 0 && (words.empty() || words.back() != Controlword()))
      words.push_back(Controlword());
  }
  // From quick stop active by switch on disabled, not by transition 16.
  EXPECT_EQ(words, (std::vector<int>{2, 0, 6, 7, 15}));
  EXPECT_EQ(Feedback().on, 1);
}

TEST_F(Master402, AFaultOfTheDriveIsResetOnlyWhenAsked) {
  for (const int code : {0x2310, 0}) {
    drive_ = DriveNode(kDrive);
    drive_.out.clear();
    Enable();
    drive_.Fail(static_cast<uint16_t>(code));
    if (code == 0) drive_.Set(0x603F, 0x7300);
    Tick();
    if (code != 0) {
      EXPECT_EQ(Feedback().reason, DRIVE402_DRIVE_EMERGENCY);
      EXPECT_EQ(Controlword(), 2);  // at once
    }
    Tick(kCycle);
    EXPECT_EQ(Feedback().reason, code != 0 ? DRIVE402_DRIVE_EMERGENCY : DRIVE402_DRIVE_FAULT);
    for (int i = 0; i < 300; ++i) {
      Tick();
      EXPECT_EQ(Target(), 0);
      EXPECT_EQ(Feedback().on, 0);
      if (Controlword() >= 0) {
        EXPECT_TRUE(Controlword() == 0 || Controlword() == 2);
      }
    }
    EXPECT_EQ(Feedback().error_code, code != 0 ? code : 0x7300);  // by EMCY or from 603Fh
    EXPECT_EQ(drive_.state, DriveNode::kFault);
    // A level is no wish: only the edge resets.
    Reset();
    for (int i = 0; i < 30; ++i) {
      Tick();
      EXPECT_NE(Controlword() == 0x80 && Target() != 0, true);
    }
    EXPECT_NE(drive_.state, DriveNode::kFault);
    EXPECT_EQ(Feedback().reason, DRIVE402_NONE);
    Tick(30);
    EXPECT_EQ(Feedback().on, 1);
  }
}

// Of an emergency message the error register says whether there is an error: bit 0 is set in any
// error (CiA 301), and a drive that sets another bit alone means one too.
TEST_F(Master402, AnEmergencyMessageWithoutAnErrorIsNoFailure) {
  Enable();
  for (const uint16_t code : {0xFF02, 0xFF03, 0xFF04, 0x8110}) {
    drive_.Emergency(code, 0);
    Tick(20);
    EXPECT_EQ(Feedback().error_code, code) << "kept";
    EXPECT_EQ(Feedback().reason, DRIVE402_NONE);
    EXPECT_EQ(Feedback().fault, 0);
    EXPECT_EQ(Feedback().on, 1);
  }
  for (const uint8_t remains : {0x00, 0x01, 0xFF}) {  // the end of one of several errors
    drive_.Emergency(0, remains);
    Tick(20);
    EXPECT_EQ(Feedback().error_code, 0x8110);
    EXPECT_EQ(Feedback().on, 1);
  }
  for (int bit = 0; bit < 8; ++bit) {
    drive_ = DriveNode(kDrive);
    drive_.out.clear();
    Enable();
    drive_.Emergency(0xFF02, static_cast<uint8_t>(1 << bit));
    Tick();
    EXPECT_EQ(Feedback().reason, DRIVE402_DRIVE_EMERGENCY) << bit;
    EXPECT_EQ(Feedback().error_code, 0xFF02);
    EXPECT_EQ(Controlword(), 2);
  }
}

// A fault whose emergency message says that there is none is still seen in the statusword.
TEST_F(Master402, AFaultWithAWarningIsSeenInTheStatusword) {
  Enable();
  drive_.Fail(0);
  drive_.Emergency(0x2310, 0);
  Tick(kCycle + 1);
  EXPECT_EQ(Feedback().reason, DRIVE402_DRIVE_FAULT);
  EXPECT_EQ(Feedback().error_code, 0x2310);
}

// Bit 7 stays 1 until the drive has left the state, and then one transition in a cycle follows.
TEST_F(Master402, TheFaultResetIsHeldUntilTheFaultHasGone) {
  config_.wait_ms = 200;
  for (const int needed : {1, 2, 5, 20, 45}) {  // cycles for which the drive wants to see bit 7
    drive_ = DriveNode(kDrive);
    drive_.out.clear();
    Enable();
    drive_.fault_stays = true;
    drive_.Fail(0x4310);
    Tick(30);
    command_.reset = 1;
    std::vector<int> words;
    for (int seen = 0; Feedback().on == 0 && words.size() < 60;) {
      NextRpdo();
      words.push_back(Controlword());
      seen += Controlword() == 0x80;
      if (seen == needed) drive_.state = DriveNode::kSwitchOnDisabled;
    }
    command_.reset = 0;
    EXPECT_EQ(std::count(words.begin(), words.end(), 0x80), needed + 1) << "and one on its way";
    EXPECT_EQ(Feedback().on, 1);
  }
}

// An axis may be enabled while its drive still starts.
TEST_F(Master402, AFaultInWhichTheDriveStartsIsResetIfThatWasAskedBefore) {
  for (const bool asked : {false, true}) {
    drive_ = DriveNode(kDrive);
    drive_.out.clear();
    command_ = {};
    Init();
    Until(DRIVE402_STARTING);
    drive_.state = DriveNode::kFault;
    command_ = {100, 1, static_cast<uint8_t>(asked ? 1 : 0)};
    Tick(150);
    EXPECT_EQ(Feedback().on, asked ? 1 : 0);
    EXPECT_EQ(Feedback().reason, asked ? DRIVE402_NONE : DRIVE402_DRIVE_FAULT);
  }
}

TEST_F(Master402, AFaultThatStaysIsReportedAgain) {
  Enable();
  drive_.fault_stays = true;
  drive_.Fail(0x4310);
  Tick(30);
  Reset();
  int ticks = 1;
  for (; Feedback().reason == 0 && ticks < 300; ++ticks) {
    Tick();
    EXPECT_EQ(Feedback().fault, 1);
    EXPECT_EQ(Feedback().on, 0);
    if (Controlword() >= 0 && Feedback().reason == 0) {
      EXPECT_EQ(Controlword(), 0x80);
    }
  }
  EXPECT_NEAR(ticks, 150, 2);  // 100 ms
  EXPECT_EQ(Feedback().reason, DRIVE402_DRIVE_FAULT);
  NextRpdo();
  EXPECT_EQ(Controlword(), 0x00);
}

TEST_F(Master402, AResetInTheTickOfTheFaultIsNone) {
  Enable();
  drive_.Emergency(0x8611);
  Deliver();
  command_.reset = 1;
  Step();
  EXPECT_EQ(Controlword(), 2);
  EXPECT_EQ(Feedback().reason, DRIVE402_DRIVE_EMERGENCY);
}

TEST_F(Master402, TheDriveLeavingOperationIsAFault) {
  for (const DriveNode::State state :
       {DriveNode::kNotReady, DriveNode::kSwitchOnDisabled, DriveNode::kReady,
        DriveNode::kSwitchedOn, DriveNode::kQuickStopActive}) {
    drive_ = DriveNode(kDrive);
    drive_.out.clear();
    Enable();
    drive_.state = state;
    Tick(kCycle);
    EXPECT_EQ(Feedback().reason, DRIVE402_DRIVE_OFF) << state;
    EXPECT_EQ(Feedback().on, 0);
    EXPECT_EQ(drive_.state == DriveNode::kOperationEnabled, false);
  }
}

// The axis sees that the drive is no longer on, and disables it in the same tick.
TEST_F(Master402, ADriveThatLeavesIsNamedAlsoIfItIsDisabledAtOnce) {
  Enable();
  drive_.missing_status = 0x1000;
  for (int i = 0; i < 2 * kCycle; ++i) {
    Deliver();
    command_.enable = Feedback().on;
    Step();
  }
  EXPECT_EQ(Feedback().reason, DRIVE402_TARGET_IGNORED);
}

TEST_F(Master402, TargetsAreExactAndSaturatedNeverWrapped) {
  std::mt19937 random(7);
  for (const int mode : {DRIVE402_CSV, DRIVE402_CST}) {
    for (int round = 0; round < 40; ++round) {
      config_.mode = static_cast<uint8_t>(mode);
      config_.scale_num = 1 + random() % (round % 2 ? 5000u : 0x7FFFFFFFu);
      config_.scale_den = 1 + random() % (round % 3 ? 5000u : 0x7FFFFFFFu);
      // Targets in fractions of a code, of which not each fraction of the drive is a whole number.
      config_.scale_shift = round % 3 && round % 4 == 1 ? 4 : 0;
      config_.target_max =
          1 + static_cast<int32_t>(random() % (mode == DRIVE402_CST ? 32767u : 2147483642u));
      drive_ = DriveNode(kDrive);
      drive_.out.clear();
      Run();
      command_ = {0, 1, 0};
      Tick(60);
      ASSERT_EQ(Feedback().on, 1);
      for (int i = 0; i < 50; ++i) {
        command_.target =
            i % 2 ? static_cast<int32_t>(random() % 4096) - 2048 : static_cast<int32_t>(random());
        NextRpdo();
        // floor(x num / den + 1/2)
        const Wide under = static_cast<Wide>(config_.scale_den) << config_.scale_shift;
        const Wide exact = FloorDivide(
            static_cast<Wide>(command_.target) * config_.scale_num * 2 + under, under * 2);
        const bool beyond = exact > config_.target_max || exact < -config_.target_max;
        const auto limited =
            static_cast<int64_t>(Clamp(exact, -config_.target_max, config_.target_max));
        EXPECT_EQ(Target(), limited);
        EXPECT_EQ(Feedback().saturated, beyond ? 1 : 0);
      }
    }
  }
}

TEST_F(Master402, InPositionModeTheDriveIsHeldWhereItIs) {
  config_.mode = DRIVE402_CSP;
  config_.scale_num = config_.scale_den = 1;
  config_.target_max = 2000000000;
  drive_.Reset();
  Run();
  const auto at = [this](int32_t position) {
    drive_.Set(0x6064, static_cast<uint32_t>(position));
    Tick(kCycle);
    NextRpdo();
  };
  at(-123456);
  EXPECT_EQ(Target(), -123456);
  command_ = {-123000, 1, 0};
  for (int i = 0; i < 60 && Feedback().on == 0; ++i) {
    at(-123456 - i);
    if (Feedback().on == 0) {
      EXPECT_EQ(Target(), -123456 - i);
    }
  }
  NextRpdo();
  EXPECT_EQ(Target(), -123000);
  command_.enable = 0;
  Tick();
  EXPECT_EQ(Target(), Feedback().position_cnt);
  at(INT32_MIN);  // 6064h wraps at 32 bits
  EXPECT_EQ(Feedback().position_cnt, INT32_MIN);
}

// Any pattern of missing TPDOs: two in succession are a fault, one holds.
TEST_F(Master402, TwoMissingTpdosAreAFaultAndOneHolds) {
  std::mt19937 random(11);
  int faults = 0, held = 0;
  for (int round = 0; round < 60; ++round) {
    drive_ = DriveNode(kDrive);
    drive_.out.clear();
    config_.cycle_ms = static_cast<uint8_t>(2 * (1 + round % 3));
    const int cycle = config_.cycle_ms * 3 / 2;
    Run();
    command_ = {100, 1, 0};
    Tick(40 * cycle);
    ASSERT_EQ(Feedback().on, 1);
    NextRpdo();
    int misses = 0, age = cycle;
    uint32_t position = drive_.Get(0x6064);
    for (int i = 0; i < 200; ++i) {  // a cycle each; the SYNC was sent just now
      const bool missing = random() % 5 == 0;
      if (missing) std::erase_if(drive_.out, [](const Frame &f) { return f.id == kTpdo; });
      if (!missing) {
        // The first one after a missing one may be that one, late.
        age = misses > 0 ? cycle : 0;
        position = drive_.Get(0x6064);
      }
      Deliver();
      EXPECT_EQ(Feedback().age_ticks, age + 1);
      EXPECT_EQ(static_cast<uint32_t>(Feedback().position_cnt), position);
      misses = missing ? misses + 1 : 0;
      held += misses == 1;
      drive_.Set(0x6064, static_cast<uint32_t>(random()));
      Tick(cycle);
      age += cycle;
      if (misses == 2) {
        EXPECT_EQ(Feedback().reason, DRIVE402_TPDO_MISSING);
        EXPECT_EQ(Controlword(), 2);
        EXPECT_EQ(Target(), 0);
        ++faults;
        break;
      }
      ASSERT_EQ(Feedback().reason, DRIVE402_NONE);
      EXPECT_EQ(Controlword(), 15);
      EXPECT_EQ(Target(), 350);
    }
  }
  EXPECT_GT(faults, 40);
  EXPECT_GT(held, 200);
}

TEST_F(Master402, DoubledAndLateFramesAreNoFault) {
  std::mt19937 random(12);
  Enable();
  NextRpdo();
  std::optional<Frame> late;
  int doubled = 0, held = 0;
  for (int i = 0; i < 600; ++i) {  // a cycle each; the SYNC was sent just now
    const bool holds = !late && random() % 3 == 0;
    const bool follows = late.has_value();
    if (late) Hand(*std::exchange(late, std::nullopt));
    for (const Frame &f : std::exchange(drive_.out, {})) {
      if (f.id != kTpdo) {
        Hand(f);
      } else if (holds) {
        late = f;
      } else {
        static const unsigned some[] = {1, 2, 3, 255, 256, 257, 512};
        const unsigned copies = i % 2 != 0 ? 1 : some[random() % 7];
        for (unsigned k = 0; k < copies; ++k) Hand(f);
        doubled += copies > 1;
      }
    }
    if (!holds) {
      EXPECT_EQ(Feedback().position_cnt, static_cast<int32_t>(drive_.Get(0x6064)));
      EXPECT_EQ(Feedback().age_ticks, 1);
    }
    held += follows;
    drive_.Set(0x6064, static_cast<uint32_t>(i));
    Tick(kCycle);
    ASSERT_EQ(Feedback().reason, DRIVE402_NONE) << i;
    EXPECT_EQ(Feedback().on, 1);
    EXPECT_EQ(Controlword(), 15);
  }
  EXPECT_GT(doubled, 100);
  EXPECT_GT(held, 100);
}

// Two nodes of one id, from power-up or one that joins: both answer.
TEST_F(Master402, TwoNodesOfOneIdAreNamed) {
  drive_.doubled = true;
  Init();
  Tick(100);
  EXPECT_EQ(Feedback().reason, DRIVE402_DOUBLED);
  EXPECT_EQ(Feedback().phase, DRIVE402_CONFIGURING);
  drive_ = DriveNode(kDrive);
  drive_.out.clear();
  Enable();
  drive_.doubled = true;
  int ticks = 0;
  for (; Feedback().reason == 0 && ticks < 100; ++ticks) Tick();
  EXPECT_LE(ticks, 3 * kCycle);
  EXPECT_EQ(Feedback().reason, DRIVE402_DOUBLED);
  Tick();
  EXPECT_NE(drive_.state, DriveNode::kOperationEnabled);
}

// A drive that sends its TPDO on a change has no number of them in a cycle.
TEST_F(Master402, ADriveWithoutASynchronousTpdoMaySendSeveral) {
  config_.without = DRIVE402_WITHOUT_TPDO_TYPE;
  drive_.at_reset = {{{0x1800, 2}, 1u}};
  drive_.Reset();
  drive_.out.clear();
  Enable();
  drive_.doubled = true;
  Tick(100);
  EXPECT_EQ(Feedback().on, 1);
}

// Answers to uploads as CiA 301 permits them, and those with too few bytes.
TEST_F(Master402, AnUploadMayHaveAnySizeThatIsEnough) {
  enum Way { kNoSize, kFourBytes, kSegmented, kSegmentedNoSize, kShortSegment, kWays };
  for (int way = 0; way < kWays; ++way) {
    drive_ = DriveNode(kDrive);
    drive_.out.clear();
    Bytes held;
    drive_.answers = [&](const Bytes &request, const Bytes &answer) -> std::optional<Bytes> {
      if (request[0] == 0x60) {  // the segment: up to 7 bytes, of which `held` is the first
        Bytes segment{static_cast<uint8_t>((7 - held.size()) << 1 | 1)};
        segment.insert(segment.end(), held.begin(), held.end());
        segment.resize(8);
        return segment;
      }
      if ((answer[0] & 0xE0) != 0x40) return answer;
      Bytes other = answer;
      const size_t bytes = 4 - (answer[0] >> 2 & 3);
      held.assign(answer.begin() + 4, answer.begin() + 4 + static_cast<long>(bytes));
      if (way == kShortSegment) held.pop_back();
      if (way == kNoSize) other[0] = 0x42;
      if (way == kFourBytes) other[0] = 0x43;
      if (way >= kSegmented) {
        other[0] = way == kSegmentedNoSize ? 0x40 : 0x41;
        PutWord(other, 4, static_cast<uint32_t>(held.size()));
      }
      return other;
    };
    Init();
    Tick(1200);
    if (way == kShortSegment) {
      EXPECT_EQ(Feedback().reason, DRIVE402_SDO_UNEXPECTED);
    } else {
      EXPECT_EQ(Feedback().phase, DRIVE402_RUNNING)
          << way << drive402_reason_text(Feedback().reason);
      command_.enable = 1;
      Tick(60);
      EXPECT_EQ(Feedback().on, 1);
      command_.enable = 0;
    }
  }
}

// Between two requests are 5 ticks, 3.3 ms, also if an answer comes at once.
TEST_F(Master402, RequestsAreNotCloserThan3Ms) {
  Init();
  int last = -100, requests = 0;
  for (int i = 0; i < 600; ++i) {
    Tick();
    if (Count(0x600 + kDrive) == 0) continue;
    EXPECT_GE(i - last, 5);
    last = i;
    ++requests;
  }
  EXPECT_GT(requests, 60);
}

// A drive that is slower than sdo_timeout_ms gets each request twice, and answers each.
TEST_F(Master402, TwoAnswersToARepeatedRequestAreOne) {
  struct Late {
    int at;
    Frame frame;
  };
  std::vector<Late> late;
  int tick = 0;
  drive_.answers = [&](const Bytes &, const Bytes &answer) -> std::optional<Bytes> {
    late.push_back({tick + 60, {kSdo, answer}});  // 40 ms
    return std::nullopt;
  };
  Init();
  for (; tick < 10000 && Feedback().phase < DRIVE402_STARTING && !HasFailure(); ++tick) {
    for (const Late &l : late) {
      if (l.at == tick) Hand(l.frame);
    }
    Tick();
  }
  EXPECT_EQ(Feedback().reason, DRIVE402_NONE) << drive402_reason_text(Feedback().reason);
  EXPECT_EQ(Feedback().phase, DRIVE402_STARTING);
}

// The node of a drive that still stops is not reset.
TEST_F(Master402, ANewStartWaitsForTheEndOfAStop) {
  config_.quick_stop_ms = 300;
  Enable();
  drive402_bus(&master_, CAN_BUS_ACTIVE, 1);
  Tick();
  EXPECT_EQ(Controlword(), 2);
  command_.reset = 1;
  int ticks = 0;
  for (; Count(0) == 0 && ticks < 1000; ++ticks) {
    Tick();
    if (Controlword() >= 0) {
      EXPECT_EQ(Controlword(), 2);
      EXPECT_EQ(Target(), 0);
    }
    EXPECT_EQ(drive_.state == DriveNode::kQuickStopActive, Count(0) == 0);
  }
  EXPECT_NEAR(ticks, 450, 1);
  Until(DRIVE402_RUNNING);
}

// What a drive lacks, one after the other: nothing of it is written, or it is compared alone; the
// rest is as it was.
TEST_F(Master402, EachBitLeavesOutItsObject) {
  const std::map<int, std::set<int>> left_out{
      {DRIVE402_WITHOUT_SYNC_ID, {0x1005}},       {DRIVE402_WITHOUT_SYNC_PERIOD, {0x1006}},
      {DRIVE402_WITHOUT_INTERPOLATION, {0x60C2}}, {DRIVE402_WITHOUT_ABORT_OPTION, {0x6007}},
      {DRIVE402_WITHOUT_CONSUMER, {0x1016}},      {DRIVE402_WITHOUT_PRODUCER, {0x1017}},
      {DRIVE402_WITHOUT_MODE, {0x6060}},
  };
  for (int bit = 1; bit <= DRIVE402_WITHOUT_FOLLOWS; bit *= 2) {
    config_.without = static_cast<uint16_t>(bit);
    drive_ = DriveNode(kDrive);
    drive_.at_reset = {
        {{0x1006, 0}, 2000u},       {{0x1017, 0}, 20u},         {{0x6060, 0}, 9u},
        {{0x1400, 2}, 254u},        {{0x1800, 2}, 1u},          {{0x1600, 0}, 2u},
        {{0x1600, 1}, 0x60400010u}, {{0x1600, 2}, 0x60FF0020u}, {{0x1A00, 0}, 3u},
        {{0x1A00, 1}, 0x60410010u}, {{0x1A00, 2}, 0x60640020u}, {{0x1A00, 3}, 0x60770010u},
    };
    drive_.Reset();
    drive_.out.clear();
    Enable();
    const auto found = left_out.find(bit);
    for (const auto &[index, sub] : drive_.written) {
      if (found != left_out.end()) {
        EXPECT_FALSE(found->second.contains(index)) << bit;
      }
      const bool is_rpdo = index == 0x1600 || (index == 0x1400 && sub == 1);
      const bool is_tpdo = index == 0x1A00 || (index == 0x1800 && sub == 1);
      EXPECT_FALSE(bit == DRIVE402_WITHOUT_RPDO_MAPPING && is_rpdo);
      EXPECT_FALSE(bit == DRIVE402_WITHOUT_TPDO_MAPPING && is_tpdo);
      EXPECT_FALSE(bit == DRIVE402_WITHOUT_RPDO_TYPE && index == 0x1400 && sub == 2);
      EXPECT_FALSE(bit == DRIVE402_WITHOUT_TPDO_TYPE && index == 0x1800 && sub == 2);
      EXPECT_FALSE(bit == DRIVE402_WITHOUT_TORQUE && index == 0x1A00 && sub == 3);
    }
    EXPECT_EQ(drive_.Get(0x1800, 1),
              bit == DRIVE402_WITHOUT_REQUEST_BIT ? kTpdo : 0x40000000u | kTpdo);
  }
  // A fixed mapping has to be the right one.
  config_.without = DRIVE402_WITHOUT_TPDO_MAPPING;
  drive_.at_reset[{0x1A00, 2}] = 0x606C0020u;
  drive_.Reset();
  Init();
  Tick(600);
  EXPECT_EQ(Feedback().reason, DRIVE402_SDO_DIFFERS);
  EXPECT_EQ(Feedback().failed_index, 0x1A00);
  EXPECT_EQ(Feedback().failed_sub, 2);
}

// A drive that keeps a value of its own, or refuses the download: named, and on with its bit.
TEST_F(Master402, AnObjectThatDiffersMayBeWrittenAndNotCompared) {
  const std::pair<DriveNode::Address, int> objects[] = {
      {{0x1005, 0}, DRIVE402_WITHOUT_SYNC_ID},       {{0x1006, 0}, DRIVE402_WITHOUT_SYNC_PERIOD},
      {{0x60C2, 1}, DRIVE402_WITHOUT_INTERPOLATION}, {{0x6007, 0}, DRIVE402_WITHOUT_ABORT_OPTION},
      {{0x1016, 1}, DRIVE402_WITHOUT_CONSUMER},      {{0x1017, 0}, DRIVE402_WITHOUT_PRODUCER},
      {{0x1400, 2}, DRIVE402_WITHOUT_RPDO_TYPE},     {{0x6060, 0}, DRIVE402_WITHOUT_MODE},
  };
  for (const auto &[at, bit] : objects) {
    for (const bool refused : {false, true}) {
      for (const bool differs : {false, true}) {
        config_.differs = static_cast<uint16_t>(differs ? bit : 0);
        drive_ = DriveNode(kDrive);
        drive_.at_reset = {{{0x1005, 0}, 0x81u}, {{0x1006, 0}, 1000u}, {{0x60C2, 1}, 4u},
                           {{0x6007, 0}, 0u},    {{0x1016, 1}, 7u},    {{0x1017, 0}, 15u},
                           {{0x1400, 2}, 254u},  {{0x6060, 0}, 3u}};
        drive_.Reset();
        if (refused) {
          drive_.read_only = {at};
        } else {
          drive_.answers = [&](const Bytes &request, const Bytes &answer) {
            Bytes own = answer;
            const bool its = request[1] == (at.first & 0xFF) && request[2] == at.first >> 8 &&
                             request[3] == at.second;
            if (its && request[0] == 0x40) own[4] ^= 0x40;
            return std::optional(own);
          };
        }
        Init();
        Tick(600);
        const drive402_feedback_t said = Feedback();
        if (differs) {
          EXPECT_EQ(said.reason, DRIVE402_NONE) << std::hex << at.first;
          EXPECT_EQ(said.phase, DRIVE402_RUNNING);
        } else {
          EXPECT_EQ(said.reason, refused ? DRIVE402_SDO_ABORTED : DRIVE402_SDO_DIFFERS);
          EXPECT_EQ(said.failed_index, at.first);
          ASSERT_NE(drive402_key(&said), nullptr);
        }
      }
    }
  }
}

TEST_F(Master402, ShortFramesAreNoTpdos) {
  Enable();
  drive_.mute_pdo = true;
  drive_.out.clear();
  for (int i = 0; i < 3 * kCycle; ++i) {
    Hand({kTpdo, Bytes(7)});
    Hand({kTpdo, Bytes(8)}, true);
    Tick();
  }
  EXPECT_EQ(Feedback().reason, DRIVE402_TPDO_MISSING);
}

// Failures of the bus, of the drive and of its node: the reason, and the ticks from the event to
// the RPDO with quick stop and target 0, the most over its place in the cycle.
struct Stop {
  std::string name;
  int reason;
  int most_ticks;
  std::function<void()> happens;
  bool only_at_sync = false;
};

class StopTimes402 : public Master402 {
 protected:
  std::vector<Stop> Stops() {
    const auto quiet = [](const Bytes &, const Bytes &) { return std::nullopt; };
    const int cycles = 3 * kCycle;  // two SYNCs without an answer are known at the third one
    return {
        {"enable becomes 0", DRIVE402_NONE, 1, [this] { command_.enable = 0; }},
        {"bus off", DRIVE402_BUS_OFF, 1, [this] { drive402_bus(&master_, CAN_BUS_OFF, 0); }},
        {"received frames lost", DRIVE402_FRAMES_LOST, 1,
         [this] { drive402_bus(&master_, CAN_BUS_ACTIVE, 1); }},
        {"frames not sent", DRIVE402_FRAMES_KEPT, 1, [this] { drive402_tick(&master_, &command_); },
         true},
        {"emergency message of an error", DRIVE402_DRIVE_EMERGENCY, 1,
         [this] { drive_.Emergency(0x3210); }},
        {"drive in fault, no emergency message", DRIVE402_DRIVE_FAULT, kCycle + 1,
         [this] { drive_.Fail(0); }},
        {"drive leaves operation enabled", DRIVE402_DRIVE_OFF, kCycle + 1,
         [this] { drive_.state = DriveNode::kSwitchedOn; }},
        {"drive starts again", DRIVE402_BOOTED, 1, [this] { drive_.Reset(); }},
        {"drive stopped by NMT", DRIVE402_NOT_OPERATIONAL, 1,
         [this] {
           Hand({kBeat, {DriveNode::kStopped}});
         }},
        {"drive pre-operational", DRIVE402_NOT_OPERATIONAL, 1,
         [this] {
           Hand({kBeat, {DriveNode::kPreOperational}});
         }},
        {"drive killed", DRIVE402_TPDO_MISSING, cycles, [this] { drive_.dead = true; }},
        {"two TPDOs missing", DRIVE402_TPDO_MISSING, cycles, [this] { drive_.mute_pdo = true; }},
        // From its last one, which comes every 20 ms; 50 ms are 75 ticks.
        {"heartbeat missing, 50 ms", DRIVE402_HEARTBEAT_LOST, 75 + 2,
         [this] { drive_.mute_heartbeat = true; }},
        // 10 ms between two reads, and a request is repeated once.
        {"6061h not answered, 2 x 30 ms", DRIVE402_SDO_TIMEOUT, 15 + 2 * 45 + 3,
         [this, quiet] { drive_.answers = quiet; }},
        {"statusword without bit 9", DRIVE402_NOT_REMOTE, kCycle + 1,
         [this] { drive_.missing_status = 0x0200; }},
        {"statusword without bit 12", DRIVE402_TARGET_IGNORED, kCycle + 1,
         [this] { drive_.missing_status = 0x1000; }},
        {"a second node of the same id", DRIVE402_DOUBLED, cycles,
         [this] { drive_.doubled = true; }},
        {"6061h displays another mode", DRIVE402_MODE_LOST, 15 + 3,
         [this] { drive_.mode_shown = 8; }},
    };
  }

  // Ticks from the event, at this place in the cycle, to the stop.
  int TicksTo(const Stop &stop, int shift) {
    drive_ = DriveNode(kDrive);
    drive_.out.clear();
    Enable();
    Tick(shift);
    stop.happens();
    int ticks = 0;
    do {
      Tick();
      ++ticks;
    } while (Controlword() != 2 && ticks < 200);
    EXPECT_EQ(Target(), 0);
    EXPECT_EQ(Feedback().reason, stop.reason) << stop.name;
    EXPECT_EQ(Feedback().on, 0);
    return ticks;
  }

  // It stays off, and a reset brings a drive back that is well again.
  void ExpectReset(const Stop &stop) {
    for (int i = 0; i < 100; ++i) {
      Tick();
      EXPECT_EQ(Target(), 0);
      if (Controlword() >= 0) {
        EXPECT_TRUE(Controlword() == 2 || Controlword() == 0);
      }
    }
    drive_.dead = drive_.mute_pdo = drive_.mute_heartbeat = false;
    drive_.answers = nullptr;
    drive_.mode_shown.reset();
    drive_.missing_status = 0;
    drive_.doubled = false;
    command_.enable = 1;
    Reset();
    Tick(600);
    EXPECT_EQ(Feedback().reason, DRIVE402_NONE) << stop.name;
    EXPECT_EQ(Feedback().on, 1) << stop.name;
  }
};

TEST_F(StopTimes402, EachEventStopsInTheStatedTicks) {
  std::ostringstream page;
  // The reason without its advice.
  const auto name = [](int reason) {
    const std::string text = drive402_reason_text(static_cast<uint8_t>(reason));
    return text.substr(0, text.find_first_of(":;"));
  };
  page << R"(# Stop times of a drive on CANopen

Ticks of 1/1500 s from an event to the frame by which the master of a drive (`firmware/drive402`)
commands quick stop and target 0, the most over the place of the event in a bus cycle of 2 ms. The
drive of the test has a heartbeat of 20 ms. An emergency message is a reason if the error register
(1001h) in it is not 0; with the register 0 it is a warning, and code 0 is the end of an error.

| event | reason | ticks |
|---|---|---|
)";
  for (const Stop &stop : Stops()) {
    int most = 0;
    for (int shift = 0; shift < (stop.only_at_sync ? 1 : 30); ++shift) {
      const int ticks = TicksTo(stop, shift);
      EXPECT_LE(ticks, stop.most_ticks) << stop.name;
      most = std::max(most, ticks);
      if (shift < kCycle) ExpectReset(stop);
    }
    page << "| " << stop.name << " | " << (stop.reason == DRIVE402_NONE ? "-" : name(stop.reason))
         << " | " << most << " |\n";
  }
  std::ifstream file(DRIVE_STOP_TIMES_FILE);
  std::stringstream kept;
  kept << file.rdbuf();
  if (const char *path = std::getenv("DRIVE_STOP_TIMES")) std::ofstream(path) << page.str();
  EXPECT_EQ(kept.str(), page.str())
      << "docs/drive_stop_times.md is made by DRIVE_STOP_TIMES=docs/drive_stop_times.md "
         "drive402_unit --gtest_filter=StopTimes402.*";
}

TEST_F(Master402, TheFirstFailureIsKept) {
  Enable();
  drive_.Emergency(0x1000);
  Tick();
  drive402_bus(&master_, CAN_BUS_OFF, 1);
  Tick(10);
  EXPECT_EQ(Feedback().reason, DRIVE402_DRIVE_EMERGENCY);
}

TEST_F(Master402, TheHeartbeatOfTheMasterIsRegular) {
  Init();
  std::vector<int> at;
  for (int i = 0; i < 3000; ++i) {
    if (i == 1500) drive_.dead = true;  // also after a failure
    Tick();
    if (Count(0x700 + kMaster) == 1) {
      at.push_back(i);
      for (const Frame &f : sent_) {
        if (f.id == 0x700 + kMaster) {
          EXPECT_EQ(f.data, Bytes{5});
        }
      }
    }
  }
  ASSERT_EQ(at.size(), 100u);  // 20 ms
  for (size_t i = 1; i < at.size(); ++i) EXPECT_EQ(at[i] - at[i - 1], 30);
}

TEST_F(Master402, WithoutTheMasterTheDriveStops) {
  Enable();
  for (int i = 0; i < 76; ++i) drive_.Tick();  // 50 ms without a frame
  EXPECT_EQ(drive_.state, DriveNode::kQuickStopActive);
}

// Whatever comes: while `enable` is 0, no frame enables or moves.
TEST_F(Master402, AStopIsNeverRefused) {
  std::mt19937 random(13);
  int enabled = 0;
  for (int round = 0; round < 300; ++round) {
    drive_ = DriveNode(kDrive);
    drive_.out.clear();
    Init();
    command_ = {1000, 1, 0};
    for (int i = static_cast<int>(random() % 600); i > 0; --i) {
      if (random() % 60 == 0) drive_.state = static_cast<DriveNode::State>(random() % 8);
      if (random() % 100 == 0) {
        drive_.Emergency(static_cast<uint16_t>(random()), static_cast<uint8_t>(random() % 2));
      }
      command_.reset = random() % 20 == 0;
      Tick();
    }
    enabled += Feedback().on;
    command_.enable = 0;
    for (int i = 0; i < 50; ++i) {
      Tick();
      EXPECT_EQ(Target(), 0);
      if (Controlword() >= 0) {
        EXPECT_NE(Controlword() & 0x0F, 0x0F);
      }
    }
    Tick(300);  // a drive that is being configured gets no controlword before
    EXPECT_NE(drive_.state, DriveNode::kOperationEnabled);
  }
  EXPECT_GT(enabled, 30);
}

}  // namespace
