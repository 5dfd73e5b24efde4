#pragma once
// Units: dimensions of values, spellings of their units, and quantities such as "12 mm/s".
//
// clang-format off
// The spellings, by what they measure (each entry: spellings of one dimension):
//   1, V/V                          ratio                count                       codes
//   kg                              mass                 m                           length
//   s                               time                 m/s                         velocity
//   N                               force                N s, N*s, kg m/s            impulse
//   N/m                             stiffness            N s/m, N*s/m, kg/s          damping
//   V                               voltage              A                           current
//   ohm                             resistance           H                           inductance
//   V/A                             current sensing      N m/A, N*m/A                torque constant
//   V s/rad, V*s/rad                speed constant       m/rad                       transmission
//   rad/s, 1/s                      rate                 N m s/rad, N*m*s/rad        rotary damping
//   kg m^2, kg*m^2                  inertia              N/V                         drive gain
//   m/s/V, m/(s V)                  speed per volt       count/m                     encoder scale
//   m/s^2                           acceleration         N/s                         rate of a force
//   Hz                              frequency            Hz/s                        sweep
//   V/N                             force gain           V/m                         position gain
//   V s/m, V*s/m                    velocity gain
//   N/count  A/count  V/count  m/count  m/s/count        ADC scale of such a signal
//   m/s^2/count  N/s/count
// clang-format on
//
// A parameter's unit is one of these. A quantity is a number and one of these in which each symbol
// may have a prefix, n u m c k M on N m s V A ohm H Hz g rad; besides, g is 0.001 kg, min 60 s, deg
// and rev are angles in place of rad: "400 kN/m", "25 mm/rev". A rate may be given in Hz, each 2 pi
// rad/s. Decimal prefixes are exact: "12.3 mm" is the double next to 0.0123.
#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace forceaxis::sim {

/// What a value measures.
enum class Dimension {
  ratio,
  count,
  mass,
  length,
  time,
  velocity,
  force,
  impulse,
  stiffness,
  damping,
  voltage,
  current,
  resistance,
  inductance,
  volt_per_amp,
  torque_constant,
  speed_constant,
  transmission,
  rate,
  rotary_damping,
  inertia,
  force_per_volt,
  velocity_per_volt,
  count_per_length,
  acceleration,
  force_rate,
  frequency,
  sweep,
  volt_per_force,
  volt_per_length,
  volt_per_velocity,
  force_per_count,
  current_per_count,
  voltage_per_count,
  length_per_count,
  velocity_per_count,
  acceleration_per_count,
  force_rate_per_count,
};

/// Powers of kg, m, s, A, count and the cycle of a frequency; an angle is a number.
using Powers = std::array<int, 6>;
Powers powers_of(Dimension dimension);

/// The first of the accepted spellings, e.g. "N s/m".
std::string_view unit_of(Dimension dimension);
/// "a force in N"; of a ratio "a number without unit".
std::string phrase_of(Dimension dimension);
/// The dimension of a spelling, or nothing if it is not in the list.
std::optional<Dimension> dimension_of(std::string_view unit);
/// Every accepted spelling.
std::vector<std::string> unit_spellings();

/// Whether a text is meant as a quantity: it begins with a digit, after a sign or point if any.
/// A parameter's name never does.
bool is_quantity(std::string_view text);

/// A quantity's number, without the unit's prefix, and the text of its unit.
struct QuantityText {
  double number = 0.0;  ///< infinite if there is no such double
  std::string_view digits;
  std::string_view unit;
};
QuantityText split_quantity(std::string_view text);

/// A quantity in the first spelling's unit, or else a description of the text to follow "got ".
struct QuantityResult {
  std::optional<double> value;
  std::string obtained;
};

/// Reads a text for which is_quantity() holds. The value may be beyond any range, or infinite.
QuantityResult read_quantity(std::string_view text, Dimension dimension);

}  // namespace forceaxis::sim
