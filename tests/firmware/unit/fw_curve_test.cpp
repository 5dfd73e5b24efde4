// The curve of a cycle over the buses: uploads against clients written here from CiA 301, parts
// over Modbus, who may read when, and what a stop, a fault and the next cycle leave of it.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <functional>
#include <utility>
#include <vector>

#include "tests/firmware/unit/cycle_records.hpp"
#include "tests/firmware/unit/fw_fixture.hpp"

namespace {

constexpr uint16_t kIndex = 0x243B;
constexpr uint8_t kSub = 6;
constexpr uint32_t kState = 0x08000022, kNoData = 0x08000024;
constexpr int kWords = 15;  // of five points

struct Point {
  uint32_t time;
  int32_t travel, force_q8;
  int phase;
  bool operator==(const Point &) const = default;
};
using Points = std::vector<Point>;

class CurveOfACycle : public Fw {
 protected:
  CurveOfACycle() { PowerUpWith(1000); }

  void PowerUpWith(uint32_t points, blackbox_t *blackbox = nullptr) {
    fw_ = fw_t{};
    fw_config_t config = NodeConfig();
    config.curve_memory = points == 0 ? nullptr : memory_.data();
    config.curve_bytes = 12 * points;
    config.blackbox = blackbox;
    fw_init(&fw_, &config);
    EnableServers();
    inputs_ = {0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
    Set(AXIS_OBJ_CONTACT_FORCE, 5 * 256);
    Set(AXIS_OBJ_FORCE_MAX, 250 * 256);
  }

  // Two phases that wait: the first one for 40 ticks, both at most until the home switch.
  void SelectPhases(const std::vector<cycle_point_t> &compliance = {}) {
    cycle_header_t header{};
    header.compliance = static_cast<uint8_t>(compliance.size());
    cycle_phase_t phase = wait_phase(1);
    phase.force_max_q8 = kForceMost;
    phase.travel_max = CYCLE_TRAVEL_MAX;
    phase.time_max = 1000000;
    phase.conditions[0] = {CYCLE_TIME, 1, 0, 40};
    phase.conditions[1] = {CYCLE_INPUT_ON, CYCLE_END, 0, AXIS_DIGITAL_INPUTS_HOME};
    cycle_phase_t last = phase;
    last.conditions[0] = last.conditions[1];
    record_ = completed(
        header, {phase, last}, [](cycle_element_t &peak) { peak.y_most = INT32_MAX; }, compliance);
    ASSERT_EQ(
        fw_select_program(&fw_, record_.data(), static_cast<uint32_t>(4 * record_.size())).reason,
        CYCLE_ACCEPTED);
  }

  void StartCycle() {
    inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
    Set(AXIS_OBJ_MODES_OF_OPERATION, -9);
    for (int word : {0x06, 0x07, 0x0F}) {
      Set(AXIS_OBJ_CONTROLWORD, word);
      Tick(2);
    }
    ASSERT_EQ(Inner(AXIS_OBJ_DRIVE_STATE), AXIS_DRIVE_STATE_OPERATION_ENABLED);
    Set(AXIS_OBJ_CONTROLWORD, 0x1F);
    begin_ = static_cast<uint32_t>(Inner(AXIS_OBJ_TICK_COUNT));
    zero_ = Place();
    zeroed_ = false;
    samples_.clear();
  }

  // The position less the deflection of the press.
  int32_t Place() const { return Inner(AXIS_OBJ_POSITION) - deflection_(Inner(AXIS_OBJ_FORCE)); }

  // One tick of the cycle with a motion and a force, noted as a sample if the cycle runs.
  void Step(int counts, int code) {
    inputs_.encoder_cnt += counts;
    inputs_.adc_code[0] = static_cast<uint16_t>(code);
    const bool runs = cycle_is_running(&fw_.drive.cycle);
    const int phase = fw_.drive.cycle.phase;
    Tick();
    const bool stopped = fw_.drive.cycle.outcome == CYCLE_STOPPED;
    if (!runs || stopped) return;
    if (!zeroed_ && Inner(AXIS_OBJ_CONTACT) != 0) {
      zeroed_ = true;
      zero_ = Place();
    }
    samples_.push_back({static_cast<uint32_t>(Inner(AXIS_OBJ_TICK_COUNT)) - begin_, Place(),
                        Inner(AXIS_OBJ_FORCE), phase});
  }

  // A slow approach, and from the contact on a force that rises with the travel.
  void Press(int ticks) {
    for (int i = 0; i < ticks; ++i, ++pressed_)
      Step(pressed_ % 3 == 0, std::max(0, std::min(200, pressed_ - 25)));
  }
  void EndCycle() {
    inputs_.din |= AXIS_DIGITAL_INPUTS_HOME;
    Press(1);
    Tick();
    ASSERT_FALSE(cycle_is_running(&fw_.drive.cycle));
  }
  void RunCycle(int ticks) {
    pressed_ = 0;
    StartCycle();
    Press(ticks);
    EndCycle();
  }

  // The points for samples by the description of curve.h, without a full memory.
  Points Expected(uint32_t travel, uint32_t force, uint32_t time) const {
    Points points;
    const auto is = [](int64_t change, uint32_t step) {
      return step != 0 && std::abs(change) >= step;
    };
    for (size_t i = 0; i < samples_.size(); ++i) {
      Point now = samples_[i];
      now.travel -= zero_;
      if (points.empty() || i + 1 == samples_.size() || now.phase != points.back().phase ||
          is(int64_t{now.travel} - points.back().travel, travel) ||
          is(int64_t{now.force_q8} - points.back().force_q8, force) ||
          is(int64_t{now.time} - points.back().time, time)) {
        points.push_back(now);
      }
    }
    return points;
  }
  Points ExpectedByDefault() const { return Expected(25, 256, 15); }

  static Points Decoded(const Bytes &bytes) {
    Points points;
    EXPECT_EQ(bytes.size() % 12, 0u);
    for (size_t at = 0; at + 12 <= bytes.size(); at += 12) {
      Point point{};
      std::memcpy(&point.time, &bytes[at], 4);
      std::memcpy(&point.travel, &bytes[at + 4], 4);
      point.phase = bytes[at + 8];
      point.force_q8 =
          static_cast<int8_t>(bytes[at + 11]) * 65536 + bytes[at + 10] * 256 + bytes[at + 9];
      points.push_back(point);
    }
    return points;
  }

  uint32_t UploadCode(Way way, uint8_t command = 0x40) {
    Bytes request = Request(command, kIndex, kSub, 127);
    const Bytes answer = AskSdo(way, request);
    if (answer.empty()) return kSilence;
    return answer[0] == 0x80 ? Word(answer) : 0;
  }

  Bytes InSegments(Way way) {
    const Bytes first = AskSdo(way, Request(0x40, kIndex, kSub));
    EXPECT_EQ(first[0], 0x41);
    Bytes data;
    for (uint8_t toggle = 0;; toggle ^= 0x10) {
      const Bytes segment = AskSdo(way, {static_cast<uint8_t>(0x60 | toggle), 0, 0, 0, 0, 0, 0, 0});
      if (segment.empty() || segment[0] == 0x80) {
        ADD_FAILURE() << "aborted";
        return {};
      }
      data.insert(data.end(), segment.begin() + 1, segment.end() - (segment[0] >> 1 & 7));
      if ((segment[0] & 1) != 0) break;
    }
    EXPECT_EQ(data.size(), Word(first));
    return data;
  }

  Bytes InBlocks(Way way, uint8_t block) {
    const Bytes first = AskSdo(way, Request(0xA4, kIndex, kSub, block));
    EXPECT_EQ(first[0], 0xC6);
    AskSdo(way, {0xA3, 0, 0, 0, 0, 0, 0, 0});
    Bytes data;
    for (bool last = false; !last;) {
      uint8_t good = 0;
      for (int quiet = 0; quiet < 3 && good < block && !last;) {
        Tick();
        const std::vector<Frame> frames = Take(AnswerId(ServerOf(way)));
        quiet = frames.empty() ? quiet + 1 : 0;
        for (const Frame &frame : frames) {
          ++good;
          last = (frame.data[0] & 0x80) != 0;
          data.insert(data.end(), frame.data.begin() + 1, frame.data.end());
        }
      }
      const Bytes answer = AskSdo(way, {0xA2, good, block, 0, 0, 0, 0, 0});
      if (!last) continue;
      EXPECT_EQ(answer[0] & 0xE3, 0xC1);
      data.erase(data.end() - (answer[0] >> 2 & 7), data.end());
      EXPECT_EQ(answer[1] | answer[2] << 8, BlockCrc(data));
    }
    EXPECT_TRUE(AskSdo(way, {0xA1, 0, 0, 0, 0, 0, 0, 0}).empty());
    EXPECT_EQ(data.size(), Word(first));
    return data;
  }

  // Five points at a time, each word by its own request.
  Bytes InParts(Way way) {
    Bytes data;
    const uint32_t points = Read(way, AXIS_OBJ_CYCLE_CURVE_POINTS);
    for (uint32_t first = 0; first < points; first += 5) {
      EXPECT_EQ(Write(way, AXIS_OBJ_CYCLE_CURVE_FIRST, static_cast<int32_t>(first)), 0u);
      for (int i = 0; i < kWords; ++i) {
        const Bytes word =
            LittleEndian(Read(way, static_cast<uint16_t>(AXIS_OBJ_CYCLE_DATA_1 + i)), 4);
        data.insert(data.end(), word.begin(), word.end());
      }
    }
    const Bytes beyond(data.begin() + 12 * points, data.end());
    EXPECT_EQ(beyond, Bytes(beyond.size())) << "0 without a point";
    data.resize(12 * points);
    return data;
  }

  std::vector<uint32_t> memory_ = std::vector<uint32_t>(3000);
  std::vector<uint32_t> record_;
  Points samples_;  // travel: the place
  std::function<int32_t(int32_t)> deflection_ = [](int32_t) { return 0; };
  uint32_t begin_ = 0;
  int32_t zero_ = 0;
  bool zeroed_ = false;
  int pressed_ = 0;
};

TEST_F(CurveOfACycle, HasTheSamplesOfTheTicksByEveryWay) {
  SelectPhases();
  for (const int ticks : {300, 41, 40, 26, 1, 700}) {
    RunCycle(ticks);
    ASSERT_EQ(zeroed_, ticks > 30) << "the contact is in the tick with more than 5 counts";
    const Points expected = ExpectedByDefault();
    ASSERT_EQ(Inner(AXIS_OBJ_CYCLE_CURVE_POINTS), static_cast<int>(expected.size()));
    ASSERT_EQ(Inner(AXIS_OBJ_CYCLE_CURVE_THINNED), 0);
    for (Way way : {kCanopen, kGateway, kLcm}) {
      const Bytes segments = InSegments(way);
      ASSERT_EQ(Decoded(segments), expected) << ticks;
      for (const uint8_t block : {1, 4, 127}) ASSERT_EQ(InBlocks(way, block), segments);
    }
    ASSERT_EQ(Decoded(InParts(kCanopen)), expected);
  }
  // Modbus reads the words of its axis one by one, or writes the place and reads five points
  // by one request of function 23.
  Set(AXIS_OBJ_CONTROLWORD, 0);
  Tick(2);
  ASSERT_TRUE(Acquires(kRtu));
  EXPECT_EQ(Decoded(InParts(kRtu)), ExpectedByDefault());
  const Bytes answer = AskRtu({23, 0x04, 0x10, 0, 30, 0x04, 0x45, 0, 1, 2, 0, 4});
  ASSERT_EQ(answer.size(), 5u + 60);
  for (int i = 0; i < kWords; ++i) {
    const size_t at = 3 + 4 * static_cast<size_t>(i);
    const uint32_t word = static_cast<uint32_t>(answer[at] << 24 | answer[at + 1] << 16 |
                                                answer[at + 2] << 8 | answer[at + 3]);
    ASSERT_EQ(word, memory_[12 + static_cast<size_t>(i)]);
  }
}

// The press deflects by half a count for a count of force, which it has before the cycle too.
TEST_F(CurveOfACycle, TheTravelIsLessTheDeflectionOfThePress) {
  deflection_ = [](int32_t force_q8) { return (force_q8 + 256) / 512; };
  SelectPhases({{0, 0}, {400 * 256, 200}});
  inputs_.adc_code[0] = 4;
  Tick();
  RunCycle(300);
  ASSERT_TRUE(zeroed_);
  ASSERT_EQ(deflection_(samples_[200].force_q8), 88);
  const Points points = Decoded(InSegments(kCanopen));
  EXPECT_EQ(points, ExpectedByDefault());
  EXPECT_GT(points.size(), 100u);
}

TEST_F(CurveOfACycle, TheStepsAreThoseAtTheStart) {
  SelectPhases();
  Set(AXIS_OBJ_CYCLE_CURVE_STEP_TRAVEL, 3);
  Set(AXIS_OBJ_CYCLE_CURVE_STEP_FORCE, 0);
  Set(AXIS_OBJ_CYCLE_CURVE_STEP_TIME, 0);
  StartCycle();
  Press(50);
  Set(AXIS_OBJ_CYCLE_CURVE_STEP_TIME, 1);
  Press(100);
  EndCycle();
  EXPECT_EQ(Decoded(InSegments(kCanopen)), Expected(3, 0, 0));
  RunCycle(20);
  EXPECT_EQ(Decoded(InSegments(kCanopen)), Expected(3, 0, 1));
  EXPECT_EQ(samples_.size(), 21u);
}

// As many ticks as the interrupt may wait for the main loop, also before the first one.
TEST_F(CurveOfACycle, SamplesThatWaitAreTakenLater) {
  SelectPhases();
  StartCycle();
  for (int i = 0; i < 20; ++i) {
    for (int k = 0; k < FW_BETWEEN_TICKS_MAX; ++k, ++pressed_) {
      inputs_.encoder_cnt += pressed_ % 2;
      inputs_.adc_code[0] = static_cast<uint16_t>(std::min(100, pressed_));
      const int phase = fw_.drive.cycle.phase;
      fw_prepare(&fw_);
      fw_control(&fw_, &inputs_, &outputs_);
      ASSERT_TRUE(fw_report(&fw_));
      if (!zeroed_ && Inner(AXIS_OBJ_CONTACT) != 0) {
        zeroed_ = true;
        zero_ = Inner(AXIS_OBJ_POSITION);
      }
      samples_.push_back({static_cast<uint32_t>(Inner(AXIS_OBJ_TICK_COUNT)) - begin_,
                          Inner(AXIS_OBJ_POSITION), Inner(AXIS_OBJ_FORCE), phase});
    }
    fw_between(&fw_);
  }
  inputs_.din |= AXIS_DIGITAL_INPUTS_HOME;
  Step(0, 100);
  ASSERT_TRUE(zeroed_);
  EXPECT_EQ(Decoded(InSegments(kCanopen)), ExpectedByDefault());
}

TEST_F(CurveOfACycle, ARunningCycleIsNotRead) {
  EXPECT_EQ(UploadCode(kCanopen), kNoData) << "before the first cycle";
  EXPECT_EQ(UploadCode(kLcm, 0xA4), kNoData);
  SelectPhases();
  RunCycle(100);
  StartCycle();
  EXPECT_EQ(UploadCode(kCanopen), kState) << "from the start on, before the first tick";
  Press(60);
  for (Way way : {kCanopen, kGateway, kLcm}) {
    EXPECT_EQ(UploadCode(way), kState);
    EXPECT_EQ(UploadCode(way, 0xA4), kState);
  }
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_CYCLE_CURVE_FIRST, 0), kState);
  EXPECT_EQ(AskRtu({23, 0x04, 0x10, 0, 30, 0x04, 0x45, 0, 1, 2, 0, 0})[1], 0x97);
  EXPECT_GT(Inner(AXIS_OBJ_CYCLE_CURVE_POINTS), 3) << "but it is seen to grow";
  EndCycle();
  EXPECT_EQ(Decoded(InSegments(kCanopen)), ExpectedByDefault());
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_CYCLE_CURVE_FIRST, 0), 0u);
}

