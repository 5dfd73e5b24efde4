#include "host/lcm/assembly.hpp"

#include <algorithm>

namespace forceaxis::lcm_bus {
namespace {

using Bytes = std::span<const std::uint8_t>;

// Magic numbers "LC02" and "LC03".
constexpr std::uint32_t kWhole = 0x4C433032, kFragment = 0x4C433033;
constexpr std::size_t kWholeHeader = 8, kFragmentHeader = 20;
constexpr std::size_t kLongestChannel = 63;

std::uint32_t number_at(Bytes bytes, std::size_t at, int size = 4) {
  std::uint32_t number = 0;
  for (int i = 0; i < size; ++i) number = number << 8 | bytes[at + static_cast<std::size_t>(i)];
  return number;
}

// Returns the channel name at the start of `bytes`. Returns nothing if the final zero of the name
// is missing.
std::optional<std::string_view> leading_channel(Bytes bytes) {
  const Bytes searched = bytes.first(std::min(bytes.size(), kLongestChannel + 1));
  const auto zero = std::ranges::find(searched, 0);
  if (zero == searched.end() || zero == searched.begin()) return std::nullopt;
  return std::string_view(reinterpret_cast<const char *>(bytes.data()),
                          static_cast<std::size_t>(zero - searched.begin()));
}

}  // namespace

struct Assembly::Fragment {
  std::uint32_t message, bytes, offset, number, fragments;
  Bytes data;
};

std::string_view channel_of(Bytes datagram) {
  if (datagram.size() < kWholeHeader) return {};
  std::size_t header = kWholeHeader;
  if (number_at(datagram, 0) == kFragment) {
    header = kFragmentHeader;
    if (datagram.size() < header || number_at(datagram, 16, 2) != 0) return {};
  } else if (number_at(datagram, 0) != kWhole) {
    return {};
  }
  return leading_channel(datagram.subspan(header)).value_or(std::string_view());
}

std::optional<Message> Assembly::malformed_message() {
  ++malformed_;
  return std::nullopt;
}

std::optional<Message> Assembly::take(Sender sender, Bytes datagram) {
  if (datagram.size() < kWholeHeader) return malformed_message();
  const std::uint32_t magic = number_at(datagram, 0);
  if (magic == kWhole) return whole(datagram.subspan(kWholeHeader));
  if (magic != kFragment || datagram.size() < kFragmentHeader) return malformed_message();
  return add(sender, {number_at(datagram, 4), number_at(datagram, 8), number_at(datagram, 12),
                      number_at(datagram, 16, 2), number_at(datagram, 18, 2),
                      datagram.subspan(kFragmentHeader)});
}

std::optional<Message> Assembly::whole(Bytes rest) {
  const auto channel = leading_channel(rest);
  if (!channel) return malformed_message();
  if (!wanted_(*channel)) return std::nullopt;
  return Message{*channel, rest.subspan(channel->size() + 1)};
}

std::optional<Message> Assembly::add(Sender sender, const Fragment &fragment) {
  const auto partial = std::ranges::find(partials_, sender, &Partial::sender);
  const bool known = partial != partials_.end() && partial->number == fragment.message;
  if (fragment.number != 0) {
    // A message is unknown if its channel is not wanted or if its first fragment was lost.
    return known ? extend(partial, fragment) : std::nullopt;
  }
  const auto channel = leading_channel(fragment.data);
  if (!channel) return malformed_message();
  if (!wanted_(*channel)) return std::nullopt;
  Fragment first = fragment;
  first.data = first.data.subspan(channel->size() + 1);
  if (known && partial->channel == *channel) return extend(partial, first);
  if (partial != partials_.end()) {
    ++incomplete_;
    partials_.erase(partial);
  }
  if (first.fragments == 0 || first.bytes > kMostBytes) return malformed_message();
  begin(sender, first, *channel);
  return extend(partials_.end() - 1, first);
}

void Assembly::begin(Sender sender, const Fragment &fragment, std::string_view channel) {
  if (partials_.size() == kMostSenders) {
    ++incomplete_;
    partials_.erase(partials_.begin());
  }
  partials_.push_back(
      {sender, fragment.message, fragment.bytes, fragment.fragments, 0, std::string(channel), {}});
}

// Allocates memory for received data and not for the length in a header, so the memory for a sender
// is never larger than the data that the sender has sent.
std::optional<Message> Assembly::extend(std::vector<Partial>::iterator partial,
                                        const Fragment &fragment) {
  std::vector<std::uint8_t> &held = partial->data;
  const auto drop = [&](std::uint64_t &count) {
    ++count;
    partials_.erase(partial);
    return std::nullopt;
  };
  if (fragment.bytes != partial->bytes || fragment.fragments != partial->fragments ||
      fragment.number >= partial->fragments || fragment.offset > partial->bytes ||
      fragment.data.size() > partial->bytes - fragment.offset) {
    return drop(malformed_);
  }
  if (fragment.number < partial->next) {
    const bool repeated =
        fragment.offset + fragment.data.size() <= held.size() &&
        std::ranges::equal(fragment.data,
                           Bytes(held).subspan(fragment.offset, fragment.data.size()));
    if (!repeated) return drop(malformed_);
    return std::nullopt;
  }
  if (fragment.number > partial->next) return drop(incomplete_);
  if (fragment.offset != held.size()) return drop(malformed_);
  held.insert(held.end(), fragment.data.begin(), fragment.data.end());
  if (++partial->next < partial->fragments) return std::nullopt;
  if (held.size() != partial->bytes) return drop(malformed_);
  complete_ = std::move(*partial);
  partials_.erase(partial);
  return Message{complete_.channel, complete_.data};
}

}  // namespace forceaxis::lcm_bus
