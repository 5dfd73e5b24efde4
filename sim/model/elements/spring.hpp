#pragma once
#include "sim/model/elements/slopes.hpp"

namespace forceaxis::sim {

struct Spring : Link {
  static constexpr std::string_view kMeaning =
      "A spring with damping. For d = x_a - x_b, the force stiffness * d + damping * d' "
      "acts backwards on a and forwards on b.";
  Slopes stiffness;      ///< stiffness in N/m, >= 0, as a function of the deflection in m
  double damping = 0.0;  ///< damping in N s/m, >= 0; does not depend on the velocity

  /// Spring and dashpot in parallel with the stiffness.
  std::optional<Maxwell> maxwell = std::nullopt;

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    return rows_of(
        Link::rows(),
        field(&Spring::stiffness, &Slopes::slopes,
              numbers("stiffness", Dimension::stiffness, not_negative, "",
                      "Stiffness. A list makes the spring piecewise linear, with stiffness k "
                      "between breaks[k-1] and breaks[k].")),
        field(&Spring::stiffness, &Slopes::loads,
              rising(numbers("loads", Dimension::force, any, "none",
                             "Forces at which the stiffness changes, in ascending order, in place "
                             "of `breaks`. The list has one value fewer than the list of "
                             "stiffnesses, which must then be > 0."))),
        field(&Spring::stiffness, &Slopes::breaks,
              rising(numbers("breaks", Dimension::length, any, "none",
                             "Deflections at which the stiffness changes, in ascending order, one "
                             "value fewer than stiffnesses."))),
        field(&Spring::damping, kDampingKey), part(&Spring::maxwell));
  }
  void complete(Section &section, Names &) { stiffness.complete(section, "stiffness"); }
};

struct Damper : Link {
  static constexpr std::string_view kMeaning = "A damper without stiffness.";
  Slopes damping;  ///< damping in N s/m, >= 0, as a function of the velocity in m/s

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    return rows_of(
        Link::rows(),
        field(&Damper::damping, &Slopes::slopes,
              numbers("damping", Dimension::damping, not_negative, "",
                      "Damping. A list makes the damper a piecewise-linear function of the "
                      "velocity.")),
        field(&Damper::damping, &Slopes::breaks,
              rising(numbers("breaks", Dimension::velocity, any, "none",
                             "Velocities at which the damping changes, in ascending order, one "
                             "value fewer than dampings."))));
  }
  void complete(Section &section, Names &) { damping.complete(section, "damping"); }
};

}  // namespace forceaxis::sim
