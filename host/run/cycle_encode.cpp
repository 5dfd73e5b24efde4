#include "host/run/cycle_encode.hpp"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>

#include "sim/model/text.hpp"

extern "C" {
#include "firmware/fx/bytes.h"
}

namespace forceaxis::host {
namespace {

using sim::Dimension;

constexpr double kSpeedMax = 3072000;     // largest speed in counts/s
constexpr double kForceMax = 32766;       // largest force in per mille of rated_force
constexpr double kSlopeMax = UINT32_MAX;  // largest slope in per mille of rated_force per second
constexpr double kTimeMax = 1e9;          // longest time in ticks
constexpr double kLevelMax = INT32_MAX;   // largest level of a stiffness

static_assert(std::endian::native == std::endian::little, "the record has the lowest byte first");

// Rounds a number in a unit of the firmware. Throws InputError if the result is not from `low` to
// `high`.
std::int64_t rounded(const CyclePlace &place, std::string_view key, double value, double low,
                     double high) {
  const double whole = std::nearbyint(value);
  if (!(whole >= low && whole <= high))
    place.fail(key, "expected a value of " + sim::number_text(low) + " to " +
                        sim::number_text(high) + " in counts of the axis, got " +
                        sim::number_text(value) + "; choose another value or another model");
  return static_cast<std::int64_t>(whole);
}

double largest(Dimension dimension) {
  if (dimension == Dimension::force) return CYCLE_FORCE_MAX_Q8;
  return dimension == Dimension::stiffness ? kLevelMax : CYCLE_TRAVEL_MAX;
}

// One coordinate of a curve: the key and the values in the file, and the number of firmware units
// in one unit of the file.
struct Coordinate {
  const char *key;
  const std::vector<double> &values;
  double per_unit;
  double most;
};

class Encoder {
 public:
  Encoder(const CycleProgram &program, const CycleScales &scales, const CyclePlace &root)
      : program_(program), scales_(scales), root_(root) {}

  CycleCode encode() {
    encode_header();
    if (!program_.compliance_force.empty())
      code_.header.compliance = add_table(
          root_,
          {"compliance_force", program_.compliance_force, scales_.q8_per_N, CYCLE_TRAVEL_MAX},
          {"compliance_deflection", program_.compliance_deflection, scales_.counts_per_m,
           CYCLE_TABLE_Y_MAX});
    for (std::size_t i = 0; i < program_.phases.size(); ++i)
      code_.phases.push_back(encode(program_.phases[i], root_.at("phase", i)));
    for (std::size_t i = 0; i < program_.elements.size(); ++i)
      code_.elements.push_back(encode(program_.elements[i], root_.at("element", i)));
    return std::move(code_);
  }

 private:
  void encode_header() {
    cycle_header_t &header = code_.header;
    header.magic = CYCLE_MAGIC;
    header.version = CYCLE_VERSION;
    header.number = static_cast<std::uint32_t>(program_.number);
    if (program_.name.size() > sizeof(header.name))
      root_.fail("name", "expected at most 12 bytes, got " + std::to_string(program_.name.size()) +
                             "; shorten the name, or give it in title");
    std::memcpy(header.name, program_.name.data(), program_.name.size());
    if (program_.bank_crc) header.bank_crc = crc_of(*program_.bank_crc);
    header.zero = program_.zero.code();
    if (program_.zero_force)
      header.zero_level = level(root_, "zero_force", *program_.zero_force, Dimension::force);
    if (program_.zero_position)
      header.zero_level = level(root_, "zero_position", *program_.zero_position, Dimension::length);
    header.outputs_keep = program_.keep_outputs.codes;
  }

  std::uint32_t crc_of(const std::string &text) const {
    std::uint32_t value = 0;
    const char *const end = text.data() + text.size();
    if (text.size() != 8 || std::from_chars(text.data(), end, value, 16).ptr != end)
      root_.fail("bank_crc", "expected 8 hexadecimal digits, got " + sim::in_quotes(text) +
                                 "; give the CRC that `design_law` prints");
    return value;
  }

  std::int32_t level(const CyclePlace &place, std::string_view key, double value,
                     Dimension dimension) const {
    const double most = largest(dimension);
    return static_cast<std::int32_t>(
        rounded(place, key, value * scales_.per(dimension), -most, most));
  }

  // Returns a rounded magnitude, which must be at least 1.
  static std::uint32_t magnitude(const CyclePlace &place, std::string_view key, double value,
                                 double most) {
    return static_cast<std::uint32_t>(rounded(place, key, std::fabs(value), 1, most));
  }

  std::uint8_t phase_of(const CyclePlace &place, const char *key, const std::string &name) const {
    const std::vector<std::string> names = program_.phase_names();
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end())
      place.fail(key, "expected a phase of this file, got " + sim::in_quotes(name) +
                          sim::suggestion(name, names) + "; add this phase or correct its name");
    return static_cast<std::uint8_t>(found - names.begin());
  }
  std::uint8_t next_of(const CyclePlace &place, const char *key, const std::string &name) const {
    return name == "end" ? std::uint8_t{CYCLE_END} : phase_of(place, key, name);
  }

