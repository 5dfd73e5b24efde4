#pragma once
// The bus between the firmware and a drive. Frames leave once in each bus cycle and arrive late.
//
// A bus cycle has m ticks and starts at the ticks 0, m, 2 m, ... In the first tick of a cycle, the
// firmware's DAC code and amp_enable leave for the drive, and the drive measures its encoder. The
// drive applies a frame `delay_ticks_out` ticks later and holds it until the next frame. The
// firmware has each encoder count from `delay_ticks_in` ticks after its measurement until the next
// count arrives. Until the first frame arrives, the drive is disabled and the firmware has the
// count of tick 0.
//
// A drive with `enable_ticks` reports its state, which travels with the encoder count. The drive is
// on `enable_ticks` ticks after the frame that enables the drive has arrived. Until then, it stays
// disabled.
#include <algorithm>
#include <cstdint>
#include <optional>
#include <vector>

#include "sim/model/elements/bus_cycle.hpp"

namespace forceaxis::sim {

/// Bits of a drive's report to the firmware.
enum DriveBit : std::uint8_t { kDriveFitted = 1, kDriveOn = 2, kDriveFault = 4 };

/// Failures of a drive with `enable_ticks`. `off`: the drive has switched itself off. `fault`: the
/// drive has switched itself off and reports a fault. `silent`: the frames of the drive do not
/// arrive any more, but the drive still receives frames.
enum class DriveFailure : std::uint8_t { none, off, fault, silent };

class DriveBus {
 public:
  /// A frame from the firmware to the drive.
  struct Frame {
    int dac_code = 0;
    bool amp_enable = false;
  };
  /// The data of the drive that the firmware has in one tick.
  struct Sample {
    /// Encoder count that the drive has measured.
    std::int32_t count = 0;
    /// Number of ticks since the drive has measured `count`, at most 255.
    std::uint8_t age_ticks = 0;
    std::uint8_t report = 0;  ///< state that the drive reports over its bus, as bits DriveBit; 0 if
                              ///< the model has no key `enable_ticks`
  };

  DriveBus() = default;
  DriveBus(const BusCycle &cycle, std::optional<int> enable_ticks)
      : cycle_(cycle),
        enable_ticks_(enable_ticks),
        frames_(places(cycle.delay_ticks_out, cycle.ticks)),
        sent_(places(cycle.delay_ticks_in, cycle.ticks)) {}

  /// Returns true if the plant has a bus.
  bool fitted() const { return !frames_.empty(); }

  /// Starts a failure of the drive at this instant. DriveFailure::none ends the failure.
  void fail(DriveFailure failure) { failure_ = failure; }

  /// Returns the frame that the drive applies in this tick. Must be called once in each tick, with
  /// the outputs of the firmware in this tick.
  Frame act(std::int64_t tick, Frame out) {
    if (tick % cycle_.ticks == 0) place(frames_, tick) = out;
    const std::int64_t left = tick - cycle_.delay_ticks_out;
    const Frame frame = left < 0 ? Frame{} : place(frames_, left);
    if (!enable_ticks_) return frame;
    enabled_ticks_ =
        frame.amp_enable && !is_off() ? std::min(enabled_ticks_, *enable_ticks_) + 1 : 0;
    return enabled_ticks_ > *enable_ticks_ ? frame : Frame{};
  }

  /// Returns the data of the drive that the firmware has in this tick. `count` is the true encoder
  /// count of this tick. Must be called at least once in each tick, before act().
  Sample sense(std::int64_t tick, std::int32_t count) {
    if (tick == 0) newest_ = first_ = {0, count, report()};
    if (tick % cycle_.ticks == 0) {
      if (failure_ != DriveFailure::silent) newest_ = {tick, count, report()};
      place(sent_, tick) = newest_;
    }
    const std::int64_t left = tick - cycle_.delay_ticks_in;
    const Measured &seen = left < 0 ? first_ : place(sent_, left);
    const std::int64_t age = std::min<std::int64_t>(tick - seen.tick, 255);
    return {seen.count, static_cast<std::uint8_t>(age), seen.report};
  }

 private:
  struct Measured {
    std::int64_t tick = 0;
    std::int32_t count = 0;
    std::uint8_t report = 0;
  };
  bool is_off() const { return failure_ == DriveFailure::off || failure_ == DriveFailure::fault; }
  // Returns the drive's report at this instant. The frame of this tick has not arrived yet. A drive
  // that needs no time to switch on therefore reports one tick after it has begun to follow the DAC
  // code.
  std::uint8_t report() const {
    if (!enable_ticks_) return 0;
    if (failure_ == DriveFailure::fault) return kDriveFitted | kDriveFault;
    const bool on = !is_off() && enabled_ticks_ >= std::max(*enable_ticks_, 1);
    return on ? kDriveFitted | kDriveOn : kDriveFitted;
  }
  // Returns the number of bus cycles whose values must be stored.
  static std::size_t places(int delay, int ticks) {
    return static_cast<std::size_t>(delay / ticks + 2);
  }
  // Returns the element of the ring buffer `cycles` for the bus cycle to which a tick belongs.
  template <class T>
  T &place(std::vector<T> &cycles, std::int64_t tick) const {
    return cycles[static_cast<std::size_t>(tick / cycle_.ticks) % cycles.size()];
  }

  BusCycle cycle_;
  std::optional<int> enable_ticks_;
  DriveFailure failure_ = DriveFailure::none;
  int enabled_ticks_ = 0;  // number of ticks for which the drive has been enabled, at most
                           // enable_ticks + 1
  std::vector<Frame> frames_;
  std::vector<Measured> sent_;
  Measured first_;
  Measured newest_;
};

}  // namespace forceaxis::sim
