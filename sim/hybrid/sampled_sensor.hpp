#pragma once
// Stores the samples of a converter with its own clock from the instant of sampling until they
// arrive at the firmware.
//
// Sample k is taken phase_s + k / rate_hz after tick 0. The firmware has the newest sample that is
// at least latency_s old. Until the first sample has arrived, the firmware has the signal of tick
// 0. An instant within 1e-6 steps of a tick is treated as that tick. A sample at a tick is taken
// before the new DAC code acts.
#include <cmath>
#include <cstdint>
#include <vector>

#include "sim/model/elements/sampling.hpp"

namespace forceaxis::sim {

class SampledSensor {
 public:
  SampledSensor() = default;
  /// `steps_per_s` is the number of steps of the plant per second. A tick has `parts` steps.
  SampledSensor(const Sampling &sampling, double steps_per_s, int parts)
      : rate_hz_(sampling.rate_hz),
        steps_per_s_(steps_per_s),
        phase_(sampling.phase_s * steps_per_s),
        latency_(sampling.latency_s * steps_per_s),
        parts_(parts),
        codes_(static_cast<std::size_t>(sampling.latency_s * sampling.rate_hz) + 3) {}

  /// Returns true if the sensor has its own sample instants.
  bool fitted() const { return !codes_.empty(); }

  /// Index of the next sample, and its instant in steps since tick 0.
  std::int64_t next() const { return next_; }
  double next_instant() const { return instant(next_); }

  /// Sets the code of the signal at tick 0. To be called before the first sample.
  void begin(std::uint16_t code) { first_ = code; }
  /// Adds the code of the next sample.
  void take(std::uint16_t code) {
    place(next_) = code;
    ++next_;
  }

  /// The code that the firmware has, and the number of ticks since it was sampled, rounded up, at
  /// most 255.
  struct Reading {
    std::uint16_t code = 0;
    std::uint8_t age_ticks = 0;
  };

  /// Returns the code that the firmware has in a step. All samples up to this step must have been
  /// taken.
  Reading at(std::int64_t step) const {
    const auto now = static_cast<double>(step);
    const double samples = (now - latency_ - phase_ + kSame) * rate_hz_ / steps_per_s_;
    const auto arrived = static_cast<std::int64_t>(std::floor(samples));
    const std::int64_t newest = arrived < next_ ? arrived : next_ - 1;
    if (newest < 0) return {first_, age(now)};
    return {codes_[static_cast<std::size_t>(newest) % codes_.size()], age(now - instant(newest))};
  }

 private:
  static constexpr double kSame = 1e-6;  // largest difference of two instants, in steps, that are
                                         // regarded as equal

  double instant(std::int64_t sample) const {
    const double at = phase_ + static_cast<double>(sample) * steps_per_s_ / rate_hz_;
    const double whole = std::nearbyint(at);
    return std::fabs(at - whole) < kSame ? whole : at;
  }
  std::uint8_t age(double steps) const {
    const double ticks = std::ceil(steps / parts_ - kSame);
    return static_cast<std::uint8_t>(ticks < 255.0 ? ticks : 255.0);
  }
  std::uint16_t &place(std::int64_t sample) {
    return codes_[static_cast<std::size_t>(sample) % codes_.size()];
  }

  double rate_hz_ = 0.0;
  double steps_per_s_ = 0.0;
  double phase_ = 0.0;
  double latency_ = 0.0;
  int parts_ = 1;
  std::vector<std::uint16_t> codes_;
  std::uint16_t first_ = 0;
  std::int64_t next_ = 0;
};

}  // namespace forceaxis::sim
