// The archive: incidents that a power cut leaves, whatever was under way.

#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <vector>

#include "tests/firmware/unit/bus_fixture.hpp"
#include "tests/firmware/unit/flash.hpp"

namespace {

constexpr uint32_t kSampleBytes = 18;
constexpr uint32_t kSamples = 60;
constexpr uint32_t kRecorderBytes = kSamples * kSampleBytes;
constexpr uint32_t kRecord = 16 + 16 + (kRecorderBytes + 15) / 16 * 16 + 4 + 4;
constexpr uint32_t kSector = (2 * kRecord + 100) / 16 * 16;  // two incidents

class Archive : public BusFixture {
 protected:
  Archive() : flash_(kSector) { PowerUp(); }

  // The memory of the black box holds anything after a power cut.
  void PowerUp() {
    std::memset(static_cast<void *>(&blackbox_), 0xA5, sizeof(blackbox_));
    fw_config_t config = NodeConfig();
    config.recorder_bytes = kRecorderBytes;
    config.blackbox = &blackbox_;
    config.archive = flash_.memory();
    fw_init(&fw_, &config);
    inputs_ = {0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
    Tick(4);
  }

  int Stored() { return Read(AXIS_OBJ_INCIDENT_STORED); }

  void Settle() {
    for (int i = 0; i < 1000 && Busy(); ++i) Tick();
  }
  bool Busy() {
    return Stored() == AXIS_INCIDENT_STORED_WRITING || Stored() == AXIS_INCIDENT_STORED_CHECKING ||
           Read(AXIS_OBJ_BLACKBOX_STATE) == AXIS_BLACKBOX_STATE_COMPLETING;
  }

  // An incident whose last position is `position`.
  void Fail(int position) {
    inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
    Set(AXIS_OBJ_FAULT_RESET, 1);
    Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
    inputs_.encoder_cnt = position - 100;
    for (int i = 0; i < 100; ++i) {
      ++inputs_.encoder_cnt;
      Tick();
    }
    ASSERT_EQ(outputs_.amp_enable, 1);
    inputs_.din = 0;
    Tick(BLACKBOX_AFTER + kRecorderBytes / 16 + 4);
  }

  // The last position before the error, of the incident in the black box; 0: there is none.
  int Position() {
    if (Write(AXIS_OBJ_INCIDENT_COMMAND, AXIS_INCIDENT_COMMAND_FETCH) != FW_OK) return 0;
    std::vector<std::int32_t> values(RECORDER_CHANNELS);
    const auto error = static_cast<uint32_t>(Read(AXIS_OBJ_RECORDER_TRIGGER_INDEX));
    EXPECT_EQ(fw_recorder_read(&fw_, error, values.data()), RECORDER_CHANNELS);
    Set(AXIS_OBJ_RECORDER_ARM, 0);
    return values[0];
  }

  // The same of what a power cut left.
  int Loaded() {
    Settle();
    if (Write(AXIS_OBJ_INCIDENT_COMMAND, AXIS_INCIDENT_COMMAND_LOAD) != FW_OK) return 0;
    Settle();
    EXPECT_EQ(Read(AXIS_OBJ_BLACKBOX_STATE), AXIS_BLACKBOX_STATE_INCIDENT_KEPT);
    return Position();
  }

  Flash flash_;
  blackbox_t blackbox_{};
};

TEST_F(Archive, AnIncidentOutlivesAPowerCutWhole) {
  EXPECT_EQ(Stored(), AXIS_INCIDENT_STORED_NONE);
  Fail(5000);
  Settle();
  ASSERT_EQ(Stored(), AXIS_INCIDENT_STORED_STORED);
  const int32_t crc = Read(AXIS_OBJ_INCIDENT_CRC);
  const int32_t tick = Read(AXIS_OBJ_INCIDENT_TICK);
  PowerUp();
  EXPECT_EQ(Read(AXIS_OBJ_BLACKBOX_STATE), AXIS_BLACKBOX_STATE_RECORDING);
  EXPECT_EQ(Loaded(), 5000);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_CRC), crc);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_TICK), tick);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_FAULT), AXIS_FAULT_ENABLE_LOST);
  EXPECT_EQ(Read(AXIS_OBJ_INCIDENT_ERROR_CODE), AXIS_ERROR_CODE_ENABLE_LOST);
  EXPECT_EQ(Read(AXIS_OBJ_RECORDER_COUNT), 0);  // given back
  EXPECT_EQ(flash_.erases(), 0);
  EXPECT_LE(flash_.most_per_call(), 16);
}

TEST_F(Archive, ACutAfterAnyByteLeavesTheOldIncidentOrTheNewOne) {
  Fail(5000);
  Settle();
  const Bytes before = flash_.bytes();
  PowerUp();
  const int64_t begin = flash_.steps();
  Fail(6000);
  Settle();
  const int64_t steps = flash_.steps() - begin;
  ASSERT_EQ(steps, kRecord - 4);
  int old_seen = 0;
  for (int64_t life = 1; life <= steps; ++life) {
    flash_.bytes() = before;
    PowerUp();
    flash_.PowerFor(life, static_cast<uint32_t>(life));
    Fail(6000);
    Settle();
    flash_.PowerFor(-1, 0);
    PowerUp();
    const int found = Loaded();
    ASSERT_EQ(found, life == steps && found == 6000 ? 6000 : 5000) << "cut in step " << life;
    old_seen += found == 5000 ? 1 : 0;
    // The next one finds room, at the latest in the sector that this power-up erased.
    Set(AXIS_OBJ_INCIDENT_COMMAND, AXIS_INCIDENT_COMMAND_CLEAR);
    Tick(4);
    Fail(7000);
    Settle();
    PowerUp();
    ASSERT_EQ(Loaded(), 7000) << "after a cut in step " << life;
    ASSERT_FALSE(flash_.misused());
  }
  EXPECT_GE(old_seen, steps - 1);
}

