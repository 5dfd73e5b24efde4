#include "sim/model/units.hpp"

#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <limits>
#include <numbers>

#include "sim/model/text.hpp"

namespace forceaxis::sim {
namespace {

struct Spelling {
  Dimension dimension;
  std::string_view unit;
  // Name of the dimension; empty except at the first spelling of a dimension.
  std::string_view name;
};

// The accepted spellings of units. Messages use the first spelling of a dimension. The list in
// units.hpp must agree with this table.
constexpr Spelling kSpellings[] = {
    {Dimension::ratio, "1", "a ratio"},
    {Dimension::ratio, "V/V", ""},
    {Dimension::count, "count", "a number of counts"},
    {Dimension::mass, "kg", "a mass"},
    {Dimension::length, "m", "a length"},
    {Dimension::time, "s", "a time"},
    {Dimension::velocity, "m/s", "a velocity"},
    {Dimension::force, "N", "a force"},
    {Dimension::energy, "J", "an energy"},
    {Dimension::energy, "N m", ""},
    {Dimension::energy, "N*m", ""},
    {Dimension::impulse, "N s", "an impulse"},
    {Dimension::impulse, "N*s", ""},
    {Dimension::impulse, "kg m/s", ""},
    {Dimension::stiffness, "N/m", "a stiffness"},
    {Dimension::damping, "N s/m", "a damping"},
    {Dimension::damping, "N*s/m", ""},
    {Dimension::damping, "kg/s", ""},
    {Dimension::voltage, "V", "a voltage"},
    {Dimension::current, "A", "a current"},
    {Dimension::resistance, "ohm", "a resistance"},
    {Dimension::inductance, "H", "an inductance"},
    {Dimension::volt_per_amp, "V/A", "a current sensing"},
    {Dimension::torque_constant, "N m/A", "a torque constant"},
    {Dimension::torque_constant, "N*m/A", ""},
    {Dimension::speed_constant, "V s/rad", "a speed constant"},
    {Dimension::speed_constant, "V*s/rad", ""},
    {Dimension::transmission, "m/rad", "a transmission"},
    {Dimension::rate, "rad/s", "a rate"},
    {Dimension::rate, "1/s", ""},
    {Dimension::rotary_damping, "N m s/rad", "a rotary damping"},
    {Dimension::rotary_damping, "N*m*s/rad", ""},
    {Dimension::inertia, "kg m^2", "an inertia"},
    {Dimension::inertia, "kg*m^2", ""},
    {Dimension::force_per_volt, "N/V", "a drive gain"},
    {Dimension::velocity_per_volt, "m/s/V", "a speed per volt"},
    {Dimension::velocity_per_volt, "m/(s V)", ""},
    {Dimension::current_per_volt, "A/V", "an amplifier scale"},
    {Dimension::force_per_current, "N/A", "a motor constant"},
    {Dimension::count_per_length, "count/m", "an encoder scale"},
    {Dimension::acceleration, "m/s^2", "an acceleration"},
    {Dimension::force_rate, "N/s", "a rate of a force"},
    {Dimension::frequency, "Hz", "a frequency"},
    {Dimension::sweep, "Hz/s", "a sweep"},
    {Dimension::volt_per_force, "V/N", "a force gain"},
    {Dimension::volt_per_length, "V/m", "a position gain"},
    {Dimension::volt_per_velocity, "V s/m", "a velocity gain"},
    {Dimension::volt_per_velocity, "V*s/m", ""},
    {Dimension::force_per_count, "N/count", "an ADC scale"},
    {Dimension::current_per_count, "A/count", "an ADC scale"},
    {Dimension::voltage_per_count, "V/count", "an ADC scale"},
    {Dimension::length_per_count, "m/count", "an ADC scale"},
    {Dimension::velocity_per_count, "m/s/count", "an ADC scale"},
    {Dimension::acceleration_per_count, "m/s^2/count", "an ADC scale"},
    {Dimension::force_rate_per_count, "N/s/count", "an ADC scale"},
};

const Spelling &canonical(Dimension dimension) {
  return *std::find_if(std::begin(kSpellings), std::end(kSpellings),
                       [=](const Spelling &s) { return s.dimension == dimension; });
}

// A symbol of a unit. One unit with this symbol is factor * 10^exponent units with the symbol in
// the accepted spellings.
struct Symbol {
  std::string_view text;
  std::string_view base;
  int exponent;
  double factor;
  bool prefixed;  // true: the unit may have an SI prefix
  Powers powers;
};

constexpr Symbol kSymbols[] = {
    {"N", "N", 0, 1.0, true, {1, 1, -2}},
    {"m", "m", 0, 1.0, true, {0, 1}},
    {"s", "s", 0, 1.0, true, {0, 0, 1}},
    {"min", "s", 0, 60.0, false, {0, 0, 1}},
    {"kg", "kg", 0, 1.0, false, {1}},
    {"g", "kg", -3, 1.0, true, {1}},
    {"V", "V", 0, 1.0, true, {1, 2, -3, -1}},
    {"A", "A", 0, 1.0, true, {0, 0, 0, 1}},
    {"J", "J", 0, 1.0, true, {1, 2, -2}},
    {"ohm", "ohm", 0, 1.0, true, {1, 2, -3, -2}},
    {"H", "H", 0, 1.0, true, {1, 2, -2, -2}},
    {"Hz", "Hz", 0, 1.0, true, {0, 0, -1, 0, 0, 1}},
    {"rad", "rad", 0, 1.0, true, {}},
    {"deg", "rad", 0, std::numbers::pi / 180.0, false, {}},
    {"rev", "rad", 0, 2.0 * std::numbers::pi, false, {}},
    {"count", "count", 0, 1.0, false, {0, 0, 0, 0, 1}},
};

struct Prefix {
  char letter;
  int exponent;
};

constexpr Prefix kPrefixes[] = {{'n', -9}, {'u', -6}, {'m', -3}, {'c', -2}, {'k', 3}, {'M', 6}};

std::optional<Symbol> find_symbol(std::string_view text) {
  for (const Symbol &symbol : kSymbols)
    if (symbol.text == text) return symbol;
  for (const Prefix &prefix : kPrefixes) {
    if (text.empty() || text.front() != prefix.letter) continue;
    for (Symbol symbol : kSymbols) {
      if (!symbol.prefixed || symbol.text != text.substr(1)) continue;
      symbol.exponent += prefix.exponent;
      return symbol;
    }
  }
  return std::nullopt;
}

bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); }

