#pragma once
// The flow of a mode with very fast states, for pieces of 1, 1/2, 1/4, ... ticks.
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "sim/hybrid/kernel.hpp"
#include "sim/matrix/extended.hpp"

namespace forceaxis::sim {

/// The matrices that simulate a mode in pieces. Sizes: n states, c = n + 2 columns, g channels, f
/// fast modes. The unit of time is one tick, and piece k has the length h = 2^-k.
///
/// A light body between springs and dampers moves up to a million times faster than the rest of the
/// plant, but only for a short time after a switch has changed. Then it follows its neighbours. The
/// pieces may therefore be long as soon as the fast motion has decayed, although a Taylor series
/// converges only within a part of about the shortest time constant.
///
/// Test of a piece. The flow A is the sum of a slow flow B and of fast modes with eigenvalue l,
/// right vector v and left vector w (sim/matrix/extended.hpp). For a signal s = r z,
///     s(t) = r e^{B t} (z - sum of v w z) + sum of r v e^{l t} w z.
/// Between the ends of a piece, the signal deviates from its chord by at most
///     h^2/8 (|r B^2 z| + h |r B| e^{|B| h} |B^2 z|)              from the slow part, and
///     |r v| |w z| min(|l|^2 h^2 / 8, 2) max(1, |e^{l h}|)        from each fast mode,
/// plus the rounding error of all products. In B^2 z, the large forces on a light body cancel,
/// because B does not have the mode in which these forces act. If the signal, with this deviation,
/// is within its bounds, no switch changes during the piece.
///
/// A signal may be on its bound for a long time. The test also passes if the signal is beyond its
/// bound by less than the rounding error of the state, as in Detector::first_change().
struct Pieces {
  /// Returns the length of a piece in ticks.
  static double length(std::size_t halvings) {
    return 1.0 / static_cast<double>(std::uint64_t{1} << halvings);
  }

  /// The finest piece has 2^-halvings ticks, which is Mode::reach.
  std::size_t halvings = 0;
  std::size_t fast = 0;  ///< number of fast modes; a conjugate pair counts as one mode

  /// Matrix stored by columns. Its rows give B^2 z, r B^2 z, the real and imaginary parts of w z,
  /// and the signals r z.
  kernel::Vector head;
  std::size_t head_stride = 0;
  std::size_t bend_place = 0;   ///< index of the first row of the matrix `head` that gives r B^2 z,
                                ///< the second derivatives of the signals
  std::size_t fast_place = 0;   ///< index of the first row of the matrix `head` that gives w z, the
                                ///< amplitudes of the fast modes
  std::size_t start_place = 0;  ///< index of the first row of the matrix `head` that gives r z, the
                                ///< values of the signals

  /// For each piece 0..halvings, the matrix, stored by columns, whose rows give the state, the ADC
  /// signals and the channel signals at the end of the piece.
  std::vector<kernel::Vector> flow;
  std::size_t flow_stride = 0;
  /// Index of the first row of `flow` that computes a channel signal.
  std::size_t signal_place = 0;

  /// For each piece, the matrix, stored by columns, that maps (|B^2 z|, |w z|, |z|) to the
  /// deviation of each signal, without the term |r B^2 z|.
  std::vector<kernel::Vector> bound;
  std::size_t bound_stride = 0;
};

/// Builds the pieces of a mode. `a` is the square flow matrix, with the tick as unit of time. `r`
/// has a row for each channel, and `sensor` a row for each ADC. A Taylor series of the order
/// kHighestOrder is accurate in a piece of 2^-halvings ticks.
std::unique_ptr<const Pieces> build_pieces(const ExtendedMatrix &a, const ExtendedMatrix &r,
                                           const ExtendedMatrix &sensor, std::size_t halvings);

}  // namespace forceaxis::sim
