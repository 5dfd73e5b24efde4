#pragma once
// The gateway's end of a CAN interface, which never blocks: data frames in, frames out in their
// order, and what was lost.
#include <cstdint>
#include <deque>
#include <optional>
#include <string>

#include "host/canopen/can_socket.hpp"
#include "host/canopen/frame.hpp"

namespace forceaxis::nodes {

class CanQueue {
 public:
  // Throws canopen::CanError.
  explicit CanQueue(const std::string &interface);

  int fd() const { return socket_.fd(); }

  // Sends at once, or when there is room again: see flush().
  void send(const canopen::Frame &frame);
  bool waits_for_room() const { return !waiting_.empty(); }
  void flush();

  // The next data frame; nothing when there is none. Remote and extended frames are passed over.
  std::optional<canopen::Frame> receive();

  // What went wrong since the last call, in words; empty: nothing. `lost` counts frames.
  struct Trouble {
    std::string text;
    std::uint64_t lost = 0;
  };
  Trouble take_trouble();

 private:
  void note(const std::string &text);

  canopen::CanSocket socket_;
  std::deque<canopen::Frame> waiting_;
  Trouble trouble_;
};

}  // namespace forceaxis::nodes
