// A partner that falls silent or disconnects, or sensors that fail, are detected in time.

#include <gtest/gtest.h>

#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "tests/firmware/unit/fw_fixture.hpp"

namespace {

TEST_F(Fw, ASupervisorThatIsKilledIsMissedByItsHeartbeat) {
  for (int ms : {1, 2, 10, 25, 100, 1000}) {
    PowerUp();
    WatchHeartbeat(ms);
    Drive();
    Send(0x77F, {5});
    EXPECT_EQ(TicksToOff(3000), TicksOf(ms) + 2) << ms << " ms";
    ExpectNamed(AXIS_FAULT_HEARTBEAT_LOST, 0x8130);
  }
}

TEST_F(Fw, AHeartbeatInTimeKeepsTheAxis) {
  WatchHeartbeat(10);
  Drive();
  for (int i = 0; i < 50; ++i) {
    Send(0x77F, {5});
    for (int k = 0; k < TicksOf(10); ++k) {
      Tick();
      ASSERT_TRUE(IsOn()) << i << ' ' << k;
    }
  }
}

TEST_F(Fw, AnRpdoThatStaysAway) {
  for (int ms : {1, 5, 20, 333}) {
    PowerUp();
    ASSERT_EQ(Download(kCanopen, 0x1400, 5, static_cast<uint32_t>(ms), 2), 0u);
    Send(0, {1, kNode});
    Drive();
    Send(0x205, {0x0F, 0x00, 0xFE});
    EXPECT_EQ(TicksToOff(1000), TicksOf(ms) + 2) << ms << " ms";
    ExpectNamed(AXIS_FAULT_PDO_TIMEOUT, 0x8250);
  }
}

// A master lost before its first RPDO: the deadline begins when the axis becomes active.
TEST_F(Fw, AnRpdoThatNeverCame) {
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  ASSERT_EQ(Download(kCanopen, 0x1400, 5, 20, 2), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_MODES_OF_OPERATION, AXIS_MODES_OF_OPERATION_OPEN_LOOP), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_OPEN_LOOP_CODE, kCode), 0u);
  Tick(500);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
  EXPECT_EQ(TicksToOff(100), TicksOf(20) + 2);
  ExpectNamed(AXIS_FAULT_PDO_TIMEOUT, 0x8250);
}

// On a chip the main loop calls fw_between(), which supervises the buses. Ticks that a late main
// loop misses are counted at its next call: the node's times stay exact.
TEST_F(Fw, AHeartbeatIsOnTimeHoweverLateTheMainLoop) {
  for (int late : {1, 2, 7, 15}) {
    PowerUp();
    Tick();
    Take();
    int heartbeats = 0;
    for (int tick = 0; tick < 3000; tick += late) {  // 200 ms are 300 ticks
      for (int i = 0; i < late; ++i) {
        fw_prepare(&fw_);
        fw_control(&fw_, &inputs_, &outputs_);
        ASSERT_TRUE(fw_report(&fw_));
      }
      fw_between(&fw_);
      heartbeats += static_cast<int>(Take(0x700 + kNode).size());
    }
    EXPECT_EQ(heartbeats, 10) << late;
  }
}

TEST_F(Fw, AMainLoopThatHangs) {
  for (const int reaction : {0, 1}) {
    PowerUp();
    Set(AXIS_OBJ_FAULT_REACTION_OPTION, reaction);
    Drive();
    const auto interrupt = [this] {
      fw_prepare(&fw_);
      fw_control(&fw_, &inputs_, &outputs_);
      return fw_report(&fw_);
    };
    for (int i = 0; i < FW_BETWEEN_TICKS_MAX; ++i) {
      EXPECT_TRUE(interrupt()) << "tick " << i;
      ASSERT_TRUE(IsOn()) << "tick " << i;
    }
    fw_between(&fw_);  // late, but in time
    for (int i = 0; i < FW_BETWEEN_TICKS_MAX; ++i) {
      EXPECT_TRUE(interrupt()) << "tick " << i;
      ASSERT_TRUE(IsOn()) << "tick " << i;
    }
    for (int i = 0; i < 300; ++i) {
      EXPECT_FALSE(interrupt()) << "the watchdog would be fed";
      ASSERT_TRUE(IsOff()) << "tick " << i;
    }
    fw_between(&fw_);  // it resumes before the watchdog expires
    Take();
    for (int i = 0; i < 100; ++i) {
      Tick();
      Take();
      ASSERT_TRUE(IsOff());
    }
    ExpectNamed(AXIS_FAULT_MAIN_LOOP_LOST, 0x6100);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x80), 0u);
    Drive();
    EXPECT_TRUE(interrupt());
    EXPECT_TRUE(IsOn());
  }
}

