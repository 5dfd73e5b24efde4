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
  std::vector<std::string> files;  // experiment files, one for each axis, in the order of the axes
  std::vector<std::string> sets;   // overrides, NAME=VALUE for all axes or N:NAME=VALUE for axis N
  int first_axis = 1;
  // Number of axes that share one experiment file; 0 if each axis has a file of its own.
  int axes = 0;
  std::string inject;
  std::string pace = "fast";  // "fast" or "real"
  double start_timeout_s = 5;
  double timeout_s = 1;
  bool endless = false;  // The nodes run a session, see host/link/session.hpp.
  host::LinkOptions link;
};

// add_options() adds the options to `app`. finish_options() is called after parsing; it checks the
// options and derives other values from them. It throws UsageError.
void add_options(CLI::App &app, NodeOptions &options);
void finish_options(NodeOptions &options);

// Returns the overrides NAME=VALUE of one axis, which is counted from 1.
std::vector<std::string> overrides_of(const NodeOptions &options, int axis);

// Returns the experiments, one for each axis. They are endless if the options say so. Throws
// sim::InputError.
std::vector<host::Experiment> load_experiments(const NodeOptions &options);

// Returns the axes of this process as text for messages, "1" or "1-6".
std::string axes_range(const NodeOptions &options);

// Returns the interruptions of a session and the reason for its end. `ended` is empty if a signal
// ended it.
std::string session_json(const host::Interruptions &interruptions, const std::string &ended);

// Returns the statistics of one end of the link, with the injected faults.
std::string statistics_json(const host::LinkStatistics &statistics,
                            const host::InjectionCounts &injected);

}  // namespace forceaxis::nodes
