#pragma once
// How axis_node, plant_node and the gateway end: one line on standard error, and an exit status.
#include <CLI/CLI.hpp>
#include <atomic>
#include <functional>
#include <stdexcept>

namespace forceaxis::nodes {

// A mistake in the command line: exit status 2.
struct UsageError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Runs a program: what it throws becomes one line on standard error and an exit status, 2 for what
// the user must change, 1 for a run that failed.
int guarded(const char *name, const std::function<int()> &program);

// Prints CLI11's error as one line and returns 2; prints help and returns 0 if that was asked for.
int refuse(const char *name, const CLI::App &app, const CLI::ParseError &error);

// The signal that ends the program after its report is written, 0 before. From end_by_signals() on
// SIGINT and SIGTERM set it; a second one ends the program at once, status 128 + signal.
extern std::atomic<int> stopped;
void end_by_signals();

}  // namespace forceaxis::nodes
