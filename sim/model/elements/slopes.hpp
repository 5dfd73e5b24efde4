#pragma once
#include <optional>
#include <vector>

#include "sim/model/elements/ends.hpp"

namespace forceaxis::sim {

/// A continuous piecewise-linear curve through the origin, with slopes[k] between breaks[k-1] and
/// breaks[k]. A curve with one slope and no break is a straight line.
struct Slopes {
  std::vector<double> slopes;
  std::vector<double> breaks;  ///< inputs at which the slope changes, in ascending order

  /// Outputs at which the slope changes, if the model file has loads in place of breaks.
  std::vector<double> loads = {};

  /// Derives the breaks from the loads. `key` is the key of the slopes in the model file.
  void complete(Section &section, const char *key);
};

/// A spring in series with a dashpot. Both are parallel to the stiffness k of an element, which is
/// then a standard linear solid (Zener model). The extension w of the dashpot is a state:
///   w' = (s - w) / time,    force k s + stiffness (s - w) at the deflection s
/// The surface of a contact without force recovers: s = stiffness w / (k + stiffness).
struct Maxwell {
  double stiffness = 0.0;  ///< stiffness of the spring in N/m, > 0
  double time = 0.0;  ///< time constant in s, > 0: damping of the dashpot divided by `stiffness`

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    return rows_of(
        field(&Maxwell::stiffness,
              optional("maxwell_stiffness", Dimension::stiffness, positive, "none",
                       "Stiffness of a further spring in series with a dashpot, beside the "
                       "stiffness: the force of a held deflection relaxes by the share of this "
                       "spring (standard linear solid).")),
        field(&Maxwell::time,
              needed_beside("maxwell_stiffness",
                            optional("maxwell_time", Dimension::time, positive,
                                     "maxwell_stiffness must be omitted too",
                                     "Time in which that force relaxes to 1/e: the damping of the "
                                     "dashpot divided by maxwell_stiffness."))));
  }
};

}  // namespace forceaxis::sim
