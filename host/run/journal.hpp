#pragma once
// A journal records all inputs of a firmware with buses: the stored parameters at power-up, frames,
// bytes, and the writes of the experiment. Each entry has the tick before which the firmware
// received the input. The times of bus messages are not repeatable, but a replay of the journal
// repeats the run in one process and gives the same outputs to the last bit.
//
// A journal belongs to one axis. The file is a text file with one entry in each line:
//   forceaxis-journal 1             name and version of the format
//   experiment FILE                 the experiment of the run; overrides and hash follow
//   set NAME=VALUE
//   inputs_hash HEX
//   endless                         the run had no duration
//   config NODE BUSES BAUD SERIAL   the configuration of the firmware at power-up
//   store HEX                       content of the store of the axis
//   archive HEX                     content of the incident archive of the axis
//   write TICK OBJECT RAW           a write of the experiment
//   can TICK ID LENGTH HEX          a CAN data frame
//   can TICK ID R                   a CAN remote frame
//   lost TICK COUNT                 CAN frames that the kernel dropped
//   bus TICK STATE                  a change of the state of the CAN bus
//   modbus TICK HEX                 bytes of Modbus
//   overrun TICK                    a late tick
//   sensorless TICK COUNT           ticks of the firmware without sensor values
//   end TICKS HASH                  number of ticks and trace hash of the run
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

// First line of a journal. The number 1 is the version of the format.
inline constexpr char kJournalTitle[] = "forceaxis-journal 1";

class JournalWriter {
 public:
  // Creates the file, or replaces an existing journal. Throws sim::InputError if the existing file
  // is not a journal, cannot be written, or is locked by another process. `option` is the name for
  // the file in the message of this error.
  JournalWriter(const std::filesystem::path &file, const char *option, const Experiment &experiment,
                std::span<const std::string> overrides);
  ~JournalWriter();
  JournalWriter(const JournalWriter &) = delete;
  JournalWriter &operator=(const JournalWriter &) = delete;

  // Returns true if all flushed entries were written to the file. If the disk is full, the run
  // continues without the journal.
  bool good() const { return out_.good(); }
  // Writes and flushes the entries for the state at power-up: config, store and archive.
  void power_up(const fw_config_t &config);
  void write(std::int64_t tick, std::uint16_t object, std::int32_t raw);
  void can(std::int64_t tick, const can_frame_t &frame);
  void lost(std::int64_t tick, std::uint16_t frames);
  void bus(std::int64_t tick, std::uint8_t state);
  void modbus(std::int64_t tick, std::span<const std::uint8_t> bytes);
  void overrun(std::int64_t tick);
  // Records one tick of the firmware without sensor values, before `tick`. Consecutive ticks
  // without sensor values share one entry if there is no input between them, so a long time without
  // messages needs little space.
  void sensorless(std::int64_t tick);
  void end(std::int64_t ticks, const std::string &hash);
  // Must be called at intervals, because all entries that are not flushed are lost if the process
  // is killed.
  void flush();

 private:
  std::ostream &entry();
  void write_memory(const char *kind, const store_memory_t &memory);

  int lock_;
  std::ofstream out_;
  std::int64_t sensorless_tick_ = 0;
  // Number of ticks without sensor values that have no entry in the file yet.
  std::int64_t sensorless_ = 0;
};

// Checks the file like the constructor of JournalWriter and throws the same exceptions, but does
// not change the file.
void expect_journal(const std::filesystem::path &file, const char *option);

// Checks that an existing file, or a new file in an existing folder, can be written. Throws
// sim::InputError.
void expect_writable(const std::filesystem::path &file, const char *option);

struct Journal {
  // The types of inputs, other than writes and frames, that an entry records.
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
  // Content of the store at power-up; empty if the axis had no store.
  std::vector<std::uint8_t> store;
  bool has_store = false;
  // Content of the incident archive of the black box at power-up.
  std::vector<std::uint8_t> archive;
  bool has_archive = false;
  std::vector<Entry> entries;
  std::int64_t ticks = -1;  // number of ticks of the recorded run; -1: the journal has no entry
                            // `end`
  std::string trace_hash;

  // Returns the number of ticks of the recorded run. If the journal has no entry `end`, returns the
  // number of ticks up to the last entry.
  std::int64_t known_ticks() const;

  // Returns the experiment of the journal with the duration of the recorded run. This function does
  // not compare the hash of the inputs. Throws sim::InputError.
  Experiment load() const;
};

// Reads a journal. Throws sim::InputError, which names the file and the line.
Journal read_journal(const std::filesystem::path &file);

}  // namespace forceaxis::host
