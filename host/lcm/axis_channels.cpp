#include "host/lcm/axis_channels.hpp"

#include <random>

#include "host/lcm/command_message.hpp"
#include "host/lcm/url.hpp"

namespace forceaxis::lcm_bus {

namespace {

// Largest number of datagrams that one call processes. This limit prevents that many datagrams
// delay the other buses of the gateway.
constexpr int kMostAtOnce = 128;

}  // namespace

std::string Drops::text(const std::string &remedy) const {
  std::string said;
  const auto add = [&said](std::uint64_t count, const std::string &what) {
    if (count == 0) return;
    said += (said.empty() ? "" : ", ") + std::to_string(count) + " " + what;
  };
  add(refused,
      "commands from other machines refused (the last one from " + last_refused + remedy + ")");
  add(malformed, "malformed messages dropped");
  add(incomplete, "incomplete messages dropped");
  return said;
}

AxisChannels::AxisChannels(const std::string &url) : url_(url), lcm_(usable<LcmError>(url)) {
  if (!lcm_.good()) throw LcmError(url + ": expected a URL that LCM can open");
  std::random_device device;
  run_id_ = std::uniform_int_distribution<std::int64_t>(1, INT64_MAX)(device);
}

void AxisChannels::listen(const std::vector<int> &axes, const std::vector<Network> &remote,
                          Command command) {
  for (const int axis : axes) listening_["AXIS_" + std::to_string(axis) + "_COMMAND"] = axis;
  command_ = std::move(command);
  const auto wanted = [this](std::string_view channel) { return listening_.contains(channel); };
  receiver_.emplace(url_, remote, wanted);
  refused_.emplace(url_, remote, wanted);
}

void AxisChannels::handle() {
  refused_->receive(kMostAtOnce);
  receiver_->receive(kMostAtOnce, [this](const Message &message) {
    const auto command = decode_command(message.data);
    if (!command) {
      ++undecodable_;
      return;
    }
    command_(listening_.find(message.channel)->second, *command);
  });
}

Drops AxisChannels::drops() const {
  if (!receiver_) return {};
  const Assembly &assembly = receiver_->assembly();
  return {refused_->count(), refused_->last(), assembly.malformed() + undecodable_,
          assembly.incomplete()};
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
