#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "tests/firmware/unit/axis_fixture.hpp"

namespace {

class Recorder : public AxisFixture {
 protected:
  // Ticks with the encoder at `from`, from+1, ...: position and tick number differ by a constant.
  void TickTo(int ticks) {
    for (int i = 0; i < ticks; ++i) TickPosition(next_++);
  }

  std::vector<int32_t> Column(int channel) {
    std::vector<int32_t> column;
    int32_t values[RECORDER_CHANNELS];
    for (uint32_t i = 0; fw_recorder_read(&fw_, i, values) > 0; ++i) {
      column.push_back(values[channel]);
    }
    return column;
  }

  static std::vector<int32_t> Range(int first, int count, int step = 1) {
    std::vector<int32_t> range(static_cast<size_t>(count));
    for (int i = 0; i < count; ++i) range[static_cast<size_t>(i)] = first + i * step;
    return range;
  }

  int next_ = 0;
};

TEST_F(Recorder, ImmediateFillsTheLength) {
  Set(AXIS_OBJ_RECORDER_SIGNAL_1, Address(AXIS_OBJ_POSITION));
  Set(AXIS_OBJ_RECORDER_LENGTH, 10);
  TickTo(5);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_STATE), AXIS_RECORDER_STATE_IDLE);
  Set(AXIS_OBJ_RECORDER_ARM, 1);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_STATE), AXIS_RECORDER_STATE_ARMED);
  TickTo(9);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_STATE), AXIS_RECORDER_STATE_RECORDING);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_COUNT), 9);
  TickTo(1);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_STATE), AXIS_RECORDER_STATE_DONE);
  TickTo(10);
  EXPECT_EQ(fw_.live, 0) << "a recording of the axis alone wakes no drive";
  EXPECT_EQ(Column(0), Range(5, 10));
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_TRIGGER_INDEX), 0);
}

TEST_F(Recorder, PretriggerAndRisingEdge) {
  Set(AXIS_OBJ_RECORDER_SIGNAL_1, Address(AXIS_OBJ_POSITION));
  Set(AXIS_OBJ_RECORDER_LENGTH, 8);
  Set(AXIS_OBJ_RECORDER_PRETRIGGER, 3);
  Set(AXIS_OBJ_RECORDER_TRIGGER_SOURCE, Address(AXIS_OBJ_POSITION));
  Set(AXIS_OBJ_RECORDER_TRIGGER_EDGE, AXIS_RECORDER_TRIGGER_EDGE_RISING);
  Set(AXIS_OBJ_RECORDER_TRIGGER_LEVEL, 100);
  Set(AXIS_OBJ_RECORDER_ARM, 1);
  TickTo(100);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_STATE), AXIS_RECORDER_STATE_ARMED);
  EXPECT_EQ(Column(0).size(), 0u) << "nothing can be read before it is done";
  TickTo(20);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_STATE), AXIS_RECORDER_STATE_DONE);
  EXPECT_EQ(Column(0), Range(97, 8));
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_TRIGGER_INDEX), 3);
}

TEST_F(Recorder, EarlyTriggerKeepsFewerSamplesBefore) {
  Set(AXIS_OBJ_RECORDER_SIGNAL_1, Address(AXIS_OBJ_POSITION));
  Set(AXIS_OBJ_RECORDER_LENGTH, 8);
  Set(AXIS_OBJ_RECORDER_PRETRIGGER, 7);
  Set(AXIS_OBJ_RECORDER_TRIGGER_SOURCE, Address(AXIS_OBJ_POSITION));
  Set(AXIS_OBJ_RECORDER_TRIGGER_EDGE, AXIS_RECORDER_TRIGGER_EDGE_EITHER);
  Set(AXIS_OBJ_RECORDER_TRIGGER_LEVEL, 2);
  Set(AXIS_OBJ_RECORDER_ARM, 1);
  TickTo(20);
  EXPECT_EQ(Column(0), Range(0, 8));
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_TRIGGER_INDEX), 2);
}

