// Sets of other tables: of version 0.1.0, and of later ones that have other defaults or objects.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <map>
#include <string>
#include <vector>

#include "tests/firmware/unit/store_fixture.hpp"

namespace {

constexpr uint32_t kAtDefault = 1u << 24;
constexpr uint32_t kOtherTable = ~AXIS_OBJECTS_HASH32;

std::ifstream Open(const std::string &name) {
  std::ifstream file(STORE_DATA "/" + name, std::ios::binary);
  EXPECT_TRUE(file.good()) << name;
  return file;
}

// What the process that wrote the set had: address to value, for what differed from its defaults.
std::map<uint32_t, int32_t> ValuesOf(const std::string &name) {
  std::ifstream file = Open(name);
  std::map<uint32_t, int32_t> values;
  std::string address;
  long value = 0;
  while (file >> address >> value) {
    const size_t colon = address.find(':');
    values[static_cast<uint32_t>(std::stoul(address.substr(0, colon), nullptr, 16) << 8 |
                                 std::stoul(address.substr(colon + 1), nullptr, 16))] =
        static_cast<int32_t>(value);
  }
  return values;
}

TEST(Store, ASetOfVersion010Loads) {
  Flash flash(16384);
  std::ifstream file = Open("store_0_1_0.bin");
  const Bytes image{std::istreambuf_iterator<char>(file), {}};
  ASSERT_EQ(image.size(), flash.bytes().size());
  flash.bytes() = image;
  for (const uint8_t node_id : {5, 9}) {
    Axis axis(flash.memory(), node_id);
    EXPECT_EQ(axis.State(), AXIS_STORE_STATE_LOADED);
    EXPECT_EQ(axis.Read(AXIS_OBJ_STORE_CHANGE_COUNT), 0);
    const Axis defaults(nullptr, node_id);
    std::map<uint32_t, int32_t> values = ValuesOf("store_0_1_0.txt");
    ASSERT_EQ(values.size(), 40u);
    int others = 0;
    for (uint16_t i = 1; i < AXIS_OBJ_COUNT; ++i) {
      if (axis_objects[i].stored == 0) continue;
      const auto found = values.find(EntryOf(i, 0).first);
      const int32_t expected = found == values.end() ? defaults.Read(i) : found->second;
      EXPECT_EQ(axis.Read(i), expected) << i << " node " << int{node_id};
      others += found == values.end() ? 0 : 1;
    }
    EXPECT_EQ(others, 40);
  }
  // The next save is of this version, behind it, and the old set stays where it was.
  Axis axis(flash.memory(), 5);
  const Values loaded = axis.Stored();
  axis.Save();
  EXPECT_EQ(flash.erases(), 0);
  EXPECT_FALSE(flash.misused());
  EXPECT_EQ(Axis(flash.memory(), 5).Stored(), loaded);
  EXPECT_EQ(Axis(flash.memory(), 5).State(), AXIS_STORE_STATE_LOADED);
}

// The table of commit 43b2af7, whose PDOs could still carry a reset, an owner and a mode: every
// value as stored; a PDO that carries such a thing carries nothing, and it is reported which.
TEST(Store, ASetWithMappingsThatAreNotPermittedAnyMoreLoadsAndReportsThem) {
  Flash flash(16384);
  std::ifstream file = Open("store_43b2af7.bin");
  const Bytes image{std::istreambuf_iterator<char>(file), {}};
  ASSERT_EQ(image.size(), flash.bytes().size());
  flash.bytes() = image;
  const std::map<uint32_t, int32_t> values = ValuesOf("store_43b2af7.txt");
  ASSERT_EQ(values.size(), 13u);
  const std::vector<uint32_t> inert{0x160202, 0x160203, 0x160302, 0x160303};
  for (int power_up = 0; power_up < 2; ++power_up) {
    Axis axis(flash.memory(), 5);
    EXPECT_EQ(axis.State(), AXIS_STORE_STATE_LOADED_PARTLY);
    EXPECT_EQ(axis.Changes(), inert);
    EXPECT_EQ(axis.Read(AXIS_OBJ_STORE_CHANGE_COUNT), 4);
    const Axis defaults(nullptr, 5);
    for (uint16_t i = 1; i < AXIS_OBJ_COUNT; ++i) {
      if (axis_objects[i].stored == 0 || i == AXIS_OBJ_FIRST_MOTION_TEST) continue;
      const auto found = values.find(EntryOf(i, 0).first);
      EXPECT_EQ(axis.Read(i), found == values.end() ? defaults.Read(i) : found->second) << i;
    }
    axis.Save();  // by this table; read back the same way
  }
}

// A cut of the first save after an upgrade leaves the set of version 0.1.0.
TEST(Store, ACutOfTheFirstSaveLeavesTheSetOfVersion010) {
  Flash flash(16384);
  std::ifstream file = Open("store_0_1_0.bin");
  const Bytes image{std::istreambuf_iterator<char>(file), {}};
  flash.bytes() = image;
  const Values old_set = Axis(flash.memory(), 5).Stored();
  for (int64_t life = 1; life < STORE_SET_BYTES; life += 7) {
    flash.bytes() = image;
    Axis axis(flash.memory(), 5);
    axis.Change(static_cast<uint32_t>(life), 100);
    flash.PowerFor(life, static_cast<uint32_t>(life));
    ASSERT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
    axis.Run();
    flash.PowerFor(-1, 0);
    ASSERT_EQ(Axis(flash.memory(), 5).Stored(), old_set) << life;
  }
}

// A default is another today: the parameter keeps the one that its set was written against.
TEST(Store, AnotherDefaultKeepsTheOldValue) {
  Entry bits = EntryOf(AXIS_OBJ_ADC_BITS, 10);  // 8 today
  bits.first |= kAtDefault;
  Entry same = EntryOf(AXIS_OBJ_OUTPUT_LIMIT, 2048);
  same.first |= kAtDefault;
  // Defaults are no part of the hash, so a set of this very hash may have another one.
  for (const uint32_t hash : {AXIS_OBJECTS_HASH32, kOtherTable}) {
    Flash flash;
    PutSet(flash.bytes(), 0, hash, 1, {bits, same, EntryOf(AXIS_OBJ_POSITION_MAX, 5)});
    Axis axis(flash.memory());
    EXPECT_EQ(axis.State(), AXIS_STORE_STATE_LOADED_OLD_DEFAULTS);
    EXPECT_EQ(axis.Read(AXIS_OBJ_ADC_BITS), 10);
    EXPECT_EQ(axis.Read(AXIS_OBJ_POSITION_MAX), 5);
    EXPECT_EQ(axis.Read(AXIS_OBJ_STORE_CHANGE_COUNT), 1);
    EXPECT_EQ(axis.Changes(), std::vector<uint32_t>{0x01200F00});
    axis.Save();
    Axis next(flash.memory());
    EXPECT_EQ(next.State(), AXIS_STORE_STATE_LOADED) << "by now it is a value like any other";
    EXPECT_EQ(next.Read(AXIS_OBJ_ADC_BITS), 10);
  }
}

// An old default that follows the node id goes on following it.
TEST(Store, AnotherDefaultCobIdGoesOnFollowingTheNodeId) {
  Flash flash;
  Entry follows = EntryOf(AXIS_OBJ_RPDO_COB_ID_2, 0x340);  // 300h today
  follows.first |= kAtDefault;
  PutSet(flash.bytes(), 0, kOtherTable, 1, {follows, EntryOf(AXIS_OBJ_RPDO_COB_ID_1, 0x200)});
  for (const uint8_t node_id : {5, 9}) {
    Axis axis(flash.memory(), node_id);
    EXPECT_EQ(axis.State(), AXIS_STORE_STATE_LOADED_OLD_DEFAULTS);
    EXPECT_EQ(axis.Read(AXIS_OBJ_RPDO_COB_ID_2), 0x340 + node_id);
    EXPECT_EQ(axis.Read(AXIS_OBJ_RPDO_COB_ID_1), 0x200) << "chosen, though it looks like a default";
  }
}

// More changes than there is room for: counted, the first ones by address. Dropped ones decide.
TEST(Store, EveryChangeIsCounted) {
  Flash flash;
  std::vector<Entry> entries;
  for (uint32_t i = 0; i < 10; ++i) entries.push_back({0x300000 + (i << 8), 1, 0});
  Entry bits = EntryOf(AXIS_OBJ_ADC_BITS, 10);
  bits.first |= kAtDefault;
  entries.push_back(bits);
  PutSet(flash.bytes(), 0, kOtherTable, 1, entries);
  Axis axis(flash.memory());
  EXPECT_EQ(axis.State(), AXIS_STORE_STATE_LOADED_PARTLY);
  EXPECT_EQ(axis.Read(AXIS_OBJ_STORE_CHANGE_COUNT), 11);
  EXPECT_EQ(axis.Read(AXIS_OBJ_STORE_CHANGE_1), 0x300000);
  EXPECT_EQ(axis.Read(AXIS_OBJ_STORE_CHANGE_8), 0x300700);
  EXPECT_EQ(axis.Read(AXIS_OBJ_ADC_BITS), 10);
}

}  // namespace