TEST_F(Archive, TheNewestIsKeptWhileSectorsTakeTurns) {
  for (int i = 1; i <= 9; ++i) {
    Fail(1000 * i);
    Settle();
    const int erases = flash_.erases();
    EXPECT_EQ(erases, i > 4 ? (i - 3) / 2 : 0) << i;
    PowerUp();
    ASSERT_EQ(Loaded(), 1000 * i);
    PowerUp();
    EXPECT_LE(flash_.erases(), erases + 1);
  }
  EXPECT_FALSE(flash_.misused());
}

TEST_F(Archive, OneADayOfOperation) {
  Fail(5000);
  Settle();
  const int64_t steps = flash_.steps();
  for (const uint32_t hours : {0u, 23u, 0u}) {
    fw_overrun(&fw_, hours * 3600 * 1500);
    Set(AXIS_OBJ_INCIDENT_COMMAND, AXIS_INCIDENT_COMMAND_CLEAR);
    Tick(8);
    Fail(6000);
    Settle();
    EXPECT_LE(flash_.steps() - steps, 4);  // that it is cleared
  }
  Set(AXIS_OBJ_INCIDENT_COMMAND, AXIS_INCIDENT_COMMAND_CLEAR);
  fw_overrun(&fw_, 3600 * 1500);
  Fail(7000);
  Settle();
  PowerUp();
  EXPECT_EQ(Loaded(), 7000);
}

TEST_F(Archive, NothingIsWrittenWhileTheAxisIsEnabled) {
  Fail(5000);
  for (int i = 0; i < 20 && Stored() != AXIS_INCIDENT_STORED_WRITING; ++i) Tick();
  Tick(3);
  inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
  Set(AXIS_OBJ_FAULT_RESET, 1);
  Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  Tick();
  ASSERT_EQ(outputs_.amp_enable, 1);
  const int64_t steps = flash_.steps();
  Tick(100);
  EXPECT_EQ(flash_.steps(), steps);
  EXPECT_EQ(Stored(), AXIS_INCIDENT_STORED_WRITING);
  Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
  Tick(2);
  Settle();
  PowerUp();
  EXPECT_EQ(Loaded(), 5000);
}

TEST_F(Archive, AClearedIncidentIsNotFoundAgain) {
  Fail(5000);
  Settle();
  Set(AXIS_OBJ_INCIDENT_COMMAND, AXIS_INCIDENT_COMMAND_CLEAR);
  EXPECT_EQ(Stored(), AXIS_INCIDENT_STORED_STORED);
  Tick(2);
  EXPECT_EQ(Stored(), AXIS_INCIDENT_STORED_NONE);
  PowerUp();
  EXPECT_EQ(Loaded(), 0);
  Fail(6000);
  Settle();
  PowerUp();
  EXPECT_EQ(Loaded(), 6000);
}

TEST_F(Archive, AnIncidentOfAnotherTableIsReportedNotLoaded) {
  Fail(5000);
  Settle();
  Bytes &bytes = flash_.bytes();
  PutWord(bytes, 4, AXIS_OBJECTS_HASH32 + 1);
  PutWord(bytes, kRecord - 8, Crc32(bytes.data(), kRecord - 8));
  PowerUp();
  Settle();
  EXPECT_EQ(Stored(), AXIS_INCIDENT_STORED_OTHER_TABLE);
  EXPECT_EQ(Write(AXIS_OBJ_INCIDENT_COMMAND, AXIS_INCIDENT_COMMAND_LOAD), FW_ERROR_NO_DATA);
}

TEST_F(Archive, AMemoryThatFailsLeavesTheAxisAsItIs) {
  flash_.faults.program = FlashFaults::Program::kRefused;
  flash_.faults.program_from = 500;
  Fail(5000);
  Settle();
  EXPECT_EQ(Stored(), AXIS_INCIDENT_STORED_NONE);
  EXPECT_EQ(Position(), 5000);
  flash_.faults.program = FlashFaults::Program::kStuck;
  PowerUp();
  Fail(6000);
  Settle();
  EXPECT_EQ(Stored(), AXIS_INCIDENT_STORED_NONE);
  flash_.faults = {};
  PowerUp();
  Fail(7000);
  Settle();
  EXPECT_EQ(Stored(), AXIS_INCIDENT_STORED_STORED);
  PowerUp();
  EXPECT_EQ(Loaded(), 7000);
}

TEST_F(Archive, AnIncidentOfTheBlackBoxIsNotOverwritten) {
  Fail(5000);
  Settle();
  PowerUp();
  Settle();
  Fail(6000);
  EXPECT_EQ(Write(AXIS_OBJ_INCIDENT_COMMAND, AXIS_INCIDENT_COMMAND_LOAD), FW_ERROR_NO_DATA);
  EXPECT_EQ(Position(), 6000);
}

}  // namespace