// A client of the gateway reaches the axis through it alone; its own watchdog would act much later.
TEST_F(Fw, AClientOfAKilledGatewayIsMissedByTheGatewaysHeartbeat) {
  for (const Way way : {kGateway, kLcm}) {
    for (int ms : {1, 10, 100, 300}) {
      PowerUp();
      WatchHeartbeat(ms);
      Drive(way);
      Send(0x77F, {5});
      EXPECT_EQ(TicksToOff(1000), TicksOf(ms) + 2) << way << ' ' << ms << " ms";
      EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
      ExpectNamed(AXIS_FAULT_HEARTBEAT_LOST, 0x8130);
    }
  }
}

TEST_F(Fw, AClientOfAGatewayThatBootsUpAgainIsLost) {
  for (const Way way : {kGateway, kLcm}) {
    PowerUp();
    WatchHeartbeat(1000);
    Drive(way);
    Send(0x77F, {5});
    Tick();
    ASSERT_TRUE(IsOn());
    Send(0x77F, {0});
    EXPECT_EQ(TicksToOff(10), 1);
    EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_SOURCE_LOST);
    EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
  }
}

// By which way Modbus acquired the axis is what its last write of command_source says; where it was
// given the axis it is unknown, so it counts as on CAN. What enables it over CAN is on CAN.
TEST_F(Fw, TheWayByWhichModbusAcquiredTheAxisDecides) {
  const struct {
    const char *what;
    std::vector<Way> acquire;  // each writes the number of Modbus
    Way write;                 // and this one what follows
    bool lost;
  } cases[] = {{"over the gateway", {kGateway}, kGateway, true},
               {"over the serial line", {kRtu}, kRtu, false},
               {"over the gateway, written over the serial line", {kGateway}, kRtu, true},
               {"over the serial line, written over the gateway", {kRtu}, kGateway, true},
               {"over the serial line last", {kGateway, kRtu}, kRtu, false},
               {"over the gateway last", {kRtu, kGateway}, kGateway, true},
               {"given", {kCanopen}, kRtu, true},
               {"given, then over the serial line", {kCanopen, kRtu}, kRtu, false}};
  for (const auto &c : cases) {
    PowerUp();
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    WatchHeartbeat(10);
    for (const Way way : c.acquire) {
      ASSERT_EQ(Write(way, AXIS_OBJ_COMMAND_SOURCE, AXIS_COMMAND_SOURCE_MODBUS), 0u) << c.what;
    }
    ASSERT_EQ(Write(c.write, AXIS_OBJ_MODES_OF_OPERATION, AXIS_MODES_OF_OPERATION_OPEN_LOOP), 0u);
    ASSERT_EQ(Write(c.write, AXIS_OBJ_OPEN_LOOP_CODE, kCode), 0u);
    ASSERT_EQ(Write(c.write, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
    ASSERT_EQ(Write(c.write, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
    Tick(2);
    ASSERT_TRUE(IsOn()) << c.what;
    Send(0x77F, {5});
    Tick(200);
    EXPECT_EQ(IsOff(), c.lost) << c.what;
    EXPECT_EQ(IsOn(), !c.lost) << c.what;
    EXPECT_EQ(Owner(), c.lost ? AXIS_COMMAND_SOURCE_CANOPEN : AXIS_COMMAND_SOURCE_MODBUS);
  }
}

// A Modbus on the serial line had the axis and fell silent. Its next owner is CANopen, whose end is
// noticed as that of any CANopen owner: it is lost, and nobody holds the axis by that. Also where
// the axis went on meanwhile, so that CANopen did not enable it.
TEST_F(Fw, CanopenIsWatchedAfterAModbusOnTheSerialLineFellSilent) {
  for (const bool goes_on : {false, true}) {
    for (const bool bus_off : {false, true}) {
      PowerUp();
      ASSERT_EQ(Download(kCanopen, 0x1400, 5, 20, 2), 0u);
      Send(0, {1, kNode});
      Set(AXIS_OBJ_ABORT_CONNECTION_OPTION, goes_on ? 0 : 1);
      Drive(kRtu);
      ASSERT_EQ(Write(kRtu, AXIS_OBJ_WATCHDOG, 10), 0u);
      Tick(50);
      ASSERT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
      ASSERT_EQ(IsOn(), goes_on);
      Set(AXIS_OBJ_ABORT_CONNECTION_OPTION, 1);
      if (!goes_on) {
        ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x80), 0u);
        ASSERT_EQ(Write(kCanopen, AXIS_OBJ_OPEN_LOOP_CODE, kCode), 0u);
        ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
        ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
        Tick(2);
      }
      ASSERT_TRUE(IsOn());
      Send(0x205, {0x0F, 0x00, 0xFE});
      if (bus_off) fw_can_bus(&fw_, CAN_BUS_OFF);
      EXPECT_EQ(TicksToOff(100), bus_off ? 1 : TicksOf(20) + 2) << goes_on;
      EXPECT_EQ(Inner(AXIS_OBJ_FAULT), bus_off ? AXIS_FAULT_CAN_OFF : AXIS_FAULT_PDO_TIMEOUT);
      EXPECT_EQ(Inner(AXIS_OBJ_STOPPED_BY), AXIS_STOPPED_BY_NOBODY);
    }
  }
}

// A master on the serial line that writes the owner's number while the gateway's client moves the
// axis does not put an end to the gateway's supervision.
TEST_F(Fw, WritingTheOwnersNumberAgainDoesNotEndTheSupervisionOfAGateway) {
  WatchHeartbeat(10);
  Send(0x77F, {5});
  Drive(kGateway);
  ASSERT_EQ(Write(kRtu, AXIS_OBJ_COMMAND_SOURCE, AXIS_COMMAND_SOURCE_MODBUS), 0u);
  Send(0x77F, {5});
  for (int i = 0; i < 40; ++i) {
    (void)Write(kRtu, AXIS_OBJ_COMMAND_SOURCE, AXIS_COMMAND_SOURCE_MODBUS);
    Tick();
  }
  EXPECT_TRUE(IsOff());
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_HEARTBEAT_LOST);
}

// unsupervised_owner = refused is judged while the axis is enabled, too: whatever ends the
// supervision disables it by abort_connection_option. Without it the warning comes.
TEST_F(Fw, ASupervisionThatEndsWhileEnabledIsJudgedAsAtEnabling) {
  for (const bool refused : {true, false}) {
    for (int how = 0; how < 4; ++how) {
      PowerUp();
      if (how < 2) {
        WatchHeartbeat(1000);
        Send(0x77F, {5});
      } else {
        ASSERT_EQ(Download(kCanopen, 0x1400, 5, 1000, 2), 0u);
      }
      Set(AXIS_OBJ_UNSUPERVISED_OWNER,
          refused ? AXIS_UNSUPERVISED_OWNER_REFUSED : AXIS_UNSUPERVISED_OWNER_WARNED);
      Drive();
      ASSERT_EQ(Inner(AXIS_OBJ_STATUSWORD) & 0x80, 0);
      switch (how) {
        case 0:
          ASSERT_EQ(Download(kCanopen, 0x1016, 1, 0, 4), 0u);
          break;
        case 1:
          ASSERT_EQ(Download(kCanopen, 0x1016, 1, 0x007F07D0, 4), 0u);  // until it is heard again
          break;
        case 2:
          ASSERT_EQ(Download(kCanopen, 0x1400, 5, 0, 2), 0u);
          break;
        default:
          ASSERT_EQ(Download(kCanopen, 0x1400, 1, 0x80000200u + kNode, 4), 0u);
          break;
      }
      Tick(2);
      EXPECT_EQ(IsOff(), refused) << how;
      EXPECT_EQ(Inner(AXIS_OBJ_FAULT), refused ? AXIS_FAULT_SOURCE_LOST : AXIS_FAULT_NONE);
      EXPECT_EQ(CountEmergencies(0xFF09), refused ? 0 : 1) << how;
      EXPECT_EQ((Inner(AXIS_OBJ_STATUSWORD) & 0x80) != 0, !refused);
    }
  }
  // And where that itself is decided while nobody watches.
  PowerUp();
  Drive();
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_UNSUPERVISED_OWNER, AXIS_UNSUPERVISED_OWNER_REFUSED), 0u);
  Tick();
  EXPECT_TRUE(IsOff());
}

