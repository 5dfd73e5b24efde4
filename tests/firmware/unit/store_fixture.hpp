#ifndef TESTS_UNIT_STORE_FIXTURE_HPP_
#define TESTS_UNIT_STORE_FIXTURE_HPP_

#include <gtest/gtest.h>

#include <cstdint>
#include <random>
#include <string_view>
#include <vector>

#include "firmware/port/host/firmware.hpp"
#include "tests/firmware/unit/flash.hpp"
#include "tests/support/poisoned.hpp"

using Values = std::vector<int32_t>;

// Which of the places of a fault are tried: each in the release build; the sanitizers, with which
// all take minutes, look for other errors.
#ifdef __SANITIZE_ADDRESS__
inline constexpr int kEvery = 7;
#else
inline constexpr int kEvery = 1;
#endif

// Where the second set of a sector begins.
inline constexpr uint32_t kSetSpace = (STORE_SET_BYTES + 15) / 16 * 16;

// Records by hand, as record.h and store.h describe them: each returns where the next one goes.
struct Entry {
  uint32_t first;  // index times 256 plus sub-index; bit 24: at its default
  uint32_t value;
  uint32_t signature;
};

inline size_t PutRecord(Bytes &bytes, size_t at, const std::vector<uint32_t> &head,
                        const std::vector<uint32_t> &entries) {
  size_t next = at;
  for (const auto &words : {head, {static_cast<uint32_t>(4 * entries.size())}, entries}) {
    for (const uint32_t word : words) {
      PutWord(bytes, next, word);
      next += 4;
    }
  }
  PutWord(bytes, next, Crc32(&bytes[at], next - at));
  return next + 4;
}

// "FAS2"
inline size_t PutSet(Bytes &bytes, size_t at, uint32_t hash, uint32_t sequence,
                     const std::vector<Entry> &entries) {
  std::vector<uint32_t> words;
  for (const Entry &entry : entries) {
    words.insert(words.end(), {entry.first, entry.value, entry.signature});
  }
  return PutRecord(bytes, at, {0x32534146, hash, sequence}, words);
}

// "FAS1", of version 0.1.0: pairs of address and value
inline size_t PutOldSet(Bytes &bytes, size_t at, uint32_t hash, uint32_t sequence,
                        const std::vector<uint32_t> &words) {
  return PutRecord(bytes, at, {0x31534146, hash, sequence}, words);
}

inline uint32_t SignatureOf(std::string_view text) {
  return Crc32(reinterpret_cast<const uint8_t *>(text.data()), text.size());
}

inline Entry EntryOf(uint16_t object, uint32_t value) {
  for (const axis_address_t &a : axis_addresses) {
    if (a.what == AXIS_ADDRESS_OBJECT && a.value == object) {
      const auto first = static_cast<uint32_t>(a.index) << 8 | a.sub;
      return {first, value, axis_objects[object].signature};
    }
  }
  return {};
}

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

  // What the store reports of the loaded set.
  std::vector<uint32_t> Changes() const {
    std::vector<uint32_t> changes;
    for (uint16_t i = AXIS_OBJ_STORE_CHANGE_1; i <= AXIS_OBJ_STORE_CHANGE_8; ++i) {
      if (Read(i) != 0) changes.push_back(static_cast<uint32_t>(Read(i)));
    }
    return changes;
  }

  void Tick() {
    const axis_inputs_t inputs{0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
    axis_outputs_t outputs;
    fw_tick(&fw_, &inputs, &outputs);
    EXPECT_EQ(outputs.amp_enable, 0);
    EXPECT_EQ(outputs.dac_code, 0);
  }

  // Ticks until the store is idle; returns their number.
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

  // All stored parameters, in the order of the table; but first_motion_test as 0, since it is on
  // wherever the set in force is not the newest one (a test of its own).
  Values Stored() const {
    Values values;
    for (uint16_t i = 1; i < AXIS_OBJ_COUNT; ++i) {
      const bool is_test = i == AXIS_OBJ_FIRST_MOTION_TEST;
      if (axis_objects[i].stored != 0) values.push_back(is_test ? 0 : Read(i));
    }
    return values;
  }

  // Sets some of the stored parameters to other values.
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
  fw_t fw_ = poisoned<fw_t>();
};

#endif
