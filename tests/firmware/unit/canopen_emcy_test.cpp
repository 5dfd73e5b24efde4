// SYNC, emergencies and their history, the state of the bus.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "tests/firmware/unit/canopen_fixture.hpp"

namespace {

TEST_F(Canopen, ASyncWithDataIsReportedAndIgnored) {
  Start();
  for (int i = 0; i < 3; ++i) Send(0x80, {1});
  EXPECT_TRUE(Take().empty());
  Tick();
  EXPECT_EQ(Take(0x85), std::vector<Frame>{Emergency(0x8240, 0x11, 1)});
  EXPECT_EQ(Read(AXIS_OBJ_SYNC_COUNT), 0);
}

TEST_F(Canopen, FaultsComeAndGo) {
  Take();
  ShowFault(0x8611, AXIS_FAULT_FOLLOWING_ERROR);
  NodeTick(1);
  EXPECT_EQ(Take(), std::vector<Frame>{Emergency(0x8611, 0x21, AXIS_FAULT_FOLLOWING_ERROR)});
  EXPECT_EQ(Upload(0x1001, 0), 0x21u);
  NodeTick(10);
  EXPECT_TRUE(Take().empty());
  ShowFault(0, 0);
  NodeTick(1);
  EXPECT_EQ(Take(), std::vector<Frame>{Emergency(0, 0, 0)});
  EXPECT_EQ(Upload(0x1001, 0), 0u);
  EXPECT_EQ(Upload(0x1003, 0), 1u) << "a reset is no entry";
  EXPECT_EQ(Upload(0x1003, 1), 0x8611u + 0x10000u * AXIS_FAULT_FOLLOWING_ERROR);
}

TEST_F(Canopen, TheHistoryKeepsTheLatestEight) {
  for (uint16_t i = 1; i <= 10; ++i) {
    canopen_emergency(&fw_.canopen, static_cast<uint16_t>(0xFF00 + i), 0);
    Tick();
  }
  EXPECT_EQ(Upload(0x1003, 0), 8u);
  for (uint8_t i = 1; i <= 8; ++i) EXPECT_EQ(Upload(0x1003, i), 0xFF0Bu - i);
  for (uint32_t count : {1u, 8u, 255u}) EXPECT_EQ(Download(0x1003, 0, count, 1), 0x06090030u);
  EXPECT_EQ(Download(0x1003, 1, 0, 4), 0x06010002u);
  EXPECT_EQ(Download(0x1003, 0, 0, 1), 0u);
  EXPECT_EQ(Upload(0x1003, 0), 0u);
  for (uint8_t i = 1; i <= 8; ++i) EXPECT_EQ(UploadAbort(0x1003, i), 0x08000024u);
  canopen_emergency(&fw_.canopen, 0xFF04, 0);
  EXPECT_EQ(Upload(0x1003, 1), 0xFF04u);
  EXPECT_EQ(UploadAbort(0x1003, 2), 0x08000024u);
}

TEST_F(Canopen, EmergenciesKeepTheirInhibitTime) {
  ASSERT_EQ(Download(0x1015, 0, 100, 2), 0u);  // 10 ms, 15 ticks
  Take();
  for (uint16_t i = 1; i <= 6; ++i) canopen_emergency(&fw_.canopen, 0xFF00 + i, 0);
  std::vector<std::array<int, 2>> sent;
  for (int i = 0; i < 100; ++i) {
    NodeTick(1);
    for (const Frame &frame : Take(0x85)) sent.push_back({i, frame.data[0]});
  }
  // The queue holds four; the oldest are dropped, so that the last one sent is the current state.
  EXPECT_EQ(sent, (std::vector<std::array<int, 2>>{{0, 3}, {15, 4}, {30, 5}, {45, 6}}));
}

TEST_F(Canopen, EmcyCanBeSwitchedOff) {
  ASSERT_EQ(Download(0x1014, 0, 0x80000085, 4), 0u);
  canopen_emergency(&fw_.canopen, 0xFF04, 0);
  Tick();
  EXPECT_TRUE(Take(0x85).empty());
  EXPECT_EQ(Upload(0x1003, 0), 1u) << "the history goes on";
}

TEST_F(Canopen, AFloodOfRequestsLeavesRoomAndIsCounted) {
  Start();
  for (int i = 0; i < 20; ++i) Send(0x605, Request(0x40, 0x1000, 0));
  Tick(500);
  const auto frames = Take();
  EXPECT_EQ(frames.size(), 15u) << "PDOs leave two places, of which the heartbeat took one";
  EXPECT_EQ(std::ranges::count_if(frames, [](const Frame &f) { return f.id == 0x585; }), 10);
  EXPECT_EQ(std::ranges::count(frames, Emergency(0x8110, 0x11, 0)), 1);
  EXPECT_GE(std::ranges::count_if(frames, [](const Frame &f) { return f.id == 0x705; }), 1);
  EXPECT_GE(Read(AXIS_OBJ_CAN_LOST), 10);
  EXPECT_EQ(Upload(0x1003, 0), 1u) << "recorded once until all were sent";
}

TEST_F(Canopen, LostInputIsCountedAndReported) {
  Take();
  fw_can_lost(&fw_, 3);
  fw_can_lost(&fw_, 4);
  Tick();
  EXPECT_EQ(Take(), std::vector<Frame>{Emergency(0x8110, 0x11, 0)});
  EXPECT_EQ(Read(AXIS_OBJ_CAN_LOST), 7);
  fw_can_lost(&fw_, 65535);
  EXPECT_EQ(Read(AXIS_OBJ_CAN_LOST), 65535);
}

TEST_F(Canopen, BusStatesAreReported) {
  Take();
  fw_can_bus(&fw_, CAN_BUS_PASSIVE);
  NodeTick(1);
  EXPECT_EQ(Take(), std::vector<Frame>{Emergency(0x8120, 0x11, 0)});
  fw_can_bus(&fw_, CAN_BUS_ACTIVE);
  NodeTick(1);
  EXPECT_EQ(Take(), std::vector<Frame>{Emergency(0, 0, 0)});
  Nmt(1);
  canopen_emergency(&fw_.canopen, 0xFF04, 0);
  fw_can_bus(&fw_, CAN_BUS_OFF);
  EXPECT_EQ(Read(AXIS_OBJ_NMT_STATE), 127);
  NodeTick(400);
  EXPECT_TRUE(Take().empty()) << "off is off";
  EXPECT_EQ(Read(AXIS_OBJ_CAN_LOST), 0);
  fw_can_bus(&fw_, CAN_BUS_ACTIVE);
  NodeTick(1);
  EXPECT_EQ(Take(), (std::vector<Frame>{Emergency(0xFF04, 0, 0), Emergency(0x8140, 0x11, 0),
                                        Emergency(0, 0, 0)}));
}

TEST_F(Canopen, AStateOfTheBusThatIsNoChangeIsNotReported) {
  Take();
  for (int state : {+CAN_BUS_ACTIVE, +CAN_BUS_PASSIVE, +CAN_BUS_PASSIVE, 3, 255}) {
    fw_can_bus(&fw_, static_cast<uint8_t>(state));
  }
  NodeTick(3);
  EXPECT_EQ(Take(0x85), std::vector<Frame>{Emergency(0x8120, 0x11, 0)});
  fw_can_bus(&fw_, CAN_BUS_OFF);
  fw_can_bus(&fw_, CAN_BUS_OFF);
  fw_can_bus(&fw_, CAN_BUS_PASSIVE);
  NodeTick(3);
  EXPECT_EQ(Take(0x85),
            (std::vector<Frame>{Emergency(0x8140, 0x11, 0), Emergency(0x8120, 0x11, 0)}));
}

TEST_F(Canopen, AResetKeepsTheBusStateThatThePortReported) {
  fw_can_bus(&fw_, CAN_BUS_PASSIVE);
  Tick();
  Nmt(130);
  Tick();
  Take();
  Tick();
  EXPECT_EQ(Take(), std::vector<Frame>{Emergency(0x8120, 0x11, 0)});
}

}  // namespace
