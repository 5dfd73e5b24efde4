#pragma once
// The units of Modbus TCP that are no axis: the gateway itself, 255 and 0, has an identity
// (functions 8, 17 and 43/14, by the firmware's own server core) and no registers, exception 1;
// behind any other unit there is nothing, exception 10.
#include <array>
#include <cstdint>

#include "host/modbus/frames.hpp"

extern "C" {
#include "firmware/modbus/request.h"
}

namespace forceaxis::nodes {

class ModbusSelf {
 public:
  // Carries out a request to a unit that is no axis and puts the answer in its place.
  void serve(std::uint8_t unit, modbus::Pdu &pdu);

 private:
  std::array<std::uint16_t, MODBUS_COUNTERS> counters_{};
};

}  // namespace forceaxis::nodes
