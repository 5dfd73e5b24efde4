#pragma once
// The product of kernel.hpp for the vector width the including file is compiled for. Internal
// linkage: the same source gives different machine code in each of them.
#include <cstddef>
#include <utility>

namespace {

// Wrapped, because template arguments lose their attributes. Memory need not be aligned.
struct Pair {
  static constexpr std::size_t kWidth = 2;
  typedef double Value __attribute__((vector_size(16)));
  typedef double Memory __attribute__((vector_size(16), aligned(8), may_alias));
};
struct Quad {
  static constexpr std::size_t kWidth = 4;
  typedef double Value __attribute__((vector_size(32)));
  typedef double Memory __attribute__((vector_size(32), aligned(8), may_alias));
};

// As many vectors of rows at once as there are indices, their sums in registers.
template <class Lanes, std::size_t... kIndex>
inline void unrolled(std::index_sequence<kIndex...>, const double *m, std::size_t stride,
                     const double *v, std::size_t columns, double *y) {
  typedef typename Lanes::Memory Memory;
  const double first = v[0];
  typename Lanes::Value sum[] = {reinterpret_cast<const Memory *>(m)[kIndex] * first...};
  for (std::size_t j = 1; j < columns; ++j) {
    m += stride;
    const double factor = v[j];
    ((sum[kIndex] += reinterpret_cast<const Memory *>(m)[kIndex] * factor), ...);
  }
  ((reinterpret_cast<Memory *>(y)[kIndex] = sum[kIndex]), ...);
}

template <class Lanes, std::size_t kCount>
inline void block(const double *m, std::size_t stride, const double *v, std::size_t columns,
                  double *y) {
  unrolled<Lanes>(std::make_index_sequence<kCount>(), m, stride, v, columns, y);
}

// As many vectors as `rows` has room for; returns the rows done.
template <class Lanes>
inline std::size_t blocks(const double *m, std::size_t rows, std::size_t stride, const double *v,
                          std::size_t columns, double *y) {
  constexpr std::size_t kWidth = Lanes::kWidth;
  std::size_t row = 0;
  for (; row + 8 * kWidth <= rows; row += 8 * kWidth)
    block<Lanes, 8>(m + row, stride, v, columns, y + row);
  m += row;
  y += row;
  const std::size_t left = (rows - row) / kWidth;
  switch (left) {
    case 1:
      block<Lanes, 1>(m, stride, v, columns, y);
      break;
    case 2:
      block<Lanes, 2>(m, stride, v, columns, y);
      break;
    case 3:
      block<Lanes, 3>(m, stride, v, columns, y);
      break;
    case 4:
      block<Lanes, 4>(m, stride, v, columns, y);
      break;
    case 5:
      block<Lanes, 5>(m, stride, v, columns, y);
      break;
    case 6:
      block<Lanes, 6>(m, stride, v, columns, y);
      break;
    case 7:
      block<Lanes, 7>(m, stride, v, columns, y);
      break;
    default:
      break;
  }
  return row + left * kWidth;
}

}  // namespace
