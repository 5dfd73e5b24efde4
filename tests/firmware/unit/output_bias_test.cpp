// The output bias, which holds the weight of a vertical axis: in which ticks it is put out, that it
// is within every bound, and that no limit and no stop lets the axis fall.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "tests/firmware/unit/axis_fixture.hpp"
#include "tests/firmware/unit/cia402_fixture.hpp"

namespace {

constexpr int kBias = 16 * 300 + 6;  // 300.375 codes

class OutputBias : public AxisFixture {
 protected:
  void Start(int mode, int shift = 0, int latency = 0, int bias = kBias) {
    PowerUp();
    Set(AXIS_OBJ_DAC_BITS, 16);
    Set(AXIS_OBJ_LATENCY_TICKS, latency);
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, shift);
    Set(AXIS_OBJ_OUTPUT_BIAS, bias);
    Set(AXIS_OBJ_MODE, mode);
  }

  int Fine() const { return outputs_.dac_fine; }
};

TEST_F(OutputBias, IsPutOutFromTheFirstToTheLastTickInWhichTheAxisIsEnabled) {
  const int modes[] = {AXIS_MODE_OPEN_LOOP, AXIS_MODE_POSITION, AXIS_MODE_FORCE,
                       AXIS_MODE_EXCITATION};
  for (const int mode : modes) {
    for (const int shift : {0, 6}) {
      for (const int latency : {0, 1}) {
        for (const int bias : {kBias, -kBias}) {
          Start(AXIS_MODE_DISABLED, shift, latency, bias);
          Tick();
          ExpectOff(AXIS_FAULT_NONE);
          Set(AXIS_OBJ_MODE, mode);
          for (int i = 0; i < 5; ++i) {
            Tick();
            ASSERT_EQ(Fine(), bias) << "mode " << mode << " tick " << i;
            ASSERT_EQ(outputs_.brake_release, 1);
          }
          inputs_.sensor_valid = 0;
          Tick();
          ExpectOff(AXIS_FAULT_SENSOR_INVALID);
          inputs_.sensor_valid = 1;
        }
      }
    }
  }
}

