// Programs of cycles over the buses: downloads in segments, in blocks and in parts against clients
// written here from CiA 301, the library, the selection, and a cycle of a downloaded program.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <random>
#include <vector>

#include "tests/firmware/unit/cycle_records.hpp"
#include "tests/firmware/unit/fw_fixture.hpp"

namespace {

constexpr uint16_t kIndex = 0x2435;
constexpr uint32_t kTooLong = 0x06070012, kLength = 0x06070010, kMemory = 0x05040005,
                   kState = 0x08000022, kLocked = 0x08000021, kValue = 0x06090030,
                   kTimeout = 0x05040000, kOver = 0x05040001;
constexpr uint32_t kRoom = 12288;

// How a client downloads; `size` is what it announces, 0: the true size.
struct Manner {
  bool sized = true;
  bool with_crc = true;
  uint16_t wrong_crc = 0;
  uint32_t size = 0;
  size_t stops_after = SIZE_MAX;  // segments
  std::function<bool()> loses = [] { return false; };
};

class Programs : public Fw {
 protected:
  Programs() { PowerUpWith(CYCLE_PROGRAM_BYTES_MAX + kRoom); }

  void PowerUpWith(uint32_t bytes) {
    fw_ = fw_t{};
    fw_config_t config = NodeConfig();
    config.program_memory = bytes == 0 ? nullptr : programs_.data();
    config.program_bytes = bytes;
    fw_init(&fw_, &config);
    EnableServers();
    segments_ = 0;
  }

  Bytes Ask(Way way, Bytes request) {
    request.resize(8);
    return AskSdo(way, request);
  }

  static uint32_t CodeOf(const Bytes &answer) {
    if (answer.empty()) return kSilence;
    return answer[0] == 0x80 ? Word(answer) : 0;
  }

  // The abort code, 0 if the record was accepted, kSilence if the client stopped.
  uint32_t InSegments(Way way, const Bytes &record, const Manner &manner = {}) {
    const auto true_size = static_cast<uint32_t>(record.size());
    const uint32_t size = manner.size != 0 ? manner.size : true_size;
    if (uint32_t code = CodeOf(Ask(way, Request(manner.sized ? 0x21 : 0x20, kIndex, 1, size))))
      return code;
    uint8_t toggle = 0;
    size_t segments = 0;
    for (size_t at = 0; at < record.size() || at == 0; at += 7, toggle ^= 0x10) {
      if (segments++ == manner.stops_after) return kSilence;
      const size_t count = std::min<size_t>(7, record.size() - at);
      Bytes request{static_cast<uint8_t>(toggle | (7 - count) << 1 | (at + 7 >= record.size()))};
      request.insert(request.end(), record.begin() + static_cast<long>(at),
                     record.begin() + static_cast<long>(at + count));
      const Bytes answer = Ask(way, request);
      if (uint32_t code = CodeOf(answer)) return code;
      EXPECT_EQ(answer[0], 0x20 | toggle);
    }
    return 0;
  }