// A unit as a factor times one of the accepted spellings. For example, "kN*s/mm" is 10^6 "N s/m".
struct Unit {
  std::string spelling;
  int exponent = 0;
  double factor = 1.0;
  Powers powers{};
};

std::optional<Unit> parse_unit(std::string_view text) {
  Unit unit;
  bool divides = false;
  // True inside parentheses.
  bool group = false;
  // True after a blank, which stands for a multiplication of two symbols.
  bool gap = false;
  for (std::size_t i = 0; i < text.size();) {
    const char c = text[i];
    if (!is_letter(c)) {
      ++i;
      if (c == ' ' || c == '*') {
        gap = true;
        continue;
      }
      gap = false;
      if (c == '/') divides = true;
      if (c == '(') group = true;
      if (c == ')') group = divides = false;
      unit.spelling += c;
      continue;
    }
    std::size_t end = i;
    while (end < text.size() && is_letter(text[end])) ++end;
    const auto symbol = find_symbol(text.substr(i, end - i));
    if (!symbol) return std::nullopt;
    const bool squared = text.substr(end, 2) == "^2";
    const int power = (divides ? -1 : 1) * (squared ? 2 : 1);
    unit.exponent += power * symbol->exponent;
    for (std::size_t k = 0; k < unit.powers.size(); ++k)
      unit.powers[k] += power * symbol->powers[k];
    for (int k = 0; k < std::abs(power); ++k)
      unit.factor = power > 0 ? unit.factor * symbol->factor : unit.factor / symbol->factor;
    if (gap && !unit.spelling.empty() && unit.spelling.back() != '/' && unit.spelling.back() != '(')
      unit.spelling += ' ';
    gap = false;
    unit.spelling += symbol->base;
    if (squared) unit.spelling += "^2";
    i = end + (squared ? 2 : 0);
    if (!group) divides = false;
  }
  return unit;
}

