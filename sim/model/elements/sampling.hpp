#pragma once

namespace forceaxis::sim {

/// Clock of a converter that has its own sample rate. Sample k = 0, 1, 2, ... is taken phase_s + k
/// / rate_hz after tick 0, and the firmware has it latency_s later.
struct Sampling {
  double rate_hz = 1500.0;  ///< samples per second, 1 to 30000
  double phase_s = 0.0;     ///< time of sample 0 in s, from 0 to less than 1 / rate_hz

  /// False if the phase of the converter's clock is not known. In this case, only simulated runs
  /// use phase_s.
  bool phase_known = true;
  double latency_s = 0.0;  ///< time in s from a sample to its arrival at the firmware, 0 to 0.1
};

}  // namespace forceaxis::sim
