#pragma once
// Evaluates force laws over a set of plants. Computes the largest gain that keeps the margins. Also
// computes the bandwidths and margins at a given gain.
//
// Each plant has its own frequency grid. This grid is dense near the poles and zeros of the plant,
// because a resonance is narrower than the steps of a common grid. L is the loop gain with a law of
// the gain 1, and g is the gain of the law. S = 1 / (1 + g L) is the sensitivity function, and T =
// g L / (1 + g L) is the response of the closed loop.
//
// The condition that |1 + g L| is above a bound is quadratic in g at each frequency. The largest
// gain is therefore computed without iteration. A loop that is stable at
// small gains is stable up to this gain, because the curve of g L does not pass through -1 at a
// smaller gain.
#include <atomic>
#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "sim/linear/force_plant.hpp"
#include "sim/linear/law_shape.hpp"
#include "sim/linear/ramp_response.hpp"

namespace forceaxis::sim {

/// Bounds that all loops have to keep. Infinity means no bound.
struct LawBounds {
  std::vector<double> ms;         ///< largest permitted |S|, above 1, with each delay of the loop
  double gain_margin = 1.0;       ///< smallest permitted gain margin, as a factor
  double phase_margin_deg = 0.0;  ///< smallest permitted phase margin in degrees; 0: no bound

  /// Largest permitted gain at high frequency in DAC codes per 8-bit count.
  double hf_gain = std::numeric_limits<double>::infinity();
};

/// The largest gain that the bounds permit, and the point of the grid at which a bound is reached.
struct GainLimit {
  enum class Bound { hf, ms, gm, pm };
  double gain = 0.0;
  Bound bound = Bound::hf;
  std::size_t plant = 0, delay = 0;  ///< index of the plant and index of the delay whose loop has
                                     ///< this bound; not used for Bound::hf
  double frequency_hz = 0.0;
  /// Smallest gain that the bounds permit. It is 0 unless plant and law have an integral each: such
  /// a loop has little phase margin at low frequency if its gain is small.
  double least = 0.0;
};

/// Figures of a stable loop with one delay around one plant. The stability is not checked.
struct LoopFigures {
  /// First frequency at which |S| rises above -3 dB: 0 if |S| is above at the lowest frequency of
  /// the grid, and half the tick rate if |S| stays below.
  double fS_hz;
  /// Last frequency at which |T| falls below -3 dB: 0 if |T| is below at all frequencies of the
  /// grid, and half the tick rate if |T| is above at the last one.
  double fT_hz;
  double Ms;                ///< largest magnitude of the sensitivity function, |S|
  double gain_margin;       ///< gain margin as a factor; infinity if no larger gain is unstable
  double phase_margin_rad;  ///< phase margin with the smallest magnitude; infinity if |L| reaches 1
                            ///< at no frequency
};

/// Figures of one loop that are not limited by the steps of a grid: roots and peaks are searched
/// for between the points of the grid. Relative errors are about 1e-9.
///
/// Over a bus, |S| and the margins are those of the loop that is sampled once in a cycle. |T| is |L
/// / (1 + L)|. This is the response of the reading in place of the force, to a set-point that acts
/// once in a cycle. So fT differs by some per cent from that of the lifted loop.
struct PreciseFigures {
  /// True if the loop is known to be stable: plant and law are stable, an integral acts with the
  /// sign that reduces the error, and no gain up to the given gain brings the curve of the loop to
  /// -1. Otherwise the other fields are 0, and the stability must be decided from the poles of the
  /// loop. This is also so for a loop with a pole, a zero or a bandwidth below the lowest frequency
  /// of the grid.
  bool known_stable = false;
  double fS_hz = 0;  ///< first frequency at which |S| rises above -3 dB; infinity if |S| stays
                     ///< below -3 dB
  double fT_hz = 0;  ///< last frequency at which |T| falls below -3 dB; infinity if |T| stays above
                     ///< -3 dB
  double Ms = 0;
  double gain_margin = 0;
  double phase_margin_rad = 0;
  bool sag = false;  ///< true if |T| falls below -3 dB already at a frequency below fS_hz
};

/// The bandwidth of a law over the set of plants, and the largest gain that keeps the bounds.
struct LawValue {
  double bandwidth_hz = 0.0;
  double gain = 0.0;
};

class LawGrid {
 public:
  /// `delays_ticks` has the delays of the loop in ticks. `density` is the ratio of the number of
  /// grid points to that of a full grid. Figures of a full grid have a relative error of about
  /// 0.001.
  LawGrid(std::vector<ForcePlant> plants, std::vector<int> delays_ticks, double density);

