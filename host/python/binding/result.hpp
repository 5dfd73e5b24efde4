#pragma once
// Functions that convert the result of a run to Python objects.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "host/run/experiment.hpp"
#include "host/run/held_force.hpp"
#include "host/run/objects.hpp"
#include "host/run/result.hpp"

template <class T, class Rows, class Get>
pybind11::array_t<T> column(const Rows &rows, Get get) {
  pybind11::array_t<T> values(static_cast<pybind11::ssize_t>(rows.size()));
  T *out = values.mutable_data();
  for (const auto &row : rows) *out++ = static_cast<T>(get(row));
  return values;
}

// Converts the controlled force to Python. settle_s is None if the force does not settle.
inline pybind11::dict to_dict(const forceaxis::host::HeldForce &f) {
  pybind11::dict d;
  d["setpoint_N"] = f.setpoint_N;
  d["held_N"] = f.held_N;
  d["error_N"] = f.error_N;
  d["error_percent"] = f.error_percent;
  d["overshoot_percent"] = f.overshoot_percent;
  d["from_s"] = f.from_s;
  d["settle_s"] = std::isfinite(f.settle_s) ? std::optional(f.settle_s) : std::nullopt;
  return d;
}

inline pybind11::dict to_dict(const forceaxis::host::Metrics &m) {
  pybind11::dict d;
  d["window_ticks"] = m.window_ticks;
  d["window_start_s"] = m.window_start_s;
  d["force_ripple_count"] = m.force_ripple.count;
  d["force_ripple_late_count"] = m.force_ripple.late_count;
  d["position_ripple_count"] = m.position_ripple.count;
  d["position_ripple_late_count"] = m.position_ripple.late_count;
  d["contacts"] = m.contacts;
  d["contact_losses"] = m.contact_losses;
  d["contact_losses_run"] = m.contact_losses_run;
  d["first_contact_s"] = m.first_contact_s;
  d["contact_at_window"] = m.contact_at_window;
  d["in_contact"] = m.in_contact;
  d["peak_force_N"] = m.peak_force_N;
  d["final_force_N"] = m.final_force_N;
  d["saturated_ticks"] = m.saturated_ticks;
  d["saturated_run_ticks"] = m.saturated_run_ticks;
  d["reading_range_ticks"] = m.reading_range_ticks;
  d["setpoint_beyond_N"] = m.setpoint_beyond_N;
  d["reading_end_N"] = m.reading_end_N;
  d["last_adc_change_tick"] = m.last_adc_change_tick;
  d["held_force"] = m.held_force ? pybind11::object(to_dict(*m.held_force)) : pybind11::none();
  return d;
}

// Converts missed limits to Python. An infinite value, for a force that never settles, becomes
// None.
inline pybind11::list to_list(const std::vector<forceaxis::host::Missed> &missed) {
  pybind11::list list;
  for (const auto &m : missed) {
    pybind11::dict d;
    d["limit"] = m.limit;
    d["verdict"] = m.verdict;
    d["value"] = std::isfinite(m.value) ? std::optional(m.value) : std::nullopt;
    d["bound"] = m.bound;
    d["unit"] = m.unit;
    list.append(d);
  }
  return list;
}

inline pybind11::object to_dict(const std::optional<forceaxis::host::Criterion> &c) {
  if (!c) return pybind11::none();
  pybind11::dict d;
  d["window_s"] = c->window_s;
  d["force_ripple_max_count"] = c->force_ripple_max_count;
  d["position_ripple_max_count"] = c->position_ripple_max_count;
  d["held_force_error_max_N"] = c->held_force_error_max_N;
  d["held_force_error_max_percent"] = c->held_force_error_max_percent;
  d["overshoot_max_percent"] = c->overshoot_max_percent;
  d["settle_max_s"] = c->settle_max_s;
  d["peak_force_max_N"] = c->peak_force_max_N;
  d["peak_force_max_percent"] = c->peak_force_max_percent;
  d["contact_losses_max"] = c->contact_losses_max;
  d["saturated_max_s"] = c->saturated_max_s;
  d["contact_held"] = c->contacts.empty() ? pybind11::object(pybind11::bool_(c->contact_held))
                                          : pybind11::cast(c->contacts);
  return d;
}

// Returns the physical quantity for each column of codes. The value in `unit` is (code - zero) *
// per_code.
inline pybind11::dict converters_of(const forceaxis::sim::Model &model) {
  pybind11::dict d;
  const auto add = [&d](const char *column, const std::string &signal, std::string_view unit,
                        double per_code, int zero, int bits) {
    d[column] = pybind11::dict(pybind11::arg("signal") = signal, pybind11::arg("unit") = unit,
                               pybind11::arg("per_code") = per_code, pybind11::arg("zero") = zero,
                               pybind11::arg("bits") = bits);
  };
  if (model.encoder) add("encoder", "position", "m", 1.0 / model.encoder->scale, 0, 32);
  static const char *const kColumns[] = {"adc0", "adc1"};
  for (std::size_t i = 0; i < model.adc.size(); ++i) {
    if (!model.adc[i]) continue;
    const forceaxis::sim::Adc &adc = *model.adc[i];
    for (const auto &signal : model.signal_list())
      if (signal.name == adc.signal)
        add(kColumns[i], adc.signal, forceaxis::sim::unit_of(signal.dimension), adc.per_count,
            adc.zero_code, adc.bits);
  }
  add("dac", "drive.command", "V", model.dac.volts_per_step(), 0, model.dac.bits);
  return d;
}

