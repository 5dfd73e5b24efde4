// The safety side of the buses: whoever falls silent, breaks off or sends rubbish, the axis is
// disabled with code 0 within the stated ticks, and every bus names why.
//
// Ticks are counted from the event, 1: the very next tick is off. N is a time rounded up to ticks.
//   no valid sensors (dead plant)        1        lost lock of a source on another bus   N + 1
//   CAN bus off, NMT stop, NMT reset *   1        lost heartbeat, late RPDO              N + 2
// (* a reset of the node: 2.) Ramps of fault_reaction_option come before that where it asks so.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "firmware/port/host/firmware.hpp"

namespace {

constexpr uint8_t kNode = 5;
constexpr int kCode = 300;  // what the enabled axis puts out, in open loop
constexpr uint32_t kSilence = 0xFFFFFFFF;

using Bytes = std::vector<uint8_t>;

struct Frame {
  uint16_t id;
  Bytes data;
};

// The ways in. Gateway: the second SDO server, for Modbus TCP.
enum Way { kCanopen, kGateway, kLcm, kRtu };
constexpr std::array<Way, 4> kWays{kCanopen, kGateway, kLcm, kRtu};

int SourceOf(Way way) {
  return way == kCanopen ? AXIS_COMMAND_SOURCE_CANOPEN
         : way == kLcm   ? AXIS_COMMAND_SOURCE_LCM
                         : AXIS_COMMAND_SOURCE_MODBUS;
}

uint16_t Crc(const Bytes &bytes) {
  unsigned crc = 0xFFFF;
  for (uint8_t byte : bytes) {
    crc ^= byte;
    for (int i = 0; i < 8; ++i) crc = (crc & 1) != 0 ? (crc >> 1) ^ 0xA001 : crc >> 1;
  }
  return static_cast<uint16_t>(crc);
}

Bytes Closed(Bytes frame) {
  const uint16_t crc = Crc(frame);
  frame.push_back(static_cast<uint8_t>(crc & 0xFF));
  frame.push_back(static_cast<uint8_t>(crc >> 8));
  return frame;
}

// ms on the wire as ticks of 2/3 ms, rounded up.
int TicksOf(int ms) { return (3 * ms + 1) / 2; }

const axis_address_t *AddressOf(uint16_t object) {
  for (const axis_address_t &a : axis_addresses) {
    if (a.what == AXIS_ADDRESS_OBJECT && a.value == object) return &a;
  }
  return nullptr;
}

std::optional<uint16_t> RegisterOf(uint16_t object) {
  for (const axis_register_t &r : axis_holding) {
    if (r.object == object) return r.first;
  }
  for (const axis_register_t &r : axis_input) {
    if (r.object == object) return r.first;
  }
  return std::nullopt;
}

int SizeOf(uint16_t object) { return value_bytes(axis_objects[object].type); }

uint32_t Masked(int32_t value, uint16_t object) {
  const int bytes = SizeOf(object);
  return static_cast<uint32_t>(value) & (bytes == 4 ? 0xFFFFFFFFu : (1u << (8 * bytes)) - 1);
}

class Fw : public ::testing::Test {
 protected:
  Fw() { PowerUp(); }

  void PowerUp(const store_memory_t *memory = nullptr) {
    fw_ = fw_t{};
    fw_config_t config{};
    config.recorder_buffer = buffer_.data();
    config.recorder_bytes = static_cast<uint32_t>(buffer_.size());
    config.memory = memory;
    config.node_id = kNode;
    config.buses = 1;
    fw_init(&fw_, &config);
    inputs_ = {0, {0, 0}, AXIS_DIN_ENABLE, 1};
    outputs_ = {};
    emergencies_.clear();
  }

  void Tick(int ticks = 1) {
    for (int i = 0; i < ticks; ++i) fw_tick(&fw_, &inputs_, &outputs_);
  }

  // --- CAN

  void Send(uint16_t id, const Bytes &data) {
    can_frame_t frame{};
    frame.id = id;
    frame.length = static_cast<uint8_t>(data.size());
    std::copy(data.begin(), data.end(), frame.data);
    fw_can_receive(&fw_, &frame);
  }

  // What was sent; emergencies are kept for Told().
  std::vector<Frame> Take() {
    std::vector<Frame> frames;
    for (can_frame_t f{}; fw_can_transmit(&fw_, &f);) {
      frames.push_back({f.id, {f.data, f.data + f.length}});
      if (f.id == 0x80 + kNode)
        emergencies_.push_back(f.data[0] | f.data[1] << 8 | f.data[3] << 16);
    }
    return frames;
  }

  // Emergencies since the last call: code, and the info byte in bits 16 to 23.
  std::vector<int> Told() {
    Take();
    return std::exchange(emergencies_, {});
  }

  int CountTold(int code) {
    const std::vector<int> told = Told();
    return static_cast<int>(
        std::count_if(told.begin(), told.end(), [&](int t) { return (t & 0xFFFF) == code; }));
  }

  Bytes AskSdo(Way way, const Bytes &request) {
    static constexpr uint16_t ids[][2] = {{0x600, 0x580}, {0x640, 0x5C0}, {0x660, 0x5E0}};
    Take();
    Send(static_cast<uint16_t>(ids[way][0] + kNode), request);
    for (const Frame &f : Take()) {
      if (f.id == ids[way][1] + kNode) return f.data;
    }
    return {};
  }

  static Bytes Request(unsigned command, unsigned index, unsigned sub, uint32_t value = 0) {
    Bytes data;
    for (unsigned byte : {command, index & 0xFF, index >> 8, sub, value & 0xFF, value >> 8 & 0xFF,
                          value >> 16 & 0xFF, value >> 24}) {
      data.push_back(static_cast<uint8_t>(byte));
    }
    return data;
  }

  static uint32_t Word(const Bytes &answer) {
    if (answer.size() < 8) return kSilence;
    return static_cast<uint32_t>(answer[4] | answer[5] << 8 | answer[6] << 16) |
           static_cast<uint32_t>(answer[7]) << 24;
  }

  // 0 or the abort code.
  uint32_t Download(Way way, unsigned index, unsigned sub, uint32_t value, int bytes) {
    const Bytes answer =
        AskSdo(way, Request(0x23u | static_cast<unsigned>(4 - bytes) << 2, index, sub, value));
    return (!answer.empty() && answer[0] == 0x60) ? 0 : Word(answer);
  }

  // --- Modbus

