#pragma once
// The force set-point of an experiment, and the controlled force that was measured in a run.
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "host/run/object_values.hpp"
#include "sim/model/model.hpp"

namespace forceaxis::host {

struct Experiment;

// The last set-point of an experiment that controls force. The firmware controls force in its
// native force modes. With an enabled drive, the firmware also controls force in the modes of
// operation for which firmware/drive/modes.h declares a force as the controlled quantity.
struct ForceTask {
  double setpoint_N = 0.0;
  // Tick of the last of these actions: a set-point, an impulse, the start or end of an excitation.
  std::int64_t from_tick = 0;
  std::string signal;  // name of the force signal that ADC 0 converts
};

struct ForceSetpoint {
  std::int64_t tick = 0;  // The set-point applies from this tick on.
  double setpoint_N = 0.0;
};

// Returns all force set-points of the experiment. The first set-point is that of tick 0. A
// set-point is 0 while the experiment does not control force. The list is empty if ADC 0 does not
// measure a force.
std::vector<ForceSetpoint> force_setpoints(const Experiment &);

// Returns nothing if the experiment does not control force, if its last set-point is 0, or if ADC 0
// does not measure a force. Slopes, limits and fault reactions of the firmware are ignored. If the
// firmware does not reach the set-point for such a reason, the difference is an error of the
// controlled force.
std::optional<ForceTask> force_task(const Experiment &);

struct HeldForce {
  double setpoint_N = 0.0;
  // Mean of the force in N over the window of the criterion.
  double held_N = 0.0;
  // Set-point minus held_N, in N.
  double error_N = 0.0;
  // Magnitude of error_N, in percent of the set-point.
  double error_percent = 0.0;
  // Largest excess of the force over the set-point after from_s, in percent of the set-point.
  double overshoot_percent = 0;
  // Time in s of ForceTask::from_tick, or of the first contact after this tick.
  double from_s = 0.0;
  // Time from from_s until the signal stays within kSettledPart of held_N. Infinite if the signal
  // does not settle before the window.
  double settle_s = std::numeric_limits<double>::infinity();
};

inline constexpr double kSettledPart = 0.05;

// Evaluates the force of a run. `values` has the value of the signal ForceTask::signal at each
// tick. The window begins at the tick `window_start`.
HeldForce held_force(const ForceTask &task, const std::vector<double> &values,
                     std::int64_t window_start);

}  // namespace forceaxis::host
