// The program plant_node: the plants of one or several axes, in lock-step with axis_node.
#include <unistd.h>

#include <algorithm>
#include <iostream>
#include <optional>

#include "host/lcm/lcm_ends.hpp"
#include "host/lcm/url.hpp"
#include "host/plant_node/live_plants.hpp"
#include "host/program/node_options.hpp"

namespace {

using namespace forceaxis;

std::string axis_json(int axis, const host::Experiment &experiment, std::int64_t ticks,
                      const host::RunResult &result) {
  nodes::JsonObject o;
  o.add("axis", axis)
      .add("experiment", experiment.file.string())
      .add("inputs_hash", experiment.hash)
      .add("ticks", ticks)
      .add("trace_hash", result.trace_hash)
      .add("peak_force_N", result.metrics.peak_force_N)
      .add("fault", result.fault);
  if (result.verdict.empty()) {
    o.raw("verdict", "null");
  } else {
    o.add("verdict", result.verdict);
  }
  return o.add("edge_margin", result.edge_margin).text();
}

int run(const nodes::NodeOptions &options, bool live) {
  const std::vector<host::Experiment> experiments = nodes::load_experiments(options);
  host::LinkedPlants plants(experiments, static_cast<std::uint8_t>(options.first_axis),
                            {.trace = false, .audit = false}, options.link);
  std::optional<nodes::LivePlants> shown;
  if (live) shown.emplace(lcm_bus::default_url());
  std::cout << "plant_node ready pid " << getpid() << ", " << host::link_text(options.link)
            << ", axes " << nodes::axes_range(options) << std::endl;
  std::vector<host::RunResult> results;
  std::string failure;
  try {
    host::LinkWatch watch;
    if (shown) watch = [&shown](const host::LinkMoment &moment) { shown->show(moment); };
    const host::LinkSession session{
        [] { return nodes::stopped != 0; },
        [&shown](std::int64_t tick, bool paused, const std::string &text) {
          std::cerr << "plant_node: " << text << std::endl;
          if (shown) shown->report(tick, paused, text);
        }};
    results = plants.run(options.pace == "real", watch, options.endless ? &session : nullptr);
  } catch (const host::LinkSilent &error) {
    failure = error.what();
  }
  const host::LinkReport report = plants.report();
  std::string ended = failure;
  if (report.axis_ended) {
    ended = "axis_node has ended at tick " + std::to_string(report.ticks) + "; the session ends";
    std::cerr << "plant_node: " << ended << '\n';
  }
  if (shown) shown->end(std::max<std::int64_t>(report.ticks - 1, 0), ended);
  std::string axes;
  for (std::size_t i = 0; i < results.size(); ++i) {
    nodes::append(axes, axis_json(options.first_axis + static_cast<int>(i), experiments[i],
                                  std::min(experiments[i].ticks + 1, report.ticks), results[i]));
  }
  const double rate =
      report.seconds > 0 ? static_cast<double>(report.ticks - 1) / report.seconds : 0;
  nodes::JsonObject o;
  o.add("node", "plant")
      .add("pid", getpid())
      .add("link", options.link.kind)
      .add("run_id", options.link.run_id)
      .add("ticks", report.ticks)
      .add("ticks_per_s", rate)
      .add("real_time", rate / sim::kTickRateHz)
      .add("overruns", report.overruns)
      .raw("axes", "[" + axes + "]")
      .raw("statistics", nodes::statistics_json(report.statistics, report.injected));
  if (options.endless) o.raw("session", nodes::session_json(report.interruptions, ended));
  if (!failure.empty()) o.add("error", failure);
  std::cout << o.text() << std::endl;
  if (failure.empty()) return 0;
  std::cerr << "plant_node: " << failure << '\n';
  return 1;
}

}  // namespace

int main(int argc, char **argv) {
  nodes::NodeOptions options;
  CLI::App app(
      "The plants of one or several axes, tick by tick in lock-step with axis_node.\n"
      "Prints one line when ready and one JSON object at the end. Exit status: 0 "
      "complete, 1 the run failed (axis_node silent), 2 wrong usage or input. A "
      "session (--endless) that was ended has status 0.");
  nodes::add_options(app, options);
  bool live = false;
  app.add_flag(
      "--live", live,
      "Publish the clock and the true signals of the plants every 0.1 s of simulated time, for "
      "`forceaxis monitor` and logs, on LCM_DEFAULT_URL or else on LCM's default URL.");
  app.get_option("EXPERIMENT")->required();
  app.footer(
      "Example:\n"
      "  axis_node sim/experiments/contact.toml --link lcm --run-id 7 &\n"
      "  plant_node sim/experiments/contact.toml --link lcm --run-id 7\n"
      "a session in real time, until Ctrl-C:\n"
      "  axis_node sim/experiments/contact.toml --endless --pace real --can vcan0 &\n"
      "  plant_node sim/experiments/contact.toml --endless --pace real --live");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError &error) {
    return nodes::refuse("plant_node", app, error);
  }
  return nodes::guarded("plant_node", [&] {
    nodes::finish_options(options);
    const std::string wrong = live ? lcm_bus::url_trouble(lcm_bus::default_url()) : "";
    if (!wrong.empty()) throw nodes::UsageError("LCM_DEFAULT_URL " + wrong);
    if (options.endless) nodes::end_by_signals();
    return run(options, live);
  });
}
