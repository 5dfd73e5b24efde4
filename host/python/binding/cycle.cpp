// Evaluates the evaluation elements of a press cycle over recorded samples, and whole recorded
// curves, for Python.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

#include "host/python/binding/parts.hpp"
#include "host/python/binding/table.hpp"
#include "host/run/cycle_judge.hpp"
#include "host/run/experiment.hpp"

extern "C" {
#include "firmware/cycle/element.h"
#include "firmware/cycle/program.h"
#include "firmware/cycle/sample.h"
}

namespace py = pybind11;
using forceaxis::host::CurveJudge;
using forceaxis::host::CurveSample;
using forceaxis::host::CycleScales;

namespace {

using Fields = std::map<std::string, std::int64_t>;
using Samples = py::array_t<std::int64_t, py::array::c_style | py::array::forcecast>;

// Moves the value of a field to the variable `place`. A field that is not given has the value 0.
template <typename T>
void take(Fields &fields, const char *name, T &place) {
  const auto found = fields.find(name);
  if (found == fields.end()) return;
  place = static_cast<T>(found->second);
  if (static_cast<std::int64_t>(place) != found->second)
    throw std::invalid_argument(std::string(name) + ": out of range");
  fields.erase(found);
}

cycle_element_t element_of(Fields fields) {
  cycle_element_t element{};
  take(fields, "kind", element.kind);
  take(fields, "over_time", element.over_time);
  take(fields, "phases", element.phases);
  take(fields, "of_force", element.of_force);
  take(fields, "direction", element.direction);
  take(fields, "ordinal", element.ordinal);
  take(fields, "enters", element.enters);
  take(fields, "leaves", element.leaves);
  take(fields, "lower", element.lower);
  take(fields, "upper", element.upper);
  take(fields, "first", element.first);
  take(fields, "x_least", element.x_least);
  take(fields, "x_most", element.x_most);
  take(fields, "y_least", element.y_least);
  take(fields, "y_most", element.y_most);
  take(fields, "level", element.level);
  take(fields, "level_2", element.level_2);
  if (!fields.empty())
    throw std::invalid_argument(fields.begin()->first + ": expected a field of cycle_element_t");
  return element;
}

std::vector<cycle_sample_t> samples_of(const Samples &rows) {
  if (rows.ndim() != 2 || rows.shape(1) != 4)
    throw std::invalid_argument("samples: expected rows of tick, travel, force and phase");
  const auto at = rows.unchecked<2>();
  std::vector<cycle_sample_t> samples;
  samples.reserve(static_cast<std::size_t>(rows.shape(0)));
  for (py::ssize_t i = 0; i < rows.shape(0); ++i) {
    const std::int64_t travel = at(i, 1), force = at(i, 2), phase = at(i, 3);
    if (travel < -CYCLE_TRAVEL_MAX || travel > CYCLE_TRAVEL_MAX || force < -CYCLE_FORCE_MAX_Q8 ||
        force > CYCLE_FORCE_MAX_Q8 || phase < 0 || phase > 15)
      throw std::invalid_argument("samples: row " + std::to_string(i) + ": out of range");
    samples.push_back({static_cast<std::uint32_t>(at(i, 0)), static_cast<std::int32_t>(travel),
                       static_cast<std::int32_t>(force), static_cast<std::uint8_t>(phase), 1, 1});
  }
  return samples;
}

py::list evaluate(const std::vector<Fields> &elements,
                  const std::vector<std::tuple<std::int32_t, std::int32_t>> &points,
                  const Samples &rows) {
  std::vector<cycle_point_t> pool;
  for (const auto &[x, y] : points) pool.push_back({x, y});
  const std::vector<cycle_sample_t> samples = samples_of(rows);
  py::list results;
  for (std::size_t i = 0; i < elements.size(); ++i) {
    const cycle_element_t element = element_of(elements[i]);
    if (!cycle_element_is_valid(&element, pool.data(), static_cast<std::uint16_t>(pool.size())))
      throw std::invalid_argument("elements: " + std::to_string(i) + ": expected a valid element");
    cycle_element_state_t state;
    cycle_element_begin(&state);
    for (const cycle_sample_t &sample : samples)
      cycle_element_take(&element, pool.data(), &state, &sample);
    const cycle_element_result_t result = cycle_element_result(&element, &state);
    results.append(py::make_tuple(result.value, result.found_tick, result.verdict));
  }
  return results;
}

// Returns the judge of the program that an experiment names, for `rate_hz` samples per second.
CurveJudge judge_of_experiment(const std::filesystem::path &file,
                               const std::vector<std::string> &overrides, double rate_hz) {
  const auto experiment = forceaxis::host::load_cycle_experiment(file, overrides);
  CycleScales scales =
      forceaxis::host::cycle_scales({file.string(), {}}, *experiment.model, experiment.initial);
  scales.ticks_per_s = rate_hz;
  return {experiment.cycle->file, scales};
}

// Returns the judge of a program for an axis of which only the size of its counts is known.
CurveJudge judge_of_program(const std::filesystem::path &file, double travel_count_m,
                            double force_count_N, double rate_hz, std::optional<double> contact_N) {
  const double infinity = std::numeric_limits<double>::infinity();
  CycleScales scales;
  scales.counts_per_m = 1 / travel_count_m;
  scales.q8_per_N = 1 / force_count_N;
  scales.ticks_per_s = rate_hz;
  scales.limit_N = CYCLE_FORCE_MAX_Q8 * force_count_N;
  // A curve record contains at most 32 times the rated force.
  scales.rated_N = scales.limit_N / 32;
  scales.tare_band_q8 = scales.tare_most = CYCLE_FORCE_MAX_Q8;
  scales.tare_least = -CYCLE_FORCE_MAX_Q8;
  scales.position_most = scales.span = scales.most_q8 = infinity;
  scales.position_least = scales.least_q8 = -infinity;
  if (contact_N)
    scales.contact_q8 = static_cast<std::int32_t>(
        std::clamp(std::nearbyint(*contact_N / force_count_N), 0.0, 1.0 * CYCLE_FORCE_MAX_Q8));
  return {file, scales};
}

std::vector<CurveSample> curve_of(const CurveJudge &judge, const Samples &rows) {
  if (rows.ndim() != 2 || rows.shape(1) != 4 || rows.shape(0) < 2)
    throw std::invalid_argument("samples: expected rows of position, force, validity and phase");
  const auto at = rows.unchecked<2>();
  const auto phases = static_cast<std::int64_t>(judge.program().phases.size());
  std::vector<CurveSample> samples;
  for (py::ssize_t i = 0; i < rows.shape(0); ++i) {
    const std::int64_t position = at(i, 0), force = at(i, 1), phase = at(i, 3);
    if (position != static_cast<std::int32_t>(position) || force < -CYCLE_FORCE_MAX_Q8 ||
        force > CYCLE_FORCE_MAX_Q8 || phase < 0 || phase >= phases)
      throw std::invalid_argument("samples: row " + std::to_string(i) + ": out of range");
    samples.push_back({static_cast<std::int32_t>(position), static_cast<std::int32_t>(force),
                       at(i, 2) != 0, static_cast<std::uint8_t>(phase)});
  }
  return samples;
}

py::tuple judge_curve(const CurveJudge &judge, const Samples &rows,
                      std::optional<std::uint32_t> open) {
  const std::vector<CurveSample> all = curve_of(judge, rows);
  const std::span<const CurveSample> samples(all.begin() + 1, all.end());
  const auto judged =
      open ? judge.judge_followed(all[0], samples, *open) : judge.judge_labelled(all[0], samples);
  return py::make_tuple(table::object(judged.result),
                        py::array_t<std::uint8_t>(static_cast<py::ssize_t>(judged.phases.size()),
                                                  judged.phases.data()),
                        judged.zeroed_at);
}

std::optional<double> known_end(double value) {
  return std::isfinite(value) ? std::optional(value) : std::nullopt;
}

}  // namespace

