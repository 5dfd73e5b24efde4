#pragma once
// A run in one process. In each tick, the function fw_tick of the firmware is called directly with
// the sensor codes of the plant and returns the DAC code.
#include "host/run/experiment.hpp"
#include "host/run/result.hpp"

namespace forceaxis::host {

// Runs an experiment. Throws sim::InputError if the firmware refuses an initial write,
// sim::SimulationError if the simulation of the plant cannot continue, and RunStopped if
// options.stop returns true.
RunResult run(const Experiment &, const RunOptions & = {});

}  // namespace forceaxis::host
