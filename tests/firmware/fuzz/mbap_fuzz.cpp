// Any bytes of Modbus TCP, in whatever pieces: the requests are those that a parser of the whole
// stream finds, up to the first header that is not valid; and whatever is asked of a unit that is
// no axis, the answer is one frame with the header of its request.
//
// The input is a row of records: a byte says how many bytes follow (bits 0 to 5), whether a valid
// header is put in front of them (bit 7; the first of them is the unit), and whether they come one
// by one (bit 6).
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <span>
#include <vector>

#include "host/gateway/modbus_self.hpp"
#include "host/modbus/frames.hpp"

using namespace forceaxis::modbus;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size);

namespace {

using Bytes = std::vector<std::uint8_t>;

void require(bool holds) {
  if (!holds) std::abort();
}

// The frames of a stream, and whether a header in it is not valid.
struct Parsed {
  std::vector<Bytes> frames;
  bool broken = false;
};

Parsed parsed(const Bytes &stream) {
  Parsed found;
  for (std::size_t at = 0;;) {
    const std::size_t left = stream.size() - at;
    found.broken = (left > 2 && stream[at + 2] != 0) || (left > 3 && stream[at + 3] != 0);
    if (found.broken || left < 6) return found;
    const std::size_t length = stream[at + 4] * std::size_t{256} + stream[at + 5];
    found.broken = length < 2 || length > 254;
    if (found.broken || left < 6 + length) return found;
    const auto begin = stream.begin() + static_cast<std::ptrdiff_t>(at);
    found.frames.emplace_back(begin, begin + static_cast<std::ptrdiff_t>(6 + length));
    at += 6 + length;
  }
}

void check_answer(forceaxis::nodes::ModbusSelf &self, const Request &request) {
  Pdu answer = request.pdu;
  self.serve(request.header.unit, answer);
  require(!answer.empty() && answer.size() <= 253 && (answer[0] & 0x7F) == (request.pdu[0] & 0x7F));
  if (request.header.unit != 0 && request.header.unit != 255) {
    require(answer.size() == 2 && answer[0] >= 0x80 && answer[1] == 10);
  }
  const Bytes frame = frame_of(request.header, answer);
  const Parsed again = parsed(frame);
  require(!again.broken && again.frames.size() == 1 && again.frames[0] == frame);
  require(std::equal(request.header.transaction.begin(), request.header.transaction.end(),
                     frame.begin()) &&
          frame[6] == request.header.unit);
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  forceaxis::nodes::ModbusSelf self;
  FrameBuffer buffer;
  Bytes stream;
  std::vector<Bytes> taken;
  const auto receive = [&](std::span<const std::uint8_t> piece) {
    stream.insert(stream.end(), piece.begin(), piece.end());
    buffer.append(piece);
    while (const auto request = buffer.take()) {
      require(!request->pdu.empty() && request->pdu.size() <= 253);
      taken.push_back(frame_of(request->header, request->pdu));
      check_answer(self, *request);
    }
  };
  while (size > 0 && !buffer.broken()) {
    const std::uint8_t what = data[0];
    const std::size_t count = std::min<std::size_t>(what & 0x3F, size - 1);
    Bytes piece;
    if ((what & 0x80) != 0) {
      piece = {what, static_cast<std::uint8_t>(size), 0, 0, 0, static_cast<std::uint8_t>(count)};
    }
    piece.insert(piece.end(), data + 1, data + 1 + count);
    data += 1 + count;
    size -= 1 + count;
    if ((what & 0x40) == 0) {
      receive(piece);
    } else {
      for (const std::uint8_t &byte : piece) receive({&byte, 1});
    }
  }
  const Parsed expected = parsed(stream);
  require(taken == expected.frames && buffer.broken() == expected.broken);
  return 0;
}
