#pragma once
#include "sim/hybrid/wiring.hpp"
#include "sim/model/model.hpp"

namespace forceaxis::sim {

/// Builds the wires, switches and states of every element of a model. Throws InputError if the
/// states of the switches need more bits than a ModeKey has.
Wiring assemble(const Model &model);

}  // namespace forceaxis::sim
