// A reset of the node against a node that was never used.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <random>
#include <vector>

#include "tests/firmware/unit/bus_fixture.hpp"
#include "tests/support/poisoned.hpp"

namespace {

// One firmware on both buses, driven by random numbers.
class Node {
 public:
  Node() {
    fw_config_t config{};
    config.recorder_buffer = buffer_.data();
    config.recorder_bytes = static_cast<uint32_t>(buffer_.size());
    config.node_id = kNode;
    config.buses = 1;
    fw_init(&fw_, &config);
  }

  void Send(uint16_t id, const Bytes &data) {
    can_frame_t frame{};
    frame.id = id;
    frame.length = static_cast<uint8_t>(data.size());
    std::copy(data.begin(), data.end(), frame.data);
    fw_can_receive(&fw_, &frame);
  }

  // A random write, frame or measurement, then a tick.
  void Live(std::mt19937 &random) {
    const auto below = [&](uint32_t bound) { return static_cast<uint32_t>(random() % bound); };
    const int controlwords[] = {0x06, 0x07, 0x0F, 0x0F, 0x1F, 0x3F, 0x10F, 0x02, 0x80, 0x00};
    for (uint32_t i = below(3); i > 0; --i) {
      switch (below(10)) {
        case 0:
        case 1:
        case 2:
          (void)Write(AXIS_OBJ_CONTROLWORD, controlwords[below(10)]);
          break;
        case 3:
          (void)Write(AXIS_OBJ_MODES_OF_OPERATION, static_cast<int32_t>(below(19)) - 8);
          break;
        case 4:
        case 5:
          WriteAny(random);
          break;
        case 6:
          Send(0, {static_cast<uint8_t>(below(2) != 0 ? 1 : 128), kNode});
          break;
        case 7:
          Send(static_cast<uint16_t>(0x205 + 0x100 * below(4)), Bytes(1 + below(8), below(256)));
          break;
        case 8:
          Send(0x80, {});
          break;
        default:
          Send(0x605, {static_cast<uint8_t>(0x40 + 0x20 * below(2)), 0x08, 0x10, 0, 0, 0, 0, 0});
          break;
      }
    }
    if (below(20) == 0) {
      const uint8_t bytes[3] = {kNode, 3, static_cast<uint8_t>(below(256))};
      fw_modbus_receive(&fw_, bytes, static_cast<uint16_t>(below(4)));
    }
    if (below(30) == 0) fw_overrun(&fw_, 0);
    inputs_.encoder_cnt += static_cast<int32_t>(below(41)) - 20;
    inputs_.adc_code[0] = static_cast<uint16_t>(below(20) != 0 ? 30 * below(2) : 255);
    inputs_.sensor_valid = below(200) != 0;
    Tick();
  }

  void Disable() {
    EXPECT_EQ(Write(AXIS_OBJ_MODE, AXIS_MODE_DISABLED), FW_OK);
    Idle();
  }

