// The three SDO servers: lengths, abort codes, segments, time-outs.

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "tests/firmware/unit/canopen_fixture.hpp"

namespace {

TEST_F(Canopen, ReadsEveryAddressOfTheTable) {
  Take();
  for (const axis_address_t &at : axis_addresses) {
    const auto answer = Ask(Request(0x40, at.index, at.sub));
    ASSERT_EQ(answer.size(), 8u) << std::hex << at.index;
    EXPECT_EQ(answer[1] | answer[2] << 8, at.index);
    EXPECT_EQ(answer[3], at.sub);
    if (at.what == AXIS_ADDRESS_COUNT) {
      EXPECT_EQ(answer[0], 0x4F);
      EXPECT_EQ(Word(answer), at.value);
    } else if (at.what == AXIS_ADDRESS_OBJECT) {
      const axis_object_t &object = axis_objects[at.value];
      if (object.access == AXIS_ACCESS_WO) {
        EXPECT_EQ(answer[0], 0x80);
        EXPECT_EQ(Word(answer), 0x06010001u);
        continue;
      }
      if (at.index == 0x1003 && at.sub > 0) {
        EXPECT_EQ(answer[0], 0x80);
        EXPECT_EQ(Word(answer), 0x08000024u) << "no error yet";
        continue;
      }
      const uint8_t commands[] = {0, 0x4F, 0x4B, 0, 0x43};
      const int bytes = value_bytes(object.type);
      EXPECT_EQ(answer[0], commands[bytes]) << std::hex << at.index;
      const uint32_t mask = bytes == 4 ? 0xFFFFFFFFu : (1u << (8 * bytes)) - 1;
      EXPECT_EQ(Word(answer), static_cast<uint32_t>(Read(at.value)) & mask);
    }
  }
}

TEST_F(Canopen, CobIdsCarryTheNodeId) {
  EXPECT_EQ(Upload(0x1014, 0), 0x85u);
  EXPECT_EQ(Upload(0x1200, 1), 0x605u);
  EXPECT_EQ(Upload(0x1200, 2), 0x585u);
  EXPECT_EQ(Upload(0x1403, 1), 0x505u);
  EXPECT_EQ(Upload(0x1800, 1), 0x40000185u);
  EXPECT_EQ(Upload(0x1018, 4), 0x12345678u);
}

TEST_F(Canopen, ReadOnlyObjectsRefuseEveryLength) {
  int count = 0;
  for (const axis_address_t &at : axis_addresses) {
    if (at.what == AXIS_ADDRESS_OBJECT && axis_objects[at.value].access != AXIS_ACCESS_RO) continue;
    if (at.what == AXIS_ADDRESS_DOWNLOAD) continue;  // fw_programs_test.cpp
    ++count;
    for (int bytes = 1; bytes <= 4; ++bytes) {
      EXPECT_EQ(Download(at.index, at.sub, 0, bytes), 0x06010002u)
          << std::hex << at.index << ' ' << int{at.sub} << ' ' << bytes;
    }
    EXPECT_EQ(Word(Ask(Request(0x22, at.index, at.sub))), 0x06010002u) << "no length";
    EXPECT_EQ(Word(Ask(Request(0x20, at.index, at.sub))), 0x06010002u) << "segments, no length";
    for (uint32_t size : {0u, 1u, 2u, 3u, 4u, 5u, 7u, 8u, 256u, 0xFFFFFFFFu}) {
      EXPECT_EQ(Word(Ask(Request(0x21, at.index, at.sub, size))), 0x06010002u) << size;
    }
  }
  EXPECT_GT(count, 90);
}

TEST_F(Canopen, WritableObjectsRefuseWrongLengths) {
  for (const axis_address_t &at : axis_addresses) {
    if (at.what != AXIS_ADDRESS_OBJECT || axis_objects[at.value].access == AXIS_ACCESS_RO) continue;
    const int right = value_bytes(axis_objects[at.value].type);
    for (int bytes = 1; bytes <= 4; ++bytes) {
      if (bytes == right) continue;
      const uint32_t expected = bytes > right ? 0x06070012u : 0x06070013u;
      EXPECT_EQ(Download(at.index, at.sub, 0, bytes), expected) << std::hex << at.index;
    }
  }
}

TEST_F(Canopen, AbortCodesOfValues) {
  EXPECT_EQ(Download(0x5000, 0, 0, 1), 0x06020000u);
  EXPECT_EQ(Download(0x1018, 9, 0, 1), 0x06090011u);
  EXPECT_EQ(UploadAbort(0x5000, 0), 0x06020000u);
  EXPECT_EQ(UploadAbort(0x1018, 9), 0x06090011u);
  EXPECT_EQ(UploadAbort(0x2001, 1), 0x06090011u);
  EXPECT_EQ(UploadAbort(0x201E, 0), 0x06010001u);
  EXPECT_EQ(Download(0x200F, 0, 17, 1), 0x06090031u);  // adc_bits 8..16
  EXPECT_EQ(Download(0x200F, 0, 7, 1), 0x06090032u);
  EXPECT_EQ(Download(0x200D, 0, 0, 1), 0x06090030u);  // force_sign -1 or 1
  EXPECT_EQ(Download(0x200D, 0, 0xFF, 1), 0u);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_SIGN), -1) << "signs are extended";
  EXPECT_EQ(Download(0x1010, 1, 0x73617665, 4), 0x08000020u) << "\"save\" backwards";
  EXPECT_EQ(Download(0x1011, 1, 0x65766173, 4), 0x08000020u) << "the other's signature";
  EXPECT_EQ(Download(0x1010, 1, 0x65766173, 4), 0x06060000u) << "without a memory";
  EXPECT_EQ(Download(0x2001, 0, 3, 1), 0x08000022u) << "a native mode over a bus";
  EXPECT_EQ(UploadAbort(0x2120, 0), 0x08000024u) << "no recording";
  EXPECT_EQ(Download(0x2107, 0, 1, 1), 0x06090030u) << "arm without a channel";
  fw_.axis.signals.active_mode = AXIS_MODE_FORCE;
  EXPECT_EQ(Download(0x200F, 0, 12, 1), 0x08000022u) << "only while disabled";
}

