// The format of sets, and records that another program or damage made.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <random>
#include <utility>
#include <vector>

#include "tests/firmware/unit/store_fixture.hpp"

namespace {

constexpr uint32_t kForceGain = 0x200A00;
constexpr uint32_t kOurs = AXIS_OBJECTS_HASH32;

// By the rule of the table's generator, written out.
const uint32_t kForceGainSignature = SignatureOf("u16|code/count|0.00390625|0|65535||");

Entry ForceGain(uint32_t value) { return {kForceGain, value, kForceGainSignature}; }

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
  size_t end = PutSet(flash.bytes(), 0, kOurs, 1, {ForceGain(1280)});
  Axis axis(flash.memory(), 5);
  EXPECT_EQ(axis.State(), AXIS_STORE_STATE_LOADED);
  EXPECT_EQ(axis.Read(AXIS_OBJ_FORCE_GAIN), 1280);
  // Every stored parameter, at its default but for one; without the node id where that is added.
  std::vector<Entry> entries;
  for (uint16_t i = 1; i < AXIS_OBJ_COUNT; ++i) {
    if (axis_objects[i].stored == 0) continue;
    Entry entry = EntryOf(i, static_cast<uint32_t>(axis_objects[i].initial));
    if (i == AXIS_OBJ_FORCE_GAIN) entry = ForceGain(7);
    if (i != AXIS_OBJ_FORCE_GAIN) entry.first |= 1u << 24;
    entries.push_back(entry);
  }
  ASSERT_EQ(entries.size(), static_cast<size_t>(AXIS_STORED_COUNT));
  std::vector<uint8_t> expected = flash.bytes();
  end = PutSet(expected, end, kOurs, 2, entries);
  EXPECT_EQ(end, 32u + STORE_SET_BYTES);
  ASSERT_EQ(axis.Write(AXIS_OBJ_FORCE_GAIN, 7), FW_OK);
  axis.Save();
  EXPECT_EQ(flash.bytes(), expected);
}

// In a set of an unknown table without signatures the meaning of its values is unknown.
TEST(Store, ASetThatDoesNotDescribeItselfIsIgnored) {
  Flash flash;
  const size_t end = PutSet(flash.bytes(), 0, kOurs, 1, {ForceGain(1280)});
  PutOldSet(flash.bytes(), end, kOurs, 2, {kForceGain, 2560});
  const std::vector<uint8_t> before = flash.bytes();
  Axis axis(flash.memory());
  EXPECT_EQ(axis.State(), AXIS_STORE_STATE_OTHER_TABLE);
  EXPECT_EQ(axis.Read(AXIS_OBJ_FORCE_GAIN), 0);
  EXPECT_EQ(flash.bytes(), before);
  axis.Save();
  EXPECT_EQ(flash.erases(), 0);
  EXPECT_TRUE(std::equal(before.begin(), before.begin() + 60, flash.bytes().begin()));
}

// Entries that no set of this table can have.
std::vector<Entry> EntriesThatDoNotFit() {
  Entry flagged = EntryOf(AXIS_OBJ_ADC_BITS, 8);
  flagged.first |= 1u << 25;
  Entry unsigned_one = EntryOf(AXIS_OBJ_ADC_BITS, 8);
  unsigned_one.signature ^= 1;
  return {
      EntryOf(AXIS_OBJ_ADC_BITS, 17),       // above its range
      EntryOf(AXIS_OBJ_ADC_BITS, 7),        // below
      EntryOf(AXIS_OBJ_FORCE_SIGN, 0),      // neither +1 nor -1
      EntryOf(AXIS_OBJ_OPEN_LOOP_CODE, 1),  // not stored
      {0x203F00, 1, 0},                     // no such object
      EntryOf(AXIS_OBJ_STATUSWORD, 1),      // a signal
      {0x100800, 1, 0},                     // a text
      flagged,
      unsigned_one,
  };
}

