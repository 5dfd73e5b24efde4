// The system that the signal analyzer measures. It is the plant alone, driven by a voltage with a
// small time step, or the plant with the firmware. The firmware then generates the DAC codes.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "firmware/objects/generated/axis_objects.h"
#include "firmware/port/host/axis_host.h"
#include "host/python/binding/model.hpp"
#include "host/python/binding/parts.hpp"
#include "host/run/objects.hpp"
#include "sim/hybrid/plant.hpp"
#include "sim/model/elements/adc.hpp"
#include "sim/model/elements/contact.hpp"
#include "sim/model/elements/dac.hpp"
#include "sim/model/elements/drive.hpp"
#include "sim/model/elements/encoder.hpp"
#include "sim/model/elements/spring.hpp"

namespace py = pybind11;
using forceaxis::sim::ModeCache;
using forceaxis::sim::Model;
using forceaxis::sim::Plant;
using forceaxis::sim::SimulationError;

namespace {

struct AxisDeleter {
  void operator()(fw_t *axis) const { axis_host_destroy(axis); }
};

// Largest valid magnitude of a recorded value.
constexpr double kLargest = 1e15;

class Excited {
 public:
  Excited(const std::filesystem::path &file, const Overrides &overrides, std::uint64_t seed,
          int parts, bool clamped) {
    Model loaded = load(file, overrides);
    if (loaded.drive && !loaded.drive->bus.immediate())
      throw forceaxis::sim::InputError(
          loaded.file, "drive.cycle_ticks",
          "expected 1 and no delays in a model that an analyzer measures at its amplifier, got a "
          "bus; remove cycle_ticks, delay_ticks_out and delay_ticks_in for this measurement");
    if (clamped) {
      for (const auto &contact : loaded.contacts)
        loaded.springs.push_back(
            {{contact.name, contact.ends}, contact.stiffness, contact.damping, contact.maxwell});
      loaded.contacts.clear();
    }
    auto model = std::make_shared<const Model>(std::move(loaded));
    plant_ =
        std::make_unique<Plant>(std::make_shared<ModeCache>(std::move(model), parts),
                                forceaxis::sim::PlantOptions{.listed_events = 0, .seed = seed});
  }

  py::array_t<double> volts(const py::array_t<double, py::array::c_style> &volts,
                            const std::vector<std::string> &signals) {
    const std::vector<std::size_t> places = places_of(signals);
    const py::ssize_t n = volts.size();
    py::array_t<double> rows({static_cast<py::ssize_t>(places.size()), n});
    double *out = rows.mutable_data();
    const double *in = volts.data();
    const py::gil_scoped_release release;
    met_.clear();
    changes_ = -1;
    for (py::ssize_t k = 0; k < n; ++k) {
      plant_->hold_volts(in[k], true);
      count_mode();
      for (std::size_t i = 0; i < places.size(); ++i)
        out[static_cast<py::ssize_t>(i) * n + k] = checked(plant_->signal_at(places[i]));
      plant_->step_volts(in[k], true);
    }
    return rows;
  }

  void write(const std::string &object, double value) {
    const auto number = forceaxis::host::find_object(object);
    if (!number) throw std::invalid_argument("no object named " + object);
    if (!axis_) power_up();
    const axis_object_meta_t &meta = forceaxis::host::object_meta(*number);
    const double raw = std::floor(value / meta.scale + 0.5);
    const bool fits = raw >= static_cast<double>(meta.min) && raw <= static_cast<double>(meta.max);
    // The value of an unsigned 32-bit object is passed as a signed value with the same bits.
    const auto bits = static_cast<std::uint32_t>(fits ? static_cast<std::int64_t>(raw) : 0);
    if (!fits || fw_object_write(axis_.get(), FW_SOURCE_LOCAL, *number,
                                 static_cast<std::int32_t>(bits)) != FW_OK)
      throw std::invalid_argument("the firmware refuses " + object + " = " + std::to_string(value));
  }

  py::array_t<double> codes(py::ssize_t ticks, const std::vector<std::string> &columns) {
    static const std::vector<std::string> kCodes = {"adc0", "adc1", "encoder", "dac_code"};
    if (!axis_) power_up();
    std::vector<std::string> names;
    // For each column, the index in kCodes, or -1 if the column is the next signal in `names`.
    std::vector<int> code(columns.size(), -1);
    for (std::size_t i = 0; i < columns.size(); ++i) {
      const auto found = std::find(kCodes.begin(), kCodes.end(), columns[i]);
      if (found != kCodes.end())
        code[i] = static_cast<int>(found - kCodes.begin());
      else
        names.push_back(columns[i]);
    }
    const std::vector<std::size_t> places = places_of(names);
    py::array_t<double> rows({static_cast<py::ssize_t>(columns.size()), ticks});
    double *out = rows.mutable_data();
    const py::gil_scoped_release release;
    met_.clear();
    changes_ = -1;
    for (py::ssize_t k = 0; k < ticks; ++k) {
      const forceaxis::sim::SensorCodes sensed = plant_->codes();
      const axis_inputs_t in{sensed.encoder,
                             {sensed.adc[0], sensed.adc[1]},
                             AXIS_DIGITAL_INPUTS_ENABLE,
                             1,
                             0,
                             sensed.encoder_age,
                             sensed.force_age};
      axis_outputs_t put{};
      fw_tick(axis_.get(), &in, &put);
      std::int32_t fault = 0;
      fw_object_read(axis_.get(), AXIS_OBJ_FAULT, &fault);
      if (fault != AXIS_FAULT_NONE)
        throw SimulationError("the firmware latched the fault " +
                              forceaxis::host::enum_text(AXIS_OBJ_FAULT, fault));
      const double volts = plant_->volts(axis_host_dac_code(&put, dac_bits()));
      plant_->hold_volts(volts, put.amp_enable != 0);
      count_mode();
      const double value[] = {
          static_cast<double>(sensed.adc[0]), static_cast<double>(sensed.adc[1]),
          static_cast<double>(sensed.encoder), static_cast<double>(put.dac_code)};
      std::size_t next = 0;
      for (std::size_t i = 0; i < columns.size(); ++i)
        out[static_cast<py::ssize_t>(i) * ticks + k] =
            code[i] >= 0 ? value[code[i]] : checked(plant_->signal_at(places[next++]));
      plant_->step_volts(volts, put.amp_enable != 0, put.brake_release != 0);
    }
    return rows;
  }

