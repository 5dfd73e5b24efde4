// PDOs: their bits, times, mapping and errors.

#include <gtest/gtest.h>

#include <cstdint>
#include <set>
#include <vector>

#include "tests/firmware/unit/canopen_fixture.hpp"

namespace {

TEST_F(Canopen, DefaultPdosWork) {
  Nmt(1);
  Take();
  Tick();
  // Event driven: once when it becomes operational.
  auto frames = Take(0x185);
  ASSERT_EQ(frames.size(), 1u);
  EXPECT_EQ(frames[0].data.size(), 3u);
  Send(0x80, {});
  frames = Take();
  ASSERT_EQ(frames.size(), 1u) << "TPDO2 alone, at once";
  EXPECT_EQ(frames[0].id, 0x285);
  EXPECT_EQ(frames[0].data.size(), 8u);
  Send(0x305, {0x00, 0x00, 0x78, 0x56, 0x34, 0x12});
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 0x12345678);
  Send(0x405, {0x00, 0x00, 0xFF, 0xFF, 0xFF, 0xFF});
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_VELOCITY), -1);
  Send(0x505, {0x00, 0x00, 0xFE, 0xFF});
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_FORCE), -2);
}

TEST_F(Canopen, TheEventTimerAndChangesSendATpdo) {
  Start();
  fw_.drive.signals.statusword = 0x1234;
  NodeTick(1);
  EXPECT_EQ(Take(0x185), (std::vector<Frame>{{0x185, {0x34, 0x12, 0}}})) << "in the same tick";
  NodeTick(29);
  EXPECT_TRUE(Take(0x185).empty());
  NodeTick(1);
  EXPECT_EQ(Take(0x185).size(), 1u) << "20 ms after it was last sent";
  Nmt(128);
  fw_.drive.signals.statusword = 1;
  NodeTick(100);
  EXPECT_TRUE(Take(0x185).empty()) << "not operational";
}

TEST_F(Canopen, ADeferredTickSendsItsTpdosToo) {
  Start();
  for (const uint16_t word : {0x1234, 0x4321}) {
    fw_.drive.signals.statusword = word;
    NodeTickOf(fw_, true);
    Bytes data = LittleEndian(word, 2);
    data.push_back(0);
    EXPECT_EQ(Take(0x185), (std::vector<Frame>{{0x185, data}})) << "in the same tick";
  }
}

TEST_F(Canopen, AnEventTimeOfZeroIsNone) {
  Start();
  ASSERT_EQ(Download(0x1800, 5, 0, 2), 0u);
  NodeTick(1);
  Take();
  NodeTick(200);
  EXPECT_TRUE(Take(0x185).empty()) << "neither the old time nor a new one";
  fw_.drive.signals.statusword = 0x1234;
  NodeTick(1);
  EXPECT_EQ(Take(0x185).size(), 1u) << "a change is sent all the same";
  NodeTick(200);
  EXPECT_TRUE(Take(0x185).empty());
}

// After ticks that did not run, a PDO that was due is sent once, at the next tick, and from there
// on at its interval; timers that are not due keep their ends.
TEST_F(Canopen, TicksThatWereMissedAreMadeUpForAtOnce) {
  Start();
  fw_.drive.signals.statusword = 0x1234;
  NodeTick(1);
  ASSERT_EQ(Take(0x185).size(), 1u);  // again after 30 ticks
  NodeTick(10);
  const uint32_t ticks = fw_.axis.signals.tick_count;
  fw_overrun(&fw_, 15);
  EXPECT_EQ(fw_.axis.signals.tick_count, ticks + 15);
  NodeTick(4);
  EXPECT_TRUE(Take(0x185).empty());
  NodeTick(1);
  EXPECT_EQ(Take(0x185).size(), 1u) << "10 + 15 + 5 ticks after it was last sent";
  fw_overrun(&fw_, 450);
  EXPECT_EQ(fw_.device_signals.overruns, 15 + 450);
  NodeTick(1);
  EXPECT_EQ(Take(0x185).size(), 1u);
  NodeTick(29);
  EXPECT_TRUE(Take(0x185).empty());
  NodeTick(1);
  EXPECT_EQ(Take(0x185).size(), 1u);
}