TEST_F(Recorder, FallingEdgeOnly) {
  Set(AXIS_OBJ_RECORDER_SIGNAL_1, Address(AXIS_OBJ_FORCE_RAW));
  Set(AXIS_OBJ_RECORDER_LENGTH, 2);
  Set(AXIS_OBJ_RECORDER_TRIGGER_SOURCE, Address(AXIS_OBJ_FORCE_RAW));
  Set(AXIS_OBJ_RECORDER_TRIGGER_EDGE, AXIS_RECORDER_TRIGGER_EDGE_FALLING);
  Set(AXIS_OBJ_RECORDER_TRIGGER_LEVEL, 50);
  Set(AXIS_OBJ_RECORDER_ARM, 1);
  for (int code : {40, 60, 70, 51}) TickForce(static_cast<uint16_t>(code));
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_STATE), AXIS_RECORDER_STATE_ARMED);
  for (int code : {50, 49}) TickForce(static_cast<uint16_t>(code));
  EXPECT_EQ(Column(0), (std::vector<int32_t>{50, 49}));
}

// A u32 has no sign: past 2^31 it still rises, and falls only where it wraps.
TEST_F(Recorder, AnUnsignedSourceIsComparedWithoutSign) {
  struct Case {
    uint32_t from;
    int32_t level;  // the same 32 bits
    int edge;
    bool triggers;
  };
  const auto rising = AXIS_RECORDER_TRIGGER_EDGE_RISING;
  const auto falling = AXIS_RECORDER_TRIGGER_EDGE_FALLING;
  for (const Case &c :
       {Case{0x7FFFFFFDu, 0, falling, false}, Case{0x7FFFFFFDu, -5, falling, false},
        Case{0x7FFFFFFDu, INT32_MIN, rising, true}, Case{0x7FFFFFFDu, INT32_MIN, falling, false},
        Case{0x8FFFFFFEu, fx_s32_from_u32(0x90000000u), rising, true},
        Case{0xFFFFFFFDu, 0, falling, true}, Case{0xFFFFFFFDu, 0, rising, false},
        Case{0xFFFFFFFDu, -2, falling, true}}) {
    PowerUp();
    fw_.axis.signals.tick_count = c.from;
    Set(AXIS_OBJ_RECORDER_SIGNAL_1, Address(AXIS_OBJ_TICK_COUNT));
    Set(AXIS_OBJ_RECORDER_LENGTH, 1);
    Set(AXIS_OBJ_RECORDER_TRIGGER_SOURCE, Address(AXIS_OBJ_TICK_COUNT));
    Set(AXIS_OBJ_RECORDER_TRIGGER_EDGE, c.edge);
    Set(AXIS_OBJ_RECORDER_TRIGGER_LEVEL, c.level);
    Set(AXIS_OBJ_RECORDER_ARM, 1);
    TickTo(4);
    EXPECT_EQ(Read(AXIS_OBJ_RECORDER_STATE),
              c.triggers ? AXIS_RECORDER_STATE_DONE : AXIS_RECORDER_STATE_ARMED)
        << c.from << " " << c.level << " " << c.edge;
  }
}

// A signed source passes 0 on its way down.
TEST_F(Recorder, ASignedSourceIsComparedWithSign) {
  Set(AXIS_OBJ_RECORDER_SIGNAL_1, Address(AXIS_OBJ_POSITION));
  Set(AXIS_OBJ_RECORDER_LENGTH, 1);
  Set(AXIS_OBJ_RECORDER_TRIGGER_SOURCE, Address(AXIS_OBJ_POSITION));
  Set(AXIS_OBJ_RECORDER_TRIGGER_EDGE, AXIS_RECORDER_TRIGGER_EDGE_FALLING);
  Set(AXIS_OBJ_RECORDER_TRIGGER_LEVEL, -1);
  Set(AXIS_OBJ_RECORDER_ARM, 1);
  for (int position : {-3, -2, 0}) TickPosition(position);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_STATE), AXIS_RECORDER_STATE_ARMED);
  TickPosition(-1);
  EXPECT_EQ(Column(0), (std::vector<int32_t>{-1}));
}

