#pragma once
#include "sim/model/model.hpp"
#include "sim/model/section.hpp"

namespace forceaxis::sim {

/// Reads bodies, elements, drive and sensors from the root table of a model file into `model`.
/// model.hpp describes the keys and rules. Throws InputError.
void read_elements(Section &root, Model &model);

}  // namespace forceaxis::sim
