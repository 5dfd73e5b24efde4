#include "sim/hybrid/kernel.hpp"

#include "sim/hybrid/kernel_body.hpp"

namespace forceaxis::sim::kernel {

void multiply_base(const double *m, std::size_t stride, const double *v, std::size_t columns,
                   double *y) {
  blocks<Pair, false>(m, stride, v, columns, y);
}

bool quiet_base(const QuietTest &test, const double *z, double *result, double *dip) {
  return quiet<Pair>(test, z, result, dip);
}

bool calm_base(const CalmTest &test, const double *z, const double *signal, double *head,
               double *dip) {
  return calm<Pair>(test, z, signal, head, dip);
}

std::uint64_t grid_base(const GridTest &test, const double *z, double *signal, double *dip) {
  return grid<Pair>(test, z, signal, dip);
}

Multiply best_multiply() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2") != 0) return multiply_wide;
#endif
  return multiply_base;
}

Quiet best_quiet() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2") != 0) return quiet_wide;
#endif
  return quiet_base;
}

Calm best_calm() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2") != 0) return calm_wide;
#endif
  return calm_base;
}

Grid best_grid() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2") != 0) return grid_wide;
#endif
  return grid_base;
}

}  // namespace forceaxis::sim::kernel
