#ifndef TESTS_UNIT_AXIS_FIXTURE_HPP_
#define TESTS_UNIT_AXIS_FIXTURE_HPP_

#include <gtest/gtest.h>

#include <array>
#include <cstdint>

#include "firmware/port/host/firmware.hpp"

// One axis with good inputs: enable chain closed, sensors valid, everything 0.
class AxisFixture : public ::testing::Test {
 protected:
  AxisFixture() { PowerUp(); }

  void PowerUp() { PowerUp(buffer_.data(), static_cast<uint32_t>(buffer_.size())); }
  void PowerUp(void *recorder_buffer, uint32_t recorder_bytes) {
    fw_config_t config{};
    config.recorder_buffer = recorder_buffer;
    config.recorder_bytes = recorder_bytes;
    fw_init(&fw_, &config);
  }

  int Write(uint16_t object, int32_t value) {
    return fw_object_write(&fw_, FW_SOURCE_LOCAL, object, value);
  }

  // How the recorder is told of an object: index times 256 plus sub-index.
  static int32_t Address(uint16_t object) {
    for (const axis_address_t &a : axis_addresses) {
      if (a.what == AXIS_ADDRESS_OBJECT && a.value == object) return a.index * 256 + a.sub;
    }
    return 0xFFFFFF;  // none
  }

  void Set(uint16_t object, int32_t value) {
    ASSERT_EQ(Write(object, value), FW_OK) << "object " << object << " value " << value;
  }

  int32_t Read(uint16_t object) const {
    int32_t value = 0;
    EXPECT_EQ(fw_object_read(&fw_, object, &value), FW_OK) << "object " << object;
    return value;
  }

  // The code put out.
  int Tick() {
    fw_tick(&fw_, &inputs_, &outputs_);
    return outputs_.dac_code;
  }

  int TickForce(uint16_t adc_code) {
    inputs_.adc_code[0] = adc_code;
    return Tick();
  }

  int TickPosition(int32_t encoder_cnt) {
    inputs_.encoder_cnt = encoder_cnt;
    return Tick();
  }

  // Force mode without bias, k_f = 5 and f_d = 30 counts (Fig 3.14), ticked once at 30 counts.
  void StartForce() {
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    Set(AXIS_OBJ_FORCE_GAIN, 5 * 256);
    Set(AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
    Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
    ASSERT_EQ(TickForce(30), 0);
    ASSERT_EQ(outputs_.amp_enable, 1);
  }

  void ExpectOff(int fault) {
    EXPECT_EQ(outputs_.dac_code, 0);
    EXPECT_EQ(outputs_.amp_enable, 0);
    EXPECT_EQ(outputs_.brake_release, 0);
    EXPECT_EQ(Read(AXIS_OBJ_FAULT), fault);
    EXPECT_EQ(Read(AXIS_OBJ_ACTIVE_MODE), AXIS_MODE_DISABLED);
    EXPECT_EQ(Read(AXIS_OBJ_MODE), AXIS_MODE_DISABLED);
  }

  std::array<uint8_t, FW_RECORDER_BYTES> buffer_{};
  fw_t fw_{};
  axis_inputs_t inputs_{0, {0, 0}, AXIS_DIN_ENABLE, 1};
  axis_outputs_t outputs_{};
};

#endif
