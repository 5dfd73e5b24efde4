#include "host/canopen/can_socket.hpp"

#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

namespace forceaxis::canopen {
namespace {

// Size of the receive buffer in bytes. The default of the kernel is too small for bursts of frames.
constexpr int kDeepBytes = 4 << 20;

}  // namespace

CanSocket::CanSocket(const std::string &interface, const Options &options)
    : interface_(interface),
      fd_(::socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC | (options.blocking ? 0 : SOCK_NONBLOCK),
                   CAN_RAW)),
      deep_(options.deep) {
  if (fd_ < 0) {
    throw CanError(interface + ": expected a kernel with SocketCAN, but this kernel has none (" +
                   std::strerror(errno) + "); run this program under tools/vcan");
  }
  const auto fail = [this](const std::string &what) {
    ::close(fd_);
    throw CanError(interface_ + ": " + what);
  };
  ifreq request{};
  if (interface.empty() || interface.size() >= sizeof request.ifr_name) {
    fail("expected the name of a CAN interface such as vcan0");
  }
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = static_cast<int>(if_nametoindex(interface.c_str()));
  if (address.can_ifindex == 0) {
    fail("expected a CAN interface, but no interface has this name; create one with `ip link add " +
         interface + " type vcan`, or run this program under tools/vcan");
  }
  if (!is_up())
    fail("expected an interface that is up; start the interface with `ip link set " + interface +
         " up`");
  ::setsockopt(fd_, SOL_CAN_RAW, CAN_RAW_FILTER, &options.filter, sizeof options.filter);
  ::setsockopt(fd_, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &options.errors, sizeof options.errors);
  if (deep_) {
    const int on = 1;
    ::setsockopt(fd_, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on);
    if (::setsockopt(fd_, SOL_SOCKET, SO_RCVBUFFORCE, &kDeepBytes, sizeof kDeepBytes) != 0) {
      ::setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &kDeepBytes, sizeof kDeepBytes);
    }
  }
  if (::bind(fd_, reinterpret_cast<sockaddr *>(&address), sizeof address) != 0) {
    fail(std::string("cannot open the CAN interface, ") + std::strerror(errno));
  }
}

CanSocket::~CanSocket() { ::close(fd_); }

bool CanSocket::is_up() const {
  ifreq request{};
  interface_.copy(request.ifr_name, sizeof request.ifr_name - 1);
  return ::ioctl(fd_, SIOCGIFFLAGS, &request) == 0 && (request.ifr_flags & IFF_UP) != 0;
}

int CanSocket::send(std::span<const can_frame> frames) {
  if (frames.size() == 1) {
    return ::write(fd_, frames.data(), sizeof(can_frame)) < 0 ? -errno : 1;
  }
  std::array<iovec, kBatch> parts;
  std::array<mmsghdr, kBatch> messages;
  const std::size_t most = std::min(frames.size(), kBatch);
  for (std::size_t i = 0; i < most; ++i) {
    parts[i] = {const_cast<can_frame *>(&frames[i]), sizeof frames[i]};
    messages[i] = {};
    messages[i].msg_hdr.msg_iov = &parts[i];
    messages[i].msg_hdr.msg_iovlen = 1;
  }
  const int n = ::sendmmsg(fd_, messages.data(), static_cast<unsigned>(most), 0);
  return n < 0 ? -errno : n;
}

int CanSocket::receive(std::span<can_frame> frames) {
  struct Control {
    alignas(cmsghdr) char bytes[CMSG_SPACE(sizeof(std::uint32_t))];
  };
  std::array<iovec, kBatch> parts;
  std::array<Control, kBatch> controls;
  std::array<mmsghdr, kBatch> messages;
  const std::size_t most = std::min(frames.size(), kBatch);
  for (std::size_t i = 0; i < most; ++i) {
    parts[i] = {&frames[i], sizeof frames[i]};
    messages[i] = {};
    messages[i].msg_hdr.msg_iov = &parts[i];
    messages[i].msg_hdr.msg_iovlen = 1;
    if (!deep_) continue;
    messages[i].msg_hdr.msg_control = controls[i].bytes;
    messages[i].msg_hdr.msg_controllen = sizeof controls[i].bytes;
  }
  const int n =
      ::recvmmsg(fd_, messages.data(), static_cast<unsigned>(most), MSG_WAITFORONE, nullptr);
  if (n < 0) return -errno;
  for (std::size_t i = 0; deep_ && i < static_cast<std::size_t>(n); ++i) {
    msghdr &header = messages[i].msg_hdr;
    for (cmsghdr *c = CMSG_FIRSTHDR(&header); c != nullptr; c = CMSG_NXTHDR(&header, c)) {
      if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SO_RXQ_OVFL) continue;
      std::uint32_t dropped = 0;
      std::memcpy(&dropped, CMSG_DATA(c), sizeof dropped);
      lost_ += dropped - std::exchange(dropped_, dropped);
    }
  }
  return n;
}

void CanSocket::set_wait(std::chrono::milliseconds wait) {
  if (wait == wait_) return;  // saves a system call
  const timeval time{wait.count() / 1000, wait.count() % 1000 * 1000};
  ::setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &time, sizeof time);
  wait_ = wait;
}

std::uint32_t CanSocket::take_lost() { return std::exchange(lost_, 0); }

}  // namespace forceaxis::canopen
