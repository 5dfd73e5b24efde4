// Saving, loading, forgetting, and what is refused meanwhile.

#include <gtest/gtest.h>

#include <cstdint>

#include "tests/unit/store_fixture.hpp"

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
  const axis_inputs_t inputs{0, {0, 0}, AXIS_DIN_ENABLE, 1};
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

}  // namespace
