// Results of cycles: they wait until they are acknowledged, are counted over power cuts, and lock
// the start where the user wants it.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <map>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tests/firmware/unit/cycle_records.hpp"
#include "tests/firmware/unit/flash.hpp"
#include "tests/firmware/unit/fw_fixture.hpp"

namespace {

enum Bits : uint32_t {
  kReady = 1,
  kBusy = 2,
  kGood = 4,
  kBad = 8,
  kAborted = 16,
  kWaits = 32,
  kLock = 64,
  kFull = 128
};

class Results : public Fw {
 protected:
  Results() { PowerUpWith(nullptr, FW_RESULTS); }

  void PowerUpWith(const store_memory_t *memory, size_t results) {
    fw_ = fw_t{};
    fw_config_t config = NodeConfig();
    config.memory = memory;
    config.program_memory = programs_.data();
    config.program_bytes = static_cast<uint32_t>(4 * programs_.size());
    results_.assign(results, cycle_part_t{});
    config.result_memory = results == 0 ? nullptr : results_.data();
    config.result_bytes = static_cast<uint32_t>(results * sizeof(cycle_part_t));
    fw_init(&fw_, &config);
    EnableServers();
    inputs_ = {0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
    Set(AXIS_OBJ_FIRST_MOTION_TEST, AXIS_FIRST_MOTION_TEST_OFF);
  }

  // The program of one phase of ten ticks, whose element is good up to a force of 900/256 counts.
  void Load(const Bytes &record = cycle_record(7)) {
    cycle_library_begin(&fw_.library);
    ASSERT_TRUE(
        cycle_library_append(&fw_.library, 0, record.data(), static_cast<uint32_t>(record.size())));
    Set(AXIS_OBJ_CYCLE_DATA_END, static_cast<int>(record.size()));
    Settle();
    Set(AXIS_OBJ_CYCLE_PROGRAM, 7);
  }

  void Settle() {
    Tick();
    for (int i = 0; i < 4000; ++i) {
      Tick();
      if (Inner(AXIS_OBJ_CYCLE_STORE_STATE) != AXIS_CYCLE_STORE_STATE_WAITING) return;
    }
    FAIL() << "it is not stored";
  }

  void Enable() {
    Set(AXIS_OBJ_MODES_OF_OPERATION, -9);
    for (int word : {0x06, 0x07, 0x0F}) {
      Set(AXIS_OBJ_CONTROLWORD, word);
      Tick(2);
    }
    ASSERT_EQ(Inner(AXIS_OBJ_DRIVE_STATE), AXIS_DRIVE_STATE_OPERATION_ENABLED);
  }
  void Disable() {
    Set(AXIS_OBJ_CONTROLWORD, 0);
    Tick(2);
  }

  // Starts a cycle; returns whether it runs.
  bool Start() {
    Set(AXIS_OBJ_CONTROLWORD, 0x0F);
    Tick();
    Set(AXIS_OBJ_CONTROLWORD, 0x1F);
    Tick();
    return Inner(AXIS_OBJ_CYCLE_STATE) == AXIS_CYCLE_STATE_RUNNING;
  }

  // Presses a part; returns the state that the axis shows.
  int Press(int verdict = AXIS_CYCLE_STATE_GOOD) {
    inputs_.adc_code[0] = verdict == AXIS_CYCLE_STATE_BAD ? static_cast<int16_t>(3 + 1) : 3;
    if (!Start()) return Inner(AXIS_OBJ_CYCLE_STATE);
    if (verdict == AXIS_CYCLE_STATE_ABORTED) {
      Tick(3);
      Set(AXIS_OBJ_CONTROLWORD, 0x0F);
    }
    Tick(20);
    return Inner(AXIS_OBJ_CYCLE_STATE);
  }

  uint32_t Acknowledge(Way way, uint32_t number) {
    return Write(way, AXIS_OBJ_CYCLE_ACKNOWLEDGE, static_cast<int32_t>(number));
  }
  int Waiting() const { return Inner(AXIS_OBJ_CYCLE_RESULTS_WAITING); }
  uint32_t State() const { return static_cast<uint32_t>(Inner(AXIS_OBJ_CYCLE_BITS)); }
  uint32_t Shown(uint16_t object) { return Read(kCanopen, object); }

  std::vector<uint32_t> programs_ =
      std::vector<uint32_t>((CYCLE_PROGRAM_BYTES_MAX + 4096) / sizeof(uint32_t));
  std::vector<cycle_part_t> results_;
};

TEST_F(Results, AResultShowsWhatWasPressed) {
  Load();
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_PART), 0u);
  EXPECT_EQ(State(), 0u) << "not enabled";
  Enable();
  EXPECT_EQ(State(), kReady);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CYCLE_SERIAL_1, 0x34333231), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CYCLE_SERIAL_4, 0x39), 0u);
  ASSERT_TRUE(Start());
  const auto begin = static_cast<uint32_t>(Inner(AXIS_OBJ_TICK_COUNT)) - 1;
  EXPECT_EQ(State(), kBusy);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_SERIAL_1), 0) << "taken";
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CYCLE_SERIAL_1, 0x55), 0u) << "of the next part";
  inputs_.adc_code[0] = 3;
  Tick(20);
  EXPECT_EQ(State(), kReady | kGood | kWaits);
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_PART), 1u);
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_STATE), AXIS_CYCLE_STATE_GOOD);
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_BEGIN), begin);
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_DURATION), 10u);
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_SERIAL_1), 0x34333231u);
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_SERIAL_4), 0x39u);
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_PROGRAM_CRC), Shown(AXIS_OBJ_CYCLE_PROGRAM_CRC));
  EXPECT_EQ(Press(AXIS_CYCLE_STATE_BAD), AXIS_CYCLE_STATE_BAD);
  EXPECT_EQ(State(), kReady | kBad | kWaits);
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_SERIAL_1), 0x55u);
  EXPECT_EQ(Press(AXIS_CYCLE_STATE_ABORTED), AXIS_CYCLE_STATE_ABORTED);
  EXPECT_EQ(State() & (kGood | kBad | kAborted), static_cast<uint32_t>(kAborted));
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_SERIAL_1), 0u) << "none was given";
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_OUTCOME), AXIS_CYCLE_OUTCOME_STOPPED);
  // Each waiting result is shown by its number.
  const int verdicts[] = {AXIS_CYCLE_STATE_GOOD, AXIS_CYCLE_STATE_BAD, AXIS_CYCLE_STATE_ABORTED};
  for (uint32_t number : {2u, 1u, 3u}) {
    ASSERT_EQ(Write(kLcm, AXIS_OBJ_CYCLE_RESULT_NUMBER, static_cast<int32_t>(number)), 0u);
    EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_PART), number);
    EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_STATE), static_cast<uint32_t>(verdicts[number - 1]));
    EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_VALUE), number == 2 ? 1024u : 768u);
  }
  ASSERT_EQ(Write(kLcm, AXIS_OBJ_CYCLE_RESULT_NUMBER, 4), 0u);
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_PART), 0u) << "there is no such result";
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_PARTS_GOOD), 1u);
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_PARTS_BAD), 1u);
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_PARTS_ABORTED), 1u);
}