// A gateway that is already lost would not be missed again.
TEST_F(Fw, AClientOfALostGatewayDoesNotEnable) {
  for (const Way way : kWays) {
    PowerUp();
    WatchHeartbeat(10);
    Send(0x77F, {5});
    Tick(100);
    ASSERT_TRUE(Acquires(way));
    ASSERT_EQ(Write(way, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
    const bool refused = way == kGateway || way == kLcm;  // CANopen's is a fault, as below
    EXPECT_EQ(Write(way, AXIS_OBJ_CONTROLWORD, 0x0F), refused ? 0x08000022u : 0u) << way;
    Send(0x77F, {5});
    EXPECT_EQ(Write(way, AXIS_OBJ_CONTROLWORD, 0x0F), 0u) << way;
  }
}

// The loss is a state, not an event: enabling again while it lasts fails again.
TEST_F(Fw, NoEnablingWhileTheHeartbeatIsLost) {
  WatchHeartbeat(10);
  Drive();
  Send(0x77F, {5});
  ASSERT_EQ(TicksToOff(100), TicksOf(10) + 2);
  const auto enable = [&] {
    for (int word : {0x80, 0x06, 0x0F}) ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, word), 0u);
    Tick(2);
  };
  enable();
  EXPECT_TRUE(IsOff());
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_HEARTBEAT_LOST);
  Send(0x77F, {5});
  enable();
  EXPECT_EQ(outputs_.amp_enable, 1);
}

