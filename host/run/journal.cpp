#include "host/run/journal.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <optional>
#include <stdexcept>

#include "firmware/port/host/store_file.h"
#include "host/run/objects.hpp"

namespace forceaxis::host {
namespace {

constexpr char kDigits[] = "0123456789abcdef";

std::string hex_of(std::span<const std::uint8_t> bytes) {
  if (bytes.empty()) return "-";
  std::string text;
  for (const std::uint8_t byte : bytes) {
    text += kDigits[byte >> 4];
    text += kDigits[byte & 15];
  }
  return text;
}

// One line of a journal, which is parsed from left to right. An invalid field throws InputError.
class Line {
 public:
  Line(const std::filesystem::path &file, std::size_t number, std::string_view text)
      : file_(file), number_(number), rest_(text) {}

  [[noreturn]] void fail(const std::string &expected) const {
    throw sim::InputError(file_.string(), "line " + std::to_string(number_),
                          "expected " + expected);
  }
  std::string word(const std::string &what) {
    if (rest_.empty()) fail(what);
    const std::size_t space = std::min(rest_.find(' '), rest_.size());
    const std::string found(rest_.substr(0, space));
    rest_.remove_prefix(std::min(space + 1, rest_.size()));
    return found;
  }
  std::string rest() const { return std::string(rest_); }

  template <class T>
  T number(const std::string &what, std::int64_t low, std::int64_t high, int base = 10) {
    const std::string text = word(what);
    std::int64_t value = 0;
    const auto parsed = std::from_chars(text.data(), text.data() + text.size(), value, base);
    if (parsed.ec != std::errc() || parsed.ptr != text.data() + text.size() || value < low ||
        value > high) {
      fail(what);
    }
    return static_cast<T>(value);
  }
  std::int64_t tick() { return number<std::int64_t>("a tick", 0, kEndlessTicks); }

  std::vector<std::uint8_t> bytes(const std::string &what, std::size_t most) {
    const std::string text = word(what);
    std::vector<std::uint8_t> bytes;
    if (text == "-") return bytes;
    if (text.size() % 2 != 0 || text.size() / 2 > most) fail(what);
    for (std::size_t i = 0; i < text.size(); i += 2) {
      unsigned value = 0;
      const auto parsed = std::from_chars(&text[i], &text[i] + 2, value, 16);
      if (parsed.ec != std::errc() || parsed.ptr != &text[i] + 2) fail(what);
      bytes.push_back(static_cast<std::uint8_t>(value));
    }
    return bytes;
  }

