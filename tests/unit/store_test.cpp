// The parameter store on a memory that can be cut off after every byte, torn, partly erased or
// worn.

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "firmware/port/host/firmware.hpp"
#include "firmware/port/host/store_file.h"

namespace {

constexpr int kErased = 0xFF;

// Flash: programming clears bits of blank bytes, erasing sets those of a sector. Each byte is one
// step, an erase kEraseSteps; after `life` steps the power is gone in the middle of the next one.
class Flash {
 public:
  static constexpr int kEraseSteps = 8;

  explicit Flash(uint32_t sector_bytes = STORE_SECTOR_MIN)
      : bytes_(2 * sector_bytes, kErased),
        memory_{this, sector_bytes, &Flash::Read, &Flash::Program, &Flash::Erase} {}

  const store_memory_t *memory() const { return &memory_; }
  std::vector<uint8_t> &bytes() { return bytes_; }

  // Power for so many steps, with the bits of a torn step by `seed`; -1: for ever.
  void PowerFor(int64_t life, uint32_t seed) {
    life_ = life;
    random_.seed(seed);
  }
  int64_t steps() const { return steps_; }
  int erases() const { return erases_; }
  bool misused() const { return misused_; }
  int most_per_call() const { return most_per_call_; }

  // A worn memory: programming fails where a byte at or behind an address is touched.
  uint32_t worn_from = UINT32_MAX;
  uint32_t worn_to = UINT32_MAX;
  bool worn_says_so = true;  // false: the bytes are just not as wanted
  bool erase_works = true;

 private:
  static Flash &Of(void *context) { return *static_cast<Flash *>(context); }

  static void Read(void *context, uint32_t address, uint8_t *to, uint32_t count) {
    Flash &f = Of(context);
    f.misused_ |= address + count > f.bytes_.size();
    std::copy_n(f.bytes_.begin() + address, count, to);
  }

  static bool Program(void *context, uint32_t address, const uint8_t *from, uint32_t count) {
    Flash &f = Of(context);
    f.misused_ |= address % 4 != 0 || count % 4 != 0 || address + count > f.bytes_.size();
    f.most_per_call_ = std::max(f.most_per_call_, static_cast<int>(count));
    for (uint32_t i = 0; i < count; ++i) {
      uint8_t &byte = f.bytes_[address + i];
      if (f.life_ == 0) return false;
      f.misused_ |= byte != kErased;
      ++f.steps_;
      if (f.life_ > 0 && --f.life_ == 0) {
        // Torn: some of the bits that were to be cleared are.
        byte &= static_cast<uint8_t>(from[i] | f.random_());
        return false;
      }
      if (address + i >= f.worn_from && address + i < f.worn_to) {
        byte &= static_cast<uint8_t>(from[i] | 0x40);
        if (f.worn_says_so) return false;
        continue;
      }
      byte &= from[i];
    }
    return true;
  }

  static bool Erase(void *context, uint8_t sector) {
    Flash &f = Of(context);
    const size_t size = f.bytes_.size() / 2;
    const auto begin = f.bytes_.begin() + static_cast<std::ptrdiff_t>(sector * size);
    if (f.life_ == 0) return false;
    f.misused_ |= sector > 1;
    ++f.erases_;
    if (!f.erase_works) return false;
    for (int step = 1; step <= kEraseSteps; ++step) {
      ++f.steps_;
      if (f.life_ > 0 && --f.life_ == 0) {
        // Partly erased: some bytes wholly, some in a few bits, some not at all.
        for (size_t i = 0; i < size; ++i) {
          const uint32_t luck = f.random_() % kEraseSteps;
          auto &byte = *(begin + static_cast<std::ptrdiff_t>(i));
          if (luck < static_cast<uint32_t>(step)) byte = kErased;
          if (luck == static_cast<uint32_t>(step)) byte |= static_cast<uint8_t>(f.random_());
        }
        return false;
      }
    }
    std::fill_n(begin, size, kErased);
    return true;
  }

