#pragma once
// A raw SocketCAN socket, the one that gateway, axis_node and lock-step link are built on.
#include <linux/can.h>

#include <chrono>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>

namespace forceaxis::canopen {

// No CAN, no such interface, or it is down: what() is one line with the remedy.
struct CanError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class CanSocket {
 public:
  struct Options {
    can_filter filter;          // of frames that the kernel passes on
    can_err_mask_t errors = 0;  // classes of error frames that it passes on, whatever the filter
    bool blocking = false;      // receive() waits, see set_wait()
    bool deep = false;          // room for thousands of frames, and take_lost() counts
  };
  // Frames of one call that share one system call.
  static constexpr std::size_t kBatch = 16;

  // Throws CanError.
  CanSocket(const std::string &interface, const Options &options);
  ~CanSocket();
  CanSocket(const CanSocket &) = delete;
  CanSocket &operator=(const CanSocket &) = delete;

  const std::string &interface() const { return interface_; }
  int fd() const { return fd_; }
  bool is_up() const;

  // Queues the first of the frames, at most kBatch. Returns how many the interface accepted, at
  // least 1, or -errno: -ENOBUFS and -EAGAIN if its queue is full.
  int send(std::span<const can_frame> frames);

  // Receives the pending frames, at most kBatch. Returns how many, or -errno: -EAGAIN if there is
  // none, in a blocking socket none within the wait.
  int receive(std::span<can_frame> frames);

  // How long receive() of a blocking socket waits for its first frame; by default for ever.
  void set_wait(std::chrono::milliseconds wait);

  // Frames that the kernel had to drop since the last call, known from the next frame received.
  std::uint32_t take_lost();

 private:
  std::string interface_;
  int fd_;
  bool deep_;
  std::chrono::milliseconds wait_{-1};
  std::uint32_t dropped_ = 0;  // as the kernel counts, wraps
  std::uint32_t lost_ = 0;     // not reported yet
};

}  // namespace forceaxis::canopen