// All frames come between two passes of the main loop: the serial number that follows the start is
// that of the next part, also where the start follows the end of the last part at once.
TEST_F(Results, TheSerialNumberIsTakenAtTheStart) {
  Load();
  Enable();
  const auto controlword = [&](unsigned word) {
    Send(0x200 + kNode, {static_cast<uint8_t>(word), static_cast<uint8_t>(word >> 8), 0xF7});
  };
  const auto serial = [&](int32_t value) {
    ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CYCLE_SERIAL_1, value), 0u);
  };
  Send(0, {1, kNode});
  serial(1);
  controlword(0x1F);
  serial(2);
  inputs_.adc_code[0] = 3;
  Tick(5);
  controlword(0x0F);
  controlword(0x1F);
  serial(3);
  Tick(20);
  controlword(0x0F);
  controlword(0x1F);
  controlword(0x11F);  // withdrawn before a tick: the part keeps its number
  controlword(0x0F);
  controlword(0x1F);
  serial(4);
  Tick(20);
  EXPECT_EQ(Waiting(), 3);
  for (uint32_t part : {1u, 2u, 3u}) {
    ASSERT_EQ(Write(kLcm, AXIS_OBJ_CYCLE_RESULT_NUMBER, static_cast<int32_t>(part)), 0u);
    EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_SERIAL_1), part);
  }
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_SERIAL_1), 4) << "of the next part";
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_COUNT), 3);
  // Also a start that another write than a controlword withdraws gives the number back.
  controlword(0x0F);
  controlword(0x1F);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_SERIAL_1), 0);
  Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_COUNT), 3);
  for (int word : {0x06, 0x07, 0x0F, 0x1F}) controlword(static_cast<unsigned>(word));
  serial(5);
  Tick(20);
  ASSERT_EQ(Write(kLcm, AXIS_OBJ_CYCLE_RESULT_NUMBER, 4), 0u);
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_SERIAL_1), 4u);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_SERIAL_1), 5);
}

