// SDO block transfers, against a client written here from CiA 301: blocks of every size, lost and
// repeated segments, CRC, abort codes, time-outs.

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "tests/firmware/unit/canopen_fixture.hpp"

namespace {

constexpr size_t kFramesOfATick = 4;

class Block : public Canopen {
 protected:
  // What a client does with a segment that came.
  using Loses = std::function<bool()>;

  // The answer to a request of another length than a value's.
  static uint32_t Code(const Bytes &answer) {
    return !answer.empty() && answer[0] == 0x80 ? Word(answer) : 0;
  }

  Bytes Begin(uint16_t index, uint8_t sub, uint8_t block, uint8_t threshold = 0,
              uint16_t server = kServer, uint8_t command = 0xA4) {
    return Ask(Request(command, index, sub, block | threshold << 8), server);
  }

  // Segments that come until the client has to answer.
  std::vector<Bytes> Segments(size_t most, uint16_t server = kServer) {
    std::vector<Bytes> all;
    for (int quiet = 0; quiet < 3 && all.size() < most;) {
      Tick();
      const std::vector<Frame> frames = Take(AnswerId(server));
      EXPECT_LE(frames.size(), kFramesOfATick);
      quiet = frames.empty() ? quiet + 1 : 0;
      for (const Frame &frame : frames) all.push_back(frame.data);
    }
    return all;
  }

  // All data of an upload; `next` gives the size of each block.
  Bytes Upload(
      uint16_t index, uint8_t sub, const std::function<uint8_t()> &next,
      const Loses &loses = [] { return false; }, bool with_crc = true, uint16_t server = kServer) {
    uint8_t block = next();
    const Bytes first = Begin(index, sub, block, 0, server, with_crc ? 0xA4 : 0xA0);
    if (first.empty() || first[0] != (with_crc ? 0xC6 : 0xC2)) {
      ADD_FAILURE() << "not begun";
      return {};
    }
    const uint32_t size = Word(first);
    Bytes data;
    Bytes answer = Ask({0xA3}, server);
    for (int blocks = 0; blocks < 100000; ++blocks) {
      EXPECT_TRUE(answer.empty());
      uint8_t good = 0;
      bool last = false;
      for (const Bytes &segment : Segments(block, server)) {
        if ((segment[0] & 0x7F) != good + 1 || loses()) continue;
        ++good;
        last = (segment[0] & 0x80) != 0;
        data.insert(data.end(), segment.begin() + 1, segment.end());
      }
      block = next();
      answer = Ask({0xA2, good, block}, server);
      if (!last) continue;
      EXPECT_EQ(answer[0] & 0xE3, 0xC1);
      data.resize(data.size() - (answer[0] >> 2 & 7));
      EXPECT_EQ(data.size(), size);
      EXPECT_EQ(answer[1] | answer[2] << 8, with_crc ? BlockCrc(data) : 0);
      EXPECT_TRUE(Ask({0xA1}, server).empty());
      EXPECT_EQ(Code(Ask({0xA1}, server)), 0x05040001u) << "it is over";
      return data;
    }
    ADD_FAILURE() << "no end";
    return {};
  }

  static std::function<uint8_t()> Always(uint8_t block) {
    return [block] { return block; };
  }

  // A finished recording; as it comes in segments.
  Bytes Record(int samples) {
    EXPECT_EQ(Download(0x2100, 1, 0x201F00, 4), 0u);  // tick_count
    EXPECT_EQ(Download(0x2106, 0, static_cast<uint32_t>(samples), 2), 0u);
    EXPECT_EQ(Download(0x2107, 0, 1, 1), 0u);
    Tick(samples);
    uint32_t size = 0;
    return UploadAll(0x2120, 0, size);
  }

