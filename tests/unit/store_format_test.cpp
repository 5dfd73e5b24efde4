// What another program or a broken record left.

#include <gtest/gtest.h>

#include <algorithm>
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
    EXPECT_EQ(axis.State(), AXIS_STORE_STATE_FAILED);
    axis.Change(7, 20);
    axis.Save();
    EXPECT_EQ(Axis(flash.memory()).Stored(), axis.Stored());
    EXPECT_FALSE(flash.misused());
  }
}

}  // namespace
