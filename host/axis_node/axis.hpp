#pragma once
// One axis of axis_node: the firmware, the buses, the store and the journal of this axis.
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

// The options of axis_node that plant_node does not have.
struct AxisOptions {
  std::string can;     // name of the CAN interface that all axes use; empty: no CANopen
  std::string modbus;  // path of the serial device that all axes use; empty: no Modbus
  int modbus_baud = 115200;
  std::string store;
  std::string journal;
  std::optional<int> node_id;  // Node id of the first axis. The default is the number of this axis.
  std::optional<std::uint32_t> serial;  // CANopen serial number of the first axis.
  double hold_s = 0;
  bool serve = false;
  bool real_time = false;  // true: late ticks are counted

  bool buses() const { return !can.empty() || !modbus.empty(); }
};

// Checks the files of --store and --journal. This check is made before any file is opened, so that
// a run that cannot start does not create or change a file. Throws sim::InputError.
void expect_files(const AxisOptions &options, const std::string &suffix);

struct StoreCloser {
  void operator()(store_file_t *store) const;
};

class Axis {
 public:
  // Opens CAN interface, store and journal. `suffix` is appended to the file names of store and
  // journal. The experiment must exist as long as the axis. Throws sim::InputError, TransportError
  // and canopen::CanError.
  Axis(int number, int first_axis, const host::Experiment &experiment,
       std::span<const std::string> overrides, const AxisOptions &options,
       const std::string &suffix);

  // Passes the received bus data to the firmware, then computes the next tick of the firmware.
  host::LinkOutputs tick(const host::LinkInputs &in, ModbusPort *modbus);
  // Computes a tick without sensor values, in which the drive is disabled and the DAC code is 0.
  // The trace does not contain this tick.
  host::LinkOutputs lose_sensors(ModbusPort *modbus);
  void receive_modbus(std::span<const std::uint8_t> bytes);

  // Completes hash and journal, and returns the report of the axis as JSON. To be called after the
  // last tick.
  std::string json();

  bool journal_broken() const { return journal_ && !journal_->good(); }
  int number() const { return number_; }
  std::int64_t coming() const { return firmware_->next_tick(); }

  // Text for the report: reaction of the axis after the plant has stopped sending.
  std::string lost;

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
  // Incident archive of the black box, in a second file next to the store.
  std::unique_ptr<store_file_t, StoreCloser> archive_;
  std::unique_ptr<host::JournalWriter> journal_;
  std::unique_ptr<CanPort> can_;
  CanPort::Handlers handlers_;
  std::unique_ptr<host::FirmwareSide> firmware_;
  std::deque<can_frame_t> unsent_;
};

}  // namespace forceaxis::nodes
