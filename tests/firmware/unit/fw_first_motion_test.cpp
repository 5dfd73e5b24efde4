// The test before the first motion, as the buses see it. Here the axis never moves: the loop tests
// have the plants.

#include <gtest/gtest.h>

#include "tests/firmware/unit/fw_fixture.hpp"

namespace {

class FwFirstMotion : public Fw {
 protected:
  // Enabled by this way, with the test just begun.
  void Begin(Way way) {
    PowerUp();
    ASSERT_TRUE(Acquires(way));
    ASSERT_EQ(Write(way, AXIS_OBJ_FIRST_MOTION_TEST, 1), 0u);
    ASSERT_EQ(Write(way, AXIS_OBJ_MODES_OF_OPERATION, AXIS_MODES_OF_OPERATION_OPEN_LOOP), 0u);
    ASSERT_EQ(Write(way, AXIS_OBJ_OPEN_LOOP_CODE, kCode), 0u);
    ASSERT_EQ(Write(way, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
    ASSERT_EQ(Write(way, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
    ASSERT_EQ(Inner(AXIS_OBJ_FIRST_MOTION_RESULT), AXIS_FIRST_MOTION_RESULT_RUNNING);
    Emergencies();
  }

  // Ticks until the test puts a code out.
  void UntilItMoves() {
    for (int i = 0; i < 400 && outputs_.dac_code == 0; ++i) Tick();
    ASSERT_LT(outputs_.dac_code, 0);
    Emergencies();
  }
};

TEST_F(FwFirstMotion, AnAxisThatDoesNotMoveIsReportedByEveryBus) {
  for (Way way : kWays) {
    Begin(way);
    for (int i = 0; i < 2000 && Inner(AXIS_OBJ_FAULT) == 0; ++i) {
      EXPECT_EQ(Inner(AXIS_OBJ_STATUSWORD) & 0x6F, 0x23) << "switched on, tick " << i;
      EXPECT_LE(0, outputs_.dac_code + 100) << "the user's code is " << kCode;
      EXPECT_LE(outputs_.dac_code, 0);
      ASSERT_EQ(Write(way, AXIS_OBJ_WATCHDOG, 1000), 0u);  // the owner is there
      Tick();
    }
    EXPECT_TRUE(IsOff());
    Tick(2);
    ExpectNamed(AXIS_FAULT_NO_MOTION, 0x7121);
    for (Way reader : kWays) {
      EXPECT_EQ(Read(reader, AXIS_OBJ_FIRST_MOTION_RESULT), AXIS_FIRST_MOTION_RESULT_NO_MOTION);
      EXPECT_EQ(Read(reader, AXIS_OBJ_FIRST_MOTION_CODE_REACHED), 0xFFFFu & -100);
      EXPECT_EQ(Read(reader, AXIS_OBJ_FIRST_MOTION_MOVED), 0u);
    }
  }
}

// Everybody stops the test; who does not own the axis holds it by that.
TEST_F(FwFirstMotion, AStopByAnySourceActsInTheNextTick) {
  for (Way owner : kWays) {
    for (Way stopper : kWays) {
      Begin(owner);
      UntilItMoves();
      ASSERT_EQ(Write(stopper, AXIS_OBJ_CONTROLWORD, 0x02), 0u);
      Tick();
      EXPECT_TRUE(IsOff()) << "owner " << owner << " stopper " << stopper;
      EXPECT_EQ(Inner(AXIS_OBJ_FIRST_MOTION_RESULT), AXIS_FIRST_MOTION_RESULT_NOT_RUN);
      EXPECT_EQ(Inner(AXIS_OBJ_FAULT), 0);
      const bool is_other = SourceOf(stopper) != SourceOf(owner);
      EXPECT_EQ(CountEmergencies(0xFF08), is_other ? 1 : 0);
      if (is_other) {
        EXPECT_NE(Write(owner, AXIS_OBJ_CONTROLWORD, 0x0F), 0u) << "held";
      }
      Tick(100);
      EXPECT_TRUE(IsOff());
    }
  }
}

TEST_F(FwFirstMotion, TheEndOfTheOwnerActsInTheNextTick) {
  Begin(kCanopen);
  UntilItMoves();
  fw_can_bus(&fw_, CAN_BUS_OFF);
  Tick();
  EXPECT_TRUE(IsOff());
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_CAN_OFF);
}

// The owner cannot stretch the bounds of a test under way, nor what it judges by; afterwards, yes.
TEST_F(FwFirstMotion, ItsBoundsAreFrozenWhileItRuns) {
  Begin(kCanopen);
  const auto wide = [&] {
    return Write(kCanopen, AXIS_OBJ_FIRST_MOTION_CODE, 102) == 0 ||
           Write(kCanopen, AXIS_OBJ_FIRST_MOTION_COUNTS, 100) == 0 ||
           Write(kCanopen, AXIS_OBJ_FIRST_MOTION_SPEED, 100) == 0 ||
           Write(kCanopen, AXIS_OBJ_FORCE_TARE, 100) == 0 ||
           Write(kCanopen, AXIS_OBJ_CONTACT_FORCE, 6000) == 0;
  };
  EXPECT_FALSE(wide());
  UntilItMoves();
  EXPECT_FALSE(wide());
  for (int i = 0; i < 600; ++i) {
    Tick();
    ASSERT_GE(outputs_.dac_code, -100);
    if (i % 50 == 0) {
      ASSERT_EQ(Write(kCanopen, AXIS_OBJ_WATCHDOG, 1000), 0u);
    }
  }
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_NO_MOTION);
  EXPECT_TRUE(wide());
}

// Nobody acquires the axis, and no parameter of a disabled axis is written, while it is tested.
TEST_F(FwFirstMotion, TheAxisCountsAsEnabled) {
  Begin(kCanopen);
  EXPECT_FALSE(Acquires(kLcm));
  EXPECT_NE(Write(kCanopen, AXIS_OBJ_FORCE_SIGN, -1), 0u);
  EXPECT_NE(Write(kCanopen, AXIS_OBJ_FIRST_MOTION_TEST, 0), 0u);
  EXPECT_NE(Write(kCanopen, AXIS_OBJ_STORE_PARAMETERS, 1), 0u);
  UntilItMoves();
  EXPECT_FALSE(Acquires(kLcm));
  EXPECT_NE(Write(kCanopen, AXIS_OBJ_FORCE_SIGN, -1), 0u);
}

}  // namespace