  uint32_t InBlocks(Way way, const Bytes &record, const Manner &manner = {}) {
    const auto true_size = static_cast<uint32_t>(record.size());
    const uint32_t size = manner.size != 0 ? manner.size : true_size;
    const auto command = static_cast<uint8_t>(0xC0 | manner.sized << 1 | manner.with_crc << 2);
    Bytes answer = Ask(way, Request(command, kIndex, 1, manner.sized ? size : 0));
    if (uint32_t code = CodeOf(answer)) return code;
    EXPECT_EQ(answer[0], 0xA0 | manner.with_crc << 2);
    size_t block = answer[4];
    size_t sent = 0;
    for (size_t at = 0; at < record.size();) {
      EXPECT_TRUE(block >= 1 && block <= 127);
      const size_t count = std::min(block, (record.size() - at + 6) / 7);
      size_t good = 0;
      for (size_t i = 1; i <= count; ++i) {
        if (sent++ == manner.stops_after) return kSilence;
        ++segments_;
        const size_t from = at + 7 * (i - 1), to = std::min(record.size(), from + 7);
        Bytes segment{static_cast<uint8_t>(i | (to == record.size() ? 0x80 : 0))};
        segment.insert(segment.end(), record.begin() + static_cast<long>(from),
                       record.begin() + static_cast<long>(to));
        // Without the last segment of a block nobody would answer.
        if (i < count && manner.loses()) continue;
        if (good == i - 1) good = i;
        answer = Ask(way, segment);
        if (i < count && answer.empty()) continue;
        if (uint32_t code = CodeOf(answer)) return code;
        EXPECT_EQ(i, count);
      }
      EXPECT_EQ(answer[0], 0xA2);
      EXPECT_EQ(answer[1], good) << "the last one before the gap";
      at += 7u * answer[1];
      block = answer[2];
    }
    const auto crc = static_cast<uint16_t>(BlockCrc(record) ^ manner.wrong_crc);
    const size_t unused = (7 - record.size() % 7) % 7;
    answer = Ask(way, {static_cast<uint8_t>(0xC1 | unused << 2), static_cast<uint8_t>(crc),
                       static_cast<uint8_t>(crc >> 8)});
    if (uint32_t code = CodeOf(answer)) return code;
    EXPECT_EQ(answer[0], 0xA1);
    return 0;
  }

  uint32_t Select(Way way, uint32_t number) {
    return Write(way, AXIS_OBJ_CYCLE_PROGRAM, static_cast<int32_t>(number));
  }
  uint32_t Remove(Way way, uint32_t number) {
    return Write(way, AXIS_OBJ_CYCLE_PROGRAM_REMOVE, static_cast<int32_t>(number));
  }
  int Count() const { return Inner(AXIS_OBJ_CYCLE_PROGRAM_COUNT); }

  static std::map<uint32_t, Bytes> Kept(const fw_t &fw) {
    std::map<uint32_t, Bytes> programs;
    for (uint8_t i = 0; i < fw.library.count; ++i) {
      const cycle_header_t *program = cycle_library_at(&fw.library, i);
      const auto *bytes = reinterpret_cast<const uint8_t *>(program);
      programs[program->number] = {bytes, bytes + program->size};
    }
    return programs;
  }

  static uint32_t CrcAtEnd(const Bytes &record) { return Crc32(record.data(), record.size() - 4); }

  // Enables the axis in mode -9, from the port.
  void EnableCycle() {
    Set(AXIS_OBJ_MODES_OF_OPERATION, -9);
    for (int word : {0x06, 0x07, 0x0F}) {
      Set(AXIS_OBJ_CONTROLWORD, word);
      Tick(2);
    }
    ASSERT_EQ(Inner(AXIS_OBJ_DRIVE_STATE), AXIS_DRIVE_STATE_OPERATION_ENABLED);
  }

  // A record in parts, each by function 16: the offset and up to 16 words.
  uint32_t InParts(const Bytes &record, uint32_t size) {
    for (size_t at = 0; at < record.size(); at += 64) {
      std::vector<unsigned> words{static_cast<unsigned>(at)};
      for (size_t k = at; k < std::min(at + 64, record.size()); k += 4) {
        words.push_back(record[k + 2] | record[k + 3] << 8);
        words.push_back(record[k] | record[k + 1] << 8);
      }
      const Bytes answer = AskRtu(WritePdu(0x040F, words));
      if (IsException(answer)) return answer.size() > 2 ? answer[2] : kSilence;
    }
    return Write(kRtu, AXIS_OBJ_CYCLE_DATA_END, static_cast<int32_t>(size));
  }

