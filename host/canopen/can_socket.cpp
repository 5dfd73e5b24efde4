#include "host/canopen/can_socket.hpp"

#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace forceaxis::canopen {
namespace {

// Size of the receive buffer in bytes. The default of the kernel is too small for bursts of frames.
constexpr int kDeepBytes = 4 << 20;

}  // namespace

void expect_open(can_raw_result_t result, const std::string &interface) {
  const auto fail = [&](const std::string &what) { throw CanError(interface + ": " + what); };
  switch (result) {
    case CAN_RAW_OPEN:
      return;
    case CAN_RAW_NO_CAN:
      fail(std::string("expected a kernel with SocketCAN, but this kernel has none (") +
           std::strerror(errno) + "); run this program under tools/vcan");
      break;
    case CAN_RAW_BAD_NAME:
      fail("expected the name of a CAN interface such as vcan0");
      break;
    case CAN_RAW_NO_INTERFACE:
      fail(
          "expected a CAN interface, but no interface has this name; create one with `ip link "
          "add " +
          interface + " type vcan`, or run this program under tools/vcan");
      break;
    case CAN_RAW_REFUSED:
      fail(std::string("cannot open the CAN interface, ") + std::strerror(errno));
      break;
  }
}

void expect_up(const can_raw_t &socket) {
  const std::string interface = socket.interface;
  if (!can_raw_link(&socket).is_up)
    throw CanError(interface +
                   ": expected an interface that is up; start the interface with `ip link set " +
                   interface + " up`");
}

CanSocket::CanSocket(const std::string &interface, const Options &options)
    : interface_(interface), raw_{} {
  const can_raw_settings_t settings{.filter = options.filter,
                                    .errors = options.errors,
                                    .blocks = options.blocking,
                                    .buffer_bytes = options.deep ? kDeepBytes : 0};
  expect_open(can_raw_open(&raw_, interface.c_str(), &settings), interface);
  try {
    expect_up(raw_);
  } catch (const CanError &) {
    ::close(raw_.fd);
    throw;
  }
}

CanSocket::~CanSocket() { ::close(raw_.fd); }

int CanSocket::send(std::span<const can_frame> frames) {
  return can_raw_send(&raw_, frames.data(), static_cast<unsigned>(frames.size()));
}

int CanSocket::receive(std::span<can_frame> frames) {
  return can_raw_receive(&raw_, frames.data(), static_cast<unsigned>(frames.size()));
}

void CanSocket::set_wait(std::chrono::milliseconds wait) {
  if (wait == wait_) return;  // If the timeout is the same as before, no system call is needed.
  const timeval time{wait.count() / 1000, wait.count() % 1000 * 1000};
  ::setsockopt(raw_.fd, SOL_SOCKET, SO_RCVTIMEO, &time, sizeof time);
  wait_ = wait;
}

std::uint32_t CanSocket::take_lost() { return raw_.dropped - std::exchange(lost_, raw_.dropped); }

}  // namespace forceaxis::canopen
