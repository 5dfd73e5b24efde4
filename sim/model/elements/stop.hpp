#pragma once
#include <optional>

#include "sim/model/elements/ends.hpp"

namespace forceaxis::sim {

/// A backlash or a pair of limit stops. There is no force while low < d < high. Outside this range,
/// the stop acts as a contact.
struct Stop : Link {
  static constexpr std::string_view kMeaning =
      "End stops. They have no force while low < x_a - x_b < high. At least one of `low` "
      "and `high` must be given.";
  double stiffness = 0.0;  ///< contact stiffness in N/m, > 0
  double damping = 0.0;    ///< contact damping in N s/m, >= 0

  /// Deflection at the lower stop in m; empty: no lower stop. At least one of `low` and `high` is
  /// given.
  std::optional<double> low;
  std::optional<double> high;  ///< deflection at the upper stop in m, >= low; empty: no upper stop

  static constexpr auto touching() {
    return rows_of(
        Link::rows(),
        field(&Stop::stiffness, format::needed("stiffness", Dimension::stiffness, Sign::positive,
                                               "Stiffness of the contact.")),
        field(&Stop::damping, kDampingKey));
  }
  static constexpr auto rows() {
    using namespace format;
    return rows_of(
        touching(),
        field(&Stop::low, optional("low", Dimension::length, Sign::any, "no stop at this end",
                                   "Value of x_a - x_b below which the stop is in contact.")),
        field(&Stop::high, optional("high", Dimension::length, Sign::any, "no stop at this end",
                                    "Value of x_a - x_b above which the stop is in contact; "
                                    "greater than `low`.")));
  }
  void complete(Section &section, Names &names);
};

/// A backlash: two stops at the deflections -width/2 and +width/2.
struct Backlash : Stop {
  static constexpr std::string_view kMeaning = "A backlash between two bodies.";
  double width = 0.0;  ///< free travel in m, >= 0

  static constexpr auto rows() {
    return rows_of(touching(),
                   field(&Backlash::width,
                         format::needed("width", Dimension::length, Sign::not_negative,
                                        "Free travel. The ends are in contact below -width/2 and "
                                        "above +width/2.")));
  }
  void complete(Section &, Names &) {
    low = -0.5 * width;
    high = 0.5 * width;
  }
};

}  // namespace forceaxis::sim
