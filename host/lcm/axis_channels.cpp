#include "host/lcm/axis_channels.hpp"

#include <random>

#include "host/lcm/url.hpp"

namespace forceaxis::lcm_bus {

AxisChannels::AxisChannels(const std::string &url) : lcm_(usable<LcmError>(url)) {
  if (!lcm_.good()) throw LcmError(url + ": expected a bus that LCM can join");
  std::random_device device;
  run_id_ = std::uniform_int_distribution<std::int64_t>(1, INT64_MAX)(device);
}

void AxisChannels::listen(int axis, Command command) {
  listeners_.push_back(std::make_unique<Listener>(axis, std::move(command)));
  lcm_.subscribe("AXIS_" + std::to_string(axis) + "_COMMAND", &Listener::receive,
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