  std::vector<uint32_t> programs_ =
      std::vector<uint32_t>((CYCLE_PROGRAM_BYTES_MAX + kRoom) / sizeof(uint32_t));
  size_t segments_ = 0;
};

TEST_F(Programs, AreDownloadedInSegmentsByEachServer) {
  uint32_t number = 1;
  for (Way way : {kCanopen, kGateway, kLcm}) {
    ASSERT_TRUE(Acquires(way));
    for (const bool sized : {true, false}) {
      Manner manner;
      manner.sized = sized;
      const Bytes record = cycle_record(number, 493 - 3 * static_cast<uint16_t>(number));
      PowerUpWith(CYCLE_PROGRAM_BYTES_MAX + kRoom);
      ASSERT_TRUE(Acquires(way));
      EXPECT_EQ(InSegments(way, record, manner), 0u);
      EXPECT_EQ(Kept(fw_), (std::map<uint32_t, Bytes>{{number, record}}));
      EXPECT_EQ(Count(), 1);
      ++number;
    }
  }
}

TEST_F(Programs, AreDownloadedInBlocksOfEveryEnd) {
  for (uint16_t points : {0, 1, 2, 3, 4, 5, 6, 94, 95, 493}) {
    const Bytes record = cycle_record(1, points);
    for (const bool sized : {true, false}) {
      for (const bool with_crc : {true, false}) {
        Manner manner;
        manner.sized = sized;
        manner.with_crc = with_crc;
        ASSERT_EQ(InBlocks(kCanopen, record, manner), 0u) << points;
        ASSERT_EQ(Kept(fw_), (std::map<uint32_t, Bytes>{{1, record}}));
        ASSERT_EQ(Remove(kCanopen, 1), 0u);
      }
    }
  }
}

TEST_F(Programs, LostSegmentsAreSentAgain) {
  std::mt19937 random(31);
  const Bytes record = cycle_record(9, 493);
  for (uint32_t one_in : {2u, 5u, 50u, 500u}) {
    Manner manner;
    manner.loses = [&] { return random() % one_in == 0; };
    segments_ = 0;
    EXPECT_EQ(InBlocks(kLcm, record, manner), kLocked);
    EXPECT_EQ(InBlocks(kCanopen, record, manner), 0u);
    EXPECT_EQ(Kept(fw_)[9], record);
    if (one_in < 50) {
      EXPECT_GT(segments_, record.size() / 7 + 20) << "some were lost";
    }
    ASSERT_EQ(Remove(kCanopen, 9), 0u);
  }
}

TEST_F(Programs, DownloadsAreRefusedWithTheirCodes) {
  const Bytes record = cycle_record(3);
  Manner long_one;
  long_one.size = CYCLE_PROGRAM_BYTES_MAX + 1;
  Manner unsized;
  unsized.sized = false;
  Manner other_size;
  other_size.size = 155;
  Manner short_size;
  short_size.size = 141;
  Manner wrong_crc;
  wrong_crc.wrong_crc = 1;
  EXPECT_EQ(InSegments(kCanopen, record, long_one), kTooLong);
  EXPECT_EQ(InBlocks(kCanopen, record, long_one), kTooLong);
  EXPECT_EQ(InSegments(kCanopen, Bytes(4097), unsized), kTooLong);
  EXPECT_EQ(InBlocks(kCanopen, Bytes(4104), unsized), kTooLong);
  EXPECT_EQ(InSegments(kCanopen, Bytes(4096), unsized), kValue) << "no record, but it has room";
  EXPECT_EQ(InBlocks(kCanopen, Bytes(4096), unsized), kValue);
  EXPECT_EQ(InSegments(kCanopen, record, other_size), kLength);
  EXPECT_EQ(InBlocks(kCanopen, record, other_size), kLength);
  EXPECT_EQ(InSegments(kCanopen, record, short_size), kTooLong);
  EXPECT_EQ(InBlocks(kCanopen, record, wrong_crc), 0x05040004u);
  EXPECT_EQ(Download(kCanopen, kIndex, 1, 0x59435846, 4), kValue) << "in the request itself";
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_PROGRAM_REFUSAL), AXIS_CYCLE_PROGRAM_REFUSAL_NO_PROGRAM);
  EXPECT_EQ(Download(kCanopen, kIndex, 1, 0, 1), kValue);
  EXPECT_EQ(CodeOf(Ask(kCanopen, Request(0x40, kIndex, 1))), 0x06010001u) << "write only";
  EXPECT_EQ(CodeOf(Ask(kCanopen, Request(0xA4, kIndex, 1, 127))), 0x06010001u);
  for (Way way : {kGateway, kLcm}) {
    EXPECT_EQ(InSegments(way, record), kLocked);
    EXPECT_EQ(InBlocks(way, record), kLocked);
    EXPECT_EQ(Remove(way, 3), kLocked);
    EXPECT_EQ(Select(way, 0), kLocked);
  }
  EXPECT_EQ(InSegments(kCanopen, cycle_record(0)), kValue);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_PROGRAM_REFUSAL), AXIS_CYCLE_PROGRAM_REFUSAL_NO_NUMBER);
  EXPECT_EQ(Count(), 0);
  EXPECT_EQ(InSegments(kCanopen, record), 0u);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_PROGRAM_REFUSAL), AXIS_CYCLE_PROGRAM_REFUSAL_NONE);
}

