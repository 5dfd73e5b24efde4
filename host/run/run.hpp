#pragma once
// The in-process run: the firmware's fw_tick around the plant, one record a tick, passed by one
// direct call.
#include "host/run/experiment.hpp"
#include "host/run/result.hpp"

namespace forceaxis::host {

// Throws sim::InputError if the firmware refuses an initial write, sim::SimulationError if the
// plant cannot be stepped on, RunStopped.
RunResult run(const Experiment &, const RunOptions & = {});

}  // namespace forceaxis::host
