#pragma once
// Repeats a journal's run in process, with the firmware's outputs identical to the last bit.
#include "host/run/firmware_side.hpp"
#include "host/run/journal.hpp"
#include "host/run/result.hpp"

namespace forceaxis::host {

// Passes one entry to the firmware; to be called before the entry's tick. Sensorless ticks are run.
void apply(const Journal::Entry &entry, FirmwareSide &firmware);

// The run of the journal in process, as far as that is known. `experiment` must be that of the
// journal and gives the plant, the impulses and what happens to its sensor. Throws as run().
RunResult replay(const Journal &journal, const Experiment &experiment, const RunOptions &options);

}  // namespace forceaxis::host
