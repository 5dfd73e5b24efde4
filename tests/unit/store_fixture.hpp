#ifndef TESTS_UNIT_STORE_FIXTURE_HPP_
#define TESTS_UNIT_STORE_FIXTURE_HPP_

#include <gtest/gtest.h>

#include <cstdint>
#include <random>
#include <vector>

#include "firmware/port/host/firmware.hpp"
#include "tests/unit/flash.hpp"

using Values = std::vector<int32_t>;

// An axis with its parameters in a memory.
class Axis {
 public:
  explicit Axis(const store_memory_t *memory, uint8_t node_id = 1) {
    config_.memory = memory;
    config_.node_id = node_id;
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
  int32_t State() const { return Read(AXIS_OBJ_STORE_STATE); }

  void Tick() {
    const axis_inputs_t inputs{0, {0, 0}, AXIS_DIN_ENABLE, 1};
    axis_outputs_t outputs;
    fw_tick(&fw_, &inputs, &outputs);
    EXPECT_EQ(outputs.amp_enable, 0);
    EXPECT_EQ(outputs.dac_code, 0);
  }

  // Until the store is at rest; how many ticks that took.
  int Run() {
    int ticks = 0;
    while (State() == AXIS_STORE_STATE_SAVING && ticks < 2000) {
      Tick();
      ++ticks;
    }
    EXPECT_LT(ticks, 2000);
    return ticks;
  }

  int Save(int32_t expected = AXIS_STORE_STATE_SAVED) {
    EXPECT_EQ(Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
    EXPECT_EQ(State(), AXIS_STORE_STATE_SAVING);
    const int ticks = Run();
    EXPECT_EQ(State(), expected);
    return ticks;
  }

  // Everything that is kept, in the order of the table.
  Values Stored() const {
    Values values;
    for (uint16_t i = 1; i < AXIS_OBJ_COUNT; ++i) {
      if (axis_objects[i].stored != 0) values.push_back(Read(i));
    }
    return values;
  }

  // Gives some of the stored parameters other values.
  void Change(uint32_t seed, int percent) {
    std::minstd_rand random(seed * 7919 + 1);
    for (uint16_t i = 1; i < AXIS_OBJ_COUNT; ++i) {
      const axis_object_t &entry = axis_objects[i];
      if (entry.stored == 0 || static_cast<int>(random() % 100) >= percent) continue;
      const bool u32 = entry.type == AXIS_TYPE_U32;
      const int64_t low = u32 ? int64_t{static_cast<uint32_t>(entry.min)} : int64_t{entry.min};
      const int64_t high = u32 ? int64_t{static_cast<uint32_t>(entry.max)} : int64_t{entry.max};
      const int64_t value = low + static_cast<int64_t>(random()) % (high - low + 1);
      Write(i, static_cast<int32_t>(static_cast<uint32_t>(value)));  // may be refused
    }
    Write(AXIS_OBJ_SPEED_MAX, static_cast<int32_t>(seed));
  }

  fw_t &fw() { return fw_; }

 private:
  fw_config_t config_{};
  fw_t fw_{};
};

#endif
