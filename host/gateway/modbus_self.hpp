#pragma once
// The units of Modbus TCP that are not axes. Units 255 and 0 are the gateway: it has an identity
// (functions 8, 17 and 43/14, with the server functions of the firmware), and answers requests for
// registers with exception 1. Any other unit answers with exception 10.
#include <array>
#include <cstdint>

#include "host/modbus/frames.hpp"

extern "C" {
#include "firmware/modbus/request.h"
}

namespace forceaxis::nodes {

class ModbusSelf {
 public:
  // Executes a request to a unit that is not an axis, and replaces the request with its answer.
  void serve(std::uint8_t unit, modbus::Pdu &pdu);

 private:
  std::array<std::uint16_t, MODBUS_COUNTERS> counters_{};
};

}  // namespace forceaxis::nodes
