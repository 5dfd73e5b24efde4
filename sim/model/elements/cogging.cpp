#include "sim/model/elements/cogging.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/model/read.hpp"

namespace forceaxis::sim {

void Cogging::complete(Section &section, Names &) {
  const auto &[force, length, segments, start, from, to] = given;
  std::vector<double> period = force;
  if (force.size() == 1) {
    period.clear();
    for (int k = 0; k < segments; ++k)
      period.push_back(force.front() * std::sin(2.0 * std::numbers::pi * k / segments));
  } else if (section.has("segments")) {
    section.fail("segments", "expected no segments beside a list of forces, got both; remove one");
  }
  const double width = length / static_cast<double>(period.size());
  if (!(to > from))
    section.fail("to", "expected a value greater than from, " + number_text(from) + ", got " +
                           number_text(to) + "; exchange or correct the two values");
  constexpr double kMostSegments = 1000.0;
  if ((to - from) / width > kMostSegments)
    section.fail("period", "expected at most 1000 segments between from and to, got " +
                               number_text((to - from) / width) +
                               "; shorten the travel, or give fewer segments");
  // The places of the force values are multiples of the width. They are counted from the start of a
  // period that begins before the travel.
  const auto first = static_cast<long>(std::floor((from - start) / width));
  const auto last = static_cast<long>(std::ceil((to - start) / width));
  const auto count = static_cast<long>(period.size());
  for (long k = first; k <= std::max(last, first + 1); ++k) {
    places.push_back(start + static_cast<double>(k) * width);
    forces.push_back(period[static_cast<std::size_t>(((k % count) + count) % count)]);
  }
  for (std::size_t k = 1; k < places.size(); ++k)
    if (!(places[k] > places[k - 1]))
      section.fail("period", "expected a period that the position resolves, got " +
                                 number_text(length) + "; correct it");
}

}  // namespace forceaxis::sim
