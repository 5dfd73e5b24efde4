#include "sim/model/elements/contact.hpp"

#include "sim/model/read.hpp"

namespace forceaxis::sim {

void Contact::complete(Section &section, Names &) {
  stiffness.complete(section, "stiffness");
  const bool linear = damping == 0.0 && stiffness.slopes.size() == 1;
  if (hysteresis && (!linear || maxwell))
    section.fail("hysteresis_stiffness",
                 "expected one stiffness, no damping and no maxwell_stiffness beside "
                 "hysteresis_stiffness, got more; remove the other keys");
  if (maxwell && !linear)
    section.fail("maxwell_stiffness",
                 "expected one stiffness and no damping beside maxwell_stiffness, got more; "
                 "remove the damping or the further segments");
}

}  // namespace forceaxis::sim
