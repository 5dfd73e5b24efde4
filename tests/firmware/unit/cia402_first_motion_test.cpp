// The test before the first motion: when it is run again, what counts as a stand, the watch that
// follows it, and which modes need a position gain. tests/loop has the simulated plants.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <string>
#include <utility>

#include "tests/firmware/unit/cia402_fixture.hpp"

namespace {

// The axis moves by its code, and reads what the test says. A signed force reading, 128 is no
// force.
class FirstMotion : public Drive {
 protected:
  static constexpr int kNoForce = 128, kPulls = 118, kPresses = 138;
  static constexpr int kOpenLoop = -2;

  void SetUp() override { Begin(); }

  void Begin() {
    PowerUp();
    Set(AXIS_OBJ_FIRST_MOTION_TEST, 1);
    Set(AXIS_OBJ_FORCE_ZERO_CODE, kNoForce);
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    force_ = kNoForce;
    current_ = 0;
    speed_ = 0.0;
  }

  void Step(int ticks = 1) {
    for (int i = 0; i < ticks; ++i) {
      inputs_.encoder_cnt = static_cast<int32_t>(std::floor(place_ + 0.5));
      inputs_.adc_code[0] = static_cast<uint16_t>(force_);
      inputs_.adc_code[1] = static_cast<uint16_t>(current_);
      fw_tick(&fw_, &inputs_, &outputs_);
      if (outputs_.amp_enable != 0) {
        speed_ = counts_per_code_ * outputs_.dac_code;
      } else {
        speed_ *= rolls_;
      }
      place_ += speed_;
    }
  }

  void Enabling(int mode = kOpenLoop) {
    Set(AXIS_OBJ_MODES_OF_OPERATION, mode);
    Step();
    Control(0x06);
    Control(0x0F);
  }

  int Result() const { return Read(AXIS_OBJ_FIRST_MOTION_RESULT); }
  int Fault() const { return Read(AXIS_OBJ_FAULT); }
  bool IsOff() const { return outputs_.amp_enable == 0 && outputs_.dac_code == 0; }

  // Ticks that the test took.
  int Run() {
    int ticks = 0;
    for (; Result() == AXIS_FIRST_MOTION_RESULT_RUNNING && ticks < 4500; ++ticks) Step();
    return ticks;
  }

  void Pass(int mode = kOpenLoop) {
    Enabling(mode);
    (void)Run();
    ASSERT_EQ(Result(), AXIS_FIRST_MOTION_RESULT_PASSED);
    ASSERT_EQ(outputs_.amp_enable, 1);
  }

  // Ticks from the enabling until the amplifier is on: the stand. After `at` of them the reading or
  // the current changes. 0: it never is.
  int TicksOfStanding(int &input, int at, int change) {
    for (int ticks = 1; ticks < 1600; ++ticks) {
      if (ticks == at) input += change;
      Step();
      if (outputs_.amp_enable != 0) return ticks;
    }
    return 0;
  }

