// The C interface of bench_peers.so.
#include "tests/bench/peers.hpp"

#include <cstdio>
#include <cstring>
#include <ctime>
#include <exception>

#include "tests/bench/plants.hpp"

using namespace forceaxis::bench;

namespace {

double thread_cpu_s() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

}  // namespace

extern "C" {

// One run of at most 3000 ticks; each array has a place per tick and one more. `seconds`: CPU time
// of this thread. Returns the crossings, -1 if the tool does not count them, -2 if it is not built
// in or failed (reason on standard error).
__attribute__((visibility("default"))) long bench_peer(const char *tool, int full, int gain,
                                                       int setpoint_N, int ticks, double *force_N,
                                                       double *robot_m, double *workpiece_m,
                                                       double *current_A, int *count,
                                                       double *seconds) {
  const Record record{force_N, robot_m, workpiece_m, current_A, count};
  const auto run = std::strcmp(tool, "odeint") == 0      ? run_odeint
                   : std::strcmp(tool, "reference") == 0 ? run_reference
#ifdef FORCEAXIS_MUJOCO
                   : std::strcmp(tool, "mujoco") == 0 ? run_mujoco
#endif
                                                      : nullptr;
  if (run == nullptr || ticks < 0 || ticks > kTicks) return -2;
  try {
    const double start = thread_cpu_s();
    const long crossings = run(full != 0, gain, setpoint_N, ticks, record);
    *seconds = thread_cpu_s() - start;
    return crossings;
  } catch (const std::exception &error) {
    std::fprintf(stderr, "%s: %s\n", tool, error.what());
    return -2;
  }
}

// One run of odeint on a plant of `forceaxis bench --growth`, as bench_peer. `plant`: "chain" with
// `size` bodies, or "rattle" with an oscillator of `size` Hz.
__attribute__((visibility("default"))) long bench_growth(const char *plant, double size, int gain,
                                                         int setpoint_N, int ticks, double *force_N,
                                                         double *robot_m, double *workpiece_m,
                                                         double *current_A, int *count,
                                                         double *seconds) {
  const Record record{force_N, robot_m, workpiece_m, current_A, count};
  if (ticks < 0 || ticks > kTicks) return -2;
  try {
    const double start = thread_cpu_s();
    const long crossings =
        std::strcmp(plant, "chain") == 0
            ? run_odeint_chain(static_cast<int>(size), gain, setpoint_N, ticks, record)
            : run_odeint_rattle(size, gain, setpoint_N, ticks, record);
    *seconds = thread_cpu_s() - start;
    return crossings;
  } catch (const std::exception &error) {
    std::fprintf(stderr, "odeint: %s\n", error.what());
    return -2;
  }
}
}
