#ifndef TESTS_UNIT_FW_FIXTURE_HPP_
#define TESTS_UNIT_FW_FIXTURE_HPP_

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "tests/firmware/unit/bus_fixture.hpp"

// The safety of the buses: whether a partner falls silent, disconnects or sends invalid frames, the
// axis is disabled with code 0 within the stated ticks, and every bus reports the reason.
//
// Ticks are counted from the event, 1: the very next tick is off. N is a time rounded up to ticks.
//   no valid sensors (dead plant)        1        lost lock of a source on another bus   N + 1
//   CAN bus off, NMT stop, NMT reset *   1        lost heartbeat, late RPDO              N + 2
// (* a reset of the node: 2.) A ramp of fault_reaction_option precedes that if selected.
class Fw : public BusFixture {
 protected:
  static constexpr int kCode = 300;  // output of the enabled axis, in open loop

  // The sources of writes. Gateway: the second SDO server, for Modbus TCP.
  enum Way { kCanopen, kGateway, kLcm, kRtu };
  static constexpr std::array<Way, 4> kWays{kCanopen, kGateway, kLcm, kRtu};

  static int SourceOf(Way way) {
    return way == kCanopen ? AXIS_COMMAND_SOURCE_CANOPEN
           : way == kLcm   ? AXIS_COMMAND_SOURCE_LCM
                           : AXIS_COMMAND_SOURCE_MODBUS;
  }

  static uint16_t ServerOf(Way way) {
    return way == kGateway ? kModbusServer : way == kLcm ? kLcmServer : kServer;
  }

  // ms on the wire as ticks of 2/3 ms, rounded up.
  static int TicksOf(int ms) { return (3 * ms + 1) / 2; }

  static std::optional<uint16_t> RegisterOf(uint16_t object) {
    for (const axis_register_t &r : axis_holding) {
      if (r.object == object) return r.first;
    }
    for (const axis_register_t &r : axis_input) {
      if (r.object == object) return r.first;
    }
    return std::nullopt;
  }

  static int SizeOf(uint16_t object) { return value_bytes(axis_objects[object].type); }

  static uint32_t Masked(int32_t value, uint16_t object) {
    const int bytes = SizeOf(object);
    return static_cast<uint32_t>(value) & (bytes == 4 ? 0xFFFFFFFFu : (1u << (8 * bytes)) - 1);
  }

  Fw() { PowerUp(); }

  void PowerUp(const store_memory_t *memory = nullptr) {
    fw_ = fw_t{};
    fw_config_t config = NodeConfig();
    config.memory = memory;
    fw_init(&fw_, &config);
    EnableServers();
    inputs_ = {0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
    outputs_ = {};
    emergencies_.clear();
  }

  Bytes AskSdo(Way way, const Bytes &request) { return AskServer(request, ServerOf(way)); }

  // 0 or the abort code.
  uint32_t Download(Way way, uint16_t index, uint8_t sub, uint32_t value, int bytes) {
    return BusFixture::Download(index, sub, value, bytes, ServerOf(way));
  }

  Bytes SendRtu(const Bytes &frame) {
    SendSerial(frame);
    return Fetch();
  }

  Bytes AskRtu(const Bytes &pdu) { return SendRtu(RtuFrame(kNode, pdu)); }

  static bool IsException(const Bytes &answer) { return answer.size() < 2 || answer[1] > 0x7F; }

  bool LowFirst() const {
    return Inner(AXIS_OBJ_MODBUS_WORD_ORDER) == AXIS_MODBUS_WORD_ORDER_LOW_FIRST;
  }

  // Writes an object by one of the ways: 0, an abort code or an exception.
  uint32_t Write(Way way, uint16_t object, int32_t value) {
    const uint32_t raw = Masked(value, object);
    if (way != kRtu) {
      const axis_address_t *at = AddressOf(object);
      return Download(way, at->index, at->sub, raw, SizeOf(object));
    }
    const unsigned first = *RegisterOf(object);
    const unsigned high = raw >> 16, low = raw & 0xFFFF;
    const bool low_first = LowFirst();
    const Bytes answer = AskRtu(
        SizeOf(object) == 4 ? WritePdu(first, {low_first ? low : high, low_first ? high : low})
                            : Pdu(6, {first, static_cast<unsigned>(value) & 0xFFFF}));
    return IsException(answer) ? (answer.size() > 2 ? answer[2] : kSilence) : 0;
  }

  // The raw bits as this way reads them.
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

  // The firmware's own value, without a bus.
  int32_t Inner(uint16_t object) const { return FirmwareFixture::Read(object); }

  int Owner() const { return Inner(AXIS_OBJ_COMMAND_SOURCE); }
  bool Acquires(Way way) { return Write(way, AXIS_OBJ_COMMAND_SOURCE, SourceOf(way)) == 0; }

  // Enables the axis by this way, with output kCode.
  void Drive(Way way = kCanopen) {
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    ASSERT_TRUE(Acquires(way));
    ASSERT_EQ(Write(way, AXIS_OBJ_MODES_OF_OPERATION, AXIS_MODES_OF_OPERATION_OPEN_LOOP), 0u);
    ASSERT_EQ(Write(way, AXIS_OBJ_OPEN_LOOP_CODE, kCode), 0u);
    ASSERT_EQ(Write(way, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
    ASSERT_EQ(Write(way, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
    Tick(2);
    ASSERT_TRUE(IsOn());
    Emergencies();
  }

  bool IsOn() const { return outputs_.dac_code == kCode && outputs_.amp_enable == 1; }
  bool IsOff() const {
    return outputs_.dac_code == 0 && outputs_.dac_fine == 0 && outputs_.amp_enable == 0 &&
           outputs_.brake_release == 0 && Inner(AXIS_OBJ_ACTIVE_MODE) == AXIS_MODE_DISABLED;
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

  // Every bus reports the same fault; one emergency is sent.
  void ExpectNamed(int fault, int code, bool reachable_by_can = true) {
    EnableServers();  // a gateway does so after every boot-up
    for (Way way : kWays) {
      if (way != kRtu && !reachable_by_can) continue;
      EXPECT_EQ(Read(way, AXIS_OBJ_FAULT), static_cast<uint32_t>(fault)) << "way " << way;
      EXPECT_EQ(Read(way, AXIS_OBJ_ERROR_CODE), static_cast<uint32_t>(code)) << "way " << way;
      EXPECT_EQ(Read(way, AXIS_OBJ_STATUSWORD) & 0x4F, 0x08u) << "way " << way;
    }
    EXPECT_EQ(CountEmergencies(code), reachable_by_can ? 1 : 0);
  }

  void WatchHeartbeat(int ms) {
    ASSERT_EQ(Download(kCanopen, 0x1016, 1, 0x007F0000u | static_cast<unsigned>(ms), 4), 0u);
  }
};

#endif
