#include <gtest/gtest.h>

#include <cstring>
#include <string>

#include "firmware/objects/generated/axis_objects_meta.h"
#include "tests/firmware/unit/axis_fixture.hpp"

namespace {

class Objects : public AxisFixture {
 protected:
  static bool IsOfAxis(const axis_object_meta_t &meta) {
    const std::string part = meta.part;
    return part == "axis" || part == "recorder";
  }
};

TEST_F(Objects, MetadataAndDescriptorsAgree) {
  ASSERT_EQ(AXIS_OBJECTS_META_COUNT + 1, AXIS_OBJ_COUNT);
  EXPECT_EQ(std::strlen(AXIS_OBJECTS_HASH), 64u);
  for (int i = 0; i < AXIS_OBJECTS_META_COUNT; ++i) {
    const axis_object_meta_t &meta = axis_objects_meta[i];
    const axis_object_t &entry = axis_objects[i + 1];
    EXPECT_EQ(meta.object, i + 1);
    EXPECT_EQ(static_cast<int32_t>(meta.min), entry.min) << meta.name;
    EXPECT_EQ(static_cast<int32_t>(meta.max), entry.max) << meta.name;
    EXPECT_EQ(std::string(meta.access) == "ro", entry.access == AXIS_ACCESS_RO) << meta.name;
    EXPECT_GT(meta.scale, 0) << meta.name;
    const bool made_at_power_up =
        entry.node_id != 0 || i + 1 == AXIS_OBJ_OBJECT_TABLE_HASH || i + 1 == AXIS_OBJ_NODE_ID;
    if (entry.access != AXIS_ACCESS_WO && !made_at_power_up) {
      EXPECT_EQ(Read(meta.object), static_cast<int32_t>(meta.initial)) << meta.name;
    }
  }
}

// Neither bound is refused, one beyond either is, and nothing is clipped.
TEST_F(Objects, RangesAreEnforcedAtBothRails) {
  for (int i = 0; i < AXIS_OBJECTS_META_COUNT; ++i) {
    const axis_object_meta_t &meta = axis_objects_meta[i];
    if (std::string(meta.access) != "rw") continue;
    PowerUp();
    const int32_t before = Read(meta.object);
    const bool is_unsigned = std::string(meta.type) == "u32";
    const int64_t lowest = is_unsigned ? 0 : INT32_MIN,
                  highest = is_unsigned ? UINT32_MAX : INT32_MAX;
    if (meta.min > lowest) {
      EXPECT_EQ(Write(meta.object, static_cast<int32_t>(meta.min - 1)), FW_ERROR_RANGE)
          << meta.name;
      EXPECT_EQ(Write(meta.object, static_cast<int32_t>(lowest)), FW_ERROR_RANGE) << meta.name;
    }
    if (meta.max < highest) {
      EXPECT_EQ(Write(meta.object, static_cast<int32_t>(meta.max + 1)), FW_ERROR_RANGE)
          << meta.name;
      EXPECT_EQ(Write(meta.object, static_cast<int32_t>(highest)), FW_ERROR_RANGE) << meta.name;
    }
    EXPECT_EQ(Read(meta.object), before) << meta.name;
    if (!IsOfAxis(meta)) continue;  // drive and CANopen have rules of their own
    const std::string name = meta.name;
    const bool names_object =
        name.find("recorder_signal") == 0 || name == "recorder_trigger_source";
    for (int64_t bound : {meta.min, meta.max}) {
      if (names_object && bound != 0) continue;
      EXPECT_EQ(Write(meta.object, static_cast<int32_t>(bound)), FW_OK) << meta.name;
      EXPECT_EQ(Read(meta.object), static_cast<int32_t>(bound)) << meta.name;
    }
  }
}

TEST_F(Objects, AWriteTouchesNothingElse) {
  for (int i = 0; i < AXIS_OBJECTS_META_COUNT; ++i) {
    const axis_object_meta_t &meta = axis_objects_meta[i];
    if (std::string(meta.access) != "rw" || !IsOfAxis(meta)) continue;
    PowerUp();
    const auto value =
        static_cast<int32_t>(meta.min == meta.initial ? meta.initial + 1 : meta.initial - 1);
    if (Write(meta.object, value) != FW_OK) continue;
    for (int j = 0; j < AXIS_OBJECTS_META_COUNT; ++j) {
      const axis_object_meta_t &other = axis_objects_meta[j];
      if (j == i || std::string(other.access) == "wo" || !IsOfAxis(other)) continue;
      ASSERT_EQ(Read(other.object), static_cast<int32_t>(other.initial))
          << meta.name << " changed " << other.name;
    }
  }
}

TEST_F(Objects, NoSuchObject) {
  int32_t value = 0;
  for (int object : {0, static_cast<int>(AXIS_OBJ_COUNT), 65535}) {
    EXPECT_EQ(fw_object_read(&fw_, static_cast<uint16_t>(object), &value), FW_ERROR_NO_OBJECT);
    EXPECT_EQ(Write(static_cast<uint16_t>(object), 0), FW_ERROR_NO_OBJECT);
  }
}

TEST_F(Objects, SignalsAndCommands) {
  int32_t value = 0;
  EXPECT_EQ(Write(AXIS_OBJ_POSITION, 1), FW_ERROR_READ_ONLY);
  EXPECT_EQ(Write(AXIS_OBJ_FAULT, 0), FW_ERROR_READ_ONLY);
  EXPECT_EQ(fw_object_read(&fw_, AXIS_OBJ_FAULT_RESET, &value), FW_ERROR_WRITE_ONLY);
  EXPECT_EQ(fw_object_read(&fw_, AXIS_OBJ_RECORDER_ARM, &value), FW_ERROR_WRITE_ONLY);
  EXPECT_EQ(Write(AXIS_OBJ_FAULT_RESET, 0), FW_ERROR_RANGE);
  EXPECT_EQ(Write(AXIS_OBJ_FAULT_RESET, 2), FW_ERROR_RANGE);
}

TEST_F(Objects, SomeAreOnlyWritableWhileDisabled) {
  StartForce();
  for (uint16_t object :
       {AXIS_OBJ_ADC_BITS, AXIS_OBJ_FORCE_ZERO_CODE, AXIS_OBJ_FORCE_SIGN, AXIS_OBJ_LATENCY_TICKS}) {
    EXPECT_EQ(Write(object, Read(object)), FW_ERROR_STATE) << object;
  }
  EXPECT_EQ(Write(AXIS_OBJ_ADC_BITS, 99), FW_ERROR_RANGE);
  EXPECT_EQ(Write(AXIS_OBJ_FORCE_TARE, 5), FW_OK);
  Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
  EXPECT_EQ(Write(AXIS_OBJ_ADC_BITS, 12), FW_ERROR_STATE) << "still active until the next tick";
  Tick();
  EXPECT_EQ(Write(AXIS_OBJ_ADC_BITS, 12), FW_OK);
}

TEST_F(Objects, ForceSignZeroIsNoSign) {
  EXPECT_EQ(Write(AXIS_OBJ_FORCE_SIGN, 0), FW_ERROR_RANGE);
  EXPECT_EQ(Write(AXIS_OBJ_FORCE_SIGN, -1), FW_OK);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_SIGN), -1);
}