  void Idle() {
    inputs_ = {1000, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
    Tick();
  }

  void Tick() {
    fw_tick(&fw_, &inputs_, &outputs_);
    sent_.clear();
    for (can_frame_t f{}; fw_can_transmit(&fw_, &f);) {
      sent_.push_back({f.id, {f.data, f.data + f.length}});
    }
    uint8_t bytes[300];
    sent_.push_back({0, {bytes, bytes + fw_modbus_transmit(&fw_, bytes, sizeof(bytes))}});
  }

  int Write(uint16_t object, int32_t value) {
    return fw_object_write(&fw_, FW_SOURCE_LOCAL, object, value);
  }

  int32_t Read(uint16_t object) const {
    int32_t value = 0;
    const int result = fw_object_read(&fw_, object, &value);
    return result == FW_OK ? value : result;
  }

  const std::vector<Frame> &sent() const { return sent_; }

  std::array<int, 3> outputs() const {
    return {outputs_.dac_code, outputs_.amp_enable, outputs_.brake_release};
  }

 private:
  void WriteAny(std::mt19937 &random) {
    const auto object = static_cast<uint16_t>(random() % AXIS_OBJ_COUNT);
    const axis_object_t &entry = axis_objects[object];
    const int64_t span = entry.type == AXIS_TYPE_U32 ? int64_t{static_cast<uint32_t>(entry.max)}
                                                     : int64_t{entry.max} - entry.min;
    const int64_t value = entry.min + static_cast<int64_t>(random() % (span + 1));
    const int32_t values[] = {entry.min, entry.max, entry.initial,
                              fx_s32_from_u32(static_cast<uint32_t>(value))};
    (void)Write(object, values[random() % 4]);
  }

  std::array<uint8_t, 600> buffer_{};
  fw_t fw_ = poisoned<fw_t>();
  axis_inputs_t inputs_{1000, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
  axis_outputs_t outputs_{};
  std::vector<Frame> sent_;
};

// Largest number of ticks in which a brake engages.
const int kBrakeTicks = axis_objects[AXIS_OBJ_BRAKE_ENGAGE_TICKS].max + 1;

// Counters of losses keep their values over a reset.
bool GoesOn(uint16_t object) { return object == AXIS_OBJ_OVERRUNS || object == AXIS_OBJ_CAN_LOST; }

// An NMT reset of the node restores all power-up values: a node used before its reset and a fresh
// one behave the same from then on, object by object and frame by frame.
TEST(FwReset, ANodeThatWasResetIsAsOneThatWasNeverUsed) {
  int frames = 0;
  for (uint32_t seed = 1; seed <= 60; ++seed) {
    const auto used = std::make_unique<Node>(), unused = std::make_unique<Node>();
    std::mt19937 random(seed);
    for (int tick = 0; tick < 400; ++tick) {
      used->Live(random);
      unused->Idle();
    }
    for (Node *node : {used.get(), unused.get()}) {
      node->Disable();  // an active axis would be reset later, when its brake holds
      for (int tick = 0; tick < kBrakeTicks; ++tick) node->Idle();
      node->Send(0, {129, kNode});
      for (int tick = 0; tick < 3; ++tick) node->Idle();
    }
    std::mt19937 again(1000 + seed), same(1000 + seed);
    for (int tick = 0; tick < 400; ++tick) {
      for (uint16_t object = 0; object < AXIS_OBJ_COUNT; ++object) {
        if (GoesOn(object)) continue;
        ASSERT_EQ(used->Read(object), unused->Read(object))
            << "object " << object << ", seed " << seed << ", tick " << tick;
      }
      used->Live(again);
      unused->Live(same);
      ASSERT_EQ(used->outputs(), unused->outputs()) << "seed " << seed << ", tick " << tick;
      ASSERT_EQ(used->sent(), unused->sent()) << "seed " << seed << ", tick " << tick;
      frames += static_cast<int>(used->sent().size()) - 1;
    }
  }
  EXPECT_GT(frames, 5000);
}

// Also of the origin that homing set.
TEST(FwReset, TheOriginOfHomingIsThatOfPowerUp) {
  Node node;
  node.Idle();
  const auto write = [&](uint16_t object, int32_t value) {
    ASSERT_EQ(node.Write(object, value), FW_OK);
    node.Idle();
  };
  write(AXIS_OBJ_HOMING_METHOD, 35);
  write(AXIS_OBJ_HOME_OFFSET, 70);
  write(AXIS_OBJ_MODES_OF_OPERATION, AXIS_MODES_OF_OPERATION_HOMING);
  for (const int controlword : {0x06, 0x0F, 0x1F}) write(AXIS_OBJ_CONTROLWORD, controlword);
  for (int tick = 0; tick < 5; ++tick) node.Idle();
  ASSERT_EQ(node.Read(AXIS_OBJ_POSITION_ACTUAL), 70);
  node.Disable();
  node.Send(0, {129, kNode});
  for (int tick = 0; tick < 3; ++tick) node.Idle();
  EXPECT_EQ(node.Read(AXIS_OBJ_POSITION_ACTUAL), 1000) << "the encoder's count";
}

}  // namespace