  Bytes AskRtu(const Bytes &pdu) {
    Bytes frame{kNode};
    frame.insert(frame.end(), pdu.begin(), pdu.end());
    return SendRtu(Closed(frame));
  }

  Bytes SendRtu(const Bytes &frame) {
    fw_modbus_receive(&fw_, frame.data(), static_cast<uint16_t>(frame.size()));
    Bytes answer(300);
    answer.resize(fw_modbus_transmit(&fw_, answer.data(), 300));
    return answer;
  }

  static Bytes Pdu(unsigned function, std::initializer_list<unsigned> words) {
    Bytes pdu{static_cast<uint8_t>(function)};
    for (unsigned w : words) {
      pdu.push_back(static_cast<uint8_t>(w >> 8));
      pdu.push_back(static_cast<uint8_t>(w));
    }
    return pdu;
  }

  static bool IsException(const Bytes &answer) { return answer.size() < 2 || answer[1] > 0x7F; }

  bool LowFirst() const {
    return Inner(AXIS_OBJ_MODBUS_WORD_ORDER) == AXIS_MODBUS_WORD_ORDER_LOW_FIRST;
  }

  // --- objects, whichever way

  // 0, an abort code or an exception.
  uint32_t Write(Way way, uint16_t object, int32_t value) {
    const uint32_t raw = Masked(value, object);
    if (way != kRtu) {
      const axis_address_t *at = AddressOf(object);
      return Download(way, at->index, at->sub, raw, SizeOf(object));
    }
    const unsigned first = *RegisterOf(object);
    Bytes pdu;
    if (SizeOf(object) == 4) {
      const unsigned high = raw >> 16, low = raw & 0xFFFF;
      pdu = Pdu(16, {first, 2});
      pdu.push_back(4);
      const bool low_first = LowFirst();
      for (unsigned w : {low_first ? low : high, low_first ? high : low}) {
        pdu.push_back(static_cast<uint8_t>(w >> 8));
        pdu.push_back(static_cast<uint8_t>(w));
      }
    } else {
      pdu = Pdu(6, {first, static_cast<unsigned>(value) & 0xFFFF});
    }
    const Bytes answer = AskRtu(pdu);
    return IsException(answer) ? (answer.size() > 2 ? answer[2] : kSilence) : 0;
  }

  // The raw bits as this way shows them.
  uint32_t Read(Way way, uint16_t object) {
    const int bytes = SizeOf(object);
    if (way != kRtu) {
      const axis_address_t *at = AddressOf(object);
      const Bytes answer = AskSdo(way, Request(0x40, at->index, at->sub));
      EXPECT_EQ(answer.empty() ? -1 : answer[0], 0x43 | (4 - bytes) << 2) << "object " << object;
      return Word(answer);
    }
    const unsigned first = *RegisterOf(object);
    const bool holding = axis_objects[object].access != AXIS_ACCESS_RO;
    const unsigned count = bytes == 4 ? 2 : 1;
    const Bytes answer = AskRtu(Pdu(holding ? 3 : 4, {first, count}));
    EXPECT_EQ(answer.size(), 5 + 2 * count) << "object " << object;
    if (answer.size() != 5 + 2 * count) return kSilence;
    uint32_t words[2] = {};
    for (unsigned i = 0; i < count; ++i) words[i] = 256u * answer[3 + 2 * i] + answer[4 + 2 * i];
    if (count == 1) return words[0] & (bytes == 1 ? 0xFFu : 0xFFFFu);
    return LowFirst() ? words[1] << 16 | words[0] : words[0] << 16 | words[1];
  }

  static bool Reaches(Way way, uint16_t object) { return way != kRtu || RegisterOf(object); }

  int32_t Inner(uint16_t object) const {
    int32_t value = 0;
    EXPECT_EQ(fw_object_read(&fw_, object, &value), FW_OK) << "object " << object;
    return value;
  }
  void Set(uint16_t object, int32_t value) {
    ASSERT_EQ(fw_object_write(&fw_, FW_SOURCE_LOCAL, object, value), FW_OK) << "object " << object;
  }

  int Owner() const { return Inner(AXIS_OBJ_COMMAND_SOURCE); }
  bool Takes(Way way) { return Write(way, AXIS_OBJ_COMMAND_SOURCE, SourceOf(way)) == 0; }

