#pragma once
// One linear mode of a plant, prepared for stepping, and the cache that owns modes.
//
// Time is counted in ticks here, T = 1/1500 s or a whole part of it: all matrices hold A T. Rows
// act on z = (x, 1, u).
#include <cstddef>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <unordered_map>
#include <vector>

#include "sim/hybrid/kernel.hpp"
#include "sim/hybrid/network.hpp"

namespace forceaxis::sim {

inline constexpr double kTickRateHz = 1500.0;

/// The plant cannot be stepped on: chattering, or a state that is not finite. what() names the
/// element and the time where they are known.
struct SimulationError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Immutable once built. Sizes: n states, c = n + 2 columns, g channels.
///
/// Quiet tick. With K = `samples` equal parts of a tick, `tick` maps z to the state and the ADCs'
/// signals after one tick and to every channel's signal at the K + 1 ends of the parts; `curve`
/// maps |z| to a bound on how far a signal can leave its chord within each part,
///     (T/K)^2 / 8 max |s''|  with  |s''(t)| <= |r A^2 Phi(t_k)| e^{|A| T/K} |z|   (entrywise),
/// plus the rounding of both sums. If all signals stay within their bounds by more than that, no
/// switch changes within the tick. The same holds for each channel by itself, and for a tick's time
/// from any instant.
///
/// In |z| large terms that cancel in the plant do not: two bodies behind a stiff spring, the
/// current and its command. So what fails is tried once more with
///     |s''(t)| <= |r A^2 Phi(t_k) z| + (T/K) |r A Phi(t_k)| e^{|A| T/K} |A^2 z|,
/// the second derivative at the part's start and a bound on the third: `calm_head` maps z to A^2 z
/// and to the first term, `calm_tail` |A^2 z| to the second (both times (T/K)^2 / 8), and
/// `calm_doubt` times the largest |z_j| bounds all the rounding. Whatever stands still or moves as
/// one cancels.
///
/// Other ticks. For the channels that fail, the same test on `grid` parts of length `reach` finds
/// the parts in which something may happen; the flow to the start of one is one product, and within
/// it the Taylor series of order `order` converges to rounding. `reach` = 1/(8 K) ticks; modes too
/// fast for a quiet test (`samples` 0) have smaller ones, and the grid covers but the next few.
///
/// Accuracy of the series. The part (`reach`) is halved until the term of order `order` is below
/// 2^-58 of the influence N = sum over k of (|A| T / s)^k, entry by entry, where s (a power of two,
/// at least 1) lies between 2 and 5 times the spectral radius of |A| T or is 1. The terms left out
/// then add up to less than 2^-58 N |z|. In the units in which the rows of |A| T balance (its
/// Perron vector d: |A| T d = radius d; a chain of equal bodies and springs: velocities by the
/// fastest frequency, positions by 1) N's norm is 2 at most, so that one part changes the state by
/// less than 2^-57 max_j |x_j| / d_j beyond the exact flow, a sixteenth of a rounding (2^-53) of
/// the state in that norm. Entry by entry, an error in a state is that share of what the others can
/// make of it within some time constants (or within a tick): states that do not act on it do not
/// count, whatever their size. It is not relative to the entries of the flow itself: the first stir
/// of a body ten springs away from the only one that moves, 1e-30 of that one's motion, is not
/// resolved, and asking for it would halve the part for nothing that the dynamics needs. So `reach`
/// follows from the fastest rate alone, whatever the number of states: 1/8 up to about one per
/// tick, then the power of two that makes rate times reach 1/16 to 1/4.
struct Mode {
  ModeKey key = 0;
  std::size_t states = 0;
  std::size_t columns = 0;
  std::size_t channels = 0;
  std::size_t samples = 0;

