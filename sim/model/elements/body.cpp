#include "sim/model/elements/body.hpp"

#include "sim/model/read.hpp"

namespace forceaxis::sim {

void Body::complete(Section &section, Names &) {
  if (!section.has("inertia"))
    // Without the key inertia, the key mass is required.
    (void)section.value("mass", Dimension::mass, Sign::positive);
  if (inertia.size() != r_trans.size())
    section.fail("r_trans", "expected " + std::to_string(inertia.size()) +
                                " values, one for each inertia, got " +
                                std::to_string(r_trans.size()) + "; add or remove values");
  for (std::size_t i = 0; i < inertia.size(); ++i) mass += inertia[i] / (r_trans[i] * r_trans[i]);
}

}  // namespace forceaxis::sim
