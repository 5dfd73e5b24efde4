#pragma once
// Repeats the run of a journal in one process. The outputs of the firmware are identical to the
// last bit.
#include "host/run/firmware_side.hpp"
#include "host/run/journal.hpp"
#include "host/run/result.hpp"

namespace forceaxis::host {

// Passes one journal entry to the firmware. Must be called before the tick of the entry. For an
// entry `sensorless`, computes the ticks without sensor values.
void replay_entry(const Journal::Entry &entry, FirmwareSide &firmware);

// Repeats the run of the journal in one process, up to the last recorded tick. `experiment` must be
// the experiment of the journal. The plant, the impulses and the failures of the force sensor are
// taken from this experiment. Throws the exceptions of run().
RunResult replay(const Journal &journal, const Experiment &experiment, const RunOptions &options);

}  // namespace forceaxis::host
