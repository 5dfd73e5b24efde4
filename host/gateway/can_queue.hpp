#pragma once
// The connection of the gateway to a CAN interface. The class receives data frames, sends frames in
// their order, and reports lost frames. No function blocks.
#include <cstdint>
#include <deque>
#include <optional>
#include <string>

#include "host/canopen/can_socket.hpp"
#include "host/canopen/frame.hpp"

namespace forceaxis::nodes {

class CanQueue {
 public:
  // Opens the CAN interface. Throws canopen::CanError.
  explicit CanQueue(const std::string &interface);

  int fd() const { return socket_.fd(); }

  // Sends a frame immediately. If the queue of the interface is full, the frame is stored until
  // flush() is called.
  void send(const canopen::Frame &frame);
  bool waits_for_room() const { return !waiting_.empty(); }
  void flush();

  // Returns the next received data frame, or nothing if no frame is pending. Remote frames and
  // extended frames are ignored.
  std::optional<canopen::Frame> receive();

  // Problems since the last call of take_trouble(). `text` describes a problem and is empty if
  // there was no problem. `lost` is the number of lost frames.
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
