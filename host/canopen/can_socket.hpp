#pragma once
// A raw SocketCAN interface that never blocks: frames in, frames out, and what was lost.
#include <array>
#include <cstdint>
#include <deque>
#include <optional>
#include <stdexcept>
#include <string>

namespace forceaxis::canopen {

// No CAN, no such interface, or it is down: the text says what to do.
struct CanError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// A data frame with an 11-bit identifier.
struct Frame {
  std::uint32_t id = 0;
  std::uint8_t length = 0;
  std::array<std::uint8_t, 8> data{};
};

class CanSocket {
 public:
  explicit CanSocket(const std::string &interface);
  ~CanSocket();
  CanSocket(const CanSocket &) = delete;
  CanSocket &operator=(const CanSocket &) = delete;

  int fd() const { return fd_; }

  // Sends at once, or when there is room again: see flush().
  void send(const Frame &frame);
  bool waits_for_room() const { return !waiting_.empty(); }
  void flush();

  // The next data frame; nothing when there is none. Remote and extended frames are passed over.
  std::optional<Frame> receive();

  // What went wrong since the last call, in words; empty: nothing. `lost` counts frames.
  struct Trouble {
    std::string text;
    std::uint64_t lost = 0;
  };
  Trouble take_trouble();

 private:
  void note(const std::string &text);

  std::string interface_;
  int fd_ = -1;
  std::deque<Frame> waiting_;
  std::uint32_t dropped_ = 0;  // as the kernel counts them, wraps
  Trouble trouble_;
};

}  // namespace forceaxis::canopen
