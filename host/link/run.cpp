#include "host/link/run.hpp"

#include <algorithm>
#include <memory>

#include "firmware/objects/generated/axis_objects.h"
#include "firmware/port/host/axis_host.h"
#include "host/link/objects.hpp"
#include "host/link/sha256.hpp"

namespace forceaxis::host {
namespace {

struct AxisDeleter {
  void operator()(axis_host_t *axis) const { axis_host_destroy(axis); }
};
using Axis = std::unique_ptr<axis_host_t, AxisDeleter>;

std::int32_t read(const Axis &axis, std::uint16_t object) {
  std::int32_t value = 0;
  axis_host_read(axis.get(), object, &value);
  return value;
}

const char *refusal_text(int error) {
  switch (error) {
    case FW_ERROR_RANGE:
      return "outside its range or at odds with another object";
    case FW_ERROR_STATE:
      return "not in this state of the axis: a fault is latched, or it must be disabled or idle";
    default:
      return "cannot be written";
  }
}

int write(const Axis &axis, const ObjectWrite &w) {
  return axis_host_write(axis.get(), w.object, w.raw);
}

// Objects that bound each other are taken in whatever order works.
void write_initial(const Axis &axis, const Experiment &experiment) {
  std::vector<ObjectWrite> left = experiment.initial;
  while (!left.empty()) {
    std::vector<ObjectWrite> refused;
    for (const ObjectWrite &w : left) {
      if (write(axis, w) != FW_OK) refused.push_back(w);
    }
    if (refused.size() == left.size()) {
      const ObjectWrite &w = refused.front();
      throw sim::InputError(
          experiment.file.string(), std::string("firmware.") + object_meta(w.object).name,
          "expected a value that the firmware takes beside the others, it refused " +
              std::to_string(w.raw) + " (raw): " + refusal_text(write(axis, w)));
    }
    left = refused;
  }
}

// The trace hash. Records are collected, little-endian and unpadded, and hashed many at a time.
class TraceHash {
 public:
  void add(const TickRecord &r) {
    if (size_ == sizeof bytes_) flush();
    put(r.tick, 4);
    put(static_cast<std::uint32_t>(r.encoder_cnt), 4);
    put(r.adc0_code, 2);
    put(r.adc1_code, 2);
    put(r.din, 1);
    put(static_cast<std::uint16_t>(r.dac_code), 2);
    put(r.out, 1);
  }

  std::string hex() {
    flush();
    return hash_.hex();
  }

 private:
  void put(std::uint32_t value, int count) {
    for (int i = 0; i < count; ++i) bytes_[size_++] = static_cast<std::uint8_t>(value >> (8 * i));
  }
  void flush() {
    hash_.update(bytes_, size_);
    size_ = 0;
  }

  Sha256 hash_;
  std::size_t size_ = 0;
  std::uint8_t bytes_[256 * kTickRecordBytes];
};

constexpr std::size_t kListedEvents = 100000;

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

// Peak to peak over the ticks of the window.
template <class T>
class Ripple {
 public:
  void add(T value) {
    low_ = empty_ ? value : std::min(low_, value);
    high_ = empty_ ? value : std::max(high_, value);
    empty_ = false;
  }
  double peak_to_peak() const { return static_cast<double>(high_) - static_cast<double>(low_); }