// The record names the bank of the start.
TEST_F(Results, TheBankOfAPartIsThatOfItsStart) {
  for (int bank : {0, 1}) {
    Set(static_cast<uint16_t>(AXIS_OBJ_BANK_GAIN_1 + bank), (5 + bank) * 256);
    Set(static_cast<uint16_t>(AXIS_OBJ_BANK_CRC_1 + bank),
        static_cast<int32_t>(law_bank_crc(&fw_.banks.params, static_cast<uint8_t>(bank))));
  }
  Load();
  Set(AXIS_OBJ_FORCE_BANK, 1);
  Enable();
  inputs_.adc_code[0] = 3;
  ASSERT_TRUE(Start());
  Tick(3);
  EXPECT_NE(Write(kCanopen, AXIS_OBJ_FORCE_BANK, 2), 0u);
  Tick(7);
  ASSERT_EQ(Inner(AXIS_OBJ_CYCLE_STATE), AXIS_CYCLE_STATE_EVALUATING + 1) << "good";
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_FORCE_BANK, 2), 0u);
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_BANK_CRC),
            static_cast<uint32_t>(Inner(AXIS_OBJ_BANK_CRC_1)));
  ASSERT_TRUE(Start());
  Tick(20);
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_BANK_CRC),
            static_cast<uint32_t>(Inner(AXIS_OBJ_BANK_CRC_2)));
}

// Numbers of parts wrap without the number 0, which means none, and what waits stays reachable.
TEST_F(Results, TheNumbersOfPartsWrap) {
  Load();
  Enable();
  fw_.results.counts.number = UINT32_MAX - 2;
  for (int i = 0; i < 4; ++i) ASSERT_EQ(Press(), AXIS_CYCLE_STATE_GOOD) << i;
  EXPECT_EQ(Waiting(), 4);
  EXPECT_EQ(cycle_results_oldest(&fw_.results.waiting), UINT32_MAX - 1);
  for (uint32_t number : {UINT32_MAX - 1, UINT32_MAX, 1u, 2u}) {
    ASSERT_EQ(Write(kLcm, AXIS_OBJ_CYCLE_RESULT_NUMBER, static_cast<int32_t>(number)), 0u);
    EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_PART), number);
    EXPECT_EQ(Acknowledge(kCanopen, number), 0u) << number;
  }
  EXPECT_EQ(Waiting(), 0);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_NUMBER), 2);
}

TEST_F(Results, FullOfResultsNoCycleStarts) {
  Load();
  Enable();
  for (int i = 0; i < FW_RESULTS; ++i) ASSERT_EQ(Press(), AXIS_CYCLE_STATE_GOOD) << i;
  EXPECT_EQ(Waiting(), FW_RESULTS);
  EXPECT_EQ(Press(), AXIS_CYCLE_STATE_RESULTS_FULL);
  EXPECT_EQ(State() & (kReady | kFull), static_cast<uint32_t>(kFull));
  EXPECT_EQ(Acknowledge(kCanopen, 17), 0u);
  EXPECT_EQ(Acknowledge(kCanopen, 17), 0u) << "again, as a cyclic frame does";
  EXPECT_NE(Acknowledge(kCanopen, 40), 0u) << "there was no such part";
  EXPECT_EQ(Waiting(), FW_RESULTS - 1);
  Tick();
  EXPECT_EQ(Press(), AXIS_CYCLE_STATE_GOOD);
  EXPECT_EQ(Press(), AXIS_CYCLE_STATE_RESULTS_FULL);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CYCLE_RESULT_NUMBER, 17), 0u);
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_PART), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CYCLE_RESULT_NUMBER, 33), 0u);
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_PART), 33u);
}

