#include "sim/hybrid/curve.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "sim/model/elements/slopes.hpp"

namespace forceaxis::sim {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

}  // namespace

Curve Curve::clamp(double limit) {
  Curve curve;
  curve.segments = {{"low limit", 0, -static_cast<Extended>(limit)},
                    {"linear", 1, 0},
                    {"high limit", 0, static_cast<Extended>(limit)}};
  curve.breaks = {-limit, limit};
  curve.home = 1;
  return curve;
}

Curve Curve::dead_size(double least) {
  Curve curve;
  curve.segments = {{"negative", -1, 0}, {"small", 0, least}, {"positive", 1, 0}};
  curve.breaks = {-least, least};
  curve.home = 1;
  return curve;
}

Curve Curve::amplifier(double inner, double corner, double outer, double limit) {
  const Extended k = inner;
  const Extended ko = outer;
  // Output at the input 0 if the straight line above the corner is extended to this input.
  const Extended step = (k - ko) * static_cast<Extended>(corner);
  Curve curve;
  curve.segments = {{"inner", k, 0}};
  const auto wrap = [&curve](const char *name, Extended slope, Extended offset, Extended at) {
    curve.segments.insert(curve.segments.begin(), {std::string("low ") + name, slope, -offset});
    curve.segments.push_back({std::string("high ") + name, slope, offset});
    curve.breaks.insert(curve.breaks.begin(), -static_cast<double>(at));
    curve.breaks.push_back(static_cast<double>(at));
    ++curve.home;
  };
  const bool corner_first =
      corner < kInfinity && k * static_cast<Extended>(corner) < static_cast<Extended>(limit);
  if (corner_first) wrap("outer", ko, step, corner);
  if (limit < kInfinity) {
    const Extended top = limit;
    if (!corner_first)
      wrap("limit", 0, top, top / k);
    else if (ko > 0)
      wrap("limit", 0, top, (top - step) / ko);
  }
  return curve;
}

Curve Curve::through_origin(const Slopes &given) {
  Curve curve;
  curve.breaks = given.breaks;
  curve.home = static_cast<int>(
      std::count_if(given.breaks.begin(), given.breaks.end(), [](double at) { return at < 0.0; }));
  for (std::size_t k = 0; k < given.slopes.size(); ++k)
    curve.segments.push_back({"segment " + std::to_string(k), given.slopes[k], 0});
  // Two neighbouring segments have the same output at the break between them. The segment at the
  // origin has no offset.
  const auto home = static_cast<std::size_t>(curve.home);
  const auto meet = [&curve](std::size_t next, std::size_t known, double at) {
    Curve::Segment &segment = curve.segments[next];
    const Curve::Segment &neighbour = curve.segments[known];
    segment.offset =
        neighbour.offset + (neighbour.slope - segment.slope) * static_cast<Extended>(at);
  };
  for (std::size_t k = home; k < given.breaks.size(); ++k) meet(k + 1, k, given.breaks[k]);
  for (std::size_t k = home; k-- > 0;) meet(k, k + 1, given.breaks[k]);
  return curve;
}

Curve Curve::interpolated(const std::vector<double> &x, const std::vector<double> &y) {
  Curve curve;
  curve.breaks = x;
  curve.segments.push_back({"segment 0", 0, y.front()});
  for (std::size_t k = 1; k < x.size(); ++k) {
    const Extended slope = (static_cast<Extended>(y[k]) - static_cast<Extended>(y[k - 1])) /
                           (static_cast<Extended>(x[k]) - static_cast<Extended>(x[k - 1]));
    const Extended offset = static_cast<Extended>(y[k]) - slope * static_cast<Extended>(x[k]);
    curve.segments.push_back({"segment " + std::to_string(k), slope, offset});
  }
  curve.segments.push_back({"segment " + std::to_string(x.size()), 0, y.back()});
  return curve;
}

Curve Curve::sine(double amplitude, double period, int segments, int periods) {
  std::vector<double> x;
  std::vector<double> y;
  for (int k = -segments * periods; k <= segments * periods; ++k) {
    // the curve has no breakpoint at 0, so that one segment goes through the origin
    if (k == 0) continue;
    x.push_back(period * k / segments);
    y.push_back(amplitude * std::sin(2.0 * std::numbers::pi * (k % segments) / segments));
  }
  Curve curve = interpolated(x, y);
  curve.home = segments * periods;
  curve.segments[static_cast<std::size_t>(curve.home)].offset = 0;
  return curve;
}

}  // namespace forceaxis::sim
