// What decides a part stays as it is while its cycle runs: every object of the table is written in
// a running cycle, with its present value and with another one, and does what the column in_cycle
// says.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <map>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "tests/firmware/unit/cia402_fixture.hpp"
#include "tests/firmware/unit/cycle_records.hpp"

namespace {

class CycleChanges : public Drive {
 protected:
  static constexpr int kCycle = AXIS_MODES_OF_OPERATION_CYCLE;

  CycleChanges() {
    for (uint16_t bank : {0, 1, 2, 3}) {
      Set(static_cast<uint16_t>(AXIS_OBJ_BANK_GAIN_1 + bank), (5 + bank) * 256);
      Set(static_cast<uint16_t>(AXIS_OBJ_BANK_CRC_1 + bank),
          static_cast<int32_t>(law_bank_crc(&fw_.banks.params, static_cast<uint8_t>(bank))));
    }
    Set(AXIS_OBJ_FORCE_BANK, 1);
    for (const int first : {AXIS_OBJ_RPDO_COB_ID_1, AXIS_OBJ_TPDO_COB_ID_1}) {
      for (int pdo = first; pdo < first + 4; ++pdo) {
        const auto object = static_cast<uint16_t>(pdo);
        Set(object, static_cast<int32_t>(static_cast<uint32_t>(Read(object)) | 0x80000000u));
      }
    }
    for (const int first : {AXIS_OBJ_RPDO_MAPPED_1, AXIS_OBJ_TPDO_MAPPED_1}) {
      for (int pdo = first; pdo < first + 4; ++pdo) Set(static_cast<uint16_t>(pdo), 0);
    }
  }

  bool Select(std::vector<std::uint32_t> record) {
    const cycle_check_t check = fw_select_program(
        &fw_, record.data(), static_cast<std::uint32_t>(record.size() * sizeof(record[0])));
    if (check.reason == CYCLE_ACCEPTED) record_ = std::move(record);
    return check.reason == CYCLE_ACCEPTED;
  }
  int Cycle() { return Read(AXIS_OBJ_CYCLE_STATE); }
  int Outcome() { return Read(AXIS_OBJ_CYCLE_OUTCOME); }
  bool Runs() const { return cycle_is_running(&fw_.drive.cycle); }

  // Writes that stop the axis, or after which nobody would notice the loss of its owner; their own
  // rules end a cycle as aborted.
  static bool Stops(uint16_t object) {
    return object == AXIS_OBJ_MODE || object == AXIS_OBJ_CONTROLWORD ||
           object == AXIS_OBJ_MODES_OF_OPERATION || object == AXIS_OBJ_UNSUPERVISED_OWNER;
  }
  static bool HasValue(uint16_t object) {
    return axis_objects[object].access == AXIS_ACCESS_RW &&
           axis_objects[object].block != AXIS_BLOCK_NONE;
  }

  // Another value than the present one that `like`, an enabled axis without a cycle, accepts.
  static std::optional<int32_t> Other(const fw_t &like, uint16_t object) {
    const axis_object_t &entry = axis_objects[object];
    int32_t present = 0;
    if (HasValue(object)) (void)fw_object_read(&like, object, &present);
    const auto up = static_cast<int32_t>(static_cast<uint32_t>(present) + 1);
    const auto down = static_cast<int32_t>(static_cast<uint32_t>(present) - 1);
    // also an object for the recorder, one for a PDO, and a COB-ID that is not valid
    const auto cob_id = static_cast<int32_t>(0x80000181);
    for (const int32_t value : {up, down, entry.min, entry.max, 0x606400, 0x60400010, cob_id}) {
      if (HasValue(object) && value == present) continue;
      fw_t copy = like;
      if (fw_object_write(&copy, FW_SOURCE_LOCAL, object, value) == FW_OK) return value;
    }
    return std::nullopt;
  }

