#pragma once
// The firmware of an axis on no bus as a unit: codes of encoder and ADCs in, DAC code and enable
// out, and the objects of its parts axis, law, recorder and drive as variables PART.OBJECT in the
// units of the object table.
#include <cstdint>
#include <memory>
#include <vector>

#include "host/fmu/unit.hpp"
#include "host/run/experiment.hpp"

namespace forceaxis::fmu {

// Powers up a firmware with a DAC of `dac_bits` bits. It has the program of the words `program`, if
// there are any, and makes the writes of the experiment: `initial` at once, `actions` before their
// ticks. Throws sim::InputError.
std::unique_ptr<Unit> firmware_unit(host::Experiment experiment, int dac_bits,
                                    std::vector<std::uint32_t> program);

}  // namespace forceaxis::fmu