TEST_F(Fw, AnRpdoThatStaysAwayAgain) {
  ASSERT_EQ(Download(kCanopen, 0x1400, 5, 20, 2), 0u);
  Send(0, {1, kNode});
  Drive();
  Send(0x205, {0x0F, 0x00, 0xFE});
  ASSERT_EQ(TicksToOff(1000), TicksOf(20) + 2);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x80), 0u);
  Drive();
  EXPECT_NE(TicksToOff(TicksOf(20) + 2), 0);
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_PDO_TIMEOUT);
}

// Frames arrive, but not the SYNC that would apply them.
TEST_F(Fw, RpdosWithoutSyncKeepNoDeadline) {
  ASSERT_EQ(Download(kCanopen, 0x1400, 5, 20, 2), 0u);
  ASSERT_EQ(Download(kCanopen, 0x1400, 2, 1, 1), 0u);
  Send(0, {1, kNode});
  Drive();
  int ticks = 0;
  for (; ticks < 100 && outputs_.amp_enable != 0; ++ticks) {
    Send(0x205, {0x0F, 0x00, 0xFE});
    Tick();
    Take();
  }
  EXPECT_LE(ticks, TicksOf(20) + 2);
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_PDO_TIMEOUT);
}

TEST_F(Fw, AMasterThatBootsUpAgainIsLost) {
  WatchHeartbeat(1000);
  Drive();
  Send(0x77F, {5});
  Tick();
  ASSERT_TRUE(IsOn());
  Send(0x77F, {0});
  EXPECT_EQ(TicksToOff(10), 1);
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_SOURCE_LOST);
}

TEST_F(Fw, ASilentPlantIsDetectedInTheSameTick) {
  Drive();
  inputs_.sensor_valid = 0;
  EXPECT_EQ(TicksToOff(10), 1);
  ExpectNamed(AXIS_FAULT_SENSOR_INVALID, 0x7305);
}

