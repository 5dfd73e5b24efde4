#pragma once
// The options, overrides and statistics that axis_node and plant_node share.
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
  bool endless = false;  // a session, see host/link/session.hpp
  host::LinkOptions link;
};

// Adds the options to `app`. finish_options(), after parsing, checks them and derives the others;
// it throws UsageError.
void add_options(CLI::App &app, NodeOptions &options);
void finish_options(NodeOptions &options);

// The overrides NAME=VALUE of one axis, numbered from 1.
std::vector<std::string> overrides_of(const NodeOptions &options, int axis);

// The experiments, one an axis, endless if the options are. Throws sim::InputError.
std::vector<host::Experiment> load_experiments(const NodeOptions &options);

// The hosted axes as messages name them, "1" or "1-6".
std::string axes_range(const NodeOptions &options);

// What a session went through; `ended` is empty where a signal ended it.
std::string session_json(const host::Interruptions &interruptions, const std::string &ended);

// Statistics of one end, injected faults included.
std::string statistics_json(const host::LinkStatistics &statistics,
                            const host::InjectionCounts &injected);

}  // namespace forceaxis::nodes