TEST_F(Programs, TheReasonOfARefusalIsShown) {
  Bytes record = cycle_record(3);
  record[100] ^= 4;
  EXPECT_EQ(InBlocks(kCanopen, record), kValue);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_PROGRAM_REFUSAL), AXIS_CYCLE_PROGRAM_REFUSAL_WRONG_CRC);
  const auto words = record_of({wait_phase(1), wait_phase(7)}, 3);
  const auto *bytes = reinterpret_cast<const uint8_t *>(words.data());
  EXPECT_EQ(InSegments(kCanopen, {bytes, bytes + 4 * words.size()}), kValue);
  EXPECT_EQ(Read(kCanopen, AXIS_OBJ_CYCLE_PROGRAM_REFUSAL),
            static_cast<uint32_t>(AXIS_CYCLE_PROGRAM_REFUSAL_WRONG_PHASE));
  EXPECT_EQ(Read(kCanopen, AXIS_OBJ_CYCLE_PROGRAM_REFUSED_PART), 1u);
}

TEST_F(Programs, WithoutMemoryThereAreNone) {
  PowerUpWith(0);
  const Bytes record = cycle_record(3);
  EXPECT_EQ(InSegments(kCanopen, record), kMemory);
  EXPECT_EQ(InBlocks(kCanopen, record), kMemory);
  EXPECT_EQ(Select(kCanopen, 3), kValue);
  EXPECT_EQ(Select(kCanopen, 0), 0u);
  EXPECT_EQ(Remove(kCanopen, 3), 0x06060000u);
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_CYCLE_DATA_END, 4), 0x06060000u);
}

TEST_F(Programs, AFullLibraryKeepsItsPrograms) {
  for (uint32_t number : {1u, 2u, 3u}) {
    ASSERT_EQ(InBlocks(kCanopen, cycle_record(number, 493)), 0u);
  }
  const auto before = Kept(fw_);
  EXPECT_EQ(InBlocks(kCanopen, cycle_record(4)), kMemory);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_PROGRAM_REFUSAL), AXIS_CYCLE_PROGRAM_REFUSAL_NO_ROOM);
  EXPECT_EQ(Kept(fw_), before);
  EXPECT_EQ(InBlocks(kCanopen, cycle_record(2)), 0u) << "in place of a longer one";
  EXPECT_EQ(InBlocks(kCanopen, cycle_record(4)), 0u);
  EXPECT_EQ(Count(), 4);
}

TEST_F(Programs, ATransferThatEndsEarlyChangesNothing) {
  ASSERT_EQ(InSegments(kCanopen, cycle_record(1)), 0u);
  const auto before = Kept(fw_);
  const Bytes other = cycle_record(1, 300);
  Manner stops;
  for (size_t segments : {0u, 1u, 100u, 200u, 362u}) {
    stops.stops_after = segments;
    ASSERT_EQ(InSegments(kCanopen, other, stops), kSilence);
    EXPECT_TRUE(Ask(kCanopen, Request(0x80, kIndex, 1, 0x08000000)).empty());
    EXPECT_EQ(CodeOf(Ask(kCanopen, {0x00})), kOver) << "the client's abort ends it";
    ASSERT_EQ(InBlocks(kCanopen, other, stops), kSilence);
    EXPECT_TRUE(Ask(kCanopen, Request(0x80, kIndex, 1, 0x08000000)).empty());
    EXPECT_EQ(Kept(fw_), before);
  }
  ASSERT_EQ(Download(kCanopen, 0x1017, 0, 0, 2), 0u);
  for (const bool blocks : {false, true}) {
    stops.stops_after = 200;
    ASSERT_EQ(blocks ? InBlocks(kCanopen, other, stops) : InSegments(kCanopen, other, stops),
              kSilence);
    Take();
    Tick(7500);
    EXPECT_TRUE(Take(AnswerId(kServer)).empty());
    Tick();
    const std::vector<Frame> frames = Take(AnswerId(kServer));
    ASSERT_EQ(frames.size(), 1u);
    EXPECT_EQ(frames[0].data, Request(0x80, kIndex, 1, kTimeout));
    EXPECT_EQ(Kept(fw_), before);
  }
  EXPECT_EQ(InBlocks(kCanopen, other), 0u) << "and the next one is free";
}

