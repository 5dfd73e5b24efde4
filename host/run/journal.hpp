#pragma once
// A journal records all inputs of a firmware on buses, in order, each with the tick before which
// the firmware received it: the stored parameters at power-up, frames, bytes, and the writes of the
// experiment. Buses work in wall time. A replay of the journal repeats the run in one process and
// gives the same outputs to the last bit.
//
// A journal belongs to one axis. It is a text file with one entry in each line:
//   forceaxis-journal 1             name and version of the format
//   experiment FILE                 the experiment of the run, with its overrides and its hash
//   set NAME=VALUE
//   inputs_hash HEX
//   endless                         the run had no duration
//   config NODE BUSES BAUD SERIAL   the configuration of the firmware at power-up
//   store HEX                       its stored parameters
//   archive HEX                     its archive of incidents
//   write TICK OBJECT RAW           a write of the experiment
//   can TICK ID LENGTH HEX          a CAN data frame
//   can TICK ID R                   a CAN remote frame
//   lost TICK COUNT                 CAN frames that the kernel dropped
//   bus TICK STATE                  a change of the state of the CAN bus
//   modbus TICK HEX                 bytes of Modbus
//   overrun TICK                    a late tick
//   sensorless TICK COUNT           ticks of the firmware without sensor values
//   end TICKS HASH                  length of the run, and its trace hash
// The tick of initial writes is 0. Bytes are hexadecimal; an empty list of bytes is "-". A
// truncated journal has no `end`. A truncated line is ignored.
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "firmware/port/host/axis_host.h"
#include "host/run/experiment.hpp"

namespace forceaxis::host {

// First line of a journal. The number is the version of the format.
inline constexpr char kJournalTitle[] = "forceaxis-journal 1";

class JournalWriter {
 public:
  // Creates the file, or replaces an existing journal. Throws sim::InputError if the existing file
  // is not a journal, cannot be written, or is locked by another process.
  JournalWriter(const std::filesystem::path &file, const Experiment &experiment,
                std::span<const std::string> overrides);
  ~JournalWriter();
  JournalWriter(const JournalWriter &) = delete;
  JournalWriter &operator=(const JournalWriter &) = delete;

  // Returns whether the file has all flushed entries. If the disk is full, the run continues and
  // the journal ends.
  bool good() const { return out_.good(); }
  // Writes and flushes the state of the firmware at power-up, with its stored parameters.
  void power_up(const fw_config_t &config);
  void write(std::int64_t tick, std::uint16_t object, std::int32_t raw);
  void can(std::int64_t tick, const can_frame_t &frame);
  void lost(std::int64_t tick, std::uint16_t frames);
  void bus(std::int64_t tick, std::uint8_t state);
  void modbus(std::int64_t tick, std::span<const std::uint8_t> bytes);
  void overrun(std::int64_t tick);
  // Records one tick of the firmware without sensor values, before `tick`. Consecutive ticks of
  // this kind with no input between them share one entry, so a long silence needs little space.
  void sensorless(std::int64_t tick);
  void end(std::int64_t ticks, const std::string &hash);
  // Must be called at intervals, because a killed process loses all entries that are not flushed.
  void flush();

 private:
  std::ostream &entry();
  void write_memory(const char *kind, const store_memory_t &memory);

  int lock_;
  std::ofstream out_;
  std::int64_t sensorless_tick_ = 0;
  std::int64_t sensorless_ = 0;  // number of ticks of the sensorless entry not yet written
};

// Throws the exceptions of the constructor of JournalWriter for this file, and changes nothing.
void expect_journal(const std::filesystem::path &file);

// Throws sim::InputError unless this file, or a new file in its folder, can be written.
void expect_writable(const std::filesystem::path &file, const char *option);

struct Journal {
  // The inputs of the firmware that an entry records, other than writes and frames.
  struct FramesLost {
    std::uint16_t count;
  };
  struct BusState {
    std::uint8_t state;
  };
  struct ModbusBytes {
    std::vector<std::uint8_t> bytes;
  };
  struct Overrun {};
  struct Sensorless {
    std::int64_t count;
  };
  struct Entry {
    std::int64_t tick;
    std::variant<ObjectWrite, can_frame_t, FramesLost, BusState, ModbusBytes, Overrun, Sensorless>
        what;
  };

  std::filesystem::path file;
  std::filesystem::path experiment;
  std::vector<std::string> overrides;
  std::string inputs_hash;
  bool endless = false;
  std::uint8_t node_id = 0;
  std::uint32_t serial_number = 0;
  std::uint8_t buses = 0;
  std::uint32_t modbus_baud = 0;
  std::vector<std::uint8_t> store;  // stored parameters; empty if the axis had no store
  bool has_store = false;
  std::vector<std::uint8_t> archive;  // archive of incidents of the black box
  bool has_archive = false;
  std::vector<Entry> entries;
  std::int64_t ticks = -1;  // number of ticks; -1: the journal has no entry `end`
  std::string trace_hash;

  // Returns the number of ticks of the journal; without `end`, the ticks up to the last entry.
  std::int64_t known_ticks() const;

  // Returns the experiment of the journal with the duration of the recorded run. Throws
  // sim::InputError. The hash of the inputs is not compared.
  Experiment load() const;
};

// Reads a journal. Throws sim::InputError, which names the file and the line.
Journal read_journal(const std::filesystem::path &file);

}  // namespace forceaxis::host