TEST_F(CurveOfACycle, TheNextCycleEndsAnUploadAndNothingElseDoes) {
  SelectPhases();
  RunCycle(200);
  const Bytes all = InSegments(kLcm);
  Set(AXIS_OBJ_RECORDER_SIGNAL_1, 0x201F00);
  Set(AXIS_OBJ_RECORDER_LENGTH, 50);
  Set(AXIS_OBJ_RECORDER_ARM, 1);
  ASSERT_EQ(AskSdo(kLcm, Request(0x40, kIndex, kSub))[0], 0x41);
  Tick(60);
  Set(AXIS_OBJ_CONTROLWORD, 0);
  Set(AXIS_OBJ_RECORDER_ARM, 0);
  Tick(10);
  const Bytes next{0x60, 0, 0, 0, 0, 0, 0, 0};
  Bytes segment = AskSdo(kLcm, next);
  EXPECT_EQ(segment, (Bytes{0x00, all[0], all[1], all[2], all[3], all[4], all[5], all[6]}))
      << "another recording changes nothing";
  // A recording that is being uploaded, by another server.
  Set(AXIS_OBJ_RECORDER_ARM, 1);
  Tick(60);
  ASSERT_EQ(AskSdo(kGateway, Request(0x40, 0x2120, 0))[0], 0x41);
  ASSERT_EQ(AskSdo(kCanopen, Request(0xA4, kIndex, kSub, 2))[0], 0xC6);
  pressed_ = 0;
  StartCycle();
  Press(1);
  segment = AskSdo(kLcm, {0x70, 0, 0, 0, 0, 0, 0, 0});
  EXPECT_EQ(segment, Request(0x80, kIndex, kSub, kNoData));
  AskSdo(kCanopen, {0xA3, 0, 0, 0, 0, 0, 0, 0});
  Tick();
  const std::vector<Frame> frames = Take(AnswerId(kServer));
  ASSERT_EQ(frames.size(), 1u);
  EXPECT_EQ(frames[0].data, Request(0x80, kIndex, kSub, kNoData));
  EXPECT_EQ(AskSdo(kGateway, next)[0], 0x00) << "the recording goes on";
}

