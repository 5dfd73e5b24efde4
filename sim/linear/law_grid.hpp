#pragma once
// Evaluates force laws over a set of plants: the largest gain that keeps the margins, bandwidths
// and margins at a gain.
//
// Each plant has its own grid of frequencies, which is dense near its poles and zeros, because a
// resonance is narrower than the steps of a common grid. S = 1 / (1 + g L) is the sensitivity
// function and T = g L / (1 + g L) the closed loop, for the gain g and the loop L with the gain 1.
//
// The conditions |1 + g L| above a bound and |T| below a bound are quadratic in g at each
// frequency. The largest gain is therefore computed without iteration. A loop that is stable at
// small gains is stable up to this gain, because the curve of g L does not pass through -1 at a
// smaller gain.
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
  std::vector<double> ms;                               ///< largest |S| for each delay of the loop
  double mt = std::numeric_limits<double>::infinity();  ///< largest |T|
  double gain_margin = 1.0;                             ///< factor
  double phase_margin_deg = 0.0;                        ///< 0: no bound
  double hf_gain = std::numeric_limits<double>::infinity();  ///< DAC codes per 8-bit count
};

/// The largest gain that the bounds permit, and the point of the grid at which a bound is reached.
struct GainLimit {
  enum class Bound { hf, ms, mt, gm, pm };
  double gain = 0.0;
  Bound bound = Bound::hf;
  std::size_t plant = 0, delay = 0;  ///< indices; not used for Bound::hf
  double frequency_hz = 0.0;
};

/// Figures of the loops with one delay around one plant.
struct LoopFigures {
  double fS_hz;       ///< first frequency at which |S| rises above -3 dB; 0 at the lowest frequency
  double fT_hz;       ///< first frequency at which |T| falls below -3 dB
  double last_fT_hz;  ///< last frequency at which |T| falls below -3 dB; 0 if |T| is never above
  double Ms, Mt;      ///< largest |S| and |T|
  double gain_margin;       ///< factor; infinity if the loop has no gain margin
  double phase_margin_rad;  ///< smallest magnitude; infinity if |L| is 1 at no frequency
};

/// Figures of one loop that are not limited by the steps of a grid: roots and peaks are searched
/// for between the points of the grid. Relative errors are about 1e-9.
struct PreciseFigures {
  /// Whether the loop is known to be stable: the plant is stable, and no gain up to the given gain
  /// brings the curve of the loop to -1. Otherwise the other fields are 0, and poles have to
  /// decide.
  bool known_stable = false;
  double fS_hz = 0;  ///< as in LoopFigures; infinity if |S| stays below -3 dB
  double fT_hz = 0;  ///< last frequency at which |T| falls below -3 dB; infinity if it stays above
  double Ms = 0;
  double gain_margin = 0;
  double phase_margin_rad = 0;
  bool sag = false;  ///< |T| is below -3 dB at a frequency below fS_hz
};

/// The bandwidth of a law over the set of plants, and the largest gain that keeps the bounds.
struct LawValue {
  double bandwidth_hz = 0.0;
  double gain = 0.0;
};

class LawGrid {
 public:
  /// `delays_ticks`: delays of the loop. `density`: ratio of the number of grid points to that of a
  /// full grid. Figures of a full grid have a relative error of about 0.001.
  LawGrid(std::vector<ForcePlant> plants, std::vector<int> delays_ticks, double density);

  const std::vector<ForcePlant> &plants() const { return plants_; }
  std::span<const double> frequency_hz(std::size_t plant) const;
  /// Returns the response of a plant in 8-bit counts per DAC code at its grid frequencies.
  std::vector<std::complex<double>> response(std::size_t plant) const;

  /// Returns the largest magnitude of a law without its integral part at the grid frequencies.
  double noise_gain(const LawShape &law) const;
  /// Returns the largest gain that the bounds permit for each plant alone. `hf_gain`: gain of the
  /// law at high frequency.
  std::vector<GainLimit> limits(const LawShape &law, double hf_gain, const LawBounds &bounds) const;
  /// Returns the smallest one of limits().
  GainLimit largest_gain(const LawShape &law, double hf_gain, const LawBounds &bounds) const;
  /// Returns the figures of all loops at a gain, one plant after another, each with all delays.
  std::vector<LoopFigures> figures(const LawShape &law, double gain) const;
  /// Returns the precise figures of the loop around a plant with a delay at a gain.
  PreciseFigures precise(const LawShape &law, double gain, std::size_t plant,
                         std::size_t delay) const;
  /// Returns the value of a law for a search: the smallest bandwidth at 0.97 times the largest
  /// gain, where |S| and, for a law with an integral, |T| are within -3 dB. A `ramp` reduces the
  /// bandwidth if the force does not follow it. The ramp is not computed for a bandwidth below
  /// `floor_hz`.
  LawValue evaluate(const LawShape &law, const LawBounds &bounds, const RampResponse *ramp,
                    double floor_hz) const;

 private:
  struct Loop;
  struct Curve;
  class Precise;
  class Sight;  // one loop at any frequency
  Loop loop_of_one() const;
  void compute(const LawShape &law, std::size_t plant, std::size_t first, Loop &loop) const;
  Curve curve(const Loop &loop, std::size_t first, std::size_t plant, std::size_t delay) const;
  static void reduce(GainLimit &limit, const Curve &curve, std::size_t plant, std::size_t delay,
                     const LawBounds &bounds);

  std::vector<ForcePlant> plants_;
  std::vector<int> delays_;
  double tick_s_;
  std::vector<std::size_t> begin_;  // index of the first point of each plant, and of the end
  // Of each point: frequency, w = tan(pi f T), real and imaginary part of the plant's response.
  std::vector<double> hz_, w_, real_, imag_;
};

}  // namespace forceaxis::sim