  std::vector<uint8_t> bytes_;
  store_memory_t memory_;
  std::minstd_rand random_;
  int64_t life_ = -1;
  int64_t steps_ = 0;
  int erases_ = 0;
  int most_per_call_ = 0;
  bool misused_ = false;
};

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

TEST(Store, IsEmptyOnABlankMemory) {
  Flash flash;
  Axis axis(flash.memory());
  EXPECT_EQ(axis.State(), AXIS_STORE_STATE_EMPTY);
  EXPECT_EQ(flash.steps(), 0);
}

TEST(Store, WithoutAMemoryItRefuses) {
  Axis axis(nullptr);
  EXPECT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_ERROR_STATE);
  EXPECT_EQ(axis.Write(AXIS_OBJ_RESTORE_DEFAULTS, 1), FW_ERROR_STATE);
  Flash small(1024);
  Axis too_small(small.memory());
  EXPECT_EQ(too_small.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_ERROR_STATE);
}

TEST(Store, KeepsEveryStoredParameterAndNoOther) {
  Flash flash;
  Axis axis(flash.memory());
  axis.Change(1, 100);
  ASSERT_EQ(axis.Write(AXIS_OBJ_OPEN_LOOP_CODE, 77), FW_OK);
  const int ticks = axis.Save();
  Axis next(flash.memory());
  EXPECT_EQ(next.State(), AXIS_STORE_STATE_LOADED);
  EXPECT_EQ(next.Stored(), axis.Stored());
  EXPECT_EQ(next.Read(AXIS_OBJ_OPEN_LOOP_CODE), 0);
  EXPECT_NE(next.Read(AXIS_OBJ_SPEED_MAX), 0);
  EXPECT_FALSE(flash.misused());
  EXPECT_LE(flash.most_per_call(), 16);
  // 1 erase, 40 looks at the blank sector, head, 2 entries a tick, CRC, 64 bytes a tick back.
  const int entries = static_cast<int>(axis.Stored().size());
  EXPECT_LE(ticks, 1 + 40 + 1 + (entries + 1) / 2 + 1 + (16 + 8 * entries) / 64 + 1);
}

TEST(Store, ASavedDefaultIsLoadedToo) {
  Flash flash;
  Axis axis(flash.memory());
  axis.Save();
  EXPECT_EQ(Axis(flash.memory()).State(), AXIS_STORE_STATE_LOADED);
}

TEST(Store, ForgettingGivesTheDefaults) {
  Flash flash;
  Axis axis(flash.memory());
  const Values defaults = axis.Stored();
  axis.Change(3, 50);
  axis.Save();
  ASSERT_EQ(axis.Write(AXIS_OBJ_RESTORE_DEFAULTS, 1), FW_OK);
  axis.Run();
  EXPECT_EQ(axis.State(), AXIS_STORE_STATE_RESTORED);
  EXPECT_EQ(axis.Read(AXIS_OBJ_SPEED_MAX), 3) << "only the next power-up has the defaults";
  Axis next(flash.memory());
  EXPECT_EQ(next.State(), AXIS_STORE_STATE_EMPTY);
  EXPECT_EQ(next.Stored(), defaults);
  next.Change(4, 50);
  next.Save();
  EXPECT_EQ(Axis(flash.memory()).Stored(), next.Stored());
}

TEST(Store, WhileItWorksStoredParametersStandStill) {
  Flash flash;
  Axis axis(flash.memory());
  axis.Change(5, 100);
  const Values saved = axis.Stored();
  ASSERT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
  EXPECT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_ERROR_BUSY);
  EXPECT_EQ(axis.Write(AXIS_OBJ_RESTORE_DEFAULTS, 1), FW_ERROR_BUSY);
  axis.Tick();
  EXPECT_EQ(axis.Write(AXIS_OBJ_FORCE_GAIN, 9), FW_ERROR_BUSY);
  EXPECT_EQ(axis.Write(AXIS_OBJ_FORCE_SETPOINT, 9), FW_OK);  // not kept
  axis.Run();
  EXPECT_EQ(axis.Write(AXIS_OBJ_FORCE_GAIN, 9), FW_OK);
  EXPECT_EQ(Axis(flash.memory()).Stored(), saved);
}

