#include "host/program/node_options.hpp"

#include <algorithm>
#include <cctype>
#include <memory>
#include <stdexcept>

#include "host/lcm/url.hpp"
#include "host/program/help.hpp"
#include "host/program/number_range.hpp"

namespace forceaxis::nodes {
namespace {

std::chrono::milliseconds milliseconds_of(double seconds) {
  return std::chrono::milliseconds(static_cast<std::int64_t>(seconds * 1000 + 0.5));
}

// Parses the prefix of an override such as "3:NAME=VALUE". Returns the axis number, or 0 for all
// axes, and the index of the first character of the name.
std::pair<int, std::size_t> axis_prefix(const std::string &set) {
  const bool prefixed =
      set.size() > 2 && std::isdigit(static_cast<unsigned char>(set[0])) != 0 && set[1] == ':';
  return prefixed ? std::pair(set[0] - '0', std::size_t{2}) : std::pair(0, std::size_t{0});
}

}  // namespace

void add_options(CLI::App &app, NodeOptions &o) {
  app.formatter(std::make_shared<Help>());
  app.add_option("EXPERIMENT", o.files,
                 "Experiment file of each axis; both nodes must get the same files.");
  app.add_option(
         "--set", o.sets,
         "Override NAME=VALUE as for `forceaxis run`, or N:NAME=VALUE for axis N only. Repeatable.")
      ->take_all()
      ->expected(1)
      ->type_name("NAME=VALUE");
  app.add_option("--axes", o.axes, "Number of axes if all axes have the same experiment.")
      ->check(CLI::Range(1, host::kMostAxes));
  app.add_option("--first-axis", o.first_axis, "Number of the first axis.")
      ->check(CLI::Range(1, host::kMostAxes))
      ->capture_default_str();
  app.add_option("--link", o.link.kind, "Transport of the link.")
      ->check(CLI::IsMember({"lcm", "socketcan"}))
      ->capture_default_str();
  app.add_option("--link-can", o.link.can_interface,
                 "CAN interface of the link, which must carry no other frames.")
      ->capture_default_str();
  app.add_option("--lcm-url", o.link.lcm_url,
                 "LCM URL of the link, udpm://ADDRESS:PORT?ttl=N, on this machine; default: a "
                 "port computed from the run number.");
  app.add_option("--run-id", o.link.run_id,
                 "Number of the run (LCM); the same for both nodes, different for concurrent runs.")
      ->check(CLI::Range(std::int64_t{0}, std::int64_t{1} << 53))
      ->capture_default_str();
  app.add_option("--pace", o.pace,
                 "fast: as fast as possible; real: 1500 ticks a second of the wall clock. "
                 "plant_node sets the pace. With real, axis_node reports a tick that is more than "
                 "one tick period late as an overrun: object 2307h, emergency FF04h.")
      ->check(CLI::IsMember({"fast", "real"}))
      ->capture_default_str();
  app.add_flag("--endless", o.endless,
               "For both nodes: run a session until the user ends a node (Ctrl-C, SIGTERM; exit "
               "status 0), independent of the experiment's duration. A node that was suspended "
               "reports the missed ticks, and the axis is disabled during the suspension.");
  app.add_option("--start-timeout", o.start_timeout_s,
                 "Seconds to wait for the other node's first record.")
      ->check(real_range(0.01, 86400))
      ->capture_default_str();
  app.add_option("--timeout", o.timeout_s,
                 "Seconds without a record after which the other node is reported as silent.")
      ->check(real_range(0.01, 3600))
      ->capture_default_str();
  app.add_option(
      "--inject", o.inject,
      "For tests: faults in the records that this node sends, drop=0.05,double=0.05,seed=1,"
      "flip=TICK,bit=0.");
}

void finish_options(NodeOptions &o) {
  if (!o.inject.empty()) {
    try {
      o.link.injection = host::injection_of(o.inject);
    } catch (const std::invalid_argument &error) {
      throw UsageError(std::string("--inject: ") + error.what());
    }
  }
  if (!o.link.lcm_url.empty()) {
    const std::string wrong = lcm_bus::url_trouble(o.link.lcm_url);
    if (!wrong.empty()) throw UsageError("--lcm-url " + wrong);
  }
  o.link.timeouts = {milliseconds_of(o.start_timeout_s), milliseconds_of(o.timeout_s)};
  if (o.axes > 0 && o.files.size() > 1) {
    throw UsageError("--axes: expected one experiment for all axes, or one for each axis");
  }
  while (static_cast<int>(o.files.size()) < o.axes) o.files.push_back(o.files.front());
  const int last = o.first_axis + static_cast<int>(o.files.size()) - 1;
  if (last > host::kMostAxes) {
    throw UsageError("EXPERIMENT: expected axes 1 to 6, but the last would be axis " +
                     std::to_string(last));
  }
  for (const std::string &set : o.sets) {
    const int axis = axis_prefix(set).first;
    if (axis_prefix(set).second > 0 && (axis < o.first_axis || axis > last)) {
      throw UsageError("--set " + set + ": expected an axis of this node, " + axes_range(o));
    }
  }
}

std::vector<std::string> overrides_of(const NodeOptions &o, int axis) {
  const auto name = [](const std::string &set) {
    const std::size_t at = axis_prefix(set).second;
    return set.substr(at, set.find('=', at) - at);
  };
  // An override for one axis takes precedence over an override for all axes.
  const auto shadowed = [&](const std::string &set) {
    return axis_prefix(set).first == 0 &&
           std::any_of(o.sets.begin(), o.sets.end(), [&](const std::string &other) {
             return axis_prefix(other).first == axis && name(other) == name(set);
           });
  };
  std::vector<std::string> overrides;
  for (const std::string &set : o.sets) {
    const auto [of, at] = axis_prefix(set);
    if ((of == 0 || of == axis) && !shadowed(set)) overrides.push_back(set.substr(at));
  }
  return overrides;
}

std::vector<host::Experiment> load_experiments(const NodeOptions &o) {
  std::vector<host::Experiment> experiments;
  for (std::size_t i = 0; i < o.files.size(); ++i) {
    experiments.push_back(
        host::load_experiment(o.files[i], overrides_of(o, o.first_axis + static_cast<int>(i))));
    if (o.endless) host::make_endless(experiments.back());
  }
  return experiments;
}

std::string axes_range(const NodeOptions &o) {
  const int last = o.first_axis + static_cast<int>(o.files.size()) - 1;
  return std::to_string(o.first_axis) + (last > o.first_axis ? "-" + std::to_string(last) : "");
}

std::string session_json(const host::Interruptions &interruptions, const std::string &ended) {
  return JsonObject()
      .add("interruptions", interruptions.count)
      .add("missed_s", static_cast<double>(interruptions.total.count()) / 1000)
      .add("missed_ticks", interruptions.ticks())
      .add("ended", ended.empty() ? "by a signal" : ended)
      .text();
}

std::string statistics_json(const host::LinkStatistics &s, const host::InjectionCounts &injected) {
  return JsonObject()
      .add("sent", s.sent)
      .add("received", s.received)
      .add("repeated", s.repeated)
      .add("duplicates", s.duplicates)
      .add("foreign", s.foreign)
      .add("dropped", injected.dropped)
      .add("doubled", injected.doubled)
      .add("flipped", injected.flipped)
      .add("on_wire", s.sent - injected.dropped + injected.doubled)
      .text();
}

}  // namespace forceaxis::nodes
