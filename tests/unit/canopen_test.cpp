#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "firmware/port/host/firmware.hpp"

namespace {

constexpr uint8_t kNode = 5;

struct Frame {
  uint16_t id;
  std::vector<uint8_t> data;
  bool operator==(const Frame &) const = default;
};

std::ostream &operator<<(std::ostream &out, const Frame &frame) {
  out << std::hex << frame.id << " [";
  for (uint8_t byte : frame.data) out << ' ' << int{byte};
  return out << " ]" << std::dec;
}

Frame Heartbeat(uint8_t state) { return {0x700 + kNode, {state}}; }

// Little-endian bytes.
std::vector<uint8_t> Bytes(uint32_t value, int count) {
  std::vector<uint8_t> bytes;
  for (int i = 0; i < count; ++i) bytes.push_back(static_cast<uint8_t>(value >> (8 * i)));
  return bytes;
}

Frame Emergency(uint16_t code, uint8_t error_register, uint8_t info) {
  std::vector<uint8_t> data = Bytes(code, 2);
  data.insert(data.end(), {error_register, info, 0, 0, 0, 0});
  return {0x80 + kNode, data};
}

// A node on a bus of its own: frames in by Send, out by Take.
class Canopen : public ::testing::Test {
 protected:
  Canopen() { PowerUp(); }

  void PowerUp() {
    fw_config_t config{};
    config.recorder_buffer = buffer_.data();
    config.recorder_bytes = buffer_.size();
    config.hardware = "a bench of this test";
    config.serial_number = 0x12345678;
    config.node_id = kNode;
    config.buses = 1;
    fw_init(&fw_, &config);
    inputs_.sensor_valid = 1;
    inputs_.din = AXIS_DIN_ENABLE;
  }

  void Send(uint16_t id, const std::vector<uint8_t> &data, bool remote = false) {
    can_frame_t frame{};
    frame.id = id;
    frame.length = static_cast<uint8_t>(data.size());
    frame.remote = remote ? 1 : 0;
    std::copy(data.begin(), data.end(), frame.data);
    fw_can_receive(&fw_, &frame);
  }

  void Tick(int ticks = 1) {
    for (int i = 0; i < ticks; ++i) fw_tick(&fw_, &inputs_, &outputs_);
  }

  std::vector<Frame> Take() {
    std::vector<Frame> frames;
    can_frame_t frame{};
    while (fw_can_transmit(&fw_, &frame)) {
      EXPECT_EQ(frame.remote, 0);
      frames.push_back({frame.id, {frame.data, frame.data + frame.length}});
    }
    return frames;
  }

