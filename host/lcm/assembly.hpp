#pragma once
// Assembles LCM messages from UDP datagrams. A datagram "LC02" contains a complete message, a
// datagram "LC03" contains a fragment of a message. The class has no socket and no clock. For any
// content of the datagrams, the only exception is std::bad_alloc, and at most kMostSenders messages
// of kMostBytes are kept in memory.
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace forceaxis::lcm_bus {

// Address and port of the sender in host byte order. Fragments of different senders belong to
// different messages.
struct Sender {
  std::uint32_t address;
  std::uint16_t port;
  bool operator==(const Sender &) const = default;
};

// A message, which is valid as long as the datagram exists, and at most until the next call of
// take().
struct Message {
  std::string_view channel;
  std::span<const std::uint8_t> data;
};

class Assembly {
 public:
  // Largest length of a message in bytes.
  static constexpr std::size_t kMostBytes = std::size_t{1} << 20;
  // Largest number of senders that can have an incomplete message.
  static constexpr std::size_t kMostSenders = 8;

  // `wanted` returns true if messages on a channel are assembled and counted. Messages on other
  // channels are ignored.
  explicit Assembly(std::function<bool(std::string_view channel)> wanted)
      : wanted_(std::move(wanted)) {}

  // Returns the message that a datagram contains or completes. Returns nothing if no message is
  // complete. Fragments must arrive in order. A repeated fragment is ignored.
  std::optional<Message> take(Sender sender, std::span<const std::uint8_t> datagram);

  // Returns the number of invalid inputs: datagrams that are not LCM, messages that are too large,
  // and messages whose fragments contradict each other.
  std::uint64_t malformed() const { return malformed_; }
  // Returns the number of messages with a missing fragment.
  std::uint64_t incomplete() const { return incomplete_; }

 private:
  struct Fragment;
  struct Partial {
    Sender sender;
    std::uint32_t number, bytes, fragments, next;
    std::string channel;
    std::vector<std::uint8_t> data;
  };

  std::optional<Message> whole(std::span<const std::uint8_t> rest);
  std::optional<Message> add(Sender sender, const Fragment &fragment);
  std::optional<Message> extend(std::vector<Partial>::iterator partial, const Fragment &fragment);
  void begin(Sender sender, const Fragment &fragment, std::string_view channel);
  std::optional<Message> malformed_message();

  std::function<bool(std::string_view)> wanted_;
  // Incomplete messages, sorted by age with the oldest message first. Each sender has at most one
  // incomplete message.
  std::vector<Partial> partials_;
  Partial complete_;
  std::uint64_t malformed_ = 0, incomplete_ = 0;
};

// Returns the channel name in a datagram. Returns an empty text for a fragment that is not the
// first fragment of a message. The datagram may be truncated after the channel name.
std::string_view channel_of(std::span<const std::uint8_t> datagram);

}  // namespace forceaxis::lcm_bus
