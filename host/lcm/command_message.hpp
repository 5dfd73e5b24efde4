#pragma once
// Decodes and checks received commands before the generated code decodes them. The generated code
// does not check counts and lengths, and throws an exception for some of them.
#include <cstddef>
#include <cstdint>
#include <forceaxis/axis_command_t.hpp>
#include <optional>
#include <span>

namespace forceaxis::lcm_bus {

// Limits far above the needs of any client. They bound the memory for kept commands and answers.
constexpr std::int32_t kMostItems = 4096, kMostSignals = 64;
constexpr std::uint32_t kLongestName = 255;

// Decodes a command. Returns nothing unless counts are within the limits above, names are
// printable, and the length is exactly right. The only exception is std::bad_alloc.
std::optional<axis_command_t> decode_command(std::span<const std::uint8_t> data);

}  // namespace forceaxis::lcm_bus
