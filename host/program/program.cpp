#include "host/program/program.hpp"

#include <unistd.h>

#include <csignal>
#include <iostream>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

#include "sim/model/model.hpp"
#include "sim/model/text.hpp"

namespace forceaxis::nodes {

namespace {

// Pairs of a name that messages of the library have in backticks, and the corresponding name on the
// command line.
constexpr std::pair<std::string_view, std::string_view> kNames[] = {
    {"`overrides`", "--set"},
    {"`list_objects`", "`forceaxis objects`"},
    {"`measure_response`", "`forceaxis measure`"},
    {"`design_law`", "`forceaxis design`"},
};

std::string for_command_line(std::string text) {
  for (const auto &[name, word] : kNames) {
    for (std::size_t at = text.find(name); at != text.npos; at = text.find(name, at)) {
      text.replace(at, name.size(), word);
    }
  }
  return text;
}

}  // namespace

int guarded(const char *name, const std::function<int()> &program) {
  const auto report = [name](const std::string &what, int status) {
    std::cerr << name << ": " << sim::one_line(for_command_line(what)) << '\n';
    return status;
  };
  try {
    return program();
  } catch (const UsageError &error) {
    return report(error.what(), 2);
  } catch (const sim::InputError &error) {
    return report(error.what(), 2);
  } catch (const std::exception &error) {
    return report(error.what(), 1);
  }
}

int refuse(const char *name, const CLI::App &app, const CLI::ParseError &error) {
  if (error.get_exit_code() == 0) return app.exit(error);
  std::cerr << name << ": " << sim::one_line(error.what()) << "; see --help\n";
  return 2;
}

std::atomic<int> stopped{0};

void end_by_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  // A separate thread receives the signals, so that a signal does not interrupt system calls of
  // other threads.
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  std::thread([signals] {
    for (int signal = 0; sigwait(&signals, &signal) == 0;) {
      if (stopped.exchange(signal) != 0) _exit(128 + signal);
    }
  }).detach();
}

}  // namespace forceaxis::nodes