  // The frames of one identifier in what was sent since.
  std::vector<Frame> Take(uint16_t id) {
    std::vector<Frame> frames = Take();
    std::erase_if(frames, [id](const Frame &f) { return f.id != id; });
    return frames;
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

  // One request to an SDO server: its answer's 8 bytes, empty without one.
  std::vector<uint8_t> Ask(std::vector<uint8_t> request, uint16_t server = 0x600) {
    static const std::array<std::array<uint16_t, 2>, 3> ids{
        {{0x600, 0x580}, {0x640, 0x5C0}, {0x660, 0x5E0}}};
    request.resize(8);
    Take();
    Send(static_cast<uint16_t>(server + kNode), request);
    for (const auto &pair : ids) {
      if (pair[0] != server) continue;
      const std::vector<Frame> frames = Take(static_cast<uint16_t>(pair[1] + kNode));
      if (frames.empty()) return {};
      EXPECT_EQ(frames.size(), 1u);
      EXPECT_EQ(frames[0].data.size(), 8u);
      return frames[0].data;
    }
    return {};
  }

  static std::vector<uint8_t> Request(uint8_t command, uint16_t index, uint8_t sub,
                                      uint32_t value = 0) {
    std::vector<uint8_t> data{command, static_cast<uint8_t>(index),
                              static_cast<uint8_t>(index >> 8), sub};
    const std::vector<uint8_t> bytes = Bytes(value, 4);
    data.insert(data.end(), bytes.begin(), bytes.end());
    return data;
  }

  static uint32_t Word(const std::vector<uint8_t> &answer) {
    return answer.size() < 8 ? 0xFFFFFFFFu
                             : static_cast<uint32_t>(answer[4] | answer[5] << 8 | answer[6] << 16) |
                                   static_cast<uint32_t>(answer[7]) << 24;
  }

  // Expedited download with this many bytes: 0 or the abort code.
  uint32_t Download(uint16_t index, uint8_t sub, uint32_t value, int bytes,
                    uint16_t server = 0x600) {
    const auto answer =
        Ask(Request(static_cast<uint8_t>(0x23 | (4 - bytes) << 2), index, sub, value), server);
    if (answer.empty()) return 0xFFFFFFFFu;
    EXPECT_TRUE(answer[0] == 0x60 || answer[0] == 0x80) << int{answer[0]};
    EXPECT_EQ(answer[1] | answer[2] << 8, index);
    EXPECT_EQ(answer[3], sub);
    return answer[0] == 0x60 ? 0 : Word(answer);
  }

  std::optional<uint32_t> Upload(uint16_t index, uint8_t sub, uint16_t server = 0x600) {
    const auto answer = Ask(Request(0x40, index, sub), server);
    if (answer.empty() || (answer[0] & 0xE3) != 0x43) return std::nullopt;
    return Word(answer);
  }

  uint32_t UploadAbort(uint16_t index, uint8_t sub) {
    const auto answer = Ask(Request(0x40, index, sub));
    return (!answer.empty() && answer[0] == 0x80) ? Word(answer) : 0;
  }

  // Segmented upload of everything, and the size that was announced.
  std::vector<uint8_t> UploadAll(uint16_t index, uint8_t sub, uint32_t &size) {
    const auto first = Ask(Request(0x40, index, sub));
    EXPECT_EQ(first[0], 0x41);
    size = Word(first);
    std::vector<uint8_t> all;
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

  int32_t Read(uint16_t object) const {
    int32_t value = 0;
    EXPECT_EQ(fw_object_read(&fw_, object, &value), FW_OK) << "object " << object;
    return value;
  }

  // As a drive that has latched a fault shows it.
  void ShowFault(uint16_t code, uint8_t fault) {
    fw_.drive.signals.error_code = code;
    fw_.axis.signals.fault = fault;
  }

  // Runs the node's tick alone: the drive's signals stay as the test has set them.
  void NodeTick(int ticks = 1) {
    for (int i = 0; i < ticks; ++i) canopen_tick(&fw_.canopen, &fw_);
  }

  // The standard sequence of a client.
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

  fw_t fw_{};
  axis_inputs_t inputs_{};
  axis_outputs_t outputs_{};
  std::array<uint8_t, FW_RECORDER_BYTES> buffer_{};
};

TEST(Payload, BitsGoWhereTheyBelong) {
  EXPECT_EQ(fx_payload_put(0, 0xFFFFFFFFu, 32, 32), 0xFFFFFFFF00000000u);
  EXPECT_EQ(fx_payload_put(1, 0x1FFu, 63, 1), 0x8000000000000001u);
  EXPECT_EQ(fx_payload_put(0, 0xABCDu, 9, 8), 0xCDu << 9);
  EXPECT_EQ(fx_payload_get(0x8123456789ABCDEFu, 0, 32), 0x89ABCDEFu);
  EXPECT_EQ(fx_payload_get(0x8123456789ABCDEFu, 32, 32), 0x81234567u);
  EXPECT_EQ(fx_payload_get(0x8123456789ABCDEFu, 63, 1), 1u);
  EXPECT_EQ(fx_payload_get(0x8123456789ABCDEFu, 4, 8), 0xDEu);
  uint8_t bytes[9] = {9, 9, 9, 9, 9, 9, 9, 9, 9};
  fx_store_payload(bytes, 0x8123456789ABCDEFu, 3);
  EXPECT_EQ(fx_load_payload(bytes, 4), 0x09ABCDEFu);
  fx_store_payload(bytes, 0x8123456789ABCDEFu, 8);
  EXPECT_EQ(fx_load_payload(bytes, 8), 0x8123456789ABCDEFu);
  EXPECT_EQ(bytes[8], 9);
  EXPECT_EQ(fx_load_payload(bytes, 0), 0u);
}

// --- NMT and heartbeat ---------------------------------------------------------------------------

TEST_F(Canopen, BootsUpAfterEveryReset) {
  EXPECT_EQ(Take(), std::vector<Frame>{Heartbeat(0)});
  for (uint8_t command : {129, 130}) {
    for (uint8_t node : {uint8_t{0}, kNode}) {
      Nmt(1);
      Nmt(command, node);
      Take();
      Tick();
      const auto frames = Take();
      ASSERT_FALSE(frames.empty());
      EXPECT_EQ(frames[0], Heartbeat(0));
      EXPECT_EQ(Read(AXIS_OBJ_NMT_STATE), 127);
    }
  }
}

TEST_F(Canopen, NmtCommandsMoveTheStateAndForeignOnesDoNot) {
  struct Row {
    uint8_t command, node;
    int state;
  };
  for (const Row &row :
       {Row{1, kNode, 5}, Row{2, kNode, 4}, Row{128, kNode, 127}, Row{1, 0, 5}, Row{128, 0, 127},
        Row{2, 0, 4}, Row{1, kNode + 1, 4}, Row{3, kNode, 4}, Row{0, 0, 4}, Row{1, kNode, 5}}) {
    Nmt(row.command, row.node);
    EXPECT_EQ(Read(AXIS_OBJ_NMT_STATE), row.state) << int{row.command};
  }
  Send(0, {2});
  Send(0, {2, kNode, 0});
  Send(0, {2, kNode}, true);
  EXPECT_EQ(Read(AXIS_OBJ_NMT_STATE), 5);
}

TEST_F(Canopen, StatesGateTheServices) {
  EXPECT_TRUE(Upload(0x1000, 0).has_value());
  Send(0x200 + kNode, {0x06, 0x00, 0x01});
  EXPECT_EQ(Read(AXIS_OBJ_MODES_OF_OPERATION), 0) << "no PDO before it is operational";
  Nmt(2);
  EXPECT_TRUE(Ask(Request(0x40, 0x1000, 0)).empty());
  Send(0x80, {});
  EXPECT_EQ(Read(AXIS_OBJ_SYNC_COUNT), 0);
  canopen_emergency(&fw_.canopen, 0xFF04, 0);
  Take();
  Tick(301);
  EXPECT_EQ(Take(), std::vector<Frame>{Heartbeat(4)}) << "nothing but the heartbeat";
  Nmt(128);
  Tick();
  EXPECT_EQ(Take(), std::vector<Frame>{Emergency(0xFF04, 0x81, 0)}) << "what had to wait";
  Send(0x80, {});
  EXPECT_EQ(Read(AXIS_OBJ_SYNC_COUNT), 1);
}

TEST_F(Canopen, HeartbeatTimesRoundUpToTicks) {
  Take();
  // 200 ms are 300 ticks: the boot-up message came before tick 0.
  EXPECT_EQ(TicksUntil(0x700 + kNode, 1000), 301);
  EXPECT_EQ(TicksUntil(0x700 + kNode, 1000), 300);
  for (const auto &[ms, ticks] : std::vector<std::array<int, 2>>{
           {1, 2}, {2, 3}, {3, 5}, {7, 11}, {1000, 1500}, {65535, 98303}}) {
    ASSERT_EQ(Download(0x1017, 0, static_cast<uint32_t>(ms), 2), 0u);
    TicksUntil(0x700 + kNode, 100000);
    EXPECT_EQ(TicksUntil(0x700 + kNode, 100000), ticks) << ms << " ms";
  }
  ASSERT_EQ(Download(0x1017, 0, 0, 2), 0u);
  EXPECT_EQ(TicksUntil(0x700 + kNode, 5000), 0);
}

TEST_F(Canopen, AMissingHeartbeatIsToldAndReturnsWithAReset) {
  ASSERT_EQ(Download(0x1016, 1, 0x000A0064, 4), 0u);  // node 10, 100 ms
  ASSERT_EQ(Download(0x1016, 2, 0x000B0032, 4), 0u);  // node 11, 50 ms
  EXPECT_EQ(Download(0x1016, 3, 0x000A0001, 4), 0x06040043u) << "one consumer for each node";
  EXPECT_EQ(Download(0x1016, 3, 0x010A0001, 4), 0x06090030u) << "reserved bits";
  EXPECT_EQ(Download(0x1016, 3, 0x000A0000, 4), 0u) << "no time, no consumer";
  Start();
  NodeTick(1000);
  EXPECT_EQ(fw_.canopen.signals.error_register, 0) << "watched from the first heartbeat on";
  Send(0x70A, {5});
  NodeTick(150);
  EXPECT_EQ(Read(AXIS_OBJ_NMT_STATE), 5);
  Take();
  NodeTick(1);
  EXPECT_EQ(Take(0x80 + kNode), std::vector<Frame>{Emergency(0x8130, 0x11, 10)});
  EXPECT_EQ(Read(AXIS_OBJ_NMT_STATE), 127) << "1029h: pre-operational";
  EXPECT_EQ(Read(AXIS_OBJ_ERROR_REGISTER), 0x11);
  // The fault that follows was told already.
  ShowFault(0x8130, AXIS_FAULT_HEARTBEAT_LOST);
  NodeTick(3);
  EXPECT_TRUE(Take(0x80 + kNode).empty());
  ShowFault(0, 0);
  NodeTick(1);
  EXPECT_EQ(Take(0x80 + kNode), std::vector<Frame>{Emergency(0, 0x11, 0)});
  Send(0x70A, {5});
  NodeTick(1);
  EXPECT_EQ(Take(0x80 + kNode), std::vector<Frame>{Emergency(0, 0, 0)});
  EXPECT_EQ(Read(AXIS_OBJ_ERROR_REGISTER), 0);
}

TEST_F(Canopen, ErrorBehaviourChoosesTheState) {
  for (const auto &[behaviour, state] : std::vector<std::array<int, 2>>{{0, 127}, {1, 5}, {2, 4}}) {
    PowerUp();
    ASSERT_EQ(Download(0x1029, 1, static_cast<uint32_t>(behaviour), 1), 0u);
    ASSERT_EQ(Download(0x1016, 1, 0x000A000A, 4), 0u);
    Start();
    Send(0x70A, {5});
    Tick(20);
    EXPECT_EQ(Read(AXIS_OBJ_NMT_STATE), state);
  }
  EXPECT_EQ(Download(0x1029, 1, 3, 1), 0xFFFFFFFFu) << "stopped: no SDO";
}

// --- SDO -----------------------------------------------------------------------------------------

TEST_F(Canopen, ReadsEveryAddressOfTheTable) {
  Take();
  for (const axis_address_t &at : axis_addresses) {
    const auto answer = Ask(Request(0x40, at.index, at.sub));
    ASSERT_EQ(answer.size(), 8u) << std::hex << at.index;
    EXPECT_EQ(answer[1] | answer[2] << 8, at.index);
    EXPECT_EQ(answer[3], at.sub);
    if (at.what == AXIS_ADDRESS_COUNT) {
      EXPECT_EQ(answer[0], 0x4F);
      EXPECT_EQ(Word(answer), at.value);
    } else if (at.what == AXIS_ADDRESS_OBJECT) {
      const axis_object_t &object = axis_objects[at.value];
      if (object.access == AXIS_ACCESS_WO) {
        EXPECT_EQ(answer[0], 0x80);
        EXPECT_EQ(Word(answer), 0x06010001u);
        continue;
      }
      const uint8_t commands[] = {0, 0x4F, 0x4B, 0, 0x43};
      const int bytes = value_bytes(object.type);
      EXPECT_EQ(answer[0], commands[bytes]) << std::hex << at.index;
      const uint32_t mask = bytes == 4 ? 0xFFFFFFFFu : (1u << (8 * bytes)) - 1;
      EXPECT_EQ(Word(answer), static_cast<uint32_t>(Read(at.value)) & mask);
    }
  }
}

TEST_F(Canopen, CobIdsCarryTheNodeId) {
  EXPECT_EQ(Upload(0x1014, 0), 0x85u);
  EXPECT_EQ(Upload(0x1200, 1), 0x605u);
  EXPECT_EQ(Upload(0x1200, 2), 0x585u);
  EXPECT_EQ(Upload(0x1201, 1), 0x645u);
  EXPECT_EQ(Upload(0x1202, 2), 0x5E5u);
  EXPECT_EQ(Upload(0x1403, 1), 0x505u);
  EXPECT_EQ(Upload(0x1800, 1), 0x40000185u);
  EXPECT_EQ(Upload(0x1018, 4), 0x12345678u);
}

TEST_F(Canopen, ReadOnlyObjectsRefuseEveryLength) {
  int count = 0;
  for (const axis_address_t &at : axis_addresses) {
    if (at.what == AXIS_ADDRESS_OBJECT && axis_objects[at.value].access != AXIS_ACCESS_RO) continue;
    ++count;
    for (int bytes = 1; bytes <= 4; ++bytes) {
      EXPECT_EQ(Download(at.index, at.sub, 0, bytes), 0x06010002u)
          << std::hex << at.index << ' ' << int{at.sub} << ' ' << bytes;
    }
    EXPECT_EQ(Word(Ask(Request(0x22, at.index, at.sub))), 0x06010002u) << "no length";
    EXPECT_EQ(Word(Ask(Request(0x20, at.index, at.sub))), 0x06010002u) << "segments, no length";
    for (uint32_t size : {0u, 1u, 2u, 3u, 4u, 5u, 7u, 8u, 256u, 0xFFFFFFFFu}) {
      EXPECT_EQ(Word(Ask(Request(0x21, at.index, at.sub, size))), 0x06010002u) << size;
    }
  }
  EXPECT_GT(count, 90);
}

TEST_F(Canopen, WritableObjectsRefuseWrongLengths) {
  for (const axis_address_t &at : axis_addresses) {
    if (at.what != AXIS_ADDRESS_OBJECT || axis_objects[at.value].access == AXIS_ACCESS_RO) continue;
    const int right = value_bytes(axis_objects[at.value].type);
    for (int bytes = 1; bytes <= 4; ++bytes) {
      if (bytes == right) continue;
      const uint32_t expected = bytes > right ? 0x06070012u : 0x06070013u;
      EXPECT_EQ(Download(at.index, at.sub, 0, bytes), expected) << std::hex << at.index;
    }
  }
}

TEST_F(Canopen, AbortCodesOfValues) {
  EXPECT_EQ(Download(0x5000, 0, 0, 1), 0x06020000u);
  EXPECT_EQ(Download(0x1018, 9, 0, 1), 0x06090011u);
  EXPECT_EQ(UploadAbort(0x5000, 0), 0x06020000u);
  EXPECT_EQ(UploadAbort(0x1018, 9), 0x06090011u);
  EXPECT_EQ(UploadAbort(0x2001, 1), 0x06090011u);
  EXPECT_EQ(UploadAbort(0x201E, 0), 0x06010001u);
  EXPECT_EQ(Download(0x200F, 0, 17, 1), 0x06090031u);  // adc_bits 8..16
  EXPECT_EQ(Download(0x200F, 0, 7, 1), 0x06090032u);
  EXPECT_EQ(Download(0x200D, 0, 0, 1), 0x06090030u);  // force_sign -1 or 1
  EXPECT_EQ(Download(0x200D, 0, 0xFF, 1), 0u);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_SIGN), -1) << "signs are extended";
  EXPECT_EQ(Download(0x1010, 1, 0x73617665, 4), 0x08000020u) << "\"save\" backwards";
  EXPECT_EQ(Download(0x1011, 1, 0x65766173, 4), 0x08000020u) << "the other's signature";
  EXPECT_EQ(Download(0x1010, 1, 0x65766173, 4), 0x08000022u) << "without a memory";
  EXPECT_EQ(Download(0x2001, 0, 3, 1), 0x08000022u) << "a native mode over a bus";
  EXPECT_EQ(UploadAbort(0x2120, 0), 0x08000024u) << "no recording";
  EXPECT_EQ(Download(0x2107, 0, 1, 1), 0x06090030u) << "arm without a channel";
  fw_.axis.signals.active_mode = AXIS_MODE_FORCE;
  EXPECT_EQ(Download(0x200F, 0, 12, 1), 0x08000022u) << "only while disabled";
}

TEST_F(Canopen, ServersWriteForTheirSources) {
  EXPECT_EQ(Download(0x200A, 0, 100, 2, 0x640), 0x08000021u) << "canopen owns the axis";
  EXPECT_EQ(Download(0x200A, 0, 100, 2, 0x660), 0x08000021u);
  EXPECT_EQ(Download(0x2301, 0, 2, 1, 0x640), 0x08000021u) << "only its own number";
  EXPECT_EQ(Download(0x2301, 0, 1, 1, 0x640), 0u);
  EXPECT_EQ(Download(0x200A, 0, 100, 2), 0x08000021u);
  EXPECT_EQ(Download(0x200A, 0, 100, 2, 0x660), 0x08000021u);
  EXPECT_EQ(Download(0x200A, 0, 100, 2, 0x640), 0u);
  EXPECT_EQ(Upload(0x200A, 0), 100u) << "all may read";
  EXPECT_EQ(Upload(0x200A, 0, 0x660), 100u);
  Tick(1400);
  EXPECT_EQ(Download(0x200A, 0, 100, 2, 0x640), 0u);
  Tick(1400);
  EXPECT_EQ(Read(AXIS_OBJ_COMMAND_SOURCE), AXIS_COMMAND_SOURCE_MODBUS) << "a write keeps the axis";
  EXPECT_EQ(Upload(0x200A, 0, 0x640), 100u);
  EXPECT_EQ(Download(0x200F, 0, 7, 1, 0x640), 0x06090032u);
  Send(0x645, {0x2B, 0x0A, 0x20});
  Tick(200);
  EXPECT_EQ(Read(AXIS_OBJ_COMMAND_SOURCE), AXIS_COMMAND_SOURCE_CANOPEN) << "nothing else does";
  EXPECT_EQ(Download(0x200A, 0, 101, 2), 0u);
}

TEST_F(Canopen, TransfersOfServersAreApart) {
  uint32_t size = 0;
  EXPECT_EQ(Ask(Request(0x40, 0x1008, 0))[0], 0x41);
  EXPECT_EQ(Ask(Request(0x40, 0x100A, 0), 0x660)[0], 0x41);
  EXPECT_EQ(Ask({0x60})[0] & 0xF0, 0x00);
  EXPECT_EQ(Ask({0x60}, 0x660)[0] & 0xF0, 0x00);
  EXPECT_EQ(Ask({0x60}, 0x640)[0], 0x80);
  EXPECT_EQ(Ask({0x70})[0], 0x1B);  // "ax" is left
  EXPECT_EQ(UploadAll(0x1008, 0, size).size(), 9u);
}

TEST_F(Canopen, TextsComeInSegments) {
  uint32_t size = 0;
  auto text = UploadAll(0x1008, 0, size);
  EXPECT_EQ(std::string(text.begin(), text.end()), "forceaxis");
  EXPECT_EQ(size, 9u);
  text = UploadAll(0x1009, 0, size);
  EXPECT_EQ(std::string(text.begin(), text.end()), "a bench of this test");
  text = UploadAll(0x100A, 0, size);
  EXPECT_EQ(std::string(text.begin(), text.end()), FW_VERSION " " AXIS_OBJECTS_HASH_TEXT);
  EXPECT_EQ(size, text.size());
}

TEST_F(Canopen, TheRecordingIsUploadedWhole) {
  ASSERT_EQ(Download(0x2100, 1, 0x201F00, 4), 0u);  // tick_count
  ASSERT_EQ(Download(0x2107, 0, 1, 1), 0u);
  Tick(3072);
  ASSERT_EQ(Upload(0x2108, 0), 3u);
  uint32_t size = 0;
  const auto data = UploadAll(0x2120, 0, size);
  ASSERT_EQ(size, 12288u);
  ASSERT_EQ(data.size(), size);
  for (size_t i = 0; i < 3072; ++i) {
    const uint32_t tick = static_cast<uint32_t>(data[4 * i] | data[4 * i + 1] << 8);
    ASSERT_EQ(tick, static_cast<uint32_t>(data[0] | data[1] << 8) + i);
  }
}

TEST_F(Canopen, AnUploadEndsWhenItsRecordingIsGone) {
  ASSERT_EQ(Download(0x2100, 1, 0x201F00, 4), 0u);
  ASSERT_EQ(Download(0x2106, 0, 8, 2), 0u);
  ASSERT_EQ(Download(0x2107, 0, 1, 1), 0u);
  Tick(8);
  EXPECT_EQ(Word(Ask(Request(0x40, 0x2120, 0))), 32u);
  EXPECT_EQ(Ask({0x60})[0], 0x00);
  ASSERT_EQ(fw_object_write(&fw_, FW_SOURCE_LOCAL, AXIS_OBJ_RECORDER_ARM, 1), FW_OK);
  Tick(8);
  const auto answer = Ask({0x70});
  EXPECT_EQ(answer[0], 0x80) << "a mixture of two recordings is none";
  EXPECT_EQ(Word(answer), 0x08000024u);
}

TEST_F(Canopen, SegmentedDownload) {
  // Announced, in one segment of 2 bytes.
  EXPECT_EQ(Ask(Request(0x21, 0x200A, 0, 2))[0], 0x60);
  EXPECT_EQ(Ask({0x0B, 0x34, 0x12})[0], 0x20);
  EXPECT_EQ(Upload(0x200A, 0), 0x1234u);
  // Not announced, byte by byte.
  EXPECT_EQ(Ask(Request(0x20, 0x2012, 0))[0], 0x60);
  EXPECT_EQ(Ask({0x0C, 0x78})[0], 0x20);
  EXPECT_EQ(Ask({0x1C, 0x56})[0], 0x30);
  EXPECT_EQ(Ask({0x0C, 0x34})[0], 0x20);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_SETPOINT), 0) << "not before the last";
  EXPECT_EQ(Ask({0x1D, 0x12})[0], 0x30);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_SETPOINT), 0x12345678);
}

