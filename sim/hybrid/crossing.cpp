#include "sim/hybrid/crossing.hpp"

#include "sim/hybrid/kernel.hpp"

namespace forceaxis::sim {
namespace {

using kernel::magnitude;

// A polynomial g(s) on the interval [0, 1].
struct Polynomial {
  const double *q;
  std::size_t degree;
  double noise;       // upper bound of the rounding error in a result of value()
  double whole_bend;  // bound that bend(1) returns

  double value(double s) const {
    double sum = q[degree];
    for (std::size_t k = degree; k-- > 0;) sum = sum * s + q[k];
    return sum;
  }
  double value_and_slope(double s, double *slope) const {
    double sum = q[degree];
    double derivative = 0.0;
    for (std::size_t k = degree; k-- > 0;) {
      derivative = derivative * s + sum;
      sum = sum * s + q[k];
    }
    *slope = derivative;
    return sum;
  }
  // Returns an upper bound of the second derivative |g''| in [0, s].
  double bend(double s) const {
    if (s == 1.0) return whole_bend;
    double sum = 0.0;
    for (std::size_t k = degree; k >= 2; --k)
      sum = sum * s + static_cast<double>(k * (k - 1)) * magnitude(q[k]);
    return sum;
  }
};

// Returns the root of g in [a, b], where g(a) >= 0 > g(b). `bend` is an upper bound of |g''| in [a,
// b].
double refine(const Polynomial &g, double a, double ga, double b, double gb, double bend) {
  double s = a + (b - a) * (ga / (ga - gb));
  double last_width = b - a;
  for (int step = 0; step < 200; ++step) {
    if (!(s > a && s < b)) s = a + 0.5 * (b - a);
    // a and b are neighbouring floating-point numbers, so the search ends
    if (!(s > a && s < b)) break;
    double slope = 0.0;
    const double value = g.value_and_slope(s, &slope);
    if (value >= 0.0) {
      a = s;
      ga = value;
    } else {
      b = s;
      gb = value;
    }
    double next = slope < 0.0 ? s - value / slope : a + 0.5 * (b - a);
    const double move = magnitude(next - s);
    // The error after a Newton step is at most 2 bend move^2 / |slope|, because the distance of the
    // root is at most 2 |move| if bend |move| <= |slope| / 4. The search ends when the error is
    // below the rounding error of s.
    const double error = 2.0 * bend * move * move;
    if (move <= 0x1p-53 * s || magnitude(value) <= 0x1p-54 * g.noise ||
        (next > a && next < b && error <= -0x1p-54 * slope * s)) {
      if (next > a && next < b) s = next;
      return s;
    }
    // At least every third step halves the interval that contains the root.
    if (step % 3 == 2) {
      if (b - a > 0.5 * last_width) next = a + 0.5 * (b - a);
      last_width = b - a;
    }
    s = next;
  }
  return magnitude(ga) < magnitude(gb) && a > 0.0 ? a : b;
}

bool search(const Polynomial &g, double a, double ga, double b, double gb, double *root) {
  const double width = b - a;
  const double bend = g.bend(b);
  if (gb >= 0.0) {
    const double dip = 0.125 * width * width * bend;
    if ((ga > dip && gb > dip) || dip <= g.noise) return false;
  }
  const double middle = a + 0.5 * width;
  if (!(middle > a && middle < b)) {
    *root = b;
    return gb < 0.0;
  }
  double slope = 0.0;
  const double gm = g.value_and_slope(middle, &slope);
  if (magnitude(slope) > 0.5 * width * bend) {
    if (gb >= 0.0) return false;
    *root = refine(g, a, ga, b, gb, bend);
    return true;
  }
  if (search(g, a, ga, middle, gm, root)) return true;
  return search(g, middle, gm, b, gb, root);
}

}  // namespace

bool first_crossing(const double *q, std::size_t degree, double end, double *root) {
  double scaled[64];
  double sum = 0.0;
  double bend = 0.0;
  double power = 1.0;
  double index = 0.0;
  for (std::size_t k = 0; k <= degree; ++k, power *= end, index += 1.0) {
    scaled[k] = q[k] * power;
    const double size = magnitude(scaled[k]);
    sum += size;
    bend += index * (index - 1.0) * size;
  }
  if (scaled[0] >= sum - scaled[0])
    // The polynomial has no root, because the constant term exceeds the sum of all other terms.
    return false;
  // To save time, terms are ignored that are too small to change the sign of the polynomial.
  double dropped = magnitude(scaled[degree]);
  while (degree > 2 && dropped * 0x1p58 < sum) dropped += magnitude(scaled[--degree]);
  const Polynomial g{scaled, degree, 0x1p-50 * sum, bend};
  if (!search(g, 0.0, scaled[0], 1.0, g.value(1.0), root)) return false;
  *root *= end;
  return true;
}

}  // namespace forceaxis::sim