  const std::vector<ForcePlant> &plants() const { return plants_; }
  std::span<const double> frequency_hz(std::size_t plant) const;
  /// Returns the response of a plant in 8-bit counts per DAC code at its grid frequencies.
  std::vector<std::complex<double>> response(std::size_t plant) const;

  /// Returns the largest magnitude of a law without its integral part at the grid frequencies.
  double noise_gain(const LawShape &law) const;
  /// Returns the largest gain that the bounds permit for each plant alone. `hf_gain` is the gain of
  /// the law at high frequency. The result is 0 if no gain keeps the bounds.
  std::vector<GainLimit> limits(const LawShape &law, double hf_gain, const LawBounds &bounds) const;
  /// Returns the result of limits() with the smallest gain. Its gain is 0 if GainLimit::least of
  /// another plant is larger.
  GainLimit largest_gain(const LawShape &law, double hf_gain, const LawBounds &bounds) const;
  /// Returns the figures of all loops at a gain, one plant after another, each with all delays.
  std::vector<LoopFigures> figures(const LawShape &law, double gain) const;
  /// Returns the precise figures of the loop around a plant with a delay at a gain.
  PreciseFigures precise(const LawShape &law, double gain, std::size_t plant,
                         std::size_t delay) const;
  /// Returns the value of a law for a search: the smallest bandwidth at 0.97 times the largest
  /// gain, where |S| and, for a law with an integral, |T| are within -3 dB. With a `ramp`, the
  /// bandwidth is reduced if the force does not follow the ramp. A bandwidth below `floor_hz` may
  /// be too large, because the evaluation ends when the bandwidth is known to be below `floor_hz`.
  LawValue evaluate(const LawShape &law, const LawBounds &bounds, const RampResponse *ramp,
                    double floor_hz) const;

 private:
  struct Loop;
  struct Turned;
  struct Curve;
  class Precise;
  class Sight;  // computes the loop gain of one loop at any frequency
  void add_frequency(double w);
  void add_aliases(const Turned &apart, std::size_t at, Turned &sum, std::size_t to,
                   std::size_t points) const;
  Loop loop_of_one() const;
  void compute(const LawShape &law, std::size_t plant, std::size_t first, Loop &loop) const;
  Curve curve(const Loop &loop, std::size_t first, std::size_t plant, std::size_t delay) const;
  void reduce(GainLimit &limit, const LawShape &law, const Curve &curve, std::size_t plant,
              std::size_t delay, const LawBounds &bounds) const;

  std::vector<ForcePlant> plants_;
  std::vector<int> delays_;
  double tick_s_;
  // Number of alias frequencies of each grid point: the number of ticks of a bus cycle, or 1
  // without a bus.
  std::size_t aliases_;
  // Index of the first grid point of each plant. The last element is the number of all points.
  std::vector<std::size_t> begin_;
  // For each plant: true if the plant has an integral, which is a pole at frequency 0.
  std::vector<bool> integrates_;
  // Frequency of each grid point in Hz.
  std::vector<double> hz_;
  // Values for each alias frequency of each grid point: w = tan(pi f T), real and imaginary part of
  // z, and real and imaginary part of the plant's response with its bus. For each plant, the arrays
  // first have all points at the first alias frequency, then all points at the second one, and so
  // on.
  std::vector<double> w_, cosine_, sine_, real_, imag_;
  // Plant that ended the last evaluation early. The next evaluation begins with this plant, because
  // it probably ends that evaluation too. The order of the plants changes no result above
  // `floor_hz`.
  mutable std::atomic<std::size_t> ends_early_{0};
};

}  // namespace forceaxis::sim
