#pragma once
#include "sim/model/model.hpp"
#include "sim/model/section.hpp"

namespace forceaxis::sim {

/// Reads bodies, links, gravities, drive and sensors (keys and rules: model.hpp) into the model.
/// Throws InputError.
void read_elements(Section &root, Model &model);

}  // namespace forceaxis::sim