  // The axis enabled by this way, with kCode put out.
  void Drive(Way way = kCanopen) {
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    ASSERT_TRUE(Takes(way));
    ASSERT_EQ(Write(way, AXIS_OBJ_MODES_OF_OPERATION, CIA402_MODE_OPEN_LOOP), 0u);
    ASSERT_EQ(Write(way, AXIS_OBJ_OPEN_LOOP_CODE, kCode), 0u);
    ASSERT_EQ(Write(way, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
    ASSERT_EQ(Write(way, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
    Tick(2);
    ASSERT_TRUE(IsOn());
    Told();
  }

  bool IsOn() const { return outputs_.dac_code == kCode && outputs_.amp_enable == 1; }
  bool IsOff() const {
    return outputs_.dac_code == 0 && outputs_.amp_enable == 0 && outputs_.brake_release == 0 &&
           Inner(AXIS_OBJ_ACTIVE_MODE) == AXIS_MODE_DISABLED;
  }

  // The number of the first tick that is off, at most `limit`; until then the axis is driven, and
  // afterwards it stays off. 0: it is not.
  int TicksToOff(int limit) {
    for (int i = 1; i <= limit; ++i) {
      Tick();
      Take();
      if (IsOff()) {
        for (int k = 0; k < 100; ++k) {
          Tick();
          Take();
          EXPECT_TRUE(IsOff()) << "tick " << k << " after";
        }
        return i;
      }
      EXPECT_TRUE(IsOn()) << "tick " << i << ", code " << outputs_.dac_code;
    }
    return 0;
  }

  // Every bus says the same. An emergency names it once.
  void ExpectNamed(int fault, int code, bool reachable_by_can = true) {
    for (Way way : kWays) {
      if (way != kRtu && !reachable_by_can) continue;
      EXPECT_EQ(Read(way, AXIS_OBJ_FAULT), static_cast<uint32_t>(fault)) << "way " << way;
      EXPECT_EQ(Read(way, AXIS_OBJ_ERROR_CODE), static_cast<uint32_t>(code)) << "way " << way;
      EXPECT_EQ(Read(way, AXIS_OBJ_STATUSWORD) & 0x4F, 0x08u) << "way " << way;
    }
    EXPECT_EQ(CountTold(code), reachable_by_can ? 1 : 0);
  }

  void WatchHeartbeat(int ms) {
    ASSERT_EQ(Download(kCanopen, 0x1016, 1, 0x007F0000u | static_cast<unsigned>(ms), 4), 0u);
  }

  fw_t fw_{};
  axis_inputs_t inputs_{};
  axis_outputs_t outputs_{};
  std::array<uint8_t, FW_RECORDER_BYTES> buffer_{};
  std::vector<int> emergencies_;
};

// --- who falls silent ----------------------------------------------------------------------------

TEST_F(Fw, ASupervisorThatIsKilledIsMissedByItsHeartbeat) {
  for (int ms : {1, 2, 10, 25, 100, 1000}) {
    PowerUp();
    WatchHeartbeat(ms);
    Drive();
    Send(0x77F, {5});
    EXPECT_EQ(TicksToOff(3000), TicksOf(ms) + 2) << ms << " ms";
    ExpectNamed(AXIS_FAULT_HEARTBEAT_LOST, 0x8130);
  }
}

TEST_F(Fw, AHeartbeatInTimeKeepsTheAxis) {
  WatchHeartbeat(10);
  Drive();
  for (int i = 0; i < 50; ++i) {
    Send(0x77F, {5});
    for (int k = 0; k < TicksOf(10); ++k) {
      Tick();
      ASSERT_TRUE(IsOn()) << i << ' ' << k;
    }
  }
}

TEST_F(Fw, AnRpdoThatStaysAway) {
  for (int ms : {1, 5, 20, 333}) {
    PowerUp();
    ASSERT_EQ(Download(kCanopen, 0x1400, 5, static_cast<uint32_t>(ms), 2), 0u);
    Send(0, {1, kNode});
    Drive();
    Send(0x205, {0x0F, 0x00, 0xFE});
    EXPECT_EQ(TicksToOff(1000), TicksOf(ms) + 2) << ms << " ms";
    ExpectNamed(AXIS_FAULT_PDO_TIMEOUT, 0x8250);
  }
}

// The master that died before its first RPDO: the deadline begins with the axis being active.
TEST_F(Fw, AnRpdoThatNeverCame) {
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  ASSERT_EQ(Download(kCanopen, 0x1400, 5, 20, 2), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_MODES_OF_OPERATION, CIA402_MODE_OPEN_LOOP), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_OPEN_LOOP_CODE, kCode), 0u);
  Tick(500);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
  EXPECT_EQ(TicksToOff(100), TicksOf(20) + 2);
  ExpectNamed(AXIS_FAULT_PDO_TIMEOUT, 0x8250);
}

// The loss is a state, not an event: who enables again while it lasts is not left alone.
TEST_F(Fw, NobodyEnablesWhileTheHeartbeatIsAway) {
  WatchHeartbeat(10);
  Drive();
  Send(0x77F, {5});
  ASSERT_EQ(TicksToOff(100), TicksOf(10) + 2);
  const auto enable = [&] {
    for (int word : {0x80, 0x06, 0x0F}) ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, word), 0u);
    Tick(2);
  };
  enable();
  EXPECT_TRUE(IsOff());
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_HEARTBEAT_LOST);
  Send(0x77F, {5});
  enable();
  EXPECT_EQ(outputs_.amp_enable, 1);
}

TEST_F(Fw, AnRpdoThatStaysAwayAgain) {
  ASSERT_EQ(Download(kCanopen, 0x1400, 5, 20, 2), 0u);
  Send(0, {1, kNode});
  Drive();
  Send(0x205, {0x0F, 0x00, 0xFE});
  ASSERT_EQ(TicksToOff(1000), TicksOf(20) + 2);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x80), 0u);
  Drive();
  EXPECT_NE(TicksToOff(TicksOf(20) + 2), 0);
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_PDO_TIMEOUT);
}

// Frames come, but the SYNC that would have them act does not.
TEST_F(Fw, RpdosWithoutSyncKeepNoDeadline) {
  ASSERT_EQ(Download(kCanopen, 0x1400, 5, 20, 2), 0u);
  ASSERT_EQ(Download(kCanopen, 0x1400, 2, 1, 1), 0u);
  Send(0, {1, kNode});
  Drive();
  int ticks = 0;
  for (; ticks < 100 && outputs_.amp_enable != 0; ++ticks) {
    Send(0x205, {0x0F, 0x00, 0xFE});
    Tick();
    Take();
  }
  EXPECT_LE(ticks, TicksOf(20) + 2);
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_PDO_TIMEOUT);
}

TEST_F(Fw, AMasterThatBootsUpAgainIsLost) {
  WatchHeartbeat(1000);
  Drive();
  Send(0x77F, {5});
  Tick();
  ASSERT_TRUE(IsOn());
  Send(0x77F, {0});
  EXPECT_EQ(TicksToOff(10), 1);
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_SOURCE_LOST);
}

TEST_F(Fw, ADeadPlantIsSeenInTheSameTick) {
  Drive();
  inputs_.sensor_valid = 0;
  EXPECT_EQ(TicksToOff(10), 1);
  ExpectNamed(AXIS_FAULT_SENSOR_INVALID, 0x7305);
}

TEST_F(Fw, FaultsOfInputsAreSeenInTheSameTick) {
  const struct {
    int fault, code;
    axis_inputs_t inputs;
  } cases[] = {
      {AXIS_FAULT_ENABLE_LOST, 0xFF05, {0, {0, 0}, 0, 1}},
      {AXIS_FAULT_ADC_RANGE, 0x7300, {0, {256, 0}, AXIS_DIN_ENABLE, 1}},
      {AXIS_FAULT_LIMIT_SWITCHES,
       0x8612,
       {0, {0, 0}, AXIS_DIN_ENABLE | AXIS_DIN_LIMIT_POS | AXIS_DIN_LIMIT_NEG, 1}},
      {AXIS_FAULT_OVERSPEED, 0x7310, {101, {0, 0}, AXIS_DIN_ENABLE, 1}},
      {AXIS_FAULT_FORCE_MAX, 0xFF06, {0, {201, 0}, AXIS_DIN_ENABLE, 1}},
  };
  for (const auto &c : cases) {
    PowerUp();
    Set(AXIS_OBJ_SPEED_MAX, 100);
    Set(AXIS_OBJ_FORCE_MAX, 200 * 256);
    Drive();
    inputs_ = c.inputs;
    EXPECT_EQ(TicksToOff(10), 1) << c.fault;
    ExpectNamed(c.fault, c.code);
  }
}

