#pragma once
// The product of kernel.hpp for the vector width the including file is compiled for. Internal
// linkage: the same source gives different machine code in each of them.
#include <cstddef>
#include <utility>

#include "sim/hybrid/kernel.hpp"

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

// As many vectors of rows at once as there are indices, their sums in registers; M v or M |v|.
template <class Lanes, bool kAbsolute, std::size_t... kIndex>
inline void unrolled(std::index_sequence<kIndex...>, const double *m, std::size_t stride,
                     const double *v, std::size_t columns, double *y) {
  typedef typename Lanes::Memory Memory;
  const double first = kAbsolute ? __builtin_fabs(v[0]) : v[0];
  typename Lanes::Value sum[] = {reinterpret_cast<const Memory *>(m)[kIndex] * first...};
  for (std::size_t j = 1; j < columns; ++j) {
    m += stride;
    const double factor = kAbsolute ? __builtin_fabs(v[j]) : v[j];
    ((sum[kIndex] += reinterpret_cast<const Memory *>(m)[kIndex] * factor), ...);
  }
  ((reinterpret_cast<Memory *>(y)[kIndex] = sum[kIndex]), ...);
}

template <class Lanes, bool kAbsolute, std::size_t kCount>
inline void block(const double *m, std::size_t stride, const double *v, std::size_t columns,
                  double *y) {
  unrolled<Lanes, kAbsolute>(std::make_index_sequence<kCount>(), m, stride, v, columns, y);
}

template <class Lanes, bool kAbsolute>
inline void blocks(const double *m, std::size_t stride, const double *v, std::size_t columns,
                   double *y) {
  constexpr std::size_t kWidth = Lanes::kWidth;
  std::size_t row = 0;
  for (; row + 8 * kWidth <= stride; row += 8 * kWidth)
    block<Lanes, kAbsolute, 8>(m + row, stride, v, columns, y + row);
  m += row;
  y += row;
  switch ((stride - row) / kWidth) {
    case 1:
      block<Lanes, kAbsolute, 1>(m, stride, v, columns, y);
      break;
    case 2:
      block<Lanes, kAbsolute, 2>(m, stride, v, columns, y);
      break;
    case 3:
      block<Lanes, kAbsolute, 3>(m, stride, v, columns, y);
      break;
    case 4:
      block<Lanes, kAbsolute, 4>(m, stride, v, columns, y);
      break;
    case 5:
      block<Lanes, kAbsolute, 5>(m, stride, v, columns, y);
      break;
    case 6:
      block<Lanes, kAbsolute, 6>(m, stride, v, columns, y);
      break;
    case 7:
      block<Lanes, kAbsolute, 7>(m, stride, v, columns, y);
      break;
    default:
      break;
  }
}

template <class Lanes>
inline bool quiet(const forceaxis::sim::kernel::QuietTest &test, const double *z, double *result,
                  double *dip) {
  typedef typename Lanes::Memory Memory;
  typedef typename Lanes::Value Value;
  blocks<Lanes, false>(test.tick, test.tick_stride, z, test.columns, result);
  blocks<Lanes, true>(test.curve, test.curve_stride, z, test.columns, dip);
  const auto at = [](const double *p) -> Value { return *reinterpret_cast<const Memory *>(p); };
  const double *signal = result + test.first;
  auto good = Value{} == Value{};
  for (std::size_t k = 0; k < test.samples; ++k)
    for (std::size_t i = 0; i < test.stride; i += Lanes::kWidth, signal += Lanes::kWidth) {
      const Value a = at(signal);
      const Value b = at(signal + test.stride);
      const Value room = at(dip + k * test.stride + i);
      good &= ((b < a ? b : a) - room >= at(test.low + i)) &
              ((b < a ? a : b) + room <= at(test.high + i));
    }
  bool all = true;
  for (std::size_t i = 0; i < Lanes::kWidth; ++i) all &= good[i] != 0;
  return all;
}

}  // namespace
