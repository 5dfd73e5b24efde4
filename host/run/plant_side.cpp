#include "host/run/plant_side.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "firmware/objects/generated/axis_objects.h"
#include "firmware/port/host/axis_host.h"
#include "host/run/objects.hpp"
#include "sim/model/elements/adc.hpp"
#include "sim/model/elements/contact.hpp"
#include "sim/model/elements/dac.hpp"
#include "sim/model/elements/drive.hpp"
#include "sim/model/elements/encoder.hpp"

namespace forceaxis::host {
namespace {

constexpr std::size_t kListedEvents = 100000;
constexpr double kNoLimit_N = std::numeric_limits<double>::infinity();
static_assert(sim::kLimitPos == int{AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE} &&
              sim::kLimitNeg == int{AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE} &&
              sim::kIndex == int{AXIS_DIGITAL_INPUTS_INDEX} &&
              sim::kHome == int{AXIS_DIGITAL_INPUTS_HOME});
static_assert(sim::kDriveFitted == int{AXIS_DRIVE_REPORT_FITTED} &&
              sim::kDriveOn == int{AXIS_DRIVE_REPORT_ON} &&
              sim::kDriveFault == int{AXIS_DRIVE_REPORT_FAULT});
}  // namespace

PlantSide::PlantSide(const Experiment &experiment, const RunOptions &options)
    : experiment_(&experiment),
      options_(options),
      plant_(experiment.modes, {.audit = options.audit,
                                .listed_events = options.trace ? kListedEvents : 0,
                                .seed = static_cast<std::uint64_t>(experiment.seed)}),
      action_(experiment.actions.begin()),
      width_(plant_.signal_names().size()) {
  expect_evaluable(experiment);
  in_.sensor_valid = 1;
  in_.axis = 1;
  static_assert(kEnabled == int{AXIS_DIGITAL_INPUTS_ENABLE});
  static_assert(kNoFault == AXIS_FAULT_NONE);
  const std::vector<std::string> &names = plant_.signal_names();
  if (options.trace) {
    const std::size_t rows = static_cast<std::size_t>(experiment.ticks) + 1;
    result_.signal_names = names;
    result_.records.reserve(rows);
    result_.firmware.reserve(rows);
    result_.signals.resize(rows * width_);
  }
  const int steps_per_code = 1 << (experiment.model->dac->bits - AXIS_DAC_BITS_MIN);
  dac_top_ = 2047 * steps_per_code;
  dac_bottom_ = -2048 * steps_per_code;
  const Criterion criterion = experiment.criterion.value_or(Criterion{});
  const std::vector<std::string> held = criterion.contact_held.value_or(HeldContacts{}).names;
  for (const sim::Contact &contact : experiment.model->contacts) {
    const auto place = static_cast<std::size_t>(
        std::find(names.begin(), names.end(), contact.name + ".force") - names.begin());
    contact_forces_.push_back(place);
    if (!held.empty() && std::find(held.begin(), held.end(), contact.name) == held.end()) continue;
    held_.push_back(contact.name);
    held_forces_.push_back(place);
  }
  if (experiment.ticks < kEndlessTicks) force_task_ = force_task(experiment);
  if (force_task_) {
    task_place_ = static_cast<std::size_t>(
        std::find(names.begin(), names.end(), force_task_->signal) - names.begin());
    task_force_.reserve(static_cast<std::size_t>(experiment.ticks) + 1);
  }
  window_start_ = std::max<std::int64_t>(
      0, experiment.ticks - static_cast<std::int64_t>(criterion.window_s * sim::kTickRateHz));
  second_half_ = window_start_ + (experiment.ticks - window_start_) / 2;
  first_pressed_.assign(held_.size(), -1);
  untouched_ = held_.size();
  if (plant_.model().adc[0]) find_reading_ends(*plant_.model().adc[0]);
}

void PlantSide::find_reading_ends(const sim::Adc &adc) {
  const double limit_N =
      std::min(adc.sensor_limit.value_or(kNoLimit_N), adc.conditioning_limit.value_or(kNoLimit_N));
  const double span = limit_N / std::fabs(adc.per_count);
  const double zero = adc.zero_code + adc.rounding;
  const double top = (1 << adc.bits) - 1;
  adc_zero_ = adc.zero_code;
  adc_low_ = static_cast<int>(std::max(0.0, std::floor(zero - span)));
  adc_high_ = static_cast<int>(std::min(top, std::floor(zero + span)));
}

double PlantSide::reading_N(int code) const {
  return (code - adc_zero_) * plant_.model().adc[0]->per_count;
}

void PlantSide::look_for_contact() {
  for (std::size_t i = 0; i < held_.size(); ++i) {
    if (first_pressed_[i] >= 0 || plant_.signal_at(held_forces_[i]) <= 0) continue;
    first_pressed_[i] = tick_;
    --untouched_;
  }
}

void PlantSide::begin_window() {
  losses_before_window_ = contact_losses();
  metrics_.contact_at_window = all_pressed();
}

bool PlantSide::all_pressed() const {
  return !held_forces_.empty() &&
         std::all_of(held_forces_.begin(), held_forces_.end(),
                     [this](std::size_t i) { return plant_.signal_at(i) > 0; });
}

std::int64_t PlantSide::contact_losses() const {
  std::int64_t losses = 0;
  for (const auto &kind : plant_.event_counts()) {
    const bool counts = std::find(held_.begin(), held_.end(), kind.element) != held_.end();
    if (counts && kind.from == "pressed") losses += kind.count;
  }
  return losses;
}

void PlantSide::act_due() {
  for (; due(); ++action_) {
    if (const auto &impulse = action_->impulse)
      plant_.apply_impulse(impulse->body, impulse->impulse_N_s);
    if (action_->sensor) force_sensor_ = action_->sensor->force;
    if (action_->drive) plant_.fail_drive(action_->drive->failure);
  }
}

std::uint16_t PlantSide::failed_reading(std::uint16_t code) const {
  const sim::Adc &adc = *plant_.model().adc[0];
  switch (force_sensor_) {
    case ForceSensor::held:
    case ForceSensor::silent:
      return tick_ == 0 ? code : in_.adc0_code;
    case ForceSensor::high:
      return static_cast<std::uint16_t>((1 << adc.bits) - 1);
    case ForceSensor::low:
      return 0;
    case ForceSensor::zero:
      return static_cast<std::uint16_t>(adc.zero_code);
    default:
      return code;
  }
}

void PlantSide::keep(const TickRecord &record, const LinkOutputs &out) {
  result_.records.push_back(record);
  result_.firmware.push_back({out.fault, out.limit_reason});
  plant_.signals({&result_.signals[static_cast<std::size_t>(tick_) * width_], width_});
}

std::optional<double> PlantSide::first_contact_s() const {
  std::optional<std::int64_t> found;
  const bool all = experiment_->criterion && experiment_->criterion->contact_held;
  for (const std::int64_t tick : first_pressed_) {
    if (tick < 0 && all) return std::nullopt;
    if (tick < 0) continue;
    found = all ? std::max(found.value_or(tick), tick) : std::min(found.value_or(tick), tick);
  }
  if (!found) return std::nullopt;
  return static_cast<double>(*found) / sim::kTickRateHz;
}

void PlantSide::check_setpoint() {
  const std::vector<ForceSetpoint> setpoints = force_setpoints(*experiment_);
  if (setpoints.empty()) return;
  const double ends[] = {reading_N(adc_low_), reading_N(adc_high_)};
  const auto [low, high] = std::minmax(ends[0], ends[1]);
  const double setpoint_N = setpoints.back().setpoint_N;
  if (low <= setpoint_N && setpoint_N <= high) return;
  metrics_.setpoint_beyond_N = setpoint_N;
  metrics_.reading_end_N = setpoint_N > high ? high : low;
}

// Returns the last position set-point of an experiment in encoder counts.
std::optional<std::int32_t> position_target(const Experiment &experiment) {
  std::optional<std::int32_t> found;
  const auto look = [&found](const std::vector<ObjectWrite> &writes) {
    for (const ObjectWrite &w : writes) {
      if (w.object == AXIS_OBJ_POSITION_SETPOINT || w.object == AXIS_OBJ_TARGET_POSITION)
        found = w.raw;
    }
  };
  look(experiment.initial);
  for (const Action &action : experiment.actions) look(action.writes);
  return found;
}

RunResult PlantSide::finish() {
  const auto &adc = plant_.model().adc[0];
  const int adc_bits = adc ? adc->bits : 8;
  const auto counts_per_code = static_cast<double>(1 << (adc_bits - 8));
  metrics_.window_ticks = tick_ - window_start_;
  metrics_.window_start_s = static_cast<double>(window_start_) / sim::kTickRateHz;
  metrics_.force_ripple = {force_.width() / counts_per_code, force_late_.width() / counts_per_code};
  metrics_.position_ripple = {position_.width(), position_late_.width()};
  const auto target = position_target(*experiment_);
  if (target && metrics_.window_ticks > 0)
    metrics_.position_error_count =
        position_sum_ / static_cast<double>(metrics_.window_ticks) - *target;
  metrics_.contacts = static_cast<std::int64_t>(held_.size());
  metrics_.contact_losses_run = contact_losses();
  metrics_.contact_losses = metrics_.contact_losses_run - losses_before_window_;
  metrics_.first_contact_s = first_contact_s();
  metrics_.in_contact = all_pressed();
  if (!contact_forces_.empty()) metrics_.final_force_N = plant_.signal_at(contact_forces_.front());

  if (experiment_->ticks < kEndlessTicks) check_setpoint();
  if (force_task_) metrics_.held_force = held_force(*force_task_, task_force_, window_start_);
  result_.fault = enum_text(AXIS_OBJ_FAULT, first_fault_);
  result_.metrics = metrics_;
  result_.events = plant_.events();
  result_.event_count = plant_.crossings() + plant_.jumps();
  if (options_.audit) result_.energy = plant_.energy();
  result_.edge_margin = plant_.edge_margin();
  result_.trace_hash = hash_.hex();
  if (experiment_->criterion) {
    Evaluation evaluated =
        evaluate(*experiment_->criterion, metrics_, first_fault_ != AXIS_FAULT_NONE);
    result_.verdict = std::move(evaluated.verdict);
    result_.missed = std::move(evaluated.missed);
  }
  return std::move(result_);
}

}  // namespace forceaxis::host
