// The plant without firmware for Python. The inputs are DAC codes, the outputs are sensor codes and
// true signals. With this plant, control laws and checks can be written in Python.
#include "sim/hybrid/plant.hpp"

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "host/python/binding/energy.hpp"
#include "host/python/binding/model.hpp"
#include "host/python/binding/parts.hpp"

namespace py = pybind11;
using forceaxis::sim::Event;
using forceaxis::sim::Model;
using forceaxis::sim::Plant;
using forceaxis::sim::PlantOptions;
using forceaxis::sim::SensorCodes;

namespace {

std::unique_ptr<Plant> make_plant(const std::filesystem::path &model, const Overrides &overrides,
                                  std::uint64_t seed, bool audit) {
  PlantOptions options;
  options.audit = audit;
  options.seed = seed;
  return std::make_unique<Plant>(std::make_shared<const Model>(load(model, overrides)), options);
}

py::tuple codes(Plant &plant) {
  const SensorCodes c = plant.codes();
  return py::make_tuple(c.encoder, c.adc[0], c.adc[1]);
}

py::array_t<double> signals(const Plant &plant) {
  py::array_t<double> values(static_cast<py::ssize_t>(plant.signal_names().size()));
  plant.signals({values.mutable_data(), plant.signal_names().size()});
  return values;
}

using Commands = py::array_t<double, py::array::c_style>;
using Flags = py::array_t<bool, py::array::c_style>;

// Simulates one tick for each command. Returns the codes (encoder, adc0, adc1) and the signals
// `names` at the start of each tick, before its command acts. The commands are DAC codes, or
// voltages if `volts` is true. If the model has a controller of the machine, voltages act in place
// of its output, and codes have no effect. `enabled` says in which ticks the drive is enabled.
py::tuple follow(Plant &plant, const Commands &commands, bool volts,
                 const std::vector<std::string> &names, const std::optional<Flags> &enabled) {
  std::vector<std::size_t> places;
  const std::vector<std::string> &known = plant.signal_names();
  for (const std::string &name : names) {
    const auto place = std::find(known.begin(), known.end(), name);
    if (place == known.end()) throw std::invalid_argument("no signal named " + name);
    places.push_back(static_cast<std::size_t>(place - known.begin()));
  }
  const auto ticks = static_cast<std::size_t>(commands.size());
  if (enabled && enabled->size() != commands.size())
    throw std::invalid_argument("enabled: expected one flag for each command");
  py::array_t<std::int64_t> codes({ticks, std::size_t{3}});
  py::array_t<double> signals({ticks, places.size()});
  const double *const command = commands.data();
  const bool *const flag = enabled ? enabled->data() : nullptr;
  std::int64_t *code = codes.mutable_data();
  double *signal = signals.mutable_data();
  const py::gil_scoped_release release;
  for (std::size_t k = 0; k < ticks; ++k) {
    const SensorCodes &now = plant.codes();
    *code++ = now.encoder;
    *code++ = now.adc[0];
    *code++ = now.adc[1];
    for (const std::size_t place : places) *signal++ = plant.signal_at(place);
    const bool enable = flag == nullptr || flag[k];
    if (volts)
      plant.step_volts(command[k], enable);
    else
      plant.step(static_cast<int>(command[k]), enable);
  }
  const py::gil_scoped_acquire acquire;
  return py::make_tuple(std::move(codes), std::move(signals));
}

py::list events(const Plant &plant) {
  py::list list;
  for (const Event &e : plant.events())
    list.append(py::make_tuple(e.time_s, e.element, e.from, e.to, e.jump));
  return list;
}

}  // namespace

void add_plant(py::module_ &m) {
  py::class_<Plant>(m, "Plant",
                    "A simulated axis without firmware. Its input is one DAC code in each tick of "
                    "1/1500 s.\n"
                    "\n"
                    "    plant = Plant('sim/models/axis_contact.toml', {'m_w': 3.3})\n"
                    "    for _ in range(1500):\n"
                    "        encoder, adc0, adc1 = plant.codes()\n"
                    "        plant.step(4 * (158 - adc0))\n"
                    "\n"
                    "Raises InputError for a wrong model, and SimulationError if the simulation "
                    "cannot continue.")
      .def(
          py::init(&make_plant), py::arg("model"), py::arg("overrides") = Overrides{},
          py::arg("seed") = 0, py::arg("audit") = false,
          "`overrides` replaces parameters of the model file, `seed` is the seed of the noise, and "
          "`audit` enables the energy balance.")
      .def(
          "step", py::overload_cast<int, bool>(&Plant::step), py::arg("code"),
          py::arg("enable") = true,
          "Simulates one tick with a constant DAC code. While the amplifier is disabled, the drive "
          "has no force.")
      .def("step_volts", py::overload_cast<double, bool>(&Plant::step_volts), py::arg("volts"),
           py::arg("enable") = true,
           "Simulates one tick with a constant command of the drive in V in place of a DAC code.")
      .def("follow", &follow, py::arg("commands"), py::arg("volts") = false,
           py::arg("signals") = std::vector<std::string>{}, py::arg("enabled") = py::none(),
           "Simulates one tick for each of the `commands` (n,), DAC codes or with `volts` V. "
           "Returns "
           "the codes (n, 3) of encoder, adc0 and adc1 and the `signals` (n, m) at the start of "
           "each "
           "tick.")
      .def("apply_impulse", &Plant::apply_impulse, py::arg("body"), py::arg("impulse_N_s"),
           "Adds impulse / mass to the velocity of a body at this instant.")
      .def("codes", &codes, "Returns the codes (encoder, adc0, adc1) at this instant.")
      .def("signals", &signals,
           "Returns the true signals at this instant, in the order of signal_names.")
      .def("signal", py::overload_cast<std::string_view>(&Plant::signal, py::const_),
           py::arg("name"), "Returns the true signal with this name.")
      .def("mode", &Plant::mode, "Returns 'ELEMENT: STATE' for every element with discrete states.")
      .def("events", &events,
           "Returns (time_s, element, from, to, jump) of the first 4096 changes. jump: a new DAC "
           "code "
           "or an impulse at a tick has caused the change.")
      .def(
          "energy", [](const Plant &plant) { return table::object(Energy{plant.energy()}); },
          "Returns the energy balance in J. Needs audit = True.")
      .def_property_readonly("signal_names", &Plant::signal_names)
      .def_property_readonly(
          "edge_margin", &Plant::edge_margin,
          "smallest distance so far, in LSB, between a converted value and a value "
          "at which the code changes")
      .def_property_readonly("tick", &Plant::tick);
}
