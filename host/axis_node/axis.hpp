#pragma once
// One axis of axis_node: its firmware, its bus, its store and its journal.
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "firmware/port/host/store_file.h"
#include "host/axis_node/buses.hpp"
#include "host/link/late_ticks.hpp"
#include "host/run/firmware_side.hpp"
#include "host/run/journal.hpp"

namespace forceaxis::nodes {

// The options that only axis_node has.
struct AxisOptions {
  std::string can;     // CAN interface of the axes; empty: no CANopen
  std::string modbus;  // serial device of the axes; empty: no Modbus
  int modbus_baud = 115200;
  std::string store;
  std::string journal;
  std::optional<int> node_id;           // node id of the first axis; default: its axis number
  std::optional<std::uint32_t> serial;  // serial number of the first axis
  double hold_s = 0;
  bool serve = false;
  bool real_time = false;  // count late ticks

  bool buses() const { return !can.empty() || !modbus.empty(); }
};

// Checks the files of --store and --journal before any file is opened, so a run that cannot start
// neither creates nor changes a file. Throws sim::InputError.
void expect_files(const AxisOptions &options, const std::string &suffix);

struct StoreCloser {
  void operator()(store_file_t *store) const;
};

class Axis {
 public:
  // Opens bus, store and journal. `suffix` is appended to the names of their files. The experiment
  // must exist as long as the axis. Throws sim::InputError, TransportError and canopen::CanError.
  Axis(int number, int first_axis, const host::Experiment &experiment,
       std::span<const std::string> overrides, const AxisOptions &options,
       const std::string &suffix);

  // Applies the data that the buses have received, then computes the next tick of the firmware.
  host::LinkOutputs tick(const host::LinkInputs &in, ModbusPort *modbus);
  // Computes a tick without sensor values: the drive is disabled and the DAC code is 0. The tick is
  // not part of the trace.
  host::LinkOutputs lose_sensors(ModbusPort *modbus);
  void receive_modbus(std::span<const std::uint8_t> bytes);

  // To be called after the last tick. Closes hash and journal and returns the report.
  std::string json();

  bool journal_broken() const { return journal_ && !journal_->good(); }
  int number() const { return number_; }
  std::int64_t coming() const { return firmware_->next_tick(); }

  std::string lost;  // text of the axis' reaction to the silence of the plant

 private:
  fw_t *axis() { return firmware_->axis(); }
  void report_broken_journal();
  void flush_journal();
  void transmit(ModbusPort *modbus);

  int number_;
  const host::Experiment &experiment_;
  fw_config_t config_{};
  bool real_time_ = false;
  host::LateTicks late_;
  int unflushed_ = 0;
  std::string journal_file_;
  bool reported_broken_ = false;
  std::unique_ptr<store_file_t, StoreCloser> store_;
  std::unique_ptr<store_file_t, StoreCloser> archive_;  // archive of incidents, in a file next to
                                                        // the store
  std::unique_ptr<host::JournalWriter> journal_;
  std::unique_ptr<CanPort> can_;
  CanPort::Handlers handlers_;
  std::unique_ptr<host::FirmwareSide> firmware_;
  std::deque<can_frame_t> unsent_;
};

}  // namespace forceaxis::nodes