struct Result {
  forceaxis::host::Experiment experiment;
  forceaxis::host::RunResult run;

  // Returns the values of a traced object in the unit of the object.
  template <class T>
  pybind11::array_t<T> object_column(std::size_t place, const axis_object_meta_t &meta) const {
    const std::size_t rows = run.records.size();
    pybind11::array_t<T> values(static_cast<pybind11::ssize_t>(rows));
    T *out = values.mutable_data();
    for (std::size_t k = 0; k < rows; ++k) {
      const std::int32_t bits = run.objects[k * experiment.traced.size() + place];
      const std::int64_t raw =
          meta.min < 0 ? std::int64_t{bits} : std::int64_t{static_cast<std::uint32_t>(bits)};
      out[k] = static_cast<T>(static_cast<double>(raw) * meta.scale);
    }
    return values;
  }

  pybind11::dict columns() const {
    pybind11::dict d;
    const auto &records = run.records;
    d["encoder"] = column<std::int32_t>(records, [](const auto &r) { return r.encoder_cnt; });
    d["adc0"] = column<std::uint16_t>(records, [](const auto &r) { return r.adc0_code; });
    d["adc1"] = column<std::uint16_t>(records, [](const auto &r) { return r.adc1_code; });
    d["din"] = column<std::uint8_t>(records, [](const auto &r) { return r.din; });
    d["dac"] = column<std::int16_t>(records, [](const auto &r) { return r.dac_code; });
    d["out"] = column<std::uint8_t>(records, [](const auto &r) { return r.out; });
    d["fault"] = column<std::uint8_t>(run.firmware, [](const auto &r) { return r.fault; });
    d["limit_reason"] =
        column<std::uint8_t>(run.firmware, [](const auto &r) { return r.limit_reason; });
    for (std::size_t j = 0; !run.objects.empty() && j < experiment.traced.size(); ++j) {
      const auto &meta = forceaxis::host::object_meta(experiment.traced[j]);
      d[meta.name] = meta.scale == 1.0 ? pybind11::object(object_column<std::int64_t>(j, meta))
                                       : pybind11::object(object_column<double>(j, meta));
    }
    const std::size_t width = run.signal_names.size();
    for (std::size_t j = 0; j < width; ++j) {
      pybind11::array_t<double> values(static_cast<pybind11::ssize_t>(records.size()));
      double *out = values.mutable_data();
      for (std::size_t k = 0; k < records.size(); ++k) out[k] = run.signals[k * width + j];
      d[pybind11::str(run.signal_names[j])] = values;
    }
    return d;
  }

  // Returns the objects in the table [trace] with their units.
  pybind11::dict objects() const {
    pybind11::dict d;
    for (const std::uint16_t object : experiment.traced) {
      const auto &meta = forceaxis::host::object_meta(object);
      d[meta.name] = std::string_view(meta.unit) == "1" ? "" : meta.unit;
    }
    return d;
  }

  pybind11::list refused() const {
    pybind11::list list;
    for (const auto &r : run.refused) {
      pybind11::dict d;
      d["tick"] = r.tick;
      d["object"] = r.object;
      d["reason"] = r.reason;
      list.append(d);
    }
    return list;
  }

  static double time_of(std::int64_t tick) {
    return static_cast<double>(tick) / forceaxis::sim::kTickRateHz;
  }

  pybind11::list setpoints() const {
    pybind11::list list;
    for (const auto &s : forceaxis::host::force_setpoints(experiment))
      list.append(pybind11::make_tuple(time_of(s.tick), s.setpoint_N));
    return list;
  }

  pybind11::list impulses() const {
    pybind11::list list;
    for (const auto &action : experiment.actions)
      for (const auto &j : action.impulses)
        list.append(pybind11::make_tuple(time_of(action.tick), j.body, j.impulse_N_s));
    return list;
  }

  pybind11::dict signal_units() const {
    pybind11::dict d;
    for (const auto &signal : experiment.model->signal_list())
      d[pybind11::str(signal.name)] = forceaxis::sim::unit_of(signal.dimension);
    return d;
  }

  pybind11::list contacts() const {
    pybind11::list names;
    for (const auto &contact : experiment.model->contacts) names.append(contact.name);
    return names;
  }

  pybind11::dict converters() const { return converters_of(*experiment.model); }

  pybind11::list events() const {
    pybind11::list list;
    for (const auto &e : run.events)
      list.append(pybind11::make_tuple(e.time_s, e.element, e.from, e.to));
    return list;
  }
};

// Returns the names of the model parameters that the table [set] or the option --set overrides.
inline std::vector<std::string> overridden(const forceaxis::sim::Model &model) {
  std::vector<std::string> names;
  for (const auto &p : model.parameters) {
    if (p.overridden && p.used) names.push_back(p.name);
  }
  return names;
}

// Returns true if the user has interrupted Python. To be used in runs that release the lock of the
// interpreter.
inline bool interrupted() {
  const pybind11::gil_scoped_acquire acquire;
  return PyErr_CheckSignals() != 0;
}
