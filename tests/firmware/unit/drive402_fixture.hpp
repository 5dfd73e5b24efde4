#ifndef TESTS_UNIT_DRIVE402_FIXTURE_HPP_
#define TESTS_UNIT_DRIVE402_FIXTURE_HPP_

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <vector>

#include "firmware/port/host/firmware.hpp"
#include "tests/support/drive402_node.hpp"

// A master and a drive on a bus of their own. Frames of a tick reach the drive in this tick, and
// its answers the master before the next one.
class Master402 : public ::testing::Test {
 protected:
  static constexpr uint8_t kDrive = 9, kMaster = 1;
  static constexpr uint16_t kRpdo = 0x200 + kDrive, kTpdo = 0x180 + kDrive;
  static constexpr uint16_t kSdo = 0x580 + kDrive, kBeat = 0x700 + kDrive;
  static constexpr int kCycle = 3;  // ticks of 2 ms

  Master402() {
    config_.scale_num = 7;
    config_.scale_den = 2;
    config_.target_max = 7000;
    config_.heartbeat_ms = 20;
    config_.heartbeat_timeout_ms = 50;
    config_.sdo_timeout_ms = 30;
    config_.wait_ms = 100;
    config_.quick_stop_ms = 10;
    config_.abort_option = 3;
    config_.cycle_ms = 2;
    config_.mode = DRIVE402_CSV;
    config_.rpdo_type = 255;
    config_.node_id = kDrive;
    config_.own_node_id = kMaster;
    drive_.out.clear();  // the drive was powered up before the master
  }

  uint8_t Init() {
    master_ = drive402_t{};
    return drive402_init(&master_, &config_);
  }

  void Hand(const Frame &frame, bool remote = false) {
    can_frame_t f{};
    f.id = frame.id;
    f.length = static_cast<uint8_t>(frame.data.size());
    f.remote = remote ? 1 : 0;
    std::copy(frame.data.begin(), frame.data.end(), f.data);
    drive402_receive(&master_, &f);
  }

  // Frames of the drive to the master.
  void Deliver() {
    for (const Frame &frame : std::exchange(drive_.out, {})) Hand(frame);
  }

  // The master's tick alone.
  void Step() {
    drive402_tick(&master_, &command_);
    sent_.clear();
    for (can_frame_t f{}; drive402_transmit(&master_, &f);) {
      EXPECT_EQ(f.remote, 0);
      sent_.push_back({f.id, {f.data, f.data + f.length}});
    }
    EXPECT_LE(sent_.size(), 4u);
    if (Controlword() >= 0) last_word_ = Controlword();
    for (const Frame &frame : sent_) drive_.Receive(frame);
    drive_.Tick();
  }

  void Tick(int ticks = 1) {
    for (int i = 0; i < ticks; ++i) {
      Deliver();
      Step();
    }
  }

  drive402_feedback_t Feedback() const { return drive402_feedback(&master_); }

  int Count(uint16_t id) const {
    return static_cast<int>(
        std::count_if(sent_.begin(), sent_.end(), [id](const Frame &f) { return f.id == id; }));
  }

  // The controlword of the RPDO of the last tick, -1 without one.
  int Controlword() const {
    for (const Frame &f : sent_) {
      if (f.id == kRpdo) return f.data[0] | f.data[1] << 8;
    }
    return -1;
  }

  // The controlword that was sent last.
  int LastWord() const { return last_word_; }

  bool HasFailure() const { return Feedback().reason != DRIVE402_NONE; }

  // Its target.
  int32_t Target() const {
    for (const Frame &f : sent_) {
      if (f.id != kRpdo) continue;
      if (f.data.size() == 4) return static_cast<int16_t>(f.data[2] | f.data[3] << 8);
      return static_cast<int32_t>(f.data[2] | f.data[3] << 8 | f.data[4] << 16 |
                                  static_cast<uint32_t>(f.data[5]) << 24);
    }
    return 0;
  }

  // Ticks until the next RPDO, which stays in sent_.
  int NextRpdo() {
    for (int i = 1; i <= 200; ++i) {
      Tick();
      if (Controlword() >= 0) return i;
    }
    ADD_FAILURE() << "no RPDO";
    return 0;
  }

  void Until(uint8_t phase) {
    for (int i = 0; i < 1000 && Feedback().phase != phase; ++i) Tick();
    ASSERT_EQ(Feedback().phase, phase) << drive402_reason_text(Feedback().reason);
    ASSERT_EQ(Feedback().reason, DRIVE402_NONE) << drive402_reason_text(Feedback().reason);
  }

  void Run() {
    ASSERT_EQ(Init(), DRIVE402_NONE);
    Until(DRIVE402_RUNNING);
  }

  void Enable(int32_t target = 100) {
    Run();
    command_ = {target, 1, 0};
    for (int i = 0; i < 200 && Feedback().on == 0; ++i) Tick();
    Deliver();
    ASSERT_EQ(Feedback().on, 1);
    NextRpdo();
    ASSERT_EQ(Controlword(), 0x0F);
    ASSERT_NE(Target(), 0);
    // Until just before the tick that begins a cycle.
    Tick(kCycle - 1);
  }

  void Reset() {
    command_.reset = 0;
    Tick();
    command_.reset = 1;
    Tick();
    command_.reset = 0;
  }

  drive402_config_t config_{};
  drive402_t master_{};
  drive402_command_t command_{};
  DriveNode drive_{kDrive};
  std::vector<Frame> sent_;
  int last_word_ = 0;
};

#endif
