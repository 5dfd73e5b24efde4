// Ownership of the axis: how the lock is acquired, lost and released; an owner's commands end with
// its ownership.

#include <gtest/gtest.h>

#include <cstdint>
#include <map>
#include <random>
#include <vector>

#include "tests/firmware/unit/fw_fixture.hpp"

namespace {

// Enabled again by CANopen without a command: the axis is at rest, whatever was commanded before.
TEST_F(Fw, AnOwnersCommandsEndWithIt) {
  for (int how = 0; how < 3; ++how) {
    PowerUp();
    Set(AXIS_OBJ_POSITION_GAIN, 5 * 256);
    Set(AXIS_OBJ_WATCHDOG, 20);
    Set(AXIS_OBJ_ABORT_CONNECTION_OPTION, 2);
    ASSERT_TRUE(Acquires(kRtu));
    ASSERT_EQ(Write(kRtu, AXIS_OBJ_MODES_OF_OPERATION, AXIS_MODES_OF_OPERATION_PROFILE_VELOCITY),
              0u);
    ASSERT_EQ(Write(kRtu, AXIS_OBJ_TARGET_VELOCITY, 30000), 0u);
    if (how == 1) {
      ASSERT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
      ASSERT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
    }
    if (how == 2) {
      ASSERT_TRUE(Acquires(kCanopen));
    }
    Tick(40);
    ASSERT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x00), 0u);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
    Tick(100);
    ASSERT_EQ(outputs_.amp_enable, 1);
    EXPECT_EQ(Inner(AXIS_OBJ_POSITION_DEMAND), 0) << how;
  }
}

// The set-points of the native modes too, which have no other flag than 0.
TEST_F(Fw, NativeSetpointsEndWithTheirOwner) {
  for (Way way : {kGateway, kLcm, kRtu}) {
    PowerUp();
    Set(AXIS_OBJ_WATCHDOG, 20);
    Set(AXIS_OBJ_ABORT_CONNECTION_OPTION, 2);
    ASSERT_TRUE(Acquires(way));
    ASSERT_EQ(Write(way, AXIS_OBJ_FORCE_SETPOINT, 256), 0u);
    ASSERT_EQ(Write(way, AXIS_OBJ_EXCITATION_AMPLITUDE, 10), 0u);
    Drive(way);
    Tick(40);
    ASSERT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
    EXPECT_EQ(Inner(AXIS_OBJ_OPEN_LOOP_CODE), 0) << way;
    EXPECT_EQ(Inner(AXIS_OBJ_FORCE_SETPOINT), 0) << way;
    EXPECT_EQ(Inner(AXIS_OBJ_EXCITATION_AMPLITUDE), 0) << way;
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
    Tick(10);
    EXPECT_EQ(outputs_.amp_enable, 1);
    EXPECT_EQ(outputs_.dac_code, 0) << way;
  }
}

TEST_F(Fw, NativeSetpointsEndWithAFault) {
  for (int how = 0; how < 2; ++how) {
    PowerUp();
    Drive();
    inputs_.sensor_valid = 0;
    Tick();
    inputs_.sensor_valid = 1;
    ASSERT_TRUE(IsOff());
    ASSERT_EQ(how == 0 ? Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x80)
                       : Write(kCanopen, AXIS_OBJ_FAULT_RESET, 1),
              0u);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
    Tick(10);
    EXPECT_EQ(outputs_.amp_enable, 1);
    EXPECT_EQ(outputs_.dac_code, 0) << how;
  }
}

// The controlword is mapped before the target; it must act on the one that came with it.
TEST_F(Fw, AnRpdoStartsTheTargetItBrings) {
  Set(AXIS_OBJ_POSITION_GAIN, 5 * 256);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_MODES_OF_OPERATION, AXIS_MODES_OF_OPERATION_PROFILE_POSITION),
            0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_TARGET_POSITION, 36000), 0u);
  Send(0, {1, kNode});
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
  Tick(2);
  Send(0x305, {0x1F, 0x00, 0x78, 0xEC, 0xFF, 0xFF});  // -5000
  Tick(200);
  EXPECT_LT(Inner(AXIS_OBJ_POSITION_DEMAND), 0);
  EXPECT_EQ(fw_.drive.setpoint.position, -5000);
}

