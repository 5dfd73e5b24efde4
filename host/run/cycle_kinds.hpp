#pragma once
// What the program of a cycle names by a word: actions, conditions, kinds of evaluation elements,
// inputs, outputs, sides. A word is one row: its code in the firmware, the keys that belong to it,
// and its meaning for the reference page.
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "firmware/port/host/firmware.hpp"
#include "sim/model/read.hpp"

namespace forceaxis::host {

struct CycleKind {
  std::uint8_t code;  ///< of firmware/cycle, or a bit of the object digital_inputs
  std::string_view name;
  std::string_view meaning = {};
  std::string_view needs = {};  ///< keys "a, b" that are required beside the word
  std::string_view takes = {};  ///< further keys that belong to the word
  /// Quantity of the key `value` of a condition.
  std::optional<sim::Dimension> value = std::nullopt;
  sim::Sign sign = sim::Sign::any;
  /// Limit of the phase which the value of a condition cannot exceed; empty: none.
  std::string_view limit = {};
  int direction = 1;  ///< -1: the limit bounds the negative of the value
};

// Keys that most elements may have.
inline constexpr std::string_view kCycleBounds = "from, to, least, most";
inline constexpr std::string_view kCycleCrossing = "of, direction, ordinal, from, to, least, most";

inline constexpr CycleKind kCycleConditions[] = {
    {CYCLE_REACHED, "reached", "the target of the phase is reached"},
    {CYCLE_TIME, "time", "the phase has lasted for the value", "value", "", sim::Dimension::time,
     sim::Sign::positive, "time_max"},
    {CYCLE_FORCE_ABOVE, "force_above",
     "the measured force less the offset of tare is at least the value", "value", "",
     sim::Dimension::force, sim::Sign::any, "force_max"},
    {CYCLE_FORCE_BELOW, "force_below",
     "the measured force less the offset of tare is at most the value", "value", "",
     sim::Dimension::force, sim::Sign::any, "force_max", -1},
    {CYCLE_TRAVEL_ABOVE, "travel_above",
     "the travel since the start of the phase, in either direction, is at least the value", "value",
     "", sim::Dimension::length, sim::Sign::positive, "travel_max"},
    {CYCLE_DEPTH_ABOVE, "depth_above",
     "the travel from travel 0 (the key zero), less the deflection of the press, is at least the "
     "value",
     "value", "", sim::Dimension::length},
    {CYCLE_DEPTH_BELOW, "depth_below",
     "the travel from travel 0, less the deflection of the press, is at most the value", "value",
     "", sim::Dimension::length},
    {CYCLE_CONTACT, "contact", "the axis is in contact"},
    {CYCLE_LOST, "lost", "the axis is not in contact"},
    {CYCLE_INPUT_ON, "input_on", "the inputs are all on", "inputs"},
    {CYCLE_INPUT_OFF, "input_off", "the inputs are all off", "inputs"},
    {CYCLE_STIFFNESS_ABOVE, "stiffness_above",
     "the change of the force divided by the change of the travel, over the last complete section "
     "of stiffness_travel, is at least the value",
     "value", "", sim::Dimension::stiffness},
    {CYCLE_STIFFNESS_BELOW, "stiffness_below", "this quotient is at most the value", "value", "",
     sim::Dimension::stiffness},
};

inline constexpr CycleKind kCycleActions[] = {
    {CYCLE_MOVE, "move", "to a position", "position, speed"},
    {CYCLE_MOVE_BY, "move_by", "by a distance from the start of the phase", "distance, speed"},
    {CYCLE_MOVE_TO_DEPTH, "move_to_depth",
     "to a distance from travel 0, the first contact unless zero says otherwise",
     "distance, speed"},
    {CYCLE_APPROACH, "approach", "by a distance, and stop at contact", "distance, speed"},
    {CYCLE_PRESS, "press", "with a force; out of contact the axis approaches", "force, slope"},
    {CYCLE_WAIT, "wait", "stay"},
    {CYCLE_FOLLOW, "follow", "press with the force of a table", "slope, table_x, table_force",
     "over"},
    {CYCLE_TARE, "tare", "stay, and measure the offset of the force", "tare_time"},
    {CYCLE_OUTPUT, "output", "stay, and switch outputs; the phase is reached at once"},
};

inline constexpr CycleKind kCycleZeros[] = {
    {CYCLE_ZERO_TOUCH, "touch", "at the first contact of the cycle"},
    {CYCLE_ZERO_FORCE, "force", "where the measured force first reaches zero_force", "zero_force"},
    {CYCLE_ZERO_POSITION, "position", "at zero_position", "zero_position"},
};

inline constexpr CycleKind kCycleElementKinds[] = {
    {CYCLE_PEAK, "peak", "largest force", "", kCycleBounds},
    {CYCLE_VALLEY, "valley", "smallest force", "", kCycleBounds},
    {CYCLE_AT, "at", "the force at an x, or x at a force", "level", kCycleCrossing},
    {CYCLE_DIFFERENCE, "difference", "the value of `at` at level_2 less that at level",
     "level, level_2", kCycleCrossing},
    {CYCLE_WORK, "work", "the sum of force times the change of x", "", kCycleBounds},
    {CYCLE_LAST, "last", "the last force", "", kCycleBounds},
    {CYCLE_WINDOW, "window", "the curve passes a window", "from, to, least, most, enters",
     "leaves"},
    {CYCLE_ENVELOPE, "envelope",
     "smallest distance of the force from a curve below and a curve above",
     "lower_x, lower_force, upper_x, upper_force", "from, to"},
};

// x of a curve, and x of the table of follow, whose defaults differ.
inline constexpr CycleKind kCycleCurves[] = {{0, "travel"}, {1, "time"}};
inline constexpr CycleKind kCycleTables[] = {{0, "time"}, {1, "travel"}};
inline constexpr CycleKind kCycleCrossings[] = {{0, "x"}, {1, "force"}};
inline constexpr CycleKind kCycleDirections[] = {
    {CYCLE_RISING, "rising"}, {CYCLE_FALLING, "falling"}, {CYCLE_EITHER, "either"}};
// The codes of these words are bits.
inline constexpr CycleKind kCycleSides[] = {
    {CYCLE_LEFT, "left"}, {CYCLE_RIGHT, "right"}, {CYCLE_BOTTOM, "bottom"}, {CYCLE_TOP, "top"}};
inline constexpr CycleKind kCycleOutputs[] = {
    {1, "output_1"}, {2, "output_2"}, {4, "output_3"}, {8, "output_4"}};
inline constexpr CycleKind kCycleInputs[] = {{AXIS_DIGITAL_INPUTS_ENABLE, "enable"},
                                             {AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE, "limit_pos"},
                                             {AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE, "limit_neg"},
                                             {AXIS_DIGITAL_INPUTS_INDEX, "index"},
                                             {AXIS_DIGITAL_INPUTS_HOME, "home"}};

// Returns true if the rows have all codes of the firmware from `first` to `count` - 1, in order.
template <std::size_t kSize>
constexpr bool has_codes(const CycleKind (&rows)[kSize], std::size_t first, std::size_t count) {
  for (std::size_t i = 0; i < kSize; ++i)
    if (rows[i].code != first + i) return false;
  return first + kSize == count;
}
static_assert(has_codes(kCycleConditions, 1, CYCLE_CONDITION_KINDS), "all but CYCLE_NEVER");
static_assert(has_codes(kCycleActions, 0, CYCLE_ACTIONS));
static_assert(has_codes(kCycleZeros, 0, CYCLE_ZEROS));
static_assert(has_codes(kCycleElementKinds, 0, CYCLE_KINDS));

// A text that is composed while the program is compiled.
struct CycleText {
  std::array<char, 1200> characters{};
  std::size_t size = 0;