  std::vector<std::uint32_t> record_;
};

TEST_F(CycleChanges, EveryObjectOfTheTableDoesWhatItsColumnSays) {
  cycle_phase_t hold = wait_phase(CYCLE_END);
  hold.time_max = 1000;
  hold.conditions[0].level = 20;
  ASSERT_TRUE(Select(record_of({hold})));
  Enable(kCycle);
  const fw_t enabled = fw_;
  Control(kNew);
  Tick(5);
  ASSERT_TRUE(Runs());
  const fw_t running = fw_;
  std::map<int, int> tried;
  std::vector<uint16_t> untried;
  for (uint16_t object = 1; object < AXIS_OBJ_COUNT; ++object) {
    const axis_object_t &entry = axis_objects[object];
    if (entry.access == AXIS_ACCESS_RO) continue;
    fw_ = running;
    if (HasValue(object)) {
      // A frame that repeats the present value changes nothing, also for what is refused.
      const int32_t present = Read(object);
      fw_t copy = enabled;
      const int as_enabled = fw_object_write(&copy, FW_SOURCE_LOCAL, object, present);
      if (object != AXIS_OBJ_CYCLE_CURVE_FIRST && object != AXIS_OBJ_CYCLE_PROGRAM &&
          object != AXIS_OBJ_CONTROLWORD) {
        EXPECT_EQ(Write(object, present), as_enabled) << object;
        EXPECT_TRUE(Runs() || object == AXIS_OBJ_MODE) << object;
      }
      fw_ = running;
    }
    if (Stops(object)) continue;
    if (entry.writable == AXIS_WRITABLE_DISABLED) {
      EXPECT_EQ(Write(object, entry.max), FW_ERROR_STATE) << object;
      EXPECT_TRUE(Runs()) << object;
      continue;
    }
    const std::optional<int32_t> other = Other(enabled, object);
    if (!other.has_value()) {
      untried.push_back(object);
      continue;
    }
    ++tried[entry.in_cycle];
    const int32_t before = HasValue(object) ? Read(object) : 0;
    const int answer = Write(object, *other);
    EXPECT_EQ(answer, entry.in_cycle == AXIS_IN_CYCLE_REFUSED ? FW_ERROR_STATE : FW_OK) << object;
    if (entry.in_cycle == AXIS_IN_CYCLE_REFUSED && HasValue(object)) {
      EXPECT_EQ(Read(object), before) << object;
    }
    EXPECT_EQ(Runs(), entry.in_cycle != AXIS_IN_CYCLE_ENDS) << object;
    Tick(30);
    EXPECT_EQ(Cycle(),
              entry.in_cycle == AXIS_IN_CYCLE_ENDS ? AXIS_CYCLE_STATE_BAD : AXIS_CYCLE_STATE_GOOD)
        << object;
    EXPECT_EQ(Outcome(),
              entry.in_cycle == AXIS_IN_CYCLE_ENDS ? CYCLE_CHANGED : int{CYCLE_BY_PROGRAM})
        << object;
  }
  // The values of the selected bank, and what needs memory or a part that this axis does not have.
  for (const uint16_t object : untried) std::printf("%d ", object);
  std::printf("are not tried\n");
  EXPECT_LE(untried.size(), 20u + 16u);
  EXPECT_GT(tried[AXIS_IN_CYCLE_FREE], 200);
  EXPECT_GT(tried[AXIS_IN_CYCLE_ENDS], 30);
  EXPECT_GT(tried[AXIS_IN_CYCLE_REFUSED], 80);
}

// Some of the table, by the words of the manual: what the readings mean and the law are refused;
// bounds act and end the part; what reads results, and what stops, is free.
TEST_F(CycleChanges, TheColumnJudgesByTheMeaning) {
  for (const uint16_t object : std::initializer_list<uint16_t>{
           AXIS_OBJ_FORCE_BANK, AXIS_OBJ_FORCE_TARE, AXIS_OBJ_FORCE_GAIN, AXIS_OBJ_POSITION_GAIN,
           AXIS_OBJ_VELOCITY_GAIN, AXIS_OBJ_CONTACT_FORCE, AXIS_OBJ_POSITION_WINDOW,
           AXIS_OBJ_HOME_OFFSET, AXIS_OBJ_BANK_COEFFICIENT_60, AXIS_OBJ_CYCLE_PROGRAM}) {
    EXPECT_EQ(axis_objects[object].in_cycle, AXIS_IN_CYCLE_REFUSED) << object;
  }
  for (const uint16_t object : std::initializer_list<uint16_t>{
           AXIS_OBJ_FORCE_LIMIT, AXIS_OBJ_FORCE_LIMIT_POSITIVE, AXIS_OBJ_FORCE_LIMIT_NEGATIVE,
           AXIS_OBJ_FORCE_MAX, AXIS_OBJ_SPEED_MAX, AXIS_OBJ_VELOCITY_MAX, AXIS_OBJ_OUTPUT_LIMIT,
           AXIS_OBJ_POSITION_MIN, AXIS_OBJ_POSITION_LIMIT_MAX, AXIS_OBJ_UNCERTIFIED_FORCE,
           AXIS_OBJ_CONTACT_TRAVEL_MAX, AXIS_OBJ_FORCE_STUCK_TIME,
           AXIS_OBJ_APPROACH_VELOCITY_MAX}) {
    EXPECT_EQ(axis_objects[object].in_cycle, AXIS_IN_CYCLE_ENDS) << object;
  }
  for (const uint16_t object : std::initializer_list<uint16_t>{
           AXIS_OBJ_MODE, AXIS_OBJ_CONTROLWORD, AXIS_OBJ_MODES_OF_OPERATION, AXIS_OBJ_TARGET_FORCE,
           AXIS_OBJ_CYCLE_ACKNOWLEDGE, AXIS_OBJ_CYCLE_RESULT_NUMBER, AXIS_OBJ_CYCLE_SERIAL_1,
           AXIS_OBJ_COMMAND_SOURCE, AXIS_OBJ_RECORDER_ARM, AXIS_OBJ_CONSUMER_HEARTBEAT_1}) {
    EXPECT_EQ(axis_objects[object].in_cycle, AXIS_IN_CYCLE_FREE) << object;
  }
}

// Random programs, and random writes of the owner in a third of their ticks: a part is good only if
// each value that decides it is at its end as it was at its start.
TEST_F(CycleChanges, NoPartIsGoodWhoseDecidingValuesChanged) {
  std::mt19937 random(1977);
  const auto one_in = [&](unsigned n) { return random() % n == 0; };
  std::vector<uint16_t> all;
  for (uint16_t object = 1; object < AXIS_OBJ_COUNT; ++object) {
    if (HasValue(object) && axis_objects[object].writable != AXIS_WRITABLE_DISABLED &&
        !Stops(object) && object != AXIS_OBJ_CYCLE_PROGRAM && object != AXIS_OBJ_COMMAND_SOURCE) {
      all.push_back(object);
    }
  }
  Set(AXIS_OBJ_TARE_BAND, 8 * 256);
  const fw_t fresh = fw_;
  const auto deciding = [&] {
    std::map<uint16_t, int32_t> values;
    for (const uint16_t object : all) {
      if (axis_objects[object].in_cycle != AXIS_IN_CYCLE_FREE) values[object] = Read(object);
    }
    return values;
  };
  std::map<int, int> answers, ends;
  int good = 0, in_contact = 0, ticks = 0;
  for (int part = 0; part < 1500; ++part) {
    fw_ = fresh;
    wall_ = place_ + static_cast<int>(random() % 40) - 10;
    inputs_.encoder_cnt = static_cast<int32_t>(place_);
    if (!Select(random_record(random, static_cast<int32_t>(place_)))) continue;
    Enable(kCycle);
    Set(AXIS_OBJ_COMMAND_SOURCE, AXIS_COMMAND_SOURCE_CANOPEN);
    const fw_t enabled = fw_;
    Control(kNew);
    const std::map<uint16_t, int32_t> before = deciding();
    const bool writes = one_in(2);
    bool ended = false;
    for (int tick = 0; tick < 300 && Runs(); ++tick) {
      if (writes && one_in(3)) {
        const uint16_t object = all[random() % all.size()];
        const axis_object_t &entry = axis_objects[object];
        const int32_t present = Read(object);
        const std::optional<int32_t> other = one_in(2) ? std::nullopt : Other(enabled, object);
        const int32_t value = other.value_or(present);
        const bool refused = entry.in_cycle == AXIS_IN_CYCLE_REFUSED && value != present;
        const int answer = fw_object_write(&fw_, FW_SOURCE_CANOPEN, object, value);
        if (refused) {
          ASSERT_EQ(answer, FW_ERROR_STATE) << object;
        }
        ended =
            ended || (answer == FW_OK && entry.in_cycle == AXIS_IN_CYCLE_ENDS && value != present);
        ASSERT_EQ(Runs(), !ended) << object;
        ++answers[answer];
      }
      if (!Runs()) break;
      Tick();
      ++ticks;
      in_contact += fw_.drive.signals.contact;
    }
    if (Runs()) Control(kOperate);
    Tick(2);
    ++ends[Outcome()];
    if (ended) {
      ASSERT_NE(Cycle(), AXIS_CYCLE_STATE_GOOD) << part;
      ASSERT_NE(Outcome(), CYCLE_BY_PROGRAM) << part;
    }
    if (Cycle() != AXIS_CYCLE_STATE_GOOD) continue;
    ++good;
    ASSERT_EQ(deciding(), before) << part;
  }
  std::printf("%d ticks, %d in contact, %d parts good, %d by a change\n", ticks, in_contact, good,
              ends[CYCLE_CHANGED]);
  EXPECT_GT(good, 30);
  EXPECT_GT(ends[CYCLE_CHANGED], 100);
  EXPECT_GT(answers[FW_ERROR_STATE], 300);
  EXPECT_GT(answers[FW_OK], 1000);
  EXPECT_GT(in_contact, ticks / 5);
}

// The native paths that change what decides a part. In contact a gain that is cut ends the part,
// and no program that is made for a bank starts with the gain of another law.
TEST_F(CycleChanges, AGainThatTheGuardCutsEndsThePart) {
  Set(AXIS_OBJ_CONTACT_UNSTABLE_OPTION, AXIS_CONTACT_UNSTABLE_OPTION_HALVE_GAIN);
  cycle_phase_t hold = wait_phase(CYCLE_END);
  hold.time_max = 100000;
  hold.conditions[0].level = 100000;
  cycle_header_t header{};
  header.bank_crc = static_cast<uint32_t>(Read(AXIS_OBJ_BANK_CRC_1));
  ASSERT_TRUE(Select(completed(header, {hold})));
  Enable(kCycle);
  Control(kNew);
  Tick(5);
  ASSERT_TRUE(Runs());
  EXPECT_EQ(fw_.drive.cycle_bank_crc, header.bank_crc);
  fw_.drive.guards.contact_guard.finding = AXIS_FAULT_CONTACT_UNSTABLE;
  Tick(2);
  EXPECT_EQ(Read(AXIS_OBJ_GAIN_HALVINGS), 1);
  EXPECT_EQ(Cycle(), AXIS_CYCLE_STATE_BAD);
  EXPECT_EQ(Outcome(), CYCLE_CHANGED);
  Control(kOperate);
  Control(kNew);
  EXPECT_EQ(Cycle(), AXIS_CYCLE_STATE_OTHER_BANK);
  Control(0);  // which restores the gain
  Tick(2);
  Enable(kCycle);
  Control(kNew);
  EXPECT_EQ(Cycle(), AXIS_CYCLE_STATE_RUNNING);
}

TEST_F(CycleChanges, TheTareMeasurementThatEndsInACycleIsRefused) {
  cycle_phase_t hold = wait_phase(CYCLE_END);
  hold.conditions[0].level = 90;
  ASSERT_TRUE(Select(record_of({hold})));
  offset_ = 3;
  Tick(2);
  Set(AXIS_OBJ_TARE, 1);
  Tick(2);
  Enable(kCycle);
  Control(kNew);
  Tick(60);
  ASSERT_TRUE(Runs());
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_TARE), 0);
  EXPECT_EQ(Read(AXIS_OBJ_TARE_STATE), AXIS_TARE_STATE_REFUSED_ENABLED);
}

