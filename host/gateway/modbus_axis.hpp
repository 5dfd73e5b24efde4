#pragma once
// Executes Modbus requests for one axis over SDO. The functions in firmware/modbus/request.h
// interpret the requests.
//
// The objects of a request are read from the axis one after the other, about one object per
// millisecond. Each 32-bit value is consistent, but the values of one request come from different
// ticks. A request that writes several objects writes all objects or none, if no other client
// writes these objects at the same time. If the axis refuses an object, the gateway writes back the
// previous values of the objects that were already written. Refusals because of the owner, the
// state or the range of an object are detected before the first write.
#include <array>
#include <string>

#include "host/gateway/axis.hpp"
#include "host/modbus/tcp_server.hpp"

extern "C" {
#include "firmware/modbus/request.h"
}

namespace forceaxis::nodes {

class ModbusAxis {
 public:
  // `axis` must exist as long as this ModbusAxis.
  explicit ModbusAxis(GatewayAxis &axis) : axis_(axis) {}

  // Executes the request in `pdu` and writes the answer to `pdu`.
  Task<void> serve(modbus::Pdu &pdu);

 private:
  // These functions return FW_OK, an error FW_ERROR_ or MODBUS_NO_ANSWER.
  Task<int> carry_out(modbus_access_t &access);
  Task<int> read(std::uint16_t object, std::int32_t &value);
  Task<int> write(std::uint16_t object, std::int32_t value);
  Task<int> check(std::uint16_t object, std::int32_t value, bool as_owner);

  GatewayAxis &axis_;
  std::string text_;  // text of the object that the last Modbus request has read
  std::array<std::uint16_t, MODBUS_COUNTERS> counters_{};
};

}  // namespace forceaxis::nodes
