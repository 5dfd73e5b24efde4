#pragma once
// The buses of axis_node connect CAN sockets and serial devices to the protocols of the firmware.
// Frames and bytes are received before a tick and sent after the tick. No function waits.
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "firmware/port/host/axis_host.h"
#include "firmware/port/linux/can_line.h"

namespace forceaxis::nodes {

// The socket of one axis on a CAN interface. Each axis has its own socket, so each axis receives
// the frames of all other axes, like the nodes on a bus. Only classic CAN frames with 11-bit
// identifiers are passed to the firmware. can_line.h says when a bus is off and when it is back.
class CanPort {
 public:
  CanPort(const CanPort &) = delete;
  CanPort &operator=(const CanPort &) = delete;
  ~CanPort();

  // Opens the CAN socket. Throws canopen::CanError if the interface does not exist or is down.
  explicit CanPort(const std::string &interface);

  struct Handlers {
    std::function<void(const can_frame_t &)> frame;
    // Function that is called with the number of received frames that the kernel has dropped.
    std::function<void(std::uint16_t)> lost;
    // Function that is called with the new state (CAN_BUS_) of the interface after a change.
    std::function<void(std::uint8_t)> state;
  };
  // Passes at most 64 pending frames and the changes of the interface's state to the handlers.
  void receive(const Handlers &handlers);

  // Returns true if the interface is down or its controller is bus off.
  bool is_off() const { return state_ == CAN_BUS_OFF; }

  // Sends a frame. Returns false if the interface did not accept the frame, because the queue is
  // full or the bus is off.
  bool send(const can_frame_t &frame);

 private:
  void tell_state(const Handlers &handlers);

  can_line_t line_{};
  std::uint8_t state_ = CAN_BUS_ACTIVE;
};

// The serial line of all axes of the process: 8 data bits, even parity.
class ModbusPort {
 public:
  // Opens the serial device. `baud` is 9600, 19200, 38400, 57600, 115200 or 230400 bit/s. With any
  // other value, the rate of the device does not change. Throws TransportError if the device cannot
  // be opened or is not a serial line.
  ModbusPort(const std::string &device, int baud);
  ModbusPort(const ModbusPort &) = delete;
  ModbusPort &operator=(const ModbusPort &) = delete;
  ~ModbusPort();

  // Returns the bytes that were received since the last call, if any.
  std::span<const std::uint8_t> receive();
  // Sends the bytes that the device accepts without waiting. The remaining bytes are lost.
  void send(std::span<const std::uint8_t> bytes);

 private:
  int device_;
  std::vector<std::uint8_t> buffer_;
};

}  // namespace forceaxis::nodes
