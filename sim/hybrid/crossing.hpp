#pragma once
// The first sign change of a polynomial, found with a bound that excludes missed roots.
#include <cstddef>

namespace forceaxis::sim {

/// Finds where g(s) = q[0] + q[1] s + ... + q[degree] s^degree, g(0) > 0, first becomes negative on
/// (0, end]. An interval is skipped only if its ends are positive by more than the largest
/// possible dip, (b - a)^2 / 8 max |g''|, or if g is monotone on it; dips below the rounding of g
/// itself (about 1e-15 of its largest term) do not count. Then Newton steps, safeguarded by
/// bisection, go to rounding. Returns false if there is none; otherwise *root is in (0, end].
bool first_crossing(const double *q, std::size_t degree, double end, double *root);

}  // namespace forceaxis::sim