TEST_F(Canopen, ServersWriteForTheirSources) {
  EXPECT_EQ(Download(0x200A, 0, 100, 2, kModbusServer), 0x08000021u) << "canopen owns the axis";
  EXPECT_EQ(Download(0x200A, 0, 100, 2, kLcmServer), 0x08000021u);
  EXPECT_EQ(Download(0x2301, 0, 2, 1, kModbusServer), 0x08000021u) << "only its own number";
  EXPECT_EQ(Download(0x2301, 0, 1, 1, kModbusServer), 0u);
  EXPECT_EQ(Download(0x200A, 0, 100, 2), 0x08000021u);
  EXPECT_EQ(Download(0x200A, 0, 100, 2, kLcmServer), 0x08000021u);
  EXPECT_EQ(Download(0x200A, 0, 100, 2, kModbusServer), 0u);
  EXPECT_EQ(Upload(0x200A, 0), 100u) << "all may read";
  EXPECT_EQ(Upload(0x200A, 0, kLcmServer), 100u);
  Tick(1400);
  EXPECT_EQ(Download(0x200A, 0, 100, 2, kModbusServer), 0u);
  Tick(1400);
  EXPECT_EQ(Read(AXIS_OBJ_COMMAND_SOURCE), AXIS_COMMAND_SOURCE_MODBUS) << "a write keeps the axis";
  EXPECT_EQ(Upload(0x200A, 0, kModbusServer), 100u);
  EXPECT_EQ(Download(0x200F, 0, 7, 1, kModbusServer), 0x06090032u);
  Send(kModbusServer, {0x2B, 0x0A, 0x20});
  Tick(200);
  EXPECT_EQ(Read(AXIS_OBJ_COMMAND_SOURCE), AXIS_COMMAND_SOURCE_CANOPEN) << "nothing else does";
  EXPECT_EQ(Download(0x200A, 0, 101, 2), 0u);
}