TEST_F(Fw, FaultsOfInputsAreSeenInTheSameTick) {
  const struct {
    int fault, code;
    axis_inputs_t inputs;
  } cases[] = {
      {AXIS_FAULT_ENABLE_LOST, 0xFF05, {0, {0, 0}, 0, 1, 0, 0, 0}},
      {AXIS_FAULT_ADC_RANGE, 0x7300, {0, {256, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0}},
      {AXIS_FAULT_LIMIT_SWITCHES,
       0x8612,
       {0,
        {0, 0},
        AXIS_DIGITAL_INPUTS_ENABLE | AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE |
            AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE,
        1,
        0,
        0,
        0}},
      {AXIS_FAULT_OVERSPEED, 0x7310, {101, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0}},
      {AXIS_FAULT_FORCE_MAX, 0xFF06, {0, {201, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0}},
  };
  for (const auto &c : cases) {
    PowerUp();
    Set(AXIS_OBJ_SPEED_MAX, 100);
    Set(AXIS_OBJ_FORCE_MAX, 200 * 256);
    Drive();
    inputs_ = c.inputs;
    EXPECT_EQ(TicksToOff(10), 1) << c.fault;
    ExpectNamed(c.fault, c.code);
  }
}

TEST_F(Fw, ALostBusIsSeenInTheComingTick) {
  Drive();
  fw_can_bus(&fw_, CAN_BUS_OFF);
  EXPECT_EQ(TicksToOff(10), 1);
  ExpectNamed(AXIS_FAULT_CAN_OFF, 0x8140, false && "the bus is off");
}

TEST_F(Fw, ALostBusIsReportedWhenItIsBack) {
  Drive();
  fw_can_bus(&fw_, CAN_BUS_OFF);
  Tick(1000);
  EXPECT_TRUE(Take().empty()) << "nothing waits, nothing is sent";
  fw_can_bus(&fw_, CAN_BUS_ACTIVE);
  Tick();
  ExpectNamed(AXIS_FAULT_CAN_OFF, 0x8140);
}

// Nothing was asked of it: a master that says no more is not missed.
TEST_F(Fw, AnOwnerOnAnotherBusSurvivesASilentCan) {
  WatchHeartbeat(10);
  Drive(kRtu);
  Send(0x77F, {5});
  for (int i = 0; i < 200; ++i) {
    Tick();
    ASSERT_TRUE(IsOn()) << i;
  }
}

TEST_F(Fw, StopAndResetsByNmtSwitchOff) {
  for (const auto &[command, ticks] : std::map<int, int>{{2, 1}, {130, 1}, {129, 1}}) {
    PowerUp();
    Drive();
    Send(0, {static_cast<uint8_t>(command), kNode});
    EXPECT_EQ(TicksToOff(10), ticks) << "command " << command;
    EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
    if (command == 130) ExpectNamed(AXIS_FAULT_SOURCE_LOST, 0x6010);
  }
}

// The master of the node asks for a reset while another bus drives the axis. Loading parameters may
// take the chip longer than a tick, so the axis is disabled before.
TEST_F(Fw, AResetOfTheNodeDisablesTheAxisFirst) {
  Drive(kRtu);
  Send(0, {129, kNode});
  Tick();
  EXPECT_TRUE(IsOff());
  EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
  EXPECT_EQ(Inner(AXIS_OBJ_OPEN_LOOP_CODE), 0);
}

// All frames come between two ticks: active_mode does not reflect the controlword yet.
TEST_F(Fw, AStopInTheTickThatEnablesSwitchesOff) {
  for (int command : {2, 130}) {
    PowerUp();
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_MODES_OF_OPERATION, AXIS_MODES_OF_OPERATION_OPEN_LOOP), 0u);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_OPEN_LOOP_CODE, kCode), 0u);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
    Tick(2);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
    Send(0, {static_cast<uint8_t>(command), kNode});
    EXPECT_EQ(TicksToOff(10), 1) << "command " << command;
    EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_SOURCE_LOST);
  }
}