// The law is added to it, and a change of mode goes on from the code that was put out.
TEST_F(OutputBias, TheLawIsAddedToIt) {
  Start(AXIS_MODE_FORCE);
  Set(AXIS_OBJ_FORCE_GAIN, 5 * 256);
  Set(AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
  TickForce(28);
  EXPECT_EQ(Fine(), kBias + 16 * 10);
  EXPECT_EQ(Read(AXIS_OBJ_COMMAND_CODE), 310);
  Set(AXIS_OBJ_OPEN_LOOP_CODE, -40);
  Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  Tick();
  EXPECT_EQ(Fine(), kBias - 16 * 40) << "without a bump bias the output is a step";
  Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
  Tick();
  Start(AXIS_MODE_OPEN_LOOP, 6);
  Set(AXIS_OBJ_OPEN_LOOP_CODE, -40);
  TickForce(28);
  EXPECT_EQ(Fine(), kBias) << "the law ramps in";
  Tick();
  ASSERT_LT(Fine(), kBias);
  const int before = Fine();
  Set(AXIS_OBJ_FORCE_GAIN, 5 * 256);
  Set(AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
  Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
  Tick();
  EXPECT_EQ(Fine(), before);
}

TEST_F(OutputBias, IsHalfOfTheRangeAtMostAndCannotChangeWhileEnabled) {
  EXPECT_EQ(Write(AXIS_OBJ_OUTPUT_BIAS, 16 * 1024), FW_OK);
  EXPECT_EQ(Write(AXIS_OBJ_OUTPUT_BIAS, 16 * 1024 + 1), FW_ERROR_RANGE);
  EXPECT_EQ(Write(AXIS_OBJ_OUTPUT_BIAS, -16 * 1024 - 1), FW_ERROR_RANGE);
  EXPECT_EQ(Write(AXIS_OBJ_OUTPUT_BIAS, -16 * 1024), FW_OK);
  Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  Tick();
  EXPECT_EQ(Write(AXIS_OBJ_OUTPUT_BIAS, 0), FW_ERROR_STATE);
  EXPECT_EQ(Fine(), -16 * 1024);
}

// The bias itself has the resolution of the output, and the sum too.
TEST_F(OutputBias, HasTheResolutionOfTheOutput) {
  for (int bits = 12; bits <= 16; ++bits) {
    const int step = 1 << (16 - bits);
    for (int bias = -40; bias <= 40; ++bias) {
      PowerUp();
      Set(AXIS_OBJ_OUTPUT_BIAS, bias);
      Set(AXIS_OBJ_DAC_BITS, bits);
      Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
      Tick();
      ASSERT_EQ(Fine(), static_cast<int>(std::floor(bias / (1.0 * step) + 0.5)) * step);
    }
  }
}

TEST_F(OutputBias, TheSumIsWithinOutputLimit) {
  std::mt19937 random(44);
  const auto any = [&random](int least, int most) {
    return std::uniform_int_distribution<int>(least, most)(random);
  };
  int limited = 0;
  for (int i = 0; i < 8000; ++i) {
    const int limit = any(0, 2) == 0 ? 2048 : any(0, 2048);
    const int bias = any(-1024, 1024);
    const int code = any(-2048, 2047);
    Start(AXIS_MODE_OPEN_LOOP, 0, any(0, 1), 16 * bias);
    Set(AXIS_OBJ_OUTPUT_LIMIT, limit);
    Set(AXIS_OBJ_OPEN_LOOP_CODE, code);
    Tick();
    Tick();
    // What is left of a bias beyond the limit is the limit.
    const int sum = std::clamp(bias, -limit, limit) + code;
    const int expected = std::clamp(sum, -limit, std::min(limit, 2047));
    ASSERT_EQ(Fine(), 16 * expected) << bias << " + " << code << " within " << limit;
    const int reason = Read(AXIS_OBJ_LIMIT_REASON);
    ASSERT_EQ(reason, sum == expected ? AXIS_LIMIT_REASON_NONE
                      : limit == 2048 ? AXIS_LIMIT_REASON_DAC_SATURATION
                                      : AXIS_LIMIT_REASON_OUTPUT_LIMIT);
    limited += sum != expected;
  }
  EXPECT_GT(limited, 800);
}

// Beyond an end the law drives no further, and the bias stays: with code 0 the axis would fall. A
// bias that moves the axis further itself, because it is too large, is taken away in that tick.
TEST_F(OutputBias, HoldsTheAxisAtItsEnds) {
  struct End {
    int sign;  // of the direction in which the end is reached
    bool at_switch;
    int reason;
  };
  const End ends[] = {{1, true, AXIS_LIMIT_REASON_LIMIT_SWITCH_POS},
                      {-1, true, AXIS_LIMIT_REASON_LIMIT_SWITCH_NEG},
                      {1, false, AXIS_LIMIT_REASON_POSITION_MAX},
                      {-1, false, AXIS_LIMIT_REASON_POSITION_MIN}};
  for (const End &end : ends) {
    for (const int bias : {16 * 300, 0, -16 * 300}) {
      for (const int latency : {0, 1}) {
        const auto at = [&](int code, int moved) {
          Start(AXIS_MODE_OPEN_LOOP, 0, latency, bias);
          inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
          TickPosition(0);
          if (end.at_switch) {
            inputs_.din |= end.sign > 0 ? AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE
                                        : AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE;
          } else {
            Set(end.sign > 0 ? AXIS_OBJ_POSITION_MAX : AXIS_OBJ_POSITION_MIN, -10 * end.sign);
          }
          Set(AXIS_OBJ_OPEN_LOOP_CODE, end.sign * code);
          TickPosition(0);
          TickPosition(end.sign * moved);
          return end.sign * Fine();
        };
        const int held = end.sign * bias;
        EXPECT_EQ(at(100, 0), held) << "no further";
        EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), end.reason);
        EXPECT_EQ(at(-100, 0), held - 1600) << "back is free";
        EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), AXIS_LIMIT_REASON_NONE);
        EXPECT_EQ(at(0, 0), held);
        EXPECT_EQ(at(100, 3), std::min(held, 0)) << "moves further";
        EXPECT_EQ(at(0, 3), std::min(held, 0));
        EXPECT_EQ(at(-100, 3), std::min(held - 1600, 0));
        EXPECT_EQ(at(100, -3), held) << "moves back";
      }
    }
  }
}