TEST_F(CurveOfACycle, AStopKeepsTheCurveUpToItsTick) {
  SelectPhases();
  const std::function<void()> stops[] = {
      [&] { Set(AXIS_OBJ_CONTROLWORD, 0x0F); },
      [&] { Set(AXIS_OBJ_CONTROLWORD, 0x00); },
      [&] { EXPECT_EQ(Write(kLcm, AXIS_OBJ_CONTROLWORD, 0x00), 0u); },
      [&] { inputs_.sensor_valid = 0; },
      [&] { inputs_.din = 0; },
      [&] { Set(AXIS_OBJ_MODES_OF_OPERATION, 1); },
  };
  for (const auto &stop : stops) {
    pressed_ = 0;
    StartCycle();
    Press(77);
    stop();
    Press(40);
    EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_STATE), AXIS_CYCLE_STATE_ABORTED);
    ASSERT_EQ(samples_.size(), 77u);
    EXPECT_EQ(Decoded(InBlocks(kCanopen, 127)), ExpectedByDefault());
    inputs_.sensor_valid = 1;
    inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
    Set(AXIS_OBJ_CONTROLWORD, 0);
    Tick(2);
    Set(AXIS_OBJ_CONTROLWORD, 0x80);
    Tick(2);
  }
}

// The end has a point also where the memory is full, and all of the cycle is there.
TEST_F(CurveOfACycle, AFullMemoryIsThinned) {
  SelectPhases();
  Set(AXIS_OBJ_CYCLE_CURVE_STEP_TIME, 1);
  RunCycle(5000);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_CURVE_THINNED), 3);
  const Points points = Decoded(InBlocks(kCanopen, 127));
  ASSERT_EQ(points.size(), static_cast<size_t>(Inner(AXIS_OBJ_CYCLE_CURVE_POINTS)));
  EXPECT_LE(points.size(), 1000u);
  EXPECT_GT(points.size(), 500u);
  size_t at = 0;
  for (const Point &point : points) {
    while (at < samples_.size() && samples_[at].time != point.time) ++at;
    ASSERT_LT(at, samples_.size());
    Point sample = samples_[at];
    sample.travel -= zero_;
    ASSERT_EQ(point, sample);
  }
  EXPECT_EQ(points.front().time, 1u);
  EXPECT_EQ(at + 1, samples_.size());
  Set(AXIS_OBJ_CONTROLWORD, 0);
  Tick(2);
  RunCycle(100);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_CURVE_THINNED), 0);
  EXPECT_EQ(Decoded(InSegments(kCanopen)), Expected(25, 256, 1));
}