 private:
  const std::filesystem::path &file_;
  std::size_t number_;
  std::string_view rest_;
};

// Returns an entry with an input of the firmware. Returns nothing if `kind` is not a kind of input.
std::optional<Journal::Entry> entry_of(const std::string &kind, Line &line) {
  if (kind == "write") {
    const std::int64_t tick = line.tick();
    const auto object = find_object(line.word("an object"));
    if (!object) line.fail("the name of a firmware object");
    const auto raw = line.number<std::int32_t>("a raw value", INT32_MIN, INT32_MAX);
    return Journal::Entry{tick, ObjectWrite{*object, raw}};
  }
  if (kind == "can") {
    const std::int64_t tick = line.tick();
    can_frame_t frame{};
    frame.id = line.number<std::uint16_t>("an identifier", 0, 0x7FF, 16);
    const std::string length = line.word("a length or R");
    frame.remote = length == "R";
    if (frame.remote == 0) {
      const auto data = line.bytes("up to 8 bytes", 8);
      if (length != std::to_string(data.size())) line.fail("as many bytes as the length states");
      frame.length = static_cast<std::uint8_t>(data.size());
      std::copy(data.begin(), data.end(), frame.data);
    }
    return Journal::Entry{tick, frame};
  }
  if (kind == "lost") {
    const std::int64_t tick = line.tick();
    const auto count = line.number<std::uint16_t>("a count", 1, 65535);
    return Journal::Entry{tick, Journal::FramesLost{count}};
  }
  if (kind == "bus") {
    const std::int64_t tick = line.tick();
    const auto state = line.number<std::uint8_t>("a state", CAN_BUS_ACTIVE, CAN_BUS_OFF);
    return Journal::Entry{tick, Journal::BusState{state}};
  }
  if (kind == "modbus") {
    const std::int64_t tick = line.tick();
    return Journal::Entry{tick, Journal::ModbusBytes{line.bytes("bytes", 65535)}};
  }
  if (kind == "overrun") return Journal::Entry{line.tick(), Journal::Overrun{}};
  if (kind == "sensorless") {
    const std::int64_t tick = line.tick();
    const auto count = line.number<std::int64_t>("a count", 1, kEndlessTicks);
    return Journal::Entry{tick, Journal::Sensorless{count}};
  }
  return std::nullopt;
}

sim::InputError not_writable(const std::filesystem::path &file, const char *option, int error) {
  return {file.string(), option,
          std::string("expected a file that can be written, ") + std::strerror(error)};
}

// Locks the open file. If this fails, closes the file and throws sim::InputError.
int lock_journal(int opened, const std::filesystem::path &file, const char *option) {
  const auto fail = [opened, &file, option](const char *what) {
    close(opened);
    throw sim::InputError(file.string(), option, what);
  };
  if (flock(opened, LOCK_EX | LOCK_NB) != 0) {
    fail("expected a file that no other process uses, but another process writes a journal here");
  }
  struct stat is {};
  std::string title(sizeof kJournalTitle - 1, '\0');
  if (fstat(opened, &is) == 0 && S_ISREG(is.st_mode) && is.st_size > 0 &&
      (pread(opened, title.data(), title.size(), 0) != static_cast<ssize_t>(title.size()) ||
       title != kJournalTitle)) {
    fail("expected a new file or a journal, got another file; choose another name");
  }
  return opened;
}

}  // namespace

void expect_writable(const std::filesystem::path &file, const char *option) {
  int wrong = 0;
  std::error_code unknown;
  if (std::filesystem::is_directory(file, unknown)) {
    wrong = EISDIR;
  } else if (access(file.c_str(), F_OK) == 0) {
    if (access(file.c_str(), R_OK | W_OK) != 0) wrong = errno;
  } else {
    const std::filesystem::path folder = std::filesystem::absolute(file).parent_path();
    if (access(folder.c_str(), W_OK | X_OK) != 0) wrong = errno;
  }
  if (wrong != 0) throw not_writable(file, option, wrong);
}

void expect_journal(const std::filesystem::path &file, const char *option) {
  expect_writable(file, option);
  const int old = open(file.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  if (old >= 0) close(lock_journal(old, file, option));
}

JournalWriter::JournalWriter(const std::filesystem::path &file, const char *option,
                             const Experiment &experiment, std::span<const std::string> overrides) {
  const int opened = open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  if (opened < 0) throw not_writable(file, option, errno);
  lock_ = lock_journal(opened, file, option);
  out_.open(file, std::ios::trunc);
  if (!out_) {
    close(lock_);
    throw not_writable(file, option, errno);
  }
  out_ << kJournalTitle << "\nexperiment " << std::filesystem::absolute(experiment.file).string()
       << '\n';
  for (const std::string &text : overrides) out_ << "set " << text << '\n';
  out_ << "inputs_hash " << experiment.hash << '\n';
  if (experiment.ticks == kEndlessTicks) out_ << "endless\n";
}

JournalWriter::~JournalWriter() { close(lock_); }

void JournalWriter::flush() { entry().flush(); }

// Writes a pending entry `sensorless`, then returns the output stream for the next entry.
std::ostream &JournalWriter::entry() {
  if (sensorless_ > 0) out_ << "sensorless " << sensorless_tick_ << ' ' << sensorless_ << '\n';
  sensorless_ = 0;
  return out_;
}

void JournalWriter::sensorless(std::int64_t tick) {
  sensorless_tick_ = tick;
  ++sensorless_;
}

void JournalWriter::power_up(const fw_config_t &config) {
  out_ << "config " << int{config.node_id} << ' ' << int{config.buses} << ' ' << config.modbus_baud
       << ' ' << config.serial_number << '\n';
  if (config.memory != nullptr) write_memory("store", *config.memory);
  if (config.archive != nullptr) write_memory("archive", *config.archive);
  flush();  // A replay needs the state at the start, even if the process is killed in the first
            // tick.
}

void JournalWriter::write_memory(const char *kind, const store_memory_t &memory) {
  std::vector<std::uint8_t> image(2 * std::size_t{memory.sector_bytes});
  memory.read(memory.context, 0, image.data(), static_cast<std::uint32_t>(image.size()));
  std::span<const std::uint8_t> store = image;
  // Erased bytes at the end of the store are omitted.
  while (!store.empty() && store.back() == 0xFF) store = store.first(store.size() - 1);
  out_ << kind << ' ' << hex_of(store) << '\n';
}

void JournalWriter::write(std::int64_t tick, std::uint16_t object, std::int32_t raw) {
  entry() << "write " << tick << ' ' << object_meta(object).name << ' ' << raw << '\n';
}

void JournalWriter::can(std::int64_t tick, const can_frame_t &frame) {
  entry() << "can " << tick << ' ' << std::hex << frame.id << std::dec << ' ';
  if (frame.remote != 0) {
    out_ << "R\n";
  } else {
    out_ << int{frame.length} << ' ' << hex_of({frame.data, frame.length}) << '\n';
  }
}

void JournalWriter::lost(std::int64_t tick, std::uint16_t frames) {
  entry() << "lost " << tick << ' ' << frames << '\n';
}

void JournalWriter::bus(std::int64_t tick, std::uint8_t state) {
  entry() << "bus " << tick << ' ' << int{state} << '\n';
}

void JournalWriter::modbus(std::int64_t tick, std::span<const std::uint8_t> bytes) {
  entry() << "modbus " << tick << ' ' << hex_of(bytes) << '\n';
}

void JournalWriter::overrun(std::int64_t tick) { entry() << "overrun " << tick << '\n'; }

void JournalWriter::end(std::int64_t ticks, const std::string &hash) {
  entry() << "end " << ticks << ' ' << hash << std::endl;
}

std::int64_t Journal::known_ticks() const {
  if (ticks >= 0) return ticks;
  return entries.empty() ? 1 : entries.back().tick + 1;
}

Experiment Journal::load() const {
  Experiment loaded = load_experiment(experiment, overrides);
  if (endless) {
    make_endless(loaded);
    loaded.ticks = known_ticks() - 1;
  }
  return loaded;
}

Journal read_journal(const std::filesystem::path &file) {
  std::ifstream in(file);
  if (!in) throw sim::InputError(file.string(), "file", "expected a readable file, got none");
  Journal journal;
  journal.file = file;
  std::string text;
  if (!std::getline(in, text) || text != kJournalTitle) {
    throw sim::InputError(file.string(), "line 1",
                          std::string("expected a readable journal, \"") + kJournalTitle + "\"");
  }
  for (std::size_t number = 2; std::getline(in, text); ++number) {
    if (in.eof()) break;  // a truncated last line of the journal is ignored
    Line line(file, number, text);
    const std::string kind = line.word("an entry");
    if (auto entry = entry_of(kind, line)) {
      journal.entries.push_back(std::move(*entry));
    } else if (kind == "experiment") {
      journal.experiment = line.rest();
    } else if (kind == "set") {
      journal.overrides.push_back(line.rest());
    } else if (kind == "inputs_hash") {
      journal.inputs_hash = line.rest();
    } else if (kind == "endless") {
      journal.endless = true;
    } else if (kind == "config") {
      journal.node_id = line.number<std::uint8_t>("a node", 0, FW_NODE_ID_BY_LSS);
      journal.buses = line.number<std::uint8_t>("buses", 0, 1);
      journal.modbus_baud = line.number<std::uint32_t>("a speed in baud", 0, 10'000'000);
      // Journals of version 0.1.0 have no archive.
      if (!line.rest().empty()) {
        journal.serial_number = line.number<std::uint32_t>("a serial number", 0, UINT32_MAX);
      }
    } else if (kind == "store") {
      journal.store = line.bytes("bytes", 2 * STORE_FILE_SECTOR_BYTES);
      journal.has_store = true;
    } else if (kind == "archive") {
      journal.archive = line.bytes("bytes", 2 * ARCHIVE_FILE_SECTOR_BYTES);
      journal.has_archive = true;
    } else if (kind == "end") {
      journal.ticks = line.tick();
      journal.trace_hash = line.rest();
    } else {
      line.fail(
          "experiment, set, inputs_hash, endless, config, store, archive, write, can, lost, bus, "
          "modbus, "
          "overrun, sensorless or end");
    }
  }
  if (journal.experiment.empty()) {
    throw sim::InputError(file.string(), "experiment", "expected a line `experiment FILE`");
  }
  return journal;
}

}  // namespace forceaxis::host