// A vertical axis: its motor commands a force, the weight pulls with `weight_` codes, and an
// engaged brake holds. Without friction, so that what does not hold it lets it fall.
class Vertical : public Drive {
 protected:
  void Hang(int bias = kBias, double weight = kBias / 16.0) {
    PowerUp();
    speed_ = 0.0;
    engaging_ = 1 << 20;
    weight_ = weight;
    Set(AXIS_OBJ_DAC_BITS, 16);
    Set(AXIS_OBJ_POSITION_GAIN, 2 * 256);
    Set(AXIS_OBJ_VELOCITY_GAIN, 60 * 256);
    Set(AXIS_OBJ_FORCE_ZERO_CODE, 128);
    Set(AXIS_OBJ_OUTPUT_BIAS, bias);
  }

  void Step(int ticks = 1) {
    for (int i = 0; i < ticks; ++i) {
      inputs_.encoder_cnt = static_cast<int32_t>(std::floor(place_ + 0.5));
      const double depth = std::max(0.0, place_ - wall_);
      inputs_.adc_code[0] = static_cast<uint16_t>(std::fmin(255.0, 128.5 + depth * stiffness_));
      fw_tick(&fw_, &inputs_, &outputs_);
      speed_ += kOfCode * (outputs_.dac_fine / 16.0 - weight_ - kOfForce * depth * stiffness_);
      engaging_ = outputs_.brake_release == 0 ? engaging_ + 1 : 0;
      if (engaging_ > engage_ticks_) speed_ = 0.0;
      place_ += speed_;
    }
  }

  void Go(int mode) {
    Set(AXIS_OBJ_MODES_OF_OPERATION, mode);
    Step();
    for (const int word : {0x06, 0x07, 0x0F}) Control(word);
    Step(2);
  }

  // The largest distance from the place in so many ticks.
  double Strays(int ticks) {
    const double from = place_;
    double most = 0.0;
    for (int i = 0; i < ticks; ++i) {
      Step();
      most = std::max(most, std::abs(place_ - from));
    }
    return most;
  }

  static constexpr double kOfCode = 0.001;  // counts per tick^2 and code
  static constexpr double kOfForce = 3.0;   // codes per count of the reading
  double speed_ = 0.0;
  int engage_ticks_ = 0;  // from the end of brake_release until the brake holds
  int engaging_ = 0;      // ticks since the end of brake_release
};

// From the first tick on: not by the law, which would need a distance for it.
TEST_F(Vertical, HangsStillInEveryMode) {
  for (int mode = -9; mode <= 10; ++mode) {
    if (!cia402_mode_exists(mode)) continue;
    for (const int sign : {1, -1}) {
      for (const int latency : {0, 1}) {
        Hang(sign * kBias, sign * kBias / 16.0);
        Set(AXIS_OBJ_LATENCY_TICKS, latency);
        Go(mode);
        ASSERT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED) << mode;
        EXPECT_LT(Strays(600), 1.0) << "mode " << mode;
        ASSERT_EQ(outputs_.brake_release, 1) << mode;
        Hang(0, sign * kBias / 16.0);
        Set(AXIS_OBJ_LATENCY_TICKS, latency);
        Go(mode);
        EXPECT_GT(Strays(600), 100.0) << "without a bias, mode " << mode;
      }
    }
  }
}

