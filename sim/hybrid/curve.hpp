#pragma once
// Piecewise-linear curves of elements, drives and sensors.
#include <string>
#include <vector>

#include "sim/model/model.hpp"

namespace forceaxis::sim {

/// Coefficients are built in extended precision and rounded to double once, when a mode is made.
using Extended = long double;

/// Segment k lies between breaks[k-1] and breaks[k]; its value is slope * input + offset. Units are
/// the caller's: SI of input and output.
struct Curve {
  struct Segment {
    std::string name;
    Extended slope;
    Extended offset;
  };
  std::vector<Segment> segments;
  std::vector<double> breaks;
  int home = 0;  ///< the segment to start the search from

  /// y = clamp(x, -limit, limit)
  static Curve clamp(double limit);
  /// Odd curve through 0: slope `inner` up to `corner`, `outer` beyond it, clamped to +-limit. An
  /// infinite corner or limit leaves that feature out.
  static Curve amplifier(double inner, double corner, double outer, double limit);
  /// Continuous, 0 at 0; segments named "segment 0", "segment 1", ...
  static Curve through_origin(const Slopes &slopes);
  /// Through (x[k], y[k]), constant beyond the ends.
  static Curve interpolated(const std::vector<double> &x, const std::vector<double> &y);
};

}  // namespace forceaxis::sim
