#include "sim/model/elements/friction.hpp"

#include "sim/model/read.hpp"

namespace forceaxis::sim {

void Friction::complete(Section &section, Names &) {
  if (!section.has("stiction")) stiction = coulomb;
  if (stiction < coulomb)
    section.fail("stiction", "expected at least coulomb, " + number_text(coulomb) + ", got " +
                                 number_text(stiction) +
                                 "; the breakaway force is not less than the sliding force");
}

}  // namespace forceaxis::sim