// The other servers: off at power-up, each on once both of its identifiers are valid.
TEST_F(Canopen, ServersOfAGatewayAreOffUntilBothIdentifiersAreValid) {
  fw_config_t config = NodeConfig();
  fw_init(&fw_, &config);
  Take();
  for (uint16_t index : {0x1201, 0x1202}) {
    for (uint8_t sub : {1, 2}) EXPECT_EQ(Upload(index, sub), 0x80000000u);
  }
  for (uint16_t id : {0x645, 0x665, 0x680, 0x682, 0x000}) {
    Send(id, Request(0x40, 0x1000, 0));
    Send(id, Request(0x2F, 0x2301, 0, 1));
  }
  EXPECT_TRUE(Take().empty());
  EXPECT_EQ(Read(AXIS_OBJ_COMMAND_SOURCE), AXIS_COMMAND_SOURCE_CANOPEN);
  ASSERT_EQ(Download(0x1201, 1, kModbusServer, 4), 0u);
  EXPECT_FALSE(Upload(0x1000, 0, kModbusServer)) << "no identifier for the answer";
  ASSERT_EQ(Download(0x1201, 2, kModbusServer + 1, 4), 0u);
  EXPECT_EQ(Upload(0x1000, 0, kModbusServer), 0x00020192u);
  ASSERT_EQ(Download(0x1202, 2, kLcmServer + 1, 4), 0u);
  EXPECT_FALSE(Upload(0x1000, 0, kLcmServer)) << "no identifier for the request";
  ASSERT_EQ(Download(0x1202, 1, kLcmServer, 4), 0u);
  EXPECT_EQ(Upload(0x1000, 0, kLcmServer), 0x00020192u);
  EXPECT_EQ(Download(0x1201, 2, 0x80000000u | (kModbusServer + 1), 4), 0u);
  EXPECT_FALSE(Upload(0x1000, 0, kModbusServer));
  EXPECT_EQ(Upload(0x1000, 0, kLcmServer), 0x00020192u) << "the other one stays";
}

TEST_F(Canopen, IdentifiersOfServersAreChecked) {
  const auto restricted = [](uint32_t id) {
    return id <= 0x7F || (id >= 0x101 && id <= 0x180) || (id >= 0x581 && id <= 0x5FF) ||
           (id >= 0x601 && id <= 0x67F) || (id >= 0x6E0 && id <= 0x6FF) || id >= 0x701;
  };
  // Of SYNC, EMCY, valid PDOs, and the servers but for the object that is written.
  std::set<uint32_t> taken{0x080,      0x080 + kNode, kModbusServer, kModbusServer + 1,
                           kLcmServer, kLcmServer + 1};
  for (uint32_t first : {0x180, 0x280, 0x200, 0x300, 0x400, 0x500}) taken.insert(first + kNode);
  for (uint16_t index : {0x1201, 0x1202}) {
    for (uint8_t sub : {1, 2}) {
      const uint32_t before = *Upload(index, sub);
      EXPECT_EQ(Download(index, sub, before + 4, 4), 0x08000022u) << "not while it is valid";
      EXPECT_EQ(Download(index, sub, before, 4), 0u) << "what it is already";
      for (uint32_t id = 0; id < 0x800; ++id) {
        ASSERT_EQ(Download(index, sub, 0x80000000u | id, 4), 0u);
        const bool is_other = id != before && taken.count(id) != 0;
        ASSERT_EQ(Download(index, sub, id, 4), restricted(id) || is_other ? 0x06090030u : 0u)
            << std::hex << id;
      }
      EXPECT_EQ(Download(index, sub, 0x80000800u, 4), 0x06090030u) << "29 bits";
      ASSERT_EQ(Download(index, sub, 0x80000000u, 4), 0u);
      ASSERT_EQ(Download(index, sub, before, 4), 0u);
    }
  }
  EXPECT_EQ(Download(0x1200, 1, 0x80000605u, 4), 0x06010002u) << "the default server stays";
}

// A server, SYNC or EMCY on the identifier of RPDO 1 would take its frames, and its stop with them.
TEST_F(Canopen, NoServiceIsMovedOntoTheIdentifierOfAnRpdo) {
  constexpr uint32_t kRpdo1 = 0x200 + kNode;
  ASSERT_EQ(Download(0x1201, 1, 0x80000000u, 4), 0u);
  EXPECT_EQ(Download(0x1201, 1, kRpdo1, 4), 0x06090030u);
  EXPECT_EQ(Download(0x1005, 0, kRpdo1, 4), 0x06090030u);
  ASSERT_EQ(Download(0x1014, 0, 0x80000000u, 4), 0u);
  EXPECT_EQ(Download(0x1014, 0, kRpdo1, 4), 0x06090030u);
  // Nor an RPDO onto theirs; a second RPDO may have it, and both are served.
  ASSERT_EQ(Download(0x1401, 1, 0x80000000u, 4), 0u);
  EXPECT_EQ(Download(0x1401, 1, 0x80, 4), 0x06090030u);
  EXPECT_EQ(Download(0x1401, 1, kRpdo1, 4), 0u);
}

