// Simulates contacts of a plant for many values of the plant's parameters. The input of the plant
// is a recorded command. commission/contact_likelihood.py compares the result with a recording.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "host/python/binding/model.hpp"
#include "host/python/binding/parts.hpp"
#include "sim/hybrid/plant.hpp"
#include "sim/model/elements/adc.hpp"
#include "sim/model/elements/body.hpp"
#include "sim/model/elements/encoder.hpp"

namespace py = pybind11;
using forceaxis::sim::BodyStart;
using forceaxis::sim::InputError;
using forceaxis::sim::ModeCache;
using forceaxis::sim::Model;
using forceaxis::sim::ModelFile;
using forceaxis::sim::Plant;
using Numbers = py::array_t<double, py::array::c_style | py::array::forcecast>;

namespace {

// Values with which each contact begins: shift of the moved bodies in m, their velocity in m/s, and
// a voltage in V that is added to the command.
constexpr py::ssize_t kStartValues = 3;
// Signals of each step: reading of ADC 0, and position of the encoder in m (0 without an encoder).
constexpr std::size_t kSignals = 2;

class Contacts {
 public:
  Contacts(const std::filesystem::path &file, Overrides held, std::vector<std::string> fitted,
           const std::vector<std::string> &moved, const std::vector<Numbers> &volts, int parts)
      : file_(file), held_(std::move(held)), fitted_(std::move(fitted)), parts_(parts) {
    const Model model = load(file_, held_);
    if (!model.adc[0])
      throw InputError(model.file, "adc", "expected a force on channel 0, got none");
    encoder_ = model.encoder.has_value();
    for (const auto &body : model.bodies)
      moved_.push_back(std::find(moved.begin(), moved.end(), body.name) != moved.end());
    for (const Numbers &one : volts) {
      volts_.emplace_back(one.data(), one.data() + one.size());
      steps_ += volts_.back().size();
    }
  }

  // Simulates all contacts for each row of `values`. Rows are independent, so the result does not
  // depend on the number of threads. Values that no plant can have give NaN.
  py::array_t<double> run(const Numbers &values, const Numbers &starts, unsigned threads) const {
    const auto names = static_cast<py::ssize_t>(fitted_.size());
    const auto contacts = static_cast<py::ssize_t>(volts_.size());
    if (values.ndim() != 2 || values.shape(1) != names || starts.ndim() != 3 ||
        starts.shape(0) != values.shape(0) || starts.shape(1) != contacts ||
        starts.shape(2) != kStartValues)
      throw std::invalid_argument(
          "expected values (rows, parameters) and starts (rows, contacts, 3)");
    const auto rows = static_cast<std::size_t>(values.shape(0));
    py::array_t<double> result(
        {values.shape(0), static_cast<py::ssize_t>(kSignals), static_cast<py::ssize_t>(steps_)});
    double *out = result.mutable_data();
    const double *parameters = values.data();
    const double *start = starts.data();
    {
      const py::gil_scoped_release release;
      std::atomic<std::size_t> next{0};
      const auto work = [&] {
        Known known;
        for (std::size_t i; (i = next++) < rows;)
          row(parameters + i * fitted_.size(), start + i * volts_.size() * kStartValues,
              out + i * kSignals * steps_, known);
      };
      std::vector<std::thread> pool;
      for (unsigned i = 1; i < std::min<std::size_t>(threads, rows); ++i) pool.emplace_back(work);
      work();
      for (std::thread &thread : pool) thread.join();
    }
    return result;
  }

 private:
  // The plant of the latest row. Rows that differ only in their start values share this plant.
  struct Known {
    std::vector<double> parameters;
    std::shared_ptr<ModeCache> plant;
  };

  void row(const double *parameters, const double *start, double *out, Known &known) const {
    try {
      const std::vector<double> values(parameters, parameters + fitted_.size());
      if (!known.plant || values != known.parameters) {
        Overrides overrides = held_;
        for (std::size_t i = 0; i < fitted_.size(); ++i) overrides[fitted_[i]] = values[i];
        known.plant = std::make_shared<ModeCache>(
            std::make_shared<const Model>(load(file_, overrides)), parts_);
        known.parameters = values;
      }
      std::size_t first = 0;
      for (const std::vector<double> &volts : volts_) {
        contact(known.plant, volts, start, out + first);
        first += volts.size();
        start += kStartValues;
      }
      // a simulation that fails ends with a SimulationError or an InputError
    } catch (const std::runtime_error &) {
      std::fill(out, out + kSignals * steps_, std::numeric_limits<double>::quiet_NaN());
    }
  }

  void contact(const std::shared_ptr<ModeCache> &cache, const std::vector<double> &volts,
               const double *start, double *out) const {
    std::vector<BodyStart> bodies;
    for (const auto &body : cache->model().bodies) {
      const bool moves = moved_[bodies.size()];
      bodies.push_back(
          {body.position + (moves ? start[0] : 0.0), body.velocity + (moves ? start[1] : 0.0)});
    }
    Plant plant(cache, {.listed_events = 0, .starts = std::move(bodies)});
    for (std::size_t k = 0; k < volts.size(); ++k) {
      plant.hold_volts(volts[k] + start[2], true);
      out[k] = plant.reading(0);
      out[steps_ + k] = encoder_ ? plant.encoder_place() : 0.0;
      plant.step_volts(volts[k] + start[2], true);
    }
  }

  ModelFile file_;
  Overrides held_;
  std::vector<std::string> fitted_;
  int parts_;
  bool encoder_ = false;
  std::vector<bool> moved_;  // for each body of the model: true if the start values move the body
  std::vector<std::vector<double>> volts_;
  std::size_t steps_ = 0;  // total number of time steps in all simulated contacts
};

}  // namespace

void add_contacts(py::module_ &m) {
  py::class_<Contacts>(
      m, "Contacts",
      "Contacts of a plant without firmware, each fed its own recorded command. `held` replaces "
      "parameters of the model file, `fitted` names the parameters of run(), `moved` names the "
      "bodies that start elsewhere in each contact, `volts` has the command of each contact in V "
      "for each step of 1/(1500 parts) s. Raises InputError.")
      .def(py::init<const std::filesystem::path &, Overrides, std::vector<std::string>,
                    const std::vector<std::string> &, const std::vector<Numbers> &, int>(),
           py::arg("model"), py::arg("held"), py::arg("fitted"), py::arg("moved"), py::arg("volts"),
           py::arg("parts") = 1)
      .def("run", &Contacts::run, py::arg("values"), py::arg("starts"), py::arg("threads") = 1,
           "Simulates all contacts for each row of `values` (rows, parameters) in SI units. "
           "`starts` (rows, contacts, 3) has the shift of the moved bodies in m, their velocity in "
           "m/s and a voltage in V that is added to the command. Returns (rows, 2, steps of all "
           "contacts): the signal that ADC 0 converts, before the filter and the clock of the "
           "converter, and the position of the encoder in m, at the "
           "start of each step. A row that no plant can have is NaN.");
}
