#pragma once
// Functions that end the programs axis_node, plant_node and gateway. Each program ends with an exit
// status and, after an error, with one line on standard error.
#include <CLI/CLI.hpp>
#include <atomic>
#include <functional>
#include <stdexcept>

namespace forceaxis::nodes {

// An error in the command line. The exit status of the program is 2.
struct UsageError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Runs a program. After an exception, prints one line on standard error and returns the exit status
// 2 if the user must change an input, or 1 if the run has failed.
int guarded(const char *name, const std::function<int()> &program);

// Prints an error of CLI11 as one line and returns 2. If the user has requested the help, prints
// the help and returns 0.
int refuse(const char *name, const CLI::App &app, const CLI::ParseError &error);

// Number of the received signal SIGINT or SIGTERM; 0 before the first signal. The program then
// writes its report and ends. end_by_signals() starts the reception of the signals. A second signal
// ends the program immediately with the exit status 128 + signal.
extern std::atomic<int> stopped;
void end_by_signals();

}  // namespace forceaxis::nodes
