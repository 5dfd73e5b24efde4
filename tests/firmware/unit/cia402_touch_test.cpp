// Protections of motion around the contact: speed, travel, approach, halved gain.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>

#include "tests/firmware/unit/cia402_fixture.hpp"

namespace {

constexpr int kForceCounts = -1, kStiffness = -6, kDamping = -7, kImpedance = -8;
constexpr int kContact = 3;  // counts of the reading, one more than contact_force
constexpr int kJudged = 5;   // every fourth tick judges, the next one answers

// The axis stands where the test puts it, and reads what the test says.
class Touch : public Drive {
 protected:
  void SetUp() override { Begin(kForceCounts); }

  void Begin(int mode, int force_sign = 1) {
    PowerUp();
    stuck_ = true;
    Set(AXIS_OBJ_FORCE_SIGN, force_sign);
    Enable(mode);
  }

  // Ticks with the axis at `cnt` and a reading of this magnitude, in counts.
  void At(int32_t cnt, int reading, int ticks = 1) {
    inputs_.encoder_cnt = cnt;
    inputs_.adc_code[0] = static_cast<uint16_t>(reading);
    for (int i = 0; i < ticks; ++i) fw_tick(&fw_, &inputs_, &outputs_);
  }

  int Fault() const { return fw_.axis.signals.fault; }
  bool IsOff() const { return outputs_.amp_enable == 0 && outputs_.dac_code == 0; }

