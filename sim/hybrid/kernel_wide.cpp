// Compiled with -mavx2 and nothing else beyond the portable flags: no fused operations.
#include "sim/hybrid/kernel.hpp"
#include "sim/hybrid/kernel_body.hpp"

namespace forceaxis::sim::kernel {

void multiply_wide(const double *m, std::size_t stride, const double *v, std::size_t columns,
                   double *y) {
  blocks<Quad, false>(m, stride, v, columns, y);
}

bool quiet_wide(const QuietTest &test, const double *z, double *result, double *dip) {
  return quiet<Quad>(test, z, result, dip);
}

std::uint64_t grid_wide(const GridTest &test, const double *z, double *signal, double *dip) {
  return grid<Quad>(test, z, signal, dip);
}

}  // namespace forceaxis::sim::kernel
