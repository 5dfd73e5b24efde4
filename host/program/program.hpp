#pragma once
// How every program of this folder ends: one line on standard error, and an exit status.
#include <CLI/CLI.hpp>
#include <functional>
#include <stdexcept>

namespace forceaxis::nodes {

// What only the command line can get wrong: exit status 2.
struct UsageError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Runs a program: what it throws becomes one line on standard error and an exit status, 2 for what
// the user must change, 1 for a run that failed.
int guarded(const char *name, const std::function<int()> &program);

// CLI11's complaint as one line and status 2; its help with 0.
int refuse(const char *name, const CLI::App &app, const CLI::ParseError &error);

}  // namespace forceaxis::nodes
