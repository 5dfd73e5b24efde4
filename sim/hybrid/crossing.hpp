#pragma once
// Finds the first sign change of a polynomial. A bound on the curvature excludes missed roots.
#include <cstddef>

namespace forceaxis::sim {

/// Finds the smallest root in (0, end] at which g(s) = q[0] + q[1] s + ... + q[degree] s^degree,
/// with g(0) > 0, becomes negative. The search skips an interval [a, b] only if g exceeds (b - a)^2
/// / 8 max |g''| at both ends, the largest possible dip between them, or if g is monotone on it. A
/// dip below the rounding error of g, about 1e-15 of its largest term, is ignored. Newton steps
/// with bisection as a safeguard then refine the root to rounding. Returns true and the root in
/// *root, or false if g has no such root.
bool first_crossing(const double *q, std::size_t degree, double end, double *root);

}  // namespace forceaxis::sim
