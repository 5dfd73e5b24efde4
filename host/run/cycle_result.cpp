#include "host/run/cycle_result.hpp"

#include <charconv>
#include <iterator>

#include "host/run/objects.hpp"

extern "C" {
#include "firmware/cycle/cycle.h"
#include "firmware/objects/generated/axis_objects_device.h"
#include "firmware/objects/generated/axis_objects_drive.h"
}

namespace forceaxis::host {
namespace {

// Returns the value rounded to 12 significant digits. The Python package rounds values that it
// reads from an axis in the same way. So 4009 counts of 1 um are 0.004009 m in C++ and in Python.
double rounded(double value) {
  char text[32];
  const auto end = std::to_chars(text, std::end(text), value, std::chars_format::general, 12).ptr;
  std::from_chars(text, end, value);
  return value;
}

}  // namespace

bool cycle_is_done(std::int32_t state) {
  return state == AXIS_CYCLE_STATE_GOOD || state == AXIS_CYCLE_STATE_BAD ||
         state == AXIS_CYCLE_STATE_ABORTED;
}

CycleResult cycle_result_of(const CycleProgram &program, const CycleValues &values) {
  static const char *const kVerdicts[] = {"none",       "good",  "below",       "above",
                                          "wrong side", "again", "not reached", "aborted"};
  static_assert(std::size(kVerdicts) == AXIS_CYCLE_RESULT_VERDICT_COUNT);
  CycleResult result;
  result.title = program.title;
  result.phases = program.phase_names();
  result.state = enum_text(AXIS_OBJ_CYCLE_STATE, values.state);
  result.outcome = enum_text(AXIS_OBJ_CYCLE_OUTCOME, values.outcome);
  result.cycles = values.cycles;
  result.invalid_ticks = values.invalid_ticks;
  if (values.failed_phase && values.outcome != AXIS_CYCLE_OUTCOME_BY_PROGRAM)
    result.failed_phase = program.phases.at(*values.failed_phase).name;
  for (std::size_t i = 0; i < values.elements.size(); ++i) {
    const CycleValues::Element &found = values.elements[i];
    const CycleElement &element = program.elements.at(i);
    result.figures.push_back({element.name, std::string(element.kind),
                              rounded(found.value * element.per_value), std::string(element.unit()),
                              found.tick, kVerdicts[found.verdict]});
  }
  return result;
}

}  // namespace forceaxis::host
