// NMT states, the heartbeat of the node and those it watches, resets.

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <random>
#include <vector>

#include "tests/firmware/unit/canopen_fixture.hpp"

namespace {

TEST_F(Canopen, BootsUpAfterEveryReset) {
  EXPECT_EQ(Take(), std::vector<Frame>{Heartbeat(0)});
  for (uint8_t command : {129, 130}) {
    for (uint8_t node : {uint8_t{0}, kNode}) {
      Nmt(1);
      Nmt(command, node);
      Take();
      Tick();
      const auto frames = Take();
      ASSERT_FALSE(frames.empty());
      EXPECT_EQ(frames[0], Heartbeat(0));
      EXPECT_EQ(Read(AXIS_OBJ_NMT_STATE), 127);
    }
  }
}

TEST_F(Canopen, NmtCommandsMoveTheStateAndForeignOnesDoNot) {
  struct Row {
    uint8_t command, node;
    int state;
  };
  for (const Row &row :
       {Row{1, kNode, 5}, Row{2, kNode, 4}, Row{128, kNode, 127}, Row{1, 0, 5}, Row{128, 0, 127},
        Row{2, 0, 4}, Row{1, kNode + 1, 4}, Row{3, kNode, 4}, Row{0, 0, 4}, Row{1, kNode, 5}}) {
    Nmt(row.command, row.node);
    EXPECT_EQ(Read(AXIS_OBJ_NMT_STATE), row.state) << int{row.command};
  }
  Send(0, {2});
  Send(0, {2, kNode, 0});
  Send(0, {2, kNode}, true);
  EXPECT_EQ(Read(AXIS_OBJ_NMT_STATE), 5);
}

TEST_F(Canopen, StatesGateTheServices) {
  EXPECT_TRUE(Upload(0x1000, 0).has_value());
  Send(0x200 + kNode, {0x06, 0x00, 0x01});
  EXPECT_EQ(Read(AXIS_OBJ_MODES_OF_OPERATION), 0) << "no PDO before it is operational";
  Nmt(2);
  EXPECT_TRUE(Ask(Request(0x40, 0x1000, 0)).empty());
  Send(0x80, {});
  EXPECT_EQ(Read(AXIS_OBJ_SYNC_COUNT), 0);
  canopen_emergency(&fw_.canopen, 0xFF04, 0);
  Take();
  Tick(301);
  EXPECT_EQ(Take(), std::vector<Frame>{Heartbeat(4)}) << "nothing but the heartbeat";
  Nmt(128);
  Tick();
  EXPECT_EQ(Take(), std::vector<Frame>{Emergency(0xFF04, 0, 0)}) << "what had to wait";
  Send(0x80, {});
  EXPECT_EQ(Read(AXIS_OBJ_SYNC_COUNT), 1);
}

TEST_F(Canopen, HeartbeatTimesRoundUpToTicks) {
  Take();
  // 200 ms are 300 ticks: the boot-up message came before tick 0.
  EXPECT_EQ(TicksUntil(0x700 + kNode, 1000), 301);
  EXPECT_EQ(TicksUntil(0x700 + kNode, 1000), 300);
  for (const auto &[ms, ticks] : std::vector<std::array<int, 2>>{
           {1, 2}, {2, 3}, {3, 5}, {7, 11}, {1000, 1500}, {65535, 98303}}) {
    ASSERT_EQ(Download(0x1017, 0, static_cast<uint32_t>(ms), 2), 0u);
    TicksUntil(0x700 + kNode, 100000);
    EXPECT_EQ(TicksUntil(0x700 + kNode, 100000), ticks) << ms << " ms";
  }
  ASSERT_EQ(Download(0x1017, 0, 0, 2), 0u);
  EXPECT_EQ(TicksUntil(0x700 + kNode, 5000), 0);
}

TEST_F(Canopen, AMissingHeartbeatIsReportedAndReturnsWithAReset) {
  ASSERT_EQ(Download(0x1016, 1, 0x000A0064, 4), 0u);  // node 10, 100 ms
  ASSERT_EQ(Download(0x1016, 2, 0x000B0032, 4), 0u);  // node 11, 50 ms
  EXPECT_EQ(Download(0x1016, 3, 0x000A0001, 4), 0x06040043u) << "one consumer for each node";
  for (uint32_t reserved = 0x01000000; reserved < 0x80000000; reserved <<= 1) {
    EXPECT_EQ(Download(0x1016, 3, 0x000C0001 | reserved, 4), 0x06090030u) << "reserved bits";
  }
  EXPECT_EQ(Download(0x1016, 3, 0x000A0000, 4), 0u) << "no time, no consumer";
  Start();
  NodeTick(1000);
  EXPECT_EQ(fw_.canopen.signals.error_register, 0) << "watched from the first heartbeat on";
  Send(0x70A, {5});
  NodeTick(150);
  EXPECT_EQ(Read(AXIS_OBJ_NMT_STATE), 5);
  Take();
  NodeTick(1);
  EXPECT_EQ(Take(0x80 + kNode), std::vector<Frame>{Emergency(0x8130, 0x11, 10)});
  EXPECT_EQ(Read(AXIS_OBJ_NMT_STATE), 127) << "1029h: pre-operational";
  EXPECT_EQ(Read(AXIS_OBJ_ERROR_REGISTER), 0x11);
  // The fault that follows was reported already.
  ShowFault(0x8130, AXIS_FAULT_HEARTBEAT_LOST);
  NodeTick(3);
  EXPECT_TRUE(Take(0x80 + kNode).empty());
  ShowFault(0, 0);
  NodeTick(1);
  EXPECT_EQ(Take(0x80 + kNode), std::vector<Frame>{Emergency(0, 0x11, 0)});
  Send(0x70A, {5});
  NodeTick(1);
  EXPECT_EQ(Take(0x80 + kNode), std::vector<Frame>{Emergency(0, 0, 0)});
  EXPECT_EQ(Read(AXIS_OBJ_ERROR_REGISTER), 0);
}

// The time has 16 significant bits.
TEST_F(Canopen, AHeartbeatMayTakeLong) {
  for (uint32_t ms : {0x8000u, 0xFFFFu}) {
    PowerUp();
    ASSERT_EQ(Download(0x1016, 1, 0x000A0000 | ms, 4), 0u);
    Send(0x70A, {5});
    NodeTick(static_cast<int>((3 * ms + 1) / 2));
    EXPECT_EQ(Read(AXIS_OBJ_ERROR_REGISTER), 0) << ms;
    NodeTick(1);
    EXPECT_EQ(Read(AXIS_OBJ_ERROR_REGISTER), 0x11) << ms;
  }
}

// Any tick's deferred part may run in the main loop: the frames are the same, in the same order.
TEST_F(Canopen, WhereATickIsServedMakesNoDifference) {
  ASSERT_EQ(Download(0x1016, 1, 0x000A0014, 4), 0u);
  ASSERT_EQ(Download(0x1029, 1, 1, 1), 0u);
  ASSERT_EQ(Download(0x1800, 1, 0xC0000185, 4), 0u);
  ASSERT_EQ(Download(0x1800, 3, 20, 2), 0u);
  ASSERT_EQ(Download(0x1800, 1, 0x40000185, 4), 0u);
  Remap(0x1802, 0x1A02, 0x40000385, {0x60640020}, 254);
  Start();
  std::mt19937 random(301);
  std::array<fw_t, 2> nodes{fw_, fw_};
  std::array<std::vector<Frame>, 2> sent;
  int frames = 0;
  for (int tick = 0; tick < 20000; ++tick) {
    const uint32_t what = random() % 40, value = random(), drain = random() % 8;
    for (size_t i = 0; i < nodes.size(); ++i) {
      fw_t &node = nodes[i];
      can_frame_t heartbeat{};
      heartbeat.id = 0x70A;
      heartbeat.length = 1;
      heartbeat.data[0] = 5;
      can_frame_t upload{};
      upload.id = 0x605;
      upload.length = 8;
      upload.data[0] = 0x40;
      upload.data[2] = 0x10;
      switch (what) {
        case 0:
        case 1:
          node.drive.signals.statusword = static_cast<uint16_t>(value % 3);
          break;
        case 2:
        case 3:
          node.drive.signals.position_actual = static_cast<int32_t>(value % 3);
          break;
        case 4:
          node.drive.signals.error_code = (value & 1) != 0 ? 0x8611 : 0;
          node.axis.signals.fault = (value & 1) != 0 ? AXIS_FAULT_FOLLOWING_ERROR : AXIS_FAULT_NONE;
          break;
        case 5:
          canopen_emergency(&node.canopen, 0xFF04, 0);
          break;
        case 6:
          fw_can_receive(&node, &heartbeat);
          break;
        case 7:
        case 8:
          fw_can_receive(&node, &upload);
          break;
        default:
          break;
      }
      NodeTickOf(node, i == 1);
      if (drain != 0) continue;
      sent[i].clear();
      for (can_frame_t f{}; fw_can_transmit(&node, &f);) {
        sent[i].push_back({f.id, {f.data, f.data + f.length}});
      }
    }
    ASSERT_EQ(sent[0], sent[1]) << tick;
    frames += static_cast<int>(sent[0].size());
  }
  EXPECT_GT(frames, 2000);
}

TEST_F(Canopen, ErrorBehaviourChoosesTheState) {
  for (const auto &[behaviour, state] : std::vector<std::array<int, 2>>{{0, 127}, {1, 5}, {2, 4}}) {
    PowerUp();
    ASSERT_EQ(Download(0x1029, 1, static_cast<uint32_t>(behaviour), 1), 0u);
    ASSERT_EQ(Download(0x1016, 1, 0x000A000A, 4), 0u);
    Start();
    Send(0x70A, {5});
    Tick(20);
    EXPECT_EQ(Read(AXIS_OBJ_NMT_STATE), state);
  }
  EXPECT_EQ(Download(0x1029, 1, 3, 1), 0xFFFFFFFFu) << "stopped: no SDO";
}

TEST_F(Canopen, AResetRestoresCommunicationAndOnlyANodesResetTheRest) {
  ASSERT_EQ(Download(0x1017, 0, 1000, 2), 0u);
  ASSERT_EQ(Download(0x200A, 0, 77, 2), 0u);
  Remap(0x1401, 0x1601, 0x205 + 0x20, {0x60FF0020}, 255);
  Nmt(130);
  EXPECT_TRUE(Ask(Request(0x40, 0x1000, 0)).empty()) << "initialising until the end of the tick";
  Tick();
  EXPECT_EQ(Upload(0x1017, 0), 200u);
  EXPECT_EQ(Upload(0x1401, 1), 0x305u);
  EXPECT_EQ(Upload(0x1601, 0), 2u);
  EXPECT_EQ(Upload(0x200A, 0), 77u);
  Nmt(129);
  Tick();
  EXPECT_EQ(Upload(0x200A, 0), 0u);
}

TEST_F(Canopen, AnAxisWithoutBusesIsSilent) {
  fw_config_t config{};
  fw_init(&fw_, &config);
  Nmt(1, 0);
  Send(0x601, Request(0x40, 0x1000, 0));
  Tick(1000);
  EXPECT_TRUE(Take().empty());
}

}  // namespace
