#pragma once
// A journal's run again, in process: to the last bit what the firmware on its buses did.
#include "firmware/port/host/axis_host.h"
#include "host/run/journal.hpp"
#include "host/run/result.hpp"

namespace forceaxis::host {

// Passes one entry to the firmware, as axis_node did before the entry's tick.
void apply(const Journal::Entry &entry, fw_t *axis);

// The run of the journal in process, as far as that is known. `experiment` must be that of the
// journal and gives the plant and the impulses. Throws as run().
RunResult replay(const Journal &journal, const Experiment &experiment, const RunOptions &options);

}  // namespace forceaxis::host
