// A memory that fails or reports false success: never a wrong value in force, and the state reports
// the failure.

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <vector>

#include "tests/firmware/unit/store_fixture.hpp"
#include "tests/support/poisoned.hpp"

namespace {

using WornStore = ::testing::TestWithParam<FlashFaults::Program>;

TEST_P(WornStore, WhatCannotBeProgrammedGoesToTheOtherSector) {
  Flash flash;
  Axis axis(flash.memory());
  axis.Change(1, 10);
  axis.Save();
  flash.faults = {.program = GetParam(), .program_from = 2200, .program_to = STORE_SECTOR_MIN};
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
  flash.faults.program = GetParam();
  for (uint32_t i = 2; i < 6; ++i) {
    axis.Change(i, 50);
    axis.Save(AXIS_STORE_STATE_FAILED);
    EXPECT_EQ(Axis(flash.memory()).Stored(), kept);
  }
  EXPECT_FALSE(flash.misused()) << "nothing is programmed over what a failed save programmed";
  flash.faults = {};  // the fault was temporary
  axis.Save();
  EXPECT_EQ(Axis(flash.memory()).Stored(), axis.Stored());
}

INSTANTIATE_TEST_SUITE_P(Each, WornStore,
                         ::testing::Values(FlashFaults::Program::kRefused,
                                           FlashFaults::Program::kStuck,
                                           FlashFaults::Program::kNothing,
                                           FlashFaults::Program::kHalf));

TEST(Store, ASectorThatCannotBeErasedIsNotUsed) {
  Flash flash;
  Axis axis(flash.memory());
  axis.Change(1, 100);
  axis.Save();
  flash.faults.erase = FlashFaults::Erase::kRefused;
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

// Over CANopen: 5530h in the error history.
TEST(Store, AFailureIsAnEmergency) {
  Flash flash;
  flash.faults.erase = FlashFaults::Erase::kRefused;
  fw_config_t config{};
  config.memory = flash.memory();
  config.buses = 1;
  fw_t fw = poisoned<fw_t>();
  fw_init(&fw, &config);
  ASSERT_EQ(fw_object_write(&fw, FW_SOURCE_LOCAL, AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
  const axis_inputs_t inputs{0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
  axis_outputs_t outputs;
  for (int i = 0; i < 20; ++i) fw_tick(&fw, &inputs, &outputs);
  int32_t latest = 0;
  ASSERT_EQ(fw_object_read(&fw, AXIS_OBJ_ERROR_HISTORY_1, &latest), FW_OK);
  EXPECT_EQ(latest & 0xFFFF, 0x5530);
}

// An erase that reports success and keeps the second half: the store detects it before it programs
// anything there, so remains are never programmed over.
TEST(Store, AnErasedSectorIsCheckedToBeBlank) {
  for (const auto fault : {FlashFaults::Erase::kNothing, FlashFaults::Erase::kHalf}) {
    Flash flash;
    Axis axis(flash.memory());
    for (uint32_t i = 1; i <= 4; ++i) {  // both sectors full
      axis.Change(i, 100);
      axis.Save();
    }
    const Values kept = axis.Stored();
    flash.faults.erase = fault;
    axis.Change(5, 100);
    axis.Save(AXIS_STORE_STATE_FAILED);
    EXPECT_FALSE(flash.misused());
    Axis next(flash.memory());
    EXPECT_EQ(next.Stored(), kept);
    flash.faults = {};
    next.Change(6, 100);
    next.Save();
    EXPECT_EQ(Axis(flash.memory()).Stored(), next.Stored());
    EXPECT_EQ(Axis(flash.memory()).State(), AXIS_STORE_STATE_LOADED);
  }
}

// A memory that reports success at any piece of a set without doing it: "saved" means that the set
// is there, "failed" that the one before it is.
TEST(Store, SavedMeansThatEveryPieceWasReadBack) {
  using Program = FlashFaults::Program;
  for (const Program fault : {Program::kNothing, Program::kHalf, Program::kStuck}) {
    for (uint32_t at = 0; at < STORE_SET_BYTES; at += 4 * kEvery) {
      Flash flash;
      Axis axis(flash.memory());
      axis.Change(1, 100);
      axis.Save();
      const Values kept = axis.Stored();
      flash.faults = {
          .program = fault, .program_from = kSetSpace + at, .program_to = kSetSpace + at + 4};
      axis.Change(at + 2, 100);
      ASSERT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
      axis.Run();
      ASSERT_EQ(axis.State(), AXIS_STORE_STATE_SAVED) << "the other sector is sound";
      ASSERT_EQ(Axis(flash.memory()).Stored(), axis.Stored()) << at;
      ASSERT_NE(axis.Stored(), kept);
      ASSERT_FALSE(flash.misused());
    }
  }
}

// A bit that changes in a set at rest: the set before it counts, and it is reported.
TEST(Store, ABitThatChangesLaterIsFoundWhenItIsLoaded) {
  Flash flash;
  Axis axis(flash.memory());
  axis.Change(1, 100);
  axis.Save();
  const Values older = axis.Stored();
  axis.Change(2, 100);
  axis.Save();
  for (size_t at = kSetSpace; at < kSetSpace + STORE_SET_BYTES; ++at) {
    flash.Flip(at, static_cast<int>(at % 8));
    const Axis next(flash.memory());
    ASSERT_EQ(next.Stored(), older) << at;
    ASSERT_EQ(next.State(), AXIS_STORE_STATE_LOADED_OLDER) << at;
    flash.Flip(at, static_cast<int>(at % 8));
  }
  EXPECT_EQ(Axis(flash.memory()).Stored(), axis.Stored());
}

// A bit that changes where nothing was programmed: the set in force is whole, what comes next goes
// behind the damage or into the other sector.
TEST(Store, ABitThatChangesInBlankMemoryCostsNoValue) {
  for (size_t at = kSetSpace; at < 2 * STORE_SECTOR_MIN; at += 61) {
    Flash flash;
    Axis axis(flash.memory());
    axis.Change(1, 100);
    axis.Save();
    flash.Flip(at, static_cast<int>(at % 8));
    Axis next(flash.memory());
    ASSERT_EQ(next.Stored(), axis.Stored()) << at;
    // The first word of 16 bytes alone can only be the begin of a record that is no set.
    const bool is_single = at < Flash::kSector && at % 16 < 4;
    ASSERT_EQ(next.State(), is_single ? AXIS_STORE_STATE_LOADED : AXIS_STORE_STATE_LOADED_OLDER)
        << at;
    next.Change(2, 100);
    next.Save();
    ASSERT_EQ(Axis(flash.memory()).Stored(), next.Stored()) << at;
    ASSERT_FALSE(flash.misused()) << at;
  }
}

// A reset of communication reads the set again, hours after it was loaded.
TEST(Store, ASetThatIsDamagedMeanwhileIsNotLoadedAgain) {
  Flash flash;
  fw_config_t config{};
  config.memory = flash.memory();
  config.node_id = 5;
  config.buses = 1;
  fw_t fw = poisoned<fw_t>();
  fw_init(&fw, &config);
  const auto read = [&](uint16_t object) {
    int32_t value = 0;
    EXPECT_EQ(fw_object_read(&fw, object, &value), FW_OK);
    return value;
  };
  const axis_inputs_t inputs{0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
  axis_outputs_t outputs;
  const auto tick = [&](int ticks) {
    for (int i = 0; i < ticks; ++i) fw_tick(&fw, &inputs, &outputs);
  };
  constexpr uint16_t kTime = AXIS_OBJ_PRODUCER_HEARTBEAT_TIME;
  ASSERT_EQ(fw_object_write(&fw, FW_SOURCE_LOCAL, kTime, 77), FW_OK);
  ASSERT_EQ(fw_object_write(&fw, FW_SOURCE_LOCAL, AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
  tick(1000);
  ASSERT_EQ(read(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_SAVED);
  const can_frame_t reset{0, 2, 0, {0x82, 0}};
  fw_can_receive(&fw, &reset);
  tick(2);
  ASSERT_EQ(read(kTime), 77) << "a sound set is loaded again";
  ASSERT_EQ(read(AXIS_OBJ_ERROR_HISTORY_COUNT), 0);
  const uint32_t entry = EntryOf(kTime, 0).first;
  size_t at = RECORD_HEAD_BYTES;
  const auto word = [&](size_t from) {
    return static_cast<uint32_t>(flash.bytes()[from] | flash.bytes()[from + 1] << 8 |
                                 flash.bytes()[from + 2] << 16);
  };
  while (word(at) != entry) at += ENTRY_BYTES;
  flash.Flip(at + 4, 6);  // the value
  fw_can_receive(&fw, &reset);
  tick(2);
  EXPECT_EQ(read(kTime), axis_objects[kTime].initial);
  EXPECT_EQ(read(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_FAILED);
  EXPECT_EQ(read(AXIS_OBJ_ERROR_HISTORY_1), 0x5530 | AXIS_STORE_STATE_FAILED << 16);
}

}  // namespace