// A start edge under a halt, and a start that is withdrawn before a tick, begin no cycle: nothing
// moves, no output switches, and no part is counted.
TEST_F(CycleChanges, AStartUnderAHaltOrWithdrawnBeforeATickIsNoPart) {
  cycle_phase_t first = wait_phase(CYCLE_END);
  first.outputs_on = 5;
  first.conditions[0].level = 90;
  cycle_header_t header{};
  header.outputs_keep = 4;
  ASSERT_TRUE(Select(completed(header, {first})));
  Enable(kCycle);
  const std::vector<std::pair<uint16_t, int32_t>> writes[] = {
      {{AXIS_OBJ_CONTROLWORD, kNew | kHalt}},
      {{AXIS_OBJ_CONTROLWORD, kNew}, {AXIS_OBJ_CONTROLWORD, kNew | kHalt}},
      {{AXIS_OBJ_CONTROLWORD, kOperate | kHalt}, {AXIS_OBJ_CONTROLWORD, kNew | kHalt}},
      {{AXIS_OBJ_CONTROLWORD, kNew}, {AXIS_OBJ_CONTROLWORD, kOperate}},
      {{AXIS_OBJ_CONTROLWORD, kNew}, {AXIS_OBJ_CONTROLWORD, 0x17}},
      {{AXIS_OBJ_CONTROLWORD, kNew}, {AXIS_OBJ_CONTROLWORD, 0x12}},
      {{AXIS_OBJ_CONTROLWORD, kNew}, {AXIS_OBJ_MODE, AXIS_MODE_DISABLED}},
      {{AXIS_OBJ_CONTROLWORD, kNew}, {AXIS_OBJ_MODES_OF_OPERATION, kPp}}};
  int number = 0;
  for (const auto &all : writes) {
    for (const int word : {0x80, 0x06, 0x07, 0x0F}) Control(word);
    Set(AXIS_OBJ_MODES_OF_OPERATION, kCycle);
    Tick(20);
    ASSERT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED) << number;
    for (const auto &[object, value] : all) Set(object, value);
    for (int i = 0; i < 5; ++i) {
      Tick();
      ASSERT_EQ(outputs_.digital, 0) << number << ' ' << i;
      ASSERT_FALSE(Runs()) << number;
    }
    EXPECT_EQ(Read(AXIS_OBJ_CYCLE_COUNT), 0) << number;
    const bool is_refused = all.size() == 1 || all[0].second == (kOperate | kHalt);
    EXPECT_EQ(Cycle(), is_refused ? AXIS_CYCLE_STATE_HALTED : int{AXIS_CYCLE_STATE_IDLE}) << number;
    ++number;
  }
  // After the halt a new edge is needed.
  for (const int word : {0x80, 0x06, 0x07, 0x0F}) Control(word);
  Set(AXIS_OBJ_MODES_OF_OPERATION, kCycle);
  Tick(20);
  Control(kNew | kHalt);
  Control(kNew);
  Tick(3);
  EXPECT_FALSE(Runs());
  Control(kOperate);
  Control(kNew);
  Tick();
  EXPECT_TRUE(Runs());
  EXPECT_EQ(Read(AXIS_OBJ_CYCLE_COUNT), 1);
  // A tick that ends with a fault is one of the cycle, because its outputs were on.
  Control(kOperate);
  Tick(2);
  Control(kNew);
  inputs_.din = 0;
  Tick(2);
  EXPECT_EQ(Read(AXIS_OBJ_CYCLE_COUNT), 2);
  EXPECT_EQ(Cycle(), AXIS_CYCLE_STATE_ABORTED);
}