TEST_F(Canopen, SegmentedDownloadRefusals) {
  const auto begin = [&](uint8_t command, uint32_t size) {
    EXPECT_EQ(Ask(Request(command, 0x200A, 0, size))[0], 0x60);
  };
  const auto aborted = [&](const std::vector<uint8_t> &answer, uint32_t code) {
    ASSERT_EQ(answer.size(), 8u);
    EXPECT_EQ(answer[0], 0x80);
    EXPECT_EQ(answer[1] | answer[2] << 8, 0x200A);
    EXPECT_EQ(Word(answer), code) << std::hex << Word(answer);
    EXPECT_EQ(Word(Ask({0x01})), 0x05040001u) << "the transfer is over";
  };
  EXPECT_EQ(Word(Ask(Request(0x21, 0x200A, 0, 3))), 0x06070012u);
  EXPECT_EQ(Word(Ask(Request(0x21, 0x200A, 0, 1))), 0x06070013u);
  EXPECT_EQ(Word(Ask(Request(0x21, 0x200A, 0, 0))), 0x06070013u);
  begin(0x21, 2);
  aborted(Ask({0x0D, 1}), 0x06070010u);  // one byte of two
  begin(0x20, 0);
  aborted(Ask({0x0D, 1}), 0x06070013u);
  begin(0x20, 0);
  aborted(Ask({0x09, 1, 2, 3}), 0x06070012u);
  begin(0x20, 0);
  aborted(Ask({0x1B, 1, 2}), 0x05030000u);
  begin(0x20, 0);
  aborted(Ask({0x60}), 0x05040001u);  // an upload's segment
  begin(0x20, 0);
  aborted(Ask(Request(0xC6, 0x200A, 0)), 0x05040001u);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_GAIN), 0);
}

