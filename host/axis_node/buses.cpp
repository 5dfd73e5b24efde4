#include "host/axis_node/buses.hpp"

#include <fcntl.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "host/canopen/can_socket.hpp"
#include "host/link/transport.hpp"

namespace forceaxis::nodes {
namespace {

constexpr std::size_t kModbusBytes = 1024;

}  // namespace

CanPort::CanPort(const std::string &interface) {
  canopen::expect_open(can_line_open(&line_, interface.c_str()), interface);
  try {
    canopen::expect_up(line_.raw);
  } catch (const canopen::CanError &) {
    close(line_.raw.fd);
    throw;
  }
}

CanPort::~CanPort() { close(line_.raw.fd); }

// Passes each change of the bus state to the handler, also if the bus was off only for a short
// time.
void CanPort::tell_state(const Handlers &handlers) {
  for (std::uint8_t state = can_line_state(&line_); state != state_;
       state = can_line_state(&line_)) {
    state_ = state;
    handlers.state(state);
  }
}

// Largest number of frames passed to the firmware in one tick. The value is ten times the number of
// frames that a bus of 1 Mbit/s transmits in a tick.
constexpr int kFramesPerTick = 64;

void CanPort::receive(const Handlers &handlers) {
  // The number of frames is limited, because many frames must not delay the tick. The remaining
  // frames wait until the next tick. If the memory of the socket is full, further frames are
  // dropped and counted.
  for (int i = 0; i < kFramesPerTick; ++i) {
    can_frame_t received{};
    const bool came = can_line_receive(&line_, &received);
    tell_state(handlers);
    if (const std::uint16_t lost = can_line_lost(&line_); lost > 0) handlers.lost(lost);
    if (!came) return;
    handlers.frame(received);
  }
}

bool CanPort::send(const can_frame_t &sent) { return can_line_send(&line_, &sent); }

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