TEST(Store, IsRefusedWhileAModeIsActive) {
  Flash flash;
  Axis axis(flash.memory());
  ASSERT_EQ(axis.Write(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP), FW_OK);
  const axis_inputs_t inputs{0, {0, 0}, AXIS_DIN_ENABLE, 1};
  axis_outputs_t outputs;
  fw_tick(&axis.fw(), &inputs, &outputs);
  ASSERT_EQ(outputs.amp_enable, 1);
  EXPECT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_ERROR_STATE);
  EXPECT_EQ(axis.Write(AXIS_OBJ_RESTORE_DEFAULTS, 1), FW_ERROR_STATE);
  EXPECT_EQ(flash.steps(), 0);
}

// An erase holds up the processor of a chip: never with the amplifier on, also if both are asked
// for between the same two ticks.
TEST(Store, NothingEnablesWhileItWorksNorInTheSameTick) {
  for (const bool native : {true, false}) {
    const uint16_t object = native ? AXIS_OBJ_MODE : AXIS_OBJ_CONTROLWORD;
    const int32_t on = native ? static_cast<int32_t>(AXIS_MODE_OPEN_LOOP) : 0x0F;
    Flash flash;
    Axis axis(flash.memory());
    ASSERT_EQ(axis.Write(AXIS_OBJ_CONTROLWORD, 0), FW_OK);
    axis.Tick();
    ASSERT_EQ(axis.Write(AXIS_OBJ_CONTROLWORD, 0x06), FW_OK);
    ASSERT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
    EXPECT_EQ(axis.Write(object, on), FW_ERROR_BUSY);
    axis.Run();
    ASSERT_EQ(axis.Write(object, on), FW_OK);
    EXPECT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_ERROR_STATE);
    EXPECT_EQ(axis.Write(AXIS_OBJ_POLARITY, 0x80), FW_ERROR_STATE);
  }
}

// A COB-ID that follows the node id follows the next one; a chosen one stays.
TEST(Store, CobIdsFollowTheNodeIdUnlessChosen) {
  Flash flash;
  Axis axis(flash.memory(), 5);
  const int32_t follows = axis.Read(AXIS_OBJ_RPDO_COB_ID_2);
  ASSERT_EQ(axis.Write(AXIS_OBJ_RPDO_COB_ID_1, static_cast<int32_t>(0x80000321u)), FW_OK);
  axis.Save();
  const uint32_t own = static_cast<uint32_t>(axis_objects[AXIS_OBJ_RPDO_COB_ID_2].initial);
  Axis same(flash.memory(), 5);
  EXPECT_EQ(same.Read(AXIS_OBJ_RPDO_COB_ID_2), follows);
  Axis other(flash.memory(), 9);
  EXPECT_EQ(static_cast<uint32_t>(other.Read(AXIS_OBJ_RPDO_COB_ID_1)), 0x80000321u);
  EXPECT_EQ(other.Read(AXIS_OBJ_RPDO_COB_ID_2), Axis(nullptr, 9).Read(AXIS_OBJ_RPDO_COB_ID_2));
  EXPECT_GE(static_cast<uint32_t>(follows), own);
}

// --- what another program or a broken record left -----------------------------------------------

void PutWord(std::vector<uint8_t> &bytes, size_t at, uint32_t word) {
  for (size_t i = 0; i < 4; ++i) bytes[at + i] = static_cast<uint8_t>(word >> (8 * i));
}

uint32_t Crc32(const uint8_t *bytes, size_t count) {
  uint32_t crc = ~0u;
  for (size_t i = 0; i < count; ++i) {
    for (int bit = 0; bit < 8; ++bit) {
      const bool one = ((crc ^ (bytes[i] >> bit)) & 1) != 0;
      crc = (crc >> 1) ^ (one ? 0xEDB88320u : 0);
    }
  }
  return ~crc;
}

// A record by hand: head, entries, CRC. Returns where the next one goes.
size_t PutRecord(std::vector<uint8_t> &bytes, size_t at, uint32_t hash, uint32_t sequence,
                 const std::vector<std::pair<uint32_t, uint32_t>> &entries) {
  PutWord(bytes, at, 0x31534146);
  PutWord(bytes, at + 4, hash);
  PutWord(bytes, at + 8, sequence);
  PutWord(bytes, at + 12, static_cast<uint32_t>(8 * entries.size()));
  size_t next = at + 16;
  for (const auto &[address, value] : entries) {
    PutWord(bytes, next, address);
    PutWord(bytes, next + 4, value);
    next += 8;
  }
  PutWord(bytes, next, Crc32(&bytes[at], next - at));
  return next + 4;
}

