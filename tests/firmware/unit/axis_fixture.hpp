#ifndef TESTS_UNIT_AXIS_FIXTURE_HPP_
#define TESTS_UNIT_AXIS_FIXTURE_HPP_

#include <gtest/gtest.h>

#include <cstdint>

#include "tests/firmware/unit/firmware_fixture.hpp"

// One axis on no bus.
class AxisFixture : public FirmwareFixture {
 protected:
  AxisFixture() { PowerUp(); }

  void PowerUp() { PowerUp(buffer_.data(), static_cast<uint32_t>(buffer_.size())); }
  void PowerUp(void *recorder_buffer, uint32_t recorder_bytes) {
    fw_config_t config{};
    config.recorder_buffer = recorder_buffer;
    config.recorder_bytes = recorder_bytes;
    fw_init(&fw_, &config);
  }

  // An object as a parameter of the recorder: index times 256 plus sub-index.
  static int32_t Address(uint16_t object) {
    const axis_address_t *a = AddressOf(object);
    return a == nullptr ? 0xFFFFFF : a->index * 256 + a->sub;
  }

  // One tick; returns the output code.
  int Tick() {
    FirmwareFixture::Tick();
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
    EXPECT_EQ(outputs_.dac_fine, 0);
    EXPECT_EQ(outputs_.amp_enable, 0);
    EXPECT_EQ(outputs_.brake_release, 0);
    EXPECT_EQ(Read(AXIS_OBJ_FAULT), fault);
    EXPECT_EQ(Read(AXIS_OBJ_ACTIVE_MODE), AXIS_MODE_DISABLED);
    EXPECT_EQ(Read(AXIS_OBJ_MODE), AXIS_MODE_DISABLED);
  }
};

#endif
