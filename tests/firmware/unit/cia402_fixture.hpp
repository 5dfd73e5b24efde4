#ifndef TESTS_UNIT_CIA402_FIXTURE_HPP_
#define TESTS_UNIT_CIA402_FIXTURE_HPP_

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>

#include "tests/firmware/unit/firmware_fixture.hpp"

// A drive on a simple axis: the amplifier commands speed, `counts_per_code` counts a tick and code;
// disabled it is at rest. A spring of `stiffness` 8-bit counts per encoder count from `wall` on.
class DriveFixture : public FirmwareFixture {
 protected:
  DriveFixture() { PowerUp(); }

  void PowerUp() {
    fw_ = fw_t{};
    const fw_config_t config{};
    fw_init(&fw_, &config);
    inputs_ = {0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
    place_ = 0.0;
    Set(AXIS_OBJ_POSITION_GAIN, 5 * 256);
    Set(AXIS_OBJ_FORCE_GAIN, 5 * 256);
    Set(AXIS_OBJ_CONTROLWORD, 0);  // wakes the drive
  }

  int State() const { return fw_.drive.signals.drive_state; }
  int Status() const { return fw_.drive.signals.statusword; }
  int Mode() const { return fw_.drive.signals.modes_of_operation_display; }
  int32_t Demand() const { return fw_.drive.signals.position_demand; }

  // Convert, tick, move. Checks in every tick that a disabled axis outputs code 0.
  void Tick(int ticks = 1) {
    for (int i = 0; i < ticks; ++i) {
      inputs_.encoder_cnt = static_cast<int32_t>(std::floor(place_ + 0.5));
      const double depth = place_ - wall_;
      const double reading = offset_ + ((depth > 0.0) ? depth * stiffness_ : 0.0);
      inputs_.adc_code[0] = static_cast<uint16_t>(std::fmin(255.0, std::floor(reading + 0.5)));
      inputs_.din = Din();
      fw_tick(&fw_, &inputs_, &outputs_);
      const int state = State();
      const bool powered = state == AXIS_DRIVE_STATE_OPERATION_ENABLED ||
                           state == AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE ||
                           state == AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE;
      if (!powered) {
        ASSERT_EQ(outputs_.dac_code, 0) << "state " << state;
        ASSERT_EQ(outputs_.amp_enable, 0) << "state " << state;
        ASSERT_EQ(outputs_.brake_release, 0) << "state " << state;
      }
      if (outputs_.amp_enable != 0 && !stuck_) {
        place_ += counts_per_code_ * (outputs_.dac_fine / 16.0 - weight_);
      }
    }
  }

  void Control(int controlword) { Set(AXIS_OBJ_CONTROLWORD, controlword); }

  void Enable(int mode) {
    Set(AXIS_OBJ_MODES_OF_OPERATION, mode);
    Tick();
    Control(0x06);
    Control(0x07);
    Control(0x0F);
    Tick(2);
    ASSERT_EQ(State(), AXIS_DRIVE_STATE_OPERATION_ENABLED);
    ASSERT_EQ(Mode(), mode);
  }

  // Ticks until the bits of the statusword under `mask` are `value`, or -1.
  int TicksUntil(int mask, int value, int most) {
    for (int i = 0; i <= most; ++i) {
      if ((Status() & mask) == value) {
        return i;
      }
      Tick();
    }
    return -1;
  }

  double Speed() const { return fw_.drive.trajectory.velocity_q16 / 65536.0; }  // count a tick

  // The digital inputs of the coming tick.
  virtual uint8_t Din() { return inputs_.din; }

  double place_ = 0.0;
  double counts_per_code_ = 0.02;
  double weight_ = 0.0;  // code with which the axis stands: its weight, or an offset
  double wall_ = 1e12;
  double stiffness_ = 0.5;
  double offset_ = 0.0;  // reading without a force
  bool stuck_ = false;
};

// Modes of operation on a simulated axis. Figures are worked out by hand from the parameters:
// 3000 count/s are 2 counts a tick, 225,000 count/s^2 are 0.1 count/tick^2.
class Drive : public DriveFixture {
 protected:
  static constexpr int kPp = 1, kPv = 3, kTq = 4, kHm = 6, kCsp = 8, kCsv = 9, kCst = 10;
  static constexpr int kOperate = 0x0F, kNew = 0x1F, kNewNow = 0x3F, kNewRelative = 0x5F;
  static constexpr int kHalt = 0x100;
  static constexpr int kReached = 0x400, kBit12 = 0x1000, kBit13 = 0x2000, kLimit = 0x800;

  // In profile velocity, at 10 counts a tick.
  void EnableAtSpeed() {
    Enable(kPv);
    Set(AXIS_OBJ_TARGET_VELOCITY, 15000);
    Tick(200);
  }

  void MoveTo(int32_t target, int command = kNew) {
    Set(AXIS_OBJ_TARGET_POSITION, target);
    Control(command);
    Control(kOperate);
  }

  // Follows the trajectory until it is at rest; checks speed and its changes.
  int Follow(double speed_max, double up, double down, int most = 20000) {
    double before = Speed();
    for (int i = 1; i <= most; ++i) {
      Tick();
      EXPECT_LE(std::abs(Speed()), speed_max + 1e-9);
      const double change = Speed() - before;
      const bool slower = std::abs(Speed()) < std::abs(before);
      EXPECT_LE(std::abs(change), (slower ? down : up) + 1e-9) << "tick " << i;
      before = Speed();
      if (Speed() == 0.0) {
        return i;
      }
    }
    return -1;
  }
};

#endif