  // Ticks until the axis is off, at most `most`; 0: it is not.
  int TicksToOff(int32_t cnt, int reading, int most) {
    for (int i = 1; i <= most; ++i) {
      At(cnt, reading);
      if (IsOff()) return i;
    }
    return 0;
  }
};

// Travel.

TEST_F(Touch, TravelFromTheFirstContactIsAFaultInTheDirectionOfPressingAlone) {
  // Also where the encoder wraps.
  for (const int32_t first : {0, 1000, INT32_MAX - 20, INT32_MIN + 20}) {
    for (const int sign : {1, -1}) {
      Begin(kForceCounts, sign);
      Set(AXIS_OBJ_CONTACT_TRAVEL_MAX, 50);
      Set(AXIS_OBJ_FORCE_SETPOINT, sign * 30 * 256);
      const auto from = [&](int counts) {
        return static_cast<int32_t>(static_cast<uint32_t>(first) +
                                    static_cast<uint32_t>(sign * counts));
      };
      At(from(0), 0, 4);
      At(from(0), kContact, kJudged);
      At(from(-500), kContact, 10);  // yielding is free
      At(from(-500), 0, 10);         // and so is losing it
      At(from(50), kContact, 10);    // the last count allowed
      ASSERT_FALSE(IsOff()) << first << " " << sign;
      const int ticks = TicksToOff(from(51), kContact, 10);
      EXPECT_GE(ticks, 2);
      EXPECT_LE(ticks, kJudged) << first << " " << sign;
      EXPECT_EQ(Fault(), AXIS_FAULT_CONTACT_TRAVEL);
      EXPECT_EQ(Read(AXIS_OBJ_ERROR_CODE), 0xFF14);
    }
  }
}

TEST_F(Touch, TravelBeginsAnewWithForceControlAndIsOffAtZero) {
  Set(AXIS_OBJ_CONTACT_TRAVEL_MAX, 50);
  At(0, kContact, 4);
  Control(0x07);
  At(0, 0, 4);
  Control(0x0F);
  At(1000, kContact, 10);
  EXPECT_FALSE(IsOff());
  Set(AXIS_OBJ_CONTACT_TRAVEL_MAX, 0);
  At(100000, kContact, 10);
  EXPECT_FALSE(IsOff());
}

// A lost contact does not begin it anew: the workpiece gave way.
TEST_F(Touch, TravelGoesOnWithoutContact) {
  Set(AXIS_OBJ_CONTACT_TRAVEL_MAX, 50);
  At(0, kContact, 4);
  At(51, 0, kJudged);
  EXPECT_TRUE(IsOff());
  EXPECT_EQ(Fault(), AXIS_FAULT_CONTACT_TRAVEL);
}

// Approach.

// 100 ms are 150 ticks; the demand is there from the tick after it was written.
TEST_F(Touch, AnApproachWithoutContactEndsAtItsTime) {
  for (const int mode : {kForceCounts, kTq, kCst}) {
    Begin(mode);
    Set(AXIS_OBJ_APPROACH_TIMEOUT, 100);
    At(0, 0, 1000);
    ASSERT_FALSE(IsOff()) << "no demand";
    Set(AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
    Set(AXIS_OBJ_TARGET_FORCE, 750);
    const int ticks = TicksToOff(0, 0, 1000);
    EXPECT_GT(ticks, 150) << mode;
    EXPECT_LE(ticks, 150 + 2 * kJudged) << mode;
    EXPECT_EQ(Fault(), AXIS_FAULT_NO_CONTACT);
    EXPECT_EQ(Read(AXIS_OBJ_ERROR_CODE), 0xFF15);
  }
}

TEST_F(Touch, AContactOrAnotherDemandBeginsTheApproachAnew) {
  Set(AXIS_OBJ_APPROACH_TIMEOUT, 100);
  Set(AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
  for (int i = 0; i < 4; ++i) {
    At(0, 0, 148);
    At(0, kContact, kJudged);
  }
  At(0, 0, 148);
  Set(AXIS_OBJ_FORCE_SETPOINT, -30 * 256);
  At(0, 0, 148);
  Set(AXIS_OBJ_FORCE_SETPOINT, 2 * 256);  // would be no contact
  At(0, 0, 1000);
  EXPECT_FALSE(IsOff());
  Set(AXIS_OBJ_FORCE_SETPOINT, 2 * 256 + 1);
  EXPECT_GT(TicksToOff(0, 0, 1000), 150);
}

// Time and way of an approach count from the enabling, wherever the axis stands and whatever an
// earlier approach had used up.
TEST_F(Touch, AnApproachBeginsAnewWithForceControl) {
  for (const int sign : {1, -1}) {
    PowerUp();
    stuck_ = true;
    place_ = 5000;
    Set(AXIS_OBJ_APPROACH_TIMEOUT, 100);
    Set(AXIS_OBJ_APPROACH_TRAVEL_MAX, 1000);
    Set(AXIS_OBJ_FORCE_SETPOINT, sign * 30 * 256);
    for (const int place : {5000, 7000, -5000}) {
      place_ = place;
      Enable(kForceCounts);
      At(place, 0, 140);
      ASSERT_FALSE(IsOff()) << sign << " at " << place;
      Control(0x07);
      At(place, 0, 10);
    }
    Control(0x0F);
    EXPECT_GT(TicksToOff(-5000, 0, 1000), 150) << sign;
    EXPECT_EQ(Fault(), AXIS_FAULT_NO_CONTACT);
  }
}

TEST_F(Touch, HaltedThereIsNoApproach) {
  for (const int mode : {kTq, kForceCounts}) {
    Begin(mode);
    Set(AXIS_OBJ_APPROACH_TIMEOUT, 100);
    Set(AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
    Set(AXIS_OBJ_TARGET_FORCE, 750);
    At(0, 0, 100);
    Control(0x0F | kHalt);
    At(0, 0, 1000);
    EXPECT_FALSE(IsOff());
    Control(0x0F);
    EXPECT_GT(TicksToOff(0, 0, 1000), 150);
  }
}

TEST_F(Touch, AnApproachWithoutContactEndsAtItsWay) {
  for (const int32_t first : {0, INT32_MAX - 20, INT32_MIN + 20}) {
    for (const int sign : {1, -1}) {
      Begin(kForceCounts);
      Set(AXIS_OBJ_APPROACH_TRAVEL_MAX, 50);
      At(first, 0, 4);
      Set(AXIS_OBJ_FORCE_SETPOINT, sign * 30 * 256);
      At(first, 0, kJudged);
      const auto from = [&](int counts) {
        return static_cast<int32_t>(static_cast<uint32_t>(first) +
                                    static_cast<uint32_t>(sign * counts));
      };
      At(from(50), 0, 10);
      ASSERT_FALSE(IsOff());
      const int ticks = TicksToOff(from(51), 0, 10);
      EXPECT_GE(ticks, 2);
      EXPECT_LE(ticks, kJudged);
      EXPECT_EQ(Fault(), AXIS_FAULT_NO_CONTACT);
    }
  }
}

// The speed out of contact.

// 3000 count/s are 2 counts a tick: without the bound the law's 150 codes are 3 of them, and a
// spring or a damper as much as it likes.
TEST_F(Drive, TheSpeedOutOfContactIsBoundedInEveryModeThatHasNoApproach) {
  for (const int mode : {kForceCounts, kStiffness, kDamping, kImpedance}) {
    for (const int sign : {1, -1}) {
      for (const bool bounded : {false, true}) {
        PowerUp();
        Set(AXIS_OBJ_TOUCH_VELOCITY_MAX, bounded ? 3000 : 0);
        Set(AXIS_OBJ_STIFFNESS, 65536);
        Set(AXIS_OBJ_DAMPING, 50 * 256);
        Enable(mode);
        Set(AXIS_OBJ_TRAJECTORY_VELOCITY, 60000);
        Set(AXIS_OBJ_FORCE_SETPOINT, sign * 30 * 256);
        Set(AXIS_OBJ_TARGET_POSITION, sign * 100000);
        Set(AXIS_OBJ_TARGET_VELOCITY, sign * 60000);
        double fastest = 0.0;
        for (int i = 0; i < 600; ++i) {
          const double from = place_;
          Tick();
          fastest = std::fmax(fastest, (place_ - from) * sign);
        }
        if (bounded) {
          EXPECT_LE(fastest, 2.2) << mode << " " << sign;
          EXPECT_GE(fastest, 1.9) << mode << " " << sign;
        } else {
          EXPECT_GT(fastest, 2.5) << mode << " " << sign;
        }
      }
    }
  }
}

// The code goes on from that of the approach; it is the law's at the end.
TEST_F(Drive, AContactAtTheBoundIsTakenOverWithoutABump) {
  for (const int shift : {0, 6}) {
    PowerUp();
    Set(AXIS_OBJ_TOUCH_VELOCITY_MAX, 3000);
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, shift);
    wall_ = 400;
    Enable(kForceCounts);
    Set(AXIS_OBJ_FORCE_SETPOINT, 60 * 256);
    int before = 0;
    for (int i = 0; i < 1000 && Read(AXIS_OBJ_CONTACT) == 0; ++i) {
      before = outputs_.dac_code;
      Tick();
    }
    ASSERT_EQ(Read(AXIS_OBJ_CONTACT), 1);
    EXPECT_NEAR(before, 100, 15);  // 2 counts a tick
    EXPECT_NEAR(outputs_.dac_code, (shift == 0) ? 5 * 57 : before, 6) << shift;
    Tick(1000);
    EXPECT_NEAR(Read(AXIS_OBJ_FORCE) / 256, 60, 1);
  }
}

TEST_F(Drive, ALostContactIsBoundedInItsTick) {
  Set(AXIS_OBJ_TOUCH_VELOCITY_MAX, 3000);
  wall_ = 400;
  Enable(kForceCounts);
  Set(AXIS_OBJ_FORCE_SETPOINT, 60 * 256);
  Tick(1500);
  ASSERT_EQ(Read(AXIS_OBJ_CONTACT), 1);
  wall_ = 1e6;
  for (int i = 0; i < 600; ++i) {
    const double from = place_;
    Tick();
    ASSERT_LE(place_ - from, 2.2) << i;
  }
  EXPECT_EQ(Read(AXIS_OBJ_CONTACT), 0);
}

// What a change of the gain left of the code of a contact drives the axis no faster toward the
// workpiece that is lost, also where the set-point presses the other way by now. Some 390 codes
// fall to none within 390 * 4 / 5 counts ahead of the bound, here of 8 a tick.
TEST_F(Touch, ABiasTowardTheLostContactIsBoundedAgainstTheSetPointToo) {
  for (const int sign : {1, -1}) {
    Begin(kForceCounts, sign);
    Set(AXIS_OBJ_TOUCH_VELOCITY_MAX, 3000);
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    Set(AXIS_OBJ_FORCE_SETPOINT, sign * 100 * 256);
    At(0, 0, 4);
    At(0, kContact, 100);
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 12);
    Set(AXIS_OBJ_FORCE_GAIN, 256);
    At(0, kContact);
    ASSERT_GT(outputs_.dac_code * sign, 300);
    Set(AXIS_OBJ_FORCE_SETPOINT, -sign * 256);
    At(0, kContact);
    ASSERT_GT(outputs_.dac_code * sign, 300);
    for (int i = 1; i < 300; ++i) {
      At(10 * i * sign, 0);
      if (i > 45) {
        ASSERT_LE(outputs_.dac_code * sign, 2) << sign << " " << i;
      }
    }
  }
}

// A code that held the axis before the force law goes on where the set-point does not press, and
// falls as well once the axis is faster than the bound.
TEST_F(Touch, ACodeThatHoldsTheAxisGoesOnUntilItIsTooFast) {
  constexpr int kOpenLoop = -2;
  for (const int sign : {1, -1}) {
    Begin(kOpenLoop);
    Set(AXIS_OBJ_TOUCH_VELOCITY_MAX, 3000);
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 12);
    Set(AXIS_OBJ_OPEN_LOOP_CODE, -sign * 300);
    At(0, 0, 10);
    ASSERT_EQ(outputs_.dac_code, -sign * 300);
    Set(AXIS_OBJ_FORCE_SETPOINT, sign * 30 * 256);
    Set(AXIS_OBJ_MODES_OF_OPERATION, kForceCounts);
    At(0, 0, 20);
    ASSERT_EQ(Mode(), kForceCounts);
    EXPECT_LT(outputs_.dac_code * sign, -290);
    for (int i = 1; i < 100; ++i) {
      At(-10 * i * sign, 0);
      if (i > 45) {
        ASSERT_GE(outputs_.dac_code * sign, -2) << sign << " " << i;
      }
    }
  }
}

// Where the set-point presses nothing of it goes on: the code rises from 0, by 5 in two ticks:
// a quarter of position_gain for each of the 4 counts that an axis at a stand is behind.
TEST_F(Touch, AnApproachBeginsWithoutTheCodeBeforeIt) {
  constexpr int kOpenLoop = -2;
  for (const int sign : {1, -1}) {
    Begin(kOpenLoop);
    Set(AXIS_OBJ_TOUCH_VELOCITY_MAX, 3000);
    Set(AXIS_OBJ_OPEN_LOOP_CODE, sign * 300);
    At(0, 0, 10);
    ASSERT_EQ(outputs_.dac_code, sign * 300);
    Set(AXIS_OBJ_FORCE_SETPOINT, sign * 30 * 256);
    Set(AXIS_OBJ_MODES_OF_OPERATION, kForceCounts);
    int ticks = 0;
    while (Read(AXIS_OBJ_ACTIVE_MODE) != AXIS_MODE_FORCE && ++ticks < 20) At(0, 0);
    EXPECT_GE(outputs_.dac_code * sign, 0);
    EXPECT_LE(outputs_.dac_code * sign, 5);
    At(0, 0, 4);
    EXPECT_LE(outputs_.dac_code * sign, 15);
  }
}

// A law that asks for less is its own, and away from the workpiece it is as fast as it likes.
TEST_F(Drive, ALawThatIsSlowerIsNotChanged) {
  for (const int speed : {0, 3000}) {
    PowerUp();
    Set(AXIS_OBJ_TOUCH_VELOCITY_MAX, speed);
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    Enable(kForceCounts);
    Set(AXIS_OBJ_FORCE_SETPOINT, 10 * 256);
    Tick(100);
    EXPECT_EQ(outputs_.dac_code, 50) << speed;
  }
}

// Losses and ripple.

class Unstable : public Touch {
 protected:
  void Lose(int times) {
    for (int i = 0; i < times; ++i) {
      At(0, kContact, 2);
      At(0, 0, 2);
    }
  }
  int Halvings() const { return Read(AXIS_OBJ_GAIN_HALVINGS); }
};

// 3 within 200 ms, which are 15 slots of 20 ticks.
TEST_F(Unstable, LossesWithinTheWindowHalveTheGain) {
  Set(AXIS_OBJ_LIMIT_CYCLE_LOSSES, 3);
  Set(AXIS_OBJ_LIMIT_CYCLE_WINDOW, 20);
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Set(AXIS_OBJ_CONTACT_UNSTABLE_OPTION, AXIS_CONTACT_UNSTABLE_OPTION_HALVE_GAIN);
  Set(AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
  for (int i = 0; i < 5; ++i) {  // too slowly
    Lose(2);
    At(0, kContact, 320);
  }
  EXPECT_EQ(Halvings(), 0);
  for (int halvings = 1; halvings <= 3; ++halvings) {
    Lose(3);
    At(0, 10, kJudged);
    EXPECT_EQ(Halvings(), halvings);
    EXPECT_EQ(outputs_.dac_code, (halvings == 1) ? 50 : (halvings == 2) ? 25 : 13);
    EXPECT_NE(Status() & 0x80, 0);
    EXPECT_EQ(Read(AXIS_OBJ_FORCE_GAIN), 5 * 256) << "it is still what was written";
    Lose(250);  // 1000 of the 1500 ticks that it is given to settle
    EXPECT_EQ(Halvings(), halvings);
    At(0, 10, 600);
  }
  Lose(3);
  At(0, kContact, kJudged);
  EXPECT_EQ(Fault(), AXIS_FAULT_CONTACT_UNSTABLE);
  EXPECT_EQ(Read(AXIS_OBJ_ERROR_CODE), 0xFF16);
}

TEST_F(Unstable, TheGainIsWholeAgainOnceTheAxisWasDisabled) {
  Set(AXIS_OBJ_LIMIT_CYCLE_LOSSES, 3);
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Set(AXIS_OBJ_CONTACT_UNSTABLE_OPTION, AXIS_CONTACT_UNSTABLE_OPTION_HALVE_GAIN);
  Set(AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
  Lose(3);
  At(0, 10, kJudged);
  ASSERT_EQ(outputs_.dac_code, 50);
  Set(AXIS_OBJ_MODES_OF_OPERATION, kCsp);  // another mode does not disable
  At(0, 10, 300);
  Set(AXIS_OBJ_MODES_OF_OPERATION, kForceCounts);
  At(0, 10, 300);
  EXPECT_EQ(outputs_.dac_code, 50);
  Control(0x07);
  At(0, 10, 2);
  EXPECT_EQ(Halvings(), 0);
  Control(0x0F);
  At(0, 10, 2);
  EXPECT_EQ(outputs_.dac_code, 100);
}

TEST_F(Unstable, TheHalvedGainIsTakenOverWithoutABump) {
  Set(AXIS_OBJ_LIMIT_CYCLE_LOSSES, 3);
  Set(AXIS_OBJ_CONTACT_UNSTABLE_OPTION, AXIS_CONTACT_UNSTABLE_OPTION_HALVE_GAIN);
  Set(AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
  At(0, 0, 1000);  // the bump of enabling is over
  Lose(2);
  At(0, kContact, 2);
  At(0, 0, 1);
  int before = outputs_.dac_code;
  ASSERT_EQ(before, 150);
  for (int i = 0; i < kJudged; ++i) {
    At(0, 0, 1);
    EXPECT_NEAR(outputs_.dac_code, before, 3) << i;
    before = outputs_.dac_code;
  }
  EXPECT_EQ(Halvings(), 1);
  At(0, 0, 1000);
  EXPECT_EQ(outputs_.dac_code, 75);
}

TEST_F(Unstable, TheOptionFaultsOrWarnsAlone) {
  for (const int option : {AXIS_CONTACT_UNSTABLE_OPTION_WARN, AXIS_CONTACT_UNSTABLE_OPTION_FAULT}) {
    Begin(kForceCounts);
    Set(AXIS_OBJ_LIMIT_CYCLE_LOSSES, 3);
    Set(AXIS_OBJ_CONTACT_UNSTABLE_OPTION, option);
    Set(AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
    Lose(2);
    At(0, kContact, 4);
    ASSERT_EQ(Fault(), AXIS_FAULT_NONE);
    Lose(1);
    At(0, kContact, kJudged);
    const bool faults = option == AXIS_CONTACT_UNSTABLE_OPTION_FAULT;
    EXPECT_EQ(Fault(), faults ? AXIS_FAULT_CONTACT_UNSTABLE : AXIS_FAULT_NONE);
    EXPECT_EQ(Halvings(), 0);
    EXPECT_EQ(Status() & 0x80, 0x80);
  }
}

// A slot is 152 ticks. A swing of 10 counts is within the limit, 11 are not; 2 slots of it.
TEST_F(Unstable, RippleIsALimitCycleWithoutALoss) {
  for (const int swing : {10, 11}) {
    Begin(kForceCounts);
    Set(AXIS_OBJ_FORCE_RIPPLE_MAX, 10 * 256);
    Set(AXIS_OBJ_FORCE_RIPPLE_TIME, 2);
    Set(AXIS_OBJ_CONTACT_UNSTABLE_OPTION, AXIS_CONTACT_UNSTABLE_OPTION_FAULT);
    Set(AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
    int ticks = 0;
    for (; ticks < 3000 && !IsOff(); ++ticks) At(0, 30 + ((ticks / 20 % 2 != 0) ? swing : 0));
    EXPECT_EQ(Read(AXIS_OBJ_CONTACT_LOSSES), 0);
    EXPECT_EQ(Read(AXIS_OBJ_FORCE_RIPPLE), swing * 256);
    EXPECT_EQ(IsOff(), swing == 11);
    if (IsOff()) {
      EXPECT_GT(ticks, 2 * 152 - 4);
      EXPECT_LE(ticks, 3 * 152 + kJudged);  // the first slot had the change of the demand
      EXPECT_EQ(Fault(), AXIS_FAULT_CONTACT_UNSTABLE);
    }
  }
}

// What is asked for may change the force.
TEST_F(Unstable, RippleUnderAChangingDemandIsNone) {
  Set(AXIS_OBJ_FORCE_RIPPLE_MAX, 10 * 256);
  Set(AXIS_OBJ_FORCE_RIPPLE_TIME, 3);
  Set(AXIS_OBJ_CONTACT_UNSTABLE_OPTION, AXIS_CONTACT_UNSTABLE_OPTION_FAULT);
  for (int i = 0; i < 30; ++i) {
    Set(AXIS_OBJ_FORCE_SETPOINT, (30 + i % 2) * 256);
    for (int k = 0; k < 5; ++k) At(0, (k % 2 != 0) ? 60 : 30, 20);
  }
  EXPECT_FALSE(IsOff());
  // Less than the time of it is not enough, however often.
  for (int i = 0; i < 6; ++i) {
    for (int k = 0; k < 14; ++k) At(0, (k % 2 != 0) ? 60 : 30, 10);  // two slots touch it at most
    At(0, 30, 460);
  }
  EXPECT_FALSE(IsOff());
}

// A bank's gain is halved as force_gain is: 8 x 5 counts.
TEST_F(Unstable, ABanksGainIsHalvedToo) {
  ASSERT_EQ(fw_.axis.law.selected, 0);
  Control(0);
  At(0, 0, 2);
  fw_.axis.law.bank = {};
  fw_.axis.law.bank.gain_q8 = 8 * 256;
  fw_.axis.law.selected = 1;
  Set(AXIS_OBJ_LIMIT_CYCLE_LOSSES, 3);
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Set(AXIS_OBJ_CONTACT_UNSTABLE_OPTION, AXIS_CONTACT_UNSTABLE_OPTION_HALVE_GAIN);
  Enable(kForceCounts);
  Set(AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
  At(0, 25, 2);
  ASSERT_EQ(outputs_.dac_code, 40);
  Lose(3);
  At(0, 25, kJudged);
  EXPECT_EQ(Halvings(), 1);
  EXPECT_EQ(outputs_.dac_code, 20);
}

}  // namespace
