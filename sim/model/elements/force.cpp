#include "sim/model/elements/force.hpp"

#include "sim/model/read.hpp"

namespace forceaxis::sim {

void Gravity::complete(Section &section, Names &names) {
  if (static_cast<std::size_t>(body) >= names.bodies)
    section.fail("body", "expected a body, got the port " +
                             in_quotes(names.points[static_cast<std::size_t>(body)]) +
                             ", whose mass is not known; give the weight of the structure as an "
                             "[[external]] force");
  const std::size_t wanted = accelerations.size() == 1 ? 0 : accelerations.size();
  if (positions.size() != wanted)
    section.fail("positions", "expected " + std::to_string(wanted) +
                                  " values, one for each of a list in acceleration, got " +
                                  std::to_string(positions.size()) + "; add or remove values");
}

void External::complete(Section &section, Names &) {
  if (times.size() < 2)
    section.fail("times", "expected at least two times, got " + std::to_string(times.size()) +
                              "; add the begin and the end of the force");
  if (forces.size() != times.size())
    section.fail("forces", "expected " + std::to_string(times.size()) +
                               " values, one for each of times, got " +
                               std::to_string(forces.size()) + "; add or remove values");
}

}  // namespace forceaxis::sim
