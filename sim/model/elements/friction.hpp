#pragma once
#include "sim/model/elements/ends.hpp"

namespace forceaxis::sim {

struct Friction : Link {
  static constexpr std::string_view kMeaning =
      "Dry friction. It opposes sliding. At standstill it sticks while the force that this "
      "needs is at most `stiction`. Frictions must not form a loop.";
  double coulomb = 0.0;   ///< friction force in N while the ends slide, >= 0
  double stiction = 0.0;  ///< largest friction force in N while the ends stick, at least `coulomb`

  static constexpr auto rows() {
    using namespace format;
    return rows_of(
        Link::rows(),
        field(&Friction::coulomb, needed("coulomb", Dimension::force, Sign::not_negative,
                                         "Friction force while the ends slide.")),
        field(&Friction::stiction,
              optional("stiction", Dimension::force, Sign::not_negative, "coulomb",
                       "Breakaway force, at which sliding begins; at least `coulomb`.")));
  }
  void complete(Section &section, Names &names);
};

/// A brake. The brake is engaged at tick 0. An engaged brake acts as a friction with the force
/// `holding`.
struct Brake : Link {
  static constexpr std::string_view kMeaning =
      "A brake that the firmware's output brake_release releases. It is engaged at the "
      "start. An engaged brake acts as dry friction, a released brake has no force. A "
      "friction between the same ends acts in addition.";
  double holding = 0.0;    ///< friction force of the engaged brake in N, > 0
  double release_s = 0.0;  ///< time in s that the brake needs to release, >= 0
  double engage_s = 0.0;   ///< time in s that the brake needs to engage, >= 0

  static constexpr auto rows() {
    using namespace format;
    return rows_of(
        Link::rows(),
        field(&Brake::holding,
              needed("holding", Dimension::force, Sign::positive,
                     "Friction force of the engaged brake while it sticks and while it slides.")),
        field(&Brake::release_s,
              number("release", Dimension::time, Sign::not_negative, 0.0,
                     "Delay from the firmware's output brake_release to the release of the "
                     "brake.")),
        field(&Brake::engage_s,
              number("engage", Dimension::time, Sign::not_negative, 0.0,
                     "Delay from the end of the output brake_release to the engaged brake.")));
  }
};

}  // namespace forceaxis::sim