TEST_F(Canopen, ProtocolErrorsOfUploads) {
  EXPECT_EQ(Word(Ask({0x60})), 0x05040001u) << "nothing was begun";
  EXPECT_EQ(Ask(Request(0x40, 0x1008, 0))[0], 0x41);
  EXPECT_EQ(Word(Ask({0x70})), 0x05030000u);
  EXPECT_EQ(Word(Ask({0x60})), 0x05040001u);
  for (uint8_t command : {0xA0, 0xC0, 0xC2, 0xE0, 0xFF}) {
    const auto answer = Ask(Request(command, 0x1008, 0));
    EXPECT_EQ(answer[0], 0x80);
    EXPECT_EQ(answer[1] | answer[2] << 8, 0x1008);
    EXPECT_EQ(Word(answer), 0x05040001u);
  }
}

TEST_F(Canopen, AClientsAbortIsNotAnswered) {
  EXPECT_EQ(Ask(Request(0x40, 0x1008, 0))[0], 0x41);
  EXPECT_TRUE(Ask(Request(0x80, 0x1008, 0, 0x08000000)).empty());
  EXPECT_EQ(Word(Ask({0x60})), 0x05040001u);
}

TEST_F(Canopen, ANewRequestReplacesAPendingOne) {
  EXPECT_EQ(Ask(Request(0x40, 0x1008, 0))[0], 0x41);
  EXPECT_EQ(Ask(Request(0x40, 0x100A, 0))[0], 0x41);
  const auto answer = Ask({0x60});
  EXPECT_EQ(std::string(answer.begin() + 1, answer.begin() + 6), FW_VERSION);
  EXPECT_EQ(Ask(Request(0x40, 0x1000, 0))[0], 0x43);
  EXPECT_EQ(Word(Ask({0x70})), 0x05040001u) << "an expedited one too";
}

