#pragma once
// Modbus requests of one axis, carried out over SDO by the firmware's own server core
// (firmware/modbus/request.h).
//
// Each object is read afresh when it is asked for, one after the other: a 32-bit value is never
// torn, but the values of one request come from consecutive ticks, about one object a millisecond.
// A request that writes several objects is all or none as long as no other client writes the same
// ones: those before the first refusal are given their previous values again. What the axis would
// refuse by its lock, its state or the object's range is known before anything is written.
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
  // The axis must outlive this.
  explicit ModbusAxis(GatewayAxis &axis) : axis_(axis), port_(axis.modbus_port()) {}

  // Carries out the request and puts the answer in its place.
  Task<void> serve(modbus::Pdu &pdu);

 private:
  // Each gives FW_OK, FW_ERROR_ or MODBUS_NO_ANSWER.
  Task<int> carry_out(modbus_access_t &access);
  Task<int> read(std::uint16_t object, std::int32_t &value);
  Task<int> write(std::uint16_t object, std::int32_t value);
  Task<int> check(std::uint16_t object, std::int32_t value, bool as_owner);

  GatewayAxis &axis_;
  ObjectPort port_;
  std::string text_;  // of the last access
  std::array<std::uint16_t, MODBUS_COUNTERS> counters_{};
};

}  // namespace forceaxis::nodes