// During missed ticks nothing can be received, so a deadline is extended by as many ticks.
TEST_F(Canopen, TicksThatWereMissedAreNoSilenceOfAMaster) {
  ASSERT_EQ(Download(0x1016, 1, 9 << 16 | 100, 4), 0u);  // 150 ticks
  Send(0x709, {5});
  Tick(100);
  fw_overrun(&fw_, 1000);
  Take();
  Tick(50);
  EXPECT_EQ(fw_.canopen.heartbeats_lost, 0);
  Tick(1);
  EXPECT_EQ(fw_.canopen.heartbeats_lost, 1);
}

TEST_F(Canopen, TheInhibitTimeHoldsChangesBack) {
  EXPECT_EQ(Download(0x1800, 3, 50, 2), 0x08000022u) << "not while it is valid";
  ASSERT_EQ(Download(0x1800, 1, 0xC0000185, 4), 0u);
  ASSERT_EQ(Download(0x1800, 3, 50, 2), 0u);  // 5 ms: 7.5, so 8 ticks
  ASSERT_EQ(Download(0x1800, 1, 0x40000185, 4), 0u);
  Nmt(1);
  Take();
  int sent_at = -1;
  for (int i = 0; i < 100; ++i) {
    fw_.drive.signals.statusword = static_cast<uint16_t>(i + 1);
    NodeTick(1);
    if (Take(0x185).empty()) continue;
    if (sent_at >= 0) {
      EXPECT_EQ(i - sent_at, 8);
    }
    sent_at = i;
  }
  EXPECT_GT(sent_at, 80);
}

TEST_F(Canopen, SynchronousTypes) {
  Nmt(1);
  for (int type : {1, 2, 3, 240}) {
    ASSERT_EQ(Download(0x1801, 2, static_cast<uint32_t>(type), 1), 0u);
    Take();
    for (int sync = 1; sync <= 2 * type; ++sync) {
      Send(0x80, {});
      EXPECT_EQ(Take(0x285).size(), sync % type == 0 ? 1u : 0u) << type << " at " << sync;
    }
  }
  ASSERT_EQ(Download(0x1801, 2, 0, 1), 0u);
  Send(0x80, {});
  EXPECT_EQ(Take(0x285).size(), 1u);
  Send(0x80, {});
  EXPECT_TRUE(Take(0x285).empty()) << "nothing has changed";
  fw_.drive.signals.position_actual += 1;
  NodeTick(10);
  EXPECT_TRUE(Take(0x285).empty());
  Send(0x80, {});
  EXPECT_EQ(Take(0x285).size(), 1u);
  for (int type : {0, 1, 240, 254, 255}) {
    EXPECT_EQ(Download(0x1801, 2, static_cast<uint32_t>(type), 1), 0u) << type;
    EXPECT_EQ(Download(0x1401, 2, static_cast<uint32_t>(type), 1), 0u) << type;
  }
  for (int type = 241; type <= 253; ++type) {
    EXPECT_EQ(Download(0x1801, 2, static_cast<uint32_t>(type), 1), 0x06090030u);
    EXPECT_EQ(Download(0x1401, 2, static_cast<uint32_t>(type), 1), 0x06090030u);
  }
}

// CiA 301, 1019h: a SYNC has a counter then, and the length says which kind of network it is of.
TEST_F(Canopen, ASyncWithACounterIsOneByteLong) {
  EXPECT_EQ(Download(0x1019, 0, 1, 1), 0x06090030u) << "reserved";
  EXPECT_EQ(Download(0x1019, 0, 241, 1), 0x06090031u);
  EXPECT_EQ(Download(0x1019, 0, 240, 1), 0u);
  EXPECT_EQ(Download(0x1019, 0, 2, 1), 0u);
  Start();
  Send(0x80, {});
  Send(0x80, {1, 2});
  Tick();
  EXPECT_EQ(Take(0x85), std::vector<Frame>{Emergency(0x8240, 0x11, 0)}) << "once for both";
  EXPECT_EQ(Read(AXIS_OBJ_SYNC_COUNT), 0);
  Send(0x80, {1});
  Send(0x80, {2, 0});
  Tick();
  EXPECT_EQ(Take(0x85), std::vector<Frame>{Emergency(0x8240, 0x11, 2)});
  EXPECT_EQ(Read(AXIS_OBJ_SYNC_COUNT), 1);
}