// Bounds that are reduced while the demand follows a ramp. The workpiece begins at 100 counts, and
// 1000 per mille are 100 counts of force.
class ReducedBounds : public CycleChanges {
 protected:
  // Presses with 800 per mille in a mode of the drive, then with a slope of 1 per mille a second.
  void Press(int mode, bool shaped) {
    PowerUp();
    Set(AXIS_OBJ_BANK_GAIN_1, 5 * 256);
    Set(AXIS_OBJ_BANK_CRC_1, static_cast<int32_t>(law_bank_crc(&fw_.banks.params, 0)));
    Set(AXIS_OBJ_UNCERTIFIED_FORCE, 150);
    Set(AXIS_OBJ_RATED_FORCE, 100000);
    Set(AXIS_OBJ_FORCE_SCALE, 1000000);
    if (shaped) {
      Set(AXIS_OBJ_FORCE_SHAPER_IMPULSES, 2);
      Set(AXIS_OBJ_FORCE_SHAPER_AMPLITUDE_1, 32768);
      Set(AXIS_OBJ_FORCE_SHAPER_AMPLITUDE_2, 32768);
      Set(AXIS_OBJ_FORCE_SHAPER_DELAY_2, 60);
      ASSERT_EQ(Read(AXIS_OBJ_FORCE_SHAPER_STATE), AXIS_FORCE_SHAPER_STATE_VALID);
    }
    stuck_ = true;
    wall_ = -160;  // a reading of 80 counts, whatever the axis does
    Set(AXIS_OBJ_FORCE_SLOPE, 100000);
    Enable(mode);
    Set(AXIS_OBJ_TARGET_FORCE, 800);
    Set(AXIS_OBJ_FORCE_SETPOINT, 80 * 256);
    Tick(300);
    Set(AXIS_OBJ_FORCE_SLOPE, 1);
  }
};

