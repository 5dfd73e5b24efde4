#pragma once
// The result of a press cycle with the names and SI units of its program. The firmware that ran the
// cycle may be in another process or on a chip.
#include <cstdint>
#include <optional>
#include <vector>

#include "host/run/cycle_file.hpp"
#include "host/run/result.hpp"

namespace forceaxis::host {

// The result of the firmware's last press cycle, as raw values of objects.
struct CycleValues {
  std::int32_t state;    // value of the object cycle_state
  std::int32_t outcome;  // value of the object cycle_outcome
  std::int64_t cycles;   // value of the object cycle_count

  // Number of the phase in which a limit was exceeded first, or the cycle was stopped. It has a
  // meaning only if the outcome is not by_program.
  std::optional<std::uint8_t> failed_phase;
  std::int64_t invalid_ticks = 0;  // value of the object cycle_result_invalid
  struct Element {
    std::int32_t value;    // value of the object cycle_result_value
    std::int32_t verdict;  // value of the object cycle_result_verdict
    std::uint32_t tick;    // value of the object cycle_result_tick
  };
  std::vector<Element> elements;  // results of the evaluation elements in the order of the program;
                                  // empty before the end of a cycle
};

// Returns true if `state`, a value of cycle_state, means that the cycle has ended and was
// evaluated.
bool cycle_is_done(std::int32_t state);

// Returns the result of the last cycle. `program` is the program of this cycle.
CycleResult cycle_result_of(const CycleProgram &program, const CycleValues &values);

}  // namespace forceaxis::host