TEST_F(Recorder, DecimationKeepsItsRasterAndMissesNoTrigger) {
  Set(AXIS_OBJ_RECORDER_SIGNAL_1, Address(AXIS_OBJ_POSITION));
  Set(AXIS_OBJ_RECORDER_LENGTH, 6);
  Set(AXIS_OBJ_RECORDER_DECIMATION, 10);
  Set(AXIS_OBJ_RECORDER_PRETRIGGER, 2);
  Set(AXIS_OBJ_RECORDER_TRIGGER_SOURCE, Address(AXIS_OBJ_FORCE_RAW));
  Set(AXIS_OBJ_RECORDER_TRIGGER_EDGE, AXIS_RECORDER_TRIGGER_EDGE_RISING);
  Set(AXIS_OBJ_RECORDER_TRIGGER_LEVEL, 1);
  Set(AXIS_OBJ_RECORDER_ARM, 1);
  TickTo(53);
  inputs_.adc_code[0] = 1;  // one tick only, between two samples
  TickTo(1);
  inputs_.adc_code[0] = 0;
  TickTo(100);
  EXPECT_EQ(Column(0), Range(40, 6, 10));
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_TRIGGER_INDEX), 2);
}

TEST_F(Recorder, PacksEachSignalByItsWidth) {
  Set(AXIS_OBJ_RECORDER_SIGNAL_1, Address(AXIS_OBJ_DAC_CODE));     // 2 bytes, negative
  Set(AXIS_OBJ_RECORDER_SIGNAL_2, Address(AXIS_OBJ_POSITION));     // 4 bytes, negative
  Set(AXIS_OBJ_RECORDER_SIGNAL_4, Address(AXIS_OBJ_ACTIVE_MODE));  // 1 byte; channel 3 is unused
  Set(AXIS_OBJ_RECORDER_SIGNAL_5, Address(AXIS_OBJ_FORCE_SIGN));   // 1 byte, negative
  Set(AXIS_OBJ_RECORDER_SIGNAL_8, Address(AXIS_OBJ_TICK_COUNT));   // 4 bytes
  Set(AXIS_OBJ_FORCE_SIGN, -1);
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Set(AXIS_OBJ_OPEN_LOOP_CODE, -2000);
  Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  Set(AXIS_OBJ_RECORDER_ARM, 1);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_CAPACITY), 32768 / 12);
  next_ = -70000;
  TickTo(2730);
  int32_t values[RECORDER_CHANNELS] = {};
  ASSERT_EQ(fw_recorder_read(&fw_, 3, values), 5);
  EXPECT_EQ(values[0], -2000);
  EXPECT_EQ(values[1], -69997);
  EXPECT_EQ(values[2], AXIS_MODE_OPEN_LOOP);
  EXPECT_EQ(values[3], -1);
  EXPECT_EQ(values[4], 4);
  const std::array<uint8_t, 12> first{0x30, 0xF8, 0x90, 0xEE, 0xFE, 0xFF, 1, 0xFF, 1, 0, 0, 0};
  EXPECT_TRUE(std::equal(first.begin(), first.end(), buffer_.begin()));
  EXPECT_EQ(fw_recorder_read(&fw_, 2729, values), 5);
  EXPECT_EQ(fw_recorder_read(&fw_, 2730, values), FW_ERROR_NO_DATA);
}

TEST_F(Recorder, TheBufferHolds16384Codes) {
  Set(AXIS_OBJ_RECORDER_SIGNAL_1, Address(AXIS_OBJ_DAC_CODE));
  Set(AXIS_OBJ_RECORDER_ARM, 1);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_CAPACITY), 16384);
}

TEST_F(Recorder, LastByteOfTheBufferAndNoFurther) {
  std::array<uint8_t, 20> small;
  small.fill(0xEE);
  PowerUp(&small[1], 18);
  Set(AXIS_OBJ_RECORDER_SIGNAL_1, Address(AXIS_OBJ_POSITION));
  Set(AXIS_OBJ_RECORDER_SIGNAL_2, Address(AXIS_OBJ_DAC_CODE));
  Set(AXIS_OBJ_RECORDER_PRETRIGGER, 2);
  Set(AXIS_OBJ_RECORDER_ARM, 1);
  TickTo(10);
  EXPECT_EQ(Column(0), Range(0, 3));
  EXPECT_EQ(small.front(), 0xEE);
  EXPECT_EQ(small.back(), 0xEE);
}

