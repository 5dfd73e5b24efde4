// The program axis_node: the firmware of one or several axes, in lock-step with the plants in
// another process.
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
#include "host/axis_node/axis.hpp"
#include "host/program/node_options.hpp"
#include "host/program/number_range.hpp"
#include "host/run/objects.hpp"

namespace {

using namespace forceaxis;
using nodes::Axis;
using nodes::AxisOptions;
using nodes::expect_files;
using nodes::stopped;
using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

constexpr milliseconds kServe{100};
// Time after the last tick for which the axis answers repeated inputs. If the last answer is lost,
// the plant repeats the inputs at least every 100 ms.
constexpr milliseconds kLinger{250};

// Checks that the node ids of all axes are in the range of CANopen.
void expect_node_ids(const nodes::NodeOptions &options, const AxisOptions &own) {
  const int axes = static_cast<int>(options.files.size());
  if (!own.node_id || *own.node_id == FW_NODE_ID_BY_LSS) return;
  if (*own.node_id == 0 && axes > 1) {
    throw nodes::UsageError(
        "--node-id 0: expected one axis, because several axes would read the same stored node id");
  }
  if (*own.node_id + axes - 1 > 127) {
    throw nodes::UsageError("--node-id " + std::to_string(*own.node_id) +
                            ": expected ids up to 127, but the last node id would be " +
                            std::to_string(*own.node_id + axes - 1));
  }
}

// Returns true if standard input has data or was closed.
bool asked_on_input() {
  pollfd input{STDIN_FILENO, POLLIN, 0};
  return poll(&input, 1, 0) == 1;
}

void receive_modbus(std::vector<std::unique_ptr<Axis>> &axes, nodes::ModbusPort &modbus) {
  const auto bytes = modbus.receive();
  for (const auto &axis : axes) {
    if (!bytes.empty()) axis->receive_modbus(bytes);
  }
}

// Computes ticks without sensor values after the plant has stopped sending, 1500 ticks per second
// of the wall clock, so that clients on the buses can read the fault.
void hold(std::vector<std::unique_ptr<Axis>> &axes, nodes::ModbusPort *modbus, double seconds) {
  const auto start = Clock::now();
  const auto ticks = static_cast<std::int64_t>(seconds * sim::kTickRateHz);
  for (std::int64_t k = 1; k <= ticks && stopped == 0; ++k) {
    std::this_thread::sleep_until(start + std::chrono::nanoseconds(k * 2000000 / 3));
    if (modbus != nullptr) receive_modbus(axes, *modbus);
    for (const auto &axis : axes) axis->lose_sensors(modbus);
  }
}

// The firmware's side of a session. The session continues after a suspension of this process, and
// after the plant has sent nothing for some time.
class Session {
 public:
  Session(const nodes::NodeOptions &options, std::vector<std::unique_ptr<Axis>> &axes,
          nodes::ModbusPort *modbus)
      : options_(options), axes_(axes), modbus_(modbus), stall_(options.link.timeouts.running) {}

  // If this process was suspended, every axis computes a tick without sensor values. To be called
  // before each tick.
  void before_tick(int axis) {
    check_self();
    if (!begun_) {
      for (const auto &a : axes_) {
        if (host::plant_held(options_.link, a->number())) visible_ |= bit(a->number());
      }
      begun_ = true;
    }
    if ((absent_ & bit(axis)) == 0) return;
    absent_ &= ~bit(axis);
    report("plant_node (axis " + std::to_string(axis) + ") was silent for " +
           interruptions.add(since(silent_since_)) + "; continues at tick " + tick_of(axis) +
           ", the axis disabled");
  }

  // Serves the plants until a signal is received or plant_node has ended, then disables the axes.
  // Returns the axes whose plant has never sent anything, as a word with bit 0 for axis 1.
  unsigned serve(host::AxisExchange &exchange) {
    while (stopped == 0 && ended.empty()) {
      const unsigned silent = exchange.serve(absent_ != 0 ? milliseconds{1} : kServe);
      if (silent != 0 && !begun_) return silent;
      if (!check_self() && silent != 0) lose(silent);
      exchange.resume(silent);
      if (absent_ != 0) hold();
    }
    lose_sensors(~0U);
    return 0;
  }

  host::Interruptions interruptions;
  std::string ended;  // reason for the end of the session; empty if a signal ended the session

 private:
  static unsigned bit(int axis) { return 1U << (axis - 1); }
  static milliseconds since(Clock::time_point time) {
    return std::chrono::duration_cast<milliseconds>(Clock::now() - time);
  }
  std::string tick_of(int axis) const {
    return std::to_string(axes_[static_cast<std::size_t>(axis - options_.first_axis)]->coming());
  }
  void report(const std::string &text) const { std::cerr << "axis_node: " << text << std::endl; }

