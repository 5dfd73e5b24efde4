#pragma once
// Commands out of what was received, checked before the generated code decodes them: that code
// believes every count and length, and throws for some.
#include <cstddef>
#include <cstdint>
#include <forceaxis/axis_command_t.hpp>
#include <optional>
#include <span>

namespace forceaxis::lcm_bus {

// Far above what any client needs, so that kept commands and answers stay small.
constexpr std::int32_t kMostItems = 4096, kMostSignals = 64;
constexpr std::uint32_t kLongestName = 255;

// The command that these bytes are: counts within the limits above, names printable, and nothing
// missing or left over. Throws nothing but std::bad_alloc.
std::optional<axis_command_t> decode_command(std::span<const std::uint8_t> data);

}  // namespace forceaxis::lcm_bus
