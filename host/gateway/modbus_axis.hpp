#pragma once
// Modbus requests of one axis, carried out over SDO: the map, order and exceptions of the
// firmware's own RTU server (firmware/modbus/map.h).
//
// Each object is read afresh when it is asked for, one after the other: a 32-bit value is never
// torn, but the values of one request come from consecutive ticks, about one object a millisecond.
// A request that writes several objects is all or none as long as no other client writes the same
// ones: those before the first refusal are given their previous values again.
#include "host/gateway/object_port.hpp"
#include "host/modbus/request.hpp"

namespace forceaxis::nodes {

class ModbusAxis {
 public:
  explicit ModbusAxis(ObjectPort port) : port_(port) {}

  // `writes_allowed`: false while the axis has another object table.
  Task<modbus::Answer> serve(modbus::Request &request, bool writes_allowed);

 private:
  struct Write {
    std::uint16_t object;
    std::int64_t value;
    std::int64_t previous = 0;
  };
  struct Coils;

  Task<std::uint8_t> read_words(bool holding, std::uint16_t first, std::uint16_t count,
                                std::vector<std::uint16_t> &words);
  Task<std::uint8_t> write_words(std::uint16_t first, const std::vector<std::uint16_t> &words);
  Task<std::uint8_t> write_all(std::vector<Write> &writes);
  Task<std::uint8_t> read_bits(bool coils, std::uint16_t first, std::uint16_t count,
                               std::vector<bool> &bits);
  Task<std::uint8_t> write_coils(std::uint16_t first, const std::vector<bool> &bits);
  Task<std::uint8_t> enable(std::int64_t halt);

  // Of an object: its value, or an exception.
  Task<std::uint8_t> read(std::uint16_t object, std::int64_t &value);
  Task<std::uint8_t> write(std::uint16_t object, std::int64_t value);

  ObjectPort port_;
};

}  // namespace forceaxis::nodes
