// The CANopen master of a CiA 402 drive, for Python. The master is called once in each tick of
// simulated time. Frames are exchanged as identifiers and bytes.
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cstdint>
#include <map>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "host/python/binding/parts.hpp"
#include "host/python/binding/table.hpp"
#include "host/run/item.hpp"

extern "C" {
#include "firmware/drive402/drive402.h"
#include "firmware/drive402/drive402_cycle.h"
#include "firmware/drive402/drive402_names.h"
}

namespace py = pybind11;

namespace {

using Entries = std::vector<std::tuple<std::uint16_t, std::uint8_t, std::uint8_t, std::uint32_t>>;
using Settings = std::map<std::string, std::int64_t>;

std::string lower(std::string name) {
  for (char &c : name) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c + 'a' - 'A') : c;
  return name;
}

#define NAME(name, text) #name,
const char *const kPhases[] = {DRIVE402_PHASES(NAME)};
const char *const kStates[] = {DRIVE402_STATES(NAME)};
const char *const kReasons[] = {DRIVE402_REASONS(NAME)};
#undef NAME

// The data that the master has about its drive, with names in place of numbers.
struct Feedback {
  static constexpr const char *kName = "DriveFeedback";
  static constexpr const char *kMeaning =
      "What a master knows of its drive: drive402_feedback_t in "
      "firmware/drive402/drive402_state.h.";
  static constexpr bool kDict = true;
  drive402_feedback_t f;

  struct Flag {
    std::uint8_t drive402_feedback_t::*member;
    bool operator()(const Feedback &feedback) const { return feedback.f.*member != 0; }
  };
  struct Text {
    const char *const *names;
    std::uint8_t drive402_feedback_t::*member;
    std::string operator()(const Feedback &feedback) const {
      return lower(names[feedback.f.*member]);
    }
  };
  std::string reason_text() const { return drive402_reason_text(f.reason); }
  std::string key() const {
    const char *key = drive402_key(&f);
    return key == nullptr ? "" : key;
  }

  static constexpr auto items() {
    using forceaxis::host::item;
    using forceaxis::host::Within;
    using F = drive402_feedback_t;
    constexpr auto f = &Feedback::f;
    return std::tuple{
        item("position_cnt", Within{f, &F::position_cnt}),
        item("torque", Within{f, &F::torque}, "per mille of the rated torque"),
        item("age_ticks", Within{f, &F::age_ticks}, "age of position and torque"),
        item("statusword", Within{f, &F::statusword}),
        item("error_code", Within{f, &F::error_code}),
        item("fitted", Flag{&F::fitted}, "True if the configuration was accepted"),
        item("on", Flag{&F::on}, "True if targets act"),
        item("fault", Flag{&F::fault}),
        item("limit", Flag{&F::limit}),
        item("saturated", Flag{&F::saturated}),
        item("phase", Text{kPhases, &F::phase}),
        item("state", Text{kStates, &F::state}),
        item("reason", Text{kReasons, &F::reason}, "first failure since the last reset"),
        item("reason_text", &Feedback::reason_text),
        item("failed_index", Within{f, &F::failed_index}),
        item("failed_sub", Within{f, &F::failed_sub}),
        item("abort_code", Within{f, &F::abort_code}),
        item("key", &Feedback::key, "setting that the drive refused; empty if there is none")};
  }
};