  // Returns true if this process was suspended since the last call.
  bool check_self() {
    const auto stalled = stall_.poll();
    if (!stalled) return false;
    if (begun_) {
      report("suspended for " + interruptions.add(*stalled) + "; continues at tick " +
             tick_of(options_.first_axis) + ", the axis disabled");
      lose_sensors(~absent_);
    }
    return true;
  }

  void lose_sensors(unsigned axes) {
    for (const auto &axis : axes_) {
      if ((axes & bit(axis->number())) != 0) axis->lose_sensors(modbus_);
    }
  }

  // Ends the session if plant_node has ended; otherwise the axes wait. To be called if the plants
  // of these axes no longer send.
  void lose(unsigned axes) {
    for (const auto &axis : axes_) {
      const unsigned of = bit(axis->number());
      if ((axes & visible_ & of) == 0 || host::plant_held(options_.link, axis->number())) continue;
      ended = "plant_node has ended at tick " + tick_of(axis->number()) +
              "; the session ends, the axis is disabled";
      return;
    }
    const unsigned newly = axes & ~absent_;
    if (newly == 0) return;
    report("plant_node silent (" + host::axes_text(newly) + ") at tick " +
           tick_of(options_.first_axis) + ": the axis is disabled and waits for plant_node");
    if (absent_ == 0) {
      due_ = Clock::now();
      silent_since_ = due_ - options_.link.timeouts.running;
    }
    absent_ |= newly;
  }

  // Computes the ticks without sensor values that are due at the present time.
  void hold() {
    constexpr std::chrono::nanoseconds kTick{2000000 / 3};
    const Clock::time_point now = Clock::now();
    if (now - due_ > options_.link.timeouts.running) due_ = now;
    for (; due_ <= now; due_ += kTick) {
      if (modbus_ != nullptr) receive_modbus(axes_, *modbus_);
      lose_sensors(absent_);
    }
  }