TEST_F(Canopen, APendingTransferTimesOut) {
  ASSERT_EQ(Download(0x1017, 0, 0, 2), 0u);
  EXPECT_EQ(Ask(Request(0x40, 0x1008, 0))[0], 0x41);
  NodeTick(5000);
  EXPECT_EQ(Ask({0x60})[0] & 0xF0, 0x00) << "every segment has its own 5 s";
  NodeTick(7500);
  EXPECT_TRUE(Take(0x585).empty());
  NodeTick(1);
  const auto frames = Take(0x585);
  ASSERT_EQ(frames.size(), 1u);
  EXPECT_EQ(frames[0].data, Request(0x80, 0x1008, 0, 0x05040000));
  NodeTick(10000);
  EXPECT_TRUE(Take(0x585).empty());
}

TEST_F(Canopen, TruncatedRequestsGetNoAnswer) {
  Take();
  for (size_t length = 0; length < 8; ++length) {
    Send(0x605, std::vector<uint8_t>(length, 0x40));
    Send(0x605, Request(0x40, 0x1000, 0), true);
  }
  EXPECT_TRUE(Take().empty());
}

// --- PDO -----------------------------------------------------------------------------------------

TEST_F(Canopen, DefaultPdosWork) {
  Nmt(1);
  Take();
  Tick();
  // Event driven: once when it becomes operational.
  auto frames = Take(0x185);
  ASSERT_EQ(frames.size(), 1u);
  EXPECT_EQ(frames[0].data.size(), 3u);
  Send(0x80, {});
  frames = Take();
  ASSERT_EQ(frames.size(), 1u) << "TPDO2 alone, at once";
  EXPECT_EQ(frames[0].id, 0x285);
  EXPECT_EQ(frames[0].data.size(), 8u);
  Send(0x305, {0x00, 0x00, 0x78, 0x56, 0x34, 0x12});
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 0x12345678);
  Send(0x405, {0x00, 0x00, 0xFF, 0xFF, 0xFF, 0xFF});
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_VELOCITY), -1);
  Send(0x505, {0x00, 0x00, 0xFE, 0xFF});
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_FORCE), -2);
}

TEST_F(Canopen, TheEventTimerAndChangesSendATpdo) {
  Start();
  fw_.drive.signals.statusword = 0x1234;
  NodeTick(1);
  EXPECT_EQ(Take(0x185), (std::vector<Frame>{{0x185, {0x34, 0x12, 0}}})) << "in the same tick";
  NodeTick(29);
  EXPECT_TRUE(Take(0x185).empty());
  NodeTick(1);
  EXPECT_EQ(Take(0x185).size(), 1u) << "20 ms after it was last sent";
  Nmt(128);
  fw_.drive.signals.statusword = 1;
  NodeTick(100);
  EXPECT_TRUE(Take(0x185).empty()) << "not operational";
}

TEST_F(Canopen, TheInhibitTimeHoldsChangesBack) {
  EXPECT_EQ(Download(0x1800, 3, 50, 2), 0x08000022u) << "not while it is valid";
  ASSERT_EQ(Download(0x1800, 1, 0xC0000185, 4), 0u);
  ASSERT_EQ(Download(0x1800, 3, 50, 2), 0u);  // 5 ms: 7.5, so 8 ticks
  ASSERT_EQ(Download(0x1800, 1, 0x40000185, 4), 0u);
  Nmt(1);
  Take();
  int sent_at = -1;
  for (int i = 0; i < 100; ++i) {
    fw_.drive.signals.statusword = static_cast<uint16_t>(i + 1);
    NodeTick(1);
    if (Take(0x185).empty()) continue;
    if (sent_at >= 0) {
      EXPECT_EQ(i - sent_at, 8);
    }
    sent_at = i;
  }
  EXPECT_GT(sent_at, 80);
}

