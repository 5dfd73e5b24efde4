#include "host/link/plant_side.hpp"

#include <algorithm>
#include <string>

#include "firmware/objects/generated/axis_objects.h"
#include "firmware/port/host/axis_host.h"
#include "host/link/objects.hpp"

namespace forceaxis::host {
namespace {

constexpr std::size_t kListedEvents = 100000;
constexpr std::int64_t kTicksBetweenAsking = 1024;  // options.stop

// Contacts that let go; the flanks of a backlash or stop do not count.
std::int64_t contact_losses(const sim::Plant &plant) {
  const auto &contacts = plant.model().contacts;
  std::int64_t losses = 0;
  for (const auto &kind : plant.event_counts()) {
    const bool of_contact =
        std::any_of(contacts.begin(), contacts.end(),
                    [&kind](const sim::Contact &c) { return c.name == kind.element; });
    if (of_contact && kind.from == "pressed") losses += kind.count;
  }
  return losses;
}

}  // namespace

PlantSide::PlantSide(const Experiment &experiment, const RunOptions &options)
    : experiment_(&experiment),
      options_(options),
      plant_(experiment.modes, {.audit = options.audit,
                                .listed_events = options.trace ? kListedEvents : 0,
                                .seed = experiment.seed}),
      action_(experiment.actions.begin()),
      width_(plant_.signal_names().size()),
      first_fault_(AXIS_FAULT_NONE) {
  in_.din = AXIS_DIN_ENABLE;
  in_.sensor_valid = 1;
  in_.axis = 1;
  const std::vector<std::string> &names = plant_.signal_names();
  if (options.trace) {
    const std::size_t rows = static_cast<std::size_t>(experiment.ticks) + 1;
    result_.signal_names = names;
    result_.records.reserve(rows);
    result_.firmware.reserve(rows);
    result_.signals.resize(rows * width_);
  }
  for (const sim::Contact &contact : experiment.model->contacts) {
    contact_forces_.push_back(static_cast<std::size_t>(
        std::find(names.begin(), names.end(), contact.name + ".force") - names.begin()));
  }
  const Criterion criterion = experiment.criterion.value_or(Criterion{});
  window_start_ = std::max<std::int64_t>(
      0, experiment.ticks - static_cast<std::int64_t>(criterion.window_s * sim::kTickRateHz));
}

const LinkInputs &PlantSide::sense() {
  for (; action_ != experiment_->actions.end() && action_->tick <= tick_; ++action_) {
    for (const Impulse &j : action_->impulses) plant_.apply_impulse(j.body, j.impulse_N_s);
  }
  const sim::SensorCodes codes = plant_.codes();
  in_.tick = tick_;
  in_.encoder_cnt = codes.encoder;
  in_.adc0_code = codes.adc[0];
  in_.adc1_code = codes.adc[1];
  return in_;
}

void PlantSide::act(const LinkOutputs &out) {
  if (tick_ % kTicksBetweenAsking == 0 && options_.stop && options_.stop()) throw RunStopped();
  const TickRecord record = tick_record(in_, out);
  hash_.add(record);
  if (first_fault_ == AXIS_FAULT_NONE) first_fault_ = out.fault;
  for (const std::size_t i : contact_forces_) {
    metrics_.peak_force_N = std::max(metrics_.peak_force_N, plant_.signal_at(i));
  }
  if (tick_ > 0 && record.adc0_code != adc0_before_) metrics_.last_adc_change_tick = tick_;
  adc0_before_ = record.adc0_code;
  if (tick_ == window_start_) losses_before_window_ = contact_losses(plant_);
  if (tick_ >= window_start_) {
    force_.add(record.adc0_code);
    position_.add(record.encoder_cnt);
    metrics_.saturated_ticks += record.dac_code == 2047 || record.dac_code == -2048;
  }
  if (options_.trace) {
    result_.records.push_back(record);
    result_.firmware.push_back({out.fault, out.limit_reason});
    plant_.signals({&result_.signals[static_cast<std::size_t>(tick_) * width_], width_});
  }
  if (tick_ < experiment_->ticks) plant_.step(out.dac_code, (out.out & 1) != 0);
  ++tick_;
}

RunResult PlantSide::finish() {
  const auto &adc = plant_.model().adc[0];
  const int adc_bits = adc ? adc->bits : 8;
  metrics_.force_ripple_count = force_.peak_to_peak() / static_cast<double>(1 << (adc_bits - 8));
  metrics_.position_ripple_count = position_.peak_to_peak();
  metrics_.contact_losses = contact_losses(plant_) - losses_before_window_;
  metrics_.in_contact = !contact_forces_.empty() &&
                        std::all_of(contact_forces_.begin(), contact_forces_.end(),
                                    [this](std::size_t i) { return plant_.signal_at(i) > 0; });
  if (!contact_forces_.empty()) metrics_.final_force_N = plant_.signal_at(contact_forces_.front());

  result_.fault = enum_text(AXIS_OBJ_FAULT, first_fault_);
  result_.metrics = metrics_;
  result_.events = plant_.events();
  result_.event_count = plant_.crossings() + plant_.jumps();
  if (options_.audit) result_.energy = plant_.energy();
  result_.edge_margin = plant_.edge_margin();
  result_.trace_hash = hash_.hex();
  if (experiment_->criterion) {
    result_.verdict = judge(*experiment_->criterion, metrics_, first_fault_ != AXIS_FAULT_NONE);
  }
  return std::move(result_);
}

}  // namespace forceaxis::host
