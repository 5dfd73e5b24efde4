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

#include "host/python/binding/table.hpp"
#include "host/run/experiment.hpp"
#include "host/run/held_force.hpp"
#include "host/run/objects.hpp"
#include "host/run/result.hpp"
#include "sim/model/elements/adc.hpp"
#include "sim/model/elements/contact.hpp"
#include "sim/model/elements/dac.hpp"
#include "sim/model/elements/encoder.hpp"

template <class T, class Rows, class Get>
pybind11::array_t<T> column(const Rows &rows, Get get) {
  pybind11::array_t<T> values(static_cast<pybind11::ssize_t>(rows.size()));
  T *out = values.mutable_data();
  for (const auto &row : rows) *out++ = static_cast<T>(get(row));
  return values;
}

/// A converter of the model. Its quantity in `unit` is (code - zero) * per_code.
struct Converter {
  static constexpr const char *kName = "ConverterTable";
  static constexpr const char *kMeaning =
      "A converter of the model, where quantity in `unit` = (code - zero) * per_code.";
  static constexpr bool kDict = true;
  std::string signal;
  std::string unit;
  double per_code;
  int zero;
  int bits;

  static constexpr auto items() {
    using forceaxis::host::item;
    return std::tuple{item("signal", &Converter::signal), item("unit", &Converter::unit),
                      item("per_code", &Converter::per_code), item("zero", &Converter::zero),
                      item("bits", &Converter::bits)};
  }
};

// Returns the converter for each column of the trace that has codes.
inline table::Ordered<Converter> converters_of(const forceaxis::sim::Model &model) {
  table::Ordered<Converter> all;
  if (model.encoder)
    all.push_back({"encoder", {"position", "m", 1.0 / model.encoder->scale, 0, 32}});
  static const char *const kColumns[] = {"adc0", "adc1"};
  for (std::size_t i = 0; i < model.adc.size(); ++i) {
    if (!model.adc[i]) continue;
    const forceaxis::sim::Adc &adc = *model.adc[i];
    for (const auto &signal : model.signal_list())
      if (signal.name == adc.signal)
        all.push_back({kColumns[i],
                       {adc.signal, std::string(forceaxis::sim::unit_of(signal.dimension)),
                        adc.per_count, adc.zero_code, adc.bits}});
  }
  all.push_back({"dac", {"drive.command", "V", model.dac->volts_per_step(), 0, model.dac->bits}});
  return all;
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
      const std::int32_t bits = run.objects[k * experiment.trace.objects.size() + place];
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
    for (std::size_t j = 0; !run.objects.empty() && j < experiment.trace.objects.size(); ++j) {
      const auto &meta = forceaxis::host::object_meta(experiment.trace.objects[j]);
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
    for (const std::uint16_t object : experiment.trace.objects) {
      const auto &meta = forceaxis::host::object_meta(object);
      d[meta.name] = std::string_view(meta.unit) == "1" ? "" : meta.unit;
    }
    return d;
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

  pybind11::list limited_setpoints() const {
    pybind11::list list;
    for (const auto &s : forceaxis::host::limited_setpoints(experiment))
      list.append(pybind11::make_tuple(s.setpoint_N, s.limit_N));
    return list;
  }

  pybind11::list impulses() const {
    pybind11::list list;
    for (const auto &action : experiment.actions)
      if (const auto &impulse = action.impulse)
        list.append(
            pybind11::make_tuple(time_of(action.tick), impulse->body, impulse->impulse_N_s));
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
