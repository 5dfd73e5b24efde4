// Passes to Python what a co-simulation unit consists of: the variables of a unit, and the writes
// of an experiment for the unit of the firmware.
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include "host/fmu/unit.hpp"
#include "host/python/binding/parts.hpp"
#include "host/run/experiment.hpp"
#include "host/run/objects.hpp"
#include "sim/model/elements/dac.hpp"

namespace py = pybind11;
using namespace py::literals;

namespace {

py::list variables(const std::filesystem::path &resources) {
  constexpr const char *kTypes[] = {"real", "int32", "uint32", "boolean"};
  constexpr const char *kRoles[] = {"input", "output", "fixed", "tunable", "independent"};
  const auto opened = forceaxis::fmu::open_unit(resources);
  py::list found;
  for (const forceaxis::fmu::Variable &v : opened.unit->variables())
    found.append(py::dict("name"_a = v.name, "type"_a = kTypes[static_cast<int>(v.type)],
                          "role"_a = kRoles[static_cast<int>(v.role)], "unit"_a = v.unit,
                          "meaning"_a = v.meaning, "start"_a = v.start));
  return found;
}

py::dict writes(const std::filesystem::path &file, const std::vector<std::string> &overrides) {
  const auto name_of = [](const forceaxis::host::ObjectWrite &w) {
    return forceaxis::host::object_meta(w.object).name;
  };
  const auto experiment = forceaxis::host::load_experiment(file, overrides);
  expect_used(experiment);
  py::list initial, at;
  for (const auto &w : experiment.initial) initial.append(py::make_tuple(name_of(w), w.raw));
  for (const auto &action : experiment.actions)
    for (const auto &w : action.writes) at.append(py::make_tuple(action.tick, name_of(w), w.raw));
  std::vector<std::uint32_t> program;
  if (experiment.cycle) program = experiment.cycle->record;
  return py::dict("title"_a = experiment.title, "dac_bits"_a = experiment.model->dac->bits,
                  "initial"_a = initial, "at"_a = at, "program"_a = program);
}

}  // namespace

void add_fmu(py::module_ &m) {
  m.def("fmu_variables", &variables, py::arg("resources"),
        "Returns the variables of the co-simulation unit whose resources are in a folder, in the "
        "order of their value references: name, type (real, int32, uint32, boolean), role (input, "
        "output, fixed, tunable, independent), unit, meaning, and start value of inputs and "
        "parameters. Raises "
        "InputError.");
  m.def("fmu_writes", &writes, py::arg("experiment"),
        py::arg("overrides") = std::vector<std::string>{},
        "Returns what the firmware of an experiment has: title, dac_bits, initial writes (object, "
        "raw value), later writes (tick, object, raw value), and the words of its program. Raises "
        "InputError.");
}
