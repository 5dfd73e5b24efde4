// The linear plant of one mode: x' = A x + B u + c, signals = C x + D u + d, u the drive's command.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "sim/hybrid/network.hpp"

namespace py = pybind11;

void add_linear(py::module_ &m);

using forceaxis::sim::Extended;
using forceaxis::sim::ExtendedMatrix;
using forceaxis::sim::ModeKey;
using forceaxis::sim::Network;

namespace {

using Overrides = std::map<std::string, double>;
using Modes = std::map<std::string, std::string>;

py::array_t<double> part(const ExtendedMatrix &m, Eigen::Index first, Eigen::Index count) {
  py::array_t<double> values({m.rows(), count});
  for (Eigen::Index i = 0; i < m.rows(); ++i)
    for (Eigen::Index j = 0; j < count; ++j)
      values.mutable_at(i, j) = static_cast<double>(m(i, first + j));
  return values;
}

// Contacts touch, everything else is as in the middle of its range, unless `modes` says otherwise.
ModeKey key_of(const Network &network, const forceaxis::sim::Model &model, Modes modes) {
  for (const auto &contact : model.contacts) modes.try_emplace(contact.name, "pressed");
  ModeKey key = network.home_key(true);
  for (const auto &[element, state] : modes) {
    const auto &switches = network.switches();
    const auto found = std::find_if(switches.begin(), switches.end(),
                                    [&](const auto &s) { return s.element == element; });
    if (found == switches.end())
      throw std::invalid_argument("no switching element named " + element);
    const auto &names = found->state_names;
    const auto at = std::find(names.begin(), names.end(), state);
    if (at == names.end()) throw std::invalid_argument(element + " has no state " + state);
    key = network.with_state(key, static_cast<int>(found - switches.begin()),
                             static_cast<int>(at - names.begin()));
  }
  return key;
}

py::dict linear(const std::filesystem::path &file, const Overrides &overrides, const Modes &modes) {
  std::vector<forceaxis::sim::Override> values;
  for (const auto &[name, value] : overrides) values.push_back({name, value});
  const forceaxis::sim::Model model = forceaxis::sim::load_model(file, values);
  const Network network(model);
  const auto equations = network.equations(key_of(network, model, modes));
  const auto &wires = network.signal_wires();
  ExtendedMatrix signals(wires.size(), network.columns());
  for (std::size_t i = 0; i < wires.size(); ++i)
    signals.row(static_cast<Eigen::Index>(i)) = equations.wires.row(wires[i]);
  py::list names;
  for (const auto &signal : model.signal_list()) names.append(signal.name);

  const int n = network.states();
  py::dict d;
  d["signals"] = names;
  d["A"] = part(equations.flow, 0, n);
  d["c"] = part(equations.flow, n, 1);
  d["B"] = part(equations.flow, n + 1, 1);
  d["C"] = part(signals, 0, n);
  d["d"] = part(signals, n, 1);
  d["D"] = part(signals, n + 1, 1);
  // What closes the loop: what ADC channel 0 converts and the converter of the drive's command.
  if (const auto &force = model.adc[0]) {
    const ExtendedMatrix reading = equations.wires.row(network.adc_wires()[0]) /
                                   static_cast<Extended>(force->per_count) /
                                   static_cast<Extended>(1 << (force->bits - 8));
    d["reading"] = part(reading, 0, n);
  }
  d["volts_per_code"] = model.dac.volts_per_code();
  return d;
}

}  // namespace

void add_linear(py::module_ &m) {
  m.def("linear", &linear, py::arg("model"), py::arg("overrides") = Overrides{},
        py::arg("modes") = Modes{},
        "x' = A x + B u + c and signals = C x + D u + d of a model while its contacts touch and "
        "everything else is at home; `modes` names other states, element -> state. u: V at the "
        "drive, volts_per_code of it a code; reading x: what ADC 0 converts, in 8-bit counts.");
}
