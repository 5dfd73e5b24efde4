// axis_node: the firmware of one or several axes as a process of its own, in lock-step with a
// plant.
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <csignal>
#include <deque>
#include <iostream>
#include <memory>
#include <span>
#include <sstream>
#include <thread>
#include <utility>

#include "firmware/objects/generated/axis_objects.h"
#include "firmware/port/host/store_file.h"
#include "host/axis_node/buses.hpp"
#include "host/link/late_ticks.hpp"
#include "host/program/node_options.hpp"
#include "host/program/number_range.hpp"
#include "host/run/firmware_side.hpp"
#include "host/run/journal.hpp"
#include "host/run/objects.hpp"

namespace {

using namespace forceaxis;
using std::chrono::milliseconds;
using namespace std::chrono_literals;

constexpr milliseconds kServe{100};
// If the last answer is lost the plant repeats its inputs, at least every 100 ms.
constexpr milliseconds kLinger{250};
constexpr int kTicksPerFlush = 1500;  // of the journal: about a second
// Frames queued for the interface; further ones are lost, as on a bus that is down.
constexpr std::size_t kMostUnsent = 256;

// The options that only axis_node has.
struct AxisOptions {
  std::string can;     // empty: no CANopen
  std::string modbus;  // empty: no Modbus
  int modbus_baud = 115200;
  std::string store;
  std::string journal;
  std::optional<int> node_id;           // of the first axis; default: its number
  std::optional<std::uint32_t> serial;  // of the first axis
  double hold_s = 0;
  bool serve = false;
  bool real_time = false;  // late ticks are counted

