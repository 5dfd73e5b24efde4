// Evaluates the evaluation elements of a press cycle over recorded samples, for Python.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cstdint>
#include <map>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

#include "host/python/binding/parts.hpp"

extern "C" {
#include "firmware/cycle/element.h"
#include "firmware/cycle/program.h"
#include "firmware/cycle/sample.h"
}

namespace py = pybind11;

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

}  // namespace

void add_cycle(py::module_ &m) {
  m.def("evaluate_elements", &evaluate, py::arg("elements"), py::arg("points"), py::arg("samples"),
        "Evaluates elements (firmware/cycle/element.h) over the samples of a cycle. elements: the "
        "fields of cycle_element_t that are not 0. points: (x, y) of envelopes. samples: rows of "
        "tick, travel in counts, force in 1/256 count and phase. Returns (value, tick, verdict) of "
        "each element. Raises ValueError for an element or a sample that is not valid.");
}