TEST_F(Fw, ALostBusIsSeenInTheComingTick) {
  Drive();
  fw_can_bus(&fw_, CAN_BUS_OFF);
  EXPECT_EQ(TicksToOff(10), 1);
  ExpectNamed(AXIS_FAULT_CAN_OFF, 0x8140, false && "nobody hears it");
}

TEST_F(Fw, ALostBusIsToldWhenItIsBack) {
  Drive();
  fw_can_bus(&fw_, CAN_BUS_OFF);
  Tick(1000);
  EXPECT_TRUE(Take().empty()) << "nothing waits, nothing is sent";
  fw_can_bus(&fw_, CAN_BUS_ACTIVE);
  Tick();
  ExpectNamed(AXIS_FAULT_CAN_OFF, 0x8140);
}

TEST_F(Fw, WhoOwnsTheAxisByAnotherBusIsNotHurtByCan) {
  WatchHeartbeat(10);
  Drive(kRtu);
  Send(0x77F, {5});
  fw_can_bus(&fw_, CAN_BUS_OFF);
  for (int i = 0; i < 200; ++i) {
    Tick();
    ASSERT_TRUE(IsOn()) << i;
  }
}

TEST_F(Fw, StopAndResetsByNmtSwitchOff) {
  for (const auto &[command, ticks] : std::map<int, int>{{2, 1}, {130, 1}, {129, 1}}) {
    PowerUp();
    Drive();
    Send(0, {static_cast<uint8_t>(command), kNode});
    EXPECT_EQ(TicksToOff(10), ticks) << "command " << command;
    EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
    if (command == 130) ExpectNamed(AXIS_FAULT_SOURCE_LOST, 0x6010);
  }
}

// Frames that all come between two ticks: active_mode knows nothing of the controlword yet.
TEST_F(Fw, AStopInTheTickThatEnablesSwitchesOff) {
  for (int command : {2, 130}) {
    PowerUp();
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_MODES_OF_OPERATION, CIA402_MODE_OPEN_LOOP), 0u);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_OPEN_LOOP_CODE, kCode), 0u);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
    Tick(2);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
    Send(0, {static_cast<uint8_t>(command), kNode});
    EXPECT_EQ(TicksToOff(10), 1) << "command " << command;
    EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_SOURCE_LOST);
  }
}

// LCM has no way in but the SDO server of this bus; its watchdog would come much later.
TEST_F(Fw, LcmIsLostWithTheBus) {
  for (int how = 0; how < 3; ++how) {
    PowerUp();
    Set(AXIS_OBJ_WATCHDOG, 65535);
    Drive(kLcm);
    if (how == 0) fw_can_bus(&fw_, CAN_BUS_OFF);
    if (how == 1) Send(0, {2, kNode});
    if (how == 2) Send(0, {130, kNode});
    EXPECT_EQ(TicksToOff(10), 1) << how;
    EXPECT_EQ(Inner(AXIS_OBJ_FAULT), how == 0 ? AXIS_FAULT_CAN_OFF : AXIS_FAULT_SOURCE_LOST);
    EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
  }
}

// --- what was asked for before
// --------------------------------------------------------------------

// Enabled again by canopen, which asks for nothing: the axis stands, whatever was asked before.
TEST_F(Fw, WhatAnOwnerAskedForEndsWithIt) {
  for (int how = 0; how < 3; ++how) {
    PowerUp();
    Set(AXIS_OBJ_POSITION_GAIN, 5 * 256);
    Set(AXIS_OBJ_WATCHDOG, 20);
    Set(AXIS_OBJ_ABORT_CONNECTION_OPTION, 2);
    ASSERT_TRUE(Takes(kRtu));
    ASSERT_EQ(Write(kRtu, AXIS_OBJ_MODES_OF_OPERATION, CIA402_MODE_PROFILE_VELOCITY), 0u);
    ASSERT_EQ(Write(kRtu, AXIS_OBJ_TARGET_VELOCITY, 30000), 0u);
    if (how == 1) {
      ASSERT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
      ASSERT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
    }
    if (how == 2) {
      ASSERT_TRUE(Takes(kCanopen));
    }
    Tick(40);
    ASSERT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x00), 0u);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
    Tick(100);
    ASSERT_EQ(outputs_.amp_enable, 1);
    EXPECT_EQ(Inner(AXIS_OBJ_POSITION_DEMAND), 0) << how;
  }
}

TEST_F(Fw, NativeSetpointsEndWithAFault) {
  for (int how = 0; how < 2; ++how) {
    PowerUp();
    Drive();
    inputs_.sensor_valid = 0;
    Tick();
    inputs_.sensor_valid = 1;
    ASSERT_TRUE(IsOff());
    ASSERT_EQ(how == 0 ? Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x80)
                       : Write(kCanopen, AXIS_OBJ_FAULT_RESET, 1),
              0u);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
    Tick(10);
    EXPECT_EQ(outputs_.amp_enable, 1);
    EXPECT_EQ(outputs_.dac_code, 0) << how;
  }
}

// The controlword is mapped before the target; it must act on the one that came with it.
TEST_F(Fw, AnRpdoStartsTheTargetItBrings) {
  Set(AXIS_OBJ_POSITION_GAIN, 5 * 256);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_MODES_OF_OPERATION, CIA402_MODE_PROFILE_POSITION), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_TARGET_POSITION, 36000), 0u);
  Send(0, {1, kNode});
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
  Tick(2);
  Send(0x305, {0x1F, 0x00, 0x78, 0xEC, 0xFF, 0xFF});  // -5000
  Tick(200);
  EXPECT_LT(Inner(AXIS_OBJ_POSITION_DEMAND), 0);
  EXPECT_EQ(fw_.drive.setpoint.position, -5000);
}