TEST_F(ReducedBounds, OfTheForceActInTheNextTick) {
  const struct {
    uint16_t object;
    int value;
    double bound;  // per mille
  } cases[] = {{AXIS_OBJ_FORCE_LIMIT, 200, 200},
               {AXIS_OBJ_FORCE_LIMIT_POSITIVE, 300, 300},
               {AXIS_OBJ_FORCE_BANK, 1, 150},
               {AXIS_OBJ_CERTIFICATE_REQUIRED, 1, 150}};
  for (const bool shaped : {false, true}) {
    for (const int mode : {kTq, kCst}) {
      for (const auto &c : cases) {
        Press(mode, shaped);
        ASSERT_EQ(fw_.drive.force_demand_q16, 800 * 65536);
        Set(c.object, c.value);
        for (int i = 0; i < 100; ++i) {
          Tick();
          ASSERT_LE(fw_.drive.force_demand_q16 / 65536.0, c.bound) << c.object << ' ' << i;
          ASSERT_LE(fw_.drive.force_ramp_q16 / 65536.0, c.bound) << c.object << ' ' << i;
        }
        EXPECT_EQ(fw_.drive.force_demand_q16 / 65536.0, c.bound) << c.object;
        EXPECT_TRUE(Status() & kLimit);
      }
    }
    // Mode -1 has the bound of a law without a certificate alone.
    Press(-1, shaped);
    Set(AXIS_OBJ_CERTIFICATE_REQUIRED, 1);
    for (int i = 0; i < 100; ++i) {
      // The set-point that the law gets in the tick, which the drive restores after it.
      fw_t copy = fw_;
      cia402_before(&copy.drive, &copy.axis);
      ASSERT_LE(copy.axis.params.force_setpoint, 15 * 256) << shaped << ' ' << i;
      Tick();
    }
  }
}

