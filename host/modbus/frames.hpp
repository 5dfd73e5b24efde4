#pragma once
// Frames of Modbus TCP (MBAP): bytes of a stream in, requests out, answers as bytes. Passive.
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace forceaxis::modbus {

// A protocol data unit: function code and data, without unit and length.
using Pdu = std::vector<std::uint8_t>;

// What an answer repeats of its request.
struct Header {
  std::array<std::uint8_t, 2> transaction;
  std::uint8_t unit;
};

struct Request {
  Header header;
  Pdu pdu;  // 1 to 253 bytes
};

// The bytes of one client that were not taken out yet.
class FrameBuffer {
 public:
  // A client that goes on sending requests without reading the responses has more.
  static constexpr std::size_t kMostBytes = 65536;

  void append(std::span<const std::uint8_t> bytes);
  // The first request, if it is complete.
  std::optional<Request> take();
  // Without a valid header the next frame cannot be located, and beyond kMostBytes none is wanted.
  bool broken() const;
  bool empty() const { return bytes_.empty(); }

 private:
  // Bytes of the first frame behind its length field; 0: not known yet, or not valid.
  std::size_t length() const;

  std::vector<std::uint8_t> bytes_;
};

// An answer of 1 to 253 bytes.
std::vector<std::uint8_t> frame_of(const Header &header, std::span<const std::uint8_t> pdu);

}  // namespace forceaxis::modbus
