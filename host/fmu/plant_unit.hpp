#pragma once
// The plant of a model as a co-simulation unit. The inputs are dac_code, amp_enable and
// brake_release. The outputs are the codes of encoder and ADCs, and all true signals. The
// parameters of the model are fixed parameters of the unit.
#include <cstdint>
#include <memory>
#include <span>

#include "host/fmu/unit.hpp"
#include "sim/model/model.hpp"

namespace forceaxis::fmu {

// Creates the unit. `set` has new values for parameters of the model; they are start values of the
// unit. `seed` is the start value of the noise seed. Throws sim::InputError.
std::unique_ptr<Unit> plant_unit(const std::filesystem::path &model,
                                 std::span<const sim::Override> set, std::int32_t seed);

}  // namespace forceaxis::fmu
