// trace_hash EXPERIMENT [NAME=VALUE ...]: the trace hash that this build gives, and SHA-256 over
// every double of the trace.
#include <cstdio>
#include <string>
#include <vector>

#include "host/run/run.hpp"
#include "host/run/sha256.hpp"

int main(int argc, char **argv) {
  if (argc < 2) return 2;
  const std::vector<std::string> overrides(argv + 2, argv + argc);
  const auto experiment = forceaxis::host::load_experiment(argv[1], overrides);
  const auto result = forceaxis::host::run(experiment);
  forceaxis::host::Sha256 doubles;
  doubles.update(result.signals.data(), result.signals.size() * sizeof(double));
  std::printf("%s %s\n", result.trace_hash.c_str(), doubles.hex().c_str());
}