constexpr uint32_t kForceGain = 0x200A00;
constexpr uint32_t kAdcBits = 0x200F00;
constexpr uint32_t kOpenLoopCode = 0x200200;

TEST(Store, TheFormatIsThatOfTheHeader) {
  Flash flash;
  PutRecord(flash.bytes(), 0, AXIS_OBJECTS_HASH32, 1, {{kForceGain, 1280}});
  Axis axis(flash.memory());
  EXPECT_EQ(axis.State(), AXIS_STORE_STATE_LOADED);
  EXPECT_EQ(axis.Read(AXIS_OBJ_FORCE_GAIN), 1280);
  std::vector<uint8_t> expected = flash.bytes();
  PutRecord(expected, 28, AXIS_OBJECTS_HASH32, 2, {{kForceGain, 7}});
  ASSERT_EQ(axis.Write(AXIS_OBJ_FORCE_GAIN, 7), FW_OK);
  axis.Save();
  EXPECT_EQ(flash.bytes(), expected);
}

TEST(Store, ASetOfAnotherTableIsLeftAlone) {
  Flash flash;
  const size_t end = PutRecord(flash.bytes(), 0, AXIS_OBJECTS_HASH32, 1, {{kForceGain, 1280}});
  PutRecord(flash.bytes(), end, AXIS_OBJECTS_HASH32 ^ 1, 2, {{kForceGain, 2560}});
  const std::vector<uint8_t> before = flash.bytes();
  Axis axis(flash.memory());
  EXPECT_EQ(axis.State(), AXIS_STORE_STATE_OTHER_TABLE);
  EXPECT_EQ(axis.Read(AXIS_OBJ_FORCE_GAIN), 0);
  EXPECT_EQ(flash.bytes(), before);
  axis.Save();
  EXPECT_EQ(flash.erases(), 0);
  EXPECT_TRUE(std::equal(before.begin(), before.begin() + 56, flash.bytes().begin()));
}

TEST(Store, ASetWithAValueThatDoesNotFitIsPassedOverWhole) {
  const std::vector<std::pair<uint32_t, uint32_t>> all = {
      {kAdcBits, 17},              // above its range
      {kAdcBits, 7},               // below
      {0x200D00, 0},               // force_sign 0
      {kOpenLoopCode, 1},          // not stored
      {0x203F00, 1},               // no such object
      {0x604100, 1},               // a signal
      {0x100800, 1},               // a text
      {0x01000000 | kAdcBits, 8},  // no address
  };
  for (const auto &entry : all) {
    Flash flash;
    const size_t end = PutRecord(flash.bytes(), 0, AXIS_OBJECTS_HASH32, 1, {{kForceGain, 1280}});
    PutRecord(flash.bytes(), end, AXIS_OBJECTS_HASH32, 2, {{kForceGain, 99}, entry});
    Axis axis(flash.memory());
    EXPECT_EQ(axis.State(), AXIS_STORE_STATE_LOADED) << std::hex << entry.first;
    EXPECT_EQ(axis.Read(AXIS_OBJ_FORCE_GAIN), 1280) << std::hex << entry.first;
    EXPECT_EQ(axis.Read(AXIS_OBJ_ADC_BITS), 8);
    Flash alone;
    PutRecord(alone.bytes(), 0, AXIS_OBJECTS_HASH32, 2, {{kForceGain, 99}, entry});
    Axis none(alone.memory());
    EXPECT_EQ(none.State(), AXIS_STORE_STATE_FAILED) << std::hex << entry.first;
    EXPECT_EQ(none.Read(AXIS_OBJ_FORCE_GAIN), 0);
    none.Change(2, 10);
    none.Save();
    EXPECT_EQ(Axis(alone.memory()).Stored(), none.Stored());
  }
}

TEST(Store, AFlippedBitAnywhereLeavesTheOlderSet) {
  Flash flash;
  Axis axis(flash.memory());
  axis.Change(1, 5);
  axis.Save();
  const Values older = axis.Stored();
  const std::vector<uint8_t> image = flash.bytes();
  axis.Change(2, 5);
  axis.Save();
  for (size_t at = 0; at < flash.bytes().size(); ++at) {
    if (flash.bytes()[at] == image[at]) continue;  // not of the newer record
    for (int bit = 0; bit < 8; ++bit) {
      flash.bytes()[at] ^= static_cast<uint8_t>(1 << bit);
      EXPECT_EQ(Axis(flash.memory()).Stored(), older) << at << "." << bit;
      flash.bytes()[at] ^= static_cast<uint8_t>(1 << bit);
    }
  }
}

