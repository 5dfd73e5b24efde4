#pragma once
#include "sim/hybrid/wiring.hpp"
#include "sim/model/model.hpp"

namespace forceaxis::sim {

/// The wires, switches and states of every element of a model. Throws InputError if its switches do
/// not fit into a ModeKey.
Wiring assemble(const Model &model);

}  // namespace forceaxis::sim