// Modbus refuses a whole request: neither its values nor earlier ones become active.
TEST_F(Fw, ARefusedRequestThatReleasesTheAxisStartsNothing) {
  Set(AXIS_OBJ_POSITION_GAIN, 5 * 256);
  ASSERT_TRUE(Acquires(kRtu));
  ASSERT_EQ(Write(kRtu, AXIS_OBJ_MODES_OF_OPERATION, AXIS_MODES_OF_OPERATION_PROFILE_VELOCITY), 0u);
  ASSERT_EQ(Write(kRtu, AXIS_OBJ_TARGET_VELOCITY, 30000), 0u);
  inputs_.sensor_valid = 0;
  Tick();
  inputs_.sensor_valid = 1;
  for (int word : {0x80, 0x06, 0x0F}) {
    ASSERT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, word), 0u);
    Tick();
  }
  ASSERT_EQ(outputs_.amp_enable, 1);
  const auto refused = [&](unsigned first, const std::vector<unsigned> &words) {
    return IsException(AskRtu(WritePdu(first, words)));
  };
  EXPECT_TRUE(refused(0, {0x0F, 3, 0, 0, 0, 0, 0, 0}));
  EXPECT_TRUE(refused(4, {0, 0, 0, 0, 1000}));
  EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_MODBUS);
  Tick(100);
  EXPECT_EQ(Inner(AXIS_OBJ_POSITION_DEMAND), 0);
  EXPECT_EQ(Inner(AXIS_OBJ_TARGET_VELOCITY), 30000);
}

TEST_F(Fw, CanopenOwnsAtPowerUp) {
  EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
  for (Way way : {kGateway, kLcm}) {
    EXPECT_EQ(Write(way, AXIS_OBJ_CONTROLWORD, 0x0F), 0x08000021u);
  }
  EXPECT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x0F), 4u);
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
}

// Its owner may give it to anybody, also while it is enabled; nobody else can but take it, and only
// a disabled one.
TEST_F(Fw, OnlyTheOwnerReleasesAnEnabledAxis) {
  for (Way owner : kWays) {
    for (Way other : kWays) {
      if (SourceOf(other) == SourceOf(owner)) continue;
      PowerUp();
      Drive(owner);
      for (int source :
           {AXIS_COMMAND_SOURCE_CANOPEN, AXIS_COMMAND_SOURCE_MODBUS, AXIS_COMMAND_SOURCE_LCM}) {
        EXPECT_EQ(Write(other, AXIS_OBJ_COMMAND_SOURCE, source), other == kRtu ? 4u : 0x08000021u)
            << owner << other << source;
        EXPECT_EQ(Owner(), SourceOf(owner));
      }
      Tick(5);
      EXPECT_TRUE(IsOn());
      ASSERT_EQ(Write(owner, AXIS_OBJ_COMMAND_SOURCE, SourceOf(other)), 0u);
      EXPECT_EQ(Owner(), SourceOf(other));
      EXPECT_NE(Write(owner, AXIS_OBJ_OPEN_LOOP_CODE, 7), 0u) << "it is no longer the owner";
      PowerUp();
      ASSERT_TRUE(Acquires(owner));
      EXPECT_TRUE(Acquires(other)) << "disabled: whoever asks";
    }
  }
}

