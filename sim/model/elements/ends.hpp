#pragma once
// Members that elements have in common: a name and, for most elements, two ends.
#include <string>

#include "sim/model/field.hpp"

namespace forceaxis::sim {

class Section;
struct Names;

inline constexpr int kGround = -1;  ///< index of an end that is at the ground, not at a point

/// The two ends of an element. Each end is the index of a point (Model::point_names), or kGround.
struct Ends {
  int a = kGround;
  int b = kGround;
};

inline constexpr KeyFormat kNameKey =
    format::name_of("element", "Name; no other element of the model may have it.");
inline constexpr KeyFormat kDampingKey =
    format::number("damping", Dimension::damping, Sign::not_negative, 0.0,
                   "Viscous damping, parallel to the stiffness.");

/// An element of the model that has two ends.
struct Link {
  std::string name;
  Ends ends;

  static constexpr auto rows() {
    return rows_of(field(&Link::name, kNameKey),
                   field(&Link::ends, format::other("between", "two names", "",
                                                    "The bodies a and b at its ends. One of them "
                                                    "may be \"ground\".")));
  }
};

}  // namespace forceaxis::sim