// Each way to stop ends where it began, with the brake engaged and the output at 0. A brake holds
// only some ticks after it was closed. Until then the amplifier has to be on, with the bias; only a
// fault that switches it off at once lets the axis fall for this time: half of a t^2.
TEST_F(Vertical, NoStopLetsItFall) {
  constexpr int kOwnerLost = -1, kEnableLost = -2, kNativeOff = -3;
  struct Stop {
    const char *name;
    int word, quick_stop_option, fault_option;
  };
  const Stop stops[] = {{"halt", 0x10F, 2, 2},
                        {"shutdown", 0x06, 2, 2},
                        {"disable operation", 0x07, 2, 2},
                        {"quick stop", 0x02, 2, 2},
                        {"quick stop, disable", 0x02, 0, 2},
                        {"quick stop, stay", 0x02, 6, 2},
                        {"disable voltage", 0x00, 2, 2},
                        {"native mode", kNativeOff, 2, 2},
                        {"owner lost", kOwnerLost, 2, 2},
                        {"owner lost, slow", kOwnerLost, 2, 1},
                        {"fault reaction 0", kOwnerLost, 2, 0},
                        {"emergency stop", kEnableLost, 2, 2}};
  for (const Stop &stop : stops) {
    for (const int engage : {0, 45}) {
      for (const int held : {0, engage}) {
        for (const int mode : {kPv, kTq, -2}) {
          Hang();
          engage_ticks_ = engage;
          Set(AXIS_OBJ_BRAKE_ENGAGE_TICKS, held);
          Set(AXIS_OBJ_QUICK_STOP_OPTION, stop.quick_stop_option);
          Set(AXIS_OBJ_FAULT_REACTION_OPTION, stop.fault_option);
          Go(mode);
          Step(200);
          if (stop.word >= 0) {
            Control(stop.word);
          } else if (stop.word == kNativeOff) {
            Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
          } else if (stop.word == kEnableLost) {
            inputs_.din = 0;
          } else {
            cia402_owner_lost(&fw_.drive, &fw_.axis, AXIS_FAULT_SOURCE_LOST);
          }
          const bool stays = stop.word == 0x10F || stop.quick_stop_option == 6;
          const bool at_once = stop.word == kEnableLost || stop.fault_option == 0;
          const double before = place_;
          const double strays = Strays(900);
          const std::string name = std::string(stop.name) + " in mode " + std::to_string(mode) +
                                   ", engages in " + std::to_string(engage) + ", held for " +
                                   std::to_string(held);
          if (stays || engage == 0 || (held == engage && !at_once)) {
            EXPECT_LT(strays, 1.0) << name;
          } else {
            const double falls = 0.5 * kOfCode * kBias / 16.0 * engage * (engage + 1);
            EXPECT_NEAR(before - place_, falls, 1.0) << name;
          }
          EXPECT_EQ(outputs_.brake_release, stays ? 1 : 0) << name;
          EXPECT_EQ(outputs_.amp_enable, stays ? 1 : 0) << name;
          EXPECT_EQ(outputs_.dac_fine, stays ? kBias : 0) << name;
          if (stop.word == kOwnerLost || stop.word == kEnableLost) {
            EXPECT_EQ(State(), AXIS_DRIVE_STATE_FAULT) << name;
          }
          inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
        }
      }
    }
  }
}

