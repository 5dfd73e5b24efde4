// Passes the contents of co-simulation units to Python: the variables of a unit, and the writes of
// an experiment for the firmware unit.
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include "host/fmu/unit.hpp"
#include "host/python/binding/parts.hpp"
#include "host/python/binding/table.hpp"
#include "host/run/experiment.hpp"
#include "host/run/item.hpp"
#include "host/run/objects.hpp"
#include "sim/model/elements/dac.hpp"

namespace py = pybind11;
using forceaxis::host::item;

namespace {

struct UnitVariable {
  static constexpr const char *kName = "UnitVariable";
  static constexpr const char *kMeaning = "A variable of a co-simulation unit.";
  forceaxis::fmu::Variable v;

  std::string type() const {
    constexpr const char *kTypes[] = {"real", "int32", "uint32", "boolean"};
    return kTypes[static_cast<int>(v.type)];
  }
  std::string role() const {
    constexpr const char *kRoles[] = {"input", "output", "fixed", "tunable", "independent"};
    return kRoles[static_cast<int>(v.role)];
  }
  static constexpr auto items() {
    using forceaxis::host::Within;
    using V = forceaxis::fmu::Variable;
    constexpr auto v = &UnitVariable::v;
    return std::tuple{
        item("name", Within{v, &V::name}),
        item("type", &UnitVariable::type, "real, int32, uint32 or boolean"),
        item("role", &UnitVariable::role, "input, output, fixed, tunable or independent"),
        item("unit", Within{v, &V::unit}, "empty without unit"),
        item("meaning", Within{v, &V::meaning}),
        item("start", Within{v, &V::start},
             "value of an input or parameter after the creation of the unit")};
  }
};

py::object variables(const std::filesystem::path &resources) {
  const auto opened = forceaxis::fmu::open_unit(resources);
  std::vector<UnitVariable> found;
  for (const forceaxis::fmu::Variable &v : opened.unit->variables()) found.push_back({v});
  return table::object(found);
}

struct FirmwareWrites {
  static constexpr const char *kName = "FirmwareWrites";
  static constexpr const char *kMeaning = "What the firmware of an experiment has.";
  static constexpr bool kDict = true;
  std::string title;
  int dac_bits = 0;
  std::vector<std::tuple<std::string, std::int32_t>> initial;
  std::vector<std::tuple<std::int64_t, std::string, std::int32_t>> at;
  std::vector<std::uint32_t> program;

  static constexpr auto items() {
    using W = FirmwareWrites;
    return std::tuple{item("title", &W::title), item("dac_bits", &W::dac_bits),
                      item("initial", &W::initial, "(object, raw value) of each initial write"),
                      item("at", &W::at, "(tick, object, raw value) of each later write"),
                      item("program", &W::program, "words of its program of a cycle")};
  }
};

py::object writes(const std::filesystem::path &file, const std::vector<std::string> &overrides) {
  const auto name_of = [](const forceaxis::host::ObjectWrite &w) -> std::string {
    return forceaxis::host::object_meta(w.object).name;
  };
  const auto experiment = forceaxis::host::load_experiment(file, overrides);
  expect_used(experiment);
  FirmwareWrites all;
  all.title = experiment.title;
  all.dac_bits = experiment.model->dac->bits;
  for (const auto &w : experiment.initial) all.initial.emplace_back(name_of(w), w.raw);
  for (const auto &action : experiment.actions)
    for (const auto &w : action.writes) all.at.emplace_back(action.tick, name_of(w), w.raw);
  if (experiment.cycle) all.program = experiment.cycle->record;
  return table::object(all);
}

}  // namespace

void add_fmu(py::module_ &m) {
  table::add_results<UnitVariable, FirmwareWrites>();
  m.def("fmu_variables", &variables, py::arg("resources"),
        "Returns the variables of the co-simulation unit whose resources are in a folder, in the "
        "order of their value references. Raises InputError.");
  m.def("fmu_writes", &writes, py::arg("experiment"),
        py::arg("overrides") = std::vector<std::string>{},
        "Returns what the firmware of an experiment has. Raises InputError.");
}
