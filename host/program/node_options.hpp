#pragma once
// What axis_node and plant_node have in common: arguments, errors, reports.
#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>
#include <vector>

#include "host/link/linked_run.hpp"
#include "host/program/json.hpp"
#include "host/program/program.hpp"

namespace forceaxis::nodes {

struct NodeOptions {
  std::vector<std::string> files;  // experiments of the axes, from the first on
  std::vector<std::string> sets;   // NAME=VALUE for all axes, or N:NAME=VALUE
  int first_axis = 1;
  int axes = 0;  // 0: as many as there are files; else one file for all of them
  std::string inject;
  std::string pace = "fast";  // or "real"
  double start_timeout_s = 5;
  double timeout_s = 1;
  host::LinkOptions link;
};

// Adds the options to `app`. They are complete after finish_options(), which throws UsageError.
void add_options(CLI::App &app, NodeOptions &options);
void finish_options(NodeOptions &options);

// The overrides of one axis.
std::vector<std::string> overrides_of(const NodeOptions &options, int axis);

// The experiments, one an axis. Throws sim::InputError.
std::vector<host::Experiment> load_experiments(const NodeOptions &options);

// "1" or "1-6".
std::string axes_range(const NodeOptions &options);

// Statistics of one end, injected faults included.
std::string statistics_json(const host::LinkStatistics &statistics,
                            const host::InjectionCounts &injected);

}  // namespace forceaxis::nodes
