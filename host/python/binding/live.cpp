// A simulated axis for commissioning, with firmware and plant in one process. The caller reads and
// writes objects as over a bus. The simulated time advances only when the caller requests this.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "firmware/port/host/axis_host.h"
#include "firmware/port/host/store_file.h"
#include "host/python/binding/parts.hpp"
#include "host/python/binding/table.hpp"
#include "host/run/firmware_side.hpp"
#include "host/run/item.hpp"
#include "host/run/plant_side.hpp"
#include "sim/model/elements/contact.hpp"

namespace py = pybind11;
using forceaxis::host::Experiment;
using forceaxis::host::FirmwareSide;
using forceaxis::host::LinkInputs;
using forceaxis::host::LinkOutputs;
using forceaxis::host::PlantSide;

namespace {

constexpr std::uint8_t kNode = 1;

Experiment endless(const std::filesystem::path &file, const std::vector<std::string> &overrides) {
  Experiment experiment = forceaxis::host::load_experiment(file, overrides);
  forceaxis::host::expect_used(experiment);
  forceaxis::host::make_endless(experiment);
  return experiment;
}

struct Extremes {
  static constexpr const char *kName = "Extremes";
  static constexpr const char *kMeaning =
      "What a simulated axis has reached since a reset of them.";
  static constexpr bool kDict = true;
  double force_N = 0;
  std::int32_t position_min_cnt = INT32_MAX;
  std::int32_t position_max_cnt = INT32_MIN;

  static constexpr auto items() {
    using forceaxis::host::item;
    return std::tuple{item("force_N", &Extremes::force_N, "largest true contact force"),
                      item("position_min_cnt", &Extremes::position_min_cnt),
                      item("position_max_cnt", &Extremes::position_max_cnt)};
  }
};

class LiveAxis {
 public:
  LiveAxis(const std::filesystem::path &file, const std::vector<std::string> &overrides,
           const std::filesystem::path &store)
      : experiment_(endless(file, overrides)), plant_(experiment_, {.trace = false}) {
    if (!store.empty()) {
      config_.memory = open(store_, store.string(), store_file_open);
      config_.archive = open(archive_, store.string() + ".incidents", archive_file_open);
    }
    config_.buses = 1;
    config_.node_id = kNode;
    config_.hardware = "simulator";
    firmware_ = std::make_unique<FirmwareSide>(
        experiment_, forceaxis::host::FirmwareOptions{.config = &config_, .store = store.string()});
    can_frame_t start{};  // NMT command "start" for all nodes
    start.length = 2;
    start.data[0] = 1;
    fw_can_receive(firmware_->axis(), &start);
    for (const auto &contact : experiment_.model->contacts) {
      const auto &names = plant_.plant().signal_names();
      const auto found = std::find(names.begin(), names.end(), contact.name + ".force");
      contact_forces_.push_back(static_cast<std::size_t>(found - names.begin()));
    }
  }

  void step(std::int64_t ticks) {
    const py::gil_scoped_release release;
    for (std::int64_t i = 0; i < ticks; ++i) {
      const LinkInputs &in = plant_.sense();
      reached_.position_min_cnt = std::min(reached_.position_min_cnt, in.encoder_cnt);
      reached_.position_max_cnt = std::max(reached_.position_max_cnt, in.encoder_cnt);
      const LinkOutputs out = firmware_->tick(in);
      firmware_->discard_output();
      plant_.act(out);
      for (const std::size_t place : contact_forces_)
        reached_.force_N = std::max(reached_.force_N, plant_.plant().signal_at(place));
    }
  }

  void end_schedule() {
    for (auto &action : experiment_.actions) action.writes.clear();
  }

  std::int32_t read(std::uint16_t object) const {
    std::int32_t raw = 0;
    const int error = fw_object_read(firmware_->axis(), object, &raw);
    if (error != FW_OK) throw py::key_error(std::to_string(error));
    return raw;
  }

