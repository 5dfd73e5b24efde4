#pragma once
// The end of axis_node, plant_node and gateway: one line on standard error and an exit status.
#include <CLI/CLI.hpp>
#include <atomic>
#include <functional>
#include <stdexcept>

namespace forceaxis::nodes {

// An error in the command line, with exit status 2.
struct UsageError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Runs a program. An exception becomes one line on standard error and an exit status: 2 if the user
// must change an input, 1 if the run has failed.
int guarded(const char *name, const std::function<int()> &program);

// Prints an error of CLI11 as one line and returns 2. Prints the help and returns 0 if the user has
// asked for it.
int refuse(const char *name, const CLI::App &app, const CLI::ParseError &error);

// Number of the signal that ends the program after it has written its report; 0 before the signal.
// After end_by_signals(), SIGINT and SIGTERM set it. A second signal ends the program at once, with
// exit status 128 + signal.
extern std::atomic<int> stopped;
void end_by_signals();

}  // namespace forceaxis::nodes
