#include "host/lcm/command_message.hpp"

#include <algorithm>

namespace forceaxis::lcm_bus {
namespace {

// Reads the values of a message one after the other. If the message ends before a value, whole_
// becomes false, and this and all further values are 0.
class Reader {
 public:
  explicit Reader(std::span<const std::uint8_t> bytes) : left_(bytes) {}

  bool ended() const { return whole_ && left_.empty(); }
  bool whole() const { return whole_; }

  std::span<const std::uint8_t> bytes(std::size_t count) {
    whole_ = whole_ && count <= left_.size();
    if (!whole_) return {};
    const auto read = left_.first(count);
    left_ = left_.subspan(count);
    return read;
  }

  std::uint64_t number(std::size_t size) {
    std::uint64_t value = 0;
    for (const std::uint8_t byte : bytes(size)) value = value << 8 | byte;
    return value;
  }

  std::size_t count(std::int32_t most) {
    const auto value = static_cast<std::int32_t>(number(4));
    whole_ = whole_ && value >= 0 && value <= most;
    return whole_ ? static_cast<std::size_t>(value) : 0;
  }

  void name() {
    // Length of the text in bytes, including the final zero.
    const std::uint64_t length = number(4);
    whole_ = whole_ && length >= 1 && length <= kLongestName + 1;
    const auto text = bytes(whole_ ? length : 0);
    whole_ = whole_ && text.back() == 0 &&
             std::ranges::all_of(text.first(text.size() - 1),
                                 [](std::uint8_t c) { return c >= 0x20 && c < 0x7F; });
  }

 private:
  std::span<const std::uint8_t> left_;
  bool whole_ = true;
};

constexpr std::size_t kFirstNumbers = 9;  // number of fields at the begin of a command message,
                                          // from utime to timeout_us

bool is_command(std::span<const std::uint8_t> data) {
  Reader reader(data);
  if (reader.number(8) != static_cast<std::uint64_t>(axis_command_t::getHash())) return false;
  reader.bytes(kFirstNumbers * 8);
  const std::size_t items = reader.count(kMostItems);
  for (std::size_t i = 0; i < items && reader.whole(); ++i) reader.name();
  reader.bytes(items * 8);
  const std::size_t signals = reader.count(kMostSignals);
  for (std::size_t i = 0; i < signals && reader.whole(); ++i) reader.name();
  return reader.ended();
}

}  // namespace

std::optional<axis_command_t> decode_command(std::span<const std::uint8_t> data) {
  if (!is_command(data)) return std::nullopt;
  axis_command_t command;
  const int size = static_cast<int>(data.size());
  if (command.decode(data.data(), 0, size) != size) return std::nullopt;
  return command;
}

}  // namespace forceaxis::lcm_bus
