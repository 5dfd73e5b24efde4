#include "sim/model/elements/slopes.hpp"

#include <algorithm>
#include <limits>

#include "sim/model/read.hpp"

namespace forceaxis::sim {

namespace {

// Returns the deflection at a load: the sum of the deflections of all segments between the force 0
// and this load.
double deflection_at(const Slopes &curve, double load) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const double low = std::min(load, 0.0);
  const double high = std::max(load, 0.0);
  double way = 0.0;
  for (std::size_t k = 0; k < curve.slopes.size(); ++k) {
    const double from = std::max(low, k == 0 ? -kInfinity : curve.loads[k - 1]);
    const double to = std::min(high, k == curve.loads.size() ? kInfinity : curve.loads[k]);
    if (to > from) way += (to - from) / curve.slopes[k];
  }
  return load < 0.0 ? -way : way;
}

}  // namespace

void Slopes::complete(Section &section, const char *key) {
  const bool loadable = std::string_view(key) == "stiffness";
  const bool by_load = !loads.empty();
  if (by_load && !breaks.empty())
    section.fail("loads", "expected breaks or loads, got both keys; remove one key");
  const std::size_t count = by_load ? loads.size() : breaks.size();
  if (count + 1 != slopes.size())
    section.fail(by_load      ? "loads"
                 : count == 0 ? key
                              : "breaks",
                 "expected one value fewer in " +
                     std::string(loadable ? "breaks or loads" : "breaks") + " than in " + key +
                     ", got " + std::to_string(count) + " and " + std::to_string(slopes.size()) +
                     "; add or remove values");
  if (!by_load) return;
  for (const double slope : slopes)
    if (!(slope > 0.0))
      section.fail(key, "expected values > 0 beside loads, got " + number_text(slope) +
                            "; a spring without stiffness cannot carry a load");
  for (const double load : loads) breaks.push_back(deflection_at(*this, load));
}

}  // namespace forceaxis::sim