// Modbus refuses a whole request: nothing of it, nor of what was there before, starts to act.
TEST_F(Fw, ARefusedRequestThatGivesTheAxisAwayStartsNothing) {
  Set(AXIS_OBJ_POSITION_GAIN, 5 * 256);
  ASSERT_TRUE(Takes(kRtu));
  ASSERT_EQ(Write(kRtu, AXIS_OBJ_MODES_OF_OPERATION, CIA402_MODE_PROFILE_VELOCITY), 0u);
  ASSERT_EQ(Write(kRtu, AXIS_OBJ_TARGET_VELOCITY, 30000), 0u);
  inputs_.sensor_valid = 0;
  Tick();
  inputs_.sensor_valid = 1;
  for (int word : {0x80, 0x06, 0x0F}) {
    ASSERT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, word), 0u);
    Tick();
  }
  ASSERT_EQ(outputs_.amp_enable, 1);
  const auto refused = [&](unsigned first, const std::vector<unsigned> &words) {
    Bytes pdu = Pdu(16, {first, static_cast<unsigned>(words.size())});
    pdu.push_back(static_cast<uint8_t>(2 * words.size()));
    for (unsigned w : words) {
      pdu.push_back(static_cast<uint8_t>(w >> 8));
      pdu.push_back(static_cast<uint8_t>(w));
    }
    return IsException(AskRtu(pdu));
  };
  EXPECT_TRUE(refused(0, {0x0F, 3, 0, 0, 0, 0, 0, 0}));
  EXPECT_TRUE(refused(4, {0, 0, 0, 0, 1000}));
  EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_MODBUS);
  Tick(100);
  EXPECT_EQ(Inner(AXIS_OBJ_POSITION_DEMAND), 0);
  EXPECT_EQ(Inner(AXIS_OBJ_TARGET_VELOCITY), 30000);
}

// --- the lock ------------------------------------------------------------------------------------

TEST_F(Fw, CanopenOwnsAtPowerUp) {
  EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
  for (Way way : {kGateway, kLcm}) {
    EXPECT_EQ(Write(way, AXIS_OBJ_CONTROLWORD, 0x06), 0x08000021u);
  }
  EXPECT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x06), 4u);
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
}

TEST_F(Fw, NobodyGivesTheAxisToAThirdOne) {
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_COMMAND_SOURCE, AXIS_COMMAND_SOURCE_MODBUS), 0x08000021u);
  ASSERT_TRUE(Takes(kRtu));
  EXPECT_EQ(Write(kRtu, AXIS_OBJ_COMMAND_SOURCE, AXIS_COMMAND_SOURCE_LCM), 4u);
  EXPECT_EQ(Write(kLcm, AXIS_OBJ_COMMAND_SOURCE, AXIS_COMMAND_SOURCE_CANOPEN), 0x08000021u)
      << "not its to give away";
  EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_MODBUS);
}

// Also one that goes on reading: that says nothing of who commands the axis.
TEST_F(Fw, AnOwnerThatWritesNoMoreIsLost) {
  for (Way way : {kGateway, kLcm, kRtu}) {
    for (int ms : {10, 15, 1000}) {
      PowerUp();
      ASSERT_TRUE(Takes(way));
      ASSERT_EQ(Write(way, AXIS_OBJ_WATCHDOG, ms), 0u);
      Drive(way);
      ASSERT_EQ(Write(way, AXIS_OBJ_WATCHDOG, ms), 0u);
      int ticks = 0;
      for (; IsOn() && ticks < 3000; ++ticks) {
        (void)Read(way, AXIS_OBJ_STATUSWORD);
        Tick();
      }
      EXPECT_EQ(ticks, TicksOf(ms) + 1) << "way " << way << ", " << ms << " ms";
      EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
      ExpectNamed(AXIS_FAULT_SOURCE_LOST, 0x6010);
    }
  }
}

TEST_F(Fw, WhatOthersSendFeedsNobody) {
  const std::map<Way, std::vector<Way>> others{
      {kRtu, {kCanopen, kLcm}}, {kLcm, {kCanopen, kGateway, kRtu}}, {kGateway, {kCanopen, kLcm}}};
  for (const auto &[owner, loud] : others) {
    PowerUp();
    Set(AXIS_OBJ_WATCHDOG, 20);
    Drive(owner);
    ASSERT_EQ(Write(owner, AXIS_OBJ_WATCHDOG, 20), 0u);
    int ticks = 0;
    while (IsOn() && ticks < 100) {
      for (Way way : loud) (void)Write(way, AXIS_OBJ_CONTROLWORD, 0x0F);
      Send(0x77F, {5});
      Send(0x80, {});
      Tick();
      ++ticks;
    }
    EXPECT_EQ(ticks, TicksOf(20) + 1) << "owner " << owner;
    EXPECT_TRUE(IsOff());
  }
}

// What another bus sends does not keep canopen's own watch from finding it lost.
TEST_F(Fw, AModbusClientDoesNotFeedCanopen) {
  WatchHeartbeat(20);
  Drive();
  Send(0x77F, {5});
  int ticks = 0;
  while (IsOn() && ticks < 100) {
    (void)Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x0F);
    (void)Read(kGateway, AXIS_OBJ_STATUSWORD);
    Tick();
    ++ticks;
  }
  EXPECT_EQ(ticks, TicksOf(20) + 2);
}

TEST_F(Fw, ASilentOwnerOfADisabledAxisLosesTheLockOnly) {
  ASSERT_TRUE(Takes(kRtu));
  Tick(1500);
  EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_MODBUS);
  Tick();
  EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
  EXPECT_TRUE(Told().empty());
  EXPECT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x06), 4u);
}

TEST_F(Fw, TheReactionIsChosenBy6007) {
  const struct {
    int option, state, owner_told;
  } cases[] = {{0, AXIS_DRIVE_STATE_OPERATION_ENABLED, 1},
               {1, AXIS_DRIVE_STATE_FAULT, 1},
               {2, AXIS_DRIVE_STATE_SWITCH_ON_DISABLED, 1},
               {3, AXIS_DRIVE_STATE_SWITCH_ON_DISABLED, 1}};
  for (const auto &c : cases) {
    PowerUp();
    Drive(kRtu);
    Set(AXIS_OBJ_ABORT_CONNECTION_OPTION, c.option);
    Set(AXIS_OBJ_WATCHDOG, 20);
    Tick(1000);
    EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
    EXPECT_EQ(Inner(AXIS_OBJ_DRIVE_STATE), c.state) << c.option;
    EXPECT_EQ(IsOff(), c.option != 0);
    EXPECT_EQ(CountTold(0x6010), c.owner_told) << "option " << c.option;
  }
}

TEST_F(Fw, TheOwnerMayChangeItsWatchdog) {
  Drive(kRtu);
  Tick(700);
  ASSERT_EQ(Write(kRtu, AXIS_OBJ_WATCHDOG, 10), 0u);
  EXPECT_EQ(TicksToOff(100), TicksOf(10) + 1) << "counted from the write";
  PowerUp();
  Drive(kRtu);
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_WATCHDOG, 10), 0x08000021u) << "not by others";
}

TEST_F(Fw, CanopenTakesTheAxisBackWhileItRuns) {
  Drive(kRtu);
  ASSERT_TRUE(Takes(kCanopen));
  EXPECT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0), 4u);
  Tick(5000);
  EXPECT_TRUE(IsOn()) << "nobody is lost: canopen has it";
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0), 0u);
  EXPECT_EQ(TicksToOff(10), 1);
}