 private:
  bool empty_ = true;
  T low_{}, high_{};
};

}  // namespace

RunResult run(const Experiment &experiment, const RunOptions &options) {
  sim::Plant plant(experiment.modes, {.audit = options.audit,
                                      .listed_events = options.trace ? kListedEvents : 0,
                                      .seed = experiment.seed});
  const Axis axis(axis_host_create());
  write_initial(axis, experiment);

  RunResult result;
  const std::vector<std::string> &names = plant.signal_names();
  const std::size_t width = names.size();
  const std::size_t rows = static_cast<std::size_t>(experiment.ticks) + 1;
  if (options.trace) {
    result.signal_names = names;
    result.records.reserve(rows);
    result.firmware.reserve(rows);
    result.signals.resize(rows * width);
  }
  std::vector<std::size_t> contact_forces;
  for (const sim::Contact &contact : experiment.model->contacts) {
    contact_forces.push_back(static_cast<std::size_t>(
        std::find(names.begin(), names.end(), contact.name + ".force") - names.begin()));
  }

  const Criterion criterion = experiment.criterion.value_or(Criterion{});
  const std::int64_t window_start = std::max<std::int64_t>(
      0, experiment.ticks - static_cast<std::int64_t>(criterion.window_s * sim::kTickRateHz));
  std::int64_t losses_before_window = 0;
  Ripple<int> force;
  Ripple<std::int64_t> position;
  Metrics metrics;
  TraceHash hash;
  std::uint16_t adc0_before = 0;
  auto action = experiment.actions.begin();

  std::int32_t first_fault = AXIS_FAULT_NONE;

  for (std::int64_t k = 0; k <= experiment.ticks; ++k) {
    if (k % 1024 == 0 && options.stop && options.stop()) throw RunStopped();
    for (; action != experiment.actions.end() && action->tick <= k; ++action) {
      for (const ObjectWrite &w : action->writes) {
        const int error = write(axis, w);
        if (error != FW_OK) {
          result.refused.push_back({k, object_meta(w.object).name, refusal_text(error)});
        }
      }
      for (const Impulse &j : action->impulses) plant.apply_impulse(j.body, j.impulse_N_s);
    }
    const sim::SensorCodes codes = plant.codes();
    axis_inputs_t in{};
    in.encoder_cnt = codes.encoder;
    in.adc_code[0] = codes.adc[0];
    in.adc_code[1] = codes.adc[1];
    in.din = AXIS_DIN_ENABLE;
    in.sensor_valid = 1;
    axis_outputs_t out{};
    axis_host_tick(axis.get(), &in, &out);

    const TickRecord record{
        static_cast<std::uint32_t>(k),
        in.encoder_cnt,
        in.adc_code[0],
        in.adc_code[1],
        in.din,
        out.dac_code,
        static_cast<std::uint8_t>((out.amp_enable ? 1 : 0) | (out.brake_release ? 2 : 0))};
    hash.add(record);
    const std::int32_t fault = read(axis, AXIS_OBJ_FAULT);
    if (first_fault == AXIS_FAULT_NONE) first_fault = fault;
    for (const std::size_t i : contact_forces) {
      metrics.peak_force_N = std::max(metrics.peak_force_N, plant.signal(i));
    }
    if (k > 0 && record.adc0_code != adc0_before) metrics.last_adc_change_tick = k;
    adc0_before = record.adc0_code;
    if (k == window_start) losses_before_window = contact_losses(plant);
    if (k >= window_start) {
      force.add(record.adc0_code);
      position.add(record.encoder_cnt);
      metrics.saturated_ticks += record.dac_code == 2047 || record.dac_code == -2048;
    }
    if (options.trace) {
      result.records.push_back(record);
      result.firmware.push_back({static_cast<std::uint8_t>(fault),
                                 static_cast<std::uint8_t>(read(axis, AXIS_OBJ_LIMIT_REASON))});
      plant.signals({&result.signals[static_cast<std::size_t>(k) * width], width});
    }
    if (k < experiment.ticks) plant.step(out.dac_code, out.amp_enable != 0);
  }

  const int adc_bits = read(axis, AXIS_OBJ_ADC_BITS);
  metrics.force_ripple_count = force.peak_to_peak() / static_cast<double>(1 << (adc_bits - 8));
  metrics.position_ripple_count = position.peak_to_peak();
  metrics.contact_losses = contact_losses(plant) - losses_before_window;
  metrics.in_contact = !contact_forces.empty() &&
                       std::all_of(contact_forces.begin(), contact_forces.end(),
                                   [&plant](std::size_t i) { return plant.signal(i) > 0; });
  if (!contact_forces.empty()) metrics.final_force_N = plant.signal(contact_forces.front());

  result.fault = enum_text(AXIS_OBJ_FAULT, first_fault);
  result.metrics = metrics;
  result.events = plant.events();
  result.event_count = plant.crossings() + plant.jumps();
  if (options.audit) result.energy = plant.energy();
  result.edge_margin = plant.edge_margin();
  result.trace_hash = hash.hex();
  if (experiment.criterion)
    result.verdict = judge(*experiment.criterion, metrics, first_fault != AXIS_FAULT_NONE);
  return result;
}

std::string judge(const Criterion &criterion, const Metrics &metrics, bool faulted) {
  const bool held = !criterion.contact_held || (metrics.in_contact && metrics.contact_losses == 0);
  const bool calm = metrics.force_ripple_count <=
                        criterion.force_ripple_max_count.value_or(metrics.force_ripple_count) &&
                    metrics.position_ripple_count <=
                        criterion.position_ripple_max_count.value_or(metrics.position_ripple_count);
  return held && calm && !faulted ? "stable" : "unstable";
}

}  // namespace forceaxis::host