  // Adds the points of a curve. Returns their number.
  std::uint8_t add_points(const CyclePlace &place, const Coordinate &x, const Coordinate &y) {
    const std::size_t size = x.values.size();
    if (size < 2 || size > UINT8_MAX || size != y.values.size())
      place.fail(y.key, std::string("expected 2 to 255 points with one value of ") + x.key +
                            " and one of " + y.key + " each; give lists of the same length");
    const auto at = [&](const Coordinate &axis, std::size_t i) {
      return static_cast<std::int32_t>(
          rounded(place, axis.key, axis.values[i] * axis.per_unit, -axis.most, axis.most));
    };
    for (std::size_t i = 0; i < size; ++i) code_.points.push_back({at(x, i), at(y, i)});
    return static_cast<std::uint8_t>(size);
  }

  // Adds the points of a table (firmware/cycle/table.h) like add_points(). Returns their number.
  std::uint8_t add_table(const CyclePlace &place, const Coordinate &x, const Coordinate &y) {
    const std::uint8_t size = add_points(place, x, y);
    for (std::size_t i = code_.points.size() - size + 1; i < code_.points.size(); ++i) {
      const std::int64_t step = std::int64_t{code_.points[i].x} - code_.points[i - 1].x;
      if (step < 1 || step > CYCLE_TABLE_STEP_MAX)
        place.fail(x.key,
                   "expected values that rise by 1 to 524287 in counts of the axis or "
                   "ticks from one point to the next; sort them, or add points");
    }
    return size;
  }

  // Encodes the motion or the force of a phase from the keys that belong to the phase's action.
  void encode_action(cycle_phase_t &code, const CyclePhase &phase, const CyclePlace &place) {
    const double per_mille = scales_.per_mille_per_N();
    if (phase.position) code.target = level(place, "position", *phase.position, Dimension::length);
    if (phase.distance) code.target = level(place, "distance", *phase.distance, Dimension::length);
    if (phase.speed)
      code.speed = magnitude(place, "speed", *phase.speed * scales_.counts_per_m, kSpeedMax);
    if (phase.force)
      code.force = static_cast<std::int16_t>(
          rounded(place, "force", *phase.force * per_mille, -kForceMax, kForceMax));
    if (phase.slope) code.slope = magnitude(place, "slope", *phase.slope * per_mille, kSlopeMax);
    if (phase.tare_s)
      code.target = static_cast<std::int32_t>(std::max(1.0, scales_.ticks_of(*phase.tare_s)));
    if (phase.table_x.empty()) return;
    code.over_travel = phase.over.code();
    code.first = static_cast<std::uint16_t>(code_.points.size());
    const Dimension x = code.over_travel != 0 ? Dimension::length : Dimension::time;
    code.points = add_table(place, {"table_x", phase.table_x, scales_.per(x), CYCLE_TRAVEL_MAX},
                            {"table_force", phase.table_force, 256 * per_mille, CYCLE_TABLE_Y_MAX});
  }

  cycle_phase_t encode(const CyclePhase &phase, const CyclePlace &place) {
    cycle_phase_t code{};
    code.action = phase.action.code();
    code.reaction = next_of(place, "on_limit", phase.on_limit);
    code.force_max_q8 =
        magnitude(place, "force_max", phase.force_max * scales_.q8_per_N, CYCLE_FORCE_MAX_Q8);
    code.travel_max =
        magnitude(place, "travel_max", phase.travel_max * scales_.counts_per_m, CYCLE_TRAVEL_MAX);
    code.time_max = static_cast<std::uint32_t>(scales_.ticks_of(phase.time_max));
    encode_action(code, phase, place);
    if (phase.stiffness_travel)
      code.stiffness_travel = static_cast<std::uint16_t>(magnitude(
          place, "stiffness_travel", *phase.stiffness_travel * scales_.counts_per_m, UINT16_MAX));
    code.outputs_on = phase.outputs_on.codes;
    code.outputs_off = phase.outputs_off.codes;
    for (std::size_t i = 0; i < phase.ends.size(); ++i)
      code.conditions[i] = encode(phase.ends[i], place.at("end", i));
    return code;
  }

  cycle_condition_t encode(const CycleEnd &end, const CyclePlace &place) const {
    cycle_condition_t code{};
    code.when = end.when.code();
    code.next = next_of(place, "next", end.next);
    code.count = static_cast<std::uint16_t>(end.count);
    code.level = end.inputs.codes;
    if (!end.value) return code;
    const auto [dimension, sign] = end.quantity();
    if (dimension == Dimension::time)
      code.level = static_cast<std::int32_t>(
          rounded(place, "value", std::max(1.0, scales_.ticks_of(*end.value)), 1, kTimeMax));
    else if (sign == sim::Sign::positive)
      code.level = static_cast<std::int32_t>(
          magnitude(place, "value", *end.value * scales_.per(dimension), largest(dimension)));
    else
      code.level = level(place, "value", *end.value, dimension);
    return code;
  }

