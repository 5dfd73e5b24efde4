#pragma once
// The LCM side of a gateway: what host/lcm/axis.lcm says, with seq, run_id and times filled in.
#include <array>
#include <cstdint>
#include <forceaxis/axis_capture_t.hpp>
#include <forceaxis/axis_command_t.hpp>
#include <forceaxis/axis_event_t.hpp>
#include <forceaxis/axis_state_t.hpp>
#include <functional>
#include <lcm/lcm-cpp.hpp>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "host/lcm/lcm_ends.hpp"

namespace forceaxis::lcm_bus {

constexpr std::int64_t kNotAvailable = axis_state_t::NOT_AVAILABLE;

// No such bus, or no route for multicast: the text says what to do.
struct LcmError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct Item {
  std::string object;
  std::int64_t value;
};

// Which command an event answers or a capture was asked by.
struct CommandId {
  std::int64_t run_id = kNotAvailable;
  std::int64_t command_id = kNotAvailable;
};

class AxisChannels {
 public:
  using Command = std::function<void(int axis, const axis_command_t &command)>;

  explicit AxisChannels(const std::string &url);

  // Calls `command` for each command received on the axis's channel, from handle().
  void listen(int axis, Command command);
  int fd() { return lcm_.getFileno(); }
  void handle() { lcm_.handleTimeout(0); }

  // These fill in wall_utime, seq and run_id.
  void publish(int axis, axis_state_t &state);
  void publish(int axis, axis_event_t &event);
  void publish(int axis, axis_capture_t &capture);

 private:
  enum Kind { kState, kEvent, kCapture, kKinds };
  static constexpr int kMostAxes = 127;

  template <class Message>
  void publish(Kind kind, int axis, const char *suffix, Message &message);

  struct Listener {
    int axis;
    Command command;
    void receive(const lcm::ReceiveBuffer *, const std::string &, const axis_command_t *message) {
      command(axis, *message);
    }
  };

  std::vector<std::unique_ptr<Listener>> listeners_;
  lcm::LCM lcm_;
  std::int64_t run_id_;
  std::array<std::array<std::int64_t, kMostAxes + 1>, kKinds> next_seq_{};
};

}  // namespace forceaxis::lcm_bus
