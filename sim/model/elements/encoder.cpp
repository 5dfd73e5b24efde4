#include "sim/model/elements/encoder.hpp"

#include "sim/model/read.hpp"

namespace forceaxis::sim {

void Encoder::complete(Section &section, Names &) {
  if (body == reference)
    section.fail("reference",
                 "expected another body than encoder.body or ground, got the same; "
                 "choose the body to which the position is relative");
}

void Switches::complete(Section &section, Names &) {
  const auto in_order = [&](const std::optional<double> &low, const std::optional<double> &high,
                            const char *low_key, const char *high_key) {
    if (low && high && *low >= *high)
      section.fail(high_key, std::string("expected a position beyond ") + low_key + " = " +
                                 number_text(*low) + " m, got " + number_text(*high) +
                                 "; exchange or correct the two positions");
  };
  in_order(limit_neg, limit_pos, "limit_neg", "limit_pos");
  in_order(home_from, home_to, "home_from", "home_to");
  if (index_every && !index)
    section.fail(
        "index_every",
        "expected the position of one index pulse too, got no index; add index, such as 0");
}

}  // namespace forceaxis::sim
