#include <gtest/gtest.h>

#include <map>
#include <string>
#include <vector>

#include "firmware/objects/generated/axis_objects_meta.h"
#include "tests/firmware/unit/cia402_fixture.hpp"

extern "C" {
#include "firmware/drive/modes.h"
}

// The state machine against CiA 402's own tables, typed from the standard's figures: commands as
// patterns of the controlword's bits 7, 3, 2, 1, 0, and for each state what a command does.

namespace {

enum Command { kNone, kShutdown, kSwitchOn, kEnable, kDisableVoltage, kQuickStop };

struct Pattern {
  Command command;
  const char *bits;  // bits 7, 3, 2, 1, 0; x is either
};

// "Switch on" and "enable operation" differ by bit 3.
const Pattern kPatterns[] = {
    {kShutdown, "0x110"},       {kSwitchOn, "00111"},  {kEnable, "01111"},
    {kDisableVoltage, "0xx0x"}, {kQuickStop, "0x01x"},
};

Command CommandOf(int controlword) {
  const int bit[5] = {7, 3, 2, 1, 0};
  for (const Pattern &pattern : kPatterns) {
    bool fits = true;
    for (int i = 0; i < 5; ++i) {
      const char want = pattern.bits[i];
      fits = fits && (want == 'x' || (want == '1') == (((controlword >> bit[i]) & 1) != 0));
    }
    if (fits) {
      return pattern.command;
    }
  }
  return kNone;
}

// NR not ready, SD switch on disabled, RS ready to switch on, SO switched on, OE operation
// enabled, QS quick stop active, FR fault reaction active, FA fault.
enum Reached { NR, SD, RS, SO, OE, QS, FR, FA };

//                       none shutdown switch-on enable disable-voltage quick-stop
const Reached kNext[8][6] = {{NR, NR, NR, NR, NR, NR},   // NR
                             {SD, RS, SD, SD, SD, SD},   // SD
                             {RS, RS, SO, OE, SD, SD},   // RS
                             {SO, RS, SO, OE, SD, SD},   // SO
                             {OE, RS, SO, OE, SD, QS},   // OE
                             {QS, QS, QS, QS, SD, QS},   // QS, option below 5
                             {FR, FR, FR, FR, FR, FR},   // FR
                             {FA, FA, FA, FA, FA, FA}};  // FA, but for the edge of bit 7

class DriveState : public DriveFixture {
 protected:
  // Enters a state by the transitions that lead there.
  void Reach(Reached state) {
    PowerUp();
    Set(AXIS_OBJ_MODES_OF_OPERATION, 1);
    Tick();
    switch (state) {
      case NR:
        fw_.drive.signals.drive_state = AXIS_DRIVE_STATE_NOT_READY;
        break;
      case SD:
        break;
      case RS:
        Control(6);
        break;
      case SO:
        Control(6);
        Control(7);
        break;
      case OE:
        Control(6);
        Control(15);
        Tick();
        break;
      case QS:
        Control(6);
        Control(15);
        Tick();
        Control(2);
        break;
      case FR:
        Set(AXIS_OBJ_FAULT_REACTION_OPTION, 1);
        Control(6);
        Control(15);
        Tick();
        cia402_owner_lost(&fw_.drive, &fw_.axis, AXIS_FAULT_SOURCE_LOST);
        break;
      case FA:
        inputs_.sensor_valid = 0;
        Tick();
        inputs_.sensor_valid = 1;
        break;
    }
    ASSERT_EQ(State(), state);
  }
};

TEST_F(DriveState, EveryControlwordInEveryState) {
  int taken = 0;
  for (int state = NR; state <= FA; ++state) {
    Reach(static_cast<Reached>(state));
    const fw_t reached = fw_;
    for (int controlword = 0; controlword <= 0xFFFF; ++controlword) {
      fw_ = reached;
      const int before = fw_.drive.params.controlword;
      int expected = kNext[state][CommandOf(controlword)];
      if (state == FA && (controlword & 0x80) != 0 && (before & 0x80) == 0) {
        expected = SD;
      }
      ASSERT_EQ(Write(AXIS_OBJ_CONTROLWORD, controlword), FW_OK);
      ASSERT_EQ(State(), expected) << "state " << state << " controlword " << controlword;
      // The statusword agrees, by mask and value.
      const int mask[8] = {0x4F, 0x4F, 0x6F, 0x6F, 0x6F, 0x6F, 0x4F, 0x4F};
      const int value[8] = {0x00, 0x40, 0x21, 0x23, 0x27, 0x07, 0x0F, 0x08};
      ASSERT_EQ(Status() & mask[expected], value[expected]);
      taken += expected != state;
    }
  }
  EXPECT_GT(taken, 0);
}

TEST_F(DriveState, AFaultIsResetByTheEdgeOnly) {
  for (int controlword = 0x80; controlword <= 0xFFFF; ++controlword) {
    if ((controlword & 0x80) == 0) {
      continue;
    }
    Reach(FA);
    Control(0x80);
    ASSERT_EQ(State(), SD);
    Control(0x80);
    inputs_.sensor_valid = 0;
    Tick();
    inputs_.sensor_valid = 1;
    ASSERT_EQ(State(), FA);
    Control(controlword);
    ASSERT_EQ(State(), FA) << controlword;
    controlword += 1021;
  }
  Control(0x00);
  EXPECT_EQ(State(), FA);
  Control(0x80);
  EXPECT_EQ(State(), SD);
  EXPECT_EQ(Read(AXIS_OBJ_ERROR_CODE), 0);
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
}

TEST_F(DriveState, AFaultThatLastsComesBack) {
  Reach(FA);
  inputs_.sensor_valid = 0;
  Control(0x80);
  EXPECT_EQ(State(), SD);
  Tick();
  EXPECT_EQ(State(), FA);
  EXPECT_EQ(Read(AXIS_OBJ_ERROR_CODE), 0x7305);
}

TEST_F(DriveState, TheNativeResetWorksToo) {
  Reach(FA);
  Set(AXIS_OBJ_FAULT_RESET, 1);
  EXPECT_EQ(State(), SD);
  Tick();
  EXPECT_EQ(State(), SD);
}

TEST_F(DriveState, QuickStopResumesWithOptions5And6) {
  for (const int option : {5, 6}) {
    Reach(OE);
    Set(AXIS_OBJ_QUICK_STOP_OPTION, option);
    Tick();
    Control(2);
    Tick(100);
    EXPECT_EQ(State(), QS);
    EXPECT_EQ(outputs_.amp_enable, 1);
    Control(6);
    EXPECT_EQ(State(), QS);
    Control(15);
    EXPECT_EQ(State(), OE);
  }
}

TEST_F(DriveState, QuickStopIsReportedAndEndsByItself) {
  for (const int option : {1, 2}) {
    Reach(OE);
    Set(AXIS_OBJ_QUICK_STOP_OPTION, option);
    Tick(3);
    Control(2);
    EXPECT_EQ(State(), QS);
    Tick();
    EXPECT_EQ(State(), QS);
    Tick();
    EXPECT_EQ(State(), SD);
  }
  Reach(OE);
  Set(AXIS_OBJ_QUICK_STOP_OPTION, 0);
  Tick();
  Control(2);
  EXPECT_EQ(State(), SD);
}

TEST_F(DriveState, NotReadyEndsByItself) {
  Reach(NR);
  Tick();
  EXPECT_EQ(State(), SD);
}

TEST_F(DriveState, ALostOwnerActsAsTheOptionSays) {
  const struct {
    int option, state, later, fault;
  } rows[] = {{0, OE, OE, AXIS_FAULT_NONE},
              {1, FA, FA, AXIS_FAULT_SOURCE_LOST},
              {2, SD, SD, AXIS_FAULT_NONE},
              {3, QS, SD, AXIS_FAULT_NONE}};
  for (const auto &row : rows) {
    Reach(OE);
    Set(AXIS_OBJ_ABORT_CONNECTION_OPTION, row.option);
    Tick(3);
    cia402_owner_lost(&fw_.drive, &fw_.axis, AXIS_FAULT_SOURCE_LOST);
    EXPECT_EQ(State(), row.state) << row.option;
    Tick(2);
    EXPECT_EQ(State(), row.later) << row.option;
    EXPECT_EQ(Read(AXIS_OBJ_FAULT), row.fault) << row.option;
    EXPECT_EQ(Read(AXIS_OBJ_ERROR_CODE), row.fault == AXIS_FAULT_NONE ? 0 : 0x6010);
    EXPECT_EQ(outputs_.amp_enable, row.later == OE);
  }
  // No effect in states that are not enabled.
  for (const Reached state : {SD, RS, SO}) {
    Reach(state);
    cia402_owner_lost(&fw_.drive, &fw_.axis, AXIS_FAULT_SOURCE_LOST);
    Tick();
    EXPECT_EQ(State(), state);
  }
}

// Bits 12 and 13 of the statusword have a name in the object table in the modes that set them
// alone.
TEST_F(DriveState, TheTableNamesBitsOfTheModesThatHaveThem) {
  std::map<int, int> named;
  for (const axis_object_bit_t &bit : axis_object_bits) {
    if (bit.object != AXIS_OBJ_STATUSWORD || (bit.bit != 12 && bit.bit != 13)) continue;
    for (int mode = -16; mode < 16; ++mode)
      if ((bit.modes >> (mode + 16) & 1) != 0) named[mode] |= 1 << bit.bit;
  }
  for (int row = 0; row < CIA402_MODES; ++row) {
    const int mode = row - CIA402_MODE_OFFSET;
    EXPECT_EQ(named.count(mode) != 0, cia402_modes[row].bits != nullptr) << mode;
  }
}

TEST_F(DriveState, EveryFaultHasItsCode) {
  const int codes[] = {0,      0x7305, 0xFF05, 0x7300, 0x8612, 0x7310, 0xFF06, 0x8611,
                       0x8130, 0x6010, 0x8140, 0x8250, 0x6100, 0xFF0A, 0xFF0B, 0xFF0C,
                       0xFF0D, 0xFF0E, 0xFF0F, 0x7121, 0xFF10, 0xFF11, 0xFF12, 0xFF14,
                       0xFF15, 0xFF16, 0xFF1A, 0xFF1E, 0xFF1B, 0xFF1D, 0x5200, 0x5100,
                       0x5220, 0x5210, 0xFF1F, 0xFF20, 0xFF21, 0xFF22, 0xFF23};
  ASSERT_EQ(std::size(codes), static_cast<size_t>(AXIS_FAULT_COUNT));
  for (int fault = 1; fault < AXIS_FAULT_COUNT; ++fault) {
    Reach(OE);
    Tick();
    axis_fault(&fw_.axis, static_cast<uint8_t>(fault));
    Tick();
    EXPECT_EQ(State(), FA);
    EXPECT_EQ(Read(AXIS_OBJ_ERROR_CODE), codes[fault]);
    EXPECT_EQ(Read(AXIS_OBJ_FAULT), fault);
  }
}

TEST_F(DriveState, TheEnableChainShowsAsVoltageAndItsLossAsAFault) {
  Reach(OE);
  Tick(2);
  EXPECT_EQ(Status() & 0x10, 0x10);
  inputs_.din = AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE | AXIS_DIGITAL_INPUTS_INDEX;
  Tick();
  EXPECT_EQ(State(), FA);
  EXPECT_EQ(Status() & 0x10, 0);
  Tick();
  EXPECT_EQ(Read(AXIS_OBJ_DRIVE_INPUTS), 0x20001);
  inputs_.din =
      AXIS_DIGITAL_INPUTS_ENABLE | AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE | AXIS_DIGITAL_INPUTS_HOME;
  Tick(2);
  EXPECT_EQ(Read(AXIS_OBJ_DRIVE_INPUTS), 0x10006);
}

TEST_F(DriveState, TheNativeModeMovesTheState) {
  const struct {
    int native, operation;
  } rows[] = {{AXIS_MODE_FORCE, -1},
              {AXIS_MODE_OPEN_LOOP, -2},
              {AXIS_MODE_EXCITATION, -3},
              {AXIS_MODE_POSITION, -4}};
  for (const auto &row : rows) {
    Reach(SD);
    Set(AXIS_OBJ_MODE, row.native);
    EXPECT_EQ(State(), OE);
    EXPECT_EQ(Mode(), row.operation);
    Tick();
    EXPECT_EQ(outputs_.amp_enable, 1);
    EXPECT_EQ(Read(AXIS_OBJ_ACTIVE_MODE), row.native);
    Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
    EXPECT_EQ(State(), SD);
    Tick();
    EXPECT_EQ(outputs_.amp_enable, 0);
  }
}

// What verdicts take for the force that was asked for: 6071h and 60B2h in modes 4 and 10 (CiA 402),
// force_setpoint in mode -1. Modes that are added below -8 state their own.
TEST(DriveModes, EachHoldsTheForceOfItsSetPoint) {
  for (int mode = -8; mode <= AXIS_MODES_OF_OPERATION_GREATEST; ++mode) {
    if (!cia402_mode_exists(mode)) continue;
    const cia402_mode_t &row = cia402_modes[mode + CIA402_MODE_OFFSET];
    const int holds = (mode == 4 || mode == 10) ? CIA402_HOLDS_TARGET
                      : (mode == -1)            ? CIA402_HOLDS_SETPOINT
                                                : CIA402_HOLDS_NONE;
    EXPECT_EQ(row.holds, holds) << mode;
    EXPECT_TRUE(row.holds == CIA402_HOLDS_NONE || row.controls_force != 0) << mode;
  }
}

TEST_F(DriveState, ADriveThatWakesControlsTheAxis) {
  fw_ = fw_t{};
  const fw_config_t config{};
  fw_init(&fw_, &config);
  Set(AXIS_OBJ_OPEN_LOOP_CODE, 40);
  Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  fw_tick(&fw_, &inputs_, &outputs_);
  ASSERT_EQ(fw_.live, 0);
  Set(AXIS_OBJ_TARGET_POSITION, 5);
  ASSERT_EQ(fw_.live, 1);
  EXPECT_EQ(State(), OE);
  EXPECT_EQ(Mode(), -2);
  fw_tick(&fw_, &inputs_, &outputs_);
  EXPECT_EQ(outputs_.amp_enable, 1);
}

TEST_F(DriveState, UnsupportedValuesAreRefused) {
  for (const int mode : {2, 5, 7}) {
    EXPECT_EQ(Write(AXIS_OBJ_MODES_OF_OPERATION, mode), FW_ERROR_RANGE) << mode;
  }
  for (const int option : {3, 4}) {
    EXPECT_EQ(Write(AXIS_OBJ_QUICK_STOP_OPTION, option), FW_ERROR_RANGE);
  }
  for (const int method : {1, 34, 36}) {
    EXPECT_EQ(Write(AXIS_OBJ_HOMING_METHOD, method), FW_ERROR_RANGE);
  }
  EXPECT_EQ(Write(AXIS_OBJ_POLARITY, 0x20), FW_ERROR_RANGE);
  Set(AXIS_OBJ_POSITION_LIMIT_MAX, 10);
  EXPECT_EQ(Write(AXIS_OBJ_POSITION_LIMIT_MIN, 11), FW_ERROR_RANGE);
  Set(AXIS_OBJ_POSITION_LIMIT_MIN, -10);
  EXPECT_EQ(Write(AXIS_OBJ_POSITION_LIMIT_MAX, -11), FW_ERROR_RANGE);
}

}  // namespace
