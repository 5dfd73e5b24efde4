#pragma once
// One linear mode of a plant, with the matrices to simulate one step, and the cache that owns all
// modes.
//
// The unit of time is one step of the cache: the tick T = 1/1500 s or an integer fraction of a
// tick. So all matrices contain A T in place of A. Rows of matrices multiply the vector z = (x, 1,
// u).
#include <cstddef>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <unordered_map>
#include <vector>

#include "sim/hybrid/audit.hpp"
#include "sim/hybrid/kernel.hpp"
#include "sim/hybrid/network.hpp"
#include "sim/hybrid/pieces.hpp"

namespace forceaxis::sim {

inline constexpr double kTickRateHz = 1500.0;

/// Error: the simulation cannot continue, because a switch changes without end or a state is not
/// finite. If element and time are known, what() names them.
struct SimulationError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// The matrices of one mode, which never change after the mode is built. Sizes: n states, c = n + 2
/// columns, g channels.
///
/// Quiet test. A tick has K = `samples` equal parts. The matrix `tick` maps z to the state and the
/// ADC signals after one tick and to the signals of all channels at the K + 1 ends of the parts.
/// The matrix `curve` maps |z| to a bound on the deviation of each signal from its chord in a part,
///     (T/K)^2 / 8 max |s''|  with  |s''(t)| <= |r A^2 Phi(t_k)| e^{|A| T/K} |z|   (entrywise),
/// plus the rounding error of both products. If the distance of all signals from their bounds is
/// larger than this deviation, no switch changes during the tick. The test is valid for each
/// channel alone, and for one tick that starts at any instant.
///
/// Second test. The product with |z| adds large terms that cancel in the plant. Examples are the
/// positions of two bodies at a stiff spring, or the current and its command. A channel that fails
/// the quiet test is therefore tested with a second bound,
///     |s''(t)| <= |r A^2 Phi(t_k) z| + (T/K) |r A Phi(t_k)| e^{|A| T/K} |A^2 z|,
/// where the first term is the second derivative at the start of the part, and the second term is
/// from a bound on the third derivative. `calm_head` maps z to A^2 z and to the first term.
/// `calm_tail` maps |A^2 z| to the second term. Both terms are multiplied by (T/K)^2 / 8.
/// `calm_doubt` times the largest |z_j| bounds the rounding error. In A^2 z, bodies at standstill
/// and bodies with equal motion cancel.
///
/// Grid. For channels that fail both tests, the quiet test on a grid of `grid` parts of length
/// `reach` finds the parts in which a switch may change. The state at the start of a part is one
/// matrix product, and within the part the Taylor series of order `order` converges to rounding.
/// `reach` is 1/(8 K) ticks. Modes that are too fast for a quiet test have `samples` = 0, no grid
/// and a smaller `reach`. They are simulated in pieces (Pieces).
///
/// Accuracy of the series. `reach` is halved until the term of order `order` is below 2^-58 N in
/// each entry. N is the influence, the sum over k of (|A| T / s)^k, and s is a power of two, at
/// least 1. Unless s is 1, s is 2 to 5 times the spectral radius of |A| T. The omitted terms then
/// add up to less than 2^-58 N |z|. Let d be the Perron vector of |A| T, so |A| T d = radius d. For
/// a chain of equal bodies and springs, d is the highest frequency for velocities and 1 for
/// positions. In the norm max_j |x_j| / d_j, N is at most 2, so one part changes the state by less
/// than 2^-57 of its norm from the exact flow. This change is a sixteenth of the rounding error
/// 2^-53. The error of a state is relative to the effect of the other states on this state within
/// some time constants, or within a tick. Other states have no effect on the error. The error is
/// not relative to the entries of the flow. For example, only one body of a chain moves, and the
/// motion of a body ten springs away is 1e-30 of this motion. The small motion is not computed
/// correctly, because this would need a smaller `reach`. So `reach` depends on the fastest rate and
/// not on the number of states. Many coupled states need a term more for each 15 states; a grid of
/// 64 parts takes such terms, because a finer grid does not fit into one search. Up to a rate of
/// about 1 per tick, `reach` is 1/8. For faster rates, `reach` is the power of two at which rate
/// times reach is 1/16 to 1/4.
struct Mode {
  ModeKey key = 0;
  std::size_t states = 0;
  std::size_t columns = 0;
  std::size_t channels = 0;
  std::size_t samples = 0;