TEST_F(Programs, SegmentsOutOfTurnEndATransfer) {
  ASSERT_EQ(CodeOf(Ask(kCanopen, Request(0xC6, kIndex, 1, 152))), 0u);
  EXPECT_EQ(CodeOf(Ask(kCanopen, {0x00, 1, 2})), 0x05040003u) << "no segment has the number 0";
  ASSERT_EQ(CodeOf(Ask(kCanopen, Request(0x21, kIndex, 1, 152))), 0u);
  EXPECT_EQ(CodeOf(Ask(kCanopen, {0x10, 1, 2})), 0x05030000u) << "the toggle bit";
  ASSERT_EQ(CodeOf(Ask(kCanopen, Request(0xC6, kIndex, 1, 7))), 0u);
  EXPECT_EQ(CodeOf(Ask(kCanopen, {0x01, 1, 2})), kTooLong) << "7 bytes, and it is not the last";
}

// The staging area belongs to one transfer at a time, and the axis to one owner at its end.
TEST_F(Programs, TwoServersDoNotMixTheirRecords) {
  const Bytes first = cycle_record(1, 50), second = cycle_record(2, 60);
  Manner half;
  half.stops_after = 20;
  ASSERT_EQ(InSegments(kCanopen, first, half), kSilence);
  ASSERT_TRUE(Acquires(kGateway));
  EXPECT_EQ(InBlocks(kGateway, second), kState) << "another transfer";
  EXPECT_EQ(CodeOf(Ask(kCanopen, {0x00, 1, 2, 3, 4, 5, 6, 7})), 0u) << "it goes on";
  EXPECT_TRUE(Ask(kCanopen, Request(0x80, kIndex, 1, 0x08000000)).empty());
  ASSERT_EQ(InBlocks(kGateway, second, half), kSilence);
  EXPECT_EQ(InSegments(kCanopen, first), kLocked);
  EXPECT_TRUE(Ask(kGateway, Request(0x80, kIndex, 1, 0x08000000)).empty());
  EXPECT_EQ(InBlocks(kGateway, second), 0u);
  EXPECT_EQ(Kept(fw_), (std::map<uint32_t, Bytes>{{2, second}}));
  // The last segment of somebody who no longer owns the axis.
  Manner all_but_one;
  all_but_one.stops_after = first.size() / 7;
  ASSERT_TRUE(Acquires(kCanopen));
  ASSERT_EQ(InSegments(kCanopen, first, all_but_one), kSilence);
  ASSERT_TRUE(Acquires(kLcm));
  const size_t rest = first.size() % 7;
  Bytes last{static_cast<uint8_t>((all_but_one.stops_after % 2 ? 0x10 : 0) | (7 - rest) << 1 | 1)};
  last.insert(last.end(), first.end() - static_cast<long>(rest), first.end());
  EXPECT_EQ(CodeOf(Ask(kCanopen, last)), kLocked);
  EXPECT_EQ(Count(), 1);
}

TEST_F(Programs, AnEnabledAxisTakesNone) {
  ASSERT_EQ(InSegments(kCanopen, cycle_record(1)), 0u);
  EnableCycle();
  EXPECT_EQ(InSegments(kCanopen, cycle_record(2)), kState);
  EXPECT_EQ(InBlocks(kCanopen, cycle_record(2)), kState);
  EXPECT_EQ(Remove(kCanopen, 1), kState);
  EXPECT_EQ(Select(kCanopen, 1), 0u) << "the next part may have another program";
}

