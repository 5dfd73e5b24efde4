// trace_hash EXPERIMENT [NAME=VALUE ...]: what this build makes of it.
#include <cstdio>
#include <string>
#include <vector>

#include "host/link/run.hpp"

int main(int argc, char **argv) {
  if (argc < 2) return 2;
  const std::vector<std::string> overrides(argv + 2, argv + argc);
  const auto experiment = forceaxis::host::load_experiment(argv[1], overrides);
  std::puts(forceaxis::host::run(experiment).trace_hash.c_str());
}
