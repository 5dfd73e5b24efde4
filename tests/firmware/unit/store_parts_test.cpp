// Programs of cycles and counts of parts in the parameter store: power cuts at any byte, faults of
// the memory, and an axis that is enabled while they are written.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <map>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "tests/firmware/unit/cycle_records.hpp"
#include "tests/firmware/unit/press_fixture.hpp"

namespace {

TEST(StoreParts, ProgramsSurviveAPowerCutAndAResetOfTheNode) {
  Flash flash;
  Press axis(flash.memory());
  ASSERT_EQ(axis.Download(cycle_record(1)), FW_OK);
  ASSERT_EQ(axis.Download(cycle_record(2, 30)), FW_OK);
  axis.Tick();
  EXPECT_EQ(axis.Read(AXIS_OBJ_CYCLE_STORE_STATE), AXIS_CYCLE_STORE_STATE_WAITING);
  axis.Settle();
  EXPECT_EQ(axis.Read(AXIS_OBJ_CYCLE_STORE_STATE), AXIS_CYCLE_STORE_STATE_STORED);
  const Kept kept{{1, cycle_record(1)}, {2, cycle_record(2, 30)}};
  Press next(flash.memory());
  EXPECT_EQ(next.Programs(), kept);
  EXPECT_EQ(next.Read(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_EMPTY) << "no parameter was saved";
  EXPECT_EQ(next.Read(AXIS_OBJ_CYCLE_PROGRAM), 0);
  EXPECT_EQ(next.Write(AXIS_OBJ_CYCLE_PROGRAM_REMOVE, 1), FW_OK);
  next.Settle();
  EXPECT_EQ(Press(flash.memory()).Programs(), (Kept{{2, cycle_record(2, 30)}}));
  EXPECT_EQ(next.Write(AXIS_OBJ_CYCLE_PROGRAM_REMOVE, 2), FW_OK);
  next.Settle();
  EXPECT_EQ(Press(flash.memory()).Programs(), Kept{});
  EXPECT_FALSE(flash.misused());
}

// A library that the store cannot keep beside a parameter set is full.
TEST(StoreParts, TheLibraryHasRoomForWhatCanBeStored) {
  Flash flash;
  Press axis(flash.memory());
  const uint32_t most = store_programs_max(&axis.fw().store);
  ASSERT_LT(most, static_cast<uint32_t>(FW_PROGRAM_BYTES) - CYCLE_PROGRAM_BYTES_MAX);
  uint32_t number = 1;
  uint32_t used = 0;
  while (axis.Download(cycle_record(number, 40)) == FW_OK) {
    used += static_cast<uint32_t>(cycle_record(number++, 40).size());
  }
  EXPECT_LE(used, most);
  EXPECT_GT(used + cycle_record(1, 40).size(), most);
  EXPECT_EQ(axis.Read(AXIS_OBJ_CYCLE_PROGRAM_REFUSAL), AXIS_CYCLE_PROGRAM_REFUSAL_NO_ROOM);
  const Kept kept = axis.Programs();
  for (int save = 0; save < 5; ++save) {
    axis.Settle();
    ASSERT_EQ(axis.Write(AXIS_OBJ_SPEED_MAX, 100 + save), FW_OK);
    ASSERT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
    axis.Settle();
    ASSERT_EQ(axis.Read(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_SAVED);
    Press next(flash.memory());
    EXPECT_EQ(next.Programs(), kept);
    EXPECT_EQ(next.Read(AXIS_OBJ_SPEED_MAX), 100 + save);
    EXPECT_EQ(next.Read(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_LOADED);
  }
}

// What one step of a history does, and what may be found after it.
struct History {
  Flash flash;
  Kept programs;
  int32_t speed = 0;         // SPEED_MAX as saved, 0: nothing saved
  bool interrupted = false;  // the last save of parameters
  std::set<uint32_t> used;   // power-ups in which a cycle could start
};

// Power cuts at a random byte of random work: downloads, removals, saves, and the counts. What is
// found is the state before or after the work that was cut, and a power-up in which a cycle may
// start has a number of its own.
TEST(StoreParts, PowerCutsAtAnyByteLeaveOldOrNewProgramsAndParameters) {
  int cuts = 0, old_seen = 0, new_seen = 0;
  for (uint32_t seed = 1; seed <= (kEvery == 1 ? 60u : 8u); ++seed) {
    std::minstd_rand random(seed);
    History past;
    for (int i = 0; i < 40; ++i) {
      const std::string replay = "seed " + std::to_string(seed) + " step " + std::to_string(i);
      past.flash.PowerFor(-1, 0);
      Press axis(past.flash.memory());
      ASSERT_EQ(axis.Programs(), past.programs) << replay;
      const int32_t state = axis.Read(AXIS_OBJ_STORE_STATE);
      if (state == AXIS_STORE_STATE_LOADED_OLDER || state == AXIS_STORE_STATE_FAILED) {
        // Until the user has saved, the store erases nothing for the sake of programs.
        ASSERT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK) << replay;
        axis.Settle();
        past.speed = axis.Read(AXIS_OBJ_SPEED_MAX);
      } else if (random() % 2 == 0) {
        axis.Settle();
      }
      const Kept before = past.programs;
      Kept wanted = before;
      int32_t speed = past.speed;
      const bool is_cut = random() % 4 != 0;
      past.flash.PowerFor(is_cut ? 1 + static_cast<int64_t>(random() % 2500) : -1,
                          static_cast<uint32_t>(random()));
      const uint32_t what = static_cast<uint32_t>(random() % 8);
      const uint32_t number = 1 + static_cast<uint32_t>(random() % 4);
      bool saves = false;
      if (what < 4) {
        const Bytes record = cycle_record(number, static_cast<uint16_t>(random() % 90));
        if (axis.Download(record) == FW_OK) wanted[number] = record;
      } else if (what < 6) {
        if (axis.Write(AXIS_OBJ_CYCLE_PROGRAM_REMOVE, static_cast<int32_t>(number)) == FW_OK) {
          wanted.erase(number);
        }
      } else {
        speed = 1 + static_cast<int32_t>(random() % 1000);
        ASSERT_EQ(axis.Write(AXIS_OBJ_SPEED_MAX, speed), FW_OK) << replay;
        ASSERT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK) << replay;
        saves = true;
      }
      axis.Settle();
      ASSERT_EQ(axis.Programs(), wanted) << replay;
      if (axis.MayStart()) {
        const auto power_up = static_cast<uint32_t>(axis.Read(AXIS_OBJ_CYCLE_POWER_UP));
        EXPECT_TRUE(past.used.insert(power_up).second) << replay << " power-up " << power_up;
      }
      past.flash.PowerFor(-1, 0);
      ASSERT_FALSE(past.flash.misused()) << replay;
      Press next(past.flash.memory());
      const Kept found = next.Programs();
      ASSERT_TRUE(found == before || found == wanted) << replay;
      const int32_t loaded = next.Read(AXIS_OBJ_STORE_STATE);
      const bool has_set = loaded != AXIS_STORE_STATE_EMPTY && loaded != AXIS_STORE_STATE_FAILED;
      const int32_t found_speed = has_set ? next.Read(AXIS_OBJ_SPEED_MAX) : 0;
      ASSERT_TRUE(found_speed == past.speed || (saves && found_speed == speed))
          << replay << " state " << loaded;
      if (!is_cut) {
        ASSERT_EQ(found, wanted) << replay;
        ASSERT_EQ(found_speed, speed) << replay;
      }
      cuts += is_cut ? 1 : 0;
      (found == wanted ? new_seen : old_seen) += 1;
      past.programs = found;
      past.speed = found_speed;
    }
  }
  std::printf("%d cuts: old programs %d times, new programs %d times\n", cuts, old_seen, new_seen);
  EXPECT_GT(cuts, kEvery == 1 ? 1500 : 150);
  EXPECT_GT(old_seen, cuts / 20);
}

// A cut while programs are written is no sign that saved parameters are missing.
TEST(StoreParts, OnlyAnInterruptedSaveOfParametersIsReported) {
  Flash flash;
  {
    Press axis(flash.memory());
    ASSERT_EQ(axis.Write(AXIS_OBJ_SPEED_MAX, 77), FW_OK);
    ASSERT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
    axis.Settle();
  }
  const Bytes saved = flash.bytes();
  int reported = 0;
  int64_t steps = 100;
  for (int64_t life = 5; life < steps + 200; life += 3) {
    flash.bytes() = saved;
    flash.PowerFor(-1, 0);
    Press axis(flash.memory());
    ASSERT_EQ(axis.Download(cycle_record(1, 400)), FW_OK);
    const int64_t begin = flash.steps();
    flash.PowerFor(life, static_cast<uint32_t>(life));
    axis.Settle();
    steps = std::max(steps, flash.steps() - begin);
    flash.PowerFor(-1, 0);
    Press next(flash.memory());
    ASSERT_EQ(next.Read(AXIS_OBJ_SPEED_MAX), 77);
    reported += next.Read(AXIS_OBJ_STORE_STATE) != AXIS_STORE_STATE_LOADED ? 1 : 0;
  }
  EXPECT_GT(steps, 3000);
  EXPECT_LE(reported, 2) << "only a cut in the first word of a record cannot be told";
}

// A program can contain the bytes of a parameter set. They are never taken for one.
TEST(StoreParts, BytesOfAProgramAreNoParameterSet) {
  Bytes inner(Flash::kSector, 0xFF);
  const size_t count =
      PutSet(inner, 0, AXIS_OBJECTS_HASH32, 1000000, {EntryOf(AXIS_OBJ_SPEED_MAX, 666)});
  auto words = record_of({wait_phase(CYCLE_END)}, 1, static_cast<uint16_t>((count + 7) / 8 + 1));
  Bytes record(4 * words.size());
  std::memcpy(record.data(), words.data(), record.size());
  const size_t points = record.size() - 4 - 8 * ((count + 7) / 8 + 1);
  std::copy_n(inner.begin(), count, record.begin() + static_cast<long>(points));
  PutWord(record, record.size() - 4, Crc32(record.data(), record.size() - 4));
  Flash flash;
  for (int64_t life = 0; life < 1200; ++life) {
    std::fill(flash.bytes().begin(), flash.bytes().end(), 0xFF);
    flash.PowerFor(-1, 0);
    Press axis(flash.memory());
    ASSERT_EQ(axis.Download(record), FW_OK);
    flash.PowerFor(life, static_cast<uint32_t>(life));
    axis.Settle();
    flash.PowerFor(-1, 0);
    ASSERT_NE(Press(flash.memory()).Read(AXIS_OBJ_SPEED_MAX), 666) << life;
  }
}

// Work on programs and counts gives way to an axis that is enabled, and goes on after it.
TEST(StoreParts, AnAxisThatIsEnabledDoesNotWait) {
  std::minstd_rand random(3);
  Flash flash;
  Press axis(flash.memory());
  ASSERT_EQ(axis.Write(AXIS_OBJ_FIRST_MOTION_TEST, AXIS_FIRST_MOTION_TEST_OFF), FW_OK);
  ASSERT_EQ(axis.Write(AXIS_OBJ_MODES_OF_OPERATION, -9), FW_OK);
  Kept wanted;
  for (int i = 0; i < 200; ++i) {
    const uint32_t number = 1 + static_cast<uint32_t>(random() % 3);
    const Bytes record = cycle_record(number, static_cast<uint16_t>(random() % 120));
    ASSERT_EQ(axis.Download(record), FW_OK);
    wanted[number] = record;
    axis.Tick(static_cast<int>(random() % 120));
    for (int word : {6, 7, 15}) {
      ASSERT_EQ(axis.Write(AXIS_OBJ_CONTROLWORD, word), FW_OK) << "it is never refused";
      axis.Tick(2);
    }
    ASSERT_NE(axis.Read(AXIS_OBJ_ACTIVE_MODE), AXIS_MODE_DISABLED);
    const int64_t steps = flash.steps();
    axis.Tick(30);
    EXPECT_EQ(flash.steps(), steps) << "nothing is programmed while the axis is enabled";
    ASSERT_EQ(axis.Write(AXIS_OBJ_CONTROLWORD, 0), FW_OK);
    axis.Tick(2);
    if (random() % 3 == 0) {
      axis.Settle();
      ASSERT_EQ(Press(flash.memory()).Programs(), wanted);
    }
  }
  ASSERT_FALSE(flash.misused());
}

// Memories that fail: the programs stay usable, the state says so, and what was stored stays.
TEST(StoreParts, AMemoryThatFailsIsReported) {
  using Program = FlashFaults::Program;
  for (Program fault : {Program::kRefused, Program::kStuck, Program::kNothing, Program::kHalf}) {
    Flash flash;
    Press axis(flash.memory());
    ASSERT_EQ(axis.Download(cycle_record(1)), FW_OK);
    axis.Settle();
    flash.faults.program = fault;
    ASSERT_EQ(axis.Download(cycle_record(2, 10)), FW_OK);
    axis.Settle();
    EXPECT_EQ(axis.Read(AXIS_OBJ_CYCLE_STORE_STATE), AXIS_CYCLE_STORE_STATE_FAILED);
    EXPECT_EQ(axis.Programs().size(), 2u);
    flash.faults.program = Program::kSound;
    EXPECT_EQ(Press(flash.memory()).Programs(), (Kept{{1, cycle_record(1)}}));
    ASSERT_EQ(axis.Download(cycle_record(3)), FW_OK);
    axis.Settle();
    EXPECT_EQ(Press(flash.memory()).Programs().size(), 3u);
  }
}

// Counts of a later firmware can have another size. They are not read.
TEST(StoreParts, CountsOfAnotherSizeAreLeftOut) {
  Flash flash;
  Bytes &bytes = flash.bytes();
  const size_t set = PutRecord(bytes, 0, {RECORD_FORGOTTEN, AXIS_OBJECTS_HASH32, 1}, {});
  PutRecord(bytes, (set + 15) / 16 * 16, {RECORD_COUNTS, 0, 2}, std::vector<uint32_t>(400, 7));
  Press axis(flash.memory());
  EXPECT_EQ(axis.fw().results.stored.power_up, 0u);
  EXPECT_EQ(axis.fw().results.given_tick, 0u);
  EXPECT_EQ(axis.Read(AXIS_OBJ_CYCLE_POWER_UP), 1);
  EXPECT_EQ(axis.Read(AXIS_OBJ_CYCLE_NUMBER), 0);
}

}  // namespace
