#pragma once
// Executes the commands for one axis that clients send over LCM (host/lcm/axis.lcm), through the
// LCM channel of the axis.
#include <map>
#include <optional>

#include "host/gateway/axis.hpp"

namespace forceaxis::nodes {

class GatewayCommands {
 public:
  GatewayCommands(EventLoop &loop, lcm_bus::AxisChannels &lcm, GatewayAxis &axis)
      : loop_(loop), lcm_(lcm), axis_(axis), waiting_(loop) {}

  void start() { loop_.spawn(serve()); }
  // Accepts a received command. If a command is repeated, its first answer is sent again.
  void receive(const axis_command_t &command);

 private:
  // A command of a client, and its answer after the command is complete.
  struct Answer {
    std::int64_t kind = 0;  // kind of the answer; 0: the command has no answer yet
    std::int64_t code = 0;
    std::string text;
    std::vector<lcm_bus::Item> items;
    std::int64_t until_us = 0;  // wall clock in us until which the client repeats its command
  };
  // A client whose oldest answers were deleted. A client numbers its commands in ascending order,
  // so any command with a number up to `command_id` is a repetition.
  struct Forgotten {
    std::int64_t command_id = 0;
    // Wall clock in us until which the client repeats one of these commands.
    std::int64_t until_us = 0;
  };
  using Id = std::pair<std::int64_t, std::int64_t>;
  // The object that an item of a command names.
  struct Target {
    ObjectAddress address;
    std::uint16_t object = AXIS_OBJ_NONE;  // AXIS_OBJ_NONE for an address without object in the
                                           // table
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
  // Returns the reason to refuse a command that may have been executed before, or that cannot be
  // recorded because the memory for commands is full. Otherwise returns nothing.
  std::optional<std::string> why_not_again(Id id);

  EventLoop &loop_;
  lcm_bus::AxisChannels &lcm_;
  GatewayAxis &axis_;
  Mailbox<axis_command_t> waiting_;
  std::map<Id, Answer> answers_;
  std::deque<Id> order_;  // ids of the commands in answers_, the oldest first
  std::map<std::int64_t, Forgotten> forgotten_;  // clients by their run_id
  std::size_t kept_items_ = 0, waiting_items_ = 0;
  int stopping_ = 0;  // number of stop commands in progress
  bool capturing_ = false;
  std::int64_t captures_ = 0;
};

}  // namespace forceaxis::nodes