TEST_F(Objects, SoftLimitsDoNotCross) {
  Set(AXIS_OBJ_POSITION_MAX, 100);
  Set(AXIS_OBJ_POSITION_MIN, -100);
  EXPECT_EQ(Write(AXIS_OBJ_POSITION_MIN, 101), FW_ERROR_RANGE);
  EXPECT_EQ(Write(AXIS_OBJ_POSITION_MAX, -101), FW_ERROR_RANGE);
  EXPECT_EQ(Write(AXIS_OBJ_POSITION_MIN, 100), FW_OK);
}

TEST_F(Objects, ASoftWindowMovesWhereverTheSetpointIs) {
  Set(AXIS_OBJ_POSITION_MAX, 200);
  Set(AXIS_OBJ_POSITION_MIN, 100);
  Set(AXIS_OBJ_POSITION_SETPOINT, 150);
  EXPECT_EQ(Write(AXIS_OBJ_POSITION_MAX, -100), FW_ERROR_RANGE) << "would cross the lower one";
  Set(AXIS_OBJ_POSITION_MIN, -200);
  Set(AXIS_OBJ_POSITION_MAX, -100);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_SETPOINT), 150);
  Set(AXIS_OBJ_POSITION_MAX, 200);
  Set(AXIS_OBJ_POSITION_MIN, 100);
}

// Set-point first or limit first: neither is refused, and the axis stops at the limit.
TEST_F(Objects, TheAxisStopsAtASoftLimitBeforeTheSetpoint) {
  for (bool limit_first : {false, true}) {
    PowerUp();
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    Set(AXIS_OBJ_POSITION_GAIN, 256);
    if (limit_first) Set(AXIS_OBJ_POSITION_MAX, 100);
    Set(AXIS_OBJ_POSITION_SETPOINT, 150);
    if (!limit_first) Set(AXIS_OBJ_POSITION_MAX, 100);
    Set(AXIS_OBJ_MODE, AXIS_MODE_POSITION);
    EXPECT_EQ(TickPosition(100), 50);
    EXPECT_EQ(TickPosition(101), 0);
    EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), AXIS_LIMIT_REASON_POSITION_MAX);
    Set(AXIS_OBJ_POSITION_SETPOINT, 90);
    EXPECT_EQ(TickPosition(101), -11) << "the way back is open";
  }
}

TEST_F(Objects, U32TravelsAsTheSameBits) {
  fw_.axis.signals.tick_count = 0xFFFFFFFEu;
  Tick();
  EXPECT_EQ(Read(AXIS_OBJ_TICK_COUNT), -1);
}

}  // namespace
