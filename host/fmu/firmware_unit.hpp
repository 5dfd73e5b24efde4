#pragma once
// The firmware of an axis without a bus as a co-simulation unit. The inputs are the codes of
// encoder and ADCs. The outputs are dac_code, amp_enable and brake_release. The objects of the
// parts axis, law, recorder and drive of the object table are variables PART.OBJECT, in the units
// of this table. Writable objects are tunable parameters, or inputs if the user requests this.
#include <cstdint>
#include <memory>
#include <vector>

#include "host/fmu/unit.hpp"
#include "host/run/experiment.hpp"

namespace forceaxis::fmu {

struct FirmwareFacts {
  // Experiment of the unit. Its `initial` values are written at power-up. Each of its `actions` is
  // written before the tick of this action.
  host::Experiment experiment;
  int dac_bits = 12;
  std::vector<std::uint32_t> program;  // cycle program as 32-bit words (firmware/cycle/program.h);
                                       // empty without a program
  std::vector<std::uint16_t> inputs;   // numbers (AXIS_OBJ_) of the objects that are inputs of the
                                       // unit
};

// Powers up a firmware and writes its initial values. Throws sim::InputError.
std::unique_ptr<Unit> firmware_unit(FirmwareFacts facts);

}  // namespace forceaxis::fmu