  // A download of one segment, up to its end, which it returns.
  Bytes Put(uint16_t index, uint8_t sub, const Bytes &value, uint8_t command, uint32_t size,
            uint16_t crc) {
    const Bytes first = Ask(Request(command, index, sub, size));
    if (first.empty() || first[0] != (0xA0 | (command & 4))) return first;
    EXPECT_EQ(first[4], 1) << "segments of a block";
    Bytes segment{0x81};
    segment.insert(segment.end(), value.begin(), value.end());
    EXPECT_EQ(Ask(segment), (Bytes{0xA2, 1, 1, 0, 0, 0, 0, 0}));
    const auto unused = static_cast<uint8_t>(7 - value.size());
    return Ask({static_cast<uint8_t>(0xC1 | unused << 2), static_cast<uint8_t>(crc),
                static_cast<uint8_t>(crc >> 8)});
  }
};

TEST_F(Block, AnUploadGivesWhatSegmentsGive) {
  const Bytes expected = Record(3072);
  ASSERT_EQ(expected.size(), 12288u);
  for (uint8_t block : {1, 2, 7, 64, 127}) EXPECT_EQ(Upload(0x2120, 0, Always(block)), expected);
  EXPECT_EQ(Upload(
                0x2120, 0, Always(127), [] { return false; }, false),
            expected)
      << "no CRC";
  std::mt19937 random(3);
  const auto any = [&] { return static_cast<uint8_t>(1 + random() % 127); };
  EXPECT_EQ(Upload(0x2120, 0, any), expected) << "another size each time";
  EXPECT_EQ(Upload(
                0x2120, 0, any, [] { return false; }, true, kLcmServer),
            expected);
}

TEST_F(Block, LostSegmentsAreSentAgain) {
  const Bytes expected = Record(700);
  std::mt19937 random(4);
  for (uint32_t one_in : {2u, 5u, 50u}) {
    const auto loses = [&] { return random() % one_in == 0; };
    const auto any = [&] { return static_cast<uint8_t>(1 + random() % 127); };
    EXPECT_EQ(Upload(0x2120, 0, any, loses), expected) << one_in;
  }
}

TEST_F(Block, EveryLengthEndsRight) {
  for (int samples = 1; samples <= 16; ++samples) {  // 4 to 64 bytes
    const Bytes expected = Record(samples);
    ASSERT_EQ(expected.size(), 4u * static_cast<unsigned>(samples));
    EXPECT_EQ(Upload(0x2120, 0, Always(2)), expected);
  }
}

TEST_F(Block, TextsAndValuesComeInBlocksToo) {
  const Bytes text = Upload(0x1008, 0, Always(127));
  EXPECT_EQ(std::string(text.begin(), text.end()), "forceaxis");
  EXPECT_EQ(Upload(0x1018, 4, Always(1)), (Bytes{0x78, 0x56, 0x34, 0x12}));
  EXPECT_EQ(Upload(0x1018, 0, Always(9)), Bytes{4}) << "a number of sub-indices";
}

// Data of at most the threshold comes as without blocks.
TEST_F(Block, TheThresholdSelectsSegments) {
  EXPECT_EQ(Begin(0x1008, 0, 127, 8)[0], 0xC6);
  EXPECT_EQ(Begin(0x1008, 0, 127, 9), Request(0x41, 0x1008, 0, 9));
  EXPECT_EQ(Ask({0x60})[0], 0x00) << "goes on in segments";
  EXPECT_EQ(Begin(0x1018, 4, 127, 4), Request(0x43, 0x1018, 4, 0x12345678));
}

TEST_F(Block, UploadsAreRefusedWithTheirCodes) {
  EXPECT_EQ(Code(Begin(0x5000, 0, 127)), 0x06020000u);
  EXPECT_EQ(Code(Begin(0x1018, 9, 127)), 0x06090011u);
  EXPECT_EQ(Code(Begin(0x201E, 0, 127)), 0x06010001u);
  EXPECT_EQ(Code(Begin(0x2120, 0, 127)), 0x08000024u) << "no recording";
  EXPECT_EQ(Code(Begin(0x1003, 1, 127)), 0x08000024u) << "no error";
  for (uint8_t block : {0, 128, 255}) EXPECT_EQ(Code(Begin(0x1008, 0, block)), 0x05040002u);
  for (uint8_t command : {0xA1, 0xA2, 0xA3, 0xC1}) {
    EXPECT_EQ(Code(Ask({command})), 0x05040001u) << "nothing was begun";
  }
}

TEST_F(Block, RequestsOutOfTurnEndAnUpload) {
  for (const Bytes &request : {Bytes{0xA1}, Bytes{0xA2, 0, 1}, Bytes{0x60}, Bytes{0xC1}}) {
    ASSERT_EQ(Begin(0x1008, 0, 127)[0], 0xC6);
    const Bytes answer = Ask(request);
    EXPECT_EQ(Code(answer), 0x05040001u);
    EXPECT_EQ(answer[1] | answer[2] << 8, 0x1008);
    Tick(3);
    EXPECT_TRUE(Take(0x585).empty());
  }
  const auto sent = [&] {
    ASSERT_EQ(Begin(0x100A, 0, 2)[0], 0xC6);
    ASSERT_TRUE(Ask({0xA3}).empty());
    ASSERT_EQ(Segments(2).size(), 2u);
  };
  sent();
  EXPECT_EQ(Code(Ask({0xA2, 3, 2})), 0x05040003u) << "two were sent";
  for (uint8_t block : {0, 128}) {
    sent();
    EXPECT_EQ(Code(Ask({0xA2, 1, block})), 0x05040002u);
  }
  sent();
  EXPECT_EQ(Code(Ask({0xA3})), 0x05040001u) << "it was started";
  sent();
  EXPECT_TRUE(Ask({0x80}).empty());
  Tick(10);
  EXPECT_TRUE(Take(0x585).empty()) << "the client's abort ends it";
}

TEST_F(Block, AnUploadEndsWithItsRecording) {
  Record(3072);
  ASSERT_EQ(Begin(0x2120, 0, 127)[0], 0xC6);
  ASSERT_TRUE(Ask({0xA3}).empty());
  Tick();
  EXPECT_EQ(Take(0x585).size(), kFramesOfATick);
  ASSERT_EQ(fw_object_write(&fw_, FW_SOURCE_LOCAL, AXIS_OBJ_RECORDER_ARM, 1), FW_OK);
  Tick();
  const std::vector<Frame> frames = Take(0x585);
  ASSERT_EQ(frames.size(), 1u);
  EXPECT_EQ(frames[0].data, Request(0x80, 0x2120, 0, 0x08000024));
}

// What matters more goes out in its tick.
TEST_F(Block, SegmentsDoNotDelayAnEmergency) {
  Record(3072);
  ASSERT_EQ(Begin(0x2120, 0, 127)[0], 0xC6);
  ASSERT_TRUE(Ask({0xA3}).empty());
  Tick(2);
  Take();
  canopen_emergency(&fw_.canopen, 0xFF04, 0);
  Tick();
  const std::vector<Frame> frames = Take();
  ASSERT_GE(frames.size(), 2u);
  EXPECT_EQ(frames[0].id, 0x85);
  EXPECT_LE(frames.size(), kFramesOfATick + 1);
}

// With nobody who takes frames only so many wait, and none is lost.
TEST_F(Block, SegmentsWaitForRoom) {
  Record(3072);
  const int lost = Read(AXIS_OBJ_CAN_LOST);
  ASSERT_EQ(Begin(0x2120, 0, 127)[0], 0xC6);
  ASSERT_TRUE(Ask({0xA3}).empty());
  Tick(100);
  EXPECT_LE(Take(0x585).size(), kFramesOfATick);
  EXPECT_EQ(Read(AXIS_OBJ_CAN_LOST), lost);
}

TEST_F(Block, ServersSendInTurn) {
  Record(3072);
  for (uint16_t server : {kServer, kModbusServer}) {
    ASSERT_EQ(Begin(0x2120, 0, 127, 0, server)[0], 0xC6);
    ASSERT_TRUE(Ask({0xA3}, server).empty());
  }
  Take();
  Tick();
  int each[2] = {};
  for (const Frame &frame : Take()) {
    each[0] += frame.id == AnswerId(kServer);
    each[1] += frame.id == AnswerId(kModbusServer);
  }
  EXPECT_EQ(each[0], 2);
  EXPECT_EQ(each[1], 2);
}

TEST_F(Block, EachStateOfAnUploadTimesOut) {
  ASSERT_EQ(Download(0x1017, 0, 0, 2), 0u);
  const auto times_out = [&](int quiet = 7500) {
    NodeTick(quiet);
    Take();
    NodeTick(1);
    const std::vector<Frame> frames = Take(0x585);
    ASSERT_EQ(frames.size(), 1u);
    EXPECT_EQ(frames[0].data, Request(0x80, 0x1008, 0, 0x05040000));
  };
  ASSERT_EQ(Begin(0x1008, 0, 127)[0], 0xC6);
  times_out();
  ASSERT_EQ(Begin(0x1008, 0, 127)[0], 0xC6);
  ASSERT_TRUE(Ask({0xA3}).empty());
  NodeTick(1);
  EXPECT_EQ(Take(0x585).size(), 2u);
  times_out(7499);  // the tick of the last segment was the first
  ASSERT_EQ(Begin(0x1008, 0, 127)[0], 0xC6);
  ASSERT_TRUE(Ask({0xA3}).empty());
  NodeTick(1);
  ASSERT_EQ(Ask({0xA2, 2, 127})[0], 0xC1 | 5 << 2);
  times_out();
}

TEST_F(Block, ADownloadWritesAtItsEnd) {
  const Bytes value{0x78, 0x56, 0x34, 0x12};
  ASSERT_EQ(Ask(Request(0xC6, 0x2012, 0, 4))[0], 0xA4);
  EXPECT_EQ(Ask({0x81, 0x78, 0x56, 0x34, 0x12})[0], 0xA2);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_SETPOINT), 0);
  EXPECT_EQ(Ask({0x81, 0x78, 0x56, 0x34, 0x12})[0], 0xA2) << "a segment that is repeated";
  const uint16_t crc = BlockCrc(value);
  EXPECT_EQ(Ask({0xC1 | 3 << 2, static_cast<uint8_t>(crc), static_cast<uint8_t>(crc >> 8)}),
            (Bytes{0xA1, 0, 0, 0, 0, 0, 0, 0}));
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_SETPOINT), 0x12345678);
  EXPECT_EQ(Put(0x2012, 0, {1, 0, 0, 0}, 0xC0, 0, 0)[0], 0xA1) << "neither CRC nor size";
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_SETPOINT), 1);
  EXPECT_EQ(Put(0x200D, 0, {0xFF}, 0xC6, 1, BlockCrc({0xFF}))[0], 0xA1);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_SIGN), -1);
}

