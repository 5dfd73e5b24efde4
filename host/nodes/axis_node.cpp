// axis_node: the firmware of one or several axes as a process of its own, in lock-step with a
// plant.
#include <poll.h>
#include <unistd.h>

#include <iostream>
#include <memory>
#include <sstream>

#include "firmware/objects/generated/axis_objects.h"
#include "host/link/firmware_side.hpp"
#include "host/link/objects.hpp"
#include "host/link/socketcan.hpp"
#include "host/nodes/node_options.hpp"

namespace {

using namespace forceaxis;
using std::chrono::milliseconds;

constexpr milliseconds kServe{100};
// The plant may miss the last answer and ask again, at most every 100 ms.
constexpr milliseconds kLinger{250};

// One axis of this node.
struct Axis {
  Axis(int n, const host::Experiment &e) : number(n), experiment(e), firmware(e, true) {}

  std::string json() {
    std::string refused;
    for (const host::Refusal &r : firmware.refused()) {
      nodes::append(refused, nodes::JsonObject()
                                 .add("tick", r.tick)
                                 .add("object", r.object)
                                 .add("reason", r.reason)
                                 .text());
    }
    nodes::JsonObject o;
    o.add("axis", number)
        .add("experiment", experiment.file.string())
        .add("inputs_hash", experiment.hash)
        .add("ticks", firmware.next_tick())
        .add("trace_hash", firmware.hash())
        .add("fault", host::enum_text(AXIS_OBJ_FAULT, firmware.read(AXIS_OBJ_FAULT)))
        .raw("refused", "[" + refused + "]");
    if (!lost.empty()) o.raw("after_silence", lost);
    return o.text();
  }

  int number;
  const host::Experiment &experiment;
  host::FirmwareSide firmware;
  std::string lost;  // what it answered after the plant fell silent
};

// Whether somebody has written to standard input, or closed it.
bool asked_on_input() {
  pollfd input{STDIN_FILENO, POLLIN, 0};
  return poll(&input, 1, 0) == 1;
}

// One run from ready to report. `serving`: standard input says when the plant has done.
int run(const nodes::NodeOptions &options, bool serving) {
  const std::vector<host::Experiment> experiments = nodes::load_experiments(options);
  std::vector<std::unique_ptr<Axis>> axes;
  std::vector<std::uint8_t> numbers;
  std::vector<std::int64_t> last_ticks;
  std::vector<std::unique_ptr<host::CanClaim>> claims;
  for (std::size_t i = 0; i < experiments.size(); ++i) {
    const int number = options.first_axis + static_cast<int>(i);
    axes.push_back(std::make_unique<Axis>(number, experiments[i]));
    numbers.push_back(static_cast<std::uint8_t>(number));
    last_ticks.push_back(experiments[i].ticks);
    if (options.link.kind != "lcm") {
      claims.push_back(std::make_unique<host::CanClaim>(options.link.can_interface,
                                                        "axis " + std::to_string(number)));
    }
  }
  host::InjectionCounts injected;
  const auto transport = host::open_axis_transport(options.link, injected);
  host::AxisExchange exchange(
      *transport, options.link.timeouts, numbers, last_ticks,
      [&axes, first = options.first_axis](const host::LinkInputs &in) {
        return axes[static_cast<std::size_t>(in.axis - first)]->firmware.tick(in);
      });
  std::cout << "axis_node ready pid " << getpid() << ", " << host::link_text(options.link)
            << ", axes " << nodes::axes_range(options) << std::endl;

  unsigned silent = 0;
  std::uint64_t lost_records = 0;
  while (!exchange.finished()) {
    const unsigned now_silent = exchange.serve(kServe);
    silent |= now_silent;
    for (const auto &axis : axes) {
      if ((now_silent >> (axis->number - 1) & 1U) == 0) continue;
      const host::LinkOutputs out =
          axis->firmware.lose_sensors(static_cast<std::uint8_t>(axis->number));
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
  while (silent == 0 && exchange.quiet() < kLinger && !(serving && asked_on_input())) {
    exchange.serve(serving ? milliseconds{2} : milliseconds{50});
  }

  std::string list;
  for (const auto &axis : axes) nodes::append(list, axis->json());
  host::LinkStatistics statistics = exchange.statistics();
  statistics.sent += lost_records;
  std::string failure;
  if (silent != 0) {
    const auto &timeouts = options.link.timeouts;
    const bool ever = axes[0]->firmware.next_tick() > 0;
    failure = "plant_node silent for " +
              std::to_string((ever ? timeouts.running : timeouts.start).count()) + " ms (" +
              host::axes_text(silent) + "): " +
              (ever ? "it ended or hangs; the axis is disabled, code 0"
                    : "it never asked; is it running, on this link and with this run id?");
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
  if (failure.empty()) return 0;
  if (!serving) std::cerr << "axis_node: " << failure << '\n';
  return 1;
}

// Runs as standard input asks for them, one a line: run number, experiment and overrides, separated
// by tabs. What fails becomes {"error": ..., "status": 1 or 2} and the next line is read.
int serve(const nodes::NodeOptions &base) {
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
      run(job, true);
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
  bool serving = false;
  CLI::App app(
      "The firmware of one or several axes, tick by tick in lock-step with plant_node.\n"
      "Prints one line when ready and one JSON object at the end. If the plant falls silent, the\n"
      "axes run one tick without sensors and are disabled. Exit status 0 done, 1 the run failed\n"
      "(plant_node silent), 2 wrong usage or input.");
  nodes::add_options(app, options);
  app.add_flag("--serve", serving,
               "Take runs from standard input, one a line: run number, experiment and overrides, "
               "separated by tabs.");
  app.footer(
      "Example:\n"
      "  axis_node sim/experiments/contact.toml --link lcm --run-id 7 &\n"
      "  plant_node sim/experiments/contact.toml --link lcm --run-id 7");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError &error) {
    return nodes::refuse("axis_node", app, error);
  }
  return nodes::guarded("axis_node", [&] {
    if (serving) return serve(options);
    if (options.files.empty()) {
      throw nodes::UsageError("EXPERIMENT: expected the experiment that the plant runs");
    }
    nodes::finish_options(options);
    return run(options, false);
  });
}
