// The program gateway: the CANopen master of one or several axes on a CAN bus, for clients on LCM
// and Modbus TCP.
#include <signal.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <iostream>
#include <memory>
#include <random>

#include "host/gateway/can_queue.hpp"
#include "host/gateway/commands.hpp"
#include "host/gateway/modbus_axis.hpp"
#include "host/gateway/modbus_self.hpp"
#include "host/gateway/options.hpp"
#include "host/gateway/words.hpp"
#include "host/modbus/tcp_server.hpp"

namespace {

using namespace forceaxis;
using namespace forceaxis::nodes;
using namespace std::chrono_literals;

constexpr std::uint32_t kSync = 0x080, kHeartbeat = 0x700;
constexpr std::uint8_t kOperational = 5;
constexpr auto kWatchPeriod = 20ms;
constexpr auto kDropsPeriod = 10s;
constexpr char kPermitted[] = ", see --lcm-remote";
// Largest number of frames that one call processes. This limit prevents that many frames delay
// SYNC, heartbeat and LCM.
constexpr int kMostFrames = 256;
// Time for which a gateway listens for another gateway before it starts. This time is longer than
// the allowed delay of a heartbeat.
constexpr auto kClaim = 600ms;

struct OtherGateway : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class Gateway {
 public:
  explicit Gateway(const GatewayOptions &options)
      : options_(options), can_(options.can), lcm_(options.lcm_url) {
    for (const AxisSettings &settings : options.settings) {
      axes_.push_back(std::make_unique<Axis>(*this, settings));
    }
    if (options.modbus_port != 0) {
      modbus_ = std::make_unique<modbus::TcpServer>(
          options.modbus_address, options.modbus_port,
          [this](std::uint64_t client, std::uint8_t unit, const modbus::Pdu &request) {
            if (Axis *axis = find(unit)) {
              axis->requests.push({client, request});
            } else {
              loop_.post([this, client, unit, pdu = request] { serve_self(client, unit, pdu); });
            }
          },
          [this](int socket) { loop_.unwatch(socket); });
    }
  }
  ~Gateway() { loop_.abandon(); }
  Gateway(const Gateway &) = delete;
  Gateway &operator=(const Gateway &) = delete;

  // Runs until a signal is received on the descriptor `signals`, then stops all axes and ends when
  // all axes are at standstill. A second signal ends the program immediately. Returns the exit
  // status.
  int run(int signals) {
    loop_.watch(
        can_.fd(),
        [this] { return static_cast<short>(can_.waits_for_room() ? POLLIN | POLLOUT : POLLIN); },
        [this](short) { serve_can(); });
    loop_.watch(
        signals, [] { return short{POLLIN}; },
        [this, signals](short) {
          signalfd_siginfo signal;
          if (read(signals, &signal, sizeof signal) <= 0) return;
          if (ending_) {
            status_ = 128 + static_cast<int>(signal.ssi_signo);
            loop_.stop();
          } else {
            end();
          }
        });
    loop_.spawn(begin());
    loop_.run();
    const lcm_bus::Drops drops = lcm_.drops();
    if (drops.total() != 0)
      std::cerr << "gateway: LCM in total: " << drops.text(kPermitted) << std::endl;
    return status_;
  }

 private:
  struct ModbusRequest {
    std::uint64_t client;
    modbus::Pdu pdu;
  };
  struct Axis {
    Axis(Gateway &g, const AxisSettings &settings)
        : node(
              g.loop_, g.lcm_, [&g](const canopen::Frame &frame) { g.can_.send(frame); }, settings),
          commands(g.loop_, g.lcm_, node),
          modbus(node),
          requests(g.loop_) {}
    GatewayAxis node;
    GatewayCommands commands;
    ModbusAxis modbus;
    Mailbox<ModbusRequest> requests;
  };

  Axis *find(int number) {
    for (const auto &axis : axes_) {
      if (axis->node.number() == number) return axis.get();
    }
    return nullptr;
  }

