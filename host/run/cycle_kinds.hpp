#pragma once
// The words that the program of a press cycle has as values of keys: actions, conditions, kinds of
// evaluation elements, inputs, outputs and sides. Each word is declared in one row. The row has the
// code of the word in the firmware, the keys that belong to the word, and its meaning for the
// reference page.
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "sim/model/read.hpp"

extern "C" {
#include "firmware/cycle/element.h"
#include "firmware/cycle/program.h"
#include "firmware/objects/generated/axis_objects_axis.h"
}

namespace forceaxis::host {

struct CycleKind {
  /// Code of the word in firmware/cycle, or a bit of the object digital_inputs.
  std::uint8_t code;
  std::string_view name;
  std::string_view meaning = {};
  /// Keys, as a text "a, b", that a table with this word must have.
  std::string_view needs = {};
  /// Further keys, as a text "a, b", that a table with this word may have.
  std::string_view takes = {};
  /// Quantity of the key `value`, if the word is a condition.
  std::optional<sim::Dimension> value = std::nullopt;
  sim::Sign sign = sim::Sign::any;
  /// Key of the phase limit that the value of a condition cannot exceed. Empty if there is no such
  /// limit.
  std::string_view limit = {};
  int direction = 1;  ///< -1: the limit of the phase is compared with the value times -1
};

// Keys that most kinds of evaluation elements may have.
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

// Words for the x of a curve, and for the x of a table of the action follow. The first word of each
// list is the default.
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

/// The words of a list of rows as one text "a, b, c". A key with choices declares its choices in
/// this form.
template <const auto &kRows>
inline constexpr CycleText kWordsOf = [] {
  CycleText text;
  for (const CycleKind &row : kRows) (text += text.size == 0 ? "" : ", ") += row.name;
  return text;
}();

/// Returns a text of the form "BEFORE a: its meaning. b: its meaning."
template <const auto &kRows>
constexpr CycleText meanings(std::string_view before) {
  CycleText text;
  text += before;
  for (const CycleKind &row : kRows)
    ((((text += text.size == 0 ? "" : " ") += row.name) += ": ") += row.meaning) += ".";
  return text;
}

/// Returns a text of the form "BEFORE: a, b, c. AFTER".
template <const auto &kRows>
constexpr CycleText naming(std::string_view before, std::string_view after = "") {
  CycleText text;
  return (((text += before) += ": ") += kWordsOf<kRows>) += after.empty() ? "." : after;
}

/// One word of a list of rows. Before the file is read, this is the first word.
template <const auto &kRows>
struct CycleChoice {
  std::size_t index = 0;

  constexpr const CycleKind &row() const { return kRows[index]; }
  std::uint8_t code() const { return row().code; }
  operator std::string_view() const { return row().name; }
};

/// A set of words from a list of rows, stored as the sum of the words' codes.
template <const auto &kRows>
struct CycleSet {
  std::uint8_t codes = 0;
};

/// Throws InputError if the table has a key that belongs only to other words of the list, or if a
/// key that `word` needs is missing.
void expect_keys(sim::Section &section, std::string_view key, std::span<const CycleKind> rows,
                 const CycleKind &word);
/// Returns the sum of the codes of the words that a key lists.
std::uint8_t codes_of(sim::Section &section, std::string_view key, std::span<const CycleKind> rows);

// Return the values of members of these types, for the rows of a struct (sim/model/read.hpp).
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
