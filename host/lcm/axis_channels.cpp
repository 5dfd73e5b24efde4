#include "host/lcm/axis_channels.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <random>

namespace forceaxis::lcm_bus {
namespace {

// LCM itself would only print warnings, and lose every message.
std::string with_route(const std::string &url) {
  if (!url.starts_with("udpm://")) return url;
  const int s = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(1);
  ::inet_pton(AF_INET, "239.255.76.67", &address.sin_addr);
  const bool there = ::connect(s, reinterpret_cast<sockaddr *>(&address), sizeof address) == 0;
  ::close(s);
  if (there) return url;
  throw LcmError(
      url +
      ": expected a route for multicast, there is none; give the loopback interface one: "
      "`ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo`");
}

}  // namespace

std::int64_t wall_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

AxisChannels::AxisChannels(const std::string &url) : lcm_(with_route(url)) {
  if (!lcm_.good()) {
    throw LcmError(url + ": expected an LCM URL such as udpm://239.255.76.67:7667?ttl=0");
  }
  std::random_device device;
  run_id_ = std::uniform_int_distribution<std::int64_t>(1, INT64_MAX)(device);
}

void AxisChannels::listen(int axis, Command command) {
  listeners_.push_back(std::make_unique<Listener>(axis, std::move(command)));
  lcm_.subscribe("AXIS_" + std::to_string(axis) + "_COMMAND", &Listener::hear,
                 listeners_.back().get())
      ->setQueueCapacity(1000);
}

template <class Message>
void AxisChannels::publish(Kind kind, int axis, const char *suffix, Message &message) {
  message.wall_utime = wall_us();
  message.seq = next_seq_[kind][static_cast<std::size_t>(axis)]++;
  message.run_id = run_id_;
  message.axis = axis;
  lcm_.publish("AXIS_" + std::to_string(axis) + suffix, &message);
}

void AxisChannels::publish(int axis, axis_state_t &state) {
  publish(kState, axis, "_STATE", state);
}
void AxisChannels::publish(int axis, axis_event_t &event) {
  publish(kEvent, axis, "_EVENT", event);
}
void AxisChannels::publish(int axis, axis_capture_t &capture) {
  publish(kCapture, axis, "_CAPTURE", capture);
}

}  // namespace forceaxis::lcm_bus