TEST_F(Results, EverySourceAcknowledgesAndOnlyThat) {
  Load();
  Enable();
  for (int i = 0; i < 4; ++i) ASSERT_EQ(Press(), AXIS_CYCLE_STATE_GOOD);
  uint32_t number = 1;
  for (Way way : kWays) {
    EXPECT_EQ(Acknowledge(way, number), 0u) << way;
    EXPECT_EQ(Waiting(), static_cast<int>(4 - number));
    ++number;
    EXPECT_EQ(Write(way, AXIS_OBJ_CYCLE_RESULT_ELEMENT, 0), 0u);
    if (way != kCanopen) {
      EXPECT_NE(Write(way, AXIS_OBJ_CYCLE_UNLOCK, 1), 0u);
      EXPECT_NE(Write(way, AXIS_OBJ_CYCLE_SERIAL_1, 1), 0u);
      EXPECT_NE(Write(way, AXIS_OBJ_CYCLE_PROGRAM, 0), 0u);
    }
  }
  EXPECT_EQ(Inner(AXIS_OBJ_COMMAND_SOURCE), AXIS_COMMAND_SOURCE_CANOPEN);
}

TEST_F(Results, ABadPartLocksTheStartUntilItIsAcknowledged) {
  Load();
  Set(AXIS_OBJ_CYCLE_LOCK_ON_BAD, 1);
  Enable();
  EXPECT_EQ(Press(), AXIS_CYCLE_STATE_GOOD);
  EXPECT_EQ(Press(), AXIS_CYCLE_STATE_GOOD) << "good parts may wait";
  for (int verdict : {AXIS_CYCLE_STATE_BAD, AXIS_CYCLE_STATE_ABORTED}) {
    EXPECT_EQ(Press(verdict), verdict);
    const auto number = static_cast<uint32_t>(Inner(AXIS_OBJ_CYCLE_NUMBER));
    EXPECT_EQ(Press(), AXIS_CYCLE_STATE_LOCKED);
    EXPECT_EQ(State() & (kReady | kLock), static_cast<uint32_t>(kLock));
    ASSERT_EQ(Acknowledge(kCanopen, 1), 0u);
    Tick();
    EXPECT_EQ(Press(), AXIS_CYCLE_STATE_LOCKED) << "another part was acknowledged";
    Set(AXIS_OBJ_CYCLE_PROGRAM, 0);
    Set(AXIS_OBJ_CYCLE_PROGRAM, 7);
    EXPECT_EQ(Press(), AXIS_CYCLE_STATE_LOCKED) << "a selection does not unlock";
    ASSERT_EQ(Acknowledge(kCanopen, number), 0u);
    Tick();
    EXPECT_EQ(Press(), AXIS_CYCLE_STATE_GOOD);
  }
}

TEST_F(Results, BadPartsInARowLockTheStart) {
  Load();
  Set(AXIS_OBJ_CYCLE_BAD_IN_ROW_MAX, 3);
  Enable();
  const auto acknowledge_all = [&] {
    for (int i = 1; i <= Inner(AXIS_OBJ_CYCLE_NUMBER); ++i) Set(AXIS_OBJ_CYCLE_ACKNOWLEDGE, i);
  };
  for (int verdict : {AXIS_CYCLE_STATE_BAD, AXIS_CYCLE_STATE_ABORTED, AXIS_CYCLE_STATE_GOOD,
                      AXIS_CYCLE_STATE_BAD, AXIS_CYCLE_STATE_BAD, AXIS_CYCLE_STATE_ABORTED}) {
    EXPECT_EQ(Press(verdict), verdict);
    acknowledge_all();
  }
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_BAD_IN_ROW), 3);
  EXPECT_EQ(Press(), AXIS_CYCLE_STATE_LOCKED);
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_CYCLE_UNLOCK, 1), 0u);
  Tick();
  EXPECT_EQ(Press(), AXIS_CYCLE_STATE_GOOD);
}

