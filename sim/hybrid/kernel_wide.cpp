// This file is compiled with -mavx2 in addition to the portable options. Fused multiply-add must
// not be used, because its rounding differs from that of the portable variant.
#include <immintrin.h>

#include "sim/hybrid/kernel.hpp"
#include "sim/hybrid/kernel_body.hpp"

namespace forceaxis::sim::kernel {

void multiply_wide(const double *m, std::size_t stride, const double *v, std::size_t columns,
                   double *y) {
  blocks<Quad, false>(m, stride, v, columns, y);
}

namespace {

// Computes quiet() for one sample and up to four channels, with all values in vector registers. The
// number of indices is the number of vector registers for the rows: states and ADC signals, then
// the channel signals at the start, then the channel signals at the end.
template <std::size_t... kIndex>
inline bool quiet_small(std::index_sequence<kIndex...>, const QuietTest &test, const double *z,
                        double *result, double *dip) {
  constexpr std::size_t kRows = 4 * sizeof...(kIndex);
  const __m256d no_sign = _mm256_castsi256_pd(_mm256_set1_epi64x(INT64_MAX));
  const double *m = test.tick;
  const double *d = test.curve;
  const double *end = z + test.columns;
  const __m256d first = _mm256_broadcast_sd(z);
  __m256d sum[] = {_mm256_loadu_pd(m + 4 * kIndex) * first...};
  __m256d room = _mm256_loadu_pd(d) * _mm256_and_pd(first, no_sign);
  while (++z < end) {
    m += kRows;
    d += 4;
    const __m256d factor = _mm256_broadcast_sd(z);
    ((sum[kIndex] += _mm256_loadu_pd(m + 4 * kIndex) * factor), ...);
    room += _mm256_loadu_pd(d) * _mm256_and_pd(factor, no_sign);
  }
  (_mm256_storeu_pd(result + 4 * kIndex, sum[kIndex]), ...);
  _mm256_storeu_pd(dip, room);
  const __m256d a = sum[sizeof...(kIndex) - 2];
  const __m256d b = sum[sizeof...(kIndex) - 1];
  const __m256d least = (b < a ? b : a) - room;
  const __m256d most = (b < a ? a : b) + room;
  const __m256d good = _mm256_and_pd(_mm256_cmp_pd(least, _mm256_loadu_pd(test.low), _CMP_GE_OQ),
                                     _mm256_cmp_pd(most, _mm256_loadu_pd(test.high), _CMP_LE_OQ));
  return _mm256_movemask_pd(good) == 15;
}

}  // namespace

bool quiet_wide(const QuietTest &test, const double *z, double *result, double *dip) {
  if (test.samples == 1 && test.stride == 4) {
    if (test.first == 4) return quiet_small(std::make_index_sequence<3>(), test, z, result, dip);
    if (test.first == 8) return quiet_small(std::make_index_sequence<4>(), test, z, result, dip);
    if (test.first == 12) return quiet_small(std::make_index_sequence<5>(), test, z, result, dip);
    if (test.first == 16) return quiet_small(std::make_index_sequence<6>(), test, z, result, dip);
  }
  return quiet<Quad>(test, z, result, dip);
}

bool calm_wide(const CalmTest &test, const double *z, const double *signal, double *head,
               double *dip) {
  return calm<Quad>(test, z, signal, head, dip);
}

std::uint64_t grid_wide(const GridTest &test, const double *z, double *signal, double *dip) {
  return grid<Quad>(test, z, signal, dip);
}

}  // namespace forceaxis::sim::kernel
