#ifndef TESTS_UNIT_PRESS_FIXTURE_HPP_
#define TESTS_UNIT_PRESS_FIXTURE_HPP_

#include <gtest/gtest.h>

#include <cstdint>
#include <map>
#include <vector>

#include "tests/firmware/unit/cycle_records.hpp"
#include "tests/firmware/unit/store_fixture.hpp"
#include "tests/support/poisoned.hpp"

using Kept = std::map<uint32_t, Bytes>;

// An axis with a store and a memory for programs.
class Press {
 public:
  explicit Press(const store_memory_t *memory) {
    config_.memory = memory;
    config_.node_id = 1;
    config_.buses = 1;
    config_.program_memory = programs_.data();
    config_.program_bytes = static_cast<uint32_t>(4 * programs_.size());
    config_.result_memory = results_.data();
    config_.result_bytes = static_cast<uint32_t>(sizeof(cycle_part_t) * results_.size());
    fw_init(&fw_, &config_);
  }

  int32_t Read(uint16_t object) const {
    int32_t value = 0;
    EXPECT_EQ(fw_object_read(&fw_, object, &value), FW_OK) << object;
    return value;
  }
  int Write(uint16_t object, int32_t value) {
    return fw_object_write(&fw_, FW_SOURCE_LOCAL, object, value);
  }

  int Download(const Bytes &record) {
    cycle_library_begin(&fw_.library);
    EXPECT_TRUE(
        cycle_library_append(&fw_.library, 0, record.data(), static_cast<uint32_t>(record.size())));
    return Write(AXIS_OBJ_CYCLE_DATA_END, static_cast<int32_t>(record.size()));
  }

  void Tick(int ticks = 1) {
    const axis_inputs_t inputs{0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
    for (int i = 0; i < ticks; ++i) {
      axis_outputs_t outputs;
      fw_tick(&fw_, &inputs, &outputs);
    }
  }

  // Ticks until programs, counts and parameters are stored.
  void Settle() {
    int ticks = 0;
    do {
      Tick();
    } while (++ticks < 4000 &&
             (Read(AXIS_OBJ_STORE_STATE) == AXIS_STORE_STATE_SAVING ||
              Read(AXIS_OBJ_CYCLE_STORE_STATE) == AXIS_CYCLE_STORE_STATE_WAITING));
    EXPECT_LT(ticks, 4000);
  }

  Kept Programs() const {
    Kept programs;
    for (uint8_t i = 0; i < fw_.library.count; ++i) {
      const cycle_header_t *program = cycle_library_at(&fw_.library, i);
      const auto *bytes = reinterpret_cast<const uint8_t *>(program);
      programs[program->number] = {bytes, bytes + program->size};
    }
    return programs;
  }

  // Whether the store lets a cycle start.
  bool MayStart() const {
    return fw_.library.count != 0 && fw_.drive.cycle_lock == AXIS_CYCLE_STATE_IDLE;
  }

  fw_t &fw() { return fw_; }

 private:
  std::vector<uint32_t> programs_ = std::vector<uint32_t>(FW_PROGRAM_BYTES / 4);
  std::vector<cycle_part_t> results_ = std::vector<cycle_part_t>(FW_RESULTS);
  fw_config_t config_{};
  fw_t fw_ = poisoned<fw_t>();
};

#endif
