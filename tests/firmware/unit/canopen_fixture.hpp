#ifndef TESTS_UNIT_CANOPEN_FIXTURE_HPP_
#define TESTS_UNIT_CANOPEN_FIXTURE_HPP_

#include <gtest/gtest.h>

#include <cstdint>
#include <optional>
#include <vector>

#include "tests/firmware/unit/bus_fixture.hpp"

inline Frame Heartbeat(uint8_t state) { return {0x700 + kNode, {state}}; }

inline Frame Emergency(uint16_t code, uint8_t error_register, uint8_t info) {
  Bytes data = LittleEndian(code, 2);
  data.insert(data.end(), {error_register, info, 0, 0, 0, 0});
  return {0x80 + kNode, data};
}

// The node's part of a tick, all of it deferred if `defer` is set. Its requests to the firmware are
// ignored.
inline void NodeTickOf(fw_t &fw, bool defer) {
  const canopen_axis_t axis{fw.drive.signals.error_code, fw.axis.signals.fault,
                            fw.axis.signals.active_mode != AXIS_MODE_DISABLED};
  canopen_tick_begin(&fw.canopen, &fw.objects, axis.active != 0,
                     defer || !canopen_has_reported(&fw.canopen, axis.error_code));
  while (canopen_is_behind(&fw.canopen)) {
    (void)canopen_tick_timers(&fw.canopen, axis.active != 0);
    canopen_tick_end(&fw.canopen, &fw.objects, &axis);
  }
}

// A CANopen node whose boot-up message is still pending.
class Canopen : public BusFixture {
 protected:
  Canopen() { PowerUp(); }

  void PowerUp() {
    fw_config_t config = NodeConfig();
    config.hardware = "a bench of this test";
    config.serial_number = 0x12345678;
    fw_init(&fw_, &config);
    EnableServers();
  }

  // Ticks until a frame of this identifier comes, at most `limit`; 0: it did not.
  int TicksUntil(uint16_t id, int limit) {
    for (int i = 1; i <= limit; ++i) {
      Tick();
      if (!Take(id).empty()) return i;
    }
    return 0;
  }

  void Nmt(uint8_t command, uint8_t node = kNode) { Send(0, {command, node}); }
  void Start() {
    Nmt(1);
    Tick();
    Take();
  }

  // Sends a request of 8 bytes to an SDO server; its response, empty without one.
  Bytes Ask(Bytes request, uint16_t server = kServer) {
    request.resize(8);
    return AskServer(request, server);
  }

  std::optional<uint32_t> Upload(uint16_t index, uint8_t sub, uint16_t server = kServer) {
    const auto answer = Ask(Request(0x40, index, sub), server);
    if (answer.empty() || (answer[0] & 0xE3) != 0x43) return std::nullopt;
    return Word(answer);
  }

  uint32_t UploadAbort(uint16_t index, uint8_t sub) {
    const auto answer = Ask(Request(0x40, index, sub));
    return (!answer.empty() && answer[0] == 0x80) ? Word(answer) : 0;
  }

  // Segmented upload of everything, and the size that was announced.
  Bytes UploadAll(uint16_t index, uint8_t sub, uint32_t &size) {
    const auto first = Ask(Request(0x40, index, sub));
    EXPECT_EQ(first[0], 0x41);
    size = Word(first);
    Bytes all;
    for (uint8_t toggle = 0;; toggle ^= 0x10) {
      const auto answer = Ask({static_cast<uint8_t>(0x60 | toggle)});
      if (answer.empty() || answer[0] == 0x80) {
        ADD_FAILURE() << "aborted: " << std::hex << Word(answer);
        return all;
      }
      EXPECT_EQ(answer[0] & 0xF0, toggle);
      const int count = 7 - ((answer[0] >> 1) & 7);
      all.insert(all.end(), answer.begin() + 1, answer.begin() + 1 + count);
      if (answer[0] & 1) return all;
    }
  }

  // Sets the signals of a drive that has latched a fault.
  void ShowFault(uint16_t code, uint8_t fault) {
    fw_.drive.signals.error_code = code;
    fw_.axis.signals.fault = fault;
  }

  // Runs the node's tick alone: the drive's signals stay as the test has set them.
  void NodeTick(int ticks = 1) {
    for (int i = 0; i < ticks; ++i) NodeTickOf(fw_, false);
  }

  // Maps a PDO with a client's standard sequence of writes.
  void Remap(uint16_t communication, uint16_t mapping, uint32_t cob_id,
             const std::vector<uint32_t> &entries, uint8_t type) {
    EXPECT_EQ(Download(communication, 1, cob_id | 0x80000000u, 4), 0u);
    EXPECT_EQ(Download(communication, 2, type, 1), 0u);
    EXPECT_EQ(Download(mapping, 0, 0, 1), 0u);
    for (size_t i = 0; i < entries.size(); ++i) {
      EXPECT_EQ(Download(mapping, static_cast<uint8_t>(i + 1), entries[i], 4), 0u) << i;
    }
    EXPECT_EQ(Download(mapping, 0, static_cast<uint32_t>(entries.size()), 1), 0u);
    EXPECT_EQ(Download(communication, 1, cob_id, 4), 0u);
  }
};

#endif
