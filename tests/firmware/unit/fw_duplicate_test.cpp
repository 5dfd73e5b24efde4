// A second node with this one's id: whatever only such a node would send disables the axis.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <vector>

#include "tests/firmware/unit/flash.hpp"
#include "tests/firmware/unit/fw_fixture.hpp"

namespace {

constexpr uint16_t kOwn[] = {0x700 + kNode,  // boot-up and heartbeat
                             0x080 + kNode,  // EMCY
                             0x580 + kNode,  // SDO answers
                             0x681,         0x683,
                             0x180 + kNode,  // TPDO 1 and 2; 3 and 4 are not valid by default
                             0x280 + kNode};

TEST_F(Fw, ASecondNodeOfThisIdDisablesTheAxisInTheNextTick) {
  for (Way way : kWays) {
    for (uint16_t id : kOwn) {
      PowerUp();
      Drive(way);
      Send(id, {0});
      EXPECT_EQ(TicksToOff(10), 1) << std::hex << id << " owner " << way;
      ExpectNamed(AXIS_FAULT_DUPLICATE_NODE, 0xFF0A);
    }
  }
}

TEST_F(Fw, BesideASecondNodeOfThisIdTheAxisIsNotEnabled) {
  Send(0x700 + kNode, {0});
  Tick(2);
  const auto enable = [&] {
    for (uint32_t word : {0x06u, 0x07u, 0x0Fu}) (void)Download(kCanopen, 0x6040, 0, word, 2);
    Tick(2);
    return Inner(AXIS_OBJ_DRIVE_STATE) == AXIS_DRIVE_STATE_OPERATION_ENABLED;
  };
  EXPECT_FALSE(enable());
  EXPECT_EQ(CountEmergencies(0xFF0A), 1) << "once";
  for (int i = 0; i < 20; ++i) Send(0x700 + kNode, {5});
  Tick(100);
  EXPECT_EQ(CountEmergencies(0xFF0A), 0) << "not again while the fault lasts";
  // It may be enabled once the other one is gone and the fault reset.
  ASSERT_EQ(Download(kCanopen, 0x6040, 0, 0x80, 2), 0u);
  Tick(2);
  EXPECT_TRUE(enable());
  Send(0x700 + kNode, {5});
  Tick();
  EXPECT_TRUE(IsOff());
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_DUPLICATE_NODE);
  EXPECT_FALSE(enable());
}

// Latched between two ticks and reset before the next one: it acts in that tick all the same, and
// is reset only after it. By 201Eh over each bus, by the controlword, and by both with all that
// would enable the axis again.
TEST_F(Fw, AFaultThatIsResetBeforeItsTickActsInItAllTheSame) {
  for (Way way : kWays) {
    for (const bool by_word : {false, true}) {
      if (!by_word && !Reaches(way, AXIS_OBJ_FAULT_RESET)) continue;
      PowerUp();
      Drive(way);
      Send(0x700 + kNode, {0});
      if (by_word) {
        (void)Write(way, AXIS_OBJ_CONTROLWORD, 0x80);
      } else {
        EXPECT_NE(Write(way, AXIS_OBJ_FAULT_RESET, 1), 0u) << "refused, not ignored";
      }
      for (int word : {0x06, 0x07, 0x0F}) (void)Write(way, AXIS_OBJ_CONTROLWORD, word);
      EXPECT_EQ(TicksToOff(10), 1) << "owner " << way;
      EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_DUPLICATE_NODE);
      EXPECT_EQ(CountEmergencies(0xFF0A), 1);
      (void)Write(way, AXIS_OBJ_CONTROLWORD, 0x00);
      ASSERT_EQ(Write(way, AXIS_OBJ_CONTROLWORD, 0x80), 0u);
      EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_NONE) << "from now on it can be";
    }
  }
}