TEST_F(Canopen, SynchronousTypes) {
  Nmt(1);
  for (int type : {1, 2, 3, 240}) {
    ASSERT_EQ(Download(0x1801, 2, static_cast<uint32_t>(type), 1), 0u);
    Take();
    for (int sync = 1; sync <= 2 * type; ++sync) {
      Send(0x80, {});
      EXPECT_EQ(Take(0x285).size(), sync % type == 0 ? 1u : 0u) << type << " at " << sync;
    }
  }
  ASSERT_EQ(Download(0x1801, 2, 0, 1), 0u);
  Send(0x80, {});
  EXPECT_EQ(Take(0x285).size(), 1u);
  Send(0x80, {});
  EXPECT_TRUE(Take(0x285).empty()) << "nothing has changed";
  fw_.drive.signals.position_actual += 1;
  NodeTick(10);
  EXPECT_TRUE(Take(0x285).empty());
  Send(0x80, {});
  EXPECT_EQ(Take(0x285).size(), 1u);
  for (int type = 241; type <= 253; ++type) {
    EXPECT_EQ(Download(0x1801, 2, static_cast<uint32_t>(type), 1), 0x06090030u);
    EXPECT_EQ(Download(0x1401, 2, static_cast<uint32_t>(type), 1), 0x06090030u);
  }
}

TEST_F(Canopen, SynchronousRpdosWaitForSync) {
  ASSERT_EQ(Download(0x1401, 2, 1, 1), 0u);
  Nmt(1);
  Send(0x305, {0x00, 0x00, 1, 0, 0, 0});
  Send(0x305, {0x00, 0x00, 2, 0, 0, 0});
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 0);
  Send(0x80, {});
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 2);
  Send(0x305, {0x00, 0x00, 3, 0, 0, 0});
  Nmt(128);
  Nmt(1);
  Send(0x80, {});
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 2) << "forgotten with the state";
}

TEST_F(Canopen, RemapsAtRunTime) {
  Start();
  Remap(0x1A02 - 0x200, 0x1A02, 0x40000385, {0x60640020, 0x60410010, 0x60610008, 0x22100008}, 1);
  fw_.drive.signals.position_actual = 0x04030201;
  fw_.drive.signals.statusword = 0x0605;
  fw_.drive.signals.modes_of_operation_display = 7;
  fw_.drive.signals.contact = 1;
  Take();
  Send(0x80, {});
  EXPECT_EQ(Take(0x385), (std::vector<Frame>{{0x385, {1, 2, 3, 4, 5, 6, 7, 1}}}));
  // Dummies keep places free, even of one bit.
  Remap(0x1403, 0x1603, 0x505, {0x00010001, 0x00050008, 0x60710010, 0x00020008}, 255);
  // 25 bits before the last: the value is bits 9 to 24 of the frame.
  const uint64_t bits = uint64_t{0xABCD & 0x7FFF} << 9;
  std::vector<uint8_t> data = Bytes(static_cast<uint32_t>(bits), 4);
  data.push_back(0);
  Send(0x505, data);
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_FORCE), 0x2BCD);
}

TEST_F(Canopen, MappingIsRefusedWhilePdoIsValid) {
  for (uint16_t pdo = 0; pdo < 2; ++pdo) {
    for (uint16_t side : {0x0000, 0x0400}) {
      const uint16_t mapping = static_cast<uint16_t>(0x1600 + side + pdo);
      const uint16_t communication = static_cast<uint16_t>(mapping - 0x200);
      const uint32_t entry = *Upload(mapping, 1);
      const uint32_t cob_id = *Upload(communication, 1);
      EXPECT_EQ(Download(mapping, 0, 0, 1), 0x08000022u);
      EXPECT_EQ(Download(mapping, 0, 2, 1), 0u) << "what it is already";
      EXPECT_EQ(Download(mapping, 1, entry, 4), 0u) << "what it is already";
      EXPECT_EQ(Download(mapping, 1, 0x60FF0020, 4), 0x08000022u);
      EXPECT_EQ(Download(communication, 1, cob_id + 0x20, 4), 0x08000022u);
      EXPECT_EQ(Download(communication, 1, (cob_id + 0x20) | 0x80000000u, 4), 0u);
      EXPECT_EQ(Download(mapping, 1, 0x60FF0020, 4), 0x08000022u) << "not while any are mapped";
      EXPECT_EQ(Download(mapping, 0, 0, 1), 0u);
      EXPECT_EQ(Download(mapping, 1, 0x60FF0020, 4), 0u);
      EXPECT_EQ(Download(mapping, 0, 9, 1), 0x06090031u);
      EXPECT_EQ(Download(mapping, 0, 1, 1), 0u);
      EXPECT_EQ(Download(communication, 1, cob_id + 0x20, 4), 0u);
    }
  }
}

TEST_F(Canopen, EntriesAreChecked) {
  for (uint16_t mapping : {0x1603, 0x1A03}) {
    const bool transmit = mapping == 0x1A03;
    const uint16_t communication = static_cast<uint16_t>(mapping - 0x200);
    ASSERT_EQ(Download(communication, 1, 0x80000000u, 4), 0u) << "the short way to switch it off";
    ASSERT_EQ(Download(mapping, 0, 0, 1), 0u);
    EXPECT_EQ(Download(mapping, 1, 0x50000008, 4), 0x06020000u);
    EXPECT_EQ(Download(mapping, 1, 0x60400110, 4), 0x06020000u) << "no such sub-index";
    EXPECT_EQ(Download(mapping, 1, 0x60710008, 4), 0x06040041u) << "16 bits";
    EXPECT_EQ(Download(mapping, 1, 0x10170010, 4), 0x06040041u) << "communication";
    EXPECT_EQ(Download(mapping, 1, 0x10180008, 4), 0x06040041u) << "a number of sub-indices";
    EXPECT_EQ(Download(mapping, 1, 0x10080008, 4), 0x06040041u) << "a text";
    EXPECT_EQ(Download(mapping, 1, 0x201E0008, 4), transmit ? 0x06040041u : 0u) << "write only";
    EXPECT_EQ(Download(mapping, 1, 0x60410010, 4), transmit ? 0u : 0x06040041u) << "read only";
    EXPECT_EQ(Download(mapping, 1, 0x00050008, 4), transmit ? 0x06020000u : 0u) << "a dummy";
    EXPECT_EQ(Download(mapping, 1, 0x00050010, 4), transmit ? 0x06020000u : 0x06040041u);
    EXPECT_EQ(Download(mapping, 1, 0, 4), 0u) << "empty";
    EXPECT_EQ(Download(mapping, 0, 1, 1), 0x06040042u) << "but not to be mapped";
    for (uint8_t i = 1; i <= 3; ++i) ASSERT_EQ(Download(mapping, i, 0x607A0020, 4), 0u);
    EXPECT_EQ(Download(mapping, 0, 3, 1), 0x06040042u) << "96 bits";
    EXPECT_EQ(Upload(mapping, 0), 0u);
    EXPECT_EQ(Download(mapping, 0, 2, 1), 0u);
  }
}

