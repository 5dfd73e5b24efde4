#pragma once
#include <string>
#include <vector>

#include "sim/model/elements/ends.hpp"

namespace forceaxis::sim {

struct Body {
  static constexpr std::string_view kMeaning =
      "A rigid body that moves along the axis. A model has 1 to 32 bodies; other elements "
      "or the drive must connect each of them to ground.";
  std::string name;
  double mass = 0.0;      ///< mass in kg, > 0; it includes the inertias that turn with the body
  double position = 0.0;  ///< position in m at tick 0
  double velocity = 0.0;  ///< velocity in m/s at tick 0

  /// Moments of inertia in kg m^2 of the parts that turn with the body.
  std::vector<double> inertia;
  std::vector<double> r_trans;  ///< travel of the body in m per radian of each inertia

  static constexpr auto rows() {
    using enum Dimension;
    using enum Sign;
    using namespace format;
    return rows_of(
        field(&Body::name, kNameKey),
        field(&Body::mass,
              optional("mass", Dimension::mass, positive, "inertia must be given", "Mass.")),
        field(&Body::inertia,
              numbers("inertia", Dimension::inertia, positive, "none",
                      "Inertia of what turns with the body, such as a rotor: it adds inertia / "
                      "r_trans^2 to the mass. A list has one value for each of `r_trans`.")),
        field(&Body::r_trans,
              needed_beside(
                  "inertia",
                  numbers("r_trans", transmission, positive, "inertia must be omitted too",
                          "Travel of the body for one radian of the inertia: a screw lead such as "
                          "\"10 mm/rev\", the radius of a pulley, or this divided by the ratio of "
                          "a gear."))),
        field(&Body::position, number("position", length, any, 0.0, "Position at the start.")),
        field(&Body::velocity,
              number("velocity", Dimension::velocity, any, 0.0, "Velocity at the start.")));
  }
  /// Adds the equivalent mass of the inertias to `mass`.
  void complete(Section &section, Names &names);
};

}  // namespace forceaxis::sim
