#include "host/gateway/object_port.hpp"

#include <algorithm>

#include "host/run/objects.hpp"

namespace forceaxis::nodes {

ObjectAddress address_of(std::uint16_t object) {
  const axis_object_meta_t &meta = host::object_meta(object);
  return {meta.index, meta.sub, static_cast<std::uint8_t>(meta.size_bytes), meta.type[0] == 'i'};
}

std::int64_t value_of(std::span<const std::uint8_t> bytes, bool is_signed) {
  std::uint64_t value = 0;
  const std::size_t count = std::min<std::size_t>(bytes.size(), 8);
  for (std::size_t i = 0; i < count; ++i) value |= static_cast<std::uint64_t>(bytes[i]) << (8 * i);
  if (is_signed && count > 0 && count < 8 && (bytes[count - 1] & 0x80) != 0) {
    value |= ~std::uint64_t{0} << (8 * count);
  }
  return static_cast<std::int64_t>(value);
}

std::vector<std::uint8_t> bytes_of(std::int64_t value, std::uint8_t bytes) {
  std::vector<std::uint8_t> out;
  for (int i = 0; i < bytes; ++i) {
    out.push_back(static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> (8 * i)));
  }
  return out;
}

bool fits(std::int64_t value, const ObjectAddress &address) {
  const std::int64_t span = std::int64_t{1} << (8 * address.bytes);
  return address.is_signed ? value >= -span / 2 && value < span / 2 : value >= 0 && value < span;
}

Task<ObjectResult> ObjectPort::read(ObjectAddress address) {
  const canopen::SdoResult got = co_await channel_.upload(address.index, address.sub);
  ObjectResult result{got.abort, got.silent, 0};
  if (!got.ok()) co_return result;
  // If the length is not the expected length, the object tables of axis and gateway differ.
  if (got.data.size() > 8 || (address.bytes != 0 && got.data.size() != address.bytes)) {
    result.abort = canopen::kAbortLength;
    co_return result;
  }
  result.value = value_of(got.data, address.is_signed);
  co_return result;
}

Task<ObjectResult> ObjectPort::write(ObjectAddress address, std::int64_t value) {
  std::vector<std::uint8_t> data = bytes_of(value, address.bytes);
  const canopen::SdoResult got = co_await channel_.download(address.index, address.sub, data);
  co_return ObjectResult{got.abort, got.silent, value};
}

}  // namespace forceaxis::nodes
