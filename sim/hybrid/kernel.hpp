#pragma once
// The only arithmetic of a quiet tick: y = M v, with M stored by columns.
//
// Every row is summed over the columns in ascending order, whatever the blocking, so a result does
// not depend on optimisation level, alignment or neighbouring rows (build with -ffp-contract=off).
#include <cstddef>
#include <cstring>

namespace forceaxis::sim::kernel {

typedef double Pair __attribute__((vector_size(16)));

inline Pair load(const double *p) {
  Pair value;
  std::memcpy(&value, p, sizeof value);
  return value;
}

inline void store(double *p, Pair value) { std::memcpy(p, &value, sizeof value); }

/// Rows are padded to an even number; `stride` is that number.
inline std::size_t padded(std::size_t rows) { return (rows + 1) & ~std::size_t{1}; }

template <int kPairs>
inline void block(const double *m, std::size_t stride, const double *v, std::size_t columns,
                  double *y) {
  Pair sum[kPairs];
  const Pair first = {v[0], v[0]};
  for (int i = 0; i < kPairs; ++i) sum[i] = load(m + 2 * i) * first;
  for (std::size_t j = 1; j < columns; ++j) {
    const double *column = m + j * stride;
    const Pair factor = {v[j], v[j]};
    for (int i = 0; i < kPairs; ++i) sum[i] += load(column + 2 * i) * factor;
  }
  for (int i = 0; i < kPairs; ++i) store(y + 2 * i, sum[i]);
}

/// y[0..stride) = M v; at least one column.
inline void multiply(const double *m, std::size_t stride, const double *v, std::size_t columns,
                     double *y) {
  std::size_t row = 0;
  for (; row + 16 <= stride; row += 16) block<8>(m + row, stride, v, columns, y + row);
  const std::size_t left = stride - row;
  if (left >= 8) block<4>(m + row, stride, v, columns, y + row), row += 8;
  if ((left & 4U) != 0) block<2>(m + row, stride, v, columns, y + row), row += 4;
  if ((left & 2U) != 0) block<1>(m + row, stride, v, columns, y + row);
}

inline double dot(const double *row, const double *v, std::size_t columns) {
  double sum = row[0] * v[0];
  for (std::size_t j = 1; j < columns; ++j) sum += row[j] * v[j];
  return sum;
}

inline double magnitude(double value) { return value < 0.0 ? -value : value; }

}  // namespace forceaxis::sim::kernel
