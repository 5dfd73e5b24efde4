#include "host/run/held_force.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "firmware/objects/generated/axis_objects.h"
#include "host/run/experiment.hpp"
#include "host/run/objects.hpp"
#include "sim/hybrid/mode.hpp"
#include "sim/model/elements/adc.hpp"

extern "C" {
#include "firmware/drive/modes.h"
}

namespace forceaxis::host {
namespace {

// All bits of the controlword that enable the drive.
constexpr int kEnabling = AXIS_CONTROLWORD_SWITCH_ON | AXIS_CONTROLWORD_ENABLE_VOLTAGE |
                          AXIS_CONTROLWORD_NO_QUICK_STOP | AXIS_CONTROLWORD_ENABLE_OPERATION;

// The values of the firmware's objects after all writes passed to add().
class Written {
 public:
  void add(const ObjectWrite &w) { values_[w.object] = w.raw; }
  std::int64_t operator[](std::uint16_t object) const {
    const auto found = values_.find(object);
    return found != values_.end() ? found->second : object_meta(object).initial;
  }

 private:
  std::map<std::uint16_t, std::int64_t> values_;
};

// Returns the force in N of one count of the firmware's measured force, or 0 if ADC 0 does not
// measure a force.
double newton_per_count(const sim::Model &model, std::int64_t force_sign) {
  const auto &adc = model.adc[0];
  if (!adc) return 0.0;
  for (const sim::SignalInfo &signal : model.signal_list()) {
    if (signal.name == adc->signal && signal.dimension == sim::Dimension::force)
      return adc->per_count * (1 << (adc->bits - 8)) * static_cast<double>(force_sign);
  }
  return 0.0;
}

// Returns the quantity (CIA402_HOLDS_) that the firmware controls in a mode of operation.
int holds(std::int64_t mode) {
  if (!cia402_mode_exists(static_cast<int32_t>(mode))) return CIA402_HOLDS_NONE;
  return cia402_modes[mode + CIA402_MODE_OFFSET].holds;
}

// Returns the quantity (CIA402_HOLDS_) that the drive controls while it is enabled and not halted.
int held_in_drive(const Written &written) {
  const std::int64_t word = written[AXIS_OBJ_CONTROLWORD];
  const bool enabled = (word & (kEnabling | AXIS_CONTROLWORD_HALT)) == kEnabling;
  return enabled ? holds(written[AXIS_OBJ_MODES_OF_OPERATION]) : CIA402_HOLDS_NONE;
}

double setpoint_of(const Written &written, double newton_per_count) {
  const int native = holds(cia402_operation_of(static_cast<uint8_t>(written[AXIS_OBJ_MODE])));
  const int drive = held_in_drive(written);
  if (native == CIA402_HOLDS_SETPOINT || drive == CIA402_HOLDS_SETPOINT)
    return static_cast<double>(written[AXIS_OBJ_FORCE_SETPOINT]) *
           object_meta(AXIS_OBJ_FORCE_SETPOINT).scale * newton_per_count;
  if (drive != CIA402_HOLDS_TARGET) return 0.0;
  const std::int64_t target = written[AXIS_OBJ_TARGET_FORCE] + written[AXIS_OBJ_FORCE_OFFSET];
  // The target force is in per mille of the rated force, and the rated force is in mN. The sign of
  // the force in the model is the sign of the sensor.
  return std::copysign(1e-6, newton_per_count) * static_cast<double>(target) *
         static_cast<double>(written[AXIS_OBJ_RATED_FORCE]);
}

}  // namespace

std::vector<ForceSetpoint> force_setpoints(const Experiment &experiment) {
  Written written;
  for (const ObjectWrite &w : experiment.initial) written.add(w);
  const double scale = newton_per_count(*experiment.model, written[AXIS_OBJ_FORCE_SIGN]);
  if (scale == 0.0) return {};
  std::vector<ForceSetpoint> found{{0, setpoint_of(written, scale)}};
  for (const Action &action : experiment.actions) {
    for (const ObjectWrite &w : action.writes) written.add(w);
    const double setpoint_N = setpoint_of(written, scale);
    if (setpoint_N != found.back().setpoint_N) found.push_back({action.tick, setpoint_N});
  }
  return found;
}

std::vector<LimitedSetpoint> limited_setpoints(const Experiment &experiment) {
  Written written;
  for (const ObjectWrite &w : experiment.initial) written.add(w);
  const double scale = newton_per_count(*experiment.model, written[AXIS_OBJ_FORCE_SIGN]);
  std::vector<LimitedSetpoint> found;
  const auto look = [&] {
    if (scale == 0.0 || held_in_drive(written) != CIA402_HOLDS_TARGET) return;
    const double setpoint_N = setpoint_of(written, scale);
    const bool presses = written[AXIS_OBJ_TARGET_FORCE] + written[AXIS_OBJ_FORCE_OFFSET] > 0;
    const std::int64_t limit =
        std::min(written[AXIS_OBJ_FORCE_LIMIT],
                 written[presses ? AXIS_OBJ_FORCE_LIMIT_POSITIVE : AXIS_OBJ_FORCE_LIMIT_NEGATIVE]);
    const double limit_N =
        1e-6 * static_cast<double>(limit) * static_cast<double>(written[AXIS_OBJ_RATED_FORCE]);
    if (std::fabs(setpoint_N) > limit_N) found.push_back({setpoint_N, limit_N});
  };
  look();
  for (const Action &action : experiment.actions) {
    for (const ObjectWrite &w : action.writes) written.add(w);
    if (!action.writes.empty()) look();
  }
  return found;
}

std::optional<ForceTask> force_task(const Experiment &experiment) {
  const std::vector<ForceSetpoint> setpoints = force_setpoints(experiment);
  if (setpoints.empty() || setpoints.back().setpoint_N == 0.0) return std::nullopt;
  ForceTask task{setpoints.back().setpoint_N, setpoints.back().tick,
                 experiment.model->adc[0]->signal};
  for (const Action &action : experiment.actions) {
    const bool excites =
        std::any_of(action.writes.begin(), action.writes.end(),
                    [](const ObjectWrite &w) { return w.object == AXIS_OBJ_EXCITATION_RUN; });
    if (excites || action.impulse) task.from_tick = std::max(task.from_tick, action.tick);
  }
  return task;
}

HeldForce held_force(const ForceTask &task, const std::vector<double> &values,
                     std::int64_t window_start) {
  const auto ticks = static_cast<std::int64_t>(values.size());
  HeldForce held{.setpoint_N = task.setpoint_N};
  if (ticks == 0) return held;
  const auto at = [&values](std::int64_t tick) { return values.begin() + tick; };
  const std::int64_t window = std::min(window_start, ticks - 1);
  held.held_N =
      std::accumulate(at(window), values.end(), 0.0) / static_cast<double>(ticks - window);
  held.error_N = held.setpoint_N - held.held_N;
  held.error_percent = 100.0 * std::fabs(held.error_N / held.setpoint_N);

  const auto begin = std::find_if(at(std::min(task.from_tick, ticks - 1)), values.end(),
                                  [](double force_N) { return force_N != 0.0; });
  if (begin == values.end()) return held;
  const auto from = begin - values.begin();
  held.from_s = static_cast<double>(from) / sim::kTickRateHz;
  double ratio = 1.0;  // largest ratio of the force to its set-point, at least 1
  for (auto force = begin; force != values.end(); ++force)
    ratio = std::max(ratio, *force / held.setpoint_N);
  held.overshoot_percent = 100.0 * (ratio - 1.0);
  const double band = kSettledPart * std::fabs(held.held_N);
  std::int64_t settled = ticks;
  while (settled > from && std::fabs(*at(settled - 1) - held.held_N) <= band) --settled;
  if (settled <= window) held.settle_s = static_cast<double>(settled - from) / sim::kTickRateHz;
  return held;
}

}  // namespace forceaxis::host