  // Encodes the bounds of the value of an evaluation element.
  static void encode_bounds(cycle_element_t &code, const CycleElement &element, double per_unit) {
    const auto bound = [](double value) {
      return static_cast<std::int32_t>(
          std::clamp(value, -2147483648.0, static_cast<double>(INT32_MAX)));
    };
    const double infinity = std::numeric_limits<double>::infinity();
    code.y_least = bound(std::ceil(element.least.value_or(-infinity) * per_unit - 1e-6));
    code.y_most = bound(std::floor(element.most.value_or(infinity) * per_unit + 1e-6));
  }

  std::uint8_t add_curve(const CyclePlace &place, const CycleElement &element, const char *x_key,
                         const std::vector<double> &x, const char *force_key,
                         const std::vector<double> &forces) {
    return add_points(place, {x_key, x, scales_.per(element.x().dimension), CYCLE_TRAVEL_MAX},
                      {force_key, forces, scales_.q8_per_N, CYCLE_FORCE_MAX_Q8});
  }

  void encode_envelope(cycle_element_t &code, const CycleElement &element,
                       const CyclePlace &place) {
    code.first = static_cast<std::uint16_t>(code_.points.size());
    code.lower =
        add_curve(place, element, "lower_x", element.lower_x, "lower_force", element.lower_force);
    code.upper =
        add_curve(place, element, "upper_x", element.upper_x, "upper_force", element.upper_force);
    const auto begin = code_.points.begin() + code.first;
    const auto middle = begin + code.lower;
    if (!element.x_from) code.x_least = std::max(begin->x, middle->x);
    if (!element.x_to) code.x_most = std::min((middle - 1)->x, code_.points.back().x);
  }

  cycle_element_t encode(const CycleElement &element, const CyclePlace &place) {
    cycle_element_t code{};
    code.kind = element.kind.code();
    code.over_time = element.over.code();
    code.of_force = element.of.code();
    for (const std::string &phase : element.phases)
      code.phases =
          static_cast<std::uint16_t>(code.phases | 1U << phase_of(place, "phases", phase));
    const auto number = [&](const char *key, const std::optional<double> &value,
                            sim::Quantity quantity, std::int32_t fallback) {
      return value ? level(place, key, *value, quantity.dimension) : fallback;
    };
    code.x_least = number("from", element.x_from, element.x(), -CYCLE_TRAVEL_MAX);
    code.x_most = number("to", element.x_to, element.x(), CYCLE_TRAVEL_MAX);
    code.level = number("level", element.level, element.crossed(), 0);
    code.level_2 = number("level_2", element.level_2, element.crossed(), 0);
    if (element.level) {
      code.direction = element.direction.code();
      code.ordinal = static_cast<std::uint8_t>(element.ordinal);
    }
    code.enters = element.enters.codes;
    code.leaves = element.leaves.codes;
    if (element.lower_x.empty())
      encode_bounds(code, element, scales_.per(element.value().dimension));
    else
      encode_envelope(code, element, place);
    return code;
  }

  const CycleProgram &program_;
  const CycleScales &scales_;
  const CyclePlace &root_;
  CycleCode code_;
};

template <class T>
void append(std::vector<std::uint8_t> &bytes, const T *first, std::size_t count) {
  const auto *begin = reinterpret_cast<const std::uint8_t *>(first);
  bytes.insert(bytes.end(), begin, begin + count * sizeof(T));
}

}  // namespace

std::vector<std::uint32_t> CycleCode::record(const CyclePlace &place) const {
  const std::size_t size = sizeof(cycle_header_t) + phases.size() * sizeof(cycle_phase_t) +
                           elements.size() * sizeof(cycle_element_t) +
                           points.size() * sizeof(cycle_point_t) + 4;
  if (size > CYCLE_PROGRAM_BYTES_MAX)
    place.fail("element", "expected a program of at most 4096 bytes, got " + std::to_string(size) +
                              "; remove points of tables and envelopes, or phases");
  cycle_header_t head = header;
  head.size = static_cast<std::uint16_t>(size);
  head.phases = static_cast<std::uint8_t>(phases.size());
  head.elements = static_cast<std::uint8_t>(elements.size());
  head.points = static_cast<std::uint16_t>(points.size());
  std::vector<std::uint8_t> bytes;
  append(bytes, &head, 1);
  append(bytes, phases.data(), phases.size());
  append(bytes, elements.data(), elements.size());
  append(bytes, points.data(), points.size());
  std::uint32_t crc = UINT32_MAX;
  for (const std::uint8_t byte : bytes) crc = fx_crc32(crc, byte);
  crc = ~crc;
  append(bytes, &crc, 1);
  std::vector<std::uint32_t> words(bytes.size() / sizeof(std::uint32_t));
  std::memcpy(words.data(), bytes.data(), bytes.size());
  return words;
}

CycleCode encode_cycle(const CycleProgram &program, const CycleScales &scales,
                       const CyclePlace &place) {
  return Encoder(program, scales, place).encode();
}

}  // namespace forceaxis::host
