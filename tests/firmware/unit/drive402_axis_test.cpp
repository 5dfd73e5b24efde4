// The master with the axis of this project as the drive of its user, in cyclic modes, over the
// axis' own CANopen server. Both tick in turn; frames go from one to the other in memory.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "tests/firmware/unit/bus_fixture.hpp"

namespace {

class AxisAsDrive : public BusFixture {
 protected:
  static constexpr uint8_t kMaster = 1;
  static constexpr double kCountsPerCode = 0.02;  // counts a tick and code of the amplifier
  static constexpr int kPerCode = 150;            // count/s and code of the command

  AxisAsDrive() {
    fw_config_t node = NodeConfig();
    fw_init(&fw_, &node);
    inputs_ = {0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
    // The owner of the axis is the master on CANopen; a position law that follows.
    Extra(AXIS_OBJ_COMMAND_SOURCE, AXIS_COMMAND_SOURCE_CANOPEN);
    Extra(AXIS_OBJ_POSITION_GAIN, 5 * 256);
    config_.extra = extra_.data();
    config_.extra_count = static_cast<uint8_t>(extra_.size());
    config_.scale_num = kPerCode;
    config_.scale_den = 1;
    config_.target_max = 300000;
    config_.heartbeat_ms = 20;
    config_.heartbeat_timeout_ms = 50;
    config_.sdo_timeout_ms = 50;
    config_.wait_ms = 200;
    config_.quick_stop_ms = 400;
    config_.abort_option = 1;
    config_.cycle_ms = 2;
    config_.mode = DRIVE402_CSV;
    config_.rpdo_type = 255;
    config_.node_id = kNode;
    config_.own_node_id = kMaster;
    config_.without = DRIVE402_WITHOUT_SYNC_PERIOD;  // the axis has no 1006h
    EXPECT_EQ(drive402_init(&master_, &config_), DRIVE402_NONE);
  }

  void Extra(uint16_t object, uint32_t value) {
    const axis_address_t *at = AddressOf(object);
    extra_.push_back(
        {at->index, at->sub, static_cast<uint8_t>(value_bytes(axis_objects[object].type)), value});
  }

  drive402_feedback_t Feedback() const { return drive402_feedback(&master_); }

  // A tick of the master, one of the axis, and what the amplifier makes of it.
  void Lockstep(int ticks = 1) {
    for (int i = 0; i < ticks; ++i) {
      for (can_frame_t f{}; fw_can_transmit(&fw_, &f);) {
        if (!cut_) drive402_receive(&master_, &f);
      }
      if (!killed_) {
        drive402_tick(&master_, &command_);
        for (can_frame_t f{}; drive402_transmit(&master_, &f);) {
          if (!cut_) fw_can_receive(&fw_, &f);
        }
      }
      inputs_.encoder_cnt = static_cast<int32_t>(std::floor(place_ + 0.5));
      encoder_.push_back(inputs_.encoder_cnt);
      fw_tick(&fw_, &inputs_, &outputs_);
      if (outputs_.amp_enable != 0) place_ += kCountsPerCode * outputs_.dac_code;
    }
    for (can_frame_t f{}; fw_can_transmit(&fw_, &f);) {
      if (!cut_) drive402_receive(&master_, &f);
    }
  }

  void Enable() {
    command_ = {0, 1, 0};
    int ticks = 0;
    while (Feedback().on == 0 && ticks < 1000) Lockstep(), ++ticks;
    ASSERT_EQ(Feedback().on, 1) << drive402_reason_text(Feedback().reason) << " " << std::hex
                                << Feedback().failed_index;
    EXPECT_EQ(Read(AXIS_OBJ_MODES_OF_OPERATION_DISPLAY), 9);
  }

  bool IsOff() const {
    return outputs_.amp_enable == 0 && outputs_.dac_code == 0 && outputs_.brake_release == 0;
  }

  int TicksToOff(int most) {
    for (int i = 1; i <= most; ++i) {
      Lockstep();
      if (IsOff()) return i;
    }
    return 0;
  }

  std::vector<drive402_entry_t> extra_;
  drive402_config_t config_{};
  drive402_t master_{};
  drive402_command_t command_{};
  std::vector<int32_t> encoder_;
  double place_ = 0.0;
  bool cut_ = false, killed_ = false;
};

TEST_F(AxisAsDrive, MovesAtTheCommandedVelocityAndStops) {
  Enable();
  for (const int code : {100, -250, 1}) {
    command_.target = code;
    Lockstep(1500);
    const double before = place_;
    // Every position is the encoder count of the tick that its age says: the axis answers a SYNC
    // with the values of its last tick.
    for (int i = 0; i < 1500; ++i) {
      const drive402_feedback_t said = Feedback();
      ASSERT_LE(said.age_ticks, 3);
      ASSERT_EQ(said.position_cnt, encoder_[encoder_.size() - said.age_ticks - 1]);
      Lockstep();
    }
    EXPECT_NEAR(place_ - before, code * kPerCode, 2.0) << "in a second";
    EXPECT_EQ(Feedback().reason, DRIVE402_NONE);
  }
  command_.target = 0;
  Lockstep(1500);
  const double rest = place_;
  Lockstep(300);
  EXPECT_NEAR(place_, rest, 1.0);
  EXPECT_EQ(outputs_.amp_enable, 1);
}

// Position mode: the axis is held where it is when it comes on, then follows each target.
TEST_F(AxisAsDrive, FollowsPositionsWithoutAJump) {
  config_.mode = DRIVE402_CSP;
  config_.scale_num = 1;
  master_ = drive402_t{};
  ASSERT_EQ(drive402_init(&master_, &config_), DRIVE402_NONE);
  place_ = -4321.0;
  Lockstep(200);
  command_ = {-4321, 1, 0};
  for (int i = 0; i < 600; ++i) {
    Lockstep();
    ASSERT_NEAR(place_, -4321.0, 1.0);
  }
  ASSERT_EQ(Feedback().on, 1);
  for (int i = 0; i <= 2400; ++i) {
    command_.target = -4321 + 3 * i;
    Lockstep();
  }
  Lockstep(1500);
  EXPECT_NEAR(place_, -4321.0 + 7200.0, 10.0);
  EXPECT_EQ(Feedback().reason, DRIVE402_NONE);
  command_.enable = 0;
  Lockstep(700);
  EXPECT_TRUE(IsOff());
}

TEST_F(AxisAsDrive, ADisabledAxisStopsQuicklyAndIsOff) {
  Enable();
  command_.target = 200;
  Lockstep(600);
  command_.enable = 0;
  Lockstep();
  EXPECT_EQ(Read(AXIS_OBJ_DRIVE_STATE), AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE);
  EXPECT_GT(TicksToOff(700), 0);
  const double rest = place_;
  Lockstep(300);
  EXPECT_EQ(place_, rest);
  EXPECT_TRUE(IsOff());
  EXPECT_EQ(Feedback().reason, DRIVE402_NONE);
  Enable();
  command_.target = 200;
  Lockstep(600);
  EXPECT_GT(place_, rest + 1000);
}

TEST_F(AxisAsDrive, ItsFaultIsNamedAndReset) {
  Enable();
  command_.target = 200;
  Lockstep(300);
  inputs_.sensor_valid = 0;
  Lockstep(3);
  EXPECT_TRUE(IsOff());
  EXPECT_EQ(Feedback().on, 0);
  EXPECT_EQ(Feedback().reason, DRIVE402_DRIVE_EMERGENCY);
  EXPECT_EQ(Feedback().error_code, AXIS_ERROR_CODE_SENSOR_INVALID);
  inputs_.sensor_valid = 1;
  Lockstep(700);
  EXPECT_EQ(Feedback().state, DRIVE402_FAULT);
  command_.reset = 1;
  Lockstep(100);
  EXPECT_EQ(Feedback().reason, DRIVE402_NONE);
  EXPECT_EQ(Feedback().on, 1);
}

TEST_F(AxisAsDrive, WithoutTheMasterTheAxisIsOff) {
  Enable();
  command_.target = 200;
  Lockstep(300);
  killed_ = true;
  const int ticks = TicksToOff(200);
  EXPECT_GT(ticks, 0);
  EXPECT_LE(ticks, 75 + 2);  // 50 ms, and the two ticks of docs/stop_times.md
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_HEARTBEAT_LOST);
}

TEST_F(AxisAsDrive, OnACutBusBothStop) {
  Enable();
  command_.target = 200;
  Lockstep(300);
  cut_ = true;
  Lockstep(9);
  EXPECT_EQ(Feedback().reason, DRIVE402_TPDO_MISSING);
  EXPECT_EQ(Feedback().on, 0);
  EXPECT_GT(TicksToOff(75 + 2), 0);
  // The bus is whole again: from the reset of the node on.
  cut_ = false;
  command_ = {0, 0, 1};
  Lockstep(600);
  Enable();
  EXPECT_EQ(Feedback().reason, DRIVE402_NONE);
}

TEST_F(AxisAsDrive, AnObjectThatItRefusesIsNamed) {
  config_.without = 0;
  master_ = drive402_t{};
  ASSERT_EQ(drive402_init(&master_, &config_), DRIVE402_NONE);
  Lockstep(100);
  EXPECT_EQ(Feedback().reason, DRIVE402_SDO_ABORTED);
  EXPECT_EQ(Feedback().failed_index, 0x1006);
  EXPECT_EQ(Feedback().abort_code, 0x06020000u);
}

}  // namespace
