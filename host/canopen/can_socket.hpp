#pragma once
// A raw SocketCAN socket, which gateway, axis_node and the link in lock-step use.
#include <linux/can.h>

#include <chrono>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>

namespace forceaxis::canopen {

// The machine has no CAN, or the interface does not exist or is down. what() is one line with the
// remedy.
struct CanError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class CanSocket {
 public:
  struct Options {
    can_filter filter;  // filter of the frames that the kernel passes to the socket
    // Classes of error frames that the socket receives, independent of the filter.
    can_err_mask_t errors = 0;
    // receive() waits for a frame for at most the time of set_wait().
    bool blocking = false;
    // The socket has a large receive buffer, and take_lost() counts lost frames.
    bool deep = false;
  };
  // Highest number of frames that one call passes with one system call.
  static constexpr std::size_t kBatch = 16;

  // Opens a socket on the interface. Throws CanError.
  CanSocket(const std::string &interface, const Options &options);
  ~CanSocket();
  CanSocket(const CanSocket &) = delete;
  CanSocket &operator=(const CanSocket &) = delete;

  const std::string &interface() const { return interface_; }
  int fd() const { return fd_; }
  bool is_up() const;

  // Puts the first frames, at most kBatch, into the queue of the interface. Returns the number of
  // accepted frames, which is at least 1, or -errno. If the queue is full, the result is -ENOBUFS
  // or -EAGAIN.
  int send(std::span<const can_frame> frames);

  // Receives pending frames, at most kBatch. Returns their number or -errno. The result is -EAGAIN
  // if no frame is pending; in a blocking socket, if no frame arrives within the wait time.
  int receive(std::span<can_frame> frames);

  // Sets the time for which receive() of a blocking socket waits for its first frame. The default
  // is no limit.
  void set_wait(std::chrono::milliseconds wait);

  // Returns the number of frames that the kernel has dropped since the last call. The kernel
  // reports this number with the next received frame.
  std::uint32_t take_lost();

 private:
  std::string interface_;
  int fd_;
  bool deep_;
  std::chrono::milliseconds wait_{-1};
  std::uint32_t dropped_ = 0;  // number of dropped frames as counted by the kernel; it wraps
  std::uint32_t lost_ = 0;     // number of dropped frames that take_lost() has not yet returned
};

}  // namespace forceaxis::canopen
