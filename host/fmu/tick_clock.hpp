#pragma once
// Converts the communication points of an importer to ticks of 1/1500 s. The length of a tick is
// not a binary fraction of a second, so a communication point that is a tick but for rounding is
// taken as this tick.
#include <algorithm>
#include <cmath>
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
  // A step that begins at a tick and deviates by at most this fraction from a whole number of ticks
  // ends at a tick. A step of one tick that is rounded down to whole nanoseconds deviates by 1e-6.
  // So an importer that counts nanoseconds gets a tick in each step, and where its deviations have
  // added up to half a tick, a step with one tick more or less.
  static constexpr double kTolerance = 2e-6;
  // Largest deviation, in ticks, of any other communication point that is taken as a tick. One
  // that is cut to whole nanoseconds deviates by less than 1.5e-6.
  static constexpr double kRounding = 2e-6;
  static constexpr double kTicksMax = 1e9;  // largest number of ticks in one step of the importer

  explicit TickClock(double start_s = 0.0) : start_s_(start_s) {}

  // Returns the present time in ticks; at a tick, this is a whole number.
  double now() const { return now_; }
  // Returns the time in s at which the next step begins.
  double time_s() const { return start_s_ + now_ / sim::kTickRateHz; }

  // Advances the time by a step that begins at a communication point. Throws StepRefused.
  void advance(double point_s, double step_s) {
    const double count = step_s * sim::kTickRateHz;
    if (!(count > 0.0 && count <= kTicksMax))
      throw StepRefused("step size: expected above 0 s and at most " +
                        sim::number_text(kTicksMax / sim::kTickRateHz) + " s, got " +
                        sim::number_text(step_s) + " s");
    const double begin = (point_s - start_s_) * sim::kTickRateHz;
    if (!(std::abs(begin - reached_) < 0.5 * std::min(1.0, count)))
      throw StepRefused("communication point: expected " + sim::number_text(time_s()) + " s, got " +
                        sim::number_text(point_s) + " s; continue where the last step has ended");
    const double end = begin + count;
    const double ticks = std::round(count), nearest = std::round(end);
    const bool is_whole =
        now_ == std::floor(now_) && ticks >= 1.0 && std::abs(count - ticks) <= kTolerance * ticks;
    now_ = std::max(now_, is_whole || std::abs(end - nearest) <= kRounding ? nearest : end);
    reached_ = end;
  }

 private:
  double start_s_;
  double now_ = 0.0;
  double reached_ = 0.0;  // end of the last step in ticks, as the importer states it
};

}  // namespace forceaxis::fmu
