#pragma once
// Reads and writes the raw values of the objects of one axis through one SDO channel.
#include <cstdint>
#include <string>

#include "host/gateway/sdo_channel.hpp"

namespace forceaxis::nodes {

struct ObjectResult {
  std::uint32_t abort = 0;  // SDO abort code of the access; 0: no error
  bool silent = false;      // true: no answer has arrived
  std::int64_t value = 0;   // raw value that was read from the object of the axis

  bool ok() const { return abort == 0; }
};

// Index, sub-index, length and sign of an object.
struct ObjectAddress {
  std::uint16_t index = 0;
  std::uint8_t sub = 0;
  std::uint8_t bytes = 0;  // length of the value in bytes; 0: not known
  bool is_signed = false;
};

ObjectAddress address_of(std::uint16_t object);

// Returns the integer in up to eight little-endian bytes. Further bytes are ignored.
std::int64_t value_of(std::span<const std::uint8_t> bytes, bool is_signed);
std::vector<std::uint8_t> bytes_of(std::int64_t value, std::uint8_t bytes);
// Returns true if a value is in the range of the integer type of the object.
bool fits(std::int64_t value, const ObjectAddress &address);

class ObjectPort {
 public:
  explicit ObjectPort(SdoChannel &channel) : channel_(channel) {}

  Task<ObjectResult> read(std::uint16_t object) { return read(address_of(object)); }
  Task<ObjectResult> write(std::uint16_t object, std::int64_t value) {
    return write(address_of(object), value);
  }
  Task<ObjectResult> read(ObjectAddress address);
  Task<ObjectResult> write(ObjectAddress address, std::int64_t value);
  // Reads an object with a value of any length, such as a text.
  Task<canopen::SdoResult> read_bytes(ObjectAddress address) {
    return channel_.upload(address.index, address.sub);
  }

 private:
  SdoChannel &channel_;
};

}  // namespace forceaxis::nodes