// The amplifier is on for exactly so many ticks, with the bias and not with the last command, which
// may press or move the axis. In this time the axis counts as enabled.
TEST_F(Vertical, HoldsForTheTimeInWhichTheBrakeEngages) {
  for (const int ticks : {1, 45, 1500}) {
    for (const int latency : {0, 1}) {
      Hang();
      Set(AXIS_OBJ_BRAKE_ENGAGE_TICKS, ticks);
      Set(AXIS_OBJ_LATENCY_TICKS, latency);
      Go(-2);
      Set(AXIS_OBJ_OPEN_LOOP_CODE, 700);
      Step(3);
      ASSERT_EQ(outputs_.dac_fine, kBias + 16 * 700);
      Control(0);
      for (int i = 0; i < ticks; ++i) {
        Step();
        ASSERT_EQ(outputs_.dac_fine, kBias) << i;
        ASSERT_EQ(outputs_.amp_enable, 1) << i;
        ASSERT_EQ(outputs_.brake_release, 0) << i;
        ASSERT_EQ(Read(AXIS_OBJ_LIMIT_REASON), AXIS_LIMIT_REASON_NONE);
        ASSERT_EQ(Write(AXIS_OBJ_OUTPUT_BIAS, 0), FW_ERROR_STATE);
      }
      Step();
      EXPECT_EQ(outputs_.dac_fine, 0);
      EXPECT_EQ(outputs_.amp_enable, 0);
      EXPECT_EQ(Write(AXIS_OBJ_OUTPUT_BIAS, 0), FW_OK);
      Step(2000);
      EXPECT_EQ(outputs_.amp_enable, 0);
    }
  }
}

// A fault, a limit and a new enabling act in this time as in every other.
TEST_F(Vertical, IsSupervisedWhileTheBrakeEngages) {
  const auto stop = [this](int mode) {
    Hang();
    engage_ticks_ = 45;
    Set(AXIS_OBJ_BRAKE_ENGAGE_TICKS, 45);
    Go(mode);
    Step(100);
    Control(0);
    Step(10);
    ASSERT_EQ(outputs_.amp_enable, 1);
  };
  stop(kPv);
  inputs_.din = 0;
  Step();
  EXPECT_EQ(outputs_.amp_enable, 0);
  EXPECT_EQ(outputs_.dac_fine, 0);
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_ENABLE_LOST);
  inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;

  stop(kPv);
  inputs_.sensor_valid = 0;
  Step();
  EXPECT_EQ(outputs_.amp_enable, 0);
  inputs_.sensor_valid = 1;

  stop(kPv);
  Set(AXIS_OBJ_OUTPUT_LIMIT, 100);
  Step();
  EXPECT_EQ(outputs_.dac_fine, 1600);

  // At an end of the travel a bias that drives the axis on is taken away.
  stop(kPv);
  inputs_.din |= AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE;
  speed_ = 3.0;
  Step(2);
  EXPECT_EQ(outputs_.dac_fine, 0);
  EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), AXIS_LIMIT_REASON_LIMIT_SWITCH_POS);
  inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;

  for (const int mode : {kPv, kTq, -2}) {
    stop(mode);
    for (const int word : {0x06, 0x07, 0x0F}) Control(word);
    EXPECT_LT(Strays(600), 1.0) << mode;
    EXPECT_EQ(outputs_.brake_release, 1) << mode;
    Control(0);
    Step(45);
    EXPECT_EQ(outputs_.amp_enable, 1) << "the whole time again, mode " << mode;
    Step();
    EXPECT_EQ(outputs_.amp_enable, 0) << mode;
  }
}

// A drive on a bus comes on late: until then the brake is engaged and the output is 0.
TEST_F(Vertical, WaitsForItsDriveWithCodeZero) {
  Hang();
  inputs_.drive = AXIS_DRIVE_REPORT_FITTED;
  Go(kPp);
  for (int i = 0; i < 50; ++i) {
    Step();
    ASSERT_EQ(outputs_.dac_fine, 0);
    ASSERT_EQ(outputs_.brake_release, 0);
  }
  inputs_.drive = AXIS_DRIVE_REPORT_FITTED | AXIS_DRIVE_REPORT_ON;
  Step();
  EXPECT_EQ(outputs_.dac_fine, kBias);
  EXPECT_LT(Strays(600), 1.0);
}