TEST(Store, ASetWithAnInvalidEntryIsIgnoredWhole) {
  for (const Entry &entry : EntriesThatDoNotFit()) {
    Flash flash;
    const size_t end = PutSet(flash.bytes(), 0, kOurs, 1, {ForceGain(1280)});
    PutSet(flash.bytes(), end, kOurs, 2, {ForceGain(99), entry});
    Axis axis(flash.memory());
    EXPECT_EQ(axis.State(), AXIS_STORE_STATE_LOADED_OLDER) << std::hex << entry.first;
    EXPECT_EQ(axis.Read(AXIS_OBJ_FORCE_GAIN), 1280) << std::hex << entry.first;
    EXPECT_EQ(axis.Read(AXIS_OBJ_ADC_BITS), 8);
    Flash alone;
    PutSet(alone.bytes(), 0, kOurs, 2, {ForceGain(99), entry});
    Axis none(alone.memory());
    EXPECT_EQ(none.State(), AXIS_STORE_STATE_FAILED) << std::hex << entry.first;
    EXPECT_EQ(none.Read(AXIS_OBJ_FORCE_GAIN), 0);
    none.Change(2, 10);
    none.Save();
    EXPECT_EQ(Axis(alone.memory()).Stored(), none.Stored());
  }
}

// In a set of another table only those entries are dropped; the others are in force.
TEST(Store, ASetOfAnotherTableIsLoadedEntryByEntry) {
  for (const Entry &entry : EntriesThatDoNotFit()) {
    Flash flash;
    PutSet(flash.bytes(), 0, ~kOurs, 1, {ForceGain(99), entry, EntryOf(AXIS_OBJ_POSITION_MAX, 5)});
    Axis axis(flash.memory());
    EXPECT_EQ(axis.State(), AXIS_STORE_STATE_LOADED_PARTLY) << std::hex << entry.first;
    EXPECT_EQ(axis.Changes(), std::vector<uint32_t>{entry.first & 0xFFFFFF});
    EXPECT_EQ(axis.Read(AXIS_OBJ_STORE_CHANGE_COUNT), 1);
    EXPECT_EQ(axis.Read(AXIS_OBJ_FORCE_GAIN), 99);
    EXPECT_EQ(axis.Read(AXIS_OBJ_POSITION_MAX), 5);
    EXPECT_EQ(axis.Read(AXIS_OBJ_ADC_BITS), 8);
    EXPECT_EQ(axis.Read(AXIS_OBJ_FORCE_SIGN), 1);
    axis.Save();
    Axis next(flash.memory());
    EXPECT_EQ(next.State(), AXIS_STORE_STATE_LOADED) << "reported until the next save";
    EXPECT_TRUE(next.Changes().empty());
  }
}

// "All defaults" needs no table to be understood.
TEST(Store, RestoringDefaultsNeedsNoTable) {
  Flash flash;
  const size_t end = PutSet(flash.bytes(), 0, kOurs, 1, {ForceGain(99)});
  PutRecord(flash.bytes(), end, {0x31464146, ~kOurs, 2}, {});
  Axis axis(flash.memory());
  EXPECT_EQ(axis.State(), AXIS_STORE_STATE_EMPTY);
  EXPECT_EQ(axis.Read(AXIS_OBJ_FORCE_GAIN), 0);
}

// Entries that are no whole number of entries: no set, though its CRC is right.
TEST(Store, APartOfAnEntryIsNoSet) {
  const Entry gain = ForceGain(99);
  const std::vector<uint32_t> words = {gain.first, gain.value, gain.signature, kForceGain};
  for (const size_t count : {1, 2, 4}) {
    Flash flash;
    PutRecord(flash.bytes(), 0, {0x32534146, kOurs, 1}, {words.begin(), words.begin() + count});
    Axis axis(flash.memory());
    EXPECT_EQ(axis.State(), AXIS_STORE_STATE_FAILED) << count;
    EXPECT_EQ(axis.Read(AXIS_OBJ_FORCE_GAIN), 0) << count;
  }
  for (const size_t count : {1, 3}) {
    Flash flash;
    PutOldSet(flash.bytes(), 0, AXIS_OBJECTS_HASH32_0_1_0, 1,
              {words.begin(), words.begin() + count});
    EXPECT_EQ(Axis(flash.memory()).State(), AXIS_STORE_STATE_FAILED) << count;
  }
}