// A recording holds the samples from `pretrigger` before the trigger on, wherever in the ring the
// oldest lies; a byte is read by its offset in it. Five samples of six bytes in a buffer of thirty,
// of its own on the heap: the address sanitizer sees every byte beside it.
TEST_F(Recorder, EveryTurnOfTheRingReadsBackWhole) {
  constexpr int kSamples = 5, kBytes = 6;
  const auto heap = std::make_unique<uint8_t[]>(kSamples * kBytes);
  std::array<uint8_t, kSamples * kBytes + 2> guarded;
  guarded.fill(0xEE);
  for (uint8_t *buffer : {heap.get(), &guarded[1]}) {
    for (int pretrigger = 0; pretrigger < kSamples; ++pretrigger) {
      for (int trigger = 1; trigger <= 3 * kSamples; ++trigger) {
        PowerUp(buffer, kSamples * kBytes);
        Set(AXIS_OBJ_RECORDER_SIGNAL_1, Address(AXIS_OBJ_POSITION));
        Set(AXIS_OBJ_RECORDER_SIGNAL_2, Address(AXIS_OBJ_FORCE_RAW));
        Set(AXIS_OBJ_RECORDER_PRETRIGGER, pretrigger);
        Set(AXIS_OBJ_RECORDER_TRIGGER_SOURCE, Address(AXIS_OBJ_POSITION));
        Set(AXIS_OBJ_RECORDER_TRIGGER_EDGE, AXIS_RECORDER_TRIGGER_EDGE_RISING);
        Set(AXIS_OBJ_RECORDER_TRIGGER_LEVEL, 1000 + trigger);
        Set(AXIS_OBJ_RECORDER_ARM, 1);
        for (int t = 0; t < trigger + kSamples; ++t) {
          inputs_.adc_code[0] = static_cast<uint16_t>(200 - t);
          TickPosition(1000 + t);
        }
        const int before = std::min(pretrigger, trigger);
        const int first = trigger - before;
        ASSERT_EQ(Read(AXIS_OBJ_RECORDER_STATE), AXIS_RECORDER_STATE_DONE);
        ASSERT_EQ(Read(AXIS_OBJ_RECORDER_COUNT), kSamples);
        ASSERT_EQ(Read(AXIS_OBJ_RECORDER_TRIGGER_INDEX), before);
        ASSERT_EQ(Column(0), Range(1000 + first, kSamples)) << pretrigger << " " << trigger;
        ASSERT_EQ(Column(1), Range(200 - first, kSamples, -1)) << pretrigger << " " << trigger;
        std::vector<uint8_t> expected;
        for (int t = first; t < first + kSamples; ++t) {
          const int place = 1000 + t;
          expected.insert(expected.end(),
                          {static_cast<uint8_t>(place), static_cast<uint8_t>(place >> 8), 0, 0,
                           static_cast<uint8_t>(200 - t), 0});
        }
        ASSERT_EQ(dictionary_domain_size(&fw_.objects, DICTIONARY_RECORDING),
                  static_cast<int>(expected.size()));
        for (uint32_t offset = 0; offset <= expected.size(); ++offset) {
          std::vector<uint8_t> bytes(expected.size() + 1, 0xEE);
          bytes.resize(dictionary_domain_read(&fw_.objects, DICTIONARY_RECORDING, offset,
                                              bytes.data(), kSamples * kBytes + 1));
          ASSERT_EQ(bytes, std::vector<uint8_t>(expected.begin() + offset, expected.end()))
              << "from byte " << offset << ", " << pretrigger << " " << trigger;
        }
      }
    }
  }
  EXPECT_EQ(guarded.front(), 0xEE);
  EXPECT_EQ(guarded.back(), 0xEE);
}

