#pragma once
// The arithmetic of a quiet tick: y = M v, with M stored by columns.
//
// Every row is summed over the columns in ascending order, whatever the blocking and the width of
// the machine's vectors, so a result does not depend on optimisation level, processor, alignment or
// neighbouring rows (build with -ffp-contract=off).
#include <cstddef>

namespace forceaxis::sim::kernel {

/// Rows are padded to an even number; `stride` is that number.
inline std::size_t padded(std::size_t rows) { return (rows + 1) & ~std::size_t{1}; }

/// y[0..stride) = M v; at least one column.
using Multiply = void (*)(const double *m, std::size_t stride, const double *v, std::size_t columns,
                          double *y);

/// The fastest variant this processor runs; all give the same doubles.
Multiply best_multiply();
/// The variant every processor of the target runs.
void multiply_base(const double *m, std::size_t stride, const double *v, std::size_t columns,
                   double *y);
/// With 256-bit vectors. Exists on x86-64 only.
void multiply_wide(const double *m, std::size_t stride, const double *v, std::size_t columns,
                   double *y);

/// Whether `count` signals, a and b at the ends of an interval and not more than `dip` off their
/// chord between, stay within [low, high]. False for values that are not numbers.
inline bool inside(const double *a, const double *b, const double *dip, const double *low,
                   const double *high, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    const double least = (b[i] < a[i] ? b[i] : a[i]) - dip[i];
    const double most = (b[i] < a[i] ? a[i] : b[i]) + dip[i];
    if (!(least >= low[i])) return false;
    if (!(most <= high[i])) return false;
  }
  return true;
}

inline double dot(const double *row, const double *v, std::size_t columns) {
  double sum = row[0] * v[0];
  for (std::size_t j = 1; j < columns; ++j) sum += row[j] * v[j];
  return sum;
}

inline double magnitude(double value) { return __builtin_fabs(value); }

}  // namespace forceaxis::sim::kernel