  // Checks that no other node has the node id of this gateway. The gateway listens for frames with
  // this node id, then sends a boot-up message. If two gateways start at the same time, they listen
  // for different times, so one gateway receives the boot-up message of the other gateway.
  Task<void> begin() {
    std::random_device device;
    const auto jitter = std::chrono::milliseconds(std::uniform_int_distribution(0, 300)(device));
    co_await loop_.sleep(kClaim + jitter);
    claimed_ = true;
    send_heartbeat(0);
    beat();
    sync();
    watch();
    for (const auto &axis : axes_) {
      axis->node.start();
      axis->commands.start();
      loop_.spawn(serve_modbus(*axis));
    }
    std::vector<int> numbers;
    for (const auto &axis : axes_) numbers.push_back(axis->node.number());
    lcm_.listen(numbers, options_.remote, [this](int n, const axis_command_t &command) {
      find(n)->commands.receive(command);
    });
    for (const int fd : lcm_.fds()) {
      loop_.watch(
          fd, [] { return short{POLLIN}; }, [this](short) { lcm_.handle(); });
    }
    if (modbus_) {
      loop_.watch(
          modbus_->listening(), [] { return short{POLLIN}; }, [this](short) { accept(); });
    }
    std::cout << "gateway ready pid " << getpid() << ", " << options_.can << " axes "
              << options_.axes << ", node id " << options_.node_id << ", LCM " << options_.lcm_url;
    for (const std::string &network : options_.lcm_remote) {
      std::cout << ", commands from " << network;
    }
    std::cout << ", "
              << (modbus_ ? "Modbus TCP " + options_.modbus_address + ":" +
                                std::to_string(options_.modbus_port)
                          : std::string("no Modbus"))
              << std::endl;
  }

  // Stops all axes at the same time, so that no axis moves while another axis stops.
  void end() {
    ending_ = true;
    if (!claimed_) return loop_.stop();
    unstopped_ = axes_.size();
    for (const auto &axis : axes_) loop_.spawn(end(*axis));
  }

  Task<void> end(Axis &axis) {
    co_await axis.node.shut_down();
    if (--unstopped_ == 0) loop_.stop();
  }

  void send_heartbeat(std::uint8_t state) {
    can_.send({kHeartbeat + static_cast<std::uint32_t>(options_.node_id), 1, {state}});
  }

  // Calls the function `what` immediately and then once in each period, counted from the time `at`.
  // A late call does not delay the next calls.
  void every(EventLoop::Time at, EventLoop::Clock::duration period, EventLoop::Call what) {
    what();
    EventLoop::Time next = at + period;
    if (next < EventLoop::Clock::now()) next = EventLoop::Clock::now() + period;
    loop_.at(next, [this, next, period, what = std::move(what)] { every(next, period, what); });
  }

  void beat() {
    every(EventLoop::Clock::now(), std::chrono::milliseconds(options_.heartbeat_ms),
          [this] { send_heartbeat(kOperational); });
  }

  void sync() {
    const auto period = std::chrono::duration_cast<EventLoop::Clock::duration>(
        std::chrono::duration<double>(1 / options_.sync_hz));
    every(EventLoop::Clock::now(), period, [this] {
      for (const auto &axis : axes_) axis->node.before_sync();
      can_.send({kSync, 0, {}});
    });
  }

  void watch() {
    every(EventLoop::Clock::now(), kWatchPeriod, [this] {
      // The received frames are processed before the heartbeats are checked.
      serve_can();
      for (const auto &axis : axes_) axis->node.watch_heartbeat(kWatchPeriod);
      if (modbus_) modbus_->close_overdue(EventLoop::Clock::now());
      report_trouble();
      report_drops();
    });
  }

  // Reports refused messages, at most once in kDropsPeriod, so that a sender of invalid messages
  // cannot fill the log.
  void report_drops() {
    const lcm_bus::Drops drops = lcm_.drops();
    const EventLoop::Time now = EventLoop::Clock::now();
    if (drops.total() == reported_drops_ || now < next_drops_) return;
    std::cerr << "gateway: LCM: " << drops.text(kPermitted) << std::endl;
    for (const auto &axis : axes_) {
      axis->node.publisher().event(axis_event_t::EVENT_BUS,
                                   static_cast<std::int64_t>(drops.total() - reported_drops_),
                                   "LCM: " + drops.text(kPermitted));
    }
    reported_drops_ = drops.total();
    next_drops_ = now + kDropsPeriod;
  }

