#include "host/axis_node/axis.hpp"

#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdio>
#include <iostream>
#include <utility>

#include "firmware/objects/generated/axis_objects.h"
#include "host/program/json.hpp"
#include "host/run/objects.hpp"

namespace forceaxis::nodes {
namespace {

using namespace std::chrono_literals;

// Number of ticks between two calls of JournalWriter::flush(), equal to 1 s.
constexpr int kTicksPerFlush = 1500;
// Largest number of frames that wait for the CAN interface. Further frames are lost.
constexpr std::size_t kMostUnsent = 256;

// Returns the serial number of a node without the option --serial. The number is computed from the
// host name, and its last byte is the axis number. So a node has the same serial number in every
// run, and the nodes of a run have different serial numbers.
std::uint32_t serial_of(int axis) {
  std::array<char, 256> name{};
  gethostname(name.data(), name.size() - 1);
  std::uint32_t hash = 2166136261U;  // start value of the FNV-1a hash
  for (const char *at = name.data(); *at != 0; ++at) {
    hash = (hash ^ static_cast<std::uint8_t>(*at)) * 16777619U;
  }
  return (hash & ~UINT32_C(0xFF)) | static_cast<std::uint32_t>(axis);
}
constexpr char kIncidents[] = ".incidents";

using OpenFile = const char *(store_file_t *, const char *);

// Returns a number with all its digits, so that a reader gets the same double.
std::string exact(double value) {
  std::array<char, 32> digits{};
  std::snprintf(digits.data(), digits.size(), "%.17g", value);
  return digits.data();
}

// Return a value, or a struct with items(), as JSON.
std::string json_of(double value) { return exact(value); }
std::string json_of(const std::string &value) { return json_text(value); }
template <class T>
std::string json_of(const T &value);
template <class T>
std::string json_of(const std::vector<T> &values) {
  std::string text;
  for (const T &value : values) append(text, json_of(value));
  return "[" + text + "]";
}
template <class T>
std::string json_of(const T &value) {
  if constexpr (std::is_integral_v<T>) {
    return std::to_string(value);
  } else {
    JsonObject object;
    std::apply(
        [&](const auto &...items) {
          ((void)object.raw(items.key, json_of(std::invoke(items.get, value))), ...);
        },
        T::items());
    return object.text();
  }
}

std::unique_ptr<store_file_t, StoreCloser> open_store(const std::string &file,
                                                      OpenFile *open_file = store_file_open) {
  auto opened = std::make_unique<store_file_t>();
  if (const char *wrong = open_file(opened.get(), file.c_str())) {
    throw sim::InputError(file, "--store", wrong);
  }
  return std::unique_ptr<store_file_t, StoreCloser>(opened.release());
}
}  // namespace

void StoreCloser::operator()(store_file_t *store) const {
  store_file_close(store);
  delete store;
}

void expect_files(const AxisOptions &options, const std::string &suffix) {
  if (!options.journal.empty()) host::expect_journal(options.journal + suffix, "--journal");
  if (options.store.empty()) return;
  const std::string file = options.store + suffix;
  host::expect_writable(file, "--store");
  if (access(file.c_str(), F_OK) == 0) open_store(file);
  const std::string archive = file + kIncidents;
  if (access(archive.c_str(), F_OK) == 0) open_store(archive, archive_file_open);
}

Axis::Axis(int number, int first_axis, const host::Experiment &experiment,
           std::span<const std::string> overrides, const AxisOptions &options,
           const std::string &suffix)
    : number_(number), experiment_(experiment) {
  // Files are opened after the CAN interface, so that no file changes if the interface cannot be
  // opened.
  if (!options.can.empty()) can_ = std::make_unique<CanPort>(options.can);
  if (!options.store.empty()) {
    store_ = open_store(options.store + suffix);
    config_.memory = &store_->memory;
    archive_ = open_store(options.store + suffix + kIncidents, archive_file_open);
    config_.archive = &archive_->memory;
  }
  real_time_ = options.real_time;
  config_.hardware = "host";
  const int place = number - first_axis;
  const int node_id = options.node_id.value_or(first_axis);
  const bool by_lss = node_id == FW_NODE_ID_BY_LSS;
  config_.node_id = static_cast<std::uint8_t>(by_lss ? node_id : node_id + place);
  config_.serial_number =
      options.serial ? *options.serial + static_cast<std::uint32_t>(place) : serial_of(number);
  config_.buses = options.buses();
  config_.modbus_baud = static_cast<std::uint32_t>(options.modbus_baud);
  if (!options.journal.empty()) {
    journal_file_ = options.journal + suffix;
    journal_ =
        std::make_unique<host::JournalWriter>(journal_file_, "--journal", experiment, overrides);
    journal_->power_up(config_);
  }
  host::FirmwareOptions firmware{.hash = true, .config = &config_};
  if (store_) firmware.store = options.store + suffix;
  if (journal_) {
    firmware.writing = [this](std::int64_t tick, const host::ObjectWrite &w) {
      journal_->write(tick, w.object, w.raw);
    };
  }
  firmware_ = std::make_unique<host::FirmwareSide>(experiment, firmware);
  // Each journal entry has the number of the tick before which the input is passed to the firmware.
  handlers_.frame = [this](const can_frame_t &frame) {
    if (journal_) journal_->can(coming(), frame);
    fw_can_receive(axis(), &frame);
  };
  handlers_.lost = [this](std::uint16_t frames) {
    if (journal_) journal_->lost(coming(), frames);
    fw_can_lost(axis(), frames);
  };
  handlers_.state = [this](std::uint8_t state) {
    if (journal_) journal_->bus(coming(), state);
    fw_can_bus(axis(), state);
  };
}

host::LinkOutputs Axis::tick(const host::LinkInputs &in, ModbusPort *modbus) {
  if (real_time_ && late_.late(std::chrono::steady_clock::now().time_since_epoch() / 1ns)) {
    if (journal_) journal_->overrun(coming());
    fw_overrun(axis(), 0);
  }
  if (can_) can_->receive(handlers_);
  const host::LinkOutputs out = firmware_->tick(in);
  transmit(modbus);
  flush_journal();
  return out;
}

host::LinkOutputs Axis::lose_sensors(ModbusPort *modbus) {
  if (can_) can_->receive(handlers_);
  if (journal_) journal_->sensorless(coming());
  const auto out = firmware_->lose_sensors(static_cast<std::uint8_t>(number_));
  transmit(modbus);
  flush_journal();
  return out;
}

void Axis::flush_journal() {
  if (!journal_ || ++unflushed_ < kTicksPerFlush) return;
  unflushed_ = 0;
  journal_->flush();
  report_broken_journal();
}

void Axis::receive_modbus(std::span<const std::uint8_t> bytes) {
  if (journal_) journal_->modbus(coming(), bytes);
  fw_modbus_receive(axis(), bytes.data(), static_cast<std::uint16_t>(bytes.size()));
}

std::string Axis::json() {
  std::string refused;
  for (const host::Refusal &r : firmware_->refused()) {
    append(refused,
           JsonObject().add("tick", r.tick).add("object", r.object).add("reason", r.reason).text());
  }
  const std::string hash = firmware_->hash();
  if (journal_) journal_->end(coming(), hash);
  report_broken_journal();
  JsonObject o;
  o.add("axis", number_)
      .add("experiment", experiment_.file.string())
      .add("inputs_hash", experiment_.hash)
      .add("ticks", coming())
      .add("trace_hash", hash)
      .add("fault", host::enum_text(AXIS_OBJ_FAULT, firmware_->read(AXIS_OBJ_FAULT)))
      .add("overruns", firmware_->read(AXIS_OBJ_OVERRUNS))
      .raw("refused", "[" + refused + "]");
  if (const auto cycle = firmware_->cycle()) o.raw("cycle", json_of(*cycle));
  if (!lost.empty()) o.raw("after_silence", lost);
  return o.text();
}

// Reports a broken journal once. This is only a warning, because a stop of the axis could be
// dangerous.
void Axis::report_broken_journal() {
  if (!journal_broken() || std::exchange(reported_broken_, true)) return;
  std::cerr << "axis_node: " << journal_file_
            << ": cannot write the journal, so the journal is incomplete\n";
}

void Axis::transmit(ModbusPort *modbus) {
  // The frames of the firmware are fetched in every tick, also without a bus, so that a replay
  // gives the same result. Frames wait if the queue of the CAN interface is full. Frames are
  // discarded while the interface is down, because they would be outdated later.
  const bool off = !can_ || can_->is_off();
  if (off) unsent_.clear();
  for (can_frame_t frame; fw_can_transmit(axis(), &frame);) {
    if (!off && unsent_.size() < kMostUnsent) unsent_.push_back(frame);
  }
  while (!unsent_.empty() && can_->send(unsent_.front())) unsent_.pop_front();
  std::array<std::uint8_t, 512> bytes;
  while (const std::uint16_t n = fw_modbus_transmit(axis(), bytes.data(), bytes.size())) {
    if (modbus != nullptr) modbus->send({bytes.data(), n});
  }
}

}  // namespace forceaxis::nodes