// While Modbus had the axis nobody asked whether canopen lives.
TEST_F(Fw, WhoGivesTheAxisToADeadCanopenLosesIt) {
  Set(AXIS_OBJ_WATCHDOG, 60000);
  for (int how = 0; how < 3; ++how) {
    PowerUp();
    Set(AXIS_OBJ_WATCHDOG, 60000);
    WatchHeartbeat(10);
    ASSERT_EQ(Download(kCanopen, 0x1400, 5, 10, 2), 0u);
    Send(0, {1, kNode});
    Send(0x77F, {5});
    Send(0x205, {0x00, 0x00, 0xFE});
    Drive(kRtu);
    if (how == 0) Send(0x77F, {5});
    if (how == 1) fw_can_bus(&fw_, CAN_BUS_OFF);
    if (how == 2) Set(AXIS_OBJ_CONSUMER_HEARTBEAT_1, 0);
    for (int i = 0; i < 100; ++i) {
      Tick();
      ASSERT_TRUE(IsOn()) << how;
    }
    ASSERT_EQ(Write(kRtu, AXIS_OBJ_COMMAND_SOURCE, 0), 0u);
    static constexpr int kTicks[] = {1, 1, 17};  // a deadline that begins with the next tick
    static constexpr int kFaults[] = {AXIS_FAULT_HEARTBEAT_LOST, AXIS_FAULT_CAN_OFF,
                                      AXIS_FAULT_PDO_TIMEOUT};
    EXPECT_EQ(TicksToOff(100), kTicks[how]) << how;
    EXPECT_EQ(Inner(AXIS_OBJ_FAULT), kFaults[how]);
  }
}

// Nor to a canopen of which nobody would notice that it is not there.
TEST_F(Fw, WhoGivesTheAxisToAnUnwatchedCanopenLosesIt) {
  for (Way way : {kRtu, kLcm, kGateway}) {
    PowerUp();
    Drive(way);
    ASSERT_EQ(Write(way, AXIS_OBJ_COMMAND_SOURCE, 0), 0u);
    EXPECT_EQ(TicksToOff(10), 1);
    ExpectNamed(AXIS_FAULT_SOURCE_LOST, 0x6010);
  }
}

TEST_F(Fw, TwoMastersOneOwner) {
  Drive(kCanopen);
  std::mt19937 random(5);
  Way owner = kCanopen;
  for (int i = 0; i < 3000; ++i) {
    const Way who = kWays[random() % 4];
    if (random() % 4 == 0) {
      ASSERT_TRUE(Takes(who));
      owner = who;
    }
    const bool allowed = SourceOf(who) == SourceOf(owner);
    const int32_t value = static_cast<int32_t>(random() % 1000);
    const uint32_t before = static_cast<uint32_t>(Inner(AXIS_OBJ_FORCE_GAIN));
    const uint32_t result = Write(who, AXIS_OBJ_FORCE_GAIN, value);
    const uint32_t expected = allowed ? 0 : who == kRtu ? 4 : 0x08000021;
    ASSERT_EQ(result, expected) << i;
    for (Way way : kWays) {
      ASSERT_EQ(Read(way, AXIS_OBJ_FORCE_GAIN), allowed ? static_cast<uint32_t>(value) : before);
    }
    if (!allowed) (void)Write(who, AXIS_OBJ_CONTROLWORD, 0);
    Tick();
    ASSERT_TRUE(IsOn()) << i;
  }
}

TEST_F(Fw, AResetGivesTheLockBack) {
  Drive(kRtu);
  Send(0, {130, kNode});
  Tick();
  EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_MODBUS) << "communication only: Modbus does not notice";
  EXPECT_TRUE(IsOn());
  Send(0, {129, kNode});
  Tick(2);
  EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
  EXPECT_TRUE(IsOff());
}

// --- a fault that ramps first --------------------------------------------------------------------

TEST_F(Fw, AFaultReactionIsNamedFromItsBeginning) {
  Set(AXIS_OBJ_FAULT_REACTION_OPTION, 1);
  Set(AXIS_OBJ_POSITION_GAIN, 5 * 256);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_MODES_OF_OPERATION, CIA402_MODE_PROFILE_VELOCITY), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_TARGET_VELOCITY, 3000), 0u);
  double place = 0;
  const auto move = [&](int ticks) {
    for (int i = 0; i < ticks; ++i) {
      inputs_.encoder_cnt = static_cast<int32_t>(place);
      Tick();
      if (outputs_.amp_enable != 0) place += 0.02 * outputs_.dac_code;
    }
  };
  move(500);
  Told();
  // A fault that the drive finds: the axis is held, the demand runs away.
  Set(AXIS_OBJ_FOLLOWING_ERROR_WINDOW, 20);
  Set(AXIS_OBJ_FOLLOWING_ERROR_TIMEOUT, 0);
  int waited = 0;
  while (Inner(AXIS_OBJ_DRIVE_STATE) == AXIS_DRIVE_STATE_OPERATION_ENABLED && waited < 2000) {
    Tick();
    ++waited;
  }
  ASSERT_EQ(Inner(AXIS_OBJ_DRIVE_STATE), AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE);
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_NONE) << "latched at the end";
  EXPECT_EQ(Inner(AXIS_OBJ_ERROR_CODE), 0x8611);
  EXPECT_EQ(Told(), std::vector<int>{0x8611 | AXIS_FAULT_FOLLOWING_ERROR << 16});
  for (int i = 0; i < 2000 && !IsOff(); ++i) Tick();
  EXPECT_TRUE(IsOff());
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_FOLLOWING_ERROR);
  EXPECT_TRUE(Told().empty()) << "once";
}

// --- emergencies that are no faults --------------------------------------------------------------