  void report_trouble() {
    const CanQueue::Trouble trouble = can_.take_trouble();
    if (trouble.text.empty() || (trouble.text == reported_ && trouble.lost == 0)) return;
    reported_ = trouble.text;
    std::cerr << "gateway: " << options_.can << ": " << trouble.text;
    if (trouble.lost != 0) std::cerr << " (" << trouble.lost << " frames)";
    std::cerr << std::endl;
    for (const auto &axis : axes_) {
      axis->node.publisher().event(axis_event_t::EVENT_BUS, static_cast<std::int64_t>(trouble.lost),
                                   options_.can + ": " + trouble.text);
    }
  }

  void serve_can() {
    if (can_.waits_for_room()) can_.flush();
    for (int n = 0; n < kMostFrames; ++n) {
      const auto frame = can_.receive();
      if (!frame) return;
      if (frame->id == kHeartbeat + static_cast<std::uint32_t>(options_.node_id)) {
        meet_other();
        continue;
      }
      for (const auto &axis : axes_) axis->node.receive(*frame);
    }
  }

  void meet_other() {
    const std::string text =
        options_.can + ": another gateway has node id " + std::to_string(options_.node_id);
    if (!claimed_) throw OtherGateway(text + "; stop that gateway, or use another --node-id here");
    if (met_other_) return;
    met_other_ = true;
    for (const auto &axis : axes_)
      axis->node.publisher().loud_event(axis_event_t::EVENT_BUS, 0, text);
  }

  void accept() {
    const auto [client, socket] = modbus_->accept(EventLoop::Clock::now());
    if (socket < 0) return;
    loop_.watch(
        socket, [] { return short{POLLIN}; },
        [this, client = client](short) { modbus_->receive(client, EventLoop::Clock::now()); });
  }

  void serve_self(std::uint64_t client, std::uint8_t unit, modbus::Pdu pdu) {
    modbus_self_.serve(unit, pdu);
    modbus_->answer(client, pdu, EventLoop::Clock::now());
  }

  Task<void> serve_modbus(Axis &axis) {
    while (loop_.running()) {
      ModbusRequest next = co_await axis.requests;
      co_await axis.modbus.serve(next.pdu);
      modbus_->answer(next.client, next.pdu, EventLoop::Clock::now());
    }
  }

  GatewayOptions options_;
  EventLoop loop_;
  CanQueue can_;
  lcm_bus::AxisChannels lcm_;
  std::vector<std::unique_ptr<Axis>> axes_;
  std::unique_ptr<modbus::TcpServer> modbus_;
  ModbusSelf modbus_self_;
  std::string reported_;
  std::uint64_t reported_drops_ = 0;
  EventLoop::Time next_drops_;
  bool claimed_ = false, ending_ = false, met_other_ = false;
  std::size_t unstopped_ = 0;  // number of axes that were still moving when the program ended
  int status_ = 0;
};

}  // namespace

int main(int argc, char **argv) {
  GatewayOptions options;
  CLI::App app(
      "CANopen master of axes on a CAN bus: configures and starts the axes, publishes "
      "their states, events and recordings over LCM, accepts commands over LCM, and "
      "serves Modbus TCP, where the unit is the node id of the axis. Prints one line "
      "when the gateway is ready.\n"
      "Ends on SIGTERM or SIGINT. Axes that CANopen or a client of the gateway owns "
      "make a quick stop first; a second signal ends the gateway before these stops are "
      "complete. If the gateway is killed, its heartbeat ends and the axes are disabled. Exit "
      "status: 0 ended, 1 no CAN, LCM or port, or another gateway has its node id, 2 "
      "wrong usage, 130 and 143 ended at once by a second SIGINT or SIGTERM.");
  add_gateway_options(app, options);
  app.footer(
      "Example:\n"
      "  gateway --can vcan0 --axes 1,2 --set force_gain=5 --modbus-port 1502");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError &error) {
    return refuse("gateway", app, error);
  }
  // Signals are blocked before LCM starts its own thread, because otherwise this thread would
  // receive the signals.
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGTERM);
  sigaddset(&set, SIGINT);
  sigprocmask(SIG_BLOCK, &set, nullptr);
  signal(SIGPIPE, SIG_IGN);
  const int signals = signalfd(-1, &set, SFD_CLOEXEC | SFD_NONBLOCK);
  return guarded("gateway", [&options, signals] {
    finish_gateway_options(options);
    return Gateway(options).run(signals);
  });
}