  std::size_t channel_stride = 0;  ///< padded(g)
  std::size_t signal_place = 0;    ///< padded(n + 2)
  std::size_t tick_stride = 0;     ///< signal_place + (samples + 1) channel_stride
  kernel::Vector tick;             ///< by columns: new state, ADCs, signals at part 0, 1, ..., K
  std::size_t curve_stride = 0;    ///< samples channel_stride
  kernel::Vector curve;            ///< by columns
  kernel::QuietTest quiet;         ///< of these
  std::size_t calm_stride = 0;     ///< padded(n) + curve_stride
  kernel::Vector calm_head;        ///< by columns: A^2 z, then the rows of `curve`
  kernel::Vector calm_tail;        ///< by n columns, the rows of `curve`
  kernel::Vector calm_doubt;       ///< the rows of `curve`
  kernel::Vector low;              ///< per channel, pulled in by the bounds' own rounding; padded
  kernel::Vector high;

  double reach = 1.0;  ///< ticks, 1 / 2^k
  std::size_t order = 0;
  std::size_t flow_stride = 0;    ///< padded(n)
  kernel::Vector taylor;          ///< (A T)^k / k!, k = 1..order below each other, by columns
  std::vector<double> signal;     ///< channel rows r, g x c by rows
  std::size_t series_stride = 0;  ///< padded(order + 1)
  kernel::Vector series;          ///< [channel]: r (A T)^k / k!, k = 0..order, by columns
  std::vector<double> doubt;      ///< [channel][k]: |r| |(A T)^k / k!| N, k = 0..order
  std::vector<Channel> channel;
  std::vector<std::size_t> fed;  ///< channels that the command acts on at once

  std::size_t grid = 0;
  kernel::Vector grid_flow;  ///< [k]: state after k + 1 parts, by columns of flow_stride
  std::size_t grid_signal_stride = 0;
  kernel::Vector grid_signal;  ///< [channel]: signal at part 0..grid, by columns
  std::size_t grid_dip_stride = 0;
  kernel::Vector grid_dip;  ///< [channel]: bound on leaving the chord in each part, by columns

  std::vector<double> slip;  ///< ModeEquations::slip by rows, n x n, or empty

  kernel::Vector sensor;      ///< by columns, 2 rows: what ADC 0 and ADC 1 convert
  std::vector<double> truth;  ///< all signals of the model, by rows
};

/// Energy bookkeeping of one mode: integrals over a whole tick as quadratic forms in z.
struct ModeAudit {
  std::size_t form_stride = 0;      ///< padded(supplies + dampers)
  kernel::Vector forms;             ///< [column j][row i][supplies then dampers]: J
  std::vector<double> first;        ///< rows of supplies then dampers, first factor
  std::vector<double> second;       ///< second factor
  std::vector<double> store_first;  ///< rows of the storages
  std::vector<double> store_second;
  std::vector<double> store_constant;  ///< per storage, J
};

/// Builds each mode at its first request and keeps it. Plants of one model may share a cache, from
/// any number of threads: modes are immutable, and a plant requests only modes new to it.
class ModeCache {
 public:
  /// `parts`: steps of the plant in one tick of the firmware, 1..kMostParts; modes hold one step.
  /// More than one is for analog signals, which an analyzer samples faster than the controller.
  explicit ModeCache(std::shared_ptr<const Model> model, int parts = 1);
  static constexpr int kMostParts = 64;
  ModeCache(const ModeCache &) = delete;
  ModeCache &operator=(const ModeCache &) = delete;

  const Model &model() const { return *model_; }
  const Network &network() const { return network_; }
  /// Steps a second.
  double rate_hz() const { return kTickRateHz * static_cast<double>(parts_); }
  int parts() const { return parts_; }
  /// Throws InputError if the mode is too fast (rates above about 1.2e7 / s). The reference is
  /// valid as long as the cache.
  const Mode &mode(ModeKey key);
  const ModeAudit &audit(ModeKey key);
  /// Number of modes built so far.
  std::size_t size() const;

 private:
  std::shared_ptr<const Model> model_;
  Network network_;
  int parts_;
  mutable std::mutex mutex_;
  std::unordered_map<ModeKey, std::unique_ptr<const Mode>> modes_;
  std::unordered_map<ModeKey, std::unique_ptr<const ModeAudit>> audits_;
};

}  // namespace forceaxis::sim