TEST_F(Programs, ASelectedProgramFollowsItsLibrary) {
  for (uint32_t number : {1u, 2u, 3u}) ASSERT_EQ(InSegments(kCanopen, cycle_record(number)), 0u);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_PROGRAM), 0);
  EXPECT_EQ(Select(kCanopen, 4), kValue);
  EXPECT_EQ(Select(kCanopen, 2), 0u);
  const auto crc = [&] { return Read(kCanopen, AXIS_OBJ_CYCLE_PROGRAM_CRC); };
  EXPECT_EQ(crc(), CrcAtEnd(cycle_record(2)));
  EXPECT_EQ(Remove(kCanopen, 1), 0u);
  EXPECT_EQ(fw_.drive.program, cycle_library_find(&fw_.library, 2)) << "it has moved";
  EXPECT_EQ(InSegments(kCanopen, cycle_record(2, 5)), 0u);
  EXPECT_EQ(fw_.drive.program, cycle_library_find(&fw_.library, 2)) << "it is a new one";
  EXPECT_EQ(crc(), CrcAtEnd(cycle_record(2, 5)));
  EXPECT_EQ(Remove(kCanopen, 2), 0u);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_PROGRAM), 0);
  EXPECT_EQ(fw_.drive.program, nullptr);
  EXPECT_EQ(crc(), 0u);
  EXPECT_EQ(Remove(kCanopen, 2), kValue);
  EXPECT_EQ(Count(), 1);
}

TEST_F(Programs, APowerUpForgetsThem) {
  ASSERT_EQ(InSegments(kCanopen, cycle_record(1)), 0u);
  ASSERT_EQ(Select(kCanopen, 1), 0u);
  Send(0, {0x81, kNode});
  Tick(3);
  EXPECT_EQ(Count(), 0);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_PROGRAM), 0);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_PROGRAM_CRC), 0);
  EXPECT_EQ(fw_.drive.program, nullptr);
}

TEST_F(Programs, ACycleRunsFromADownload) {
  ASSERT_EQ(InSegments(kCanopen, cycle_record(1)), 0u);
  ASSERT_EQ(InBlocks(kCanopen, cycle_record(2, 20)), 0u);
  ASSERT_EQ(Select(kCanopen, 2), 0u);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_RESULT_VERDICT), AXIS_CYCLE_RESULT_VERDICT_NONE);
  EnableCycle();
  inputs_.adc_code[0] = 3;
  Set(AXIS_OBJ_CONTROLWORD, 0x1F);
  Tick();
  ASSERT_EQ(Inner(AXIS_OBJ_CYCLE_STATE), AXIS_CYCLE_STATE_RUNNING);
  EXPECT_EQ(Select(kCanopen, 1), kState);
  EXPECT_EQ(Select(kCanopen, 2), kState);
  EXPECT_EQ(InSegments(kCanopen, cycle_record(3)), kState);
  EXPECT_EQ(FirmwareFixture::Write(AXIS_OBJ_CYCLE_PROGRAM, 1), FW_ERROR_STATE);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_RESULT_VERDICT), AXIS_CYCLE_RESULT_VERDICT_NONE);
  Tick(20);
  ASSERT_EQ(Inner(AXIS_OBJ_CYCLE_STATE), AXIS_CYCLE_STATE_GOOD);
  const auto has_result = [&] {
    return Read(kCanopen, AXIS_OBJ_CYCLE_RESULT_VERDICT) ==
               static_cast<uint32_t>(AXIS_CYCLE_RESULT_VERDICT_GOOD) &&
           Read(kCanopen, AXIS_OBJ_CYCLE_RESULT_VALUE) == 3 * 256 &&
           Read(kCanopen, AXIS_OBJ_CYCLE_RESULT_TICK) != 0;
  };
  EXPECT_TRUE(has_result());
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_CYCLE_RESULT_ELEMENT, 1), 0u);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_RESULT_VERDICT), AXIS_CYCLE_RESULT_VERDICT_NONE)
      << "it has one element";
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_RESULT_VALUE), 0);
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_CYCLE_RESULT_ELEMENT, 0), 0u);
  EXPECT_TRUE(has_result());
  EXPECT_EQ(Select(kCanopen, 2), 0u) << "it is selected";
  EXPECT_TRUE(has_result());
  // Another program leaves the library, and the selected one moves.
  Set(AXIS_OBJ_CONTROLWORD, 0);
  Tick(2);
  EXPECT_EQ(Remove(kCanopen, 1), 0u);
  std::fill(programs_.begin() + (CYCLE_PROGRAM_BYTES_MAX + fw_.library.used) / 4, programs_.end(),
            0);
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_CYCLE_RESULT_ELEMENT, 0), 0u);
  EXPECT_TRUE(has_result()) << "the result stays";
  EXPECT_EQ(InBlocks(kCanopen, cycle_record(2, 21)), 0u);
  EXPECT_TRUE(has_result()) << "the part was pressed, whatever the program is now";
  EXPECT_EQ(Read(kCanopen, AXIS_OBJ_CYCLE_RESULT_PROGRAM_CRC), CrcAtEnd(cycle_record(2, 20)));
}

