#pragma once
// Checks the program of a press cycle. A program that could work with no pressed part is refused.
#include "host/run/cycle_encode.hpp"

namespace forceaxis::host {

/// Throws InputError if no pressed part could pass a phase, a condition or an element, if nothing
/// reaches or ends a phase, or if the axis of `scales` could not do what a phase demands. `code` is
/// the encoded program.
void check_cycle(const CycleProgram &program, const CycleCode &code, const CycleScales &scales,
                 const CyclePlace &place);

}  // namespace forceaxis::host
