#pragma once
// Messages of LCM's wire format out of datagrams: "LC02" holds a whole one, "LC03" one fragment.
// Owns no socket and no clock. Whatever the datagrams hold, nothing is thrown but std::bad_alloc,
// and at most kMostSenders messages of kMostBytes are kept.
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace forceaxis::lcm_bus {

// Address and port, as numbers of this machine: fragments of different senders are different
// messages'.
struct Sender {
  std::uint32_t address;
  std::uint16_t port;
  bool operator==(const Sender &) const = default;
};

// Valid as long as the datagram, and until the assembly takes the next one.
struct Message {
  std::string_view channel;
  std::span<const std::uint8_t> data;
};

class Assembly {
 public:
  static constexpr std::size_t kMostBytes = std::size_t{1} << 20;  // data of one message
  static constexpr std::size_t kMostSenders = 8;                   // with a message under way

  // Messages on channels that are not wanted are neither assembled nor counted.
  explicit Assembly(std::function<bool(std::string_view channel)> wanted)
      : wanted_(std::move(wanted)) {}

  // The wanted message that this datagram is or completes. Fragments count in order; one that
  // repeats what is held already is ignored.
  std::optional<Message> take(Sender sender, std::span<const std::uint8_t> datagram);

  // Datagrams that are no LCM, and messages whose fragments contradict each other or are too large.
  std::uint64_t malformed() const { return malformed_; }
  // Messages of which a fragment did not come.
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
  std::vector<Partial> partials_;  // at most one a sender, the oldest first
  Partial complete_;
  std::uint64_t malformed_ = 0, incomplete_ = 0;
};

// The channel of a datagram that has one, which is not a later fragment's; else empty. Of a
// datagram that is cut off, the channel may be all there is.
std::string_view channel_of(std::span<const std::uint8_t> datagram);

}  // namespace forceaxis::lcm_bus
