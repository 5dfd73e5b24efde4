#pragma once
// The buses of axis_node. They connect sockets and devices to the protocols of the firmware. No
// function waits: frames and bytes are received before a tick and sent after it.
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "firmware/port/host/axis_host.h"
#include "host/canopen/can_socket.hpp"

namespace forceaxis::nodes {

// The socket of one axis on a CAN interface. Each axis has its own socket, so that the axes of one
// process receive each other's frames like the nodes of a bus. Only classic frames with 11-bit
// identifiers are passed to the firmware.
class CanPort {
 public:
  // Opens the socket. Throws canopen::CanError if the interface does not exist or is down.
  explicit CanPort(const std::string &interface);

  struct Handlers {
    std::function<void(const can_frame_t &)> frame;
    // Called with the number of frames that the kernel has dropped.
    std::function<void(std::uint16_t)> lost;
    // Called with the new state of the interface, CAN_BUS_, after a change.
    std::function<void(std::uint8_t)> state;
  };
  // Passes at most 64 pending frames, and changes of the interface's state, to the handlers. Does
  // not wait.
  void receive(const Handlers &handlers);

  // Returns whether the interface is down.
  bool is_off() const { return state_ == CAN_BUS_OFF; }

  // Returns false if the interface did not accept the frame, because its queue is full or it is
  // down.
  bool send(const can_frame_t &frame);

 private:
  void set_state(std::uint8_t state, const Handlers &handlers);

  canopen::CanSocket socket_;
  std::uint8_t state_ = CAN_BUS_ACTIVE;
  unsigned calls_ = 0;
};

// The serial line of all axes of the process: 8 data bits, even parity.
class ModbusPort {
 public:
  // Opens the device. `baud` is 9600, 19200, 38400, 57600, 115200 or 230400 bit/s; with any other
  // value the rate of the device does not change. Throws TransportError if the device cannot be
  // opened or is not a serial line.
  ModbusPort(const std::string &device, int baud);
  ModbusPort(const ModbusPort &) = delete;
  ModbusPort &operator=(const ModbusPort &) = delete;
  ~ModbusPort();

  // Returns the bytes received since the last call, which may be none.
  std::span<const std::uint8_t> receive();
  // Sends the bytes that the device accepts now. The other bytes are lost, as on a serial line.
  void send(std::span<const std::uint8_t> bytes);

 private:
  int device_;
  std::vector<std::uint8_t> buffer_;
};

}  // namespace forceaxis::nodes
