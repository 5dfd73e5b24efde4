#include "host/axis_node/buses.hpp"

#include <fcntl.h>
#include <linux/can/error.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "host/link/transport.hpp"

namespace forceaxis::nodes {
namespace {

constexpr unsigned kCallsPerCheck = 150;  // 0.1 s
constexpr std::size_t kModbusBytes = 1024;

}  // namespace

CanPort::CanPort(const std::string &interface)
    // Remote frames are received too, because the firmware processes them.
    : socket_(interface, {.filter = {0, CAN_EFF_FLAG},
                          .errors = CAN_ERR_CRTL | CAN_ERR_BUSOFF | CAN_ERR_RESTARTED,
                          .deep = true}) {}

void CanPort::set_state(std::uint8_t state, const Handlers &handlers) {
  if (state == state_) return;
  state_ = state;
  handlers.state(state);
}

// Largest number of frames passed to the firmware in one tick. The value is ten times the number of
// frames that a bus of 1 Mbit/s transmits in a tick.
constexpr int kFramesPerTick = 64;

void CanPort::receive(const Handlers &handlers) {
  // While the interface is down, its state is checked every kCallsPerCheck calls.
  if (state_ == CAN_BUS_OFF && ++calls_ % kCallsPerCheck == 0 && socket_.is_up()) {
    set_state(CAN_BUS_ACTIVE, handlers);
  }
  // The number of frames is limited, because many frames must not delay the tick. The remaining
  // frames wait until the next tick. If the memory of the socket is full, further frames are
  // dropped and counted.
  for (int i = 0; i < kFramesPerTick; ++i) {
    can_frame frame;
    const int n = socket_.receive({&frame, 1});
    if (n < 0) {
      if (n == -ENETDOWN || n == -ENODEV) set_state(CAN_BUS_OFF, handlers);
      if (n == -EINTR || n == -ENETDOWN) continue;
      return;
    }
    if (const std::uint32_t lost = socket_.take_lost(); lost > 0) {
      handlers.lost(static_cast<std::uint16_t>(std::min<std::uint32_t>(lost, 65535)));
    }
    if ((frame.can_id & CAN_EFF_FLAG) != 0) continue;
    if ((frame.can_id & CAN_ERR_FLAG) != 0) {
      constexpr int kPassive = CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE;
      const bool controller = (frame.can_id & CAN_ERR_CRTL) != 0;
      if ((frame.can_id & CAN_ERR_BUSOFF) != 0) {
        set_state(CAN_BUS_OFF, handlers);
      } else if (controller && (frame.data[1] & kPassive) != 0) {
        set_state(CAN_BUS_PASSIVE, handlers);
      } else if ((frame.can_id & CAN_ERR_RESTARTED) != 0 ||
                 (controller && (frame.data[1] & CAN_ERR_CRTL_ACTIVE) != 0)) {
        set_state(CAN_BUS_ACTIVE, handlers);
      }
      continue;
    }
    can_frame_t received{};
    received.id = static_cast<std::uint16_t>(frame.can_id & CAN_SFF_MASK);
    received.remote = (frame.can_id & CAN_RTR_FLAG) != 0;
    received.length =
        received.remote != 0 ? std::uint8_t{0} : std::min<std::uint8_t>(frame.can_dlc, 8);
    std::copy_n(frame.data, received.length, received.data);
    handlers.frame(received);
  }
}

bool CanPort::send(const can_frame_t &sent) {
  can_frame frame{};
  frame.can_id = sent.id | (sent.remote != 0 ? CAN_RTR_FLAG : 0U);
  frame.can_dlc = sent.length;
  std::copy_n(sent.data, sent.length, frame.data);
  return socket_.send({&frame, 1}) == 1;
}

ModbusPort::ModbusPort(const std::string &device, int baud)
    : device_(open(device.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)),
      buffer_(kModbusBytes) {
  termios line{};
  if (device_ < 0 || tcgetattr(device_, &line) != 0) {
    const std::string why = std::strerror(errno);
    if (device_ >= 0) close(device_);
    throw host::TransportError(device + ": expected a serial device for Modbus, " + why);
  }
  static constexpr struct {
    int baud;
    speed_t speed;
  } kSpeeds[] = {{9600, B9600},   {19200, B19200},   {38400, B38400},
                 {57600, B57600}, {115200, B115200}, {230400, B230400}};
  cfmakeraw(&line);
  line.c_cflag |= PARENB | CLOCAL | CREAD;
  for (const auto &s : kSpeeds) {
    if (s.baud == baud) cfsetspeed(&line, s.speed);
  }
  tcsetattr(device_, TCSANOW, &line);
  tcflush(device_, TCIFLUSH);
}

ModbusPort::~ModbusPort() { close(device_); }

std::span<const std::uint8_t> ModbusPort::receive() {
  const ssize_t n = read(device_, buffer_.data(), buffer_.size());
  return {buffer_.data(), n > 0 ? static_cast<std::size_t>(n) : 0};
}

void ModbusPort::send(std::span<const std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t n = write(device_, bytes.data(), bytes.size());
    // If the serial line is blocked, the bytes are lost, and the client repeats its request.
    if (n <= 0) return;
    bytes = bytes.subspan(static_cast<std::size_t>(n));
  }
}

}  // namespace forceaxis::nodes