TEST_F(CurveOfACycle, WithoutMemoryThereIsNone) {
  PowerUpWith(0);
  SelectPhases();
  RunCycle(100);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_STATE), AXIS_CYCLE_STATE_GOOD) << "the cycle needs none";
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_CURVE_POINTS), 0);
  EXPECT_EQ(UploadCode(kCanopen), kNoData);
  EXPECT_EQ(UploadCode(kCanopen, 0xA4), kNoData);
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_CYCLE_CURVE_FIRST, 65535), 0u);
  for (int i = 0; i <= kWords; ++i) EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_DATA_1 + i), 0);
}

TEST_F(CurveOfACycle, APowerUpForgetsIt) {
  SelectPhases();
  RunCycle(100);
  ASSERT_NE(Inner(AXIS_OBJ_CYCLE_CURVE_POINTS), 0);
  Set(AXIS_OBJ_CONTROLWORD, 0);
  Tick(2);
  Send(0, {0x81, kNode});
  Tick(3);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_CURVE_POINTS), 0);
  EXPECT_EQ(UploadCode(kCanopen), kNoData);
  SelectPhases();
  RunCycle(50);
  EXPECT_EQ(Decoded(InSegments(kCanopen)), ExpectedByDefault());
}

TEST_F(CurveOfACycle, AnotherSelectionLeavesIt) {
  SelectPhases();
  RunCycle(100);
  const Bytes all = InSegments(kCanopen);
  SelectPhases();
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_STATE), AXIS_CYCLE_STATE_IDLE);
  EXPECT_EQ(InSegments(kCanopen), all);
}