  bool buses() const { return !can.empty() || !modbus.empty(); }
};

// The serial number of a node without --serial: the host's name, and in the last byte the axis, so
// that it is the same in every run and no two nodes of a run have one.
std::uint32_t serial_of(int axis) {
  std::array<char, 256> name{};
  gethostname(name.data(), name.size() - 1);
  std::uint32_t hash = 2166136261U;  // FNV-1a
  for (const char *at = name.data(); *at != 0; ++at) {
    hash = (hash ^ static_cast<std::uint8_t>(*at)) * 16777619U;
  }
  return (hash & ~UINT32_C(0xFF)) | static_cast<std::uint32_t>(axis);
}

// Checks that the nodes of all axes have ids.
void expect_node_ids(const nodes::NodeOptions &options, const AxisOptions &own) {
  const int axes = static_cast<int>(options.files.size());
  if (!own.node_id || *own.node_id == FW_NODE_ID_BY_LSS) return;
  if (*own.node_id == 0 && axes > 1) {
    throw nodes::UsageError("--node-id 0: expected one axis, several would have one stored id");
  }
  if (*own.node_id + axes - 1 > 127) {
    throw nodes::UsageError("--node-id " + std::to_string(*own.node_id) +
                            ": expected ids up to 127, the last would be " +
                            std::to_string(*own.node_id + axes - 1));
  }
}

struct StoreCloser {
  void operator()(store_file_t *store) const {
    store_file_close(store);
    delete store;
  }
};

std::unique_ptr<store_file_t, StoreCloser> open_store(const std::string &file) {
  auto opened = std::make_unique<store_file_t>();
  if (const char *wrong = store_file_open(opened.get(), file.c_str())) {
    throw sim::InputError(file, "--store", wrong);
  }
  return std::unique_ptr<store_file_t, StoreCloser>(opened.release());
}

// Checks the files of --store and --journal before any is opened: a run that cannot begin neither
// creates nor changes a file.
void expect_files(const AxisOptions &options, const std::string &suffix) {
  if (!options.journal.empty()) host::expect_journal(options.journal + suffix);
  if (options.store.empty()) return;
  const std::string file = options.store + suffix;
  host::expect_writable(file, "--store");
  if (access(file.c_str(), F_OK) == 0) open_store(file);
}

// One axis of this node: its firmware, its bus, its store and its journal.
class Axis {
 public:
  Axis(int number, int first_axis, const host::Experiment &experiment,
       std::span<const std::string> overrides, const AxisOptions &options,
       const std::string &suffix)
      : number_(number), experiment_(experiment) {
    // Files last: if the bus cannot be opened they stay as they are.
    if (!options.can.empty()) can_ = std::make_unique<nodes::CanPort>(options.can);
    if (!options.store.empty()) {
      store_ = open_store(options.store + suffix);
      config_.memory = &store_->memory;
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
      journal_ = std::make_unique<host::JournalWriter>(journal_file_, experiment, overrides);
      journal_->power_up(config_);
    }
    host::FirmwareOptions firmware{.hash = true, .config = &config_};
    if (journal_) {
      firmware.writing = [this](std::int64_t tick, const host::ObjectWrite &w) {
        journal_->write(tick, w.object, w.raw);
      };
    }
    firmware_ = std::make_unique<host::FirmwareSide>(experiment, firmware);
    // Each entry carries the tick before which it is applied.
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

  host::LinkOutputs tick(const host::LinkInputs &in, nodes::ModbusPort *modbus) {
    if (real_time_ && late_.late(std::chrono::steady_clock::now().time_since_epoch() / 1ns)) {
      if (journal_) journal_->overrun(coming());
      fw_overrun(axis(), 0);
    }
    if (can_) can_->receive(handlers_);
    const host::LinkOutputs out = firmware_->tick(in);
    transmit(modbus);
    if (journal_ && ++unflushed_ == kTicksPerFlush) {
      unflushed_ = 0;
      journal_->flush();
      report_broken_journal();
    }
    return out;
  }

  // The tick after the plant fell silent, and those that hold the axis there.
  host::LinkOutputs lose_sensors(nodes::ModbusPort *modbus) {
    if (can_) can_->receive(handlers_);
    const auto out = firmware_->lose_sensors(static_cast<std::uint8_t>(number_));
    transmit(modbus);
    return out;
  }

  void receive_modbus(std::span<const std::uint8_t> bytes) {
    if (journal_) journal_->modbus(coming(), bytes);
    fw_modbus_receive(axis(), bytes.data(), static_cast<std::uint16_t>(bytes.size()));
  }

  // After the last tick: closes hash and journal.
  std::string json() {
    std::string refused;
    for (const host::Refusal &r : firmware_->refused()) {
      nodes::append(refused, nodes::JsonObject()
                                 .add("tick", r.tick)
                                 .add("object", r.object)
                                 .add("reason", r.reason)
                                 .text());
    }
    const std::string hash = firmware_->hash();
    if (journal_) journal_->end(coming(), hash);
    report_broken_journal();
    nodes::JsonObject o;
    o.add("axis", number_)
        .add("experiment", experiment_.file.string())
        .add("inputs_hash", experiment_.hash)
        .add("ticks", coming())
        .add("trace_hash", hash)
        .add("fault", host::enum_text(AXIS_OBJ_FAULT, firmware_->read(AXIS_OBJ_FAULT)))
        .add("overruns", firmware_->read(AXIS_OBJ_OVERRUNS))
        .raw("refused", "[" + refused + "]");
    if (!lost.empty()) o.raw("after_silence", lost);
    return o.text();
  }

  bool journal_broken() const { return journal_ && !journal_->good(); }
  int number() const { return number_; }
  std::int64_t coming() const { return firmware_->next_tick(); }

  std::string lost;  // its response to the silence of the plant

 private:
  fw_t *axis() { return firmware_->axis(); }

  // Once, as a warning: stopping the axis could be dangerous.
  void report_broken_journal() {
    if (!journal_broken() || std::exchange(reported_broken_, true)) return;
    std::cerr << "axis_node: " << journal_file_
              << ": expected to be able to write the journal, it is not whole\n";
  }

  void transmit(nodes::ModbusPort *modbus) {
    // The firmware's output is fetched every tick, with or without a bus, as a replay does. Frames
    // wait for room at the interface, but not for an interface that is down: they would be stale.
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

  int number_;
  const host::Experiment &experiment_;
  fw_config_t config_{};
  bool real_time_ = false;
  host::LateTicks late_;
  int unflushed_ = 0;
  std::string journal_file_;
  bool reported_broken_ = false;
  std::unique_ptr<store_file_t, StoreCloser> store_;
  std::unique_ptr<host::JournalWriter> journal_;
  std::unique_ptr<nodes::CanPort> can_;
  nodes::CanPort::Handlers handlers_;
  std::unique_ptr<host::FirmwareSide> firmware_;
  std::deque<can_frame_t> unsent_;
};

// The signal that ends the run after journal and report are written. A second one ends at once.
std::atomic<int> stopped{0};

void end_by_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  // A thread of its own receives the signals, so that they interrupt no system call.
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  std::thread([signals] {
    for (int signal = 0; sigwait(&signals, &signal) == 0;) {
      if (stopped.exchange(signal) != 0) _exit(128 + signal);
    }
  }).detach();
}

// Whether standard input has data or was closed.
bool asked_on_input() {
  pollfd input{STDIN_FILENO, POLLIN, 0};
  return poll(&input, 1, 0) == 1;
}

// Serves the buses after the silence, at the pace of the wall clock, so that clients can read the
// fault.
void hold(std::vector<std::unique_ptr<Axis>> &axes, nodes::ModbusPort *modbus, double seconds) {
  using Clock = std::chrono::steady_clock;
  const auto start = Clock::now();
  const auto ticks = static_cast<std::int64_t>(seconds * sim::kTickRateHz);
  for (std::int64_t k = 1; k <= ticks && stopped == 0; ++k) {
    std::this_thread::sleep_until(start + std::chrono::nanoseconds(k * 2000000 / 3));
    if (modbus != nullptr) {
      const auto bytes = modbus->receive();
      for (const auto &axis : axes) {
        if (!bytes.empty()) axis->receive_modbus(bytes);
      }
    }
    for (const auto &axis : axes) axis->lose_sensors(modbus);
  }
}

// One run from ready to report.
int run(const nodes::NodeOptions &options, const AxisOptions &own) {
  expect_node_ids(options, own);
  const std::vector<host::Experiment> experiments = nodes::load_experiments(options);
  std::vector<std::unique_ptr<Axis>> axes;
  std::vector<std::uint8_t> numbers;
  std::vector<std::int64_t> last_ticks;
  std::vector<std::unique_ptr<host::LinkClaim>> claims;
  for (std::size_t i = 0; i < experiments.size(); ++i) {
    claims.push_back(host::claim_axis(options.link, options.first_axis + static_cast<int>(i)));
  }
  const auto suffix = [&experiments](int number) {
    return experiments.size() > 1 ? "." + std::to_string(number) : std::string();
  };
  for (std::size_t i = 0; i < experiments.size(); ++i) {
    expect_files(own, suffix(options.first_axis + static_cast<int>(i)));
  }
  std::unique_ptr<nodes::ModbusPort> modbus;
  if (!own.modbus.empty()) {
    modbus = std::make_unique<nodes::ModbusPort>(own.modbus, own.modbus_baud);
  }
  host::InjectionCounts injected;
  const auto transport = host::open_axis_transport(options.link, injected);
  for (std::size_t i = 0; i < experiments.size(); ++i) {
    const int number = options.first_axis + static_cast<int>(i);
    axes.push_back(std::make_unique<Axis>(number, options.first_axis, experiments[i],
                                          nodes::overrides_of(options, number), own,
                                          suffix(number)));
    numbers.push_back(static_cast<std::uint8_t>(number));
    last_ticks.push_back(experiments[i].ticks);
  }
  const auto compute = [&](const host::LinkInputs &in) {
    if (modbus) {
      const auto bytes = modbus->receive();
      for (const auto &axis : axes) {
        if (!bytes.empty()) axis->receive_modbus(bytes);
      }
    }
    return axes[static_cast<std::size_t>(in.axis - options.first_axis)]->tick(in, modbus.get());
  };
  host::AxisExchange exchange(*transport, options.link.timeouts, numbers, last_ticks, compute);
  std::cout << "axis_node ready pid " << getpid() << ", " << host::link_text(options.link)
            << ", axes " << nodes::axes_range(options) << std::endl;

  unsigned silent = 0;
  std::uint64_t lost_records = 0;
  while (!exchange.finished() && stopped == 0) {
    const unsigned now_silent = exchange.serve(kServe);
    silent |= now_silent;
    for (const auto &axis : axes) {
      if ((now_silent >> (axis->number() - 1) & 1U) == 0) continue;
      const host::LinkOutputs out = axis->lose_sensors(modbus.get());
      transport->send({&out, 1});
      ++lost_records;
      axis->lost = nodes::JsonObject()
                       .add("tick", out.tick)
                       .add("dac_code", out.dac_code)
                       .add("amp_enable", (out.out & 1) != 0)
                       .add("brake_release", (out.out & 2) != 0)
                       .add("fault", host::enum_text(AXIS_OBJ_FAULT, out.fault))
                       .text();
    }
  }
  if (silent != 0) hold(axes, modbus.get(), own.hold_s);
  while (silent == 0 && stopped == 0 && exchange.quiet() < kLinger &&
         !(own.serve && asked_on_input())) {
    exchange.serve(own.serve ? milliseconds{2} : milliseconds{50});
  }

  std::string list;
  for (const auto &axis : axes) nodes::append(list, axis->json());
  host::LinkStatistics statistics = exchange.statistics();
  statistics.sent += lost_records;
  std::string failure;
  if (silent != 0) {
    const auto &timeouts = options.link.timeouts;
    const bool ever = axes[0]->coming() > 0;
    failure = "plant_node silent for " +
              std::to_string((ever ? timeouts.running : timeouts.start).count()) + " ms (" +
              host::axes_text(silent) + "): " +
              (ever ? "it ended or hangs; the axis is disabled, code 0"
                    : "it never asked; is it running, on this link and with this run id?");
  }
  if (stopped != 0 && !exchange.finished()) {
    failure = std::string("ended by ") + (stopped == SIGINT ? "SIGINT" : "SIGTERM") +
              " before the run was over";
  }
  nodes::JsonObject o;
  o.add("node", "axis")
      .add("pid", getpid())
      .add("link", options.link.kind)
      .add("run_id", options.link.run_id)
      .raw("axes", "[" + list + "]")
      .raw("statistics", nodes::statistics_json(statistics, injected));
  if (!failure.empty()) o.add("error", failure);
  std::cout << o.text() << std::endl;
  const bool broken =
      std::ranges::any_of(axes, [](const auto &axis) { return axis->journal_broken(); });
  if (failure.empty()) return broken ? 1 : 0;
  if (!own.serve) std::cerr << "axis_node: " << failure << '\n';
  return stopped != 0 ? 128 + stopped : 1;
}

// Runs requested on standard input, one a line: run number, experiment and overrides, separated by
// tabs. A failed one is reported as {"error": ..., "status": 1 or 2}, and the next line is read.
int serve(const nodes::NodeOptions &base, const AxisOptions &own) {
  for (std::string line; std::getline(std::cin, line);) {
    if (line.empty()) continue;
    nodes::NodeOptions job = base;
    std::istringstream fields(line);
    std::string field;
    std::getline(fields, field, '\t');
    const auto fail = [](const std::string &what, int status) {
      std::cout << nodes::JsonObject().add("error", what).add("status", status).text() << std::endl;
    };
    try {
      job.link.run_id = std::stoll(field);
      std::getline(fields, field, '\t');
      job.files = {field};
      while (std::getline(fields, field, '\t')) job.sets.push_back(field);
      nodes::finish_options(job);
      run(job, own);
    } catch (const sim::InputError &error) {
      fail(error.what(), 2);
    } catch (const nodes::UsageError &error) {
      fail(error.what(), 2);
    } catch (const std::exception &error) {
      fail(error.what(), 1);
    }
  }
  return 0;
}

}  // namespace

int main(int argc, char **argv) {
  nodes::NodeOptions options;
  AxisOptions own;
  CLI::App app(
      "The firmware of one or several axes, tick by tick in lock-step with plant_node.\n"
      "Prints one line when ready and one JSON object at the end. If the plant falls silent, the\n"
      "axes run one tick without sensors and are disabled. Exit status 0 done, 1 the run failed\n"
      "(plant_node silent) or the journal is not whole, 2 wrong usage or input, 130 and 143 ended\n"
      "by SIGINT and SIGTERM, journal and report written.");
  nodes::add_options(app, options);
  app.add_option("--can", own.can, "CAN interface on which the axes are CANopen nodes (vcan0).");
  app.add_option("--modbus", own.modbus, "Serial device on which they are Modbus RTU units.");
  app.add_option("--modbus-baud", own.modbus_baud, "Its speed; 8 data bits, even parity.")
      ->check(CLI::IsMember({9600, 19200, 38400, 57600, 115200, 230400}))
      ->capture_default_str();
  app.add_option(
         "--node-id", own.node_id,
         "CANopen node and Modbus unit of the first axis, the others follow; 0: the stored "
         "one, else 1; 255: the stored ones, else silent until LSS gives them. Default: the "
         "number of the axis.")
      ->check(CLI::Range(0, 127) | CLI::IsMember({FW_NODE_ID_BY_LSS}));
  app.add_option("--serial", own.serial,
                 "Serial number of the first axis (1018h:4), the others follow. Default: made of "
                 "this host's name and the number of the axis.");
  app.add_option("--store", own.store,
                 "File that keeps the stored parameters; of several axes FILE.1, FILE.2, ...");
  app.add_option("--journal", own.journal,
                 "File for everything the firmware receives, for `forceaxis replay`; of several "
                 "axes FILE.1, FILE.2, ...");
  app.add_option("--hold", own.hold_s,
                 "Seconds to go on serving the buses after the plant fell silent, disabled.")
      ->check(nodes::real_range(0, 86400))
      ->capture_default_str();
  app.add_flag("--serve", own.serve,
               "Read runs from standard input, one a line: run number, experiment and overrides, "
               "separated by tabs.");
  app.footer(
      "Example:\n"
      "  axis_node sim/experiments/contact.toml --link lcm --run-id 7 &\n"
      "  plant_node sim/experiments/contact.toml --link lcm --run-id 7\n"
      "with its buses, in real time, for clients of every kind:\n"
      "  axis_node sim/experiments/contact.toml --pace real --can vcan0 --store axis.bin \\\n"
      "    --journal axis.journal &\n"
      "  plant_node sim/experiments/contact.toml --pace real");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError &error) {
    return nodes::refuse("axis_node", app, error);
  }
  return nodes::guarded("axis_node", [&] {
    if (own.serve) return serve(options, own);
    if (options.files.empty()) {
      throw nodes::UsageError("EXPERIMENT: expected the experiment that the plant runs");
    }
    nodes::finish_options(options);
    own.real_time = options.pace == "real";
    end_by_signals();
    return run(options, own);
  });
}
