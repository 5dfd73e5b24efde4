#pragma once
// The run in one process: the function fw_tick of the firmware and the plant exchange one record in
// each direction per tick by a direct call.
#include "host/run/experiment.hpp"
#include "host/run/result.hpp"

namespace forceaxis::host {

// Runs an experiment. Throws sim::InputError if the firmware refuses an initial write,
// sim::SimulationError if the simulation of the plant cannot continue, RunStopped if the options
// stop the run.
RunResult run(const Experiment &, const RunOptions & = {});

}  // namespace forceaxis::host