// A lost contact caps what presses, about the bias; so does a law without a certificate.
TEST_F(Vertical, TheBoundsOfTheDriveAreAboutTheBias) {
  Hang();
  Set(AXIS_OBJ_CONTACT_LOSS_CAP, 0);
  wall_ = 20;
  stiffness_ = 0.5;
  Go(kTq);
  Set(AXIS_OBJ_TARGET_FORCE, 200);
  for (int i = 0; i < 3000 && Read(AXIS_OBJ_CONTACT) == 0; ++i) Step();
  ASSERT_EQ(Read(AXIS_OBJ_CONTACT), 1);
  wall_ = 1e6;
  Step();
  ASSERT_EQ(Read(AXIS_OBJ_ACTIVE_MODE), AXIS_MODE_FORCE);
  EXPECT_EQ(outputs_.dac_fine, kBias) << "not 0, with which it would fall on the part";

  Hang();
  Set(AXIS_OBJ_CERTIFICATE_REQUIRED, 1);
  Set(AXIS_OBJ_UNCERTIFIED_OUTPUT, 20);
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Set(AXIS_OBJ_FORCE_SETPOINT, 0);
  Go(-1);
  EXPECT_LT(Strays(300), 1.0);
  Set(AXIS_OBJ_FORCE_SETPOINT, 100 * 256);
  Step();
  EXPECT_EQ(outputs_.dac_fine, kBias + 16 * 20);
  EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), AXIS_LIMIT_REASON_OUTPUT_LIMIT);
  EXPECT_GT(Read(AXIS_OBJ_COMMAND_CODE), 320);
}

// With the bias that holds its weight, an axis approaches, presses, loses contact, and is stopped
// as an axis without a weight, to the last bit; the bound of the speed out of contact included.
TEST_F(Vertical, MovesAsAnAxisWithoutWeight) {
  std::mt19937 random(4);
  const auto any = [&random](int least, int most) {
    return std::uniform_int_distribution<int>(least, most)(random);
  };
  const int modes[] = {1, 3, 4, 8, 9, 10, -1, -2, -4, -5, -6, -7, -8};
  int contacts = 0;
  size_t compared = 0;
  for (int run = 0; run < 200; ++run) {
    const int mode = modes[static_cast<size_t>(any(0, 12))];
    const unsigned seed = random();
    std::vector<double> places[2];
    for (const int weighs : {0, 1}) {
      random.seed(seed);
      const int bias = any(-8000, 8000);
      Hang(weighs * bias, weighs * bias / 16.0);
      Set(AXIS_OBJ_POSITION_GAIN, 128);
      Set(AXIS_OBJ_TOUCH_VELOCITY_MAX, any(0, 1) * 3000);
      Set(AXIS_OBJ_LATENCY_TICKS, any(0, 1));
      Set(AXIS_OBJ_CONTACT_LOSS_CAP, any(0, 40));
      Set(AXIS_OBJ_CERTIFICATE_REQUIRED, any(0, 1));
      Set(AXIS_OBJ_UNCERTIFIED_OUTPUT, any(0, 200));
      Set(AXIS_OBJ_STIFFNESS, 256);
      wall_ = any(20, 100);
      stiffness_ = 0.5;
      Go(mode);
      for (int i = 0; i < 400; ++i) {
        const int act = any(0, 60);
        if (act == 0) Set(AXIS_OBJ_TARGET_POSITION, any(-100, 100));
        if (act == 1) Set(AXIS_OBJ_TARGET_FORCE, any(-100, 300));
        if (act == 2) Set(AXIS_OBJ_FORCE_SETPOINT, any(-30, 60) * 256);
        if (act == 3) Set(AXIS_OBJ_TARGET_VELOCITY, any(-2000, 2000));
        if (act == 4) Set(AXIS_OBJ_OPEN_LOOP_CODE, any(-100, 100));
        if (act == 5) Control(kNewNow);
        if (act == 6) Control(kOperate);
        if (act == 7) Control(kOperate | kHalt);
        if (act == 8) wall_ = place_ + any(-60, 60);
        Step();
        // At the end of the DAC's range the bias takes from the law in one direction.
        if (Read(AXIS_OBJ_LIMIT_REASON) == AXIS_LIMIT_REASON_DAC_SATURATION) break;
        contacts += Read(AXIS_OBJ_CONTACT);
        places[weighs].push_back(place_);
      }
    }
    const size_t ticks = std::min(places[0].size(), places[1].size());
    for (auto &one : places) one.resize(ticks);
    ASSERT_EQ(places[0], places[1]) << "run " << run << " mode " << mode;
    compared += ticks;
  }
  EXPECT_GT(contacts, 1000);
  EXPECT_GT(compared, 40000u);
}