TEST_F(Canopen, AResetForgetsTheServersOfAGateway) {
  for (uint8_t command : {129, 130}) {
    EnableServers();
    ASSERT_TRUE(Upload(0x1000, 0, kModbusServer));
    Nmt(command);
    Tick(3);
    Take();
    for (uint16_t index : {0x1201, 0x1202}) {
      for (uint8_t sub : {1, 2}) EXPECT_EQ(Upload(index, sub), 0x80000000u);
    }
    EXPECT_FALSE(Upload(0x1000, 0, kModbusServer));
    EXPECT_FALSE(Upload(0x1000, 0, kLcmServer));
  }
}

TEST_F(Canopen, ATransferEndsWithItsServer) {
  EXPECT_EQ(Ask(Request(0x40, 0x1008, 0), kLcmServer)[0], 0x41);
  ASSERT_EQ(Download(0x1202, 1, 0x80000000u | kLcmServer, 4), 0u);
  ASSERT_EQ(Download(0x1202, 1, kLcmServer, 4), 0u);
  EXPECT_EQ(Word(Ask({0x60}, kLcmServer)), 0x05040001u) << "nothing was begun";
}

TEST_F(Canopen, TransfersOfServersAreApart) {
  uint32_t size = 0;
  EXPECT_EQ(Ask(Request(0x40, 0x1008, 0))[0], 0x41);
  EXPECT_EQ(Ask(Request(0x40, 0x100A, 0), kLcmServer)[0], 0x41);
  EXPECT_EQ(Ask({0x60})[0] & 0xF0, 0x00);
  EXPECT_EQ(Ask({0x60}, kLcmServer)[0] & 0xF0, 0x00);
  EXPECT_EQ(Ask({0x60}, kModbusServer)[0], 0x80);
  EXPECT_EQ(Ask({0x70})[0], 0x1B);  // "ax" remains
  EXPECT_EQ(UploadAll(0x1008, 0, size).size(), 9u);
}

TEST_F(Canopen, TextsComeInSegments) {
  uint32_t size = 0;
  auto text = UploadAll(0x1008, 0, size);
  EXPECT_EQ(std::string(text.begin(), text.end()), "forceaxis");
  EXPECT_EQ(size, 9u);
  text = UploadAll(0x1009, 0, size);
  EXPECT_EQ(std::string(text.begin(), text.end()), "a bench of this test");
  text = UploadAll(0x100A, 0, size);
  EXPECT_EQ(std::string(text.begin(), text.end()), FW_VERSION " " AXIS_OBJECTS_HASH_TEXT);
  EXPECT_EQ(size, text.size());
}

TEST_F(Canopen, TheRecordingIsUploadedWhole) {
  ASSERT_EQ(Download(0x2100, 1, 0x201F00, 4), 0u);  // tick_count
  ASSERT_EQ(Download(0x2107, 0, 1, 1), 0u);
  Tick(8192);
  ASSERT_EQ(Upload(0x2108, 0), 3u);
  uint32_t size = 0;
  const auto data = UploadAll(0x2120, 0, size);
  ASSERT_EQ(size, 32768u);
  ASSERT_EQ(data.size(), size);
  for (size_t i = 0; i < 8192; ++i) {
    const uint32_t tick = static_cast<uint32_t>(data[4 * i] | data[4 * i + 1] << 8);
    ASSERT_EQ(tick, static_cast<uint32_t>(data[0] | data[1] << 8) + i);
  }
}

TEST_F(Canopen, AnUploadEndsWithItsRecording) {
  ASSERT_EQ(Download(0x2100, 1, 0x201F00, 4), 0u);
  ASSERT_EQ(Download(0x2106, 0, 8, 2), 0u);
  ASSERT_EQ(Download(0x2107, 0, 1, 1), 0u);
  Tick(8);
  EXPECT_EQ(Word(Ask(Request(0x40, 0x2120, 0))), 32u);
  EXPECT_EQ(Ask({0x60})[0], 0x00);
  ASSERT_EQ(fw_object_write(&fw_, FW_SOURCE_LOCAL, AXIS_OBJ_RECORDER_ARM, 1), FW_OK);
  Tick(8);
  const auto answer = Ask({0x70});
  EXPECT_EQ(answer[0], 0x80) << "a mixture of two recordings is none";
  EXPECT_EQ(Word(answer), 0x08000024u);
}