// Returns the dimension of a unit. Equivalent forms of a product, such as "N s" and "N*s", have the
// same dimension.
std::optional<Dimension> dimension_of_unit(const Unit &unit) {
  for (const Spelling &spelling : kSpellings)
    if (parse_unit(spelling.unit)->spelling == unit.spelling) return spelling.dimension;
  return std::nullopt;
}

// Returns a decimal number times a power of ten, with only one rounding.
double scaled_number(std::string number, int exponent) {
  if (const std::size_t at = number.find_first_of("eE"); at != std::string::npos) {
    int own = 0;
    const char *digits = number.data() + at + 1;
    if (*digits == '+') ++digits;
    const auto parsed = std::from_chars(digits, number.data() + number.size(), own);
    if (parsed.ec != std::errc()) return std::numeric_limits<double>::infinity();
    exponent += std::clamp(own, -100000, 100000);
    number.resize(at);
  }
  number.append(1, 'e').append(std::to_string(exponent));
  // The value stays infinite if the number is too large for a double.
  double value = std::numeric_limits<double>::infinity();
  (void)std::from_chars(number.data(), number.data() + number.size(), value);
  return value;
}

}  // namespace

std::string_view unit_of(Dimension dimension) { return canonical(dimension).unit; }

Powers powers_of(Dimension dimension) { return parse_unit(unit_of(dimension))->powers; }

std::string phrase_of(Dimension dimension) {
  if (dimension == Dimension::ratio) return "a number without unit";
  return std::string(canonical(dimension).name) + " in " + std::string(unit_of(dimension));
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

bool is_quantity(std::string_view text) {
  if (!text.empty() && (text.front() == '-' || text.front() == '+')) text.remove_prefix(1);
  if (!text.empty() && text.front() == '.') text.remove_prefix(1);
  return !text.empty() && text.front() >= '0' && text.front() <= '9';
}

QuantityText split_quantity(std::string_view text) {
  if (text.front() == '+') text.remove_prefix(1);
  QuantityText parts;
  const char *const end = text.data() + text.size();
  const auto parsed = std::from_chars(text.data(), end, parts.number);
  if (parsed.ec != std::errc()) parts.number = std::numeric_limits<double>::infinity();
  parts.digits = text.substr(0, static_cast<std::size_t>(parsed.ptr - text.data()));
  text.remove_prefix(parts.digits.size());
  parts.unit = text.substr(std::min(text.find_first_not_of(' '), text.size()));
  return parts;
}

QuantityResult read_quantity(std::string_view text, Dimension dimension) {
  const std::string quoted = in_quotes(text);
  const QuantityText parts = split_quantity(text);
  if (parts.unit.empty()) return {std::nullopt, quoted + " without a unit"};
  const auto unit = parse_unit(parts.unit);
  const auto found = unit ? dimension_of_unit(*unit) : std::nullopt;
  if (!found) return {std::nullopt, quoted + ", whose unit is not known"};
  const bool cycles = found == Dimension::frequency && dimension == Dimension::rate;
  if (found != dimension && !cycles)
    return {std::nullopt, quoted + ", " + std::string(canonical(*found).name)};
  const double factor = cycles ? 2.0 * std::numbers::pi * unit->factor : unit->factor;
  return {scaled_number(std::string(parts.digits), unit->exponent) * factor, quoted};
}

}  // namespace forceaxis::sim