TEST_F(Canopen, CobIdsAreChecked) {
  const auto restricted = [](uint32_t id) {
    return id <= 0x7F || (id >= 0x101 && id <= 0x180) || (id >= 0x581 && id <= 0x5FF) ||
           (id >= 0x601 && id <= 0x67F) || (id >= 0x6E0 && id <= 0x6FF) || id >= 0x701;
  };
  for (uint16_t index : {0x1400, 0x1800}) {
    const uint32_t rtr = index == 0x1800 ? 0x40000000 : 0;
    for (uint32_t id = 0; id < 0x800; ++id) {
      ASSERT_EQ(Download(index, 1, 0x80000000u | id, 4), 0u);
      ASSERT_EQ(Download(index, 1, rtr | id, 4), restricted(id) ? 0x06090030u : 0u)
          << std::hex << id;
    }
    ASSERT_EQ(Download(index, 1, 0x80000205u, 4), 0u);
    EXPECT_EQ(Download(index, 1, 0x20000205u, 4), 0x06090030u) << "29 bits";
    EXPECT_EQ(Download(index, 1, 0x00001205u, 4), 0x06090030u);
  }
  EXPECT_EQ(Download(0x1005, 0, 0x40000080, 4), 0x06090030u) << "it does not produce SYNC";
  EXPECT_EQ(Download(0x1005, 0, 0x601, 4), 0x06090030u);
  EXPECT_EQ(Download(0x1005, 0, 0x100, 4), 0u);
  Send(0x80, {});
  EXPECT_EQ(Read(AXIS_OBJ_SYNC_COUNT), 0);
  Send(0x100, {});
  EXPECT_EQ(Read(AXIS_OBJ_SYNC_COUNT), 1);
  EXPECT_EQ(Download(0x1014, 0, 0x90, 4), 0x08000022u);
  EXPECT_EQ(Download(0x1014, 0, 0x80000090, 4), 0u);
  EXPECT_EQ(Download(0x1014, 0, 0x90, 4), 0u);
}

TEST_F(Canopen, PdoLengthErrorsAreToldOnce) {
  Start();
  for (int i = 0; i < 5; ++i) Send(0x305, {0, 0, 1, 0, 0});
  Tick();
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 0);
  EXPECT_EQ(Take(0x85), std::vector<Frame>{Emergency(0x8210, 0x11, 2)});
  Send(0x305, {0, 0, 1, 0, 0, 0});
  Send(0x305, {0, 0});
  Tick();
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 1);
  EXPECT_EQ(Take(0x85), std::vector<Frame>{Emergency(0x8210, 0x11, 2)});
  Send(0x305, {0, 0, 2, 0, 0, 0, 9, 9});
  Tick();
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 2) << "the first bytes";
  EXPECT_EQ(Take(0x85), std::vector<Frame>{Emergency(0x8220, 0x11, 2)});
  EXPECT_EQ(Read(AXIS_OBJ_ERROR_REGISTER), 0) << "it does not last";
}

TEST_F(Canopen, ARefusedValueIsToldAndTheOthersAreTaken) {
  Start();
  Remap(0x1403, 0x1603, 0x505, {0x60FF0020, 0x60710010}, 255);
  for (int i = 0; i < 3; ++i) Send(0x505, {0xFF, 0xFF, 0xFF, 0x7F, 7, 0});
  Tick();
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_VELOCITY), 0);
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_FORCE), 7);
  EXPECT_EQ(Take(0x85), std::vector<Frame>{Emergency(0x6320, 0x01, 4)});
  EXPECT_EQ(Read(AXIS_OBJ_NMT_STATE), 5);
  // While another source owns the axis it is silence, not an error.
  ASSERT_EQ(Download(0x2301, 0, 2, 1, 0x660), 0u);
  Send(0x505, {0, 0, 0, 0, 0, 0});
  Tick();
  EXPECT_TRUE(Take(0x85).empty());
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_FORCE), 7);
}

TEST_F(Canopen, AnRpdoThatStaysAwayFromAnActiveAxisIsAFault) {
  ASSERT_EQ(Download(0x1800, 1, 0xC0000185, 4), 0u);
  ASSERT_EQ(Download(0x1401, 5, 100, 2), 0u);  // 150 ticks
  ASSERT_EQ(Download(0x6007, 0, 0, 2), 0u);    // the drive does nothing about it
  Start();
  Send(0x305, {0, 0, 1, 0, 0, 0});
  NodeTick(1000);
  EXPECT_EQ(Take(0x85), std::vector<Frame>{}) << "nobody is hurt by a disabled axis";
  fw_.axis.signals.active_mode = AXIS_MODE_POSITION;
  NodeTick(150);
  EXPECT_TRUE(Take(0x85).empty()) << "counted from the start of the mode";
  NodeTick(1);
  EXPECT_EQ(Take(0x85), std::vector<Frame>{Emergency(0x8250, 0x11, 2)});
  EXPECT_EQ(Read(AXIS_OBJ_ERROR_REGISTER), 0x11);
  Send(0x305, {0, 0, 1, 0, 0, 0});
  NodeTick(150);
  EXPECT_EQ(Take(0x85), std::vector<Frame>{Emergency(0, 0, 0)});
  Send(0x305, {0, 0, 1, 0, 0, 0});
  NodeTick(150);
  EXPECT_TRUE(Take(0x85).empty());
}

// --- SYNC, EMCY, bus -----------------------------------------------------------------------------

TEST_F(Canopen, ASyncWithDataIsToldAndIgnored) {
  Start();
  for (int i = 0; i < 3; ++i) Send(0x80, {1});
  EXPECT_TRUE(Take().empty());
  Tick();
  EXPECT_EQ(Take(0x85), std::vector<Frame>{Emergency(0x8240, 0x11, 1)});
  EXPECT_EQ(Read(AXIS_OBJ_SYNC_COUNT), 0);
}

TEST_F(Canopen, FaultsComeAndGo) {
  Take();
  ShowFault(0x8611, AXIS_FAULT_FOLLOWING_ERROR);
  NodeTick(1);
  EXPECT_EQ(Take(), std::vector<Frame>{Emergency(0x8611, 0x21, AXIS_FAULT_FOLLOWING_ERROR)});
  EXPECT_EQ(Upload(0x1001, 0), 0x21u);
  NodeTick(10);
  EXPECT_TRUE(Take().empty());
  ShowFault(0, 0);
  NodeTick(1);
  EXPECT_EQ(Take(), std::vector<Frame>{Emergency(0, 0, 0)});
  EXPECT_EQ(Upload(0x1001, 0), 0u);
  EXPECT_EQ(Upload(0x1003, 0), 1u) << "a reset is no entry";
  EXPECT_EQ(Upload(0x1003, 1), 0x8611u + 0x10000u * AXIS_FAULT_FOLLOWING_ERROR);
}

