#pragma once
// What an experiment asks of the force of its axis, and what the run held.
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

// The set-point at the end of an experiment that controls force: natively, or in a mode of
// operation of an enabled drive, where the row of the mode (firmware/drive/modes.h) says what it
// holds.
struct ForceTask {
  double setpoint_N = 0.0;
  std::int64_t from_tick = 0;  // of the last set-point, impulse, or start or end of an excitation
  std::string signal;          // of the model, read by ADC 0
};

struct ForceSetpoint {
  std::int64_t tick = 0;  // applied before it
  double setpoint_N = 0.0;
};

// Each set-point of force that the experiment asks for, the first from tick 0; 0 where it controls
// no force. Empty where ADC 0 reads no force.
std::vector<ForceSetpoint> force_setpoints(const Experiment &);

// Nothing where the experiment controls no force, its last set-point is 0, or ADC 0 does not read a
// force. Slopes, limits and fault reactions of the firmware are not considered: a force that they
// keep from being reached is an error of the force held.
std::optional<ForceTask> force_task(const Experiment &);

struct HeldForce {
  double setpoint_N = 0.0;
  double held_N = 0.0;           // mean of the signal over the window of the criterion
  double error_N = 0.0;          // set-point minus held
  double error_percent = 0.0;    // of the set-point, without sign
  double overshoot_percent = 0;  // the signal's largest excess over the set-point since from_s
  double from_s = 0.0;           // ForceTask::from_tick, or the first touch after it
  // From from_s until the signal stays within kSettledPart of the force held; infinite where it
  // does not before the window.
  double settle_s = std::numeric_limits<double>::infinity();
};

inline constexpr double kSettledPart = 0.05;

// The force of a run, whose values are those of the task's signal at its ticks; the window begins
// at `window_start`.
HeldForce held_force(const ForceTask &task, const std::vector<double> &values,
                     std::int64_t window_start);

}  // namespace forceaxis::host