TEST(Store, RubbishIsNoSet) {
  std::minstd_rand random(11);
  for (int round = 0; round < 200; ++round) {
    Flash flash;
    for (auto &byte : flash.bytes()) byte = static_cast<uint8_t>(random());
    for (int i = 0; i < 20; ++i) {  // heads that look right
      const size_t at = random() % (flash.bytes().size() / 4 - 5) * 4;
      PutWord(flash.bytes(), at, 0x31534146);
      PutWord(flash.bytes(), at + 12, static_cast<uint32_t>(random() % 3000));
    }
    Axis axis(flash.memory());
    EXPECT_EQ(axis.State(), AXIS_STORE_STATE_EMPTY);
    axis.Change(7, 20);
    axis.Save();
    EXPECT_EQ(Axis(flash.memory()).Stored(), axis.Stored());
    EXPECT_FALSE(flash.misused());
  }
}

// --- cuts ---------------------------------------------------------------------------------------

// Several saves that fill a sector and go on in the other, each one cut after every single step and
// in every case taken up again: old set or new set, and the next save works.
TEST(Store, ACutAfterAnyByteLeavesTheOldSetOrTheNewOne) {
  Flash flash;
  Axis first(flash.memory());
  Values old_set = first.Stored();
  int cuts = 0;
  int old_seen = 0;
  int new_seen = 0;
  int erases_cut = 0;
  for (uint32_t save = 1; save <= 7; ++save) {
    const std::vector<uint8_t> before = flash.bytes();
    const int percent = (save % 2 == 1) ? 100 : 40;
    int64_t steps = 0;
    Values new_set;
    std::vector<uint8_t> after;
    for (int64_t life = -1; life <= steps + 1; life = (life == -1) ? 1 : life + 1) {
      flash.bytes() = before;
      flash.PowerFor(-1, 0);
      Axis axis(flash.memory());
      ASSERT_EQ(axis.Stored(), old_set) << "save " << save;
      axis.Change(save, percent);
      const Values wanted = axis.Stored();
      const int64_t begin = flash.steps();
      const int erases = flash.erases();
      flash.PowerFor(life, static_cast<uint32_t>(save * 100000 + life));
      ASSERT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
      axis.Run();
      flash.PowerFor(-1, 0);
      if (life == -1) {
        ASSERT_EQ(axis.State(), AXIS_STORE_STATE_SAVED);
        steps = flash.steps() - begin;
        new_set = wanted;
        after = flash.bytes();
      } else {
        ++cuts;
        erases_cut += (flash.erases() > erases && life <= Flash::kEraseSteps) ? 1 : 0;
        const std::string replay =
            "save " + std::to_string(save) + ", cut in step " + std::to_string(life);
        Axis next(flash.memory());
        const Values found = next.Stored();
        ASSERT_TRUE(found == old_set || found == new_set) << replay;
        (found == new_set ? new_seen : old_seen) += 1;
        next.Change(save + 1000, 10);
        ASSERT_EQ(next.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
        next.Run();
        ASSERT_EQ(next.State(), AXIS_STORE_STATE_SAVED) << replay;
        ASSERT_EQ(Axis(flash.memory()).Stored(), next.Stored()) << replay;
        ASSERT_FALSE(flash.misused()) << replay;
      }
    }
    flash.bytes() = after;
    old_set = new_set;
  }
  std::printf("%d cuts (%d of them in an erase): old set %d times, new set %d times\n", cuts,
              erases_cut, old_seen, new_seen);
  EXPECT_GT(cuts, 3000);
  EXPECT_GE(erases_cut, 2 * Flash::kEraseSteps);
  EXPECT_GE(new_seen, 7);  // cut just behind the last byte
}

// One cut upon the other, saves in between: whatever the memory looks like by then.
TEST(Store, ManyCutsInARow) {
  for (uint32_t seed = 1; seed <= 40; ++seed) {
    std::minstd_rand random(seed);
    Flash flash;
    Values kept = Axis(flash.memory()).Stored();
    for (uint32_t i = 0; i < 60; ++i) {
      flash.PowerFor(-1, 0);
      Axis axis(flash.memory());
      ASSERT_EQ(axis.Stored(), kept) << "seed " << seed << " cut " << i;
      axis.Change(static_cast<uint32_t>(random() % 100000), static_cast<int>(random() % 60));
      const Values wanted = axis.Stored();
      flash.PowerFor(1 + static_cast<int64_t>(random() % 900), static_cast<uint32_t>(random()));
      ASSERT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
      axis.Run();
      const bool saved = axis.State() == AXIS_STORE_STATE_SAVED;
      flash.PowerFor(-1, 0);
      const Values found = Axis(flash.memory()).Stored();
      ASSERT_TRUE(found == wanted || (!saved && found == kept)) << "seed " << seed << " cut " << i;
      kept = found;
    }
    EXPECT_FALSE(flash.misused());
  }
}

// --- a memory that wears out --------------------------------------------------------------------

class WornStore : public ::testing::TestWithParam<bool> {};

TEST_P(WornStore, WhatCannotBeProgrammedGoesToTheOtherSector) {
  Flash flash;
  Axis axis(flash.memory());
  axis.Change(1, 10);
  axis.Save();
  flash.worn_from = 200;
  flash.worn_to = STORE_SECTOR_MIN;
  flash.worn_says_so = GetParam();
  axis.Change(2, 90);
  axis.Save();
  EXPECT_EQ(Axis(flash.memory()).Stored(), axis.Stored());
}

TEST_P(WornStore, WhereNothingCanBeProgrammedNothingIsLost) {
  Flash flash;
  Axis axis(flash.memory());
  axis.Change(1, 50);
  axis.Save();
  const Values kept = axis.Stored();
  flash.worn_from = 0;
  flash.worn_says_so = GetParam();
  for (uint32_t i = 2; i < 6; ++i) {
    axis.Change(i, 50);
    axis.Save(AXIS_STORE_STATE_FAILED);
    EXPECT_EQ(Axis(flash.memory()).Stored(), kept);
  }
  flash.worn_from = UINT32_MAX;  // a memory that was only cold
  axis.Save();
  EXPECT_EQ(Axis(flash.memory()).Stored(), axis.Stored());
}

INSTANTIATE_TEST_SUITE_P(Says, WornStore, ::testing::Bool());

TEST(Store, ASectorThatCannotBeErasedIsNotUsed) {
  Flash flash;
  Axis axis(flash.memory());
  axis.Change(1, 100);
  axis.Save();
  flash.erase_works = false;
  Values kept = axis.Stored();
  for (uint32_t i = 2; i < 10; ++i) {  // until no set fits behind the others
    axis.Change(i, 100);
    ASSERT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
    axis.Run();
    if (axis.State() == AXIS_STORE_STATE_SAVED) kept = axis.Stored();
    EXPECT_EQ(Axis(flash.memory()).Stored(), kept);
  }
  EXPECT_EQ(axis.State(), AXIS_STORE_STATE_FAILED);
}

// CANopen tells of it: 5530h in the error history.
TEST(Store, AFailureIsAnEmergency) {
  Flash flash;
  flash.erase_works = false;
  fw_config_t config{};
  config.memory = flash.memory();
  config.buses = 1;
  fw_t fw{};
  fw_init(&fw, &config);
  ASSERT_EQ(fw_object_write(&fw, FW_SOURCE_LOCAL, AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
  const axis_inputs_t inputs{0, {0, 0}, AXIS_DIN_ENABLE, 1};
  axis_outputs_t outputs;
  for (int i = 0; i < 20; ++i) fw_tick(&fw, &inputs, &outputs);
  int32_t latest = 0;
  ASSERT_EQ(fw_object_read(&fw, AXIS_OBJ_ERROR_HISTORY_1, &latest), FW_OK);
  EXPECT_EQ(latest & 0xFFFF, 0x5530);
}

// "save", and a reset of the node before that is done: the reset waits, nothing is lost.
TEST(Store, AResetOfTheNodeFindsWhatWasJustSaved) {
  Flash flash;
  fw_config_t config{};
  config.memory = flash.memory();
  config.buses = 1;
  fw_t fw{};
  fw_init(&fw, &config);
  const auto read = [&](uint16_t object) {
    int32_t value = 0;
    EXPECT_EQ(fw_object_read(&fw, object, &value), FW_OK);
    return value;
  };
  ASSERT_EQ(fw_object_write(&fw, FW_SOURCE_CANOPEN, AXIS_OBJ_FORCE_GAIN, 1234), FW_OK);
  ASSERT_EQ(fw_object_write(&fw, FW_SOURCE_CANOPEN, AXIS_OBJ_STORE_ALL, 0x65766173), FW_OK);
  const can_frame_t reset{0, 2, 0, {0x81, 0}};
  fw_can_receive(&fw, &reset);
  const axis_inputs_t inputs{0, {0, 0}, AXIS_DIN_ENABLE, 1};
  axis_outputs_t outputs;
  for (int i = 0; i < 100 && read(AXIS_OBJ_STORE_STATE) != AXIS_STORE_STATE_LOADED; ++i) {
    fw_tick(&fw, &inputs, &outputs);
  }
  EXPECT_EQ(read(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_LOADED);
  EXPECT_EQ(read(AXIS_OBJ_FORCE_GAIN), 1234);
}

// --- the file of the host -----------------------------------------------------------------------

class StoreFile : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = std::filesystem::temp_directory_path() / "forceaxis_store_XXXXXX";
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    folder_ = name;
    path_ = folder_ / "axis.store";
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::filesystem::path folder_;
  std::filesystem::path path_;
};

TEST_F(StoreFile, KeepsASet) {
  Values saved;
  {
    store_file_t file;
    ASSERT_EQ(store_file_open(&file, path_.c_str()), nullptr);
    Axis axis(&file.memory);
    EXPECT_EQ(axis.State(), AXIS_STORE_STATE_EMPTY);
    for (uint32_t i = 1; i < 40; ++i) {  // over both sectors and back
      axis.Change(i, 100);
      axis.Save();
    }
    saved = axis.Stored();
    store_file_close(&file);
  }
  store_file_t file;
  ASSERT_EQ(store_file_open(&file, path_.c_str()), nullptr);
  EXPECT_EQ(Axis(&file.memory).Stored(), saved);
  store_file_t second;
  EXPECT_STREQ(store_file_open(&second, path_.c_str()), "another process has it");
  store_file_close(&file);
}

TEST_F(StoreFile, AnotherFileIsRefusedAndNotTouched) {
  std::FILE *other = std::fopen(path_.c_str(), "w");
  ASSERT_NE(other, nullptr);
  std::fputs("not a store", other);
  std::fclose(other);
  store_file_t file;
  EXPECT_NE(store_file_open(&file, path_.c_str()), nullptr);
  EXPECT_EQ(std::filesystem::file_size(path_), 11u);
  EXPECT_STREQ(store_file_open(&file, folder_.c_str()), "Is a directory");
}

// A process that saves without end is killed, over and over.
TEST_F(StoreFile, AKilledProcessLeavesAWholeSet) {
  std::minstd_rand random(5);
  uint32_t last = 0;
  for (int round = 0; round < 30; ++round) {
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      store_file_t file;
      if (store_file_open(&file, path_.c_str()) != nullptr) _exit(1);
      Axis axis(&file.memory);
      for (uint32_t i = last + 1;; ++i) {
        axis.Change(i, 100);
        axis.Save();
      }
    }
    usleep(3000 + static_cast<useconds_t>(random() % 20000));
    kill(child, SIGKILL);
    int status = 0;
    waitpid(child, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status));
    store_file_t file;
    ASSERT_EQ(store_file_open(&file, path_.c_str()), nullptr);
    Axis axis(&file.memory);
    const auto number = static_cast<uint32_t>(axis.Read(AXIS_OBJ_SPEED_MAX));
    ASSERT_GE(number, last);
    // The set of this number, as the child made it: each one changes every parameter.
    Axis made(nullptr);
    for (uint32_t i = 1; i <= number; ++i) made.Change(i, 100);
    EXPECT_EQ(axis.Stored(), made.Stored()) << number;
    last = number;
    store_file_close(&file);
  }
  EXPECT_GT(last, 30u);
}

}  // namespace