// In the tick that enables it, active_mode knows nothing of it yet.
TEST_F(Fw, AnAxisAboutToMoveIsNotAcquiredEither) {
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
  EXPECT_TRUE(Acquires(kLcm)) << "ready to switch on";
  ASSERT_EQ(Write(kLcm, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
  ASSERT_EQ(Write(kLcm, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_COMMAND_SOURCE, 0), 0x08000021u);
  ASSERT_EQ(Write(kLcm, AXIS_OBJ_CONTROLWORD, 0x00), 0u);
  EXPECT_TRUE(Acquires(kCanopen));
}

// Also one that continues to read: reading is no sign of a working owner.
TEST_F(Fw, AnOwnerThatWritesNoMoreIsLost) {
  for (Way way : {kGateway, kLcm, kRtu}) {
    for (int ms : {10, 15, 1000}) {
      PowerUp();
      ASSERT_TRUE(Acquires(way));
      ASSERT_EQ(Write(way, AXIS_OBJ_WATCHDOG, ms), 0u);
      Drive(way);
      ASSERT_EQ(Write(way, AXIS_OBJ_WATCHDOG, ms), 0u);
      int ticks = 0;
      for (; IsOn() && ticks < 3000; ++ticks) {
        (void)Read(way, AXIS_OBJ_STATUSWORD);
        Tick();
      }
      EXPECT_EQ(ticks, TicksOf(ms) + 1) << "way " << way << ", " << ms << " ms";
      EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
      ExpectNamed(AXIS_FAULT_SOURCE_LOST, 0x6010);
    }
  }
}

TEST_F(Fw, FramesOfOthersFeedNoWatchdog) {
  const std::map<Way, std::vector<Way>> others{
      {kRtu, {kCanopen, kLcm}}, {kLcm, {kCanopen, kGateway, kRtu}}, {kGateway, {kCanopen, kLcm}}};
  for (const auto &[owner, loud] : others) {
    PowerUp();
    Set(AXIS_OBJ_WATCHDOG, 20);
    Drive(owner);
    ASSERT_EQ(Write(owner, AXIS_OBJ_WATCHDOG, 20), 0u);
    int ticks = 0;
    while (IsOn() && ticks < 100) {
      for (Way way : loud) (void)Write(way, AXIS_OBJ_CONTROLWORD, 0x0F);
      Send(0x77F, {5});
      Send(0x80, {});
      Tick();
      ++ticks;
    }
    EXPECT_EQ(ticks, TicksOf(20) + 1) << "owner " << owner;
    EXPECT_TRUE(IsOff());
  }
}

// Frames of another bus do not hide the loss of a CANopen owner.
TEST_F(Fw, AModbusClientDoesNotFeedCanopen) {
  WatchHeartbeat(20);
  Drive();
  Send(0x77F, {5});
  int ticks = 0;
  while (IsOn() && ticks < 100) {
    (void)Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x0F);
    (void)Read(kGateway, AXIS_OBJ_STATUSWORD);
    Tick();
    ++ticks;
  }
  EXPECT_EQ(ticks, TicksOf(20) + 2);
}

TEST_F(Fw, ASilentOwnerOfADisabledAxisLosesTheLockOnly) {
  ASSERT_TRUE(Acquires(kRtu));
  Tick(1500);
  EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_MODBUS);
  Tick();
  EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
  EXPECT_TRUE(Emergencies().empty());
  EXPECT_EQ(Write(kRtu, AXIS_OBJ_OPEN_LOOP_CODE, 1), 4u);
}

TEST_F(Fw, TheReactionIsChosenBy6007) {
  const struct {
    int option, state, owner_reported;
  } cases[] = {{0, AXIS_DRIVE_STATE_OPERATION_ENABLED, 1},
               {1, AXIS_DRIVE_STATE_FAULT, 1},
               {2, AXIS_DRIVE_STATE_SWITCH_ON_DISABLED, 1},
               {3, AXIS_DRIVE_STATE_SWITCH_ON_DISABLED, 1}};
  for (const auto &c : cases) {
    PowerUp();
    Drive(kRtu);
    Set(AXIS_OBJ_ABORT_CONNECTION_OPTION, c.option);
    Set(AXIS_OBJ_WATCHDOG, 20);
    Tick(1000);
    EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
    EXPECT_EQ(Inner(AXIS_OBJ_DRIVE_STATE), c.state) << c.option;
    EXPECT_EQ(IsOff(), c.option != 0);
    EXPECT_EQ(CountEmergencies(0x6010), c.owner_reported) << "option " << c.option;
  }
}

TEST_F(Fw, TheOwnerMayChangeItsWatchdog) {
  Drive(kRtu);
  Tick(700);
  ASSERT_EQ(Write(kRtu, AXIS_OBJ_WATCHDOG, 10), 0u);
  EXPECT_EQ(TicksToOff(100), TicksOf(10) + 1) << "counted from the write";
  PowerUp();
  Drive(kRtu);
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_WATCHDOG, 10), 0x08000021u) << "not by others";
}

TEST_F(Fw, ARunningAxisIsReleasedToAWatchedCanopen) {
  WatchHeartbeat(50);
  Drive(kRtu);
  Send(0x77F, {5});
  ASSERT_EQ(Write(kRtu, AXIS_OBJ_COMMAND_SOURCE, 0), 0u);
  for (int i = 0; i < 5000; ++i) {
    if (i % 50 == 0) Send(0x77F, {5});
    Tick();
    ASSERT_TRUE(IsOn()) << "nobody is lost: canopen has it";
  }
  EXPECT_EQ(TicksToOff(100), TicksOf(50) + 2 - 50) << "and is watched";
}