TEST_F(Block, DownloadsAreRefusedWithTheirCodes) {
  const Bytes value{0x78, 0x56, 0x34, 0x12};
  EXPECT_EQ(Code(Put(0x5000, 0, value, 0xC6, 4, 0)), 0x06020000u);
  EXPECT_EQ(Code(Put(0x1018, 9, value, 0xC6, 4, 0)), 0x06090011u);
  EXPECT_EQ(Code(Put(0x1008, 0, value, 0xC6, 4, 0)), 0x06010002u);
  EXPECT_EQ(Code(Put(0x2012, 0, value, 0xC6, 5, 0)), 0x06070012u);
  EXPECT_EQ(Code(Put(0x2012, 0, value, 0xC6, 3, 0)), 0x06070013u);
  EXPECT_EQ(Code(Put(0x2012, 0, value, 0xC6, 4, BlockCrc(value) ^ 1)), 0x05040004u);
  EXPECT_EQ(Code(Put(0x2012, 0, {1, 2, 3}, 0xC2, 4, 0)), 0x06070010u) << "as announced";
  EXPECT_EQ(Code(Put(0x2012, 0, {1, 2, 3}, 0xC0, 0, 0)), 0x06070013u);
  EXPECT_EQ(Code(Put(0x2012, 0, {1, 2, 3, 4, 5}, 0xC0, 0, 0)), 0x06070012u);
  EXPECT_EQ(Code(Put(0x200F, 0, {17}, 0xC2, 1, 0)), 0x06090031u) << "the value itself";
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_SETPOINT), 0);
}

