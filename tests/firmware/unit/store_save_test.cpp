// Saving, loading, forgetting, and what is refused meanwhile.

#include <gtest/gtest.h>

#include <cstdint>
#include <utility>
#include <vector>

#include "tests/firmware/unit/store_fixture.hpp"

namespace {

TEST(Store, IsEmptyOnABlankMemory) {
  Flash flash;
  Axis axis(flash.memory());
  EXPECT_EQ(axis.State(), AXIS_STORE_STATE_EMPTY);
  EXPECT_EQ(flash.steps(), 0);
}

// On where the memory holds no set; as it was stored where there is one; off without a memory.
TEST(Store, WithoutASetTheFirstMotionIsTested) {
  Flash flash;
  const auto is_tested = [&] { return Axis(flash.memory()).Read(AXIS_OBJ_FIRST_MOTION_TEST); };
  EXPECT_EQ(Axis(nullptr).Read(AXIS_OBJ_FIRST_MOTION_TEST), 0);
  EXPECT_EQ(is_tested(), 1) << "blank";
  Axis axis(flash.memory());
  axis.Save();
  EXPECT_EQ(is_tested(), 1) << "stored on";
  ASSERT_EQ(axis.Write(AXIS_OBJ_FIRST_MOTION_TEST, 0), FW_OK);
  axis.Save();
  EXPECT_EQ(is_tested(), 0) << "stored off";
  ASSERT_EQ(axis.Write(AXIS_OBJ_RESTORE_DEFAULTS, 1), FW_OK);
  axis.Run();
  EXPECT_EQ(is_tested(), 1) << "forgotten";
}

TEST(Store, WithoutAMemoryItRefuses) {
  Axis axis(nullptr);
  EXPECT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_ERROR_NO_MEMORY);
  EXPECT_EQ(axis.Write(AXIS_OBJ_RESTORE_DEFAULTS, 1), FW_ERROR_NO_MEMORY);
  Flash small(STORE_SECTOR_MIN - 16);
  Axis too_small(small.memory());
  EXPECT_EQ(too_small.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_ERROR_NO_MEMORY);
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
  // An erase, 64 bytes a tick to see that it is blank, head, an entry a tick, CRC, 64 bytes a tick
  // read back.
  const int entries = static_cast<int>(axis.Stored().size());
  EXPECT_EQ(ticks,
            1 + (Flash::kSector + 63) / 64 + 1 + entries + 1 + (16 + 12 * entries + 63) / 64);
}

TEST(Store, ASavedDefaultIsLoadedToo) {
  Flash flash;
  Axis axis(flash.memory());
  axis.Save();
  EXPECT_EQ(Axis(flash.memory()).State(), AXIS_STORE_STATE_LOADED);
}

TEST(Store, RestoringDefaultsLoadsThem) {
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
  const axis_inputs_t inputs{0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
  axis_outputs_t outputs;
  fw_tick(&axis.fw(), &inputs, &outputs);
  ASSERT_EQ(outputs.amp_enable, 1);
  EXPECT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_ERROR_STATE);
  EXPECT_EQ(axis.Write(AXIS_OBJ_RESTORE_DEFAULTS, 1), FW_ERROR_STATE);
  EXPECT_EQ(flash.steps(), 0);
}

// An erase stalls the processor of a chip: never with the amplifier on, also if both are requested
// between the same two ticks.
TEST(Store, NothingEnablesWhileItWorksNorInTheSameTick) {
  for (const bool native : {true, false}) {
    const uint16_t object = native ? uint16_t{AXIS_OBJ_MODE} : uint16_t{AXIS_OBJ_CONTROLWORD};
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

// Off only where the set in force is the one that was saved last, whole: with it the axis was
// commissioned. Not after a restore, a save that was cut off, or with a set of another table.
TEST(Store, TheFirstMotionIsTestedWhereWhatIsInForceWasNotCommissioned) {
  constexpr uint32_t kOther = ~AXIS_OBJECTS_HASH32;
  constexpr uint32_t kForgotten = 0x31464146;  // "FAF1"
  const std::vector<Entry> off{EntryOf(AXIS_OBJ_FIRST_MOTION_TEST, 0),
                               EntryOf(AXIS_OBJ_ADC_BITS, 10)};
  Entry old_default = EntryOf(AXIS_OBJ_OUTPUT_LIMIT, 1000);
  old_default.first |= 1u << 24;
  std::vector<Entry> older = off, partly = off;
  older.push_back(old_default);
  partly.push_back({0x300000, 1, 0});
  const auto power_up = [](const auto &put, size_t remains) {
    Flash flash;
    size_t end = put(flash.bytes());
    for (size_t i = 0; i < remains; ++i) flash.bytes()[end + i] = 0x5A;
    Axis axis(flash.memory());
    return std::pair(axis.State(), axis.Read(AXIS_OBJ_FIRST_MOTION_TEST));
  };
  using Seen = std::pair<int32_t, int32_t>;
  const auto blank = [](Bytes &) -> size_t { return 0; };
  const auto set = [&](uint32_t hash, const std::vector<Entry> &entries) {
    return [hash, &entries](Bytes &bytes) { return PutSet(bytes, 0, hash, 1, entries); };
  };
  const auto forgotten = [](Bytes &bytes) {
    return PutRecord(bytes, 0, {kForgotten, AXIS_OBJECTS_HASH32, 1}, {});
  };
  EXPECT_EQ(power_up(set(AXIS_OBJECTS_HASH32, off), 0), Seen(AXIS_STORE_STATE_LOADED, 0));
  EXPECT_EQ(power_up(set(kOther, older), 0), Seen(AXIS_STORE_STATE_LOADED_OLD_DEFAULTS, 0));
  EXPECT_EQ(power_up(blank, 0), Seen(AXIS_STORE_STATE_EMPTY, 1));
  EXPECT_EQ(power_up(blank, 40), Seen(AXIS_STORE_STATE_FAILED, 1));
  EXPECT_EQ(power_up(forgotten, 0), Seen(AXIS_STORE_STATE_EMPTY, 1));
  EXPECT_EQ(power_up(forgotten, 40), Seen(AXIS_STORE_STATE_LOADED_OLDER, 1));
  EXPECT_EQ(power_up(set(AXIS_OBJECTS_HASH32, off), 40), Seen(AXIS_STORE_STATE_LOADED_OLDER, 1));
  EXPECT_EQ(power_up(set(kOther, partly), 0), Seen(AXIS_STORE_STATE_LOADED_PARTLY, 1));
  const auto old_table = [](Bytes &bytes) { return PutOldSet(bytes, 0, kOther, 1, {}); };
  EXPECT_EQ(power_up(old_table, 0), Seen(AXIS_STORE_STATE_OTHER_TABLE, 1));
}

}  // namespace