TEST_F(Results, ALockedLibraryTakesNoProgram) {
  Load();
  Set(AXIS_OBJ_CYCLE_PROGRAM_LOCK, 1);
  EXPECT_NE(Write(kCanopen, AXIS_OBJ_CYCLE_PROGRAM_REMOVE, 7), 0u);
  const Bytes record = cycle_record(8);
  cycle_library_begin(&fw_.library);
  ASSERT_TRUE(
      cycle_library_append(&fw_.library, 0, record.data(), static_cast<uint32_t>(record.size())));
  EXPECT_NE(Write(kCanopen, AXIS_OBJ_CYCLE_DATA_END, static_cast<int>(record.size())), 0u);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_PROGRAM_REFUSAL), AXIS_CYCLE_PROGRAM_REFUSAL_LOCKED);
  EXPECT_EQ(fw_.library.count, 1);
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_CYCLE_PROGRAM, 7), 0u) << "a selection is no change";
}

TEST_F(Results, WithoutMemoryOnlyTheLastResultIsKept) {
  PowerUpWith(nullptr, 0);
  Load();
  EXPECT_NE(Write(kCanopen, AXIS_OBJ_CYCLE_LOCK_ON_BAD, 1), 0u) << "it could not be kept";
  Enable();
  for (int i = 1; i <= FW_RESULTS + 5; ++i) {
    ASSERT_EQ(Press(), AXIS_CYCLE_STATE_GOOD);
    EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_PART), static_cast<uint32_t>(i));
  }
  EXPECT_EQ(Waiting(), 0);
}

// A reset of the node, in the middle of a cycle too, loses no result.
TEST_F(Results, AResetOfTheNodeKeepsResults) {
  Flash flash;
  PowerUpWith(flash.memory(), FW_RESULTS);
  Load();
  Enable();
  ASSERT_EQ(Press(), AXIS_CYCLE_STATE_GOOD);
  ASSERT_TRUE(Start());
  Tick(4);
  Send(0, {0x81, kNode});
  Tick(20);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_PROGRAM), 0);
  EXPECT_EQ(Waiting(), 2);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CYCLE_RESULT_NUMBER, 2), 0u);
  EXPECT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_STATE), AXIS_CYCLE_STATE_ABORTED);
  Set(AXIS_OBJ_CYCLE_PROGRAM, 7);
  Set(AXIS_OBJ_FIRST_MOTION_TEST, AXIS_FIRST_MOTION_TEST_OFF);
  Enable();
  ASSERT_EQ(Press(), AXIS_CYCLE_STATE_GOOD);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_NUMBER), 3);
}

