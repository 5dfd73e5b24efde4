// Supervision of the force sensor: which tick acts, both signs, every width of the ADC, and what is
// no finding. Windows are worked out by hand: 10 ms are 15 ticks.
#include <string>

#include "tests/firmware/unit/firmware_fixture.hpp"

namespace {

class Sensor : public FirmwareFixture {
 protected:
  static constexpr int kNone = AXIS_FAULT_NONE;

  // A force mode is on, with this reading; law: 5 codes per count, or of another gain.
  void PowerUp(int bits = 8, int zero_code = 0, int setpoint_count = 30, int code = 0) {
    fw_ = fw_t{};
    const fw_config_t config{};
    fw_init(&fw_, &config);
    inputs_ = {1000, {static_cast<uint16_t>(code), 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
    Set(AXIS_OBJ_ADC_BITS, bits);
    Set(AXIS_OBJ_FORCE_ZERO_CODE, zero_code);
    Set(AXIS_OBJ_FORCE_GAIN, 5 * 256);
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    Set(AXIS_OBJ_FORCE_SETPOINT, setpoint_count * 256);
    Set(AXIS_OBJ_CONTROLWORD, 0);  // wakes the drive
  }

  void Enable(int mode = AXIS_MODES_OF_OPERATION_FORCE_COUNTS) {
    Set(AXIS_OBJ_MODES_OF_OPERATION, mode);
    Tick();
    for (int word : {0x06, 0x07, 0x0F}) Set(AXIS_OBJ_CONTROLWORD, word);
    Tick(4);
    ASSERT_EQ(fw_.drive.signals.drive_state, AXIS_DRIVE_STATE_OPERATION_ENABLED);
    ASSERT_EQ(Fault(), kNone);
  }

  int Fault() const { return fw_.axis.signals.fault; }

  // One tick with this reading and place; the fault, whose outputs are off.
  int Step(int code, int place = 1000) {
    inputs_.adc_code[0] = static_cast<uint16_t>(code);
    inputs_.encoder_cnt = place;
    Tick();
    if (Fault() != kNone) {
      EXPECT_EQ(outputs_.dac_code, 0);
      EXPECT_EQ(outputs_.amp_enable, 0);
      EXPECT_EQ(outputs_.brake_release, 0);
    }
    return Fault();
  }

  // The tick, from 1, in which a fault answers to this reading and place, at most `most`; or 0.
  int TicksToFault(int code, int most, int place = 1000) {
    for (int tick = 1; tick <= most; ++tick) {
      if (Step(code, place) != kNone) return tick;
    }
    return 0;
  }
};

TEST_F(Sensor, IsNotSupervisedByDefault) {
  PowerUp(8, 128);
  Enable();
  for (int code : {0, 255, 0, 255}) EXPECT_EQ(TicksToFault(code, 200), 0);
  for (int i = 0; i < 200; ++i) ASSERT_EQ(Step(200, 1000 + 100 * i), kNone);
}

TEST_F(Sensor, RailedIsAFaultInTheLastTickOfItsTime) {
  for (int bits = 8; bits <= 16; ++bits) {
    const int middle = 1 << (bits - 1);
    for (int rail : {0, (1 << bits) - 1}) {
      SCOPED_TRACE(std::to_string(bits) + " bits, code " + std::to_string(rail));
      PowerUp(bits, middle, 30, middle);
      Set(AXIS_OBJ_FORCE_RAILED_TIME, 10);
      Enable();
      EXPECT_EQ(TicksToFault(rail, 14), 0);
      EXPECT_EQ(Step(middle), kNone);
      EXPECT_EQ(TicksToFault(rail == 0 ? 1 : rail - 1, 40), 0);
      EXPECT_EQ(TicksToFault(rail, 40), 15);
      EXPECT_EQ(Fault(), AXIS_FAULT_FORCE_RAILED);
      EXPECT_EQ(Read(AXIS_OBJ_ERROR_CODE), 0xFF1A);
      EXPECT_EQ(Read(AXIS_OBJ_STATUSWORD) & 0x4F, 0x08);
    }
  }
}

TEST_F(Sensor, TheShortestTimeIsTwoTicks) {
  PowerUp(8, 128, 30, 128);
  Set(AXIS_OBJ_FORCE_RAILED_TIME, 1);
  Enable();
  EXPECT_EQ(TicksToFault(255, 5), 2);
}

TEST_F(Sensor, TheLowerEndOfAnUnsignedReadingIsNoForce) {
  PowerUp(8, 0);
  Set(AXIS_OBJ_FORCE_RAILED_TIME, 10);
  Enable();
  EXPECT_EQ(TicksToFault(0, 100), 0);
  EXPECT_EQ(TicksToFault(255, 100), 15);
}

TEST_F(Sensor, AJumpIsAFaultInItsOwnTick) {
  for (int bits = 8; bits <= 16; ++bits) {
    const int count = 1 << (bits - 8);  // codes of an 8-bit count
    for (int sign : {1, -1}) {
      SCOPED_TRACE(std::to_string(bits) + " bits, sign " + std::to_string(sign));
      const int middle = 1 << (bits - 1);
      PowerUp(bits, middle, 30, middle);
      Set(AXIS_OBJ_FORCE_JUMP_MAX, 20 * 256);
      Enable();
      EXPECT_EQ(Step(middle + sign * 20 * count), kNone);
      EXPECT_EQ(Step(middle), kNone);
      EXPECT_EQ(Step(middle + sign * (20 * count + 1)), AXIS_FAULT_FORCE_JUMP);
      EXPECT_EQ(Read(AXIS_OBJ_ERROR_CODE), 0xFF1E);
    }
  }
}

TEST_F(Sensor, AJumpBeforeEnablingOrByTheTareIsNone) {
  PowerUp(8, 0, 30, 0);
  Set(AXIS_OBJ_FORCE_JUMP_MAX, 5 * 256);
  Set(AXIS_OBJ_MODES_OF_OPERATION, AXIS_MODES_OF_OPERATION_FORCE_COUNTS);
  for (int code : {0, 200, 0, 200}) EXPECT_EQ(Step(code), kNone);
  Enable();
  EXPECT_EQ(Step(200), kNone);
  Set(AXIS_OBJ_FORCE_TARE, 100 * 256);
  EXPECT_EQ(Step(200), kNone);
  EXPECT_EQ(Step(206), AXIS_FAULT_FORCE_JUMP);
}

TEST_F(Sensor, AReadingIsStuckWhereMotionInContactDoesNotChangeIt) {
  for (int way : {1, -1}) {
    for (int phase : {0, 1, 2, 3}) {
      SCOPED_TRACE(std::to_string(way) + ", phase " + std::to_string(phase));
      PowerUp(8, 0, 30, 28);
      Set(AXIS_OBJ_FORCE_STUCK_TRAVEL, 8);
      Enable();
      for (int i = 0; i < 10 + phase; ++i) ASSERT_EQ(Step(28), kNone);
      for (int i = 0; i < 10; ++i) ASSERT_EQ(Step(28, 1000 + 8 * way), kNone);
      EXPECT_LE(TicksToFault(28, 4, 1000 + 9 * way), 4);
      EXPECT_EQ(Fault(), AXIS_FAULT_FORCE_STUCK);
      EXPECT_EQ(Read(AXIS_OBJ_ERROR_CODE), 0xFF1B);
    }
  }
}

TEST_F(Sensor, AReadingThatChangesByOneCodeIsNotStuck) {
  for (int bits = 8; bits <= 16; ++bits) {
    const int held = 28 << (bits - 8);
    PowerUp(bits, 0, 30, held);
    Set(AXIS_OBJ_FORCE_STUCK_TRAVEL, 8);
    Enable();
    // 4 counts in a tick, and a code of change in every second one.
    for (int i = 0; i < 300; ++i) ASSERT_EQ(Step(held + (i / 2) % 2, 1000 + 4 * i), kNone) << i;
  }
}

TEST_F(Sensor, AHeldForceAndASlowWorkpieceAreNotStuck) {
  PowerUp(8, 0, 30, 28);
  Set(AXIS_OBJ_FORCE_STUCK_TRAVEL, 8);
  Set(AXIS_OBJ_FORCE_STUCK_TIME, 100);  // 150 ticks
  Enable();
  for (int i = 0; i < 20000; ++i) ASSERT_EQ(Step(28), kNone);
  for (int i = 0; i < 20000; ++i) ASSERT_EQ(Step(28, 1000 + i / 20), kNone);  // 7.5 in 150 ticks
  int moved = 0;
  while (Step(28, 2000 + moved / 15) == kNone && moved < 1000) ++moved;  // 10 in 150 ticks
  EXPECT_LT(moved, 1000);
  EXPECT_EQ(Fault(), AXIS_FAULT_FORCE_STUCK);
}

TEST_F(Sensor, MotionWithoutContactIsNotStuck) {
  PowerUp(8, 0, 30, 2);  // within contact_force
  Set(AXIS_OBJ_FORCE_STUCK_TRAVEL, 8);
  Enable();
  for (int i = 0; i < 500; ++i) ASSERT_EQ(Step(2, 1000 + 50 * i), kNone);
}

TEST_F(Sensor, ASensorIsDisconnectedWhereTheAxisPressesAndStandsWithoutContact) {
  for (int bits = 8; bits <= 16; ++bits) {
    for (int setpoint : {30, -30}) {
      for (int phase : {0, 1, 2, 3}) {
        SCOPED_TRACE(std::to_string(bits) + " bits, " + std::to_string(setpoint) + ", phase " +
                     std::to_string(phase));
        const int middle = 1 << (bits - 1);
        PowerUp(bits, middle, setpoint, middle);
        Set(AXIS_OBJ_FORCE_DISCONNECTED_CODE, 150);  // 5 codes per count
        Set(AXIS_OBJ_FORCE_DISCONNECTED_TIME, 10);
        Enable();
        for (int i = 0; i < 20 + phase; ++i) ASSERT_EQ(Step(middle, 1000 + 5 * i), kNone);
        EXPECT_EQ(outputs_.dac_code, 5 * setpoint);
        const int ticks = TicksToFault(middle, 40, 2000);
        EXPECT_GE(ticks, 15);
        EXPECT_LE(ticks, 20);
        EXPECT_EQ(Fault(), AXIS_FAULT_FORCE_DISCONNECTED);
        EXPECT_EQ(Read(AXIS_OBJ_ERROR_CODE), 0xFF1D);
      }
    }
  }
}

TEST_F(Sensor, ItIsNotDisconnectedBelowTheCodeInMotionOrInContact) {
  PowerUp(8, 0, 30, 0);
  Set(AXIS_OBJ_FORCE_DISCONNECTED_CODE, 151);  // the code is 150
  Set(AXIS_OBJ_FORCE_DISCONNECTED_TIME, 10);
  Enable();
  EXPECT_EQ(TicksToFault(0, 200), 0);
  Set(AXIS_OBJ_FORCE_DISCONNECTED_CODE, 50);
  EXPECT_EQ(TicksToFault(3, 200), 0);                                 // 135 codes, in contact
  for (int i = 0; i < 500; ++i) ASSERT_EQ(Step(0, 1000 + i), kNone);  // 15 in 15 ticks
  Set(AXIS_OBJ_FORCE_DISCONNECTED_TRAVEL, 20);
  int still = 0;
  while (Step(0, 1500 + still) == kNone && still < 200) ++still;
  EXPECT_LT(still, 25);
}

TEST_F(Sensor, TheReadingIsSupervisedWhereItGuidesTheAxis) {
  struct Case {
    int mode, homing_method;
    bool guided;
  };
  constexpr Case cases[] = {{1, 35, false},  {3, 35, false}, {8, 35, false}, {6, 35, false},
                            {-2, 35, false}, {6, -1, true},  {-5, 35, true}, {4, 35, true},
                            {10, 35, true},  {-1, 35, true}, {-6, 35, true}, {-7, 35, true},
                            {-8, 35, true}};
  for (const Case &c : cases) {
    SCOPED_TRACE("mode " + std::to_string(c.mode));
    PowerUp(8, 128, 0, 128);
    Set(AXIS_OBJ_POSITION_GAIN, 256);
    Set(AXIS_OBJ_FORCE_RAILED_TIME, 10);
    Set(AXIS_OBJ_HOMING_METHOD, c.homing_method);
    Enable(c.mode);
    const int ticks = TicksToFault(255, 40);
    EXPECT_EQ(ticks, c.guided ? 15 : 0);
  }
}

TEST_F(Sensor, AFaultThatIsLatchedStays) {
  PowerUp(8, 128, 30, 128);
  Set(AXIS_OBJ_FORCE_RAILED_TIME, 1);
  Set(AXIS_OBJ_FORCE_MAX, 50 * 256);
  Enable();
  EXPECT_EQ(Step(255), AXIS_FAULT_FORCE_MAX);
  EXPECT_EQ(TicksToFault(255, 1), 1);
  EXPECT_EQ(Fault(), AXIS_FAULT_FORCE_MAX);
}

}  // namespace
