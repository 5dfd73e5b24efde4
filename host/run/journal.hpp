#pragma once
// A journal records everything that a firmware on buses received, in order, each with the tick
// before which it was applied: the stored parameters at power-up, frames, bytes, the experiment's
// writes. Buses run in wall time; replaying its journal repeats a run in process, to the last bit.
//
// One axis, text, one entry a line:
//   forceaxis-journal 1
//   experiment FILE / set NAME=VALUE / inputs_hash HEX     the run that it belongs to
//   endless                                                without the experiment's duration
//   config NODE BUSES / store HEX / archive HEX                          the firmware's state at
//   power-up write TICK OBJECT RAW | can TICK ID LENGTH HEX | can TICK ID R | lost TICK COUNT bus
//   TICK STATE | modbus TICK HEX | overrun TICK sensorless TICK COUNT ticks of the firmware alone,
//   in between end TICKS HASH                                         how long it ran, and its
//   trace hash
// Initial writes carry tick 0. Bytes are hexadecimal, none "-". A truncated journal has no `end`; a
// truncated line is ignored.
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

// Its first line; the number is that of the format.
inline constexpr char kJournalTitle[] = "forceaxis-journal 1";

class JournalWriter {
 public:
  // Creates the file or replaces a journal. Throws sim::InputError if it is no journal, cannot be
  // written, or is locked by another process.
  JournalWriter(const std::filesystem::path &file, const Experiment &experiment,
                std::span<const std::string> overrides);
  ~JournalWriter();
  JournalWriter(const JournalWriter &) = delete;
  JournalWriter &operator=(const JournalWriter &) = delete;

  // Whether all that was flushed is in the file: on a full disk the run goes on, the journal ends.
  bool good() const { return out_.good(); }
  // Writes and flushes the firmware's state at power-up, its stored parameters included.
  void power_up(const fw_config_t &config);
  void write(std::int64_t tick, std::uint16_t object, std::int32_t raw);
  void can(std::int64_t tick, const can_frame_t &frame);
  void lost(std::int64_t tick, std::uint16_t frames);
  void bus(std::int64_t tick, std::uint8_t state);
  void modbus(std::int64_t tick, std::span<const std::uint8_t> bytes);
  void overrun(std::int64_t tick);
  // One tick of the firmware without sensors, before `tick`. Ticks that follow each other with
  // nothing received between them are one entry, so that a long silence stays short.
  void sensorless(std::int64_t tick);
  void end(std::int64_t ticks, const std::string &hash);
  // To be called at intervals: a killed process loses what was not flushed.
  void flush();

 private:
  std::ostream &entry();
  void write_memory(const char *kind, const store_memory_t &memory);

  int lock_;
  std::ofstream out_;
  std::int64_t sensorless_tick_ = 0;
  std::int64_t sensorless_ = 0;  // of the entry that is not yet written
};

// Throws what a JournalWriter of the file would, and changes nothing.
void expect_journal(const std::filesystem::path &file);

// Throws sim::InputError unless a file can be written here, that one or a new one in its folder.
void expect_writable(const std::filesystem::path &file, const char *option);

struct Journal {
  // What an entry passes to the firmware, besides writes and frames.
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
  std::vector<std::uint8_t> store;  // empty: there was none
  bool has_store = false;
  std::vector<std::uint8_t> archive;  // of incidents
  bool has_archive = false;
  std::vector<Entry> entries;
  std::int64_t ticks = -1;  // -1: the journal has no end
  std::string trace_hash;

  // How many ticks it covers: without an end up to the last entry.
  std::int64_t known_ticks() const;

  // Its experiment, as long as the run was. Throws sim::InputError; does not compare the hash.
  Experiment load() const;
};

// Throws sim::InputError naming file and line.
Journal read_journal(const std::filesystem::path &file);

}  // namespace forceaxis::host