// The two newest records, whatever the place that they are put into held before: with the newest in
// front of the older one in the memory, nothing has been found yet to compare the older one with.
TEST(Store, TheTwoNewestRecordsAreFoundInAnyOrder) {
  const record_t rubbish{1, 0x32534146, kOurs, UINT32_MAX, 0};
  for (const record_t &held : {record_t{}, rubbish}) {
    Flash flash;
    record_t found[2] = {held, held};
    record_sector_t sectors[2];
    record_survey(flash.memory(), sectors, found);
    EXPECT_EQ(found[0].magic, RECORD_NONE);
    EXPECT_EQ(found[1].magic, RECORD_NONE);
    PutSet(flash.bytes(), 0, kOurs, 5, {ForceGain(5)});
    found[0] = found[1] = held;
    record_survey(flash.memory(), sectors, found);
    EXPECT_EQ(found[0].sequence, 5u);
    EXPECT_EQ(found[1].magic, RECORD_NONE);
    const size_t end = PutSet(flash.bytes(), Flash::kSector, kOurs, 4, {ForceGain(4)});
    PutSet(flash.bytes(), end, kOurs, 3, {ForceGain(3)});
    found[0] = found[1] = held;
    record_survey(flash.memory(), sectors, found);
    EXPECT_EQ(found[0].sequence, 5u);
    EXPECT_EQ(found[1].sequence, 4u);
    EXPECT_EQ(found[1].begin, Flash::kSector);
  }
}

// One set only, and it cannot be used: there is none to fall back on. Then an older one behind it
// in the memory: it counts.
TEST(Store, AnUnusableNewestSetInFrontOfTheOlderOne) {
  Flash flash;
  PutSet(flash.bytes(), 0, kOurs, 5, {EntryOf(AXIS_OBJ_ADC_BITS, 17)});
  EXPECT_EQ(Axis(flash.memory()).State(), AXIS_STORE_STATE_FAILED);
  PutSet(flash.bytes(), Flash::kSector, kOurs, 4, {ForceGain(1280)});
  Axis axis(flash.memory());
  EXPECT_EQ(axis.State(), AXIS_STORE_STATE_LOADED_OLDER);
  EXPECT_EQ(axis.Read(AXIS_OBJ_FORCE_GAIN), 1280);
}