TEST_F(Canopen, ATpdoStartsWithTheSyncOfItsStartValue) {
  ASSERT_EQ(Download(0x1019, 0, 10, 1), 0u);
  EXPECT_EQ(Download(0x1801, 6, 3, 1), 0x08000022u) << "while it is valid";
  const auto configure = [&](uint32_t type, uint32_t first) {
    ASSERT_EQ(Download(0x1801, 1, 0xC0000285, 4), 0u);
    ASSERT_EQ(Download(0x1801, 2, type, 1), 0u);
    ASSERT_EQ(Download(0x1801, 6, first, 1), 0u);
    ASSERT_EQ(Download(0x1801, 1, 0x40000285, 4), 0u);
  };
  Start();
  const auto sync = [&](uint8_t counter) {
    Send(0x80, {counter});
    return Take(0x285).size();
  };
  configure(2, 3);
  for (uint8_t counter : {1, 2, 4, 10, 2}) EXPECT_EQ(sync(counter), 0u) << int{counter};
  EXPECT_EQ(sync(3), 0u) << "the first of two";
  EXPECT_EQ(sync(4), 1u);
  EXPECT_EQ(sync(5), 0u);
  EXPECT_EQ(sync(6), 1u);
  Nmt(128);
  Nmt(1);
  EXPECT_EQ(sync(7), 0u);
  EXPECT_EQ(sync(8), 0u) << "awaited again after operational was left";
  configure(0, 9);
  EXPECT_EQ(sync(8), 0u);
  EXPECT_EQ(sync(9), 1u);
  configure(1, 0);
  EXPECT_EQ(sync(7), 1u) << "any";
  ASSERT_EQ(Download(0x1019, 0, 0, 1), 0u);
  configure(1, 9);
  Send(0x80, {});
  EXPECT_EQ(Take(0x285).size(), 1u) << "no counter to wait for";
}

TEST_F(Canopen, SynchronousRpdosWaitForSync) {
  ASSERT_EQ(Download(0x1401, 2, 1, 1), 0u);
  Nmt(1);
  Send(0x305, {0x00, 0x00, 1, 0, 0, 0});
  Send(0x305, {0x00, 0x00, 2, 0, 0, 0});
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 0);
  Send(0x80, {});
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 2);
  Set(AXIS_OBJ_TARGET_POSITION, 7);
  Send(0x80, {});
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 7) << "a frame acts once";
  Set(AXIS_OBJ_TARGET_POSITION, 2);
  Send(0x305, {0x00, 0x00, 3, 0, 0, 0});
  Nmt(128);
  Nmt(1);
  Send(0x80, {});
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 2) << "discarded with the state";
}

TEST_F(Canopen, RemapsAtRunTime) {
  Start();
  Remap(0x1A02 - 0x200, 0x1A02, 0x40000385, {0x60640020, 0x60410010, 0x60610008, 0x22100008}, 1);
  fw_.drive.signals.position_actual = 0x04030201;
  fw_.drive.signals.statusword = 0x0605;
  fw_.drive.signals.modes_of_operation_display = 7;
  fw_.drive.signals.contact = 1;
  Take();
  Send(0x80, {});
  EXPECT_EQ(Take(0x385), (std::vector<Frame>{{0x385, {1, 2, 3, 4, 5, 6, 7, 1}}}));
  // Dummies keep places free, even of one bit.
  Remap(0x1403, 0x1603, 0x505, {0x00010001, 0x00050008, 0x60710010, 0x00020008}, 255);
  // 25 bits before the last: the value is bits 9 to 24 of the frame.
  const uint64_t bits = uint64_t{0xABCD & 0x7FFF} << 9;
  std::vector<uint8_t> data = LittleEndian(static_cast<uint32_t>(bits), 4);
  data.push_back(0);
  Send(0x505, data);
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_FORCE), 0x2BCD);
}