TEST_F(Canopen, TheHistoryKeepsTheLatestEight) {
  for (uint16_t i = 1; i <= 10; ++i) {
    canopen_emergency(&fw_.canopen, static_cast<uint16_t>(0xFF00 + i), 0);
    Tick();
  }
  EXPECT_EQ(Upload(0x1003, 0), 8u);
  for (uint8_t i = 1; i <= 8; ++i) EXPECT_EQ(Upload(0x1003, i), 0xFF0Bu - i);
  EXPECT_EQ(Download(0x1003, 0, 1, 1), 0x06090031u);
  EXPECT_EQ(Download(0x1003, 1, 0, 4), 0x06010002u);
  EXPECT_EQ(Download(0x1003, 0, 0, 1), 0u);
  EXPECT_EQ(Upload(0x1003, 0), 0u);
  EXPECT_EQ(Upload(0x1003, 1), 0u);
}

TEST_F(Canopen, EmergenciesKeepTheirInhibitTime) {
  ASSERT_EQ(Download(0x1015, 0, 100, 2), 0u);  // 10 ms, 15 ticks
  Take();
  for (uint16_t i = 1; i <= 6; ++i) canopen_emergency(&fw_.canopen, 0xFF00 + i, 0);
  std::vector<std::array<int, 2>> sent;
  for (int i = 0; i < 100; ++i) {
    NodeTick(1);
    for (const Frame &frame : Take(0x85)) sent.push_back({i, frame.data[0]});
  }
  // The queue holds four; the oldest fall out, so that the last one told is what is.
  EXPECT_EQ(sent, (std::vector<std::array<int, 2>>{{0, 3}, {15, 4}, {30, 5}, {45, 6}}));
}

TEST_F(Canopen, EmcyCanBeSwitchedOff) {
  ASSERT_EQ(Download(0x1014, 0, 0x80000085, 4), 0u);
  canopen_emergency(&fw_.canopen, 0xFF04, 0);
  Tick();
  EXPECT_TRUE(Take(0x85).empty());
  EXPECT_EQ(Upload(0x1003, 0), 1u) << "the history goes on";
}

TEST_F(Canopen, AFloodOfRequestsLeavesRoomAndIsCounted) {
  Start();
  for (int i = 0; i < 20; ++i) Send(0x605, Request(0x40, 0x1000, 0));
  Tick(500);
  const auto frames = Take();
  EXPECT_EQ(frames.size(), 15u) << "PDOs leave two places, of which the heartbeat took one";
  EXPECT_EQ(std::ranges::count_if(frames, [](const Frame &f) { return f.id == 0x585; }), 10);
  EXPECT_EQ(std::ranges::count(frames, Emergency(0x8110, 0x11, 0)), 1);
  EXPECT_GE(std::ranges::count_if(frames, [](const Frame &f) { return f.id == 0x705; }), 1);
  EXPECT_GE(Read(AXIS_OBJ_CAN_LOST), 10);
  EXPECT_EQ(Upload(0x1003, 0), 1u) << "told once until all went out";
}

TEST_F(Canopen, LostInputIsCountedAndTold) {
  Take();
  fw_can_lost(&fw_, 3);
  fw_can_lost(&fw_, 4);
  Tick();
  EXPECT_EQ(Take(), std::vector<Frame>{Emergency(0x8110, 0x11, 0)});
  EXPECT_EQ(Read(AXIS_OBJ_CAN_LOST), 7);
  fw_can_lost(&fw_, 65535);
  EXPECT_EQ(Read(AXIS_OBJ_CAN_LOST), 65535);
}

TEST_F(Canopen, BusStatesAreTold) {
  Take();
  fw_can_bus(&fw_, CAN_BUS_PASSIVE);
  NodeTick(1);
  EXPECT_EQ(Take(), std::vector<Frame>{Emergency(0x8120, 0x11, 0)});
  fw_can_bus(&fw_, CAN_BUS_ACTIVE);
  NodeTick(1);
  EXPECT_EQ(Take(), std::vector<Frame>{Emergency(0, 0, 0)});
  Nmt(1);
  canopen_emergency(&fw_.canopen, 0xFF04, 0);
  fw_can_bus(&fw_, CAN_BUS_OFF);
  EXPECT_EQ(Read(AXIS_OBJ_NMT_STATE), 127);
  NodeTick(400);
  EXPECT_TRUE(Take().empty()) << "off is off";
  EXPECT_EQ(Read(AXIS_OBJ_CAN_LOST), 0);
  fw_can_bus(&fw_, CAN_BUS_ACTIVE);
  NodeTick(1);
  EXPECT_EQ(Take(), (std::vector<Frame>{Emergency(0xFF04, 0x81, 0), Emergency(0x8140, 0x11, 0),
                                        Emergency(0, 0, 0)}));
}

TEST_F(Canopen, AResetKeepsWhatThePortToldOfTheBus) {
  fw_can_bus(&fw_, CAN_BUS_PASSIVE);
  Tick();
  Nmt(130);
  Tick();
  Take();
  Tick();
  EXPECT_EQ(Take(), std::vector<Frame>{Emergency(0x8120, 0x11, 0)});
}

TEST_F(Canopen, AResetRestoresCommunicationAndOnlyANodesResetTheRest) {
  ASSERT_EQ(Download(0x1017, 0, 1000, 2), 0u);
  ASSERT_EQ(Download(0x200A, 0, 77, 2), 0u);
  Remap(0x1401, 0x1601, 0x205 + 0x20, {0x60FF0020}, 255);
  Nmt(130);
  EXPECT_TRUE(Ask(Request(0x40, 0x1000, 0)).empty()) << "initialising until the end of the tick";
  Tick();
  EXPECT_EQ(Upload(0x1017, 0), 200u);
  EXPECT_EQ(Upload(0x1401, 1), 0x305u);
  EXPECT_EQ(Upload(0x1601, 0), 2u);
  EXPECT_EQ(Upload(0x200A, 0), 77u);
  Nmt(129);
  Tick();
  EXPECT_EQ(Upload(0x200A, 0), 0u);
}

TEST_F(Canopen, AnAxisWithoutBusesIsSilent) {
  fw_config_t config{};
  fw_init(&fw_, &config);
  Nmt(1, 0);
  Send(0x601, Request(0x40, 0x1000, 0));
  Tick(1000);
  EXPECT_TRUE(Take().empty());
}

}  // namespace
