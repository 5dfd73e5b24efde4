#pragma once
// The bus between the firmware and a drive: frames leave once in a cycle and arrive late.
//
// A cycle starts at the ticks 0, m, 2 m, ... In the first tick of a cycle the firmware's code and
// amp_enable leave for the drive, and the drive measures its encoder. The drive applies a frame
// `delay_ticks_out` ticks later and holds it until the next frame. The firmware has an encoder
// count `delay_ticks_in` ticks after its measurement and until the next one. Until the first frame
// arrives the drive is disabled, and the firmware has the count of tick 0.
#include <cstdint>
#include <vector>

#include "sim/model/model.hpp"

namespace forceaxis::sim {

class DriveBus {
 public:
  /// A frame from the firmware to the drive.
  struct Frame {
    int dac_code = 0;
    bool amp_enable = false;
  };

  DriveBus() = default;
  explicit DriveBus(const BusCycle &cycle)
      : cycle_(cycle),
        frames_(places(cycle.delay_ticks_out, cycle.ticks)),
        counts_(places(cycle.delay_ticks_in, cycle.ticks)) {}

  /// Returns true if the bus changes anything.
  bool fitted() const { return !frames_.empty(); }

  /// Returns the frame that the drive applies in this tick. Must be called once in each tick, with
  /// the outputs of the firmware in this tick.
  Frame act(std::int64_t tick, Frame out) {
    if (tick % cycle_.ticks == 0) place(frames_, tick) = out;
    const std::int64_t sent = tick - cycle_.delay_ticks_out;
    return sent < 0 ? Frame{} : place(frames_, sent);
  }

  /// An encoder count, and the number of ticks since the drive has measured it, at most 255.
  struct Count {
    std::int32_t count = 0;
    std::uint8_t age_ticks = 0;
  };

  /// Returns the encoder count that the firmware has in this tick. `count` is the true count of
  /// this tick. Must be called at least once in each tick.
  Count sense(std::int64_t tick, std::int32_t count) {
    if (tick == 0) first_ = count;
    if (tick % cycle_.ticks == 0) place(counts_, tick) = count;
    const std::int64_t sent = tick - cycle_.delay_ticks_in;
    if (sent < 0) return {first_, age(tick)};
    return {place(counts_, sent), age(cycle_.delay_ticks_in + sent % cycle_.ticks)};
  }

 private:
  static std::uint8_t age(std::int64_t ticks) {
    return static_cast<std::uint8_t>(ticks < 255 ? ticks : 255);
  }
  // Returns the number of cycles of which a value is still needed.
  static std::size_t places(int delay, int ticks) {
    return static_cast<std::size_t>(delay / ticks + 2);
  }
  // Returns the place of the cycle to which a tick belongs.
  template <class T>
  T &place(std::vector<T> &cycles, std::int64_t tick) const {
    return cycles[static_cast<std::size_t>(tick / cycle_.ticks) % cycles.size()];
  }

  BusCycle cycle_;
  std::vector<Frame> frames_;
  std::vector<std::int32_t> counts_;
  std::int32_t first_ = 0;
};

}  // namespace forceaxis::sim
