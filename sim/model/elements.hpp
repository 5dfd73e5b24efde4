#pragma once
#include "sim/model/model.hpp"
#include "sim/model/section.hpp"

namespace forceaxis::sim {

/// Reads bodies, links, gravities, drive and sensors from the root table into the model. Keys and
/// rules are described in model.hpp. Throws InputError.
void read_elements(Section &root, Model &model);

}  // namespace forceaxis::sim
