#include "host/canopen/can_socket.hpp"

#include <fcntl.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

namespace forceaxis::canopen {
namespace {

constexpr int kReceiveBytes = 4 << 20;  // of a reader's socket; the default loses bursts silently
constexpr std::size_t kMostWaiting = 4096;

std::string error_text(const can_frame &frame) {
  std::string text;
  const auto add = [&text](const char *what) {
    text += (text.empty() ? "" : ", ") + std::string(what);
  };
  if ((frame.can_id & CAN_ERR_BUSOFF) != 0) add("bus off");
  if ((frame.can_id & CAN_ERR_RESTARTED) != 0) add("controller restarted");
  if ((frame.can_id & CAN_ERR_TX_TIMEOUT) != 0) add("transmission timed out");
  if ((frame.can_id & CAN_ERR_ACK) != 0) add("no acknowledge: is any node there?");
  if ((frame.can_id & CAN_ERR_CRTL) != 0) {
    const unsigned state = frame.data[1];
    if ((state & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0) add("error passive");
    if ((state & (CAN_ERR_CRTL_RX_OVERFLOW | CAN_ERR_CRTL_TX_OVERFLOW)) != 0) add("overflow");
  }
  return text;
}

}  // namespace

CanSocket::CanSocket(const std::string &interface) : interface_(interface) {
  fd_ = ::socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, CAN_RAW);
  if (fd_ < 0) {
    throw CanError(interface + ": expected a kernel with CAN, " + std::strerror(errno) +
                   "; where there is none run this under tools/vcan");
  }
  const auto fail = [this](const std::string &what) {
    ::close(fd_);
    throw CanError(interface_ + ": " + what);
  };
  ifreq request{};
  if (interface.empty() || interface.size() >= sizeof request.ifr_name) {
    fail("expected the name of a CAN interface such as vcan0");
  }
  interface.copy(request.ifr_name, interface.size());
  if (::ioctl(fd_, SIOCGIFINDEX, &request) != 0) {
    fail("expected a CAN interface, there is none of this name; `ip link` lists them");
  }
  const int index = request.ifr_ifindex;
  if (::ioctl(fd_, SIOCGIFFLAGS, &request) == 0 && (request.ifr_flags & IFF_UP) == 0) {
    fail("expected an interface that is up; `ip link set " + interface + " up`");
  }
  const int on = 1;
  // The kernel keeps back what receive() would only pass over, however much of it comes.
  const can_filter data{0, CAN_EFF_FLAG | CAN_RTR_FLAG};
  ::setsockopt(fd_, SOL_CAN_RAW, CAN_RAW_FILTER, &data, sizeof data);
  const can_err_mask_t errors = CAN_ERR_MASK;
  ::setsockopt(fd_, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors);
  ::setsockopt(fd_, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on);
  if (::setsockopt(fd_, SOL_SOCKET, SO_RCVBUFFORCE, &kReceiveBytes, sizeof kReceiveBytes) != 0) {
    ::setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &kReceiveBytes, sizeof kReceiveBytes);
  }
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = index;
  if (::bind(fd_, reinterpret_cast<sockaddr *>(&address), sizeof address) != 0) {
    fail(std::string("expected a CAN interface, ") + std::strerror(errno));
  }
}

CanSocket::~CanSocket() { ::close(fd_); }

void CanSocket::note(const std::string &text) {
  if (trouble_.text.find(text) != std::string::npos) return;
  if (!trouble_.text.empty()) trouble_.text += "; ";
  trouble_.text += text;
}

void CanSocket::send(const Frame &frame) {
  if (waiting_.size() == kMostWaiting) {
    note("frames to send were lost, the bus takes none");
    ++trouble_.lost;
    return;
  }
  waiting_.push_back(frame);
  flush();
}

void CanSocket::flush() {
  while (!waiting_.empty()) {
    const Frame &frame = waiting_.front();
    can_frame raw{};
    raw.can_id = frame.id;
    raw.can_dlc = frame.length;
    std::ranges::copy(frame.data, raw.data);
    if (::write(fd_, &raw, sizeof raw) == static_cast<ssize_t>(sizeof raw)) {
      waiting_.pop_front();
      continue;
    }
    if (errno == EAGAIN || errno == ENOBUFS || errno == EINTR) return;
    note(std::string("cannot send, ") + std::strerror(errno));
    ++trouble_.lost;
    waiting_.pop_front();
  }
}

std::optional<Frame> CanSocket::receive() {
  for (;;) {
    can_frame raw{};
    iovec part{&raw, sizeof raw};
    alignas(cmsghdr) char control[CMSG_SPACE(sizeof(std::uint32_t))];
    msghdr message{};
    message.msg_iov = &part;
    message.msg_iovlen = 1;
    message.msg_control = control;
    message.msg_controllen = sizeof control;
    const ssize_t n = ::recvmsg(fd_, &message, 0);
    if (n < 0) {
      if (errno == EINTR) continue;
      if (errno != EAGAIN) note(std::string("cannot receive, ") + std::strerror(errno));
      return std::nullopt;
    }
    for (cmsghdr *c = CMSG_FIRSTHDR(&message); c != nullptr; c = CMSG_NXTHDR(&message, c)) {
      if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SO_RXQ_OVFL) continue;
      std::uint32_t dropped = 0;
      std::memcpy(&dropped, CMSG_DATA(c), sizeof dropped);
      if (dropped != dropped_) {
        note("received frames were lost, this machine is too slow");
        trouble_.lost += dropped - dropped_;
        dropped_ = dropped;
      }
    }
    if (n != static_cast<ssize_t>(sizeof raw)) continue;
    if ((raw.can_id & CAN_ERR_FLAG) != 0) {
      const std::string text = error_text(raw);
      if (!text.empty()) note(text);
      continue;
    }
    if ((raw.can_id & (CAN_EFF_FLAG | CAN_RTR_FLAG)) != 0) continue;
    Frame frame{raw.can_id & CAN_SFF_MASK, std::min<std::uint8_t>(raw.can_dlc, 8), {}};
    std::copy_n(raw.data, frame.length, frame.data.begin());
    return frame;
  }
}

CanSocket::Trouble CanSocket::take_trouble() { return std::exchange(trouble_, {}); }

}  // namespace forceaxis::canopen