TEST_F(Canopen, MappingIsRefusedWhilePdoIsValid) {
  for (uint16_t pdo = 0; pdo < 2; ++pdo) {
    for (uint16_t side : {0x0000, 0x0400}) {
      const uint16_t mapping = static_cast<uint16_t>(0x1600 + side + pdo);
      const uint16_t communication = static_cast<uint16_t>(mapping - 0x200);
      const uint32_t entry = *Upload(mapping, 1);
      const uint32_t cob_id = *Upload(communication, 1);
      EXPECT_EQ(Download(mapping, 0, 0, 1), 0x08000022u);
      EXPECT_EQ(Download(mapping, 0, 2, 1), 0u) << "what it is already";
      EXPECT_EQ(Download(mapping, 1, entry, 4), 0u) << "what it is already";
      EXPECT_EQ(Download(mapping, 1, 0x60FF0020, 4), 0x08000022u);
      EXPECT_EQ(Download(communication, 1, cob_id + 0x20, 4), 0x08000022u);
      EXPECT_EQ(Download(communication, 1, (cob_id + 0x20) | 0x80000000u, 4), 0u);
      EXPECT_EQ(Download(mapping, 1, 0x60FF0020, 4), 0x08000022u) << "not while any are mapped";
      EXPECT_EQ(Download(mapping, 0, 0, 1), 0u);
      EXPECT_EQ(Download(mapping, 1, 0x60FF0020, 4), 0u);
      EXPECT_EQ(Download(mapping, 0, 9, 1), 0x06090031u);
      EXPECT_EQ(Download(mapping, 0, 1, 1), 0u);
      EXPECT_EQ(Download(communication, 1, cob_id + 0x20, 4), 0u);
    }
  }
}

// What a stream of frames must not repeat in every cycle: the reset of a fault, who owns the axis,
// a native mode, what becomes of an incident.
TEST_F(Canopen, DecisionsAboutTheAxisAreReceivedByNoPdo) {
  for (uint16_t mapping : {0x1603, 0x1A03}) {
    const bool transmit = mapping == 0x1A03;
    const uint16_t communication = static_cast<uint16_t>(mapping - 0x200);
    ASSERT_EQ(Download(communication, 1, transmit ? 0xC0000000u : 0x80000000u, 4), 0u);
    ASSERT_EQ(Download(mapping, 0, 0, 1), 0u);
    for (uint16_t object :
         std::initializer_list<uint16_t>{AXIS_OBJ_FAULT_RESET, AXIS_OBJ_COMMAND_SOURCE,
                                         AXIS_OBJ_MODE, AXIS_OBJ_INCIDENT_COMMAND}) {
      const axis_address_t *at = AddressOf(object);
      const auto bits = 8u * value_bytes(axis_objects[object].type);
      const uint32_t entry = uint32_t{at->index} << 16 | uint32_t{at->sub} << 8 | bits;
      // What is read as well may be shown by a TPDO: gateways send who owns the axis.
      const bool shown = transmit && axis_objects[object].access == AXIS_ACCESS_RW;
      EXPECT_EQ(Download(mapping, 1, entry, 4), shown ? 0u : 0x06040041u) << std::hex << entry;
      EXPECT_EQ(Upload(mapping, 1) == entry, shown);
    }
  }
}

TEST_F(Canopen, EntriesAreChecked) {
  for (uint16_t mapping : {0x1603, 0x1A03}) {
    const bool transmit = mapping == 0x1A03;
    const uint16_t communication = static_cast<uint16_t>(mapping - 0x200);
    ASSERT_EQ(Download(communication, 1, transmit ? 0xC0000000u : 0x80000000u, 4), 0u)
        << "the short way to switch it off";
    ASSERT_EQ(Download(mapping, 0, 0, 1), 0u);
    EXPECT_EQ(Download(mapping, 1, 0x50000008, 4), 0x06020000u);
    EXPECT_EQ(Download(mapping, 1, 0x60400110, 4), 0x06020000u) << "no such sub-index";
    EXPECT_EQ(Download(mapping, 1, 0x60710008, 4), 0x06040041u) << "16 bits";
    EXPECT_EQ(Download(mapping, 1, 0x10170010, 4), 0x06040041u) << "communication";
    EXPECT_EQ(Download(mapping, 1, 0x10180008, 4), 0x06040041u) << "a number of sub-indices";
    EXPECT_EQ(Download(mapping, 1, 0x10080008, 4), 0x06040041u) << "a text";
    EXPECT_EQ(Download(mapping, 1, 0x21070008, 4), transmit ? 0x06040041u : 0u) << "write only";
    EXPECT_EQ(Download(mapping, 1, 0x60410010, 4), transmit ? 0u : 0x06040041u) << "read only";
    EXPECT_EQ(Download(mapping, 1, 0x00050008, 4), transmit ? 0x06020000u : 0u) << "a dummy";
    EXPECT_EQ(Download(mapping, 1, 0x00050010, 4), transmit ? 0x06020000u : 0x06040041u);
    EXPECT_EQ(Download(mapping, 1, 0, 4), 0u) << "empty";
    EXPECT_EQ(Download(mapping, 0, 1, 1), 0x06040042u) << "but not to be mapped";
    for (uint8_t i = 1; i <= 3; ++i) ASSERT_EQ(Download(mapping, i, 0x607A0020, 4), 0u);
    EXPECT_EQ(Download(mapping, 0, 3, 1), 0x06040042u) << "96 bits";
    EXPECT_EQ(Upload(mapping, 0), 0u);
    EXPECT_EQ(Download(mapping, 0, 2, 1), 0u);
  }
}

