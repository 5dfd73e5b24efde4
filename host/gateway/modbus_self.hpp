#pragma once
// The units of Modbus TCP that are not axes. Units 255 and 0 are the gateway, which answers the
// functions 8, 17 and 43/14 (diagnostics and identification) and refuses requests for registers
// with exception 1. All other units answer with exception 10.
#include <array>
#include <cstdint>

#include "host/modbus/frames.hpp"

extern "C" {
#include "firmware/modbus/request.h"
}

namespace forceaxis::nodes {

class ModbusSelf {
 public:
  // Executes the request in `pdu` to a unit that is not an axis, and writes the answer to `pdu`.
  void serve(std::uint8_t unit, modbus::Pdu &pdu);

 private:
  std::array<std::uint16_t, MODBUS_COUNTERS> counters_{};
};

}  // namespace forceaxis::nodes
