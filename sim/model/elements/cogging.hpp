#pragma once
#include <vector>

#include "sim/model/elements/ends.hpp"

namespace forceaxis::sim {

/// A force that is a periodic function of the position. It acts backwards on end a and forwards on
/// end b.
struct Cogging : Link {
  static constexpr std::string_view kMeaning =
      "A force that repeats over the position, such as the cogging of a linear motor or a screw. "
      "It is linear between its values, acts backwards on a and forwards on b, and stores energy.";
  /// Deflections x_a - x_b in m in ascending order, at least two.
  std::vector<double> places;
  /// Force in N at each place. It is interpolated between places and constant outside their range.
  std::vector<double> forces;
  /// Values of the model file: the forces of one period, or the amplitude of a sine with segments.
  struct Given {
    std::vector<double> force;
    double period = 0.0;
    int segments = 0;
    double position = 0.0;
    double from = 0.0;
    double to = 0.0;
  };
  Given given;

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    return rows_of(
        Link::rows(),
        field(&Cogging::given, &Given::force,
              numbers("force", Dimension::force, any, "",
                      "Amplitude of a sine over the position, whose rest is at `position`. A list "
                      "of at least two values has the forces at equal distances over one "
                      "period.")),
        field(&Cogging::given, &Given::period,
              needed("period", Dimension::length, positive,
                     "Distance after which the force repeats.")),
        field(&Cogging::given, &Given::segments,
              integer("segments", 4, 64, 16.0,
                      "Straight segments in a period of a sine, which they meet at their ends. "
                      "Between them they are less than the sine, at most by 1 - cos(pi / segments) "
                      "of the amplitude: 7.6 % with 8, 1.9 % with 16, 0.5 % with 32.")),
        field(&Cogging::given, &Given::position,
              number("position", Dimension::length, any, 0.0,
                     "Value of x_a - x_b at which a period begins.")),
        field(&Cogging::given, &Given::from,
              needed("from", Dimension::length, any,
                     "Value of x_a - x_b at which the travel begins. The force is constant before "
                     "the last value outside the travel.")),
        field(&Cogging::given, &Given::to,
              needed("to", Dimension::length, any,
                     "Value of x_a - x_b at which the travel ends; greater than `from`. The travel "
                     "has at most 1000 segments.")));
  }
  /// Derives `places` and `forces` from the values of the model file.
  void complete(Section &section, Names &names);
};

}  // namespace forceaxis::sim