// The black box goes on beside the curve: an incident in a cycle has its signals of every tick.
TEST_F(CurveOfACycle, TheBlackBoxRecordsBesideIt) {
  blackbox_t blackbox{};
  PowerUpWith(1000, &blackbox);
  SelectPhases();
  StartCycle();
  Press(200);
  EXPECT_EQ(Inner(AXIS_OBJ_BLACKBOX_STATE), AXIS_BLACKBOX_STATE_RECORDING);
  inputs_.din = 0;
  Press(1);
  Tick(5000);  // its CRC is computed in steps
  ASSERT_EQ(Inner(AXIS_OBJ_BLACKBOX_STATE), AXIS_BLACKBOX_STATE_INCIDENT);
  EXPECT_EQ(Decoded(InBlocks(kCanopen, 127)), ExpectedByDefault());
  Set(AXIS_OBJ_INCIDENT_COMMAND, AXIS_INCIDENT_COMMAND_FETCH);
  const uint32_t trigger = static_cast<uint32_t>(Inner(AXIS_OBJ_RECORDER_TRIGGER_INDEX));
  ASSERT_GE(trigger, 200u);
  for (uint32_t i = 0; i < 200; ++i) {
    int32_t values[RECORDER_CHANNELS];
    ASSERT_EQ(fw_recorder_read(&fw_, trigger - 200 + i, values), RECORDER_CHANNELS);
    ASSERT_EQ(values[0], samples_[i].travel) << i;  // position
  }
  EXPECT_EQ(Decoded(InBlocks(kCanopen, 127)), ExpectedByDefault())
      << "and the curve is still there";
}

}  // namespace
