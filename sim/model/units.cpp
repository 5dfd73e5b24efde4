#include <string>

#include "sim/model/model.hpp"

namespace forceaxis::sim {
namespace {

struct Spelling {
  Dimension dimension;
  std::string_view unit;
};

// The first line of a dimension is its canonical spelling. The list in the header repeats this.
constexpr Spelling kSpellings[] = {
    {Dimension::ratio, "1"},
    {Dimension::ratio, "V/V"},
    {Dimension::count, "count"},
    {Dimension::mass, "kg"},
    {Dimension::length, "m"},
    {Dimension::time, "s"},
    {Dimension::velocity, "m/s"},
    {Dimension::force, "N"},
    {Dimension::impulse, "N s"},
    {Dimension::impulse, "N*s"},
    {Dimension::impulse, "kg m/s"},
    {Dimension::stiffness, "N/m"},
    {Dimension::damping, "N s/m"},
    {Dimension::damping, "N*s/m"},
    {Dimension::damping, "kg/s"},
    {Dimension::voltage, "V"},
    {Dimension::current, "A"},
    {Dimension::resistance, "ohm"},
    {Dimension::inductance, "H"},
    {Dimension::volt_per_amp, "V/A"},
    {Dimension::torque_constant, "N m/A"},
    {Dimension::torque_constant, "N*m/A"},
    {Dimension::speed_constant, "V s/rad"},
    {Dimension::speed_constant, "V*s/rad"},
    {Dimension::transmission, "m/rad"},
    {Dimension::rate, "rad/s"},
    {Dimension::rate, "1/s"},
    {Dimension::rotary_damping, "N m s/rad"},
    {Dimension::rotary_damping, "N*m*s/rad"},
    {Dimension::inertia, "kg m^2"},
    {Dimension::inertia, "kg*m^2"},
    {Dimension::force_per_volt, "N/V"},
    {Dimension::velocity_per_volt, "m/s/V"},
    {Dimension::velocity_per_volt, "m/(s V)"},
    {Dimension::count_per_length, "count/m"},
    {Dimension::acceleration, "m/s^2"},
    {Dimension::force_rate, "N/s"},
    {Dimension::force_per_count, "N/count"},
    {Dimension::current_per_count, "A/count"},
    {Dimension::voltage_per_count, "V/count"},
    {Dimension::length_per_count, "m/count"},
    {Dimension::velocity_per_count, "m/s/count"},
    {Dimension::acceleration_per_count, "m/s^2/count"},
    {Dimension::force_rate_per_count, "N/s/count"},
};

}  // namespace

std::string_view unit_of(Dimension dimension) {
  for (const Spelling &spelling : kSpellings)
    if (spelling.dimension == dimension) return spelling.unit;
  return "1";
}

std::optional<Dimension> dimension_of(std::string_view unit) {
  for (const Spelling &spelling : kSpellings)
    if (spelling.unit == unit) return spelling.dimension;
  return std::nullopt;
}

std::vector<std::string> unit_spellings() {
  std::vector<std::string> units;
  for (const Spelling &spelling : kSpellings) units.emplace_back(spelling.unit);
  return units;
}

}  // namespace forceaxis::sim