TEST_F(Programs, ComeInPartsByModbus) {
  ASSERT_TRUE(Acquires(kRtu));
  for (uint16_t points : {0, 1, 7, 493}) {
    const Bytes record = cycle_record(5, points);
    ASSERT_EQ(InParts(record, static_cast<uint32_t>(record.size())), 0u);
    ASSERT_EQ(Kept(fw_), (std::map<uint32_t, Bytes>{{5, record}}));
  }
  const auto before = Kept(fw_);
  EXPECT_EQ(InParts(cycle_record(5), 136), 3u) << "a value that is refused";
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_PROGRAM_REFUSAL), AXIS_CYCLE_PROGRAM_REFUSAL_WRONG_SIZE);
  EXPECT_EQ(InParts(cycle_record(5), 144), 3u) << "more than came";
  const Bytes gap = AskRtu(WritePdu(0x040F, {4000, 1, 2}));
  EXPECT_FALSE(IsException(gap));
  EXPECT_EQ(Write(kRtu, AXIS_OBJ_CYCLE_DATA_END, 4004), 3u);
  EXPECT_EQ(Kept(fw_), before);
  EXPECT_EQ(Write(kRtu, AXIS_OBJ_CYCLE_PROGRAM, 5), 0u);
  EXPECT_EQ(Read(kRtu, AXIS_OBJ_CYCLE_PROGRAM_CRC), CrcAtEnd(cycle_record(5, 493)));
  EXPECT_EQ(Write(kRtu, AXIS_OBJ_CYCLE_PROGRAM_REMOVE, 5), 0u);
  EXPECT_EQ(Count(), 0);
  EXPECT_EQ(AskRtu(WritePdu(0x042F, {1, 2}))[1], 0x90) << "half of the last part";
}

TEST_F(Programs, PartsAndTransfersGiveWayToEachOther) {
  ASSERT_TRUE(Acquires(kGateway));
  const Bytes record = cycle_record(5);
  Manner half;
  half.stops_after = 3;
  ASSERT_EQ(InSegments(kGateway, record, half), kSilence);
  EXPECT_NE(InParts(record, 152), 0u);
  EXPECT_EQ(Write(kRtu, AXIS_OBJ_CYCLE_DATA_END, 152), 6u) << "busy";
  EXPECT_TRUE(Ask(kGateway, Request(0x80, kIndex, 1, 0x08000000)).empty());
  ASSERT_FALSE(IsException(AskRtu(WritePdu(0x040F, {0, 1, 2}))));
  EXPECT_EQ(InSegments(kGateway, record), kState);
  Set(AXIS_OBJ_WATCHDOG, 65535);
  Tick(7499);
  EXPECT_EQ(InSegments(kGateway, record), kState);
  Tick();
  EXPECT_EQ(InSegments(kGateway, record), 0u) << "nobody sent a part for 5 s";
}

