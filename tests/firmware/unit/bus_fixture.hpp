#ifndef TESTS_UNIT_BUS_FIXTURE_HPP_
#define TESTS_UNIT_BUS_FIXTURE_HPP_

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "tests/firmware/unit/firmware_fixture.hpp"
#include "tests/support/frames.hpp"

inline constexpr uint8_t kNode = 5;

// A node on a CAN bus and a serial line of its own: frames in by Send, out by Take,
// bytes in by SendSerial, out by Fetch.
class BusFixture : public FirmwareFixture {
 protected:
  static constexpr uint32_t kSilence = 0xFFFFFFFF;  // in place of an answer
  static constexpr uint16_t kServer = 0x600;        // the SDO server of the CANopen master
  // Requests to the other two servers, as EnableServers() sets them; answers have one more.
  static constexpr uint16_t kModbusServer = 0x680;
  static constexpr uint16_t kLcmServer = 0x682;

  fw_config_t NodeConfig() {
    fw_config_t config{};
    config.recorder_buffer = buffer_.data();
    config.recorder_bytes = static_cast<uint32_t>(buffer_.size());
    config.node_id = kNode;
    config.buses = 1;
    return config;
  }

  // As a gateway does.
  void EnableServers() {
    Set(AXIS_OBJ_SDO_MODBUS_RECEIVE, kModbusServer);
    Set(AXIS_OBJ_SDO_MODBUS_TRANSMIT, kModbusServer + 1);
    Set(AXIS_OBJ_SDO_LCM_RECEIVE, kLcmServer);
    Set(AXIS_OBJ_SDO_LCM_TRANSMIT, kLcmServer + 1);
  }

  static uint16_t RequestId(uint16_t server) {
    return static_cast<uint16_t>(server == kServer ? kServer + kNode : server);
  }
  static uint16_t AnswerId(uint16_t server) {
    return static_cast<uint16_t>(server == kServer ? kServer - 0x80 + kNode : server + 1);
  }

  void Send(uint16_t id, const Bytes &data, bool remote = false) {
    can_frame_t frame{};
    frame.id = id;
    frame.length = static_cast<uint8_t>(data.size());
    frame.remote = remote ? 1 : 0;
    std::copy(data.begin(), data.end(), frame.data);
    fw_can_receive(&fw_, &frame);
  }

  // The frames sent since the last call; emergencies are kept for Emergencies() too.
  std::vector<Frame> Take() {
    std::vector<Frame> frames;
    for (can_frame_t f{}; fw_can_transmit(&fw_, &f);) {
      EXPECT_EQ(f.remote, 0);
      frames.push_back({f.id, {f.data, f.data + f.length}});
      if (f.id == 0x80 + kNode) {
        emergencies_.push_back(f.data[0] | f.data[1] << 8 | f.data[3] << 16);
      }
    }
    return frames;
  }

  // Those of one identifier.
  std::vector<Frame> Take(uint16_t id) {
    std::vector<Frame> frames = Take();
    std::erase_if(frames, [id](const Frame &f) { return f.id != id; });
    return frames;
  }

  // Emergencies since the last call: code, and the info byte in bits 16 to 23.
  std::vector<int> Emergencies() {
    Take();
    return std::exchange(emergencies_, {});
  }

  int CountEmergencies(int code) {
    const std::vector<int> codes = Emergencies();
    return static_cast<int>(
        std::count_if(codes.begin(), codes.end(), [&](int t) { return (t & 0xFFFF) == code; }));
  }

  static Bytes Request(uint8_t command, uint16_t index, uint8_t sub, uint32_t value = 0) {
    Bytes data{command, static_cast<uint8_t>(index), static_cast<uint8_t>(index >> 8), sub};
    const Bytes bytes = LittleEndian(value, 4);
    data.insert(data.end(), bytes.begin(), bytes.end());
    return data;
  }

  static uint32_t Word(const Bytes &answer) {
    if (answer.size() < 8) return kSilence;
    return static_cast<uint32_t>(answer[4] | answer[5] << 8 | answer[6] << 16) |
           static_cast<uint32_t>(answer[7]) << 24;
  }

  // Sends a request of any length to an SDO server; the 8 bytes of its response, empty without one.
  Bytes AskServer(const Bytes &request, uint16_t server = kServer) {
    Take();
    Send(RequestId(server), request);
    const std::vector<Frame> frames = Take(AnswerId(server));
    if (frames.empty()) return {};
    EXPECT_EQ(frames.size(), 1u);
    EXPECT_EQ(frames[0].data.size(), 8u);
    return frames[0].data;
  }

  // Expedited download with this many bytes: 0 or the abort code.
  uint32_t Download(uint16_t index, uint8_t sub, uint32_t value, int bytes,
                    uint16_t server = kServer) {
    const Bytes answer = AskServer(
        Request(static_cast<uint8_t>(0x23 | (4 - bytes) << 2), index, sub, value), server);
    if (answer.empty()) return kSilence;
    EXPECT_TRUE(answer[0] == 0x60 || answer[0] == 0x80) << int{answer[0]};
    EXPECT_EQ(answer[1] | answer[2] << 8, index);
    EXPECT_EQ(answer[3], sub);
    return answer[0] == 0x60 ? 0 : Word(answer);
  }

  void SendSerial(const Bytes &bytes) {
    fw_modbus_receive(&fw_, bytes.data(), static_cast<uint16_t>(bytes.size()));
  }

  Bytes Fetch() {
    Bytes answer;
    uint8_t piece[7];  // fetched in pieces, as a port would
    for (uint16_t n; (n = fw_modbus_transmit(&fw_, piece, sizeof(piece))) > 0;) {
      answer.insert(answer.end(), piece, piece + n);
    }
    return answer;
  }

  std::vector<int> emergencies_;
};

#endif