TEST_F(ReducedBounds, OfTheSpeedAreReachedWithTheDeceleration) {
  PowerUp();
  Set(AXIS_OBJ_TRAJECTORY_DECELERATION, 225000);  // 0.1 count/tick^2
  EnableAtSpeed();
  ASSERT_NEAR(Speed(), 10.0, 1e-3);
  Set(AXIS_OBJ_VELOCITY_MAX, 3000);  // 2 counts a tick
  for (int i = 1; i <= 100; ++i) {
    Tick();
    ASSERT_LE(Speed(), std::max(2.0, 10.0 - 0.1 * i) + 1e-3) << i;
  }
  EXPECT_NEAR(Speed(), 2.0, 1e-3);
}

TEST_F(ReducedBounds, OfThePositionEndTheMotionWithinThem) {
  PowerUp();
  Set(AXIS_OBJ_TRAJECTORY_ACCELERATION, 225000);
  Set(AXIS_OBJ_TRAJECTORY_DECELERATION, 225000);
  Set(AXIS_OBJ_TRAJECTORY_VELOCITY, 3000);
  Enable(kPp);
  MoveTo(2000);
  Tick(300);
  ASSERT_GT(Demand(), 400);
  ASSERT_LT(Demand(), 700);
  Set(AXIS_OBJ_POSITION_LIMIT_MAX, 700);
  Tick();
  EXPECT_TRUE(Status() & kLimit);
  for (int i = 0; i < 400; ++i) {
    Tick();
    ASSERT_LE(Demand(), 700) << i;
  }
  EXPECT_EQ(Demand(), 700);
}

TEST_F(ReducedBounds, OfTheOutputActInTheNextTick) {
  PowerUp();
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Set(AXIS_OBJ_OPEN_LOOP_CODE, 800);
  Enable(-2);
  Tick(3);
  ASSERT_EQ(outputs_.dac_code, 800);
  Set(AXIS_OBJ_OUTPUT_LIMIT, 200);
  Tick();
  EXPECT_EQ(outputs_.dac_code, 200);
}

}  // namespace
