#pragma once
// Checks received commands before the generated code decodes them. The generated code does not
// check counts and lengths, and throws an exception for some invalid values.
#include <cstddef>
#include <cstdint>
#include <forceaxis/axis_command_t.hpp>
#include <optional>
#include <span>

namespace forceaxis::lcm_bus {

// Largest numbers of items and signals in a command. These limits bound the memory for stored
// commands and answers, and are far above the needs of any client.
constexpr std::int32_t kMostItems = 4096, kMostSignals = 64;
constexpr std::uint32_t kLongestName = 255;

// Decodes a command. Returns nothing if a number exceeds a limit above, a name is not printable, or
// the message is too short or too long. The only exception is std::bad_alloc.
std::optional<axis_command_t> decode_command(std::span<const std::uint8_t> data);

}  // namespace forceaxis::lcm_bus
