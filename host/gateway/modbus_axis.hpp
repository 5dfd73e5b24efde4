#pragma once
// Executes the Modbus requests for one axis over SDO, with the server functions of the firmware
// (firmware/modbus/request.h).
//
// A request reads its objects one after the other from the axis. A 32-bit value is consistent, but
// the values of one request come from consecutive ticks, at about one object per millisecond. A
// request that writes several objects writes all of them or none, if no other client writes these
// objects at the same time: after a refusal, the objects that were written before get their
// previous values again. Refusals by the lock, by the state or by the range of an object are
// detected before the first write.
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
  // `axis` must exist as long as this object.
  explicit ModbusAxis(GatewayAxis &axis) : axis_(axis) {}

  // Executes a request and replaces it with its answer.
  Task<void> serve(modbus::Pdu &pdu);

 private:
  // Each function returns FW_OK, FW_ERROR_ or MODBUS_NO_ANSWER.
  Task<int> carry_out(modbus_access_t &access);
  Task<int> read(std::uint16_t object, std::int32_t &value);
  Task<int> write(std::uint16_t object, std::int32_t value);
  Task<int> check(std::uint16_t object, std::int32_t value, bool as_owner);

  GatewayAxis &axis_;
  std::string text_;  // text of the last access
  std::array<std::uint16_t, MODBUS_COUNTERS> counters_{};
};

}  // namespace forceaxis::nodes
