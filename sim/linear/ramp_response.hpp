#pragma once
// The response of force loops to a force set-point that rises as a ramp.
//
// With an integral action that is slower than the loop, the force settles slowly; with a faster
// one, the force overshoots. The bandwidth does not show these two effects. The set-point is a
// periodic trapezoid of 30 ramp times, so the response is a sum of odd harmonics.
#include <complex>
#include <limits>
#include <span>
#include <vector>

#include "sim/linear/force_plant.hpp"
#include "sim/linear/law_shape.hpp"

namespace forceaxis::sim {

class RampResponse {
 public:
  /// `delays_ticks` has the delays of the loop in ticks. `ramp_s` is the rise time of the set-point
  /// in s.
  RampResponse(std::span<const ForcePlant *const> plants, std::span<const int> delays_ticks,
               double ramp_s);
  /// Returns the largest excess of the force over the permitted band about the set-point, over all
  /// plants and delays. The excess is a fraction of the set-point, and 0 if the force stays within
  /// the band. The force may be at most 5.5 % above the set-point. It may be at most 2 % below the
  /// set-point from 1.25 to 1.6 ramp times, and at most 2.5 % below after that. Loops after the
  /// first one with an excess above `most` are not computed.
  double excess(const LawShape &law, double gain,
                double most = std::numeric_limits<double>::infinity()) const;

  /// Two numbers, one for each of two loops that are computed at the same time.
  using Pair [[gnu::vector_size(16)]] = double;
  struct ComplexPair {
    Pair re, im;
  };

 private:
  double tick_s_;
  std::size_t harmonics_ = 0;
  // Values tan(pi f T) of all harmonics, followed by those of their alias frequencies (alias_of).
  std::vector<double> w_;
  std::vector<std::complex<double>> setpoint_;  // spectrum of the set-point
  std::vector<ComplexPair> plants_;  // responses of all plants with their delay; each element of
                                     // the vector has two responses
};

}  // namespace forceaxis::sim
