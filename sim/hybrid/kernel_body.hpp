#pragma once
// The products of kernel.hpp, compiled for the vector width of the file that includes this header.
// The functions have internal linkage, because each file that includes this header compiles them to
// different machine code.
#include <cstddef>
#include <utility>

#include "sim/hybrid/kernel.hpp"

namespace {

// Vectors of two and four doubles. The types are members of a struct, because a template argument
// loses its attributes. The address of a `Memory` needs only the alignment of a double.
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

// Computes M v, or M |v| if kAbsolute is true. The number of indices is the number of vector
// registers. The rows of all these registers are summed together, so the sums stay in registers.
template <class Lanes, bool kAbsolute, std::size_t... kIndex>
inline void unrolled(std::index_sequence<kIndex...>, const double *m, std::size_t stride,
                     const double *v, std::size_t columns, double *y) {
  typedef typename Lanes::Memory Memory;
  const auto factor = [](double value) { return kAbsolute ? __builtin_fabs(value) : value; };
  const double *end = v + columns;
  typename Lanes::Value sum[] = {reinterpret_cast<const Memory *>(m)[kIndex] * factor(*v)...};
  while (++v < end) {
    m += stride;
    const double by = factor(*v);
    ((sum[kIndex] += reinterpret_cast<const Memory *>(m)[kIndex] * by), ...);
  }
  ((reinterpret_cast<Memory *>(y)[kIndex] = sum[kIndex]), ...);
}

// Computes the product for a matrix whose rows fill exactly kCount vector registers. The stride of
// this matrix is a constant for the compiler.
template <class Lanes, bool kAbsolute, std::size_t kCount>
inline void block(const double *m, const double *v, std::size_t columns, double *y) {
  unrolled<Lanes, kAbsolute>(std::make_index_sequence<kCount>(), m, kCount * Lanes::kWidth, v,
                             columns, y);
}

template <class Lanes, bool kAbsolute>
inline void blocks(const double *m, std::size_t stride, const double *v, std::size_t columns,
                   double *y) {
  constexpr std::size_t kWidth = Lanes::kWidth;
  switch (stride / kWidth) {
    case 0:
      return;
    case 1:
      return block<Lanes, kAbsolute, 1>(m, v, columns, y);
    case 2:
      return block<Lanes, kAbsolute, 2>(m, v, columns, y);
    case 3:
      return block<Lanes, kAbsolute, 3>(m, v, columns, y);
    case 4:
      return block<Lanes, kAbsolute, 4>(m, v, columns, y);
    case 5:
      return block<Lanes, kAbsolute, 5>(m, v, columns, y);
    case 6:
      return block<Lanes, kAbsolute, 6>(m, v, columns, y);
    case 7:
      return block<Lanes, kAbsolute, 7>(m, v, columns, y);
    default:
      break;
  }
  std::size_t row = 0;
  for (; row + 8 * kWidth <= stride; row += 8 * kWidth)
    unrolled<Lanes, kAbsolute>(std::make_index_sequence<8>(), m + row, stride, v, columns, y + row);
  for (; row + 2 * kWidth <= stride; row += 2 * kWidth)
    unrolled<Lanes, kAbsolute>(std::make_index_sequence<2>(), m + row, stride, v, columns, y + row);
  for (; row < stride; row += kWidth)
    unrolled<Lanes, kAbsolute>(std::make_index_sequence<1>(), m + row, stride, v, columns, y + row);
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

// Returns the largest |v|. The maxima of the even and of the odd elements are computed separately,
// because each comparison has to wait for the previous one.
inline double largest_size(const double *v, std::size_t count) {
  double even = 0.0;
  double odd = 0.0;
  std::size_t j = 0;
  for (; j + 1 < count; j += 2) {
    const double a = __builtin_fabs(v[j]);
    const double b = __builtin_fabs(v[j + 1]);
    even = a <= even ? even : a;
    odd = b <= odd ? odd : b;
  }
  if (j < count && !(__builtin_fabs(v[j]) <= even)) even = __builtin_fabs(v[j]);
  return even <= odd ? odd : even;
}

template <class Lanes>
inline bool calm(const forceaxis::sim::kernel::CalmTest &test, const double *z,
                 const double *signal, double *head, double *dip) {
  typedef typename Lanes::Memory Memory;
  typedef typename Lanes::Value Value;
  blocks<Lanes, false>(test.head, test.head_stride, z, test.columns, head);
  blocks<Lanes, true>(test.tail, test.tail_stride, head, test.states, dip);
  const auto at = [](const double *p) -> Value { return *reinterpret_cast<const Memory *>(p); };
  const Value largest = Value{} + largest_size(z, test.columns);
  const double *bend = head + test.first;
  auto good = Value{} == Value{};
  for (std::size_t k = 0; k < test.samples; ++k)
    for (std::size_t i = 0; i < test.stride; i += Lanes::kWidth, signal += Lanes::kWidth) {
      const std::size_t row = k * test.stride + i;
      const Value a = at(signal);
      const Value b = at(signal + test.stride);
      const Value size = at(bend + row);
      const Value room =
          at(dip + row) + ((size < 0.0 ? -size : size) + at(test.doubt + row) * largest);
      *reinterpret_cast<Memory *>(dip + row) = room;
      good &= ((b < a ? b : a) - room >= at(test.low + i)) &
              ((b < a ? a : b) + room <= at(test.high + i));
    }
  bool all = true;
  for (std::size_t i = 0; i < Lanes::kWidth; ++i) all &= good[i] != 0;
  return all;
}

template <class Lanes>
inline std::uint64_t grid(const forceaxis::sim::kernel::GridTest &test, const double *z,
                          double *signal, double *dip) {
  typedef typename Lanes::Memory Memory;
  typedef typename Lanes::Value Value;
  blocks<Lanes, false>(test.signal, (test.parts / 4 + 1) * 4, z, test.columns, signal);
  blocks<Lanes, true>(test.dip, test.parts, z, test.columns, dip);
  const auto at = [](const double *p) -> Value { return *reinterpret_cast<const Memory *>(p); };
  const Value low = Value{} + test.low;
  const Value high = Value{} + test.high;
  std::uint64_t doubt = 0;
  for (std::size_t k = 0; k < test.parts; k += Lanes::kWidth) {
    const Value a = at(signal + k);
    const Value b = at(signal + k + 1);
    const Value room = at(dip + k);
    const auto good = ((b < a ? b : a) - room >= low) & ((b < a ? a : b) + room <= high);
    for (std::size_t i = 0; i < Lanes::kWidth; ++i)
      doubt |= static_cast<std::uint64_t>(good[i] == 0) << (k + i);
  }
  return doubt;
}

}  // namespace
