#include "sim/hybrid/kernel.hpp"

#include "sim/hybrid/kernel_body.hpp"

namespace forceaxis::sim::kernel {

void multiply_base(const double *m, std::size_t stride, const double *v, std::size_t columns,
                   double *y) {
  blocks<Pair>(m, stride, stride, v, columns, y);
}

Multiply best_multiply() {
#if defined(__x86_64__)
  static const bool wide = __builtin_cpu_supports("avx2") != 0;
  if (wide) return multiply_wide;
#endif
  return multiply_base;
}

}  // namespace forceaxis::sim::kernel
