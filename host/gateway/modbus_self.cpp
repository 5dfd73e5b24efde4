#include "host/gateway/modbus_self.hpp"

extern "C" {
#include "firmware/app/fw.h"
}

namespace forceaxis::nodes {
namespace {

// Returns true for the units that address the server itself (Messaging on TCP/IP 1.0b, 4.4.1.2).
constexpr bool is_gateway(std::uint8_t unit) { return unit == 0 || unit == 255; }

constexpr bool identifies(std::uint8_t function) {
  return function == 8 || function == 17 || function == 43;
}

void refuse(modbus::Pdu &pdu, std::uint8_t exception) {
  pdu = {static_cast<std::uint8_t>(pdu[0] | 0x80), exception};
}

void carry_out(modbus_access_t &access) {
  access.refusal = FW_OK;
  if (access.kind == MODBUS_READ_TEXT) {
    access.text = access.object == 0x1008   ? "forceaxis gateway"
                  : access.object == 0x100A ? FW_VERSION " " AXIS_OBJECTS_HASH_TEXT
                                            : "none";
  } else if (access.object == AXIS_OBJ_OBJECT_TABLE_HASH) {
    access.value = static_cast<std::int32_t>(AXIS_OBJECTS_HASH32);
  } else {
    // Modbus function 17 reports this value as the state "on" of the gateway.
    access.value = AXIS_DRIVE_STATE_OPERATION_ENABLED;
  }
}

}  // namespace

void ModbusSelf::serve(std::uint8_t unit, modbus::Pdu &pdu) {
  if (!is_gateway(unit)) {
    refuse(pdu, MODBUS_EXCEPTION_PATH);
    return;
  }
  ++counters_[MODBUS_COUNT_MESSAGES];
  if (!identifies(pdu[0])) {
    ++counters_[MODBUS_COUNT_SERVED];
    ++counters_[MODBUS_COUNT_EXCEPTIONS];
    refuse(pdu, MODBUS_EXCEPTION_FUNCTION);
    return;
  }
  const auto length = static_cast<std::uint16_t>(pdu.size());
  pdu.resize(MODBUS_PDU_BYTES);
  modbus_request_t request;
  modbus_request_begin(&request, unit, pdu.data(), length, counters_.data());
  while (!modbus_request_ended(&request)) {
    carry_out(request.access);
    modbus_request_resume(&request);
  }
  pdu.resize(request.length);
}

}  // namespace forceaxis::nodes
