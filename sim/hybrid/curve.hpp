#pragma once
// Piecewise-linear curves of elements, drives and sensors.
#include <string>
#include <vector>

#include "sim/model/model.hpp"

namespace forceaxis::sim {

/// The coefficients of a mode are computed in extended precision and rounded to double once.
using Extended = long double;

/// A piecewise-linear function. Segment k lies between breaks[k-1] and breaks[k] and has the value
/// slope * input + offset. Input and output are in the SI units of the quantities that the caller
/// connects.
struct Curve {
  struct Segment {
    std::string name;
    Extended slope;
    Extended offset;
  };
  std::vector<Segment> segments;
  std::vector<double> breaks;
  int home = 0;  ///< index of the segment that contains the input 0

  /// Saturation: y = x, limited to the range -limit to limit.
  static Curve clamp(double limit);
  /// Odd curve through the origin with slope `inner` up to the input `corner` and slope `outer`
  /// above it, limited to the output range -limit to limit. An infinite corner or limit omits that
  /// part of the curve.
  static Curve amplifier(double inner, double corner, double outer, double limit);
  /// Continuous curve with the value 0 at the input 0. Its segments are named "segment 0", "segment
  /// 1" and so on.
  static Curve through_origin(const Slopes &slopes);
  /// Linear interpolation between the points (x[k], y[k]), constant outside their range.
  static Curve interpolated(const std::vector<double> &x, const std::vector<double> &y);
};

}  // namespace forceaxis::sim