  int write(std::uint16_t object, std::int64_t raw) {
    return fw_object_write(firmware_->axis(), FW_SOURCE_LCM, object,
                           static_cast<std::int32_t>(static_cast<std::uint32_t>(raw)));
  }

  py::array_t<std::int32_t> samples(std::uint32_t first, std::uint32_t count, int channels) const {
    py::array_t<std::int32_t> rows(
        {static_cast<py::ssize_t>(count), static_cast<py::ssize_t>(channels)});
    std::int32_t values[RECORDER_CHANNELS] = {};
    for (std::uint32_t i = 0; i < count; ++i) {
      if (fw_recorder_read(firmware_->axis(), first + i, values) < channels)
        throw std::out_of_range("no such sample");
      std::copy(values, values + channels, rows.mutable_data(i, 0));
    }
    return rows;
  }

  py::object extremes() const { return table::object(reached_); }
  void reset_extremes() { reached_ = {}; }

  double signal(const std::string &name) const { return plant_.plant().signal(name); }
  std::int64_t ticks() const { return plant_.tick(); }

 private:
  struct CloseStore {
    void operator()(store_file_t *store) const {
      store_file_close(store);
      delete store;
    }
  };
  using StoreFile = std::unique_ptr<store_file_t, CloseStore>;

  template <class OpenFile>
  static const store_memory_t *open(StoreFile &file, const std::string &path, OpenFile open_file) {
    auto opened = std::make_unique<store_file_t>();
    if (const char *wrong = open_file(opened.get(), path.c_str()))
      throw forceaxis::sim::InputError(path, "store", wrong);
    file.reset(opened.release());
    return &file->memory;
  }

  Experiment experiment_;
  PlantSide plant_;
  StoreFile store_;
  StoreFile archive_;
  fw_config_t config_{};
  std::unique_ptr<FirmwareSide> firmware_;
  std::vector<std::size_t> contact_forces_;
  Extremes reached_;
};

}  // namespace

void add_live(py::module_ &m) {
  table::add_results<Extremes>();
  py::class_<LiveAxis>(
      m, "LiveAxis",
      "The simulated axis of an experiment: the firmware with buses and store, and the plant. The "
      "NMT state is operational. Writes have the source lcm, so the owner and the watchdog apply. "
      "Time advances only in step(). Commands of [firmware] are executed at the start, the tables "
      "[[at]] at their times. The run has no end and no verdict.")
      .def(py::init<const std::filesystem::path &, const std::vector<std::string> &,
                    const std::filesystem::path &>(),
           py::arg("experiment"), py::arg("overrides") = std::vector<std::string>{},
           py::arg("store") = std::filesystem::path{},
           "store: file of the parameter store, or \"\" for no store. Raises InputError.")
      .def("step", &LiveAxis::step, py::arg("ticks"),
           "Simulates a number of ticks of 1/1500 s. Raises SimulationError.")
      .def("end_schedule", &LiveAxis::end_schedule,
           "After this call, the tables [[at]] do not write to the firmware. Impulses and sensor "
           "failures remain.")
      .def("read", &LiveAxis::read, py::arg("object"),
           "Returns the raw value of the object with this number, an unsigned value as int32. "
           "Raises "
           "KeyError(FW_ERROR_).")
      .def("write", &LiveAxis::write, py::arg("object"), py::arg("raw"),
           "Writes a raw value. Returns FW_OK or FW_ERROR_.")
      .def("samples", &LiveAxis::samples, py::arg("first"), py::arg("count"), py::arg("channels"),
           "Returns the raw values of a finished recording as an array (count, channels). Raises "
           "IndexError for samples that do not exist.")
      .def_property_readonly("extremes", &LiveAxis::extremes,
                             "largest true contact force in N, smallest and largest encoder count "
                             "of all ticks since reset_extremes(); only for tests")
      .def("reset_extremes", &LiveAxis::reset_extremes)
      .def("signal", &LiveAxis::signal, py::arg("name"),
           "Returns the present value of a true signal of the plant.")
      .def_property_readonly("ticks", &LiveAxis::ticks, "number of simulated ticks");
}