  constexpr CycleText &operator+=(std::string_view more) {
    for (const char c : more) characters[size++] = c;
    return *this;
  }
  constexpr operator std::string_view() const { return {characters.data(), size}; }
};

/// The words of a list, "a, b, c", as a key with choices declares them.
template <const auto &kRows>
inline constexpr CycleText kWordsOf = [] {
  CycleText text;
  for (const CycleKind &row : kRows) (text += text.size == 0 ? "" : ", ") += row.name;
  return text;
}();

/// "BEFORE a: its meaning. b: its meaning."
template <const auto &kRows>
constexpr CycleText meanings(std::string_view before) {
  CycleText text;
  text += before;
  for (const CycleKind &row : kRows)
    ((((text += text.size == 0 ? "" : " ") += row.name) += ": ") += row.meaning) += ".";
  return text;
}

/// "BEFORE: a, b, c. AFTER"
template <const auto &kRows>
constexpr CycleText naming(std::string_view before, std::string_view after = "") {
  CycleText text;
  return (((text += before) += ": ") += kWordsOf<kRows>) += after.empty() ? "." : after;
}

/// One of the words of a list; the first one until it is read.
template <const auto &kRows>
struct CycleChoice {
  std::size_t index = 0;

  constexpr const CycleKind &row() const { return kRows[index]; }
  std::uint8_t code() const { return row().code; }
  operator std::string_view() const { return row().name; }
};

/// A set of the words of a list, as the sum of their codes.
template <const auto &kRows>
struct CycleSet {
  std::uint8_t codes = 0;
};

/// Refuses the keys that belong to other words of a list, and asks for those that the word needs.
void expect_keys(sim::Section &section, std::string_view key, std::span<const CycleKind> rows,
                 const CycleKind &word);
/// Returns the sum of the codes of the words that a key lists.
std::uint8_t codes_of(sim::Section &section, std::string_view key, std::span<const CycleKind> rows);

// The values of the rows of a struct with such members (sim/model/read.hpp).
template <const auto &kRows>
std::optional<CycleChoice<kRows>> value_of(sim::Section &section, sim::Names &,
                                           const sim::KeyFormat &key, CycleChoice<kRows> *) {
  const CycleChoice<kRows> choice{section.choice(key.key, key.advice)};
  expect_keys(section, key.key, kRows, choice.row());
  return choice;
}
template <const auto &kRows>
std::optional<CycleSet<kRows>> value_of(sim::Section &section, sim::Names &,
                                        const sim::KeyFormat &key, CycleSet<kRows> *) {
  if (!section.has(key.key)) return std::nullopt;
  return CycleSet<kRows>{codes_of(section, key.key, kRows)};
}

}  // namespace forceaxis::host
