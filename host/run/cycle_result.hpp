#pragma once
// The result of a cycle with the names and SI units of its program. The firmware that ran the cycle
// may be in another process or on a chip.
#include <cstdint>
#include <optional>
#include <vector>

#include "host/run/cycle_file.hpp"
#include "host/run/result.hpp"

namespace forceaxis::host {

// What the firmware says of its last cycle, as raw values of objects.
struct CycleValues {
  std::int32_t state;    // cycle_state
  std::int32_t outcome;  // cycle_outcome
  std::int64_t cycles;   // cycle_count
  // Number of the phase in which a limit was exceeded first, or the cycle was stopped. It has a
  // meaning only if the outcome is not by_program.
  std::optional<std::uint8_t> failed_phase;
  std::int64_t invalid_ticks = 0;  // cycle_result_invalid
  struct Element {
    std::int32_t value;    // cycle_result_value
    std::int32_t verdict;  // cycle_result_verdict
    std::uint32_t tick;    // cycle_result_tick
  };
  std::vector<Element> elements;  // results of the evaluation elements in the order of the program;
                                  // empty before the end of a cycle
};

// Returns true if the cycle has ended and was evaluated, by its cycle_state.
bool cycle_is_done(std::int32_t state);

// Returns the result of the last cycle, which `program` described.
CycleResult cycle_result_of(const CycleProgram &program, const CycleValues &values);

}  // namespace forceaxis::host