TEST_F(Canopen, CobIdsAreChecked) {
  const auto restricted = [](uint32_t id) {
    return id <= 0x7F || (id >= 0x101 && id <= 0x180) || (id >= 0x581 && id <= 0x5FF) ||
           (id >= 0x601 && id <= 0x67F) || (id >= 0x6E0 && id <= 0x6FF) || id >= 0x701;
  };
  for (uint16_t index : {0x1400, 0x1800}) {
    const uint32_t rtr = index == 0x1800 ? 0x40000000 : 0;
    // Of SYNC, EMCY, the gateway's servers, and the valid PDOs of the other direction.
    std::set<uint32_t> taken{0x080,      0x080 + kNode, kModbusServer, kModbusServer + 1,
                             kLcmServer, kLcmServer + 1};
    for (uint32_t other : (index == 0x1400) ? std::vector<uint32_t>{0x180, 0x280}
                                            : std::vector<uint32_t>{0x300, 0x400, 0x500}) {
      taken.insert(other + kNode);
    }
    for (uint32_t id = 0; id < 0x800; ++id) {
      ASSERT_EQ(Download(index, 1, 0x80000000u | rtr | id, 4), 0u);
      ASSERT_EQ(Download(index, 1, rtr | id, 4),
                restricted(id) || taken.count(id) != 0 ? 0x06090030u : 0u)
          << std::hex << id;
    }
    ASSERT_EQ(Download(index, 1, 0x80000205u | rtr, 4), 0u);
    EXPECT_EQ(Download(index, 1, 0x20000205u | rtr, 4), 0x06090030u) << "29 bits";
    EXPECT_EQ(Download(index, 1, 0x00001205u | rtr, 4), 0x06090030u);
  }
  for (uint16_t index : {0x1800, 0x1801, 0x1802, 0x1803}) {
    EXPECT_EQ(*Upload(index, 1) & 0x40000000u, 0x40000000u) << "by default";
    EXPECT_EQ(Download(index, 1, 0x80000186u, 4), 0x06090030u) << "remote requests, not valid";
    EXPECT_EQ(Download(index, 1, 0x00000186u, 4), 0x06090030u) << "and valid";
  }
  EXPECT_EQ(Download(0x1005, 0, 0x40000080, 4), 0x06090030u) << "it does not produce SYNC";
  EXPECT_EQ(Download(0x1005, 0, 0x601, 4), 0x06090030u);
  EXPECT_EQ(Download(0x1005, 0, 0x100, 4), 0u);
  Send(0x80, {});
  EXPECT_EQ(Read(AXIS_OBJ_SYNC_COUNT), 0);
  Send(0x100, {});
  EXPECT_EQ(Read(AXIS_OBJ_SYNC_COUNT), 1);
  EXPECT_EQ(Download(0x1014, 0, 0x90, 4), 0x08000022u);
  EXPECT_EQ(Download(0x1014, 0, 0x80000090, 4), 0u);
  EXPECT_EQ(Download(0x1014, 0, 0x90, 4), 0u);
}

TEST_F(Canopen, PdoLengthErrorsAreReportedOnce) {
  Start();
  for (int i = 0; i < 5; ++i) Send(0x305, {0, 0, 1, 0, 0});
  Tick();
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 0);
  EXPECT_EQ(Take(0x85), std::vector<Frame>{Emergency(0x8210, 0x11, 2)});
  Send(0x305, {0, 0, 1, 0, 0, 0});
  Send(0x305, {0, 0});
  Tick();
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 1);
  EXPECT_EQ(Take(0x85), std::vector<Frame>{Emergency(0x8210, 0x11, 2)});
  Send(0x305, {0, 0, 2, 0, 0, 0, 9, 9});
  Tick();
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 2) << "the first bytes";
  EXPECT_EQ(Take(0x85), std::vector<Frame>{Emergency(0x8220, 0x11, 2)});
  EXPECT_EQ(Read(AXIS_OBJ_ERROR_REGISTER), 0) << "it does not last";
}

