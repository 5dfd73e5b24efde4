#include "host/gateway/modbus_axis.hpp"

extern "C" {
#include "firmware/drive/state.h"
}
#include "host/run/objects.hpp"

namespace forceaxis::nodes {
namespace {

// Returns the error FW_ERROR_ for the SDO abort code with which the axis has refused a request.
int refusal_of(std::uint32_t abort) {
  switch (abort >> 16) {
    case 0x0601:
      return abort == 0x06010001 ? FW_ERROR_WRITE_ONLY : FW_ERROR_READ_ONLY;
    case 0x0604:
    case 0x0607:
      return FW_ERROR_RANGE;
    case 0x0606:
      return FW_ERROR_NO_MEMORY;
    case 0x0800:
      return abort == 0x08000020 ? FW_ERROR_RANGE : FW_ERROR_STATE;
    default:
      return abort >= 0x06090030 && abort <= 0x06090036 ? FW_ERROR_RANGE : FW_ERROR_NO_OBJECT;
  }
}

int refusal_of(const ObjectResult &result) {
  if (result.ok()) return FW_OK;
  return result.silent ? int{MODBUS_NO_ANSWER} : refusal_of(result.abort);
}

bool in_range(std::uint16_t object, std::int32_t bits) {
  const axis_object_meta_t &meta = host::object_meta(object);
  std::int64_t number = bits;
  if (axis_objects[object].type == AXIS_TYPE_U32) number = static_cast<std::uint32_t>(bits);
  return number >= meta.min && number <= meta.max;
}

// Returns true if a write to this object is refused while the store is busy.
bool touches_store(std::uint16_t object) {
  return axis_objects[object].stored != 0 || object == AXIS_OBJ_STORE_PARAMETERS ||
         object == AXIS_OBJ_RESTORE_DEFAULTS;
}

}  // namespace

Task<int> ModbusAxis::read(std::uint16_t object, std::int32_t &value) {
  const ObjectResult result = co_await axis_.modbus_port().read(object);
  if (result.ok()) value = static_cast<std::int32_t>(static_cast<std::uint32_t>(result.value));
  co_return refusal_of(result);
}

Task<int> ModbusAxis::write(std::uint16_t object, std::int32_t value) {
  // The range is checked here, because an SDO transfers only the bytes of the object. For example,
  // an SDO would transfer the value 511 of an 8-bit object as -1.
  if (!in_range(object, value)) co_return FW_ERROR_RANGE;
  const ObjectResult result = co_await axis_.modbus_port().write(object, value);
  if (result.ok() && object == AXIS_OBJ_COMMAND_SOURCE) axis_.acquired_by_modbus();
  if (result.abort == canopen::kAbortState && touches_store(object)) {
    // A wrong state and a busy store have the same SDO abort code.
    std::int32_t store = 0;
    const int refusal = co_await read(AXIS_OBJ_STORE_STATE, store);
    if (refusal == FW_OK && store == AXIS_STORE_STATE_SAVING) co_return FW_ERROR_BUSY;
  }
  co_return refusal_of(result);
}

// Checks range, owner and state like the firmware. A write that only stops the axis is accepted
// from every client.
Task<int> ModbusAxis::check(std::uint16_t object, std::int32_t value, bool as_owner) {
  if (!in_range(object, value)) co_return FW_ERROR_RANGE;
  if (cia402_is_stop(object, value)) co_return FW_OK;
  std::int32_t owner = AXIS_COMMAND_SOURCE_MODBUS;
  if (!as_owner) {
    const int refusal = co_await read(AXIS_OBJ_COMMAND_SOURCE, owner);
    if (refusal != FW_OK) co_return refusal;
  }
  const bool owns = owner == AXIS_COMMAND_SOURCE_MODBUS;
  std::int32_t state = 0;
  if (!owns && object == AXIS_OBJ_COMMAND_SOURCE && value == AXIS_COMMAND_SOURCE_MODBUS) {
    const int refusal = co_await read(AXIS_OBJ_DRIVE_STATE, state);
    if (refusal != FW_OK) co_return refusal;
    co_return cia402_is_powered(static_cast<std::uint8_t>(state)) ? FW_ERROR_LOCKED : FW_OK;
  }
  if (!owns) co_return FW_ERROR_LOCKED;
  if (axis_objects[object].writable == AXIS_WRITABLE_DISABLED) {
    const int refusal = co_await read(AXIS_OBJ_ACTIVE_MODE, state);
    if (refusal != FW_OK) co_return refusal;
    if (state != AXIS_MODE_DISABLED) co_return FW_ERROR_STATE;
  } else if (axis_objects[object].writable == AXIS_WRITABLE_RECORDER_IDLE) {
    const int refusal = co_await read(AXIS_OBJ_RECORDER_STATE, state);
    if (refusal != FW_OK) co_return refusal;
    if (state != AXIS_RECORDER_STATE_IDLE && state != AXIS_RECORDER_STATE_DONE) {
      co_return FW_ERROR_STATE;
    }
  }
  co_return FW_OK;
}

Task<int> ModbusAxis::carry_out(modbus_access_t &access) {
  const bool writes = access.kind != MODBUS_READ && access.kind != MODBUS_READ_TEXT;
  const bool stops = writes && cia402_is_stop(access.object, access.value);
  // A stop is sent even if the axis sends no heartbeats or has another object table.
  if (!axis_.present() && !stops) co_return MODBUS_NO_ANSWER;
  if (access.kind == MODBUS_READ) co_return co_await read(access.object, access.value);
  if (access.kind == MODBUS_READ_TEXT) {
    const ObjectAddress address{access.object, 0, 0, false};
    const canopen::SdoResult got = co_await axis_.modbus_port().read_bytes(address);
    text_.assign(got.data.begin(), got.data.end());
    access.text = text_.c_str();
    if (got.ok()) co_return FW_OK;
    co_return got.silent ? int{MODBUS_NO_ANSWER} : refusal_of(got.abort);
  }
  if (!axis_.writes_allowed() && !stops) co_return FW_ERROR_STATE;
  if (access.kind == MODBUS_WRITE) co_return co_await write(access.object, access.value);
  co_return co_await check(access.object, access.value, access.kind == MODBUS_CHECK_OWNER);
}

Task<void> ModbusAxis::serve(modbus::Pdu &pdu) {
  const auto length = static_cast<std::uint16_t>(pdu.size());
  pdu.resize(MODBUS_PDU_BYTES);
  ++counters_[MODBUS_COUNT_MESSAGES];
  modbus_request_t request;
  modbus_request_begin(&request, static_cast<std::uint8_t>(axis_.number()), pdu.data(), length,
                       counters_.data());
  while (!modbus_request_ended(&request)) {
    request.access.refusal = co_await carry_out(request.access);
    modbus_request_resume(&request);
  }
  pdu.resize(request.length);
}

}  // namespace forceaxis::nodes
