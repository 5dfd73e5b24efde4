// boost::odeint on the cases of the benchmark. The plants of growth are in a file of their own, so
// that they do not change what the compiler inlines here.
#include "tests/bench/odeint_run.hpp"

namespace forceaxis::bench {

long run_odeint(bool full, int gain, int setpoint_N, int ticks, const Record &record) {
  return full ? odeint::run(FullAxis<double>{}, gain, setpoint_N, ticks, record)
              : odeint::run(AxisContact<double>{}, gain, setpoint_N, ticks, record);
}

}  // namespace forceaxis::bench
