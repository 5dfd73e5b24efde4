#pragma once
#include <array>
#include <cstdint>

namespace forceaxis::canopen {

// A CAN data frame with an 11-bit identifier.
struct Frame {
  std::uint32_t id = 0;
  std::uint8_t length = 0;
  std::array<std::uint8_t, 8> data{};
};

}  // namespace forceaxis::canopen