  /// Number of rows for one value of each channel signal: padded(g).
  std::size_t channel_stride = 0;
  /// Index of the first signal row in `tick`: padded(n + 2).
  std::size_t signal_place = 0;
  /// Number of rows of the matrix `tick`.
  std::size_t tick_stride = 0;
  /// Matrix stored by columns. Its rows give the new state, the ADC signals, and the channel
  /// signals at the ends 0, 1, ..., K of the parts of a tick.
  kernel::Vector tick;
  /// Number of rows of `curve`: samples * channel_stride.
  std::size_t curve_stride = 0;
  /// Matrix, stored by columns, of the bounds on the deviation of each signal from its chord.
  kernel::Vector curve;
  /// Data of the quiet test, with pointers to `tick` and `curve`.
  kernel::QuietTest quiet;
  /// Number of rows of `calm_head`: padded(n) + curve_stride.
  std::size_t calm_stride = 0;
  /// Matrix, stored by columns, that gives A^2 z and the first term of the second test.
  kernel::Vector calm_head;
  /// Matrix, stored by columns, for the second term of the second test.
  kernel::Vector calm_tail;
  /// Rounding error of the second test for each signal and part.
  kernel::Vector calm_doubt;
  /// Data of the second test, with pointers to the matrices above.
  kernel::CalmTest calm;
  /// Lower and upper bound of each channel, narrowed by the rounding error of the bounds.
  kernel::Vector low;
  kernel::Vector high;

  double reach = 1.0;  ///< length of one interval of the time grid in ticks, such as 1/2 or 1/4
  std::size_t order = 0;
  /// Number of rows of one matrix in `taylor`: padded(n).
  std::size_t flow_stride = 0;
  /// Matrices (A T)^k / k! for k = 1..order, one below the other, stored by columns.
  kernel::Vector taylor;
  /// Matrix of g x c elements, stored by rows, that gives the signal of each channel. A row of this
  /// matrix is called r.
  std::vector<double> signal;
  /// Number of rows of a matrix in `series`: padded(order + 1).
  std::size_t series_stride = 0;
  /// For each channel, the rows r (A T)^k / k! for k = 0..order, stored by columns.
  kernel::Vector series;
  /// For each channel and each k = 0..order, the rounding error of a Taylor coefficient, |r| |(A
  /// T)^k / k!| N.
  std::vector<double> doubt;
  std::vector<Channel> channel;
  /// Indices of the channels whose signal changes at a step of the command.
  std::vector<std::size_t> fed;

  std::size_t grid = 0;
  /// Flow matrices over 1, 2, 3, ... parts of the grid, stored by columns.
  kernel::Vector grid_flow;
  std::size_t grid_signal_stride = 0;
  /// For each channel, the matrix of the signal at the ends of all parts, stored by columns.
  kernel::Vector grid_signal;
  std::size_t grid_dip_stride = 0;
  /// For each channel, the matrix of the bounds on the deviation from the chord in all parts,
  /// stored by columns.
  kernel::Vector grid_dip;

  /// Matrices that simulate the mode in pieces. Empty if the mode has a quiet test.
  std::unique_ptr<const Pieces> pieces;

  /// The matrix ModeEquations::slip, stored by rows; empty if no friction sticks.
  std::vector<double> slip;

  EnergyRows energy;
  /// Matrix, stored by columns, with two rows: the signals of ADC 0 and ADC 1.
  kernel::Vector sensor;
  std::vector<double> truth;  ///< matrix, stored by rows, that gives all signals of the model
};

/// Builds each mode when a plant requests it for the first time, and stores the mode. Modes are
/// immutable, so all plants of one model may share a cache in any number of threads. A plant
/// requests only modes that it has not used before.
class ModeCache {
 public:
  /// `parts` is the number of steps of the plant in one tick of the firmware, 1 to kMostParts. A
  /// mode describes one step. With more than one part, a plant outputs analog signals at a higher
  /// rate than the tick rate, for a signal analyzer.
  explicit ModeCache(std::shared_ptr<const Model> model, int parts = 1);
  static constexpr int kMostParts = 64;
  ModeCache(const ModeCache &) = delete;
  ModeCache &operator=(const ModeCache &) = delete;

  const Model &model() const { return *model_; }
  const Network &network() const { return network_; }
  /// Returns the number of steps of the plant per second.
  double rate_hz() const { return kTickRateHz * static_cast<double>(parts_); }
  int parts() const { return parts_; }
  /// Returns the mode with this key. The reference is valid as long as the cache exists. Throws
  /// InputError if a rate of the mode is above about 2e8 1/s, because such a mode cannot be
  /// simulated.
  const Mode &mode(ModeKey key);
  /// Returns the integrals of the powers in the mode with this key, which are built when they are
  /// requested for the first time.
  const EnergyForms &energy_forms(ModeKey key);
  /// Returns the number of modes that the cache has built.
  std::size_t size() const;

 private:
  std::shared_ptr<const Model> model_;
  Network network_;
  int parts_;
  mutable std::mutex mutex_;
  std::unordered_map<ModeKey, std::unique_ptr<const Mode>> modes_;
  std::unordered_map<ModeKey, std::unique_ptr<const EnergyForms>> energy_forms_;
};

}  // namespace forceaxis::sim