// A fault of the drive's own, which enters the state at once: a lost node in 1016h.
TEST_F(Fw, AFaultOfTheOwnersEndIsNotResetBeforeItsTickEither) {
  WatchHeartbeat(100);
  Send(0x77F, {5});
  Drive();
  Send(0x77F, {0});  // it has started anew
  (void)Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x80);
  for (int word : {0x06, 0x07, 0x0F}) (void)Write(kCanopen, AXIS_OBJ_CONTROLWORD, word);
  Tick();
  EXPECT_TRUE(IsOff());
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_SOURCE_LOST);
}

TEST_F(Fw, FramesOfOtherNodesAreNoSecondNode) {
  Drive();
  for (uint32_t id = 1; id < 0x800; ++id) {
    const bool is_own = std::find(std::begin(kOwn), std::end(kOwn), id) != std::end(kOwn);
    const bool is_request = id == 0x600 + kNode || id == kModbusServer || id == kLcmServer;
    if (!is_own && !is_request) Send(static_cast<uint16_t>(id), {0x81});
    Send(static_cast<uint16_t>(id), {}, true);  // remote requests come from anywhere
  }
  Tick(3);
  EXPECT_TRUE(IsOn());
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
}

TEST_F(Fw, IdentifiersThatAreSwitchedOffAreNotOwn) {
  ASSERT_EQ(Download(kCanopen, 0x1014, 0, 0x80000080u + kNode, 4), 0u);
  ASSERT_EQ(Download(kCanopen, 0x1800, 1, 0xC0000180u + kNode, 4), 0u);
  ASSERT_EQ(Download(kCanopen, 0x1201, 2, 0x80000681u, 4), 0u);
  for (uint16_t id : {0x080 + kNode, 0x180 + kNode, 0x681}) Send(id, {0});
  Tick(2);
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
}

// The straps first; without them the stored id, for CANopen and Modbus.
TEST_F(Fw, TheNodeIdIsThatOfTheStrapsElseTheStoredOne) {
  Flash flash;
  const auto power_up = [&](uint8_t straps) {
    fw_config_t config = NodeConfig();
    config.node_id = straps;
    config.memory = flash.memory();
    fw_ = fw_t{};
    fw_init(&fw_, &config);
    const std::vector<Frame> boot = Take();
    EXPECT_EQ(boot.size(), 1u);
    EXPECT_EQ(boot[0].id, 0x700 + Inner(AXIS_OBJ_NODE_ID));
    EXPECT_EQ(Inner(AXIS_OBJ_SDO_SERVER_RECEIVE), 0x600 + Inner(AXIS_OBJ_NODE_ID));
    const auto unit = static_cast<uint8_t>(Inner(AXIS_OBJ_NODE_ID));
    EXPECT_EQ(SendRtu(RtuFrame(unit, Pdu(4, {0, 1}))).size(), 7u);
    return Inner(AXIS_OBJ_NODE_ID);
  };
  EXPECT_EQ(power_up(0), 1) << "none is stored";
  Set(AXIS_OBJ_STORED_NODE_ID, 127);
  Set(AXIS_OBJ_RPDO_COB_ID_1, fx_s32_from_u32(0x80000222u));
  EXPECT_EQ(Inner(AXIS_OBJ_NODE_ID), 1) << "not before the next reset";
  ASSERT_EQ(FirmwareFixture::Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
  Tick(4000);
  ASSERT_EQ(Inner(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_SAVED);
  EXPECT_EQ(power_up(0), 127);
  EXPECT_EQ(Inner(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_LOADED);
  EXPECT_EQ(Inner(AXIS_OBJ_EMCY_COB_ID), 0x80 + 127) << "a default follows the id";
  EXPECT_EQ(Inner(AXIS_OBJ_RPDO_COB_ID_1), fx_s32_from_u32(0x80000222u)) << "another value stays";
  EXPECT_EQ(power_up(9), 9) << "the straps first";
  EXPECT_EQ(FirmwareFixture::Write(AXIS_OBJ_STORED_NODE_ID, 128), FW_ERROR_RANGE);
}

}  // namespace
