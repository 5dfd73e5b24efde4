// Compiled with -mavx2 and nothing else beyond the portable flags: no fused operations.
#include "sim/hybrid/kernel.hpp"
#include "sim/hybrid/kernel_body.hpp"

namespace forceaxis::sim::kernel {

void multiply_wide(const double *m, std::size_t stride, const double *v, std::size_t columns,
                   double *y) {
  const std::size_t done = blocks<Quad>(m, stride, stride, v, columns, y);
  if (done < stride) blocks<Pair>(m + done, stride - done, stride, v, columns, y + done);
}

}  // namespace forceaxis::sim::kernel