  int force_ = kNoForce, current_ = 0;
  double rolls_ = 0.0;  // share of its speed that a disabled axis keeps in a tick
  double speed_ = 0.0;  // counts per tick
};

TEST_F(FirstMotion, IsRunAgainAfterEachChangeOfWhatTheReadingsMean) {
  const struct {
    uint16_t object;
    int other;
  } cases[] = {{AXIS_OBJ_FIRST_MOTION_TEST, 0},
               {AXIS_OBJ_FORCE_SIGN, -1},
               {AXIS_OBJ_FORCE_ZERO_CODE, 100},
               {AXIS_OBJ_ADC_BITS, 12}};
  for (const auto &c : cases) {
    Begin();
    Pass();
    Control(0);
    Step();
    Set(AXIS_OBJ_CONTACT_FORCE, 513);
    Set(c.object, Read(c.object));
    EXPECT_EQ(Result(), AXIS_FIRST_MOTION_RESULT_PASSED) << c.object << ": the same value";
    Set(c.object, c.other);
    EXPECT_EQ(Result(), AXIS_FIRST_MOTION_RESULT_NOT_RUN) << c.object;
    Set(AXIS_OBJ_FIRST_MOTION_TEST, 1);
    Enabling();
    EXPECT_EQ(Result(), AXIS_FIRST_MOTION_RESULT_RUNNING) << c.object;
  }
}

// Halts and disabling in the middle of the motion begin the test again, but not its travel: eight
// times first_motion_counts, and what the axis moves in one tick, is the most of all attempts
// together.
TEST_F(FirstMotion, AttemptsThatAreStoppedHaveOneTravelTogether) {
  for (const bool halts : {true, false}) {
    Begin();
    const int counts = Read(AXIS_OBJ_FIRST_MOTION_COUNTS);
    const double start = place_;
    Enabling();
    double farthest = 0.0;
    int attempts = 0;
    for (; attempts < 300 && Fault() == AXIS_FAULT_NONE; ++attempts) {
      const double begin = place_;
      for (int i = 0; i < 3000 && Fault() == AXIS_FAULT_NONE; ++i) {
        Step();
        farthest = std::max(farthest, std::abs(place_ - start));
        if (std::abs(place_ - begin) > counts - 3) break;
      }
      Control(halts ? 0x10F : 0x06);
      Step(3);
      Control(0x0F);
    }
    EXPECT_EQ(Fault(), AXIS_FAULT_RUNAWAY) << halts;
    EXPECT_EQ(Result(), AXIS_FIRST_MOTION_RESULT_RUNAWAY);
    EXPECT_GT(attempts, 8);
    EXPECT_LT(attempts, 12);
    EXPECT_LE(farthest, 8 * counts + attempts) << halts;  // a tick of each, below a count
    // After the fault it begins at its new place, and passes.
    Control(0x80);
    Step();
    Control(0);
    Pass();
  }
}

// An axis that rolls on after each stop, some 10 or 20 counts. All of it is travel of the test, but
// for what follows the last two stops, and what an axis that stands may move. However the attempts
// are stopped and begun again: before it stands or long after, and with the test chosen anew.
TEST_F(FirstMotion, AnAxisThatRollsOnAfterEachStopHasTheSameTravel) {
  enum Stop { kHalts, kDisables, kStrikes, kChoosesAnew };
  for (const Stop stop : {kHalts, kDisables, kStrikes, kChoosesAnew}) {
    for (const double rolls : {0.97, 0.985}) {
      for (const int rest : {3, 40, 1200}) {
        Begin();
        rolls_ = rolls;
        const int counts = Read(AXIS_OBJ_FIRST_MOTION_COUNTS);
        const double start = place_;
        const auto way = [&] { return std::abs(place_ - start); };
        Enabling();
        double most = 0.0;  // of the travel when an attempt is stopped
        double last = 0.0;  // what follows a stop
        int attempts = 0;
        for (; attempts < 100 && Fault() == AXIS_FAULT_NONE; ++attempts) {
          const double begin = place_;
          for (int i = 0; i < 5000 && Fault() == AXIS_FAULT_NONE; ++i) {
            Step();
            if (outputs_.amp_enable != 0 && std::abs(place_ - begin) > 4) break;
          }
          most = std::max(most, way());
          if (Fault() != AXIS_FAULT_NONE) break;
          last = std::max(last, std::abs(speed_) / (1 - rolls));
          if (stop == kStrikes) {
            cia402_owner_lost(&fw_.drive, &fw_.axis, AXIS_FAULT_SOURCE_LOST);
            Step(rest);
            Control(0x80);
            Step();
            Control(0x06);
          } else {
            Control(stop == kHalts ? 0x10F : 0x06);
            Step(rest);
          }
          if (stop == kChoosesAnew) {
            Set(AXIS_OBJ_FIRST_MOTION_TEST, 0);
            Set(AXIS_OBJ_FIRST_MOTION_TEST, 1);
          }
          Control(0x0F);
        }
        const std::string name = std::to_string(stop) + ", rolls " + std::to_string(rolls) +
                                 ", rest " + std::to_string(rest);
        EXPECT_EQ(Fault(), AXIS_FAULT_RUNAWAY) << name;
        EXPECT_EQ(Result(), AXIS_FIRST_MOTION_RESULT_RUNAWAY) << name;
        EXPECT_GT(last, 5) << name << ": it rolls on";
        EXPECT_LE(most, 8 * counts + last + FIRST_MOTION_JITTER_CNT * attempts)
            << name << ", attempts " << attempts;
        EXPECT_GT(most, 4 * counts) << name << ", attempts " << attempts;
      }
    }
  }
}

// What a hand moves once a disabled axis has stood is no travel of the test.
TEST_F(FirstMotion, AnAxisThatStoodMayBePushed) {
  Enabling();
  for (int i = 0; i < 3000 && Read(AXIS_OBJ_FIRST_MOTION_MOVED) == 0; ++i) Step();
  Control(0x06);
  Step(70);
  place_ += 500;
  Step(70);
  Pass();
}

// What the code for the board moves by itself is no travel of the test.
TEST_F(FirstMotion, AMotionByTheBoardsCodeBeginsTheTravelAnew) {
  Enabling();
  for (int i = 0; i < 3000 && Read(AXIS_OBJ_FIRST_MOTION_MOVED) == 0; ++i) Step();
  Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  Set(AXIS_OBJ_OPEN_LOOP_CODE, 200);
  Step(200);
  ASSERT_GT(place_, 400);
  Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
  Step(5);
  Pass();
}

// contact_force is two counts. A reading that has moved by more, up or down, is no stand; it is one
// from there on.
TEST_F(FirstMotion, AReadingThatMovesByMoreThanContactForceBeginsTheStandAnew) {
  Enabling();
  const int undisturbed = TicksOfStanding(force_, 0, 0);
  ASSERT_GT(undisturbed, 60);
  for (const int change : {2, -2, 3, -3}) {
    Begin();
    Enabling();
    const int expected = undisturbed + (std::abs(change) > 2 ? 31 : 0);
    EXPECT_EQ(TicksOfStanding(force_, 32, change), expected) << change;
  }
}

// Neither does one that creeps, a count in ten ticks, ever stand.
TEST_F(FirstMotion, AReadingThatCreepsIsASensorThatFailed) {
  for (const int step : {1, -1}) {
    Begin();
    force_ = step > 0 ? 20 : 240;
    Enabling();
    for (int ticks = 0; ticks < 1600 && Fault() == 0; ++ticks) {
      if (ticks % 10 == 9) force_ += step;
      Step();
    }
    EXPECT_EQ(Fault(), AXIS_FAULT_FORCE_SENSOR_FAILED) << step;
  }
}

// A quarter of the range, 1024 of 4096 codes, is no jump, whatever the current was at first; the
// next per mille, 5 codes more, is.
TEST_F(FirstMotion, ACurrentJumpsByMoreThanAQuarterOfItsRange) {
  for (const int at_first : {0, 1640, 3000}) {
    for (const int jump : {1024, -1024, 1030, -1030}) {
      if (at_first + jump < 0 || at_first + jump > 4094) continue;
      Begin();
      Set(AXIS_OBJ_ADC_BITS, 12);
      force_ = kNoForce << 4;
      Set(AXIS_OBJ_FORCE_ZERO_CODE, force_);
      current_ = at_first;
      Enabling();
      const bool stands = TicksOfStanding(current_, 32, jump) > 0;
      EXPECT_EQ(stands, std::abs(jump) == 1024) << at_first << ' ' << jump;
      EXPECT_EQ(Fault(), stands ? 0 : AXIS_FAULT_CURRENT_SENSOR_FAILED) << at_first << ' ' << jump;
    }
  }
}

// Until the first contact, a reading below -contact_force while the axis moves toward the workpiece
// is force_reversed, off in its own tick; at one count a tick already.
TEST_F(FirstMotion, TheWatchNamesAReversedForceInItsTick) {
  Pass();
  Set(AXIS_OBJ_OPEN_LOOP_CODE, 50);
  Step(100);  // free: no contact, and the watch goes on
  force_ = kPulls;
  Step();
  EXPECT_EQ(Fault(), AXIS_FAULT_FORCE_REVERSED);
  EXPECT_TRUE(IsOff());
}

TEST_F(FirstMotion, TheWatchJudgesOnlyMotionTowardTheWorkpiece) {
  for (const int code : {0, -50}) {
    Begin();
    Pass();
    Set(AXIS_OBJ_OPEN_LOOP_CODE, code);
    Step(3);
    force_ = kPulls;
    Step(50);
    EXPECT_EQ(Fault(), 0) << code;
    force_ = kNoForce;
    Set(AXIS_OBJ_OPEN_LOOP_CODE, 50);
    Step(3);
    force_ = kPulls;
    Step();
    EXPECT_EQ(Fault(), AXIS_FAULT_FORCE_REVERSED) << "it still watches, code " << code;
  }
}

// An axis that is disabled may be pushed by hand.
TEST_F(FirstMotion, TheWatchRestsWhileTheAxisIsDisabled) {
  Pass();
  Control(0);
  Step(2);
  force_ = kPulls;
  for (int i = 0; i < 50; ++i) {
    place_ += 1;
    Step();
    ASSERT_EQ(Fault(), 0) << i;
  }
  force_ = kNoForce;
  Step();
  Enabling();
  Set(AXIS_OBJ_OPEN_LOOP_CODE, 50);
  Step(3);
  force_ = kPulls;
  Step();
  EXPECT_EQ(Fault(), AXIS_FAULT_FORCE_REVERSED) << "it still watches";
}

TEST_F(FirstMotion, TheFirstContactEndsTheWatch) {
  Pass();
  Set(AXIS_OBJ_OPEN_LOOP_CODE, 50);
  Step(3);
  force_ = kPresses;
  Step(3);
  force_ = kPulls;
  Step(50);
  EXPECT_EQ(Fault(), 0);
}

// Every mode that moves by the position law, the force modes' approach and the bound of the speed
// out of contact included.
TEST_F(FirstMotion, ModesThatMoveByThePositionLawNeedItsGain) {
  const std::pair<int, bool> modes[] = {{1, true},   {3, true},   {4, true},   {6, true},
                                        {8, true},   {9, true},   {10, true},  {-4, true},
                                        {-5, true},  {0, false},  {-1, false}, {-2, false},
                                        {-3, false}, {-6, false}, {-7, false}, {-8, false}};
  for (const int speed : {0, 1000}) {
    for (const auto &[mode, needs] : modes) {
      const bool presses = mode == -1 || mode == -6 || mode == -7 || mode == -8;
      const bool refused = needs || (presses && speed != 0);
      Begin();
      Set(AXIS_OBJ_TOUCH_VELOCITY_MAX, speed);
      Set(AXIS_OBJ_POSITION_GAIN, 0);
      Enabling(mode);
      Step(3);
      EXPECT_EQ(Fault(), refused ? AXIS_FAULT_POSITION_GAIN_ZERO : 0) << mode << ' ' << speed;
    }
  }
}

}  // namespace