class DriveMaster {
 public:
  DriveMaster(Settings settings, const Entries &extra) {
    for (const auto &[index, sub, bytes, value] : extra)
      extra_.push_back({index, sub, bytes, value});
    if (extra_.size() > UINT8_MAX)
      throw std::invalid_argument("extra: expected at most 255 entries");
    config_.extra = extra_.data();
    config_.extra_count = static_cast<std::uint8_t>(extra_.size());
    read(settings, "scale_num", config_.scale_num);
    read(settings, "scale_den", config_.scale_den);
    read(settings, "target_max", config_.target_max);
    read(settings, "heartbeat_ms", config_.heartbeat_ms);
    read(settings, "heartbeat_timeout_ms", config_.heartbeat_timeout_ms);
    read(settings, "sdo_timeout_ms", config_.sdo_timeout_ms);
    read(settings, "wait_ms", config_.wait_ms);
    read(settings, "quick_stop_ms", config_.quick_stop_ms);
    read(settings, "abort_option", config_.abort_option);
    read(settings, "cycle_ms", config_.cycle_ms);
    read(settings, "mode", config_.mode);
    read(settings, "rpdo_type", config_.rpdo_type);
    read(settings, "node_id", config_.node_id);
    read(settings, "own_node_id", config_.own_node_id);
    read(settings, "without", config_.without);
    read(settings, "differs", config_.differs);
    if (!settings.empty())
      throw std::invalid_argument(settings.begin()->first +
                                  ": expected a field of drive402_config_t");
    const std::uint8_t reason = drive402_init(&master_, &config_);
    if (reason != DRIVE402_NONE) throw std::invalid_argument(drive402_reason_text(reason));
  }
  DriveMaster(const DriveMaster &) = delete;
  DriveMaster &operator=(const DriveMaster &) = delete;

  void receive(std::uint16_t id, const std::string &data) {
    if (data.size() > 8) throw std::invalid_argument("data: expected at most 8 bytes");
    can_frame_t frame{};
    frame.id = id;
    frame.length = static_cast<std::uint8_t>(data.size());
    std::copy(data.begin(), data.end(), frame.data);
    drive402_receive(&master_, &frame);
  }

  void bus(bool off, std::uint16_t frames_lost) {
    drive402_bus(&master_, off ? CAN_BUS_OFF : CAN_BUS_ACTIVE, frames_lost);
  }

  std::vector<std::pair<int, py::bytes>> tick(std::int32_t target, bool enable, bool reset) {
    const drive402_command_t command{target, static_cast<std::uint8_t>(enable),
                                     static_cast<std::uint8_t>(reset)};
    drive402_tick(&master_, &command);
    std::vector<std::pair<int, py::bytes>> frames;
    for (can_frame_t f{}; drive402_transmit(&master_, &f);)
      frames.emplace_back(f.id, py::bytes(reinterpret_cast<const char *>(f.data), f.length));
    return frames;
  }

  py::object feedback() const { return table::object(Feedback{drive402_feedback(&master_)}); }

 private:
  // Moves the value of a setting to the variable `field`. Every setting is required.
  template <typename T>
  static void read(Settings &settings, const char *name, T &field) {
    const auto found = settings.find(name);
    if (found == settings.end()) throw std::invalid_argument(std::string(name) + ": missing");
    field = static_cast<T>(found->second);
    if (static_cast<std::int64_t>(field) != found->second)
      throw std::invalid_argument(std::string(name) + ": out of range");
    settings.erase(found);
  }

  std::vector<drive402_entry_t> extra_;
  drive402_config_t config_{};
  drive402_t master_{};
};

}  // namespace

void add_drive402(py::module_ &m) {
  table::add_results<Feedback>();
  py::class_<DriveMaster>(m, "DriveMaster",
                          "A master of one CiA 402 drive on CANopen (firmware/drive402), in ticks "
                          "of 1/1500 s.")
      .def(py::init<Settings, const Entries &>(), py::arg("settings"), py::arg("extra") = Entries{},
           "settings: every field of drive402_config_t but the extra entries; extra: (index, sub, "
           "bytes, value) of each. Raises ValueError with the reason of a refusal.")
      .def("receive", &DriveMaster::receive, py::arg("id"), py::arg("data"),
           "Takes a received frame.")
      .def("bus", &DriveMaster::bus, py::arg("off"), py::arg("frames_lost"),
           "Tells that the bus is off, and the number of lost frames.")
      .def("tick", &DriveMaster::tick, py::arg("target"), py::arg("enable"), py::arg("reset"),
           "Computes a tick. Returns the frames to send, (identifier, bytes).")
      .def("feedback", &DriveMaster::feedback, "Returns what the master knows of the drive.");
}