// They write through SDO servers of this bus alone; their watchdog would act much later.
TEST_F(Fw, ClientsOfAGatewayAreLostWithTheBus) {
  for (Way way : {kLcm, kGateway}) {
    for (int how = 0; how < 3; ++how) {
      PowerUp();
      Set(AXIS_OBJ_WATCHDOG, 65535);
      Drive(way);
      if (how == 0) fw_can_bus(&fw_, CAN_BUS_OFF);
      if (how == 1) Send(0, {2, kNode});
      if (how == 2) Send(0, {130, kNode});
      EXPECT_EQ(TicksToOff(10), 1) << how;
      EXPECT_EQ(Inner(AXIS_OBJ_FAULT), how == 0 ? AXIS_FAULT_CAN_OFF : AXIS_FAULT_SOURCE_LOST);
      EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
    }
  }
}

// An owner that is silent loses the axis in time, whatever the others write and are permitted to
// write: what every source may write, a stop, an attempt to acquire the axis, what is refused. What
// every source may write does not keep the owner either.
TEST_F(Fw, OnlyWhatTheOwnerWritesFeedsHisWatchdog) {
  const std::vector<std::pair<uint16_t, int32_t>> open{{AXIS_OBJ_CYCLE_RESULT_NUMBER, 0},
                                                       {AXIS_OBJ_CYCLE_RESULT_ELEMENT, 1},
                                                       {AXIS_OBJ_CYCLE_CURVE_FIRST, 0},
                                                       {AXIS_OBJ_CYCLE_ACKNOWLEDGE, 0}};
  const std::vector<std::pair<uint16_t, int32_t>> others{
      {AXIS_OBJ_COMMAND_SOURCE, AXIS_COMMAND_SOURCE_CANOPEN},
      {AXIS_OBJ_CONTROLWORD, 0x10F},
      {AXIS_OBJ_CONTROLWORD, 0x0F},
      {AXIS_OBJ_WATCHDOG, 20},
      {AXIS_OBJ_TARGET_FORCE, 5}};
  constexpr int kMs = 20;
  int combinations = 0;
  for (const Way owner : {kGateway, kLcm, kRtu}) {
    for (const int writer : {int{kCanopen}, int{kGateway}, int{kLcm}, int{kRtu}, 4}) {
      const bool is_local = writer == 4;
      const bool is_owner = !is_local && SourceOf(static_cast<Way>(writer)) == SourceOf(owner);
      auto writes = open;
      if (!is_owner) writes.insert(writes.end(), others.begin(), others.end());
      for (auto [object, value] : writes) {
        if (object == AXIS_OBJ_COMMAND_SOURCE) {
          if (is_local) continue;  // the code for the board may hand the axis over
          value = SourceOf(static_cast<Way>(writer));
        }
        if (!is_local && !Reaches(static_cast<Way>(writer), object)) continue;
        PowerUp();
        Set(AXIS_OBJ_HALT_OPTION, 1);
        Drive(owner);
        ASSERT_EQ(Write(owner, AXIS_OBJ_WATCHDOG, kMs), 0u);
        ++combinations;
        int ticks = 0;
        for (; ticks < 200 && Owner() == SourceOf(owner); ++ticks) {
          if (ticks % 3 == 1) {
            if (is_local) {
              (void)fw_object_write(&fw_, FW_SOURCE_LOCAL, object, value);
            } else {
              (void)Write(static_cast<Way>(writer), object, value);
            }
          }
          Tick();
          Take();
        }
        EXPECT_EQ(ticks, TicksOf(kMs) + 1)
            << "owner " << owner << ", writer " << writer << ", object " << object;
        EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_SOURCE_LOST);
      }
    }
    // What the owner writes keeps the axis, also the present value.
    PowerUp();
    Drive(owner);
    ASSERT_EQ(Write(owner, AXIS_OBJ_WATCHDOG, kMs), 0u);
    for (int i = 0; i < 20; ++i) {
      ASSERT_EQ(Write(owner, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
      Tick(TicksOf(kMs));
      ASSERT_TRUE(IsOn()) << owner << ' ' << i;
    }
  }
  EXPECT_GT(combinations, 90);
}

}  // namespace
