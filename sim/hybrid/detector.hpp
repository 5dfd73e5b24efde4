#pragma once
// Finds out which switches of a mode change their state in the next tick, and when the first switch
// changes.
#include <cstddef>
#include <cstdint>
#include <vector>

#include "sim/hybrid/kernel.hpp"
#include "sim/hybrid/mode.hpp"

namespace forceaxis::sim {

/// Upper bound of the relative rounding error of a channel's value.
inline constexpr double kChannelRounding = 0x1p-46;

/// Runs the tests that are described at Mode. The caller starts with the fastest test, quiet(),
/// continues with doubtful_parts() and calm(), and then calls first_change() for a part of the
/// tick. The caller owns the vector z = (x, 1, u) and must not change z between these calls. Copies
/// of a detector are independent. No call changes the state of a switch.
class Detector {
 public:
  struct Change {
    std::size_t channel = 0;
    bool above = false;
    double after = 0.0;  ///< time in ticks after which the switch will change, counted from the
                         ///< instant of the state z
  };

  /// Sets the assumed rounding error of Taylor coefficients to `factor` times its normal bound. If
  /// a signal is on a bound, its first coefficient above this rounding error decides whether the
  /// switch changes. The factor is normally 1. The stepper increases the factor for the rest of a
  /// tick in which the states of switches contradict each other.
  void set_doubt(double factor) { rounding_ = factor * kChannelRounding; }

  /// Selects the mode of all further calls. `mode` must exist until the next call of enter().
  void enter(const Mode &mode);

  /// The quiet test. Returns true if certainly no switch changes during the tick that starts at z.
  /// result() then has the state at the end of the tick.
  bool quiet(const double *z) {
    if (mode_->pieces) {
      start_piece(z);
      return passes_piece(z, 0);
    }
    // If only the second test passed in a tick, the second test runs first in the next kCalmTicks
    // ticks of the same mode.
    if (mode_ == calm_mode_ && calm_left_ > 0 && still_calm(z)) return true;
    return quiet_(mode_->quiet, z, result_.data(), curve_.data());
  }
  /// Returns the state and the ADC signals at the end of the tick for which quiet() or calm() has
  /// returned true.
  const double *result() const { return result_.data(); }
  /// Returns true if a signal is outside its bounds at the start of the tick. To be called after
  /// quiet().
  bool beyond_now() const;
  /// Returns true if a change of the command by `change`, in V, moves a signal outside its bounds.
  /// To be called after quiet() has returned true.
  bool beyond_after(double change) const;

  /// Returns one bit for each of the first `wanted` parts of the grid. A bit is set if a signal can
  /// reach a bound in this part. To be called after quiet() has returned false.
  std::uint64_t doubtful_parts(const double *z, std::size_t wanted);
  /// The second test. Returns true if certainly no switch changes during the tick. To be called
  /// after quiet() has returned false.
  bool calm(const double *z);
  /// Prepares the test of pieces that start at z, for a mode with pieces.
  void start_piece(const double *z);
  /// The test of a piece, which is described at Pieces. The piece has 2^-halvings ticks and starts
  /// at the state z. Returns true if certainly no switch changes during the piece. result() then
  /// has the state at its end.
  bool passes_piece(const double *z, std::size_t halvings);
  /// Returns the state and the ADC signals 2^-halvings ticks after the state z, without a test.
  const double *end_of_piece(const double *z, std::size_t halvings);
  /// expect_calm() records that no switch has changed in a tick although quiet() has failed.
  /// expects_calm() returns true if the last such tick was in the same mode and calm() has not
  /// failed since then. In this case, calm() takes less time than doubtful_parts(). The order of
  /// both tests does not affect any result.
  void expect_calm() { expected_calm_ = mode_; }
  bool expects_calm() const { return mode_ == expected_calm_; }
  /// Finds the first change of a switch within the next `end` ticks, which lie in the part `part`
  /// of the grid. Only the channels that can reach a bound in this part are searched;
  /// doubtful_parts() has found these channels. In a mode with pieces, the part 0 is the piece of
  /// the last call of passes_piece(). Returns false if no switch changes.
  bool first_change(const double *z, std::size_t part, double end, Change *found);

 private:
  enum class Verdict { none, at_once, later };

  bool still_calm(const double *z);
  bool passes_second_test(const double *z);
  double piece_rounding(const double *z, std::size_t channel, double bound) const;
  std::uint64_t parts_in_doubt(const double *z, std::size_t channel, std::size_t wanted);
  Verdict examine(const double *z, std::size_t channel, double end, double *root, bool *above);
  Verdict examine_side(std::size_t channel, double bound, double end, double *root);

  kernel::Multiply multiply_ = kernel::best_multiply();
  kernel::Quiet quiet_ = kernel::best_quiet();
  kernel::Calm calm_test_ = kernel::best_calm();
  kernel::Grid grid_ = kernel::best_grid();
  const Mode *mode_ = nullptr;
  const Mode *calm_mode_ = nullptr;  // mode of the plant in which, at the last check, quiet() was
                                     // false and calm() was true
  int calm_left_ = 0;
  const Mode *expected_calm_ = nullptr;
  // Assumed relative rounding error of the Taylor coefficients.
  double rounding_ = kChannelRounding;
  kernel::Vector result_;
  kernel::Vector curve_;
  kernel::Vector calm_;
  kernel::Vector grid_signal_;
  kernel::Vector grid_dip_;
  kernel::Vector polynomial_;
  kernel::Vector piece_head_;
  kernel::Vector piece_sizes_;  // magnitudes |B^2 z|, |w z| and |z| by which a piece of a tick is
                                // checked for changes of a switch
  std::vector<double> absolute_;
  // One word of 64 bits for each channel, with one bit for each part of the time grid. A bit is set
  // if the signal of the channel can reach a bound in this part.
  std::vector<std::uint64_t> parts_in_doubt_;
};

}  // namespace forceaxis::sim
