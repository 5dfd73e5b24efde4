#ifndef TESTS_UNIT_CIA402_FIXTURE_HPP_
#define TESTS_UNIT_CIA402_FIXTURE_HPP_

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "firmware/port/host/firmware.hpp"

// A drive on a simple axis: the amplifier commands speed, `counts_per_code` counts a tick and code;
// disabled it stands. A spring of `stiffness` 8-bit counts per encoder count from `wall` on.
class DriveFixture : public ::testing::Test {
 protected:
  static constexpr int kTicksPerSecond = 1500;
  static constexpr int kHalt = 0x100;

  DriveFixture() { PowerUp(); }

  void PowerUp() {
    fw_ = fw_t{};
    const fw_config_t config{};
    fw_init(&fw_, &config);
    inputs_ = {0, {0, 0}, AXIS_DIN_ENABLE, 1};
    place_ = 0.0;
    Set(AXIS_OBJ_POSITION_GAIN, 5 * 256);
    Set(AXIS_OBJ_FORCE_GAIN, 5 * 256);
    Set(AXIS_OBJ_CONTROLWORD, 0);  // wakes the drive
  }

  int Write(uint16_t object, int32_t value) {
    return fw_object_write(&fw_, FW_SOURCE_LOCAL, object, value);
  }

  void Set(uint16_t object, int32_t value) {
    ASSERT_EQ(Write(object, value), FW_OK) << "object " << object << " value " << value;
  }

  int32_t Read(uint16_t object) const {
    int32_t value = 0;
    EXPECT_EQ(fw_object_read(&fw_, object, &value), FW_OK) << "object " << object;
    return value;
  }

  int State() const { return fw_.drive.signals.drive_state; }
  int Status() const { return fw_.drive.signals.statusword; }
  int Mode() const { return fw_.drive.signals.modes_of_operation_display; }
  int32_t Demand() const { return fw_.drive.signals.position_demand; }

  // Convert, tick, move. Every tick: what is not powered puts out nothing.
  void Tick(int ticks = 1) {
    for (int i = 0; i < ticks; ++i) {
      inputs_.encoder_cnt = static_cast<int32_t>(std::floor(place_ + 0.5));
      const double depth = place_ - wall_;
      const double reading = (depth > 0.0) ? depth * stiffness_ : 0.0;
      inputs_.adc_code[0] = static_cast<uint16_t>(std::fmin(255.0, std::floor(reading + 0.5)));
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
        place_ += counts_per_code_ * outputs_.dac_code;
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

  fw_t fw_{};
  axis_inputs_t inputs_{};
  axis_outputs_t outputs_{};
  double place_ = 0.0;
  double counts_per_code_ = 0.02;
  double wall_ = 1e12;
  double stiffness_ = 0.5;
  bool stuck_ = false;
};

#endif
