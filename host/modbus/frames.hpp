#pragma once
// Frames of Modbus TCP (MBAP). These functions convert bytes of a stream to requests, and answers
// to bytes. They do not read or write sockets.
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace forceaxis::modbus {

// A protocol data unit: function code and data, without unit and length.
using Pdu = std::vector<std::uint8_t>;

// The fields of a request that its answer repeats.
struct Header {
  std::array<std::uint8_t, 2> transaction;
  std::uint8_t unit;
};

struct Request {
  Header header;
  Pdu pdu;  // 1 to 253 bytes
};

// The received bytes of one client that are not yet processed.
class FrameBuffer {
 public:
  // Limit for a client that sends requests without reading the responses, in bytes.
  static constexpr std::size_t kMostBytes = 65536;

  void append(std::span<const std::uint8_t> bytes);
  // Removes and returns the first request, or nothing if it is not complete.
  std::optional<Request> take();
  // Returns true if the stream has no valid header, so that the next frame cannot be found, or if
  // it has more than kMostBytes bytes.
  bool broken() const;
  bool empty() const { return bytes_.empty(); }

 private:
  // Returns the number of bytes after the length field of the first frame; 0 if the length is not
  // yet known or not valid.
  std::size_t length() const;

  std::vector<std::uint8_t> bytes_;
};

// Returns the frame of an answer. `pdu` has 1 to 253 bytes.
std::vector<std::uint8_t> frame_of(const Header &header, std::span<const std::uint8_t> pdu);

}  // namespace forceaxis::modbus