TEST_F(Block, SegmentsOfADownloadAreChecked) {
  const auto begin = [&] { ASSERT_EQ(Ask(Request(0xC2, 0x2012, 0, 4))[0], 0xA0); };
  begin();
  EXPECT_EQ(Code(Ask({0x01, 1, 2, 3, 4})), 0x06070012u) << "not the last";
  for (uint8_t sequence : {0x00, 0x02, 0x82, 0xFF, 0x40}) {
    begin();
    EXPECT_EQ(Code(Ask({sequence, 1, 2, 3, 4})), 0x05040003u);
    EXPECT_EQ(Code(Ask({0xC1 | 3 << 2})), 0x05040001u) << "it is over";
  }
  begin();
  EXPECT_TRUE(Ask(Request(0x80, 0x2012, 0, 0x08000000)).empty()) << "the client's abort";
  EXPECT_EQ(Code(Ask({0xC1 | 3 << 2})), 0x05040001u);
  ASSERT_EQ(Download(0x1017, 0, 0, 2), 0u);
  begin();
  NodeTick(7500);
  Take();
  NodeTick(1);
  const std::vector<Frame> frames = Take(0x585);
  ASSERT_EQ(frames.size(), 1u);
  EXPECT_EQ(frames[0].data, Request(0x80, 0x2012, 0, 0x05040000));
}

}  // namespace
