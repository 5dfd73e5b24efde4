#pragma once
// The firmware of an axis on no bus as a unit: codes of encoder and ADCs in, DAC code and enable
// out, and the objects of the parts axis, law, recorder and drive of the object table, as variables
// PART.OBJECT in the units of this table. Writable objects are tunable parameters, or inputs if
// they are asked for.
#include <cstdint>
#include <memory>
#include <vector>

#include "host/fmu/unit.hpp"
#include "host/run/experiment.hpp"

namespace forceaxis::fmu {

struct FirmwareFacts {
  host::Experiment experiment;  // experiment whose `initial` values are written at once and whose
                                // `actions` before their ticks
  int dac_bits = 12;
  std::vector<std::uint32_t> program;  // cycle program as 32-bit words (firmware/cycle/program.h);
                                       // empty without a program
  std::vector<std::uint16_t> inputs;   // numbers (AXIS_OBJ_) of the objects that are inputs of the
                                       // unit
};

// Powers up a firmware and makes the initial writes. Throws sim::InputError.
std::unique_ptr<Unit> firmware_unit(FirmwareFacts facts);

}  // namespace forceaxis::fmu
