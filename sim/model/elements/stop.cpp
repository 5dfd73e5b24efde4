#include "sim/model/elements/stop.hpp"

#include "sim/model/read.hpp"

namespace forceaxis::sim {

void Stop::complete(Section &section, Names &) {
  if (!low && !high)
    section.fail("low",
                 "expected low or high or both in m, got no such key; add one of these keys");
  if (low && high && !(*low < *high))
    section.fail("high", "expected a value greater than low, " + number_text(*low) + ", got " +
                             number_text(*high) + "; exchange or correct the two values");
}

}  // namespace forceaxis::sim
