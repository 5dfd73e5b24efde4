#pragma once
// Finds the switches of a mode that change their state in the next tick, and the instant of the
// first change.
#include <cstddef>
#include <cstdint>
#include <vector>

#include "sim/hybrid/kernel.hpp"
#include "sim/hybrid/mode.hpp"

namespace forceaxis::sim {

/// Upper bound of the relative rounding error of a channel's value.
inline constexpr double kChannelRounding = 0x1p-46;

/// Runs the tests that Mode describes, the cheapest first: quiet(), then doubtful_parts() and
/// calm(), then first_change() within a part of the tick. The detector owns the buffers. The caller
/// owns the vector z = (x, 1, u) and must not change it between the calls of such a sequence.
/// Copies are independent. No call changes the state of a switch.
class Detector {
 public:
  struct Change {
    std::size_t channel = 0;
    bool above = false;
    double after = 0.0;  ///< time from now until the change, in ticks
  };

  /// The rounding error of a coefficient is assumed to be `factor` times its normal bound. If a
  /// signal is on its bound, the first coefficient above this rounding error decides whether the
  /// switch changes. The factor is 1; the stepper increases it for the rest of a tick in which the
  /// states of switches contradict each other.
  void set_doubt(double factor) { rounding_ = factor * kChannelRounding; }

  /// Selects the mode of all further calls. The mode must exist as long as the detector uses it.
  void enter(const Mode &mode);

  /// Tests whether no switch changes during one tick from now. If it returns true, result() has the
  /// state at the end of the tick.
  bool quiet(const double *z) {
    if (mode_->samples == 0) return false;
    // After a tick in which only the second test passed in this mode, the second test runs first
    // for kCalmTicks ticks.
    if (mode_ == calm_mode_ && calm_left_ > 0 && still_calm(z)) return true;
    return quiet_(mode_->quiet, z, result_.data(), curve_.data());
  }
  /// The state and the ADC signals at the end of the tick for which quiet() or calm() returned
  /// true.
  const double *result() const { return result_.data(); }
  /// To be called after quiet(): returns whether a signal is outside its bounds at the start of the
  /// tick.
  bool beyond_now() const;
  /// To be called after quiet() has returned true: returns whether the change of the command, in V,
  /// moves a signal outside its bounds.
  bool beyond_after(double change) const;

  /// To be called after quiet() has returned false: returns one bit for each of the first `wanted`
  /// parts of the grid, set if a signal may reach a bound in that part.
  std::uint64_t doubtful_parts(const double *z, std::size_t wanted);
  /// To be called after quiet() has returned false: runs the second test. Returns true if no switch
  /// changes during the tick.
  bool calm(const double *z);
  /// Finds the first change of a switch from now to `end` ticks, within part `part` of the grid.
  /// Only the channels for which doubtful_parts() has set the bit of this part are searched.
  /// Returns false if no switch changes.
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
  const Mode *calm_mode_ = nullptr;  // last mode in which only the second test passed
  int calm_left_ = 0;
  double rounding_ = kChannelRounding;  // assumed relative rounding error of Taylor coefficients
  kernel::Vector result_;
  kernel::Vector curve_;
  kernel::Vector calm_;
  kernel::Vector grid_signal_;
  kernel::Vector grid_dip_;
  kernel::Vector polynomial_;
  std::vector<double> absolute_;
  // Parts of the grid in which the signal of a channel may reach a bound: one word for each
  // channel, one bit for each part.
  std::vector<std::uint64_t> parts_in_doubt_;
};

}  // namespace forceaxis::sim
