#pragma once
// A raw SocketCAN socket, which the gateway and the link in lock-step use. This header also has the
// error messages of all programs about a CAN interface.
#include <linux/can.h>

#include <chrono>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>

#include "firmware/port/linux/can_raw.h"

namespace forceaxis::canopen {

// Error: the machine does not support CAN, or the interface does not exist or is down. what()
// returns one line with the remedy.
struct CanError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Throws CanError if a socket on this interface was not opened.
void expect_open(can_raw_result_t result, const std::string &interface);
// Throws CanError if the interface of the socket is down.
void expect_up(const can_raw_t &socket);

class CanSocket {
 public:
  struct Options {
    // Filter for the frames that the kernel passes to the socket.
    can_filter filter;
    // Classes of CAN error frames that the socket receives. The filter does not apply to error
    // frames.
    can_err_mask_t errors = 0;
    // true: receive() waits for a frame, at most for the time of set_wait().
    bool blocking = false;
    // true: the socket has a large receive buffer, and take_lost() returns the number of lost
    // frames.
    bool deep = false;
  };
  // Largest number of frames that one call of send() or receive() passes.
  static constexpr std::size_t kBatch = CAN_RAW_BATCH;

  // Opens a socket on the interface. Throws CanError.
  CanSocket(const std::string &interface, const Options &options);
  ~CanSocket();
  CanSocket(const CanSocket &) = delete;
  CanSocket &operator=(const CanSocket &) = delete;

  const std::string &interface() const { return interface_; }
  int fd() const { return raw_.fd; }

  // Writes the first frames, at most kBatch, to the queue of the interface. Returns the number of
  // accepted frames, which is at least 1, or -errno. If the queue is full, the result is -ENOBUFS
  // or -EAGAIN.
  int send(std::span<const can_frame> frames);

  // Receives pending frames, at most kBatch. Returns the number of frames or -errno. The result is
  // -EAGAIN if no frame is pending, or, for a blocking socket, if no frame arrives within the wait
  // time.
  int receive(std::span<can_frame> frames);

  // Sets the time for which receive() of a blocking socket waits for a frame. By default, this time
  // is not limited.
  void set_wait(std::chrono::milliseconds wait);

  // Returns the number of frames that the kernel has dropped since the last call. The kernel
  // reports this number with the next received frame.
  std::uint32_t take_lost();

 private:
  std::string interface_;
  can_raw_t raw_;
  std::chrono::milliseconds wait_{-1};
  std::uint32_t lost_ = 0;  // number of dropped frames at the last call of take_lost()
};

}  // namespace forceaxis::canopen