TEST_F(Fw, ALostContactIsToldWhileForceIsControlled) {
  inputs_.adc_code[0] = 30;
  Tick(2);
  inputs_.adc_code[0] = 0;
  Tick(2);
  EXPECT_EQ(CountTold(0xFF01), 0) << "nobody controls force";
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_MODES_OF_OPERATION, CIA402_MODE_NATIVE_FORCE), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
  inputs_.adc_code[0] = 30;
  Tick(3);
  EXPECT_EQ(CountTold(0xFF01), 0);
  inputs_.adc_code[0] = 0;
  Tick();
  EXPECT_EQ(Told(), std::vector<int>{0xFF01});
  // Again and again: once a second, and the limit cycle.
  for (int i = 0; i < 1480; ++i) {
    inputs_.adc_code[0] = (i & 1) != 0 ? 0 : 30;
    Tick();
    Take();
  }
  EXPECT_EQ(Told(), std::vector<int>{0xFF03});
  for (int i = 0; i < 1500; ++i) {
    inputs_.adc_code[0] = (i & 1) != 0 ? 0 : 30;
    Tick();
    Take();
  }
  EXPECT_EQ(Told(), std::vector<int>{0xFF01});
  EXPECT_EQ(Inner(AXIS_OBJ_CONTACT_LOSSES), 1 + 740 + 750);
  EXPECT_EQ(Inner(AXIS_OBJ_ERROR_REGISTER), 0) << "nothing of it lasts";
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
}

TEST_F(Fw, ASaturatedSensorIsTold) {
  inputs_.adc_code[0] = 254;
  Tick(3);
  EXPECT_EQ(CountTold(0xFF02), 0);
  inputs_.adc_code[0] = 255;
  Tick();
  EXPECT_EQ(CountTold(0xFF02), 1);
  Tick(3000);
  EXPECT_EQ(CountTold(0xFF02), 0) << "the edge, not the state";
  inputs_.adc_code[0] = 254;
  Tick();
  inputs_.adc_code[0] = 255;
  Tick();
  EXPECT_EQ(CountTold(0xFF02), 1);
}

TEST_F(Fw, OverrunsAreToldOnceASecond) {
  for (int i = 0; i < 3000; ++i) {
    fw_overrun(&fw_);
    Tick();
    Take();
  }
  EXPECT_EQ(CountTold(0xFF04), 2);
  EXPECT_EQ(Inner(AXIS_OBJ_OVERRUNS), 3000);
  EXPECT_EQ(Inner(AXIS_OBJ_ERROR_HISTORY_COUNT), 2);
}

