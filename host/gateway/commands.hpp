#pragma once
// Commands that come over LCM for one axis (host/lcm/axis.lcm), carried out on its LCM channel.
#include <map>
#include <optional>

#include "host/gateway/axis.hpp"

namespace forceaxis::nodes {

class GatewayCommands {
 public:
  GatewayCommands(EventLoop &loop, lcm_bus::AxisChannels &lcm, GatewayAxis &axis)
      : loop_(loop), lcm_(lcm), axis_(axis), waiting_(loop) {}

  void start() { loop_.spawn(serve()); }
  // A command as it came; a repetition is answered as before.
  void receive(const axis_command_t &command);

 private:
  // A client's command and, once there is one, its answer.
  struct Answer {
    std::int64_t kind = 0;  // 0: not answered yet
    std::int64_t code = 0;
    std::string text;
    std::vector<lcm_bus::Item> items;
    std::int64_t until_us = 0;  // wall clock: the client repeats the command until then
  };
  // Of a client whose oldest answers are forgotten: a client counts its commands, so what it sends
  // with a number up to `command_id` is a repetition.
  struct Forgotten {
    std::int64_t command_id = 0;
    std::int64_t until_us = 0;  // when the last of them is given up
  };
  using Id = std::pair<std::int64_t, std::int64_t>;
  // What an item of a command names.
  struct Target {
    ObjectAddress address;
    std::uint16_t object = AXIS_OBJ_NONE;  // none: an address that the table does not have
  };

  Task<void> serve();
  Task<void> stop(axis_command_t command);
  Task<Answer> carry_out(const axis_command_t &command);
  Task<Answer> write_items(const axis_command_t &command);
  Task<Answer> read_items(const axis_command_t &command);
  Task<Answer> capture(const axis_command_t &command);
  Task<Answer> lock(std::int64_t source);
  Task<void> follow_capture(axis_command_t command);
  Task<void> publish_capture(const axis_command_t &command, lcm_bus::CommandId id);
  void end_capture(lcm_bus::CommandId id, std::int64_t code, const std::string &text);

  std::optional<std::string> refusal_of(const axis_command_t &command) const;
  static std::optional<Target> target_of(const std::string &name);
  Answer refused(Answer answer, const std::string &name, std::int64_t value, std::int64_t code,
                 const std::string &reason) const;
  void answer(Id id, const Answer &answer);
  void publish_answer(Id id, const Answer &answer);
  void forget_oldest();
  // Whether the command may have been carried out already, or nothing more can be remembered.
  std::optional<std::string> why_not_again(Id id);

  EventLoop &loop_;
  lcm_bus::AxisChannels &lcm_;
  GatewayAxis &axis_;
  Mailbox<axis_command_t> waiting_;
  std::map<Id, Answer> answers_;
  std::deque<Id> order_;                         // of answers_, oldest first
  std::map<std::int64_t, Forgotten> forgotten_;  // by the client's run_id
  std::size_t kept_items_ = 0, waiting_items_ = 0;
  int stopping_ = 0;  // stops under way
  bool capturing_ = false;
  std::int64_t captures_ = 0;
};

}  // namespace forceaxis::nodes
