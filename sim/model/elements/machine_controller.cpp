#include "sim/model/elements/machine_controller.hpp"

#include "sim/model/read.hpp"

namespace forceaxis::sim {

void MachineTable::complete(Section &section, Names &) {
  one_of(section, "speeds", "forces", "the commands of the table");
  const bool of_force = speeds.empty();
  const char *key = of_force ? "forces" : "speeds";
  values = of_force ? forces : speeds;
  if (times.size() < 2)
    section.fail("times", "expected at least two times, got " + std::to_string(times.size()) +
                              "; add times");
  if (values.size() != times.size())
    section.fail(key, "expected " + std::to_string(times.size()) +
                          " values, one for each of the times, got " +
                          std::to_string(values.size()) + "; add or remove values");
}

void MachineForce::complete(Section &section, Names &names) {
  if (names.signal != Dimension::force)
    section.fail("signal", "expected a force in N, got " + in_quotes(signal) +
                               "; name the force that the controller measures");
}

}  // namespace forceaxis::sim
