#pragma once
// The buses of axis_node: sockets and devices on one side, the firmware's passive protocols on the
// other. Nothing here waits: frames and bytes are received before a tick and sent after it.
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "firmware/port/host/axis_host.h"
#include "host/canopen/can_socket.hpp"

namespace forceaxis::nodes {

// One axis's own socket on a CAN interface, so that axes of one process receive each other's frames
// as nodes of a bus do. Only classic frames with 11-bit identifiers are passed on.
class CanPort {
 public:
  // Throws canopen::CanError if there is no such interface or it is down.
  explicit CanPort(const std::string &interface);

  struct Handlers {
    std::function<void(const can_frame_t &)> frame;
    std::function<void(std::uint16_t)> lost;  // frames that the kernel had to drop
    std::function<void(std::uint8_t)> state;  // CAN_BUS_, at a change
  };
  // Passes on pending frames, at most 64, and changes of the interface's state; never waits.
  void receive(const Handlers &handlers);

  // Whether the interface is down.
  bool is_off() const { return state_ == CAN_BUS_OFF; }

  // False: the interface did not accept the frame, because its queue is full or it is down.
  bool send(const can_frame_t &frame);

 private:
  void set_state(std::uint8_t state, const Handlers &handlers);

  canopen::CanSocket socket_;
  std::uint8_t state_ = CAN_BUS_ACTIVE;
  unsigned calls_ = 0;
};

// The serial line, one for all axes of the process: 8 data bits, even parity.
class ModbusPort {
 public:
  // `baud` in bit/s: 9600, 19200, 38400, 57600, 115200 or 230400; any other leaves the line's own.
  // Throws TransportError if the device cannot be opened or is no serial line.
  ModbusPort(const std::string &device, int baud);
  ModbusPort(const ModbusPort &) = delete;
  ModbusPort &operator=(const ModbusPort &) = delete;
  ~ModbusPort();

  // The bytes received since the last call, possibly none.
  std::span<const std::uint8_t> receive();
  // Sends what the device accepts now; the bytes beyond that are lost, as on a line.
  void send(std::span<const std::uint8_t> bytes);

 private:
  int device_;
  std::vector<std::uint8_t> buffer_;
};

}  // namespace forceaxis::nodes
