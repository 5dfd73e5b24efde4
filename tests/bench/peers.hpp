#pragma once
// What `forceaxis bench` sets itself beside: one shared library with a C interface, loaded by the
// verb when it finds it in the checkout (build/release/tests/bench/bench_peers.so).
#include <cstdint>

namespace forceaxis::bench {

struct Record;

// One run of `ticks` ticks. Return the number of crossings located within ticks, -1 if unknown.
long run_odeint(bool full, int gain, int setpoint_N, int ticks, const Record &record);
long run_mujoco(bool full, int gain, int setpoint_N, int ticks, const Record &record);
// The plants of `forceaxis bench --growth` (growth_plants.hpp).
long run_odeint_chain(int bodies, int gain, int setpoint_N, int ticks, const Record &record);
long run_odeint_rattle(double frequency_Hz, int gain, int setpoint_N, int ticks,
                       const Record &record);
// Extended precision, no peer: what force errors are measured against.
long run_reference(bool full, int gain, int setpoint_N, int ticks, const Record &record);

}  // namespace forceaxis::bench