// While Modbus owned the axis the CANopen master was not supervised; it is at the release.
TEST_F(Fw, ReleasingTheAxisToALostCanopenDisablesIt) {
  Set(AXIS_OBJ_WATCHDOG, 60000);
  for (int how = 0; how < 3; ++how) {
    PowerUp();
    Set(AXIS_OBJ_WATCHDOG, 60000);
    WatchHeartbeat(10);
    ASSERT_EQ(Download(kCanopen, 0x1400, 5, 10, 2), 0u);
    Send(0, {1, kNode});
    Send(0x77F, {5});
    Send(0x205, {0x00, 0x00, 0xFE});
    Drive(kRtu);
    if (how == 0) Send(0x77F, {5});
    if (how == 1) Send(0x77F, {5});
    if (how == 2) Set(AXIS_OBJ_CONSUMER_HEARTBEAT_1, 0);
    for (int i = 0; i < 100; ++i) {
      Tick();
      ASSERT_TRUE(IsOn()) << how;
    }
    ASSERT_EQ(Write(kRtu, AXIS_OBJ_COMMAND_SOURCE, 0), 0u);
    static constexpr int kTicks[] = {1, 1, 17};  // a deadline that begins with the next tick
    static constexpr int kFaults[] = {AXIS_FAULT_HEARTBEAT_LOST, AXIS_FAULT_HEARTBEAT_LOST,
                                      AXIS_FAULT_PDO_TIMEOUT};
    EXPECT_EQ(TicksToOff(100), kTicks[how]) << how;
    EXPECT_EQ(Inner(AXIS_OBJ_FAULT), kFaults[how]);
  }
}

// The same for a CANopen master whose loss nothing would detect.
TEST_F(Fw, ReleasingTheAxisToAnUnwatchedCanopenDisablesIt) {
  for (Way way : {kRtu, kLcm, kGateway}) {
    PowerUp();
    Drive(way);
    ASSERT_EQ(Write(way, AXIS_OBJ_COMMAND_SOURCE, 0), 0u);
    EXPECT_EQ(TicksToOff(10), 1);
    ExpectNamed(AXIS_FAULT_SOURCE_LOST, 0x6010);
  }
}

TEST_F(Fw, TwoMastersOneOwner) {
  WatchHeartbeat(65535); /* a canopen that is not watched would lose the axis */
  Drive(kCanopen);
  Send(0x77F, {5});
  std::mt19937 random(5);
  Way owner = kCanopen;
  for (int i = 0; i < 3000; ++i) {
    const Way who = kWays[random() % 4];
    if (random() % 4 == 0) {
      ASSERT_EQ(Write(owner, AXIS_OBJ_COMMAND_SOURCE, SourceOf(who)), 0u);
      owner = who;
    }
    const bool allowed = SourceOf(who) == SourceOf(owner);
    const int32_t value = static_cast<int32_t>(random() % 1000);
    const uint32_t before = static_cast<uint32_t>(Inner(AXIS_OBJ_FORCE_GAIN));
    const uint32_t result = Write(who, AXIS_OBJ_FORCE_GAIN, value);
    const uint32_t expected = allowed ? 0 : who == kRtu ? 4 : 0x08000021;
    ASSERT_EQ(result, expected) << i;
    for (Way way : kWays) {
      ASSERT_EQ(Read(way, AXIS_OBJ_FORCE_GAIN), allowed ? static_cast<uint32_t>(value) : before);
    }
    if (!allowed) (void)Write(who, AXIS_OBJ_CONTROLWORD, 0x0F);
    Tick();
    ASSERT_TRUE(IsOn()) << i;
  }
}

TEST_F(Fw, AResetReleasesTheLock) {
  Drive(kRtu);
  Send(0, {130, kNode});
  Tick();
  EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_MODBUS) << "of communication only";
  EXPECT_TRUE(IsOff());
  Send(0, {129, kNode});
  Tick(2);
  EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_CANOPEN);
  EXPECT_TRUE(IsOff());
}

}  // namespace