TEST_F(Recorder, BytesAreHandedOverInPieces) {
  std::array<uint8_t, 6> buffer{};
  PowerUp(buffer.data(), buffer.size());
  Set(AXIS_OBJ_RECORDER_SIGNAL_1, Address(AXIS_OBJ_DAC_CODE));
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Set(AXIS_OBJ_OPEN_LOOP_CODE, 0x123);
  Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  Set(AXIS_OBJ_RECORDER_ARM, 1);
  std::array<uint8_t, 4> piece{};
  TickTo(2);
  EXPECT_EQ(dictionary_domain_size(&fw_.objects, DICTIONARY_RECORDING), FW_ERROR_NO_DATA)
      << "not done";
  EXPECT_EQ(dictionary_domain_read(&fw_.objects, DICTIONARY_RECORDING, 0, piece.data(), 4), 0u)
      << "not done";
  TickTo(1);
  EXPECT_EQ(dictionary_domain_size(&fw_.objects, DICTIONARY_RECORDING), 6);
  EXPECT_EQ(dictionary_domain_read(&fw_.objects, DICTIONARY_RECORDING, 1, piece.data(), 3), 3u)
      << "no more than asked for";
  EXPECT_EQ(piece, (std::array<uint8_t, 4>{0x01, 0x23, 0x01, 0}));
  EXPECT_EQ(dictionary_domain_read(&fw_.objects, DICTIONARY_RECORDING, 5, piece.data(), 4), 1u)
      << "no more than there are";
  EXPECT_EQ(dictionary_domain_read(&fw_.objects, DICTIONARY_RECORDING, 6, piece.data(), 4), 0u);
  Set(AXIS_OBJ_RECORDER_ARM, 0);
  EXPECT_EQ(dictionary_domain_read(&fw_.objects, DICTIONARY_RECORDING, 0, piece.data(), 4), 0u)
      << "stopped";
}

TEST_F(Recorder, RefusesWhatItCannotDo) {
  EXPECT_EQ(Write(AXIS_OBJ_RECORDER_ARM, 1), FW_ERROR_RANGE) << "no channel";
  EXPECT_EQ(Write(AXIS_OBJ_RECORDER_SIGNAL_1, Address(AXIS_OBJ_COUNT)), FW_ERROR_RANGE);
  EXPECT_EQ(Write(AXIS_OBJ_RECORDER_SIGNAL_1, Address(AXIS_OBJ_FAULT_RESET)), FW_ERROR_RANGE);
  EXPECT_EQ(Write(AXIS_OBJ_RECORDER_TRIGGER_SOURCE, Address(AXIS_OBJ_RECORDER_ARM)),
            FW_ERROR_RANGE);
  Set(AXIS_OBJ_RECORDER_SIGNAL_1, Address(AXIS_OBJ_POSITION));
  Set(AXIS_OBJ_RECORDER_LENGTH, 8193);
  EXPECT_EQ(Write(AXIS_OBJ_RECORDER_ARM, 1), FW_ERROR_RANGE) << "one sample too many";
  Set(AXIS_OBJ_RECORDER_LENGTH, 8192);
  Set(AXIS_OBJ_RECORDER_PRETRIGGER, 8192);
  EXPECT_EQ(Write(AXIS_OBJ_RECORDER_ARM, 1), FW_ERROR_RANGE) << "no room for the trigger's sample";
  Set(AXIS_OBJ_RECORDER_PRETRIGGER, 8191);
  Set(AXIS_OBJ_RECORDER_TRIGGER_EDGE, AXIS_RECORDER_TRIGGER_EDGE_RISING);
  EXPECT_EQ(Write(AXIS_OBJ_RECORDER_ARM, 1), FW_ERROR_RANGE) << "no source";
  Set(AXIS_OBJ_RECORDER_TRIGGER_SOURCE, Address(AXIS_OBJ_POSITION));
  EXPECT_EQ(Write(AXIS_OBJ_RECORDER_ARM, 1), FW_OK);
  EXPECT_EQ(Write(AXIS_OBJ_RECORDER_SIGNAL_1, 0), FW_ERROR_STATE);
  EXPECT_EQ(Write(AXIS_OBJ_RECORDER_DECIMATION, 2), FW_ERROR_STATE);
  Set(AXIS_OBJ_RECORDER_ARM, 0);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_STATE), AXIS_RECORDER_STATE_IDLE);
  EXPECT_EQ(Write(AXIS_OBJ_RECORDER_SIGNAL_1, 0), FW_OK);
}

TEST_F(Recorder, NoBufferIsNoCrash) {
  PowerUp(nullptr, 0);
  Set(AXIS_OBJ_RECORDER_SIGNAL_1, Address(AXIS_OBJ_POSITION));
  EXPECT_EQ(Write(AXIS_OBJ_RECORDER_ARM, 1), FW_ERROR_RANGE);
  TickTo(3);
}

}  // namespace