  const nodes::NodeOptions &options_;
  std::vector<std::unique_ptr<Axis>> &axes_;
  nodes::ModbusPort *modbus_;
  host::StallWatch stall_;
  bool begun_ = false;
  // Bit axis - 1 is set if the plant_node of this axis runs on this machine, so that its end can be
  // detected.
  unsigned visible_ = 0;
  unsigned absent_ = 0;  // axes whose plant has not answered, as a bit set: bit 0 is axis 1
  Clock::time_point silent_since_{}, due_{};
};

using Axes = std::vector<std::unique_ptr<Axis>>;

// Returns the suffix for the file names of one axis, such as ".2". Returns an empty text if the run
// has only one axis.
std::string suffix_of(std::size_t axes, int number) {
  return axes > 1 ? "." + std::to_string(number) : std::string();
}

Axes make_axes(const nodes::NodeOptions &options, const AxisOptions &own,
               const std::vector<host::Experiment> &experiments) {
  Axes axes;
  for (std::size_t i = 0; i < experiments.size(); ++i) {
    const int number = options.first_axis + static_cast<int>(i);
    axes.push_back(std::make_unique<Axis>(number, options.first_axis, experiments[i],
                                          nodes::overrides_of(options, number), own,
                                          suffix_of(experiments.size(), number)));
  }
  return axes;
}

// Reports each axis that is enabled by its own experiment although it is also commanded over a bus.
// For a client on the bus, such an axis would be enabled by another source.
void report_own_commands(const AxisOptions &own, int first_axis,
                         const std::vector<host::Experiment> &experiments) {
  if (own.can.empty() && own.modbus.empty()) return;
  for (std::size_t i = 0; i < experiments.size(); ++i) {
    for (const host::Action &action : experiments[i].actions) {
      const auto commands = [](const host::ObjectWrite &w) {
        return w.object == AXIS_OBJ_CONTROLWORD || w.object == AXIS_OBJ_MODE;
      };
      const auto first = std::ranges::find_if(action.writes, commands);
      if (first == action.writes.end()) continue;
      std::cerr << "axis_node: " << experiments[i].file.string() << ": [[at]] writes "
                << host::object_meta(first->object).name << " at tick " << action.tick
                << ", so axis " << first_axis + static_cast<int>(i)
                << " enables itself; remove the tables [[at]] to command it over its bus alone\n";
      break;
    }
  }
}

// Disables an axis whose plant no longer sends, and sends the outputs of the axis to the plant.
void lose(Axis &axis, nodes::ModbusPort *modbus, host::AxisTransport &transport) {
  const host::LinkOutputs out = axis.lose_sensors(modbus);
  transport.send({&out, 1});
  axis.lost = nodes::JsonObject()
                  .add("tick", out.tick)
                  .add("dac_code", out.dac_code)
                  .add("amp_enable", (out.out & 1) != 0)
                  .add("brake_release", (out.out & 2) != 0)
                  .add("fault", host::enum_text(AXIS_OBJ_FAULT, out.fault))
                  .text();
}

// Result of serve_run(), which serves the plants of one run.
struct Served {
  unsigned silent = 0;  // axes whose plant has not answered, as a bit set: bit 0 is axis 1
  std::uint64_t lost_records = 0;
};

// Serves the plants of a run that is not a session, until the last tick or until a signal.
Served serve_run(Axes &axes, nodes::ModbusPort *modbus, host::AxisTransport &transport,
                 host::AxisExchange &exchange) {
  Served served;
  while (!exchange.finished() && stopped == 0) {
    const unsigned now_silent = exchange.serve(kServe);
    served.silent |= now_silent;
    for (const auto &axis : axes) {
      if ((now_silent >> (axis->number() - 1) & 1U) == 0) continue;
      lose(*axis, modbus, transport);
      ++served.lost_records;
    }
  }
  return served;
}

// Answers repeated inputs for the time kLinger after the last tick.
void linger(const AxisOptions &own, host::AxisExchange &exchange) {
  while (stopped == 0 && exchange.quiet() < kLinger && !(own.serve && asked_on_input())) {
    exchange.serve(own.serve ? milliseconds{2} : milliseconds{50});
  }
}

// Returns a text with the reason of a failed run and the remedy. Returns an empty text if the run
// did not fail. `ticks` is true if at least one tick was received.
std::string failure_of(const host::LinkTimeouts &timeouts, unsigned silent, bool ticks,
                       bool ended_early) {
  if (ended_early) {
    return std::string("ended by ") + (stopped == SIGINT ? "SIGINT" : "SIGTERM") +
           " before the end of the run";
  }
  if (silent == 0) return {};
  return "plant_node silent for " +
         std::to_string((ticks ? timeouts.running : timeouts.start).count()) + " ms (" +
         host::axes_text(silent) + "): " +
         (ticks ? "plant_node has ended or does not respond; the axis is disabled, DAC code 0"
                : "no tick was ever received; run plant_node on this link and with this run id");
}

// Prints the report of a run. Returns the exit status of the program.
int report(const nodes::NodeOptions &options, const AxisOptions &own, const Axes &axes,
           const Session *session, const host::AxisExchange &exchange, const Served &served,
           const host::InjectionCounts &injected) {
  std::string list;
  for (const auto &axis : axes) nodes::append(list, axis->json());
  host::LinkStatistics statistics = exchange.statistics();
  statistics.sent += served.lost_records;
  const bool ended_early = session == nullptr && stopped != 0 && !exchange.finished();
  const std::string failure =
      failure_of(options.link.timeouts, served.silent, axes[0]->coming() > 0, ended_early);
  nodes::JsonObject o;
  o.add("node", "axis")
      .add("pid", getpid())
      .add("link", options.link.kind)
      .add("run_id", options.link.run_id)
      .raw("axes", "[" + list + "]")
      .raw("statistics", nodes::statistics_json(statistics, injected));
  if (session != nullptr) {
    if (!session->ended.empty()) std::cerr << "axis_node: " << session->ended << '\n';
    o.raw("session", nodes::session_json(session->interruptions, session->ended));
  }
  if (!failure.empty()) o.add("error", failure);
  std::cout << o.text() << std::endl;
  const bool broken =
      std::ranges::any_of(axes, [](const auto &axis) { return axis->journal_broken(); });
  if (failure.empty()) return broken ? 1 : 0;
  if (!own.serve) std::cerr << "axis_node: " << failure << '\n';
  return stopped != 0 && session == nullptr ? 128 + stopped : 1;
}

// Executes one run: prints the line "ready", serves the plants and prints the report.
int run(const nodes::NodeOptions &options, const AxisOptions &own) {
  expect_node_ids(options, own);
  const std::vector<host::Experiment> experiments = nodes::load_experiments(options);
  std::vector<std::uint8_t> numbers;
  std::vector<std::int64_t> last_ticks;
  std::vector<std::unique_ptr<host::LinkClaim>> claims;
  for (const host::Experiment &experiment : experiments) {
    const int number = options.first_axis + static_cast<int>(numbers.size());
    claims.push_back(host::claim_axis(options.link, number));
    numbers.push_back(static_cast<std::uint8_t>(number));
    last_ticks.push_back(experiment.ticks);
  }
  for (const int number : numbers) expect_files(own, suffix_of(experiments.size(), number));
  std::unique_ptr<nodes::ModbusPort> modbus;
  if (!own.modbus.empty()) {
    modbus = std::make_unique<nodes::ModbusPort>(own.modbus, own.modbus_baud);
  }
  host::InjectionCounts injected;
  const auto transport = host::open_axis_transport(options.link, injected);
  Axes axes = make_axes(options, own, experiments);
  report_own_commands(own, options.first_axis, experiments);
  std::optional<Session> session;
  if (options.endless) session.emplace(options, axes, modbus.get());
  const auto compute = [&](const host::LinkInputs &in) {
    if (session) session->before_tick(in.axis);
    if (modbus) receive_modbus(axes, *modbus);
    return axes[static_cast<std::size_t>(in.axis - options.first_axis)]->tick(in, modbus.get());
  };
  host::AxisExchange exchange(*transport, options.link.timeouts, numbers, last_ticks, compute);
  std::cout << "axis_node ready pid " << getpid() << ", " << host::link_text(options.link)
            << ", axes " << nodes::axes_range(options) << std::endl;

  const Served served = session ? Served{session->serve(exchange), 0}
                                : serve_run(axes, modbus.get(), *transport, exchange);
  if (served.silent != 0) {
    hold(axes, modbus.get(), own.hold_s);
  } else if (!session) {
    linger(own, exchange);
  }
  return report(options, own, axes, session ? &*session : nullptr, exchange, served, injected);
}

// Executes the runs that are requested on standard input. Each line contains the run number, the
// experiment and the overrides, separated by tabs. After a failed run, the report is {"error": ...,
// "status": 1 or 2}, and the next line is read.
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
      "The firmware of one or several axes, tick by tick in lock-step with "
      "plant_node.\n"
      "Prints one line when ready and one JSON object at the end. If the plant becomes "
      "silent, the axes compute one tick without sensors and are disabled. Exit "
      "status: 0 complete, 1 the run failed (plant_node silent) or the journal is "
      "incomplete, 2 wrong usage or input, 130 and 143 ended by SIGINT and SIGTERM "
      "with journal and report. A session (--endless) that was ended has status 0.");
  nodes::add_options(app, options);
  app.add_option("--can", own.can, "CAN interface on which the axes are CANopen nodes (vcan0).");
  app.add_option("--modbus", own.modbus, "Serial device on which the axes are Modbus RTU units.");
  app.add_option("--modbus-baud", own.modbus_baud,
                 "Bit rate of the serial device; 8 data bits, even parity.")
      ->check(CLI::IsMember({9600, 19200, 38400, 57600, 115200, 230400}))
      ->capture_default_str();
  app.add_option(
         "--node-id", own.node_id,
         "CANopen node id and Modbus unit of the first axis; the other axes have the next ids. "
         "0: the stored id, else 1. 255: the stored id, else the node is silent until LSS "
         "assigns an id. Default: the number of the axis.")
      ->check(CLI::Range(0, 127) | CLI::IsMember({FW_NODE_ID_BY_LSS}));
  app.add_option("--serial", own.serial,
                 "Serial number of the first axis (1018h:4); the other axes have the next "
                 "numbers. Default: computed from "
                 "this host's name and the number of the axis.");
  app.add_option("--store", own.store,
                 "File with the stored parameters; FILE.1, FILE.2, ... for several axes.");
  app.add_option("--journal", own.journal,
                 "Journal file with all inputs of the firmware, for `forceaxis recording replay`; "
                 "FILE.1, FILE.2, "
                 "... for several axes.");
  app.add_option("--hold", own.hold_s,
                 "Time in s in which the disabled axes still serve their buses after the plant "
                 "became silent.")
      ->check(nodes::real_range(0, 86400))
      ->capture_default_str();
  app.add_flag("--serve", own.serve,
               "Read runs from standard input, one per line: run number, experiment and overrides, "
               "separated by tabs.");
  app.footer(
      "Example:\n"
      "  axis_node sim/experiments/contact.toml --link lcm --run-id 7 &\n"
      "  plant_node sim/experiments/contact.toml --link lcm --run-id 7\n"
      "in real time, with CAN, a store and a journal:\n"
      "  axis_node sim/experiments/contact.toml --pace real --can vcan0 --store axis.bin \\\n"
      "    --journal axis.journal &\n"
      "  plant_node sim/experiments/contact.toml --pace real");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError &error) {
    return nodes::refuse("axis_node", app, error);
  }
  return nodes::guarded("axis_node", [&] {
    if (own.serve && options.endless) {
      throw nodes::UsageError(
          "--endless: expected no --serve, because runs of --serve have a duration");
    }
    if (own.serve) return serve(options, own);
    if (options.files.empty()) {
      throw nodes::UsageError("EXPERIMENT: expected the experiment file that plant_node simulates");
    }
    nodes::finish_options(options);
    own.real_time = options.pace == "real";
    nodes::end_by_signals();
    return run(options, own);
  });
}
