#ifndef TESTS_UNIT_FIRMWARE_FIXTURE_HPP_
#define TESTS_UNIT_FIRMWARE_FIXTURE_HPP_

#include <gtest/gtest.h>

#include <array>
#include <cstdint>

#include "firmware/port/host/firmware.hpp"
#include "tests/support/poisoned.hpp"

// A firmware with inputs that permit operation: enable chain closed, sensors valid, everything else
// 0. A derived fixture powers it up.
class FirmwareFixture : public ::testing::Test {
 protected:
  static const axis_address_t *AddressOf(uint16_t object) {
    for (const axis_address_t &a : axis_addresses) {
      if (a.what == AXIS_ADDRESS_OBJECT && a.value == object) return &a;
    }
    return nullptr;
  }

  int Write(uint16_t object, int32_t value) {
    return fw_object_write(&fw_, FW_SOURCE_LOCAL, object, value);
  }

  void Set(uint16_t object, int32_t value) {
    ASSERT_EQ(Write(object, value), FW_OK) << "object " << object << " value " << value;
  }

  int32_t Read(uint16_t object) const {
    int32_t value = 0;
    EXPECT_EQ(fw_object_read(&fw_, object, &value), FW_OK) << "object " << object;
    return value;
  }

  void Tick(int ticks = 1) {
    for (int i = 0; i < ticks; ++i) {
      fw_tick(&fw_, &inputs_, &outputs_);
      // dac_fine is a multiple of the step of the output, and dac_code the nearest whole code.
      const int fine = outputs_.dac_fine;
      ASSERT_EQ(fine % (1 << (16 - fw_.axis.params.dac_bits)), 0);
      ASSERT_LE(16 * outputs_.dac_code - 8, fine);
      ASSERT_LT(fine, 16 * outputs_.dac_code + 8);
    }
  }

  std::array<uint8_t, FW_RECORDER_BYTES> buffer_{};
  fw_t fw_ = poisoned<fw_t>();
  axis_inputs_t inputs_{0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
  axis_outputs_t outputs_{};
};

#endif
