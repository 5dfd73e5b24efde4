#include "sim/matrix/hessenberg.hpp"

#include <algorithm>
#include <cstddef>
#include <vector>

#include "sim/matrix/wide.hpp"

namespace forceaxis::sim {
namespace {

// The same operations are computed for this number of points at once.
constexpr std::size_t kLanes = 4;
using Numbers [[gnu::vector_size(kLanes * sizeof(double)), gnu::aligned(8)]] = double;
struct Lanes {
  Numbers re, im;
};

// `left` has the rows of the matrix [-H, B], n x (n + inputs). `work` has as many values for the
// present points.
struct Elimination {
  std::size_t n, wide;
  const double *left;
  Lanes *work;
};

// Multiplies `value` by the reciprocal of `divisor`.
[[gnu::always_inline]] inline void divide(Lanes &value, const Lanes &divisor) {
  const Numbers size = divisor.re * divisor.re + divisor.im * divisor.im;
  const Numbers re = divisor.re / size;
  const Numbers im = -divisor.im / size;
  const Numbers before = value.re;
  value.re = before * re - value.im * im;
  value.im = before * im + value.im * re;
}

[[gnu::always_inline]] inline void subtract(Lanes &from, const Lanes &a, const Lanes &b) {
  from.re -= a.re * b.re - a.im * b.im;
  from.im -= a.re * b.im + a.im * b.re;
}

// Exchanges two rows, from the column `begin` on, for each point whose lower row has the larger
// pivot.
[[gnu::always_inline]] inline void pivot(Lanes *upper, Lanes *lower, std::size_t begin,
                                         std::size_t end) {
  const Lanes high = upper[begin];
  const Lanes low = lower[begin];
  const Numbers high_size = (high.re < 0 ? -high.re : high.re) + (high.im < 0 ? -high.im : high.im);
  const Numbers low_size = (low.re < 0 ? -low.re : low.re) + (low.im < 0 ? -low.im : low.im);
  const auto exchanged = low_size > high_size;
  for (std::size_t j = begin; j < end; ++j) {
    const Lanes a = upper[j];
    const Lanes b = lower[j];
    upper[j].re = exchanged ? b.re : a.re;
    upper[j].im = exchanged ? b.im : a.im;
    lower[j].re = exchanged ? a.re : b.re;
    lower[j].im = exchanged ? a.im : b.im;
  }
}

// Computes (s I - H)^-1 B at the points s into the columns n, n + 1, ... of `work`.
[[gnu::always_inline]] inline void solve(const Elimination &e, const Lanes &points) {
  Lanes *const work = e.work;
  for (std::size_t i = 0; i < e.n * e.wide; ++i) {
    work[i].re = Numbers{} + e.left[i];
    work[i].im = Numbers{};
  }
  for (std::size_t i = 0; i < e.n; ++i) {
    work[i * e.wide + i].re += points.re;
    work[i * e.wide + i].im += points.im;
  }
  for (std::size_t i = 0; i + 1 < e.n; ++i) {
    Lanes *const upper = work + i * e.wide;
    Lanes *const lower = upper + e.wide;
    pivot(upper, lower, i, e.wide);
    Lanes factor = lower[i];
    const auto zero = (factor.re == 0) & (factor.im == 0);
    divide(factor, upper[i]);
    factor.re = zero ? Numbers{} : factor.re;
    factor.im = zero ? Numbers{} : factor.im;
    for (std::size_t j = i + 1; j < e.wide; ++j) subtract(lower[j], factor, upper[j]);
  }
  for (std::size_t i = e.n; i-- > 0;) {
    Lanes *const row = work + i * e.wide;
    for (std::size_t c = e.n; c < e.wide; ++c) {
      for (std::size_t j = i + 1; j < e.n; ++j) subtract(row[c], row[j], work[j * e.wide + c]);
      divide(row[c], row[i]);
    }
  }
}

FORCEAXIS_WIDE void solve_wide(const Elimination &e, const Lanes &points) { solve(e, points); }
void solve_narrow(const Elimination &e, const Lanes &points) { solve(e, points); }

}  // namespace

void hessenberg_response(const Eigen::MatrixXd &H, const Eigen::MatrixXd &B,
                         const Eigen::MatrixXd &C, const Eigen::MatrixXd &D,
                         std::span<const std::complex<double>> points,
                         std::span<std::complex<double>> values) {
  const Eigen::Index n = H.rows();
  const Eigen::Index m = B.cols();
  const Eigen::Index p = C.rows();
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> left(n, n + m);
  left << -H, B;
  std::vector<Lanes> work(static_cast<std::size_t>(left.size()));
  const Elimination e{static_cast<std::size_t>(n), static_cast<std::size_t>(n + m), left.data(),
                      work.data()};
  for (std::size_t first = 0; first < points.size(); first += kLanes) {
    const std::size_t count = std::min(kLanes, points.size() - first);
    Lanes at;
    for (std::size_t l = 0; l < kLanes; ++l) {
      const std::complex<double> point = points[first + std::min(l, count - 1)];
      at.re[l] = point.real();
      at.im[l] = point.imag();
    }
    (kWide ? solve_wide : solve_narrow)(e, at);
    for (std::size_t l = 0; l < count; ++l)
      for (Eigen::Index r = 0; r < p; ++r)
        for (Eigen::Index c = 0; c < m; ++c) {
          std::complex<double> sum = D(r, c);
          for (Eigen::Index i = 0; i < n; ++i) {
            const Lanes &state = work[static_cast<std::size_t>(i * (n + m) + n + c)];
            sum += C(r, i) * std::complex<double>(state.re[l], state.im[l]);
          }
          const auto place = static_cast<Eigen::Index>(first + l) * p + r;
          values[static_cast<std::size_t>(place * m + c)] = sum;
        }
  }
}

}  // namespace forceaxis::sim