// The sector of the set in force is never erased, also where a newer one that cannot be used lies
// in the other.
TEST(Store, TheSetInForceIsKeptUntilANewOneIsWhole) {
  Flash flash;
  PutSet(flash.bytes(), 0, kOurs, 1, {ForceGain(1280)});
  size_t at = STORE_SECTOR_MIN;
  for (uint32_t sequence = 2; at + STORE_SET_BYTES <= flash.bytes().size(); ++sequence) {
    at = PutSet(flash.bytes(), at, kOurs, sequence, {EntryOf(AXIS_OBJ_ADC_BITS, 17)});
    if (at + STORE_SET_BYTES > flash.bytes().size()) break;
    // The second newest one can be used, else nothing would be loaded.
    PutSet(flash.bytes(), 0, kOurs, sequence, {ForceGain(1280)});
  }
  Axis axis(flash.memory());
  ASSERT_EQ(axis.State(), AXIS_STORE_STATE_LOADED_OLDER);
  const Values kept = axis.Stored();
  for (int save = 0; save < 3; ++save) {
    axis.Change(static_cast<uint32_t>(save + 2), 100);
    flash.PowerFor(1, 1);  // cut in the first step of the save
    ASSERT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
    axis.Run();
    flash.PowerFor(-1, 0);
    EXPECT_EQ(Axis(flash.memory()).Stored(), kept) << "save " << save;
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
  for (size_t at = 0; at < flash.bytes().size(); at += kEvery) {
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

// A damaged sector: the other one counts, and that it is not the newest set is reported.
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
  next.Save();  // uses the damaged sector
  EXPECT_EQ(Axis(flash.memory()).State(), AXIS_STORE_STATE_LOADED);
  EXPECT_EQ(Axis(flash.memory()).Stored(), next.Stored());
}

// The last word of a set may look like blank memory.
TEST(Store, ASetWhoseCrcIsAllOnesIsNotWrittenInto) {
  Flash flash;
  const auto put = [&](uint32_t value) {
    PutSet(flash.bytes(), 0, kOurs, 1, {EntryOf(AXIS_OBJ_POSITION_MIN, value)});
    return Crc32(flash.bytes().data(), 28);
  };
  ASSERT_EQ(put(ValueOfCrc(put, UINT32_MAX)), UINT32_MAX);
  const std::vector<uint8_t> before = flash.bytes();
  Axis axis(flash.memory());
  ASSERT_EQ(axis.State(), AXIS_STORE_STATE_LOADED);
  axis.Change(3, 10);
  axis.Save();
  EXPECT_TRUE(std::equal(before.begin(), before.begin() + 32, flash.bytes().begin()));
  EXPECT_EQ(Axis(flash.memory()).Stored(), axis.Stored());
}

// Both sectors full of sets that cannot be used: read once, not once for each of them.
TEST(Store, UnusableSetsCostNoMoreThanUsableOnes) {
  const auto reads = [](bool usable) {
    Flash flash(16384);
    const Entry entry = usable ? ForceGain(256) : EntryOf(AXIS_OBJ_ADC_BITS, 17);
    size_t at = 0;
    for (uint32_t sequence = 1; at + 32 <= flash.bytes().size(); ++sequence) {
      at = PutSet(flash.bytes(), at, kOurs, sequence, {entry});
    }
    const Axis axis(flash.memory());
    EXPECT_EQ(axis.State(), usable ? AXIS_STORE_STATE_LOADED : AXIS_STORE_STATE_FAILED);
    return flash.bytes_read();
  };
  EXPECT_LE(reads(false), reads(true));
}

// The cost that store.h states: both sectors once, what is blank twice, the entries in force
// thrice.
TEST(Store, LoadingReadsTheMemoryOnce) {
  Flash flash(16384);
  Axis axis(flash.memory());
  for (uint32_t i = 1; i < 12; ++i) {
    axis.Change(i, 100);
    axis.Save();
  }
  const int64_t before = flash.bytes_read();
  const Axis next(flash.memory());
  EXPECT_EQ(next.State(), AXIS_STORE_STATE_LOADED);
  const int64_t most = 2 * 16384 + 16384 + 4 * STORE_SET_BYTES + 1024;
  EXPECT_LE(flash.bytes_read() - before, most);
}

TEST(Store, RubbishIsNoSet) {
  std::minstd_rand random(11);
  for (int round = 0; round < 200; ++round) {
    Flash flash;
    for (auto &byte : flash.bytes()) byte = static_cast<uint8_t>(random());
    for (int i = 0; i < 20; ++i) {  // heads that are valid
      const size_t at = random() % (flash.bytes().size() / 4 - 5) * 4;
      PutWord(flash.bytes(), at, i % 2 == 0 ? 0x31534146 : 0x32534146);
      PutWord(flash.bytes(), at + 12, static_cast<uint32_t>(random() % 3000));
    }
    Axis axis(flash.memory());
    ASSERT_EQ(axis.State(), AXIS_STORE_STATE_FAILED) << round;
    axis.Change(7, 20);
    axis.Save();
    EXPECT_EQ(Axis(flash.memory()).Stored(), axis.Stored());
    EXPECT_FALSE(flash.misused());
  }
}

}  // namespace
