#include "host/gateway/can_queue.hpp"

#include <linux/can/error.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

namespace forceaxis::nodes {
namespace {

constexpr std::size_t kMostWaiting = 4096;

std::string error_text(const can_frame &frame) {
  std::string text;
  const auto add = [&text](const char *what) {
    text += (text.empty() ? "" : ", ") + std::string(what);
  };
  if ((frame.can_id & CAN_ERR_BUSOFF) != 0) add("bus off");
  if ((frame.can_id & CAN_ERR_RESTARTED) != 0) add("controller restarted");
  if ((frame.can_id & CAN_ERR_TX_TIMEOUT) != 0) add("transmission timed out");
  if ((frame.can_id & CAN_ERR_ACK) != 0) add("no node acknowledges frames; is a node connected?");
  if ((frame.can_id & CAN_ERR_CRTL) != 0) {
    const unsigned state = frame.data[1];
    if ((state & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0) add("error passive");
    if ((state & (CAN_ERR_CRTL_RX_OVERFLOW | CAN_ERR_CRTL_TX_OVERFLOW)) != 0) add("overflow");
  }
  return text;
}

}  // namespace

CanQueue::CanQueue(const std::string &interface)
    // A filter in the kernel discards the frames that receive() ignores, so that this program
    // spends no time on these frames.
    : socket_(interface,
              {.filter = {0, CAN_EFF_FLAG | CAN_RTR_FLAG}, .errors = CAN_ERR_MASK, .deep = true}) {}

void CanQueue::note(const std::string &text) {
  if (trouble_.text.find(text) != std::string::npos) return;
  if (!trouble_.text.empty()) trouble_.text += "; ";
  trouble_.text += text;
}

void CanQueue::send(const canopen::Frame &frame) {
  if (waiting_.size() == kMostWaiting) {
    note("frames to send were lost, because the bus accepts none");
    ++trouble_.lost;
    return;
  }
  waiting_.push_back(frame);
  flush();
}

void CanQueue::flush() {
  while (!waiting_.empty()) {
    const canopen::Frame &frame = waiting_.front();
    can_frame raw{};
    raw.can_id = frame.id;
    raw.can_dlc = frame.length;
    std::ranges::copy(frame.data, raw.data);
    const int sent = socket_.send({&raw, 1});
    if (sent == -EAGAIN || sent == -ENOBUFS || sent == -EINTR) return;
    if (sent < 0) {
      note(std::string("cannot send, ") + std::strerror(-sent));
      ++trouble_.lost;
    }
    waiting_.pop_front();
  }
}

std::optional<canopen::Frame> CanQueue::receive() {
  for (;;) {
    can_frame raw;
    const int n = socket_.receive({&raw, 1});
    if (n == -EINTR) continue;
    if (n < 0) {
      if (n != -EAGAIN) note(std::string("cannot receive, ") + std::strerror(-n));
      return std::nullopt;
    }
    if (const std::uint32_t lost = socket_.take_lost(); lost != 0) {
      note("received frames were lost, because this machine is too slow");
      trouble_.lost += lost;
    }
    if ((raw.can_id & CAN_ERR_FLAG) != 0) {
      const std::string text = error_text(raw);
      if (!text.empty()) note(text);
      continue;
    }
    if ((raw.can_id & (CAN_EFF_FLAG | CAN_RTR_FLAG)) != 0) continue;
    canopen::Frame frame{raw.can_id & CAN_SFF_MASK, std::min<std::uint8_t>(raw.can_dlc, 8), {}};
    std::copy_n(raw.data, frame.length, frame.data.begin());
    return frame;
  }
}

CanQueue::Trouble CanQueue::take_trouble() { return std::exchange(trouble_, {}); }

}  // namespace forceaxis::nodes
