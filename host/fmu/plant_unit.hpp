#pragma once
// The plant of a model as a unit: DAC code and enable in, codes of encoder and ADCs and all true
// signals out, parameters of the model as fixed parameters.
#include <cstdint>
#include <memory>
#include <span>

#include "host/fmu/unit.hpp"
#include "sim/model/model.hpp"

namespace forceaxis::fmu {

// `set` has new values of parameters; the parameters of the unit start with them and the seed of
// the noise with `seed`. Throws sim::InputError.
std::unique_ptr<Unit> plant_unit(const std::filesystem::path &model,
                                 std::span<const sim::Override> set, std::int32_t seed);

}  // namespace forceaxis::fmu