TEST_F(Canopen, SegmentedDownload) {
  // Announced, in one segment of 2 bytes.
  EXPECT_EQ(Ask(Request(0x21, 0x200A, 0, 2))[0], 0x60);
  EXPECT_EQ(Ask({0x0B, 0x34, 0x12})[0], 0x20);
  EXPECT_EQ(Upload(0x200A, 0), 0x1234u);
  // Not announced, byte by byte.
  EXPECT_EQ(Ask(Request(0x20, 0x2012, 0))[0], 0x60);
  EXPECT_EQ(Ask({0x0C, 0x78})[0], 0x20);
  EXPECT_EQ(Ask({0x1C, 0x56})[0], 0x30);
  EXPECT_EQ(Ask({0x0C, 0x34})[0], 0x20);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_SETPOINT), 0) << "not before the last";
  EXPECT_EQ(Ask({0x1D, 0x12})[0], 0x30);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_SETPOINT), 0x12345678);
}

TEST_F(Canopen, SegmentedDownloadRefusals) {
  const auto begin = [&](uint8_t command, uint32_t size) {
    EXPECT_EQ(Ask(Request(command, 0x200A, 0, size))[0], 0x60);
  };
  const auto aborted = [&](const std::vector<uint8_t> &answer, uint32_t code) {
    ASSERT_EQ(answer.size(), 8u);
    EXPECT_EQ(answer[0], 0x80);
    EXPECT_EQ(answer[1] | answer[2] << 8, 0x200A);
    EXPECT_EQ(Word(answer), code) << std::hex << Word(answer);
    EXPECT_EQ(Word(Ask({0x01})), 0x05040001u) << "the transfer is over";
  };
  EXPECT_EQ(Word(Ask(Request(0x21, 0x200A, 0, 3))), 0x06070012u);
  EXPECT_EQ(Word(Ask(Request(0x21, 0x200A, 0, 1))), 0x06070013u);
  EXPECT_EQ(Word(Ask(Request(0x21, 0x200A, 0, 0))), 0x06070013u);
  begin(0x21, 2);
  aborted(Ask({0x0D, 1}), 0x06070010u);  // one byte of two
  begin(0x20, 0);
  aborted(Ask({0x0D, 1}), 0x06070013u);
  begin(0x20, 0);
  aborted(Ask({0x09, 1, 2, 3}), 0x06070012u);
  begin(0x20, 0);
  aborted(Ask({0x1B, 1, 2}), 0x05030000u);
  begin(0x20, 0);
  aborted(Ask({0x60}), 0x05040001u);  // an upload's segment
  begin(0x20, 0);
  aborted(Ask(Request(0xC6, 0x200A, 0)), 0x06070013u);  // a block of no bytes
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_GAIN), 0);
}

TEST_F(Canopen, ProtocolErrorsOfUploads) {
  EXPECT_EQ(Word(Ask({0x60})), 0x05040001u) << "nothing was begun";
  EXPECT_EQ(Ask(Request(0x40, 0x1008, 0))[0], 0x41);
  EXPECT_EQ(Word(Ask({0x70})), 0x05030000u);
  EXPECT_EQ(Word(Ask({0x60})), 0x05040001u);
  for (uint8_t command : {0xE0, 0xE5, 0xFF}) {
    const auto answer = Ask(Request(command, 0x1008, 0));
    EXPECT_EQ(answer[0], 0x80);
    EXPECT_EQ(answer[1] | answer[2] << 8, 0x1008);
    EXPECT_EQ(Word(answer), 0x05040001u);
  }
}

TEST_F(Canopen, AClientsAbortIsNotAnswered) {
  EXPECT_EQ(Ask(Request(0x40, 0x1008, 0))[0], 0x41);
  EXPECT_TRUE(Ask(Request(0x80, 0x1008, 0, 0x08000000)).empty());
  EXPECT_EQ(Ask({0x60}), Request(0x80, 0, 0, 0x05040001)) << "of no object";
}