  // Returns, for each state of each element, the number of samples in this state during the last
  // call of volts() or codes().
  std::map<std::string, std::int64_t> states() const {
    std::map<std::string, std::int64_t> counts;
    for (const auto &[mode, count] : met_)
      for (const std::string &state : mode) counts[state] += count;
    return counts;
  }

  // Returns the number of bits of ADC 0 and ADC 1. The number is 0 if the model does not have the
  // ADC.
  std::vector<int> adc_bits() const {
    std::vector<int> bits;
    for (const auto &adc : plant_->model().adc) bits.push_back(adc ? adc->bits : 0);
    return bits;
  }

 private:
  // Powers up the firmware with the resolution of the plant's DAC. The ADCs of a plant can have
  // different resolutions, but the firmware has only one parameter for the resolution, which is set
  // to the higher resolution.
  void power_up() {
    if (plant_->parts() != 1) throw std::invalid_argument("the firmware's tick has one part");
    axis_.reset(axis_host_create());
    int bits = 8;
    for (const auto &adc : plant_->model().adc)
      if (adc) bits = std::max(bits, adc->bits);
    fw_object_write(axis_.get(), FW_SOURCE_LOCAL, AXIS_OBJ_ADC_BITS, bits);
    fw_object_write(axis_.get(), FW_SOURCE_LOCAL, AXIS_OBJ_DAC_BITS, dac_bits());
    fw_object_write(axis_.get(), FW_SOURCE_LOCAL, AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  }

  // Returns the number of bits of the firmware's output.
  int dac_bits() const { return std::max<int>(plant_->model().dac->bits, AXIS_DAC_BITS_MIN); }

  std::vector<std::size_t> places_of(const std::vector<std::string> &signals) const {
    const auto &names = plant_->signal_names();
    std::vector<std::size_t> places;
    for (const std::string &signal : signals) {
      const auto found = std::find(names.begin(), names.end(), signal);
      if (found == names.end()) throw std::invalid_argument("no signal named " + signal);
      places.push_back(static_cast<std::size_t>(found - names.begin()));
    }
    return places;
  }

  // Counts a sample for the present states of all elements. The texts of the states are built only
  // after a change of a state, because building them is slow.
  void count_mode() {
    const std::int64_t changes = plant_->crossings() + plant_->jumps();
    if (changes != changes_) here_ = met_.try_emplace(plant_->mode(), 0).first;
    changes_ = changes;
    ++here_->second;
  }

  double checked(double value) const {
    if (!(value < kLargest && value > -kLargest))
      throw SimulationError(
          "the response left all bounds at t = " + std::to_string(plant_->time_s()) + " s");
    return value;
  }

  std::unique_ptr<Plant> plant_;
  // Number of samples for each combination of element states.
  std::map<std::vector<std::string>, std::int64_t> met_;
  std::map<std::vector<std::string>, std::int64_t>::iterator here_;
  std::int64_t changes_ = -1;
  std::unique_ptr<fw_t, AxisDeleter> axis_;
};

}  // namespace

void add_excite(py::module_ &m) {
  py::class_<Excited>(
      m, "Excited",
      "A simulated plant to which an excitation is applied. Each call continues from the state "
      "after the previous call. volts() applies voltages to the drive in steps of 1/(1500 parts) "
      "s; write() and codes() use the firmware instead (parts = 1). The drive is enabled from the "
      "first step on. clamped: contacts also pull.")
      .def(py::init<const std::filesystem::path &, const Overrides &, std::uint64_t, int, bool>(),
           py::arg("model"), py::arg("overrides") = Overrides{}, py::arg("seed") = 0,
           py::arg("parts") = 1, py::arg("clamped") = false)
      .def(
          "volts", &Excited::volts, py::arg("volts"), py::arg("signals"),
          "Applies n voltages in V, each for one step. Returns an array (len(signals), n) with the "
          "signals immediately after each change of the voltage. Raises SimulationError.")
      .def(
          "write", &Excited::write, py::arg("object"), py::arg("value"),
          "Writes an object of the firmware in its unit. Raises ValueError if the firmware refuses "
          "the value.")
      .def_property_readonly(
          "states", &Excited::states,
          "number of samples in each \"element: state\" in the last call of volts() "
          "or codes()")
      .def_property_readonly("adc_bits", &Excited::adc_bits,
                             "numbers of bits of ADC 0 and ADC 1; 0: no such ADC")
      .def("codes", &Excited::codes, py::arg("ticks"), py::arg("columns"),
           "Runs the firmware. Returns an array (len(columns), ticks). The columns adc0, adc1 and "
           "encoder have the codes converted in the tick, dac_code the code output in the tick, "
           "other columns the signals immediately after this output. Raises SimulationError, also "
           "for a latched fault.");
}