// A master that only downloads keeps its axis.
TEST_F(Programs, EachSegmentKeepsTheOwner) {
  ASSERT_TRUE(Acquires(kLcm));
  Set(AXIS_OBJ_WATCHDOG, 100);
  Manner slow;
  slow.loses = [&] {
    Tick(30);
    return false;
  };
  EXPECT_EQ(InBlocks(kLcm, cycle_record(1, 493), slow), 0u);
  EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_LCM);
}

// Random clients against a map of records: whatever is refused, aborted or lost changes nothing.
TEST_F(Programs, RandomClientsAreThoseOfAMap) {
  std::mt19937 random(2435);
  const auto below = [&](uint32_t n) { return static_cast<uint32_t>(random()) % n; };
  std::map<uint32_t, Bytes> model;
  uint32_t selected = 0;
  std::map<uint32_t, int> codes;
  const Way sdo[] = {kCanopen, kGateway, kLcm};
  Way owner = kCanopen;
  for (int i = 0; i < 3000; ++i) {
    const Way way = below(8) == 0 ? sdo[below(3)] : owner;
    const bool is_owner = SourceOf(way) == SourceOf(owner);
    const uint32_t number = below(7);
    switch (below(10)) {
      case 0:
        owner = sdo[below(3)];
        ASSERT_TRUE(Acquires(owner));
        break;
      case 1: {
        const bool exists = number != 0 && model.count(number) != 0;
        const uint32_t code = Remove(way, number);
        ASSERT_EQ(code, number == 0 ? 0x06090032 : !is_owner ? kLocked : exists ? 0 : kValue);
        if (code == 0) model.erase(number);
        if (code == 0 && number == selected) selected = 0;
        break;
      }
      case 2:
      case 3: {
        const bool exists = number == 0 || model.count(number) != 0;
        const uint32_t code = Select(way, number);
        ASSERT_EQ(code, !is_owner ? kLocked : exists ? 0 : kValue);
        if (code == 0) selected = number;
        break;
      }
      default: {
        Bytes record = cycle_record(number, static_cast<uint16_t>(below(below(3) ? 494 : 40)));
        Manner manner;
        manner.sized = below(2) == 0;
        manner.with_crc = below(2) == 0;
        manner.loses = [&, one_in = 1 + below(100)] { return one_in > 1 && below(one_in) == 0; };
        const bool flipped = below(8) == 0, stops = below(8) == 0;
        if (flipped) record[below(static_cast<uint32_t>(record.size()))] ^= 1u << below(8);
        if (stops) manner.stops_after = below(static_cast<uint32_t>(record.size() / 7));
        size_t used = record.size();
        for (const auto &[other, bytes] : model) used += other == number ? 0 : bytes.size();
        const uint32_t code =
            below(2) ? InBlocks(way, record, manner) : InSegments(way, record, manner);
        if (code == kSilence) {
          ASSERT_TRUE(Ask(way, Request(0x80, kIndex, 1, 0x08000000)).empty());
        }
        ASSERT_EQ(code, !is_owner                  ? kLocked
                        : stops                    ? kSilence
                        : (flipped || number == 0) ? kValue
                        : used > kRoom             ? kMemory
                                                   : 0)
            << i;
        ++codes[code];
        if (code == 0) model[number] = record;
        break;
      }
    }
    Tick(static_cast<int>(below(3)));
    Take();
    ASSERT_EQ(Kept(fw_), model);
    ASSERT_EQ(static_cast<uint32_t>(Inner(AXIS_OBJ_CYCLE_PROGRAM)), selected);
    const auto *program = selected == 0 ? nullptr : cycle_library_find(&fw_.library, selected);
    ASSERT_EQ(fw_.drive.program, program);
    ASSERT_EQ(static_cast<uint32_t>(Inner(AXIS_OBJ_CYCLE_PROGRAM_CRC)),
              selected == 0 ? 0 : CrcAtEnd(model[selected]));
  }
  for (uint32_t code : {0u, kLocked, kSilence, kValue, kMemory}) EXPECT_GT(codes[code], 20) << code;
}

}  // namespace
