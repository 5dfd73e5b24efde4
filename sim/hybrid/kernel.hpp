#pragma once
// The arithmetic for a tick in which the mode does not change: the product y = M v. The matrix M is
// stored by columns.
//
// Every row is summed over the columns in ascending order, for every block size and every width of
// the vector registers. So a result does not depend on optimisation level, processor, alignment or
// neighbouring rows. The build needs the option -ffp-contract=off.
#include <cstddef>
#include <cstdint>
#include <new>
#include <vector>

namespace forceaxis::sim::kernel {

/// Returns the number of rows of a matrix in memory, which is `rows` rounded up to a multiple of 4.
/// The functions below call this number `stride`.
constexpr std::size_t padded(std::size_t rows) { return (rows + 3) & ~std::size_t{3}; }

/// Allocator that aligns memory to the start of a cache line. A vector register then never loads
/// from two cache lines, so a product takes less time and the same time in every run.
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

/// Computes the product y[0..stride) = M v. The matrix has at least one column.
using Multiply = void (*)(const double *m, std::size_t stride, const double *v, std::size_t columns,
                          double *y);

/// Returns the fastest variant of the product that this processor supports. All variants compute
/// the same doubles.
Multiply best_multiply();
/// Variant of the product that every processor of the target platform supports.
void multiply_base(const double *m, std::size_t stride, const double *v, std::size_t columns,
                   double *y);
/// Variant of the product with vectors of 256 bits, compiled for x86-64 only.
void multiply_wide(const double *m, std::size_t stride, const double *v, std::size_t columns,
                   double *y);

/// Data of the quiet test of one tick, which is described at Mode. All strides are multiples of 4.
struct QuietTest {
  const double *tick = nullptr;
  std::size_t tick_stride = 0;
  const double *curve = nullptr;
  std::size_t curve_stride = 0;
  const double *low = nullptr;
  const double *high = nullptr;
  /// Index of the first row of the matrix `tick` that computes a signal. The signals occupy
  /// (samples + 1) * stride rows.
  std::size_t first = 0;
  std::size_t stride = 0;
  std::size_t samples = 0;
  std::size_t columns = 0;
};

/// Computes the products result = tick z and dip = curve |z|. Returns true if inside() is true for
/// every signal in all parts of the tick.
using Quiet = bool (*)(const QuietTest &test, const double *z, double *result, double *dip);

Quiet best_quiet();
bool quiet_base(const QuietTest &test, const double *z, double *result, double *dip);
bool quiet_wide(const QuietTest &test, const double *z, double *result, double *dip);

/// Data of the second test of one tick, which is described at Mode. All strides are multiples of 4.
struct CalmTest {
  const double *head = nullptr;
  std::size_t head_stride = 0;
  const double *tail = nullptr;
  std::size_t tail_stride = 0;
  const double *doubt = nullptr;
  const double *low = nullptr;
  const double *high = nullptr;
  /// Index of the first row of the matrix `head` that computes the first term of the second test.
  std::size_t first = 0;
  std::size_t stride = 0;
  std::size_t samples = 0;
  std::size_t columns = 0;
  std::size_t states = 0;
};

/// Computes the bounds of the second test from z. `signal` has the signals at the ends of the
/// parts, which quiet() has computed. Returns true if inside() is true for every signal in all
/// parts of the tick.
using Calm = bool (*)(const CalmTest &test, const double *z, const double *signal, double *head,
                      double *dip);

Calm best_calm();
bool calm_base(const CalmTest &test, const double *z, const double *signal, double *head,
               double *dip);
bool calm_wide(const CalmTest &test, const double *z, const double *signal, double *head,
               double *dip);

/// Data of the quiet test for one signal on a grid of `parts` parts. This number is a multiple of 4
/// and at most 64. The test computes the signal at the ends of the parts, signal = M z, with
/// columns of padded(parts + 1) rows. The test also computes dip = D |z| for each part. The result
/// has one bit for each part. A bit is set if the signal can leave the range from `low` to `high`
/// in this part.
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

/// Returns true if a signal stays within [low, high] on an interval. The signal has the values `a`
/// and `b` at the ends of the interval. Between the ends, the signal deviates by at most `dip` from
/// the straight line. Returns false if a value is not a number.
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