TEST_F(Canopen, AnRpdoWithNothingMappedDoesNothing) {
  Start();
  Remap(0x1403, 0x1603, 0x505, {}, 255);
  Send(0x505, {1, 2, 3});
  Send(0x505, {});
  Tick();
  EXPECT_EQ(Take(0x85), std::vector<Frame>{});
  EXPECT_EQ(Read(AXIS_OBJ_ERROR_HISTORY_COUNT), 0);
}

TEST_F(Canopen, ARefusedValueIsReportedAndTheOthersAct) {
  Start();
  Remap(0x1403, 0x1603, 0x505, {0x60FF0020, 0x60710010}, 255);
  for (int i = 0; i < 3; ++i) Send(0x505, {0xFF, 0xFF, 0xFF, 0x7F, 7, 0});
  Tick();
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_VELOCITY), 0);
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_FORCE), 7);
  EXPECT_EQ(Take(0x85), std::vector<Frame>{Emergency(0x6320, 0x01, 4)});
  EXPECT_EQ(Read(AXIS_OBJ_NMT_STATE), 5);
  // While another source owns the axis it is silence, not an error.
  ASSERT_EQ(Download(0x2301, 0, 2, 1, kLcmServer), 0u);
  Send(0x505, {0, 0, 0, 0, 0, 0});
  Tick();
  EXPECT_TRUE(Take(0x85).empty());
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_FORCE), 7);
}

// While another source owns the axis an RPDO has no effect and is no error. Errors that do not
// depend on the owner are reported as usual afterwards.
TEST_F(Canopen, ALockedRpdoIsNoError) {
  Start();
  Remap(0x1403, 0x1603, 0x505, {0x60FF0020, 0x60710010}, 255);
  Send(0x505, {1, 0, 0, 0, 2, 0});
  ASSERT_EQ(Read(AXIS_OBJ_TARGET_VELOCITY), 1);
  ASSERT_EQ(Download(0x2301, 0, 2, 1, kLcmServer), 0u);  // LCM acquires the axis
  for (int i = 0; i < 3; ++i) {
    Send(0x505, {9, 0, 0, 0, 9, 0});
    Tick();
    EXPECT_EQ(Take(0x85), std::vector<Frame>{}) << i;
  }
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_VELOCITY), 1);
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_FORCE), 2);
  EXPECT_EQ(Read(AXIS_OBJ_ERROR_HISTORY_COUNT), 0);
  ASSERT_EQ(Download(0x2301, 0, 0, 1, kLcmServer), 0u);  // and releases it
  Send(0x505, {0xFF, 0xFF, 0xFF, 0x7F, 7, 0});           // above the range of a speed
  Tick();
  EXPECT_EQ(Take(0x85), std::vector<Frame>{Emergency(0x6320, 0x01, 4)});
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_FORCE), 7);
}

TEST_F(Canopen, AnRpdoThatStaysAwayFromAnActiveAxisIsAFault) {
  ASSERT_EQ(Download(0x1800, 1, 0xC0000185, 4), 0u);
  ASSERT_EQ(Download(0x1401, 5, 100, 2), 0u);  // 150 ticks
  ASSERT_EQ(Download(0x6007, 0, 0, 2), 0u);    // without a reaction of the drive
  Start();
  Send(0x305, {0, 0, 1, 0, 0, 0});
  NodeTick(1000);
  EXPECT_EQ(Take(0x85), std::vector<Frame>{}) << "nobody is hurt by a disabled axis";
  fw_.axis.signals.active_mode = AXIS_MODE_POSITION;
  NodeTick(150);
  EXPECT_TRUE(Take(0x85).empty()) << "counted from the start of the mode";
  NodeTick(1);
  EXPECT_EQ(Take(0x85), std::vector<Frame>{Emergency(0x8250, 0x11, 2)});
  EXPECT_EQ(Read(AXIS_OBJ_ERROR_REGISTER), 0x11);
  Send(0x305, {0, 0, 1, 0, 0, 0});
  NodeTick(150);
  EXPECT_EQ(Take(0x85), std::vector<Frame>{Emergency(0, 0, 0)});
  Send(0x305, {0, 0, 1, 0, 0, 0});
  NodeTick(150);
  EXPECT_TRUE(Take(0x85).empty());
}

}  // namespace
