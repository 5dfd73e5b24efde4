#pragma once
// Which switches of a mode may change in the tick ahead, and which one does first.
#include <cstddef>
#include <cstdint>
#include <vector>

#include "sim/hybrid/kernel.hpp"
#include "sim/hybrid/mode.hpp"

namespace forceaxis::sim {

/// Bound on the relative rounding of a channel's value.
inline constexpr double kChannelRounding = 0x1p-46;

/// The tests that Mode describes, cheapest first: quiet(), then doubtful_parts() and calm(), then
/// first_change() within a part. Owns the buffers; the caller owns z = (x, 1, u), which must not
/// change within such a sequence of calls. Copies are independent. No call changes a switch.
class Detector {
 public:
  struct Change {
    std::size_t channel = 0;
    bool above = false;
    double after = 0.0;  ///< ticks from now
  };

  /// A signal on its bound is judged by the first coefficient that exceeds its rounding `factor`
  /// times; 1 until switches contradict each other, then more for the rest of the tick.
  void set_doubt(double factor) { rounding_ = factor * kChannelRounding; }

  /// The mode of all further calls; it must outlive them.
  void enter(const Mode &mode);

  /// Tests the next tick, from any instant. True: no switch changes. result() then holds its end.
  bool quiet(const double *z) {
    if (mode_->samples == 0) return false;
    // In a mode where only the second test passed, that one is tried first for kCalmTicks ticks.
    if (mode_ == calm_mode_ && calm_left_ > 0 && still_calm(z)) return true;
    return quiet_(mode_->quiet, z, result_.data(), curve_.data());
  }
  /// State and ADC signals at the end of the tick that quiet() or calm() has passed.
  const double *result() const { return result_.data(); }
  /// After quiet(): whether a signal is beyond its bound at the start already.
  bool beyond_now() const;
  /// After a quiet tick: whether this step of the command puts a signal beyond its bound.
  bool beyond_after(double change) const;

  /// After quiet() has failed: the parts of the grid, among the first `wanted`, in which a signal
  /// may reach a bound, one bit each.
  std::uint64_t doubtful_parts(const double *z, std::size_t wanted);
  /// After quiet() has failed: the second test. True: no switch changes in the tick.
  bool calm(const double *z);
  /// The first change from here on to `end`, within part `part` of the grid, of the channels that
  /// are in doubt there. False: none.
  bool first_change(const double *z, std::size_t part, double end, Change *found);

 private:
  enum class Verdict { none, at_once, later };

  bool still_calm(const double *z);
  bool passes_second_test(const double *z);
  std::uint64_t parts_in_doubt(const double *z, std::size_t channel, std::size_t wanted);
  Verdict examine(const double *z, std::size_t channel, double end, double *root, bool *above);
  Verdict examine_side(std::size_t channel, double bound, double end, double *root);

  kernel::Multiply multiply_ = kernel::best_multiply();
  kernel::Quiet quiet_ = kernel::best_quiet();
  kernel::Grid grid_ = kernel::best_grid();
  const Mode *mode_ = nullptr;
  const Mode *calm_mode_ = nullptr;  // where the second test passed after the first had failed
  int calm_left_ = 0;
  double rounding_ = kChannelRounding;  // of coefficients, in examine_side()
  kernel::Vector result_;
  kernel::Vector curve_;
  kernel::Vector calm_;
  kernel::Vector grid_signal_;
  kernel::Vector grid_dip_;
  kernel::Vector polynomial_;
  std::vector<double> absolute_;
  std::vector<std::uint64_t> parts_in_doubt_;  // per channel, one bit per part of the grid
};

}  // namespace forceaxis::sim
