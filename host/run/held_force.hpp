#pragma once
// The force set-point of an experiment, and the controlled force that was measured in a run.
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "host/run/item.hpp"
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
  std::int64_t tick = 0;  // number of the tick from which the set-point applies
  double setpoint_N = 0.0;
};

// Returns all force set-points of the experiment. The first set-point is that of tick 0. A
// set-point is 0 while the experiment does not control force. The list is empty if ADC 0 does not
// measure a force.
std::vector<ForceSetpoint> force_setpoints(const Experiment &);

// A set-point of force that is larger than the limits force_limit, force_limit_positive and
// force_limit_negative permit in its direction.
struct LimitedSetpoint {
  double setpoint_N = 0.0;
  double limit_N = 0.0;  // largest permitted magnitude
};

// Returns the limited set-points of the modes with a target force, one for each tick with writes.
std::vector<LimitedSetpoint> limited_setpoints(const Experiment &);

// Returns the last set-point of force. Returns nothing if the experiment does not control force, if
// its last set-point is 0, or if ADC 0 does not measure a force. Slopes, limits and fault reactions
// of the firmware are ignored. If the firmware does not reach the set-point for such a reason, the
// difference is an error of the controlled force.
std::optional<ForceTask> force_task(const Experiment &);

struct HeldForce {
  static constexpr const char *kName = "HeldForce";
  static constexpr const char *kMeaning = "The controlled force over the window of the verdict.";
  double setpoint_N = 0.0;
  double held_N = 0.0;
  double error_N = 0.0;
  double error_percent = 0.0;
  double overshoot_percent = 0;
  double from_s = 0.0;
  double settle_s = std::numeric_limits<double>::infinity();

  static constexpr auto items() {
    return std::tuple{
        item("setpoint_N", &HeldForce::setpoint_N),
        item("held_N", &HeldForce::held_N, "mean of the force over the time window of the verdict"),
        item("error_N", &HeldForce::error_N, "set-point minus held_N"),
        item("error_percent", &HeldForce::error_percent,
             "magnitude of error_N, in per cent of the set-point"),
        item("overshoot_percent", &HeldForce::overshoot_percent,
             "largest excess of the force over the set-point after from_s, in per cent of the "
             "set-point"),
        item("from_s", &HeldForce::from_s,
             "start of `settle_s`: last change of set-point or excitation, last impulse or first "
             "contact"),
        item("settle_s", Finite{&HeldForce::settle_s},
             "time after from_s until the force stays within 5 % of held_N; None: not before the "
             "window")};
  }
};

inline constexpr double kSettledPart = 0.05;

// Evaluates the force of a run. `values` has the value of the signal ForceTask::signal at each
// tick. The time window of the verdict begins at the tick `window_start`.
HeldForce held_force(const ForceTask &task, const std::vector<double> &values,
                     std::int64_t window_start);

}  // namespace forceaxis::host
