// Any datagrams of LCM from any senders: a message that comes of fragments is what one sender sent,
// piece by piece; a command that is decoded is, encoded again, the same bytes.
//
// The input is a row of datagrams: a byte for the sender and what is put in front (bits 0 and 1 the
// sender, bit 2 a header of fragments, bit 3 of a whole message, bit 4 the wanted channel, bit 5
// the start of a command), a byte for how many bytes follow (times 2), then these.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <set>
#include <vector>

#include "host/lcm/assembly.hpp"
#include "host/lcm/command_message.hpp"

using namespace forceaxis::lcm_bus;
using forceaxis::axis_command_t;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size);

namespace {

using Bytes = std::vector<std::uint8_t>;

struct Seen {
  Sender sender;
  std::uint32_t message, bytes, offset, number, fragments;
  Bytes data;
};

constexpr char kChannel[] = "AXIS_1_COMMAND";

void require(bool holds) {
  if (!holds) std::abort();
}

std::uint32_t word(const Bytes &bytes, std::size_t at, std::size_t count = 4) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < count; ++i) value = value * 256 + bytes[at + i];
  return value;
}

bool is_fragment(const Bytes &bytes) {
  return bytes.size() >= 20 && std::memcmp(bytes.data(), "LC03", 4) == 0;
}

Seen seen_of(Sender sender, const Bytes &bytes) {
  Seen seen{sender,
            word(bytes, 4),
            word(bytes, 8),
            word(bytes, 12),
            word(bytes, 16, 2),
            word(bytes, 18, 2),
            {}};
  std::size_t at = 20;
  if (seen.number == 0) {
    while (at < bytes.size() && bytes[at] != 0) ++at;
    ++at;
  }
  if (at <= bytes.size()) seen.data.assign(bytes.begin() + static_cast<long>(at), bytes.end());
  return seen;
}

// The message is one piece of each number, put end to end, all of them of the last one's sender.
void check_pieces(const std::vector<Seen> &all, const Message &message) {
  const Seen &last = all.back();
  require(message.data.size() == last.bytes);
  std::set<std::size_t> ends{0};  // of the pieces up to a number
  for (std::uint32_t number = 0; number < last.fragments; ++number) {
    std::set<std::size_t> next;
    for (const Seen &piece : all) {
      if (piece.sender == last.sender && piece.message == last.message &&
          piece.bytes == last.bytes && piece.fragments == last.fragments &&
          piece.number == number && ends.contains(piece.offset) &&
          piece.data.size() <= message.data.size() - piece.offset &&
          std::equal(piece.data.begin(), piece.data.end(), message.data.begin() + piece.offset)) {
        next.insert(piece.offset + piece.data.size());
      }
    }
    ends = std::move(next);
  }
  require(ends.contains(last.bytes));
}

void check_command(std::span<const std::uint8_t> data) {
  const auto command = decode_command(data);
  if (!command) return;
  require(command->object.size() == static_cast<std::size_t>(command->num_items));
  require(command->value.size() == command->object.size());
  Bytes again(static_cast<std::size_t>(command->getEncodedSize()));
  require(again.size() == data.size());
  require(command->encode(again.data(), 0, static_cast<int>(again.size())) ==
          static_cast<int>(again.size()));
  require(std::memcmp(again.data(), data.data(), data.size()) == 0);
}

Bytes command_start() {
  const axis_command_t empty{};
  Bytes bytes(static_cast<std::size_t>(empty.getEncodedSize()));
  empty.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  bytes.resize(bytes.size() - 8);  // up to its counts
  return bytes;
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
  static const Bytes start = command_start();
  Assembly assembly([](std::string_view channel) { return channel == kChannel; });
  std::vector<Seen> seen;
  while (size >= 2) {
    const std::uint8_t what = data[0];
    const std::size_t count = std::min<std::size_t>(data[1] * std::size_t{2}, size - 2);
    const Sender sender{0x7F000001, static_cast<std::uint16_t>(what & 3)};
    Bytes bytes;
    const std::uint8_t *own = data + 2;
    std::size_t left = count;
    if ((what & 4) != 0) {
      // Sizes, offsets and numbers are small, so that they often fit.
      bytes = {'L', 'C', '0', '3'};
      for (const int zeros : {3, 3, 3, 1, 1}) {
        bytes.insert(bytes.end(), static_cast<std::size_t>(zeros), 0);
        bytes.push_back(left > 0 ? *own : 0);
        if (left > 0) ++own, --left;
      }
    } else if ((what & 8) != 0) {
      bytes = {'L', 'C', '0', '2', 0, 0, 0, 1};
    }
    if ((what & 16) != 0) bytes.insert(bytes.end(), kChannel, kChannel + sizeof kChannel);
    if ((what & 32) != 0) bytes.insert(bytes.end(), start.begin(), start.end());
    bytes.insert(bytes.end(), own, own + left);
    data += 2 + count;
    size -= 2 + count;

    if (is_fragment(bytes)) seen.push_back(seen_of(sender, bytes));
    const auto message = assembly.take(sender, bytes);
    (void)channel_of(bytes);
    if (!message) continue;
    require(message->channel == kChannel && message->data.size() <= Assembly::kMostBytes);
    if (is_fragment(bytes)) check_pieces(seen, *message);
    check_command(message->data);
  }
  return 0;
}
