#pragma once
// Executes the commands for one axis that clients send over LCM (host/lcm/axis.lcm). The commands
// use the SDO channel of LCM.
#include <map>
#include <optional>

#include "host/gateway/axis.hpp"

namespace forceaxis::nodes {

class GatewayCommands {
 public:
  GatewayCommands(EventLoop &loop, lcm_bus::AxisChannels &lcm, GatewayAxis &axis)
      : loop_(loop), lcm_(lcm), axis_(axis), waiting_(loop) {}

  void start() { loop_.spawn(serve()); }
  // Accepts a received command. If a command is repeated after its answer, the answer is sent
  // again.
  void receive(const axis_command_t &command);

 private:
  // The answer to a command of a client. A command in progress has an Answer with kind 0.
  struct Answer {
    std::int64_t kind = 0;  // kind of the answer to the command; 0: there is no answer yet
    std::int64_t code = 0;
    std::string text;
    std::vector<lcm_bus::Item> items;
    // Time of the wall clock in us until which the client repeats its command.
    std::int64_t until_us = 0;
  };
  // A client whose oldest answers were deleted. The numbers of the commands of a client ascend, so
  // any command with a number up to `command_id` is a repetition.
  struct Forgotten {
    std::int64_t command_id = 0;
    // Time of the wall clock in us until which the client repeats a command whose answer was
    // deleted.
    std::int64_t until_us = 0;
  };
  using Id = std::pair<std::int64_t, std::int64_t>;
  // The latest recording. It is kept until the next one starts, so that samples whose messages were
  // lost can be sent again.
  struct Recording {
    Id id{};
    bool complete = false;
    std::string failure;  // reason why the recording has no samples; empty if there are samples

    // Message for the recording, with all fields except the samples and their tick.
    axis_capture_t block{};
    std::vector<std::uint8_t> bytes;
    std::vector<ObjectAddress> columns;
    std::size_t row_bytes = 0;
    std::optional<std::size_t> tick_at;  // index of the recorded signal that is tick_count; empty
                                         // if tick_count is not recorded
  };
  // Range of samples: number of the first sample, and number of the sample after the last one.
  using Range = std::pair<std::int64_t, std::int64_t>;
  // The object whose name or address is in an item of a command.
  struct Target {
    ObjectAddress address;
    // AXIS_OBJ_NONE: the object table has no object with this address.
    std::uint16_t object = AXIS_OBJ_NONE;
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
  Answer repeat(const axis_command_t &command);
  Task<void> repeat_samples(std::vector<Range> ranges);
  Task<void> publish_samples(Id id, Range range);

  std::optional<std::string> refusal_of(const axis_command_t &command) const;
  static std::optional<Target> target_of(const std::string &name);
  Answer refused(Answer answer, const std::string &name, std::int64_t value, std::int64_t code,
                 const std::string &reason) const;
  void answer(Id id, const Answer &answer);
  void publish_answer(Id id, const Answer &answer);
  void forget_oldest();
  // Returns the reason to refuse a command, or nothing. A command is refused if a previous
  // execution cannot be excluded, or if the memory for commands is full.
  std::optional<std::string> why_not_again(Id id);

  EventLoop &loop_;
  lcm_bus::AxisChannels &lcm_;
  GatewayAxis &axis_;
  Mailbox<axis_command_t> waiting_;
  std::map<Id, Answer> answers_;
  std::deque<Id> order_;  // ids of the commands in `answers_`, beginning with the oldest command
  std::map<std::int64_t, Forgotten> forgotten_;  // key: run_id of the client
  std::size_t kept_items_ = 0, waiting_items_ = 0;
  int stopping_ = 0;  // number of stop commands that are in progress
  bool capturing_ = false, repeating_ = false;
  Recording recording_;
  std::int64_t captures_ = 0;
};

}  // namespace forceaxis::nodes
