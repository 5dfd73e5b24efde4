#pragma once
#include <optional>
#include <string>

#include "sim/model/elements/ends.hpp"

namespace forceaxis::sim {

/// An encoder that measures the position of a body relative to a reference, for example relative to
/// a moving base.
struct Encoder {
  static constexpr std::string_view kMeaning = "The encoder, whose position the firmware reads.";
  int body = kGround;
  int reference = kGround;
  double scale = 0.0;  ///< encoder counts per metre, not 0

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    using D = Dimension;
    return rows_of(
        field(&Encoder::body,
              other("body", "body", "", "The body whose position the encoder measures.")),
        field(&Encoder::reference, other("reference", "body or ground", "ground",
                                         "The body to which the measured position is relative.")),
        field(&Encoder::scale,
              needed("scale", D::count_per_length, not_zero, "Encoder counts per metre.")));
  }
  void complete(Section &section, Names &names);
};

/// Switches along the travel of the encoder's body. Positions are relative to the encoder's
/// reference. If a position is empty, the model has no such switch. If only one end of the home
/// switch is given, the switch is active up to the end of the travel.
struct Switches {
  static constexpr std::string_view kMeaning =
      "Positions of switches along the travel of the encoder's body. A switch exists only "
      "if its position is given.";
  /// The negative limit switch is active at and below this position in m.
  std::optional<double> limit_neg;
  /// The positive limit switch is active at and above this position in m.
  std::optional<double> limit_pos;
  /// The home switch is active at and above this position in m.
  std::optional<double> home_from;
  /// The home switch is active below this position in m.
  std::optional<double> home_to;
  /// Position of the first index pulse in m.
  std::optional<double> index;
  /// Distance between two index pulses in m, > 0; empty: only one pulse.
  std::optional<double> index_every;

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    using D = Dimension;
    return rows_of(
        field(&Switches::limit_neg,
              optional("limit_neg", D::length, any, "no switch",
                       "Limit switch that is active at this position and below it.")),
        field(&Switches::limit_pos,
              optional(
                  "limit_pos", D::length, any, "no switch",
                  "Limit switch that is active at this position and above it; above limit_neg.")),
        field(&Switches::home_from,
              optional("home_from", D::length, any, "active from the negative end of the travel",
                       "Home switch that is active at this position and above it.")),
        field(&Switches::home_to,
              optional("home_to", D::length, any, "active to the positive end of the travel",
                       "Home switch that is active below this position; above home_from.")),
        field(&Switches::index, optional("index", D::length, any, "no pulse",
                                         "Position at which the encoder gives an index pulse.")),
        field(&Switches::index_every, optional("index_every", D::length, positive, "one pulse",
                                               "Distance between further index pulses, beginning "
                                               "at `index`, which must be given too.")));
  }
  void complete(Section &section, Names &names);
};

}  // namespace forceaxis::sim