// Standing against its weight is no sign of a sensor that is not connected.
TEST_F(Vertical, AStandingAxisIsNotTakenForADisconnectedSensor) {
  Hang();
  Set(AXIS_OBJ_FORCE_DISCONNECTED_CODE, 200);
  Set(AXIS_OBJ_FORCE_DISCONNECTED_TIME, 100);
  Set(AXIS_OBJ_FORCE_DISCONNECTED_TRAVEL, 50);
  Go(kTq);
  Step(1500);
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
}

// The first motion test moves about the bias. It runs again after a change of the bias, which it
// finds if it does not hold the axis.
TEST_F(Vertical, TheFirstMotionTestTriesTheBias) {
  const auto result = [this](int bias) {
    Hang(bias);
    Set(AXIS_OBJ_FIRST_MOTION_TEST, 1);
    Go(kPp);
    for (int i = 0; i < 3000; ++i) {
      if (Read(AXIS_OBJ_FIRST_MOTION_RESULT) != AXIS_FIRST_MOTION_RESULT_RUNNING) break;
      Step();
    }
    return Read(AXIS_OBJ_FIRST_MOTION_RESULT);
  };
  EXPECT_EQ(result(0), AXIS_FIRST_MOTION_RESULT_AMPLIFIER_OFFSET);
  EXPECT_EQ(result(-kBias), AXIS_FIRST_MOTION_RESULT_AMPLIFIER_OFFSET);
  EXPECT_EQ(result(2 * kBias), AXIS_FIRST_MOTION_RESULT_AMPLIFIER_OFFSET);
  EXPECT_EQ(result(kBias), AXIS_FIRST_MOTION_RESULT_PASSED);
  Control(0);
  Step(100);
  Go(kPp);
  EXPECT_EQ(Read(AXIS_OBJ_FIRST_MOTION_RESULT), AXIS_FIRST_MOTION_RESULT_PASSED);
  Control(0);
  Step(100);
  Set(AXIS_OBJ_OUTPUT_BIAS, kBias + 1);
  EXPECT_EQ(Read(AXIS_OBJ_FIRST_MOTION_RESULT), AXIS_FIRST_MOTION_RESULT_NOT_RUN);
  Go(kPp);
  ASSERT_EQ(Read(AXIS_OBJ_FIRST_MOTION_RESULT), AXIS_FIRST_MOTION_RESULT_RUNNING);
  ASSERT_EQ(Read(AXIS_OBJ_MODE), AXIS_MODE_DISABLED) << "it waits for a standstill";
  EXPECT_EQ(Write(AXIS_OBJ_OUTPUT_BIAS, 0), FW_ERROR_STATE);
}

// Homing goes against a switch at the top and holds there.
TEST_F(Vertical, StandsAtALimitSwitchThatItIsDrivenAgainst) {
  Hang(-kBias, -kBias / 16.0);  // the weight pulls down, to larger counts
  Go(-2);
  inputs_.din |= AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE;
  Set(AXIS_OBJ_OPEN_LOOP_CODE, -200);
  EXPECT_LT(Strays(1500), 1.0);
  EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), AXIS_LIMIT_REASON_LIMIT_SWITCH_NEG);
}

// A bias that is too large by half does not drive the axis through its end.
TEST_F(Vertical, ABiasThatIsTooLargeCreepsBeyondAnEndAtMost) {
  Hang(-kBias * 3 / 2, -kBias / 16.0);
  inputs_.din |= AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE;
  Go(-2);
  for (int i = 0; i < 3000; ++i) {
    Step();
    ASSERT_LT(std::abs(speed_), 2.0) << i;
  }
}

}  // namespace