void add_cycle(py::module_ &m) {
  m.attr("CYCLE_FORCE_MAX_Q8") = CYCLE_FORCE_MAX_Q8;
  py::class_<CurveJudge>(m, "CurveJudge",
                         "The program of a cycle with the scales of recorded curves. Evaluates a "
                         "curve with the code of the firmware; a sample is a tick.")
      .def_static("of_experiment", &judge_of_experiment, py::arg("experiment"),
                  py::arg("overrides"), py::arg("rate_hz"),
                  "Returns the judge of the program of an experiment, with the counts of its "
                  "axis. Raises InputError.")
      .def_static("of_program", &judge_of_program, py::arg("file"), py::arg("travel_count_m"),
                  py::arg("force_count_N"), py::arg("rate_hz"), py::arg("contact_N"),
                  "Returns the judge of a program alone. contact_N: the force of contact, or None. "
                  "Raises InputError.")
      .def("program", [](const CurveJudge &j) { return table::object(j.program()); })
      .def_property_readonly("counts_per_m",
                             [](const CurveJudge &j) { return j.scales().counts_per_m; })
      .def_property_readonly(
          "counts_per_N", [](const CurveJudge &j) { return j.scales().q8_per_N; },
          "1/256 counts of force in 1 N.")
      .def_property_readonly(
          "force_ends",
          [](const CurveJudge &j) {
            return py::make_tuple(known_end(j.scales().least_q8), known_end(j.scales().most_q8));
          },
          "Ends of the range of the force sensor in 1/256 count; None: unknown.")
      .def_property_readonly("knows_contact",
                             [](const CurveJudge &j) { return j.scales().contact_q8.has_value(); })
      .def("judge", &judge_curve, py::arg("samples"), py::arg("open"),
           "Evaluates a curve. samples: rows of position in counts, force in 1/256 count, 1 if "
           "the sample is valid, and phase. The first row is the sample before the curve. open: "
           "None if the samples name their phases. Otherwise the conditions and limits of the "
           "program decide, and a curve that ends in one of the phases `open`, as bits, is "
           "aborted. Returns the result as of a run, the phase of each sample (255 after the "
           "end of the cycle), and the number of samples before travel 0 was found.");
  m.def("evaluate_elements", &evaluate, py::arg("elements"), py::arg("points"), py::arg("samples"),
        "Evaluates elements (firmware/cycle/element.h) over the samples of a cycle. elements: the "
        "fields of cycle_element_t that are not 0. points: (x, y) of envelopes. samples: rows of "
        "tick, travel in counts, force in 1/256 count and phase. Returns (value, tick, verdict) of "
        "each element. Raises ValueError for an element or a sample that is not valid.");
}
