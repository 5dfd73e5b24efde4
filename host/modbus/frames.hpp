#pragma once
// Frames of Modbus TCP (MBAP). These functions convert bytes of a TCP stream to requests, and
// answers to bytes, but do not access sockets.
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace forceaxis::modbus {

// A Modbus protocol data unit: function code and data, without unit and length.
using Pdu = std::vector<std::uint8_t>;

// The header fields of a request that are repeated in the answer.
struct Header {
  std::array<std::uint8_t, 2> transaction;
  std::uint8_t unit;
};

struct Request {
  Header header;
  Pdu pdu;  // protocol data unit, 1 to 253 bytes
};

// The bytes that one client has sent and that are not yet processed.
class FrameBuffer {
 public:
  // Largest number of bytes in the buffer. A client can exceed this number if it sends requests
  // without reading the responses.
  static constexpr std::size_t kMostBytes = 65536;

  void append(std::span<const std::uint8_t> bytes);
  // Removes the first request from the buffer and returns the request. Returns nothing if the first
  // request is not complete.
  std::optional<Request> take();
  // Returns true if the first header is not valid, so that the next frame cannot be found, or if
  // the buffer has more than kMostBytes bytes.
  bool broken() const;
  bool empty() const { return bytes_.empty(); }

 private:
  // Returns the number of bytes after the length field of the first frame. Returns 0 if this number
  // is not yet known or not valid.
  std::size_t length() const;

  std::vector<std::uint8_t> bytes_;
};

// Returns the frame with an answer for a client. `pdu` has 1 to 253 bytes.
std::vector<std::uint8_t> frame_of(const Header &header, std::span<const std::uint8_t> pdu);

}  // namespace forceaxis::modbus
