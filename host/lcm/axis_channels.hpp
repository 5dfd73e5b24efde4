#pragma once
// The LCM channels of a gateway (host/lcm/axis.lcm). This class sets the fields seq, run_id and
// times. The class publishes with liblcm and receives with the class Receiver, so that no C
// function is on the call stack when a command is executed.
#include <array>
#include <cstdint>
#include <forceaxis/axis_capture_t.hpp>
#include <forceaxis/axis_command_t.hpp>
#include <forceaxis/axis_event_t.hpp>
#include <forceaxis/axis_state_t.hpp>
#include <functional>
#include <lcm/lcm-cpp.hpp>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "host/lcm/lcm_ends.hpp"
#include "host/lcm/receiver.hpp"

namespace forceaxis::lcm_bus {

constexpr std::int64_t kNotAvailable = axis_state_t::NOT_AVAILABLE;

struct Item {
  std::string object;
  std::int64_t value;
};

// The command that has caused an event or a recording.
struct CommandId {
  std::int64_t run_id = kNotAvailable;
  std::int64_t command_id = kNotAvailable;
};

// Numbers of messages that were received but not executed.
struct Drops {
  // Number of datagrams with commands from networks that are not allowed.
  std::uint64_t refused = 0;
  std::string last_refused;  // sender of the last refused datagram, as "ADDRESS:PORT"
  std::uint64_t malformed = 0;
  std::uint64_t incomplete = 0;  // number of messages with a missing fragment

  std::uint64_t total() const { return refused + malformed + incomplete; }
  // Returns one line with all numbers that are not 0. `remedy` is a text that begins with a comma
  // and says how to permit a refused machine.
  std::string text(const std::string &remedy) const;
};

class AxisChannels {
 public:
  using Command = std::function<void(int axis, const axis_command_t &command)>;

  explicit AxisChannels(const std::string &url);
  AxisChannels(const AxisChannels &) = delete;
  AxisChannels &operator=(const AxisChannels &) = delete;

  // Starts the reception of commands on the channels of the axes. handle() then calls `command` for
  // each command from this machine or from a network in `remote`. To be called once. Throws
  // LcmError.
  void listen(const std::vector<int> &axes, const std::vector<Network> &remote, Command command);
  // Returns the file descriptors for poll(). To be called after listen().
  std::vector<int> fds() const { return {receiver_->fd(), refused_->fd()}; }
  void handle();
  Drops drops() const;

  // Publish a message after setting the fields wall_utime, seq and run_id.
  void publish(int axis, axis_state_t &state);
  void publish(int axis, axis_event_t &event);
  void publish(int axis, axis_capture_t &capture);

 private:
  enum Kind { kState, kEvent, kCapture, kKinds };
  static constexpr int kMostAxes = 127;

  template <class Message>
  void publish(Kind kind, int axis, const char *suffix, Message &message);

  std::string url_;
  lcm::LCM lcm_;
  std::int64_t run_id_;
  std::array<std::array<std::int64_t, kMostAxes + 1>, kKinds> next_seq_{};
  std::map<std::string, int, std::less<>> listening_;  // axis number for each channel name
  Command command_;
  std::optional<Receiver> receiver_;
  std::optional<RefusedCounter> refused_;
  std::uint64_t undecodable_ = 0;
};

}  // namespace forceaxis::lcm_bus
