#pragma once
// The common options, overrides and statistics of axis_node and plant_node.
#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>
#include <vector>

#include "host/link/linked_run.hpp"
#include "host/program/json.hpp"
#include "host/program/program.hpp"

namespace forceaxis::nodes {

struct NodeOptions {
  // Experiment files in the order of the axes, one file for each axis.
  std::vector<std::string> files;
  std::vector<std::string> sets;  // Overrides: NAME=VALUE for all axes, or N:NAME=VALUE for axis N.
  int first_axis = 1;
  // Number of axes that use the same experiment file; 0 if each axis has its own file.
  int axes = 0;
  std::string inject;
  std::string pace = "fast";  // Speed of the run: "fast" or "real".
  double start_timeout_s = 5;
  double timeout_s = 1;
  bool endless = false;  // true: the programs run a session that has no end time
                         // (host/link/session.hpp)
  host::LinkOptions link;
};

// add_options() adds the options to `app`. finish_options() must be called after parsing. This
// function checks the options, derives other values, and throws UsageError.
void add_options(CLI::App &app, NodeOptions &options);
void finish_options(NodeOptions &options);

// Returns the overrides NAME=VALUE of one axis. `axis` is counted from 1.
std::vector<std::string> overrides_of(const NodeOptions &options, int axis);

// Reads the experiments, one for each axis. With NodeOptions::endless, make_endless() is applied to
// each experiment. Throws sim::InputError.
std::vector<host::Experiment> load_experiments(const NodeOptions &options);

// Returns the axes of this process as text for messages, such as "1" or "1-6".
std::string axes_range(const NodeOptions &options);

// Returns the interruptions of a session and the reason for its end as JSON. `ended` is empty if a
// signal ended the session.
std::string session_json(const host::Interruptions &interruptions, const std::string &ended);

// Returns the statistics of one side of the link, and the numbers of injected faults, as JSON.
std::string statistics_json(const host::LinkStatistics &statistics,
                            const host::InjectionCounts &injected);

}  // namespace forceaxis::nodes
