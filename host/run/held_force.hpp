#pragma once
// The force set-point of an experiment, and the controlled force that its run has measured.
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
// native force modes, or in those modes of operation of an enabled drive for which
// firmware/drive/modes.h declares a force as the controlled quantity.
struct ForceTask {
  double setpoint_N = 0.0;
  // Tick of the last set-point, of the last impulse, or of the last start or end of an excitation.
  std::int64_t from_tick = 0;
  std::string signal;  // name of the force signal that ADC 0 converts
};

struct ForceSetpoint {
  std::int64_t tick = 0;  // The set-point applies before this tick.
  double setpoint_N = 0.0;
};

// Returns each force set-point of the experiment, beginning with that of tick 0. A set-point is 0
// while the experiment does not control force. The list is empty if ADC 0 does not measure a force.
std::vector<ForceSetpoint> force_setpoints(const Experiment &);

// Returns nothing if the experiment does not control force, if its last set-point is 0, or if ADC 0
// does not measure a force. Slopes, limits and fault reactions of the firmware are ignored: if they
// prevent the set-point, the difference counts as an error of the controlled force.
std::optional<ForceTask> force_task(const Experiment &);

struct HeldForce {
  double setpoint_N = 0.0;
  double held_N = 0.0;           // mean of the force over the window of the criterion
  double error_N = 0.0;          // set-point minus held_N
  double error_percent = 0.0;    // magnitude of error_N in percent of the set-point
  double overshoot_percent = 0;  // largest excess of the force over the set-point after from_s
  // Time of ForceTask::from_tick in s, or of the first contact after it.
  double from_s = 0.0;
  // Time from from_s until the signal stays within kSettledPart of held_N. Infinite if the signal
  // does not settle before the window.
  double settle_s = std::numeric_limits<double>::infinity();
};

inline constexpr double kSettledPart = 0.05;

// Evaluates the force of a run. `values` has the task's signal at each tick, and the window begins
// at the tick `window_start`.
HeldForce held_force(const ForceTask &task, const std::vector<double> &values,
                     std::int64_t window_start);

}  // namespace forceaxis::host
