#pragma once
// Converts the program of a press cycle from the SI units and names of its file to the numbers of
// the firmware.
#include <cstdint>
#include <vector>

#include "host/run/cycle_file.hpp"
#include "host/run/cycle_scales.hpp"

extern "C" {
#include "firmware/cycle/program.h"
}

namespace forceaxis::host {

/// The program of a press cycle in the form that the firmware uses (firmware/cycle/program.h).
/// Phases, conditions and elements have the same order as in the file.
struct CycleCode {
  cycle_header_t header{};
  std::vector<cycle_phase_t> phases;
  std::vector<cycle_element_t> elements;
  std::vector<cycle_point_t> points;

  /// Returns the record of the program, with its size and CRC. Throws InputError if the record is
  /// too large.
  std::vector<std::uint32_t> record(const CyclePlace &place) const;
};

/// Returns a program in the units of an axis. Throws InputError for a number that the record cannot
/// have, and for a name that no phase has.
CycleCode encode_cycle(const CycleProgram &program, const CycleScales &scales,
                       const CyclePlace &place);

}  // namespace forceaxis::host
