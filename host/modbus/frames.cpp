#include "host/modbus/frames.hpp"

#include <algorithm>

namespace forceaxis::modbus {
namespace {

// Sizes of the header in bytes. The header has transaction, protocol (0) and length with 16 bits
// each, then the unit. The length is the number of bytes after the length field.
constexpr std::size_t kHeader = 7, kBeforeLength = 6;
constexpr std::size_t kLeast = 2, kMost = 254;

}  // namespace

void FrameBuffer::append(std::span<const std::uint8_t> bytes) {
  bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
}

std::size_t FrameBuffer::length() const {
  if (bytes_.size() < kBeforeLength) return 0;
  return static_cast<std::size_t>(bytes_[4]) << 8 | bytes_[5];
}

bool FrameBuffer::broken() const {
  // Bytes 2 and 3 show that the client uses another protocol, even before the complete header has
  // arrived.
  const bool other = (bytes_.size() > 2 && bytes_[2] != 0) || (bytes_.size() > 3 && bytes_[3] != 0);
  const bool sized = bytes_.size() >= kBeforeLength;
  return other || (sized && (length() < kLeast || length() > kMost)) || bytes_.size() > kMostBytes;
}

std::optional<Request> FrameBuffer::take() {
  if (broken() || length() == 0 || bytes_.size() < kBeforeLength + length()) return std::nullopt;
  const auto end = bytes_.begin() + static_cast<std::ptrdiff_t>(kBeforeLength + length());
  Request request{{{bytes_[0], bytes_[1]}, bytes_[kHeader - 1]}, {}};
  request.pdu.assign(bytes_.begin() + static_cast<std::ptrdiff_t>(kHeader), end);
  bytes_.erase(bytes_.begin(), end);
  return request;
}

std::vector<std::uint8_t> frame_of(const Header &header, std::span<const std::uint8_t> pdu) {
  const std::size_t length = pdu.size() + kHeader - kBeforeLength;
  std::vector<std::uint8_t> frame(kHeader + pdu.size());
  std::ranges::copy(header.transaction, frame.begin());
  frame[4] = static_cast<std::uint8_t>(length >> 8);
  frame[5] = static_cast<std::uint8_t>(length);
  frame[6] = header.unit;
  std::ranges::copy(pdu, frame.begin() + kHeader);
  return frame;
}

}  // namespace forceaxis::modbus
