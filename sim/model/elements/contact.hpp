#pragma once
#include "sim/model/elements/slopes.hpp"

namespace forceaxis::sim {

/// A spring in series with a dry slider (Jenkins element). Both are parallel to the stiffness k of
/// a contact. The deflection e of the spring is a state. While the contact is pressed and
/// |stiffness e| < force, e' = d'. At the bound |stiffness e| = force, the slider slips, and e' = 0
/// until d' changes its sign. While the contact is open, e' = 0, and the surface of the contact is
/// where the force k d + stiffness e is 0.
struct Hysteresis {
  double stiffness = 0.0;  ///< stiffness of the spring in N/m, > 0
  double force = 0.0;      ///< slip force in N, > 0

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    return rows_of(
        field(&Hysteresis::stiffness,
              optional("hysteresis_stiffness", Dimension::stiffness, positive, "none",
                       "Stiffness of a further spring in series with a dry slider, beside the "
                       "stiffness. A closed cycle of the overlap with the amplitude D loses 4 "
                       "hysteresis_force * (D - hysteresis_force / hysteresis_stiffness) if D is "
                       "larger than this quotient.")),
        field(&Hysteresis::force,
              needed_beside("hysteresis_stiffness",
                            optional("hysteresis_force", Dimension::force, positive,
                                     "hysteresis_stiffness must be omitted too",
                                     "Force of that spring at which the slider slips."))));
  }
};

struct Contact : Link {
  static constexpr std::string_view kMeaning =
      "A contact that can be lost. Its overlap is d = x_a - x_b - gap and its force is "
      "stiffness * d + damping * d' while both are > 0; otherwise the force is 0. The surface of a "
      "contact with maxwell_stiffness recovers after a loss, and is met where it then is. The "
      "surface of a contact with hysteresis_stiffness keeps the dent of its last loss, where its "
      "force was 0, and is met there. A contact with one of these keys has one stiffness and no "
      "damping. Linear figures of a contact with hysteresis are those of small motions about a "
      "point at which the slider sticks, with the stiffness stiffness + hysteresis_stiffness and "
      "without its losses.";
  Slopes stiffness;  ///< contact stiffness in N/m, > 0, over the overlap of the bodies in m; all
                     ///< breakpoints are > 0
  double damping = 0.0;  ///< contact damping in N s/m, >= 0

  /// Distance of the surfaces in m at x_a = x_b; the overlap is d = x_a - x_b - gap.
  double gap = 0.0;
  /// Standard linear solid in parallel with the stiffness. Permitted only with one stiffness and no
  /// damping.
  std::optional<Maxwell> maxwell = std::nullopt;
  /// Hysteresis of the contact. Permitted only with one stiffness, no damping and no `maxwell`.
  std::optional<Hysteresis> hysteresis = std::nullopt;

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    return rows_of(
        Link::rows(),
        field(&Contact::stiffness, &Slopes::slopes,
              numbers("stiffness", Dimension::stiffness, positive, "",
                      "Stiffness of the contact. A list makes it a curve of force over overlap, "
                      "with stiffness k between breaks[k-1] and breaks[k]. With segments of the "
                      "width h that meet a Hertz contact F = c d^1.5 at their ends, the force is "
                      "at most 0.148 c h^1.5 more.")),
        field(&Contact::stiffness, &Slopes::loads,
              rising(numbers("loads", Dimension::force, positive, "none",
                             "Forces at which the stiffness changes, in ascending order, in place "
                             "of `breaks`."))),
        field(&Contact::stiffness, &Slopes::breaks,
              rising(numbers("breaks", Dimension::length, positive, "none",
                             "Overlaps at which the stiffness changes, in ascending order, one "
                             "value fewer than stiffnesses."))),
        field(&Contact::damping, kDampingKey), part(&Contact::maxwell), part(&Contact::hysteresis),
        field(&Contact::gap,
              number("gap", Dimension::length, any, 0.0,
                     "Distance of the two surfaces at x_a = x_b. A negative value is an "
                     "overlap.")));
  }
  void complete(Section &section, Names &names);
};

}  // namespace forceaxis::sim
