#pragma once
// Elements that exert a force on one body.
#include <string>
#include <vector>

#include "sim/model/elements/ends.hpp"

namespace forceaxis::sim {

inline constexpr KeyFormat kForcedBodyKey =
    format::other("body", "body", "", "The body on which the force acts.");

struct Gravity {
  static constexpr std::string_view kMeaning =
      "A force on one body: its mass times an acceleration.";
  std::string name;
  int body = kGround;  ///< index of a body, not of a port, because the mass of a port is not known

  /// Acceleration in m/s^2 at each of the positions, or one value for all positions.
  std::vector<double> accelerations;
  /// Positions in m in ascending order; empty if the acceleration is constant.
  std::vector<double> positions;

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    return rows_of(
        field(&Gravity::name, kNameKey), field(&Gravity::body, kForcedBodyKey),
        field(&Gravity::accelerations,
              numbers("acceleration", Dimension::acceleration, any, "",
                      "Acceleration, positive towards the workpiece. A list has one value for each "
                      "of `positions`.")),
        field(&Gravity::positions,
              rising(numbers("positions", Dimension::length, any, "none",
                             "Positions of the body in ascending order. The acceleration is "
                             "interpolated between them and constant outside their range."))));
  }
  void complete(Section &section, Names &names);
};

/// An external force on a point, positive towards +x.
struct External {
  static constexpr std::string_view kMeaning =
      "An external force on one body, a table over the time.";
  std::string name;
  int body = kGround;         ///< index of the body or port on which the force acts
  std::vector<double> times;  ///< times in s since tick 0 in ascending order, >= 0, at least two

  /// Force in N at each time. The force is interpolated between the times. It is 0 before the first
  /// time and after the last time.
  std::vector<double> forces;

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    return rows_of(
        field(&External::name, kNameKey), field(&External::body, kForcedBodyKey),
        field(&External::times,
              rising(numbers("times", Dimension::time, not_negative, "",
                             "Times since the start in ascending order, at least two."))),
        field(&External::forces,
              numbers("forces", Dimension::force, any, "",
                      "Force at each of these times, positive towards the workpiece. It is linear "
                      "between them and 0 before the first and after the last.")));
  }
  void complete(Section &section, Names &names);
};

}  // namespace forceaxis::sim
