// What another program or a broken record left.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <random>
#include <utility>
#include <vector>

#include "tests/unit/store_fixture.hpp"

namespace {

// A record by hand: head, entries, CRC. Returns where the next one goes.
size_t PutRecord(Bytes &bytes, size_t at, uint32_t hash, uint32_t sequence,
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
constexpr uint32_t kPositionMin = 0x201600;
constexpr uint32_t kAdcBits = 0x200F00;
constexpr uint32_t kOpenLoopCode = 0x200200;

// The value of 32 bits that has the CRC `wanted`. What a bit changes of a CRC does not depend on
// the others, so the changes make up any difference; each pivot is one of its highest bit.
template <typename Crc>
uint32_t ValueOfCrc(const Crc &crc_of, uint32_t wanted) {
  std::array<std::pair<uint32_t, uint32_t>, 32> pivots{};  // change of the CRC, of the value
  const auto reduce = [&](uint32_t &change, uint32_t &value) {
    for (int bit = 31; bit >= 0; --bit) {
      if ((change >> bit & 1) == 0) continue;
      if (pivots[bit].first == 0) return bit;
      change ^= pivots[bit].first;
      value ^= pivots[bit].second;
    }
    return -1;
  };
  const uint32_t zero = crc_of(0);
  for (int i = 0; i < 32; ++i) {
    uint32_t value = uint32_t{1} << i;
    uint32_t change = crc_of(value) ^ zero;
    const int pivot = reduce(change, value);
    if (pivot >= 0) pivots[pivot] = {change, value};
  }
  uint32_t value = 0;
  uint32_t change = wanted ^ zero;
  reduce(change, value);
  return value;
}

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
    EXPECT_EQ(axis.State(), AXIS_STORE_STATE_LOADED_OLDER) << std::hex << entry.first;
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
      const Axis next(flash.memory());
      EXPECT_EQ(next.Stored(), older) << at << "." << bit;
      EXPECT_EQ(next.State(), AXIS_STORE_STATE_LOADED_OLDER) << at << "." << bit;
      flash.bytes()[at] ^= static_cast<uint8_t>(1 << bit);
    }
  }
}

// A damaged sector: the other one counts, and it is told that it is not the newest set.
TEST(Store, ADamagedSectorLeavesTheOther) {
  Flash flash;
  Axis axis(flash.memory());
  uint32_t seed = 0;
  Values older;
  while (flash.erases() < 2) {  // until the second sector is begun
    older = axis.Stored();
    axis.Change(++seed, 60);
    axis.Save();
  }
  const auto half = static_cast<std::ptrdiff_t>(flash.bytes().size() / 2);
  const bool second = Axis(flash.memory()).fw().store.home == 1;
  const auto newest = flash.bytes().begin() + (second ? half : 0);
  EXPECT_EQ(Axis(flash.memory()).State(), AXIS_STORE_STATE_LOADED);
  for (auto at = newest; at != newest + half; ++at) *at &= 0x5A;
  Axis next(flash.memory());
  EXPECT_EQ(next.State(), AXIS_STORE_STATE_LOADED_OLDER);
  EXPECT_EQ(next.Stored(), older);
  next.Change(99, 20);
  next.Save();  // takes the damaged one
  EXPECT_EQ(Axis(flash.memory()).State(), AXIS_STORE_STATE_LOADED);
  EXPECT_EQ(Axis(flash.memory()).Stored(), next.Stored());
}

// The last word of a set may look like blank memory.
TEST(Store, ASetWhoseCrcIsAllOnesIsNotWrittenInto) {
  Flash flash;
  const auto put = [&](uint32_t value) {
    PutRecord(flash.bytes(), 0, AXIS_OBJECTS_HASH32, 1, {{kPositionMin, value}});
    return Crc32(flash.bytes().data(), 24);
  };
  ASSERT_EQ(put(ValueOfCrc(put, UINT32_MAX)), UINT32_MAX);
  const std::vector<uint8_t> before = flash.bytes();
  Axis axis(flash.memory());
  ASSERT_EQ(axis.State(), AXIS_STORE_STATE_LOADED);
  axis.Change(3, 10);
  axis.Save();
  EXPECT_TRUE(std::equal(before.begin(), before.begin() + 28, flash.bytes().begin()));
  EXPECT_EQ(Axis(flash.memory()).Stored(), axis.Stored());
}

// Both sectors full of sets that cannot be used: looked at once, not once for each of them.
TEST(Store, UnusableSetsCostNoMoreThanUsableOnes) {
  const auto reads = [](uint32_t gain, uint32_t last_gain) {
    Flash flash(16384);
    size_t at = 0;
    for (uint32_t sequence = 1; at + 28 <= flash.bytes().size(); ++sequence) {
      const bool last = at + 56 > flash.bytes().size();
      if (at < 16384 && at + 28 > 16384) at = 16384;
      at = PutRecord(flash.bytes(), at, AXIS_OBJECTS_HASH32, sequence,
                     {{kForceGain, last ? last_gain : gain}});
    }
    const Axis axis(flash.memory());
    EXPECT_EQ(axis.State(), last_gain == 256 ? AXIS_STORE_STATE_LOADED : AXIS_STORE_STATE_FAILED);
    return flash.bytes_read();
  };
  EXPECT_LE(reads(0x7FFFFFFF, 0x7FFFFFFF), reads(256, 256));
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
    EXPECT_EQ(axis.State(), AXIS_STORE_STATE_FAILED);
    axis.Change(7, 20);
    axis.Save();
    EXPECT_EQ(Axis(flash.memory()).Stored(), axis.Stored());
    EXPECT_FALSE(flash.misused());
  }
}

}  // namespace