// Whatever ends a cycle from outside, from each source and from none, makes the part aborted; so it
// is counted, and it waits for its acknowledgement.
TEST_F(Results, EveryEndFromOutsideAbortsThePart) {
  struct End {
    std::string name;
    std::function<void()> act;
    int ticks = 3;
  };
  std::vector<End> ends{
      {"start bit", [&] { Set(AXIS_OBJ_CONTROLWORD, 0x0F); }},
      {"halt", [&] { Set(AXIS_OBJ_CONTROLWORD, 0x11F); }},
      {"another mode", [&] { Set(AXIS_OBJ_MODES_OF_OPERATION, 1); }},
      {"NMT stop",
       [&] {
         Send(0, {2, kNode});
       }},
      {"reset of communication",
       [&] {
         Send(0, {0x82, kNode});
       }},
      {"reset of the node",
       [&] {
         Send(0, {0x81, kNode});
       }},
      {"bus off", [&] { fw_can_bus(&fw_, CAN_BUS_OFF); }},
      {"enable chain", [&] { inputs_.din = 0; }},
      {"sensors", [&] { inputs_.sensor_valid = 0; }},
      {"force", [&] { inputs_.adc_code[0] = 2047; }},
      {"the same node id", [&] { Send(0x700 + kNode, {5}); }},
      {"heartbeat", [] {}, TicksOf(20) + 3},  // of the master, which falls silent
  };
  for (Way way : kWays) {
    const std::string of = " of source " + std::to_string(way);
    for (int word : {0x00, 0x02, 0x06, 0x07}) {
      ends.push_back({"controlword " + std::to_string(word) + of,
                      [=, this] { Write(way, AXIS_OBJ_CONTROLWORD, word); }});
    }
    ends.push_back(
        {"native mode" + of, [=, this] { Write(way, AXIS_OBJ_MODE, AXIS_MODE_DISABLED); }});
  }
  cycle_phase_t longer = wait_phase(CYCLE_END);
  longer.conditions[0].level = 90;
  const auto words = record_of({longer}, 7);
  const auto *bytes = reinterpret_cast<const uint8_t *>(words.data());
  const Bytes record{bytes, bytes + 4 * words.size()};
  for (const End &end : ends) {
    PowerUpWith(nullptr, FW_RESULTS);
    Load(record);
    Set(AXIS_OBJ_FORCE_MAX, 1000);
    if (end.name == "heartbeat") WatchHeartbeat(20);
    Enable();
    Send(0x77F, {5});
    ASSERT_TRUE(Start()) << end.name;
    Tick(3);
    ASSERT_EQ(Inner(AXIS_OBJ_CYCLE_STATE), AXIS_CYCLE_STATE_RUNNING) << end.name;
    end.act();
    Tick(end.ticks);
    EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_PARTS_ABORTED), 1) << end.name;
    EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_PARTS_GOOD), 0) << end.name;
    EXPECT_EQ(Waiting(), 1) << end.name;
    EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_RESULT_STATE), AXIS_CYCLE_STATE_ABORTED) << end.name;
    Tick(200);
    EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_NUMBER), 1) << end.name << ": no second part begins";
  }
  EXPECT_EQ(ends.size(), 12u + 5u * kWays.size());
}

// After a power cut the axis names the results that were lost, as far as the store knew them, and
// a locked axis stays locked.
TEST_F(Results, LostResultsAreNamed) {
  Flash flash;
  PowerUpWith(flash.memory(), FW_RESULTS);
  Load();
  Set(AXIS_OBJ_CYCLE_LOCK_ON_BAD, 1);
  Enable();
  for (int i = 0; i < 3; ++i) ASSERT_EQ(Press(), AXIS_CYCLE_STATE_GOOD);
  ASSERT_EQ(Acknowledge(kCanopen, 1), 0u);
  ASSERT_EQ(Press(AXIS_CYCLE_STATE_BAD), AXIS_CYCLE_STATE_BAD);
  Disable();
  Settle();
  Set(AXIS_OBJ_STORE_PARAMETERS, 1);
  while (Inner(AXIS_OBJ_STORE_STATE) == AXIS_STORE_STATE_SAVING) Tick();
  PowerUpWith(flash.memory(), FW_RESULTS);
  Settle();
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_LOST_FIRST), 2);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_LOST_LAST), 4);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_POWER_UP), 2);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_NUMBER), 4);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_PARTS_GOOD), 3);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_PARTS_BAD), 1);
  Set(AXIS_OBJ_CYCLE_PROGRAM, 7);
  Enable();
  EXPECT_EQ(Press(), AXIS_CYCLE_STATE_LOCKED);
  ASSERT_EQ(Acknowledge(kCanopen, 4), 0u);
  Tick();
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_LOST_FIRST), 0);
  EXPECT_EQ(Press(), AXIS_CYCLE_STATE_GOOD);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_NUMBER), 5);
}

