#pragma once
// The conditions that end a phase of a cycle: a row for each.
#include <array>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <optional>
#include <string_view>

#include "firmware/port/host/firmware.hpp"
#include "sim/model/units.hpp"

namespace forceaxis::host {

struct CycleCondition {
  std::uint8_t code;      // CYCLE_ of firmware/cycle/program.h
  std::string_view name;  // value of the key `when`
  // Quantity of the key `value`, which the condition needs; empty: it has no value.
  std::optional<sim::Dimension> value = std::nullopt;
  bool inputs = false;  // true: the condition needs the key `inputs`
};

inline constexpr CycleCondition kCycleConditions[] = {
    {CYCLE_REACHED, "reached"},
    {CYCLE_TIME, "time", sim::Dimension::time},
    {CYCLE_FORCE_ABOVE, "force_above", sim::Dimension::force},
    {CYCLE_FORCE_BELOW, "force_below", sim::Dimension::force},
    {CYCLE_TRAVEL_ABOVE, "travel_above", sim::Dimension::length},
    {CYCLE_DEPTH_ABOVE, "depth_above", sim::Dimension::length},
    {CYCLE_DEPTH_BELOW, "depth_below", sim::Dimension::length},
    {CYCLE_CONTACT, "contact"},
    {CYCLE_LOST, "lost"},
    {CYCLE_INPUT_ON, "input_on", std::nullopt, true},
    {CYCLE_INPUT_OFF, "input_off", std::nullopt, true},
    {CYCLE_STIFFNESS_ABOVE, "stiffness_above", sim::Dimension::stiffness},
    {CYCLE_STIFFNESS_BELOW, "stiffness_below", sim::Dimension::stiffness},
};
// All but CYCLE_NEVER.
static_assert(std::size(kCycleConditions) == CYCLE_CONDITION_KINDS - 1);

// The names of all conditions, "a, b, c", as a key with choices declares them.
inline constexpr auto kCycleConditionNames = [] {
  std::array<char, 256> text{};
  std::size_t size = 0;
  for (const CycleCondition &condition : kCycleConditions) {
    if (size > 0) text[size++] = ',', text[size++] = ' ';
    for (const char c : condition.name) text[size++] = c;
  }
  return text;
}();

}  // namespace forceaxis::host
