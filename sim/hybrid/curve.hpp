#pragma once
// Piecewise-linear characteristic curves of elements, drives and sensors.
#include <string>
#include <vector>

#include "sim/matrix/extended.hpp"

namespace forceaxis::sim {

struct Slopes;

/// A piecewise-linear function. Segment k lies between breaks[k-1] and breaks[k] and has the value
/// slope * input + offset. Input and output are in SI units.
struct Curve {
  struct Segment {
    std::string name;
    Extended slope;
    Extended offset;
  };
  std::vector<Segment> segments;
  std::vector<double> breaks;
  /// Index of the segment that contains the input 0.
  int home = 0;

  /// Saturation curve: the output is the input, limited to the range -limit to limit.
  static Curve clamp(double limit);
  /// Curve whose output is the magnitude of the input, but at least `least`.
  static Curve dead_size(double least);
  /// Odd curve through the origin with the slope `inner` up to the input `corner`, and the slope
  /// `outer` above `corner`. The output is limited to the range -limit to limit. An infinite
  /// `corner` or `limit` has no effect.
  static Curve amplifier(double inner, double corner, double outer, double limit);
  /// Continuous curve with the value 0 at the input 0. Its segments are named "segment 0", "segment
  /// 1" and so on.
  static Curve through_origin(const Slopes &slopes);
  /// Curve by linear interpolation between the points (x[k], y[k]). The curve is constant before
  /// the first point and after the last point.
  static Curve interpolated(const std::vector<double> &x, const std::vector<double> &y);
  /// Curve that approximates a sine through the origin. Each period of the sine has `segments`
  /// segments, and the curve meets the sine at their ends. The curve has `periods` periods on each
  /// side of the origin and is 0 beyond them.
  static Curve sine(double amplitude, double period, int segments, int periods);
};

}  // namespace forceaxis::sim
