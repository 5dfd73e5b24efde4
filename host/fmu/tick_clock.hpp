#pragma once
// Converts the communication points of an importer to ticks of 1/1500 s. The length of a tick is
// not a binary fraction of a second, so a communication point is rounded to the nearest tick.
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <string>

#include "sim/hybrid/mode.hpp"
#include "sim/model/text.hpp"

namespace forceaxis::fmu {

struct StepRefused : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class TickClock {
 public:
  // Largest deviation of a step from a whole number of ticks, as a fraction of the step. A step of
  // one tick that is rounded down to whole nanoseconds deviates by 1e-6.
  static constexpr double kTolerance = 2e-6;
  static constexpr double kTicksMax = 1e9;  // largest number of ticks in one step of the importer

  explicit TickClock(double start_s = 0.0) : start_s_(start_s) {}

  std::int64_t tick() const { return tick_; }
  // Returns the time in s at which the next step begins.
  double time_s() const { return start_s_ + static_cast<double>(tick_) / sim::kTickRateHz; }
  void advance() { ++tick_; }

  // Returns the number of ticks of a step that begins at a communication point. Throws StepRefused.
  std::int64_t ticks(double point_s, double step_s) const {
    const double count = step_s * sim::kTickRateHz;
    const double whole = std::round(count);
    if (!(whole >= 1.0 && whole <= kTicksMax && std::abs(count - whole) <= kTolerance * whole))
      throw StepRefused("step size: expected a whole number of ticks of 1/1500 s, got " +
                        sim::number_text(step_s) + " s, which is " + sim::number_text(count) +
                        " ticks; use a multiple of 1/1500 s in double precision");
    const double at = (point_s - start_s_) * sim::kTickRateHz;
    if (!(std::abs(at - static_cast<double>(tick_)) < 0.5))
      throw StepRefused("communication point: expected " + sim::number_text(time_s()) +
                        " s (tick " + std::to_string(tick_) + "), got " +
                        sim::number_text(point_s) + " s; continue where the last step has ended");
    return static_cast<std::int64_t>(whole);
  }

 private:
  double start_s_;
  std::int64_t tick_ = 0;
};

}  // namespace forceaxis::fmu