// 1,000 power cuts at any byte that is programmed, and between: in motion, at rest, while results
// are acknowledged. A part has one identity and one verdict, what was acknowledged adds up, and
// nothing is good that was not.
TEST_F(Results, PowerCutsNeverGiveAPartTwice) {
  std::minstd_rand random(1);
  Flash flash;
  std::map<std::pair<uint32_t, uint32_t>, int> seen;  // power-up and number: verdict
  std::map<int, int> given, truth;
  int cuts = 0, unstored = 0;
  Set(AXIS_OBJ_CYCLE_PROGRAM, 0);
  for (int i = 0; i < 1000; ++i) {
    flash.PowerFor(-1, 0);
    PowerUpWith(flash.memory(), FW_RESULTS);
    if (fw_.library.count == 0) Load();
    flash.PowerFor(random() % 3 != 0 ? 1 + static_cast<int64_t>(random() % 400) : -1,
                   static_cast<uint32_t>(random()));
    Tick(static_cast<int>(random() % 40));
    Set(AXIS_OBJ_CYCLE_PROGRAM, 7);
    Enable();
    for (uint32_t parts = static_cast<uint32_t>(random() % 4); parts > 0; --parts) {
      const int wanted = AXIS_CYCLE_STATE_GOOD + static_cast<int>(random() % 3);
      const int found = Press(wanted);
      if (found == AXIS_CYCLE_STATE_NOT_STORED) {
        ++unstored;
        Disable();
        Tick(static_cast<int>(random() % 60));
        Enable();
        continue;
      }
      ASSERT_EQ(found, wanted) << i;
      const std::pair<uint32_t, uint32_t> part{Shown(AXIS_OBJ_CYCLE_RESULT_POWER_UP),
                                               Shown(AXIS_OBJ_CYCLE_RESULT_PART)};
      ASSERT_TRUE(seen.emplace(part, wanted).second)
          << i << ": " << part.first << ", " << part.second;
      ASSERT_EQ(Shown(AXIS_OBJ_CYCLE_RESULT_STATE), static_cast<uint32_t>(wanted));
      if (random() % 2 == 0) {
        ASSERT_EQ(Acknowledge(kCanopen, part.second), 0u);
        ++given[wanted];
      }
      ++truth[wanted];
    }
    if (random() % 2 == 0) {
      Disable();
      Tick(static_cast<int>(random() % 200));
    }
    if (random() % 3 == 0) {
      ASSERT_TRUE(Start() || Inner(AXIS_OBJ_CYCLE_STATE) != AXIS_CYCLE_STATE_GOOD ||
                  Inner(AXIS_OBJ_DRIVE_STATE) != AXIS_DRIVE_STATE_OPERATION_ENABLED);
      Tick(static_cast<int>(random() % 12));
    }
    ++cuts;
  }
  std::printf("%d power cuts, %zu parts, %d starts refused before the power-up was stored\n", cuts,
              seen.size(), unstored);
  EXPECT_GT(seen.size(), 800u);
  EXPECT_GT(unstored, 10);
  EXPECT_FALSE(flash.misused());
}

// The counts are stored at most every ten minutes, and at once when a lock begins.
TEST_F(Results, TheCountsAreStoredRarely) {
  Flash flash;
  PowerUpWith(flash.memory(), FW_RESULTS);
  Load();
  const auto press_and_rest = [&](int verdict) {
    Enable();
    EXPECT_EQ(Press(verdict), verdict);
    Set(AXIS_OBJ_CYCLE_ACKNOWLEDGE, Inner(AXIS_OBJ_CYCLE_NUMBER));
    Disable();
    const int64_t steps = flash.steps();
    Tick(300);
    return flash.steps() - steps;
  };
  EXPECT_EQ(press_and_rest(AXIS_CYCLE_STATE_GOOD), 0);
  EXPECT_EQ(press_and_rest(AXIS_CYCLE_STATE_BAD), 0);
  fw_.axis.signals.tick_count += 900000;
  EXPECT_GT(press_and_rest(AXIS_CYCLE_STATE_GOOD), 0);
  EXPECT_EQ(press_and_rest(AXIS_CYCLE_STATE_GOOD), 0);
  Set(AXIS_OBJ_CYCLE_BAD_IN_ROW_MAX, 1);
  EXPECT_GT(press_and_rest(AXIS_CYCLE_STATE_BAD), 0);
  PowerUpWith(flash.memory(), FW_RESULTS);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_NUMBER), 5);
  EXPECT_EQ(Inner(AXIS_OBJ_CYCLE_BAD_IN_ROW), 1) << "the lock stays over a power cut";
}

}  // namespace