TEST_F(Canopen, ANewRequestReplacesAPendingOne) {
  EXPECT_EQ(Ask(Request(0x40, 0x1008, 0))[0], 0x41);
  EXPECT_EQ(Ask(Request(0x40, 0x100A, 0))[0], 0x41);
  const auto answer = Ask({0x60});
  EXPECT_EQ(std::string(answer.begin() + 1, answer.begin() + 6), FW_VERSION);
  EXPECT_EQ(Ask(Request(0x40, 0x1000, 0))[0], 0x43);
  EXPECT_EQ(Word(Ask({0x70})), 0x05040001u) << "an expedited one too";
}

TEST_F(Canopen, APendingTransferTimesOut) {
  ASSERT_EQ(Download(0x1017, 0, 0, 2), 0u);
  EXPECT_EQ(Ask(Request(0x40, 0x1008, 0))[0], 0x41);
  NodeTick(5000);
  EXPECT_EQ(Ask({0x60})[0] & 0xF0, 0x00) << "every segment has its own 5 s";
  NodeTick(7500);
  EXPECT_TRUE(Take(0x585).empty());
  NodeTick(1);
  const auto frames = Take(0x585);
  ASSERT_EQ(frames.size(), 1u);
  EXPECT_EQ(frames[0].data, Request(0x80, 0x1008, 0, 0x05040000));
  NodeTick(10000);
  EXPECT_TRUE(Take(0x585).empty());
}

// Each segment of a download has its 5 s, 7500 ticks, too.
TEST_F(Canopen, EverySegmentOfADownloadHasItsTime) {
  ASSERT_EQ(Download(0x1017, 0, 0, 2), 0u);
  ASSERT_EQ(Ask(Request(0x20, 0x607A, 0))[0], 0x60);
  NodeTick(7000);
  EXPECT_EQ(Ask({0x0A, 0x78, 0x56})[0], 0x20);  // two of four bytes
  NodeTick(7000);
  EXPECT_EQ(Ask({0x1B, 0x34, 0x12})[0], 0x30);  // and the last two
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 0x12345678);
}

TEST_F(Canopen, TruncatedRequestsGetNoAnswer) {
  Take();
  for (size_t length = 0; length < 8; ++length) {
    Send(0x605, std::vector<uint8_t>(length, 0x40));
    Send(0x605, Request(0x40, 0x1000, 0), true);
  }
  EXPECT_TRUE(Take().empty());
}

// CiA 301, 1020h: a configuration tool notes when it configured; a change by anyone ends that.
TEST_F(Canopen, AVerifiedConfigurationEndsWithAChange) {
  const auto note = [&] {
    EXPECT_EQ(Download(0x1020, 1, 15000, 4), 0u);
    EXPECT_EQ(Download(0x1020, 2, 43200000, 4), 0u);
  };
  const auto is_noted = [&] {
    const bool date = Upload(0x1020, 1) == 15000u, time = Upload(0x1020, 2) == 43200000u;
    EXPECT_EQ(date, time);
    EXPECT_TRUE(date || Upload(0x1020, 1) == 0u);
    return date;
  };
  note();
  EXPECT_TRUE(is_noted());
  ASSERT_EQ(Download(0x1017, 0, 200, 2), 0u);
  EXPECT_TRUE(is_noted()) << "the same value";
  ASSERT_EQ(Download(0x607A, 0, 7, 4), 0u);
  ASSERT_EQ(Download(0x2302, 0, 5, 2), 0x06090032u);
  ASSERT_EQ(Download(0x1201, 1, 0x80000690, 4), 0u);
  EXPECT_TRUE(is_noted()) << "nothing that is stored, or refused";
  ASSERT_EQ(Download(0x1017, 0, 100, 2), 0u);
  EXPECT_FALSE(is_noted()) << "of the node";
  note();
  ASSERT_EQ(Write(AXIS_OBJ_FORCE_GAIN, 7), FW_OK);
  EXPECT_FALSE(is_noted()) << "of the axis, by the port";
  note();
  Start();
  ASSERT_EQ(Download(0x1600, 0, 0, 1), 0x08000022u);
  EXPECT_TRUE(is_noted());
  ASSERT_EQ(Download(0x6081, 0, 12345, 4), 0u);
  EXPECT_FALSE(is_noted()) << "of the drive";
}

}  // namespace
