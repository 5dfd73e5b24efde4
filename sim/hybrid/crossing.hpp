#pragma once
// Finds the first sign change of a polynomial. No root is missed, because the search uses a bound
// on the curvature.
#include <cstddef>

namespace forceaxis::sim {

/// Finds the smallest root in (0, end] at which the polynomial g(s) = q[0] + q[1] s + ... +
/// q[degree] s^degree becomes negative. g(0) must be > 0. The search skips an interval [a, b] in
/// two cases: g is monotone on the interval, or g exceeds (b - a)^2 / 8 max |g''| at a and b. This
/// value is the largest possible dip of g between a and b. A dip below the rounding error of g,
/// about 1e-15 of its largest term, is ignored. Newton steps, with bisection as a safeguard, refine
/// the root to the rounding error. Returns true and the root in
/// *root, or false if g has no such root.
bool first_crossing(const double *q, std::size_t degree, double end, double *root);

}  // namespace forceaxis::sim
