#pragma once
// The arithmetic of a quiet tick: y = M v, with M stored by columns.
//
// Every row is summed over the columns in ascending order, whatever the blocking and the width of
// the machine's vectors, so a result does not depend on optimisation level, processor, alignment or
// neighbouring rows (build with -ffp-contract=off).
#include <cstddef>
#include <cstdint>
#include <new>
#include <vector>

namespace forceaxis::sim::kernel {

/// Rows are padded to a multiple of 4; `stride` is that number.
constexpr std::size_t padded(std::size_t rows) { return (rows + 3) & ~std::size_t{3}; }

/// Allocates from a cache line's start, so that no vector of rows spans two lines: faster, and at
/// the same speed in every run.
template <class Value>
struct Aligned {
  using value_type = Value;
  Aligned() = default;
  template <class Other>
  explicit Aligned(const Aligned<Other> &) {}
  Value *allocate(std::size_t count) {
    return static_cast<Value *>(::operator new (count * sizeof(Value), std::align_val_t{64}));
  }
  void deallocate(Value *p, std::size_t) { ::operator delete (p, std::align_val_t{64}); }
  bool operator==(const Aligned &) const = default;
};
using Vector = std::vector<double, Aligned<double>>;

/// y[0..stride) = M v; at least one column.
using Multiply = void (*)(const double *m, std::size_t stride, const double *v, std::size_t columns,
                          double *y);

/// The fastest variant that this processor runs; all variants compute the same doubles.
Multiply best_multiply();
/// The variant every processor of the target runs.
void multiply_base(const double *m, std::size_t stride, const double *v, std::size_t columns,
                   double *y);
/// With 256-bit vectors. Exists on x86-64 only.
void multiply_wide(const double *m, std::size_t stride, const double *v, std::size_t columns,
                   double *y);

/// A quiet tick (Mode) to compute and test. All strides are padded.
struct QuietTest {
  const double *tick = nullptr;
  std::size_t tick_stride = 0;
  const double *curve = nullptr;
  std::size_t curve_stride = 0;
  const double *low = nullptr;
  const double *high = nullptr;
  std::size_t first = 0;  ///< row of the signals in `tick`, `samples` + 1 times `stride` of them
  std::size_t stride = 0;
  std::size_t samples = 0;
  std::size_t columns = 0;
};

/// result = tick z, dip = curve |z|; returns whether all signals are inside() on all parts.
using Quiet = bool (*)(const QuietTest &test, const double *z, double *result, double *dip);

Quiet best_quiet();
bool quiet_base(const QuietTest &test, const double *z, double *result, double *dip);
bool quiet_wide(const QuietTest &test, const double *z, double *result, double *dip);

/// The same test of one signal on a grid of `parts` <= 64 parts, a multiple of 4: signal = M z at
/// their ends, by columns of padded(parts + 1), and dip = D |z| in them. Returns one bit for each
/// part in which the signal is not inside() [low, high].
struct GridTest {
  const double *signal;
  const double *dip;
  std::size_t parts;
  std::size_t columns;
  double low;
  double high;
};
using Grid = std::uint64_t (*)(const GridTest &test, const double *z, double *signal, double *dip);

Grid best_grid();
std::uint64_t grid_base(const GridTest &test, const double *z, double *signal, double *dip);
std::uint64_t grid_wide(const GridTest &test, const double *z, double *signal, double *dip);

/// Whether a signal, a and b at the ends of an interval and not more than `dip` off its chord
/// between, stays within [low, high]. False for values that are not numbers.
inline bool inside(double a, double b, double dip, double low, double high) {
  const double least = (b < a ? b : a) - dip;
  const double most = (b < a ? a : b) + dip;
  return (least >= low) & (most <= high);
}

inline double dot(const double *row, const double *v, std::size_t columns) {
  double sum = row[0] * v[0];
  for (std::size_t j = 1; j < columns; ++j) sum += row[j] * v[j];
  return sum;
}

inline double magnitude(double value) { return __builtin_fabs(value); }

}  // namespace forceaxis::sim::kernel