// A set is there, but of another object table: the axis runs on defaults.
TEST_F(Fw, AStoreThatCannotBeLoadedIsToldAtPowerUp) {
  static std::array<uint8_t, 2 * STORE_SECTOR_MIN> image;
  image.fill(0xFF);
  store_memory_t memory{};
  memory.sector_bytes = STORE_SECTOR_MIN;
  memory.read = [](void *, uint32_t offset, uint8_t *bytes, uint32_t count) {
    std::copy_n(&image[offset], count, bytes);
  };
  memory.program = [](void *, uint32_t offset, const uint8_t *bytes, uint32_t count) {
    std::copy_n(bytes, count, &image[offset]);
    return true;
  };
  memory.erase = [](void *, uint8_t sector) {
    std::fill_n(&image[sector * STORE_SECTOR_MIN], STORE_SECTOR_MIN, uint8_t{0xFF});
    return true;
  };
  PowerUp(&memory);
  Tick();
  EXPECT_EQ(CountTold(0x5530), 0);
  Set(AXIS_OBJ_FORCE_GAIN, 1234);
  Set(AXIS_OBJ_STORE_PARAMETERS, 1);
  Tick(3000);
  ASSERT_EQ(Inner(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_SAVED);
  uint8_t *set = image[0] != 0xFF ? image.data() : image.data() + STORE_SECTOR_MIN;
  set[4] ^= 1;  // the hash
  const size_t length = STORE_HEAD_BYTES + (set[12] | set[13] << 8);
  uint32_t crc = 0xFFFFFFFF;
  for (size_t i = 0; i < length; ++i) {
    crc ^= set[i];
    for (int k = 0; k < 8; ++k) crc = (crc & 1) != 0 ? (crc >> 1) ^ 0xEDB88320u : crc >> 1;
  }
  for (int i = 0; i < 4; ++i)
    set[length + static_cast<size_t>(i)] = static_cast<uint8_t>(~crc >> (8 * i));
  PowerUp(&memory);
  Tick();
  ASSERT_EQ(Inner(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_OTHER_TABLE);
  EXPECT_EQ(CountTold(0x5530), 1);
  Send(0, {129, kNode});
  Tick(2);
  EXPECT_EQ(CountTold(0x5530), 1) << "also after a reset";
}

// --- frames that are broken ----------------------------------------------------------------------

// A request that would switch off (controlword 0), with every command byte and length: an answer or
// silence as CiA 301 has it, and only a download of two bytes, or of an untold number, acts.
TEST_F(Fw, EveryCommandByteAndLengthOfSdo) {
  for (unsigned command = 0; command < 256; ++command) {
    for (unsigned length = 0; length <= 8; ++length) {
      PowerUp();
      Drive();
      Bytes request = Request(command, 0x6040, 0, 0);
      request.resize(length);
      const Bytes answer = AskSdo(kCanopen, request);
      const unsigned specifier = command >> 5;
      const bool expedited = (command & 2) != 0;
      const bool sized = (command & 1) != 0;
      const unsigned bytes = 4 - (command >> 2 & 3);
      uint32_t abort = 0;
      bool acts = false;
      if (length < 8 || specifier == 4) {
        EXPECT_TRUE(answer.empty()) << command << ' ' << length;
      } else {
        ASSERT_EQ(answer.size(), 8u) << command;
        if (specifier == 1) {
          if (sized && expedited && bytes != 2) abort = bytes > 2 ? 0x06070012 : 0x06070013;
          if (sized && !expedited) abort = 0x06070013;  // 0 bytes announced
          acts = expedited && abort == 0;
          EXPECT_EQ(answer[0], abort == 0 ? 0x60 : 0x80) << command;
        } else if (specifier == 2) {
          EXPECT_EQ(answer[0], 0x4B) << command;
        } else {
          abort = 0x05040001;
        }
        if (abort != 0) {
          EXPECT_EQ(answer[0], 0x80) << command;
          EXPECT_EQ(Word(answer), abort) << std::hex << command;
        }
      }
      Tick();
      EXPECT_EQ(IsOff(), acts) << command << ' ' << length;
      EXPECT_EQ(IsOn(), !acts) << command << ' ' << length;
    }
  }
}

TEST_F(Fw, ShortRpdosAreToldAndNotUsed) {
  for (size_t length = 0; length < 3; ++length) {
    PowerUp();
    Send(0, {1, kNode});
    Drive();
    Send(0x205, Bytes(length, 0));
    Tick();
    EXPECT_TRUE(IsOn()) << length;
    EXPECT_EQ(CountTold(0x8210), 1);
  }
}

// A request that would switch off, cut after every byte and with every bit flipped: silence,
// nothing happens, it does not feed the watchdog, and the next whole request is served.
TEST_F(Fw, BrokenModbusFrames) {
  const Bytes off = Closed({kNode, 6, 0, 0, 0, 0});
  std::vector<Bytes> broken;
  for (size_t n = 1; n < off.size(); ++n)
    broken.emplace_back(off.begin(), off.begin() + static_cast<int>(n));
  for (size_t bit = 0; bit < 8 * off.size(); ++bit) {
    Bytes frame = off;
    frame[bit / 8] = static_cast<uint8_t>(frame[bit / 8] ^ 1u << (bit % 8));
    broken.push_back(frame);
  }
  for (const Bytes &frame : broken) {
    PowerUp();
    Set(AXIS_OBJ_WATCHDOG, 20);
    Drive(kRtu);
    EXPECT_EQ(Write(kRtu, AXIS_OBJ_WATCHDOG, 20), 0u);
    EXPECT_TRUE(SendRtu(frame).empty());
    Tick(10);
    EXPECT_TRUE(IsOn());
    EXPECT_TRUE(SendRtu({}).empty());
    Tick(TicksOf(20) - 10);
    EXPECT_TRUE(IsOn());
    Tick();
    EXPECT_TRUE(IsOff()) << "it fed the watchdog";
    EXPECT_EQ(Read(kRtu, AXIS_OBJ_FAULT), static_cast<uint32_t>(AXIS_FAULT_SOURCE_LOST));
  }
}

// --- the table -----------------------------------------------------------------------------------

TEST_F(Fw, ReadOnlyObjectsRefuseEveryLengthByEveryServer) {
  int count = 0;
  for (Way way : {kCanopen, kGateway, kLcm}) {
    ASSERT_TRUE(Takes(way));
    for (const axis_address_t &at : axis_addresses) {
      if (at.what == AXIS_ADDRESS_OBJECT && axis_objects[at.value].access != AXIS_ACCESS_RO) {
        continue;
      }
      ++count;
      for (int bytes = 1; bytes <= 4; ++bytes) {
        ASSERT_EQ(Download(way, at.index, at.sub, 1, bytes), 0x06010002u) << std::hex << at.index;
      }
      ASSERT_EQ(Word(AskSdo(way, Request(0x22, at.index, at.sub))), 0x06010002u);
      ASSERT_EQ(Word(AskSdo(way, Request(0x20, at.index, at.sub))), 0x06010002u);
      for (uint32_t size : {0u, 1u, 2u, 3u, 4u, 5u, 8u, 0xFFFFFFFFu}) {
        ASSERT_EQ(Word(AskSdo(way, Request(0x21, at.index, at.sub, size))), 0x06010002u);
      }
    }
  }
  EXPECT_GT(count, 3 * 90);
}

// Modbus: an input register is of a table that cannot be written.
TEST_F(Fw, NoInputRegisterIsAHoldingRegister) {
  ASSERT_TRUE(Takes(kRtu));
  for (const axis_register_t &input : axis_input) {
    const bool held = std::any_of(std::begin(axis_holding), std::end(axis_holding),
                                  [&](const auto &h) { return h.first == input.first; });
    if (held) continue;
    EXPECT_EQ(AskRtu(Pdu(6, {input.first, 0}))[1], 0x86) << input.first;
  }
}

// Whatever is written by one bus reads the same by all others; what is refused changes nothing.
TEST_F(Fw, WhatOneBusWritesTheOthersRead) {
  std::mt19937 random(1988);
  std::map<std::pair<uint16_t, Way>, int> accepted;
  // Mappings can be written while no PDO is valid and nothing is mapped.
  for (unsigned pdo = 0; pdo < 4; ++pdo) {
    for (unsigned base : {0x1400u, 0x1800u}) {
      const uint32_t cob_id = Word(AskSdo(kCanopen, Request(0x40, base + pdo, 1)));
      ASSERT_EQ(Download(kCanopen, base + pdo, 1, cob_id | 0x80000000u, 4), 0u);
      ASSERT_EQ(Download(kCanopen, base + 0x200 + pdo, 0, 0, 1), 0u);
    }
  }
  int objects = 0;
  int registers = 0;
  for (uint16_t object = 1; object < AXIS_OBJ_COUNT; ++object) {
    const axis_object_t &entry = axis_objects[object];
    if (entry.access != AXIS_ACCESS_RW || entry.block == AXIS_BLOCK_NONE) continue;
    if (object == AXIS_OBJ_COMMAND_SOURCE) continue;  // the lock itself: tested above
    ++objects;
    if (RegisterOf(object)) ++registers;
    const int32_t power_up = Inner(object);
    std::vector<int32_t> values{entry.min, entry.max, entry.initial, power_up};
    for (int i = 0; i < 6; ++i) {
      const bool is_u32 = entry.type == AXIS_TYPE_U32;
      const int64_t low =
          is_u32 ? static_cast<int64_t>(static_cast<uint32_t>(entry.min)) : entry.min;
      const int64_t high =
          is_u32 ? static_cast<int64_t>(static_cast<uint32_t>(entry.max)) : entry.max;
      const auto offset = static_cast<int64_t>(random()) % (high - low + 1);
      values.push_back(static_cast<int32_t>(static_cast<uint32_t>(low + offset)));
    }
    values.push_back(power_up);
    for (int32_t value : values) {
      std::map<Way, bool> took;
      for (Way writer : kWays) {
        if (!Reaches(writer, object)) continue;
        ASSERT_TRUE(Takes(writer));
        const uint32_t before = Masked(Inner(object), object);
        const bool ok = Write(writer, object, value) == 0;
        took[writer] = ok;
        accepted[{object, writer}] += ok;
        // The count of the history reads what is there.
        const uint32_t expected = ok ? Masked(value, object) : before;
        for (Way reader : kWays) {
          if (!Reaches(reader, object)) continue;
          ASSERT_EQ(Read(reader, object), expected)
              << "object " << object << " value " << value << " by " << writer << " to " << reader;
        }
        ASSERT_EQ(ok, took.begin()->second) << "object " << object << " value " << value << " by "
                                            << writer << ": the buses differ";
      }
    }
    if (object == AXIS_OBJ_CONTROLWORD) Set(object, 0);
  }
  for (const auto &[which, count] : accepted) {
    EXPECT_GT(count, 0) << "object " << which.first << " by " << which.second;
  }
  EXPECT_GT(objects, 150);
  EXPECT_GT(registers, 80);
  std::printf("%d objects, %d of them registers\n", objects, registers);
}

}  // namespace
