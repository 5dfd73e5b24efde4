#pragma once
// Dimensions of values, spellings of their units, and quantities such as "12 mm/s".
//
// clang-format off
// The spellings of the units of each dimension:
//   1, V/V                          ratio                count                       codes
//   kg                              mass                 m                           length
//   s                               time                 m/s                         velocity
//   N                               force                N s, N*s, kg m/s            impulse
//   J, N m, N*m                     energy
//   N/m                             stiffness            N s/m, N*s/m, kg/s          damping
//   V                               voltage              A                           current
//   ohm                             resistance           H                           inductance
//   V/A                             current sensing      N m/A, N*m/A                torque constant
//   V s/rad, V*s/rad                speed constant       m/rad                       transmission
//   rad/s, 1/s                      rate                 N m s/rad, N*m*s/rad        rotary damping
//   kg m^2, kg*m^2                  inertia              N/V                         drive gain
//   m/s/V, m/(s V)                  speed per volt       count/m                     encoder scale
//   A/V                             amplifier scale      N/A                         motor constant
//   m/s^2                           acceleration         N/s                         rate of a force
//   Hz                              frequency            Hz/s                        sweep
//   V/N                             force gain           V/m                         position gain
//   V s/m, V*s/m                    velocity gain
//   N/count  A/count  V/count  m/count  m/s/count        ADC scale of such a signal
//   m/s^2/count  N/s/count
// clang-format on
//
// The unit of a parameter is one of these spellings. A quantity is a number and one of these units,
// in which each of the symbols m s N J V A ohm H Hz g rad may have one of the prefixes n u m c k M.
// Further symbols are g for 0.001 kg, min for 60 s, and deg and rev for angles: "400 kN/m", "25
// mm/rev". A rate may be given in Hz; 1 Hz is 2 pi rad/s. The conversion of a decimal prefix adds
// no rounding error: "12.3 mm" is the double next to 0.0123.
#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace forceaxis::sim {

/// The physical quantity that a value measures.
enum class Dimension {
  ratio,
  count,
  mass,
  length,
  time,
  velocity,
  force,
  energy,
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
  current_per_volt,
  force_per_current,
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

/// Exponents of the base units kg, m, s, A, count and cycle. Angles have no base unit.
using Powers = std::array<int, 6>;
Powers powers_of(Dimension dimension);

/// Returns the first accepted spelling of the unit of a dimension, such as "N s/m".
std::string_view unit_of(Dimension dimension);
/// Returns the dimension as a phrase, such as "a force in N" or "a number without unit".
std::string phrase_of(Dimension dimension);
/// Returns the dimension of a unit. Returns nothing if the spelling of the unit is not accepted.
std::optional<Dimension> dimension_of(std::string_view unit);
/// Returns all accepted spellings of units.
std::vector<std::string> unit_spellings();

/// Returns true if a text has the form of a quantity: its first character after an optional sign or
/// point is a digit. Names of parameters never have this form.
bool is_quantity(std::string_view text);

/// The number of a quantity without the prefix of the unit, and the text of the unit.
struct QuantityText {
  /// Number before the unit; infinite if the number is too large for a double.
  double number = 0.0;
  std::string_view digits;
  std::string_view unit;
};
QuantityText split_quantity(std::string_view text);

/// The value of a quantity in the SI unit of the dimension. If the text is not valid, `obtained`
/// describes the text for a message, to follow the word "got".
struct QuantityResult {
  std::optional<double> value;
  std::string obtained;
};

/// Reads a text for which is_quantity() returns true. The value can be infinite; its range is not
/// checked.
QuantityResult read_quantity(std::string_view text, Dimension dimension);

}  // namespace forceaxis::sim
