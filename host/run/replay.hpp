#pragma once
// Repeats a journal's run in process, with the firmware's outputs identical to the last bit.
#include "firmware/port/host/axis_host.h"
#include "host/run/journal.hpp"
#include "host/run/result.hpp"

namespace forceaxis::host {

// Passes one entry to the firmware; to be called before the entry's tick.
void apply(const Journal::Entry &entry, fw_t *axis);

// The run of the journal in process, as far as that is known. `experiment` must be that of the
// journal and gives the plant and the impulses. Throws as run().
RunResult replay(const Journal &journal, const Experiment &experiment, const RunOptions &options);

}  // namespace forceaxis::host
