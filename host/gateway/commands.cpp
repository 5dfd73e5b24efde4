#include "host/gateway/commands.hpp"

#include <algorithm>
#include <charconv>

#include "host/gateway/words.hpp"
#include "host/run/objects.hpp"

extern "C" {
#include "firmware/core/recorder.h"
#include "firmware/drive/state.h"
}

namespace forceaxis::nodes {
namespace {

using namespace std::chrono_literals;
using lcm_bus::kNotAvailable;

constexpr std::size_t kKeptAnswers = 2000;
// Largest number of clients in forgotten_, for which 2 MiB are sufficient.
constexpr std::size_t kMostForgotten = 32768;
constexpr std::size_t kMostWaiting = 200;
constexpr int kMostStopping = 20;
// Largest numbers of items in stored answers and in waiting commands. These limits bound the memory
// for any number of commands that clients send.
constexpr std::size_t kKeptItems = 65536, kMostWaitingItems = 16384;
constexpr std::uint16_t kRecorderData = 0x2120;
// A block of 32 samples is sent every 16 ms, so the rate is 2000 samples per second. UDP loses no
// messages at this rate.
constexpr std::int64_t kBlock = 32;
constexpr auto kBlockTime = 16ms;
constexpr auto kRecorderPoll = 20ms;

std::string hex(unsigned value) {
  char text[16];
  std::snprintf(text, sizeof text, "%04Xh", value);
  return text;
}

// Returns true if the client no longer waits for an answer. wall_utime and timeout_us come from the
// client, so their sum could overflow.
bool late(const axis_command_t &command) {
  return command.wall_utime < 0 || command.timeout_us < 0 ||
         lcm_bus::wall_us() - command.wall_utime > command.timeout_us;
}

// Returns the time of the wall clock in us until which the client waits for an answer. If the time
// is not limited, returns the largest number.
std::int64_t end_of(const axis_command_t &command) {
  const std::int64_t left = INT64_MAX - std::max<std::int64_t>(command.wall_utime, 0);
  return command.timeout_us > left ? INT64_MAX : command.wall_utime + command.timeout_us;
}

// Returns true if the command only stops the axis. A stop command is accepted from every client,
// does not wait for other commands, and is never too late. A stop command is also accepted if the
// object table of the axis differs, because CiA 402 defines the controlword.
bool only_stops(const axis_command_t &command) {
  if (command.kind != axis_command_t::KIND_WRITE || command.object.size() != 1) return false;
  const std::int64_t value = command.value[0];
  return command.object[0] == "controlword" && value >= 0 && value <= UINT16_MAX &&
         cia402_is_stop(AXIS_OBJ_CONTROLWORD, static_cast<std::int32_t>(value));
}

}  // namespace

void GatewayCommands::publish_answer(Id id, const Answer &answer) {
  axis_.publisher().event(answer.kind, answer.code, answer.text, answer.items,
                          {id.first, id.second});
}

void GatewayCommands::receive(const axis_command_t &command) {
  const Id id{command.run_id, command.command_id};
  const auto known = answers_.find(id);
  if (known != answers_.end()) {
    if (known->second.kind != 0) publish_answer(id, known->second);
    return;
  }
  const bool stops = command.axis == axis_.number() && only_stops(command);
  if (stops) {
    // The gateway sends no answer, so that the client repeats the command.
    if (stopping_ >= kMostStopping) return;
  } else {
    // A late command is not executed, because the client no longer waits for the answer and the
    // axis must not move late.
    if (late(command)) return;
    if (const auto why = why_not_again(id)) {
      Answer answer;
      answer.kind = axis_event_t::EVENT_REFUSED;
      answer.text = *why;
      return publish_answer(id, answer);
    }
    // No answer is sent, because the client repeats the command.
    if (waiting_.size() >= kMostWaiting || waiting_items_ >= kMostWaitingItems) return;
  }
  answers_[id].until_us = end_of(command);
  order_.push_back(id);
  forget_oldest();
  if (stops) {
    ++stopping_;
    loop_.spawn(stop(command));
    return;
  }
  waiting_items_ += command.object.size();
  waiting_.push(command);
}

void GatewayCommands::answer(Id id, const Answer &answer) {
  const auto place = answers_.find(id);
  if (place != answers_.end()) {
    const std::int64_t until_us = place->second.until_us;
    place->second = answer;
    place->second.until_us = until_us;
    kept_items_ += answer.items.size();
  }
  publish_answer(id, answer);
  forget_oldest();
}

Task<void> GatewayCommands::stop(axis_command_t command) {
  const Answer done = co_await write_items(command);
  --stopping_;
  answer({command.run_id, command.command_id}, done);
}

// A command without an answer is never deleted, because a repetition of the command would then be
// executed again.
void GatewayCommands::forget_oldest() {
  while (order_.size() > kKeptAnswers || kept_items_ > kKeptItems) {
    const auto oldest = answers_.find(order_.front());
    if (oldest->second.kind == 0) return;
    kept_items_ -= oldest->second.items.size();
    Forgotten &client = forgotten_[oldest->first.first];
    client.command_id = std::max(client.command_id, oldest->first.second);
    client.until_us = std::max(client.until_us, oldest->second.until_us);
    answers_.erase(oldest);
    order_.pop_front();
  }
}

std::optional<std::string> GatewayCommands::why_not_again(Id id) {
  const auto client = forgotten_.find(id.first);
  if (client != forgotten_.end() && id.second <= client->second.command_id) {
    return "command " + std::to_string(id.second) +
           " may have been executed before, because too many other commands came since; read the "
           "objects that the command writes";
  }
  if (forgotten_.size() >= kMostForgotten) {
    const std::int64_t now_us = lcm_bus::wall_us();
    std::erase_if(forgotten_, [&](const auto &each) { return each.second.until_us < now_us; });
    if (forgotten_.size() >= kMostForgotten)
      return "too many clients wait for answers; restart the gateway";
  }
  return std::nullopt;
}

Task<void> GatewayCommands::serve() {
  while (loop_.running()) {
    const axis_command_t command = co_await waiting_;
    waiting_items_ -= command.object.size();
    const Id id{command.run_id, command.command_id};
    if (late(command)) {
      answers_.erase(id);
      std::erase(order_, id);
      continue;
    }
    const Answer done = co_await carry_out(command);
    answer(id, done);
  }
}

// Returns the reason to refuse all items of a command, or nothing.
std::optional<std::string> GatewayCommands::refusal_of(const axis_command_t &command) const {
  const bool by_address = command.kind == axis_command_t::KIND_READ &&
                          std::ranges::all_of(command.object, [](const std::string &name) {
                            return name.starts_with("0x");
                          });
  if (command.axis != axis_.number()) {
    return "expected axis " + std::to_string(axis_.number()) +
           " on the channel of this axis, got axis " + std::to_string(command.axis);
  }
  if (command.kind < axis_command_t::KIND_WRITE || command.kind > axis_command_t::KIND_REPEAT) {
    return "unknown kind of command, " + std::to_string(command.kind);
  }
  // The gateway itself has stored the samples, so this command does not need the axis.
  if (command.kind == axis_command_t::KIND_REPEAT) return std::nullopt;
  if (!axis_.present()) return std::string("the axis is silent");
  if (by_address) return std::nullopt;
  if (axis_.mismatch()) {
    return "the axis has object table " + hash_text(axis_.table_hash()) + ", the gateway has " +
           hash_text(AXIS_OBJECTS_HASH32) + ": only reads by address are executed";
  }
  if (axis_.is_stopped()) {
    return std::string("the node is stopped by NMT and not set up yet; the gateway starts it");
  }
  if (!axis_.writes_allowed()) return std::string("the axis is not set up yet");
  if (command.objects_hash != static_cast<std::int64_t>(AXIS_OBJECTS_HASH32)) {
    return "the client has object table " + hash_text(command.objects_hash) + ", the axis " +
           hash_text(AXIS_OBJECTS_HASH32) + ": only reads by address are executed";
  }
  return std::nullopt;
}

Task<GatewayCommands::Answer> GatewayCommands::carry_out(const axis_command_t &command) {
  const auto refusal = refusal_of(command);
  Answer answer;
  if (refusal) {
    answer.kind = axis_event_t::EVENT_REFUSED;
    answer.text = *refusal;
    if (!axis_.present()) answer.code = canopen::kAbortTimeout;
    co_return answer;
  }
  switch (command.kind) {
    case axis_command_t::KIND_WRITE:
      co_return co_await write_items(command);
    case axis_command_t::KIND_READ:
      co_return co_await read_items(command);
    case axis_command_t::KIND_CAPTURE:
      co_return co_await capture(command);
    case axis_command_t::KIND_REPEAT:
      co_return repeat(command);
    case axis_command_t::KIND_TAKE:
      co_return co_await lock(AXIS_COMMAND_SOURCE_LCM);
    default:
      co_return co_await lock(AXIS_COMMAND_SOURCE_CANOPEN);
  }
}

std::optional<GatewayCommands::Target> GatewayCommands::target_of(const std::string &name) {
  const auto object = host::find_object(name);
  if (object) return Target{address_of(*object), *object};
  // The name can be an address, such as "0x6040" or "0x2010:3".
  if (!name.starts_with("0x")) return std::nullopt;
  const char *const end = name.data() + name.size();
  unsigned index = 0, sub = 0;
  auto [at, error] = std::from_chars(name.data() + 2, end, index, 16);
  if (error != std::errc() || index > 0xFFFF) return std::nullopt;
  if (at != end) {
    if (*at != ':') return std::nullopt;
    const auto parsed = std::from_chars(at + 1, end, sub, 10);
    if (parsed.ec != std::errc() || parsed.ptr != end || sub > 255) return std::nullopt;
  }
  for (const axis_address_t &a : axis_addresses) {
    if (a.index == index && a.sub == sub && a.what == AXIS_ADDRESS_OBJECT) {
      return Target{address_of(a.value), a.value};
    }
  }
  return Target{{static_cast<std::uint16_t>(index), static_cast<std::uint8_t>(sub), 0, false},
                AXIS_OBJ_NONE};
}

GatewayCommands::Answer GatewayCommands::refused(Answer answer, const std::string &name,
                                                 std::int64_t value, std::int64_t code,
                                                 const std::string &reason) const {
  answer.kind = axis_event_t::EVENT_REFUSED;
  answer.code = code;
  answer.text = name + ": " + reason;
  answer.items.push_back({name, value});
  return answer;
}

namespace {

// Returns the reason why an object was not written or read.
std::string reason_of(const ObjectResult &result, std::uint16_t object, const GatewayAxis &axis) {
  if (result.silent) return "the axis did not answer in time";
  if (result.abort == canopen::kAbortLocked) {
    const std::int64_t owner = axis.publisher().value(AXIS_OBJ_COMMAND_SOURCE);
    return (owner == kNotAvailable
                ? std::string("another source owns the axis")
                : "the axis belongs to " +
                      host::enum_text(AXIS_OBJ_COMMAND_SOURCE, static_cast<std::int32_t>(owner))) +
           "; acquire the axis first (abort 08000021h)";
  }
  if (object != AXIS_OBJ_NONE) {
    const axis_object_meta_t &meta = host::object_meta(object);
    if (result.abort == 0x06090031 || result.abort == 0x06090032) {
      return canopen::abort_text(result.abort) + ", expected a raw value from " +
             std::to_string(meta.min) + " to " + std::to_string(meta.max);
    }
    if (result.abort == canopen::kAbortState && std::string_view(meta.writable) != "any") {
      return canopen::abort_text(result.abort) + ", write this object with the " +
             (std::string_view(meta.writable) == "disabled" ? "axis disabled" : "recorder idle");
    }
  }
  return canopen::abort_text(result.abort);
}

}  // namespace

Task<GatewayCommands::Answer> GatewayCommands::write_items(const axis_command_t &command) {
  Answer answer;
  for (std::size_t i = 0; i < command.object.size(); ++i) {
    const std::string &name = command.object[i];
    const std::int64_t value = command.value[i];
    const auto target = target_of(name);
    if (!target || target->object == AXIS_OBJ_NONE) {
      co_return refused(std::move(answer), name, value, 0, "no such object");
    }
    if (!fits(value, target->address)) {
      co_return refused(std::move(answer), name, value, 0,
                        std::to_string(value) + " is not a value of type " +
                            host::object_meta(target->object).type);
    }
    const ObjectResult result = co_await axis_.lcm_port().write(target->address, value);
    if (result.abort == canopen::kAbortLocked) {
      const ObjectResult owner = co_await axis_.master_port().read(AXIS_OBJ_COMMAND_SOURCE);
      if (owner.ok()) axis_.publisher().update(AXIS_OBJ_COMMAND_SOURCE, owner.value);
    }
    if (!result.ok()) {
      co_return refused(std::move(answer), name, value, result.abort,
                        reason_of(result, target->object, axis_));
    }
    answer.items.push_back({name, value});
    if (host::object_meta(target->object).access[0] == 'r')
      axis_.publisher().update(target->object, value);
  }
  answer.kind = axis_event_t::EVENT_DONE;
  answer.code = kNotAvailable;
  answer.text = answer.items.empty() ? "nothing to write" : "written";
  if (answer.items.size() == 1) answer.text = answer.items[0].object + " written";
  co_return answer;
}

Task<GatewayCommands::Answer> GatewayCommands::read_items(const axis_command_t &command) {
  Answer answer;
  for (const std::string &name : command.object) {
    const auto target = target_of(name);
    if (!target) co_return refused(std::move(answer), name, 0, 0, "no such object");
    const ObjectResult result = co_await axis_.lcm_port().read(target->address);
    if (!result.ok()) {
      co_return refused(std::move(answer), name, 0, result.abort,
                        reason_of(result, target->object, axis_));
    }
    answer.items.push_back({name, result.value});
  }
  answer.kind = axis_event_t::EVENT_DONE;
  answer.code = kNotAvailable;
  answer.text = "read";
  co_return answer;
}

Task<GatewayCommands::Answer> GatewayCommands::lock(std::int64_t source) {
  const ObjectResult result = co_await axis_.lcm_port().write(AXIS_OBJ_COMMAND_SOURCE, source);
  Answer answer;
  if (!result.ok()) {
    co_return refused(std::move(answer), "command_source", source, result.abort,
                      reason_of(result, AXIS_OBJ_COMMAND_SOURCE, axis_));
  }
  axis_.publisher().update(AXIS_OBJ_COMMAND_SOURCE, source);
  answer.kind = axis_event_t::EVENT_DONE;
  answer.code = kNotAvailable;
  answer.text = "the axis belongs to " +
                host::enum_text(AXIS_OBJ_COMMAND_SOURCE, static_cast<std::int32_t>(source));
  answer.items = {{"command_source", source}};
  co_return answer;
}

Task<GatewayCommands::Answer> GatewayCommands::capture(const axis_command_t &command) {
  Answer answer;
  answer.kind = axis_event_t::EVENT_REFUSED;
  if (command.signal.empty() || command.signal.size() > RECORDER_CHANNELS) {
    answer.text = "expected 1 to " + std::to_string(RECORDER_CHANNELS) + " signals, got " +
                  std::to_string(command.signal.size());
    co_return answer;
  }
  if (capturing_) {
    answer.text =
        "another recording is in progress; write 0 to recorder_arm to stop that recording";
    co_return answer;
  }
  // An incident_command needs no new recording, because the recording of an incident is complete.
  const bool fetches = command.object == std::vector<std::string>{"incident_command"};
  for (const std::string &name : command.object) {
    if (!name.starts_with("recorder_") && !fetches) {
      answer.text = name + ": expected a setting of the recorder";
      co_return answer;
    }
  }
  axis_command_t settings = command;
  for (std::size_t i = 0; i < RECORDER_CHANNELS && !fetches; ++i) {
    std::int64_t where = 0;
    if (i < command.signal.size()) {
      const auto object = host::find_object(command.signal[i]);
      if (!object) {
        answer.text = command.signal[i] + ": no such object";
        co_return answer;
      }
      const ObjectAddress address = address_of(*object);
      where = std::int64_t{address.index} << 8 | address.sub;
    }
    settings.object.push_back("recorder_signal_" + std::to_string(i + 1));
    settings.value.push_back(where);
  }
  if (!fetches) {
    settings.object.push_back("recorder_arm");
    settings.value.push_back(1);
  }
  answer = co_await write_items(settings);
  if (answer.kind != axis_event_t::EVENT_DONE) co_return answer;
  answer.text = fetches ? "incident fetched" : "recorder armed";
  capturing_ = true;
  recording_ = Recording{};
  recording_.id = {command.run_id, command.command_id};
  loop_.spawn(follow_capture(command));
  co_return answer;
}

void GatewayCommands::end_capture(lcm_bus::CommandId id, std::int64_t code,
                                  const std::string &text) {
  capturing_ = false;
  recording_.complete = true;
  if (code < 0) recording_.failure = text;
  axis_.publisher().event(axis_event_t::EVENT_CAPTURE, code, text, {}, id);
}

// Waits until the recorder has finished, and uploads the recording. The upload uses the SDO channel
// of the master, so that clients can send further commands over the channel of LCM during a long
// upload.
Task<void> GatewayCommands::follow_capture(axis_command_t command) {
  const lcm_bus::CommandId id{command.run_id, command.command_id};
  while (loop_.running()) {
    co_await loop_.sleep(kRecorderPoll);
    const ObjectResult state = co_await axis_.master_port().read(AXIS_OBJ_RECORDER_STATE);
    if (!state.ok()) {
      end_capture(id, -1, "capture failed: " + reason_of(state, AXIS_OBJ_RECORDER_STATE, axis_));
      co_return;
    }
    if (state.value == AXIS_RECORDER_STATE_DONE) break;
    if (state.value == AXIS_RECORDER_STATE_IDLE) {
      end_capture(id, -1, "capture failed: the recorder was stopped");
      co_return;
    }
  }
  co_await publish_capture(command, id);
}

Task<void> GatewayCommands::publish_capture(const axis_command_t &command, lcm_bus::CommandId id) {
  ObjectPort port = axis_.master_port();
  const ObjectResult trigger = co_await port.read(AXIS_OBJ_RECORDER_TRIGGER_INDEX);
  const ObjectResult decimation = co_await port.read(AXIS_OBJ_RECORDER_DECIMATION);
  const canopen::SdoResult got = co_await axis_.master_channel().upload(kRecorderData, 0);
  if (!trigger.ok() || !decimation.ok() || !got.ok()) {
    end_capture(id, -1,
                "capture failed: " + hex(kRecorderData) + " " +
                    canopen::abort_text(got.ok() ? canopen::kAbortTimeout : got.abort));
    co_return;
  }
  // After this write, the black box can use the recorder again. The write is refused if a source
  // other than CANopen owns the axis; a client that is the owner then writes the value itself.
  co_await port.write(AXIS_OBJ_RECORDER_ARM, 0);
  Recording &kept = recording_;
  for (const std::string &name : command.signal) {
    if (name == "tick_count") kept.tick_at = kept.columns.size();
    kept.columns.push_back(address_of(*host::find_object(name)));
    kept.row_bytes += kept.columns.back().bytes;
  }
  const auto total = static_cast<std::int64_t>(got.data.size() / kept.row_bytes);
  kept.bytes = got.data;
  kept.block.capture_id = ++captures_;
  kept.block.command_run_id = id.run_id;
  kept.block.command_id = id.command_id;
  kept.block.decimation = decimation.value;
  kept.block.total_samples = total;
  kept.block.trigger_sample = trigger.value;
  kept.block.num_signals = static_cast<std::int32_t>(kept.columns.size());
  kept.block.signal = command.signal;
  co_await publish_samples(recording_.id, {0, total});
  end_capture(id, total,
              std::to_string(total) + " samples of " + std::to_string(kept.columns.size()) +
                  " signals captured");
}

// Publishes the samples `range` of the recording, until another recording starts.
Task<void> GatewayCommands::publish_samples(Id id, Range range) {
  for (std::int64_t first = range.first; first < range.second; first += kBlock) {
    if (recording_.id != id) co_return;
    const Recording &kept = recording_;
    axis_capture_t block = kept.block;
    const std::int64_t end = std::min(first + kBlock, range.second);
    for (std::int64_t sample = first; sample < end; ++sample) {
      std::span<const std::uint8_t> bytes =
          std::span(kept.bytes).subspan(static_cast<std::size_t>(sample) * kept.row_bytes);
      std::vector<std::int64_t> &values = block.value.emplace_back();
      for (const ObjectAddress &column : kept.columns) {
        values.push_back(value_of(bytes.first(column.bytes), column.is_signed));
        bytes = bytes.subspan(column.bytes);
      }
    }
    block.first_sample = first;
    block.num_samples = static_cast<std::int32_t>(end - first);
    block.first_tick = kept.tick_at ? block.value[0][*kept.tick_at] : kNotAvailable;
    block.utime = kept.tick_at ? block.first_tick * 2000 / 3 : kNotAvailable;
    lcm_.publish(axis_.number(), block);
    if (end < range.second) co_await loop_.sleep(kBlockTime);
  }
}

// Answers with the number of samples of the recording, or 0 while the recording is in progress.
// Sends the samples again whose messages the client has not received.
GatewayCommands::Answer GatewayCommands::repeat(const axis_command_t &command) {
  Answer answer;
  answer.kind = axis_event_t::EVENT_REFUSED;
  const bool is_whole = command.object.size() % 2 == 1 && command.object[0] == "command_id";
  if (!is_whole) {
    answer.text = "expected command_id, then pairs of first_sample and end_sample";
    return answer;
  }
  if (recording_.id != Id{command.run_id, command.value[0]}) {
    answer.text = "another recording has started since; record again";
    return answer;
  }
  if (!recording_.failure.empty()) {
    answer.text = recording_.failure;
    return answer;
  }
  const std::int64_t total = recording_.complete ? recording_.block.total_samples : 0;
  std::vector<Range> ranges;
  std::int64_t left = total;  // a request cannot ask for more samples than the recording has
  for (std::size_t i = 1; i < command.value.size(); i += 2) {
    const std::int64_t first = std::clamp<std::int64_t>(command.value[i], 0, total);
    const std::int64_t end = std::clamp<std::int64_t>(command.value[i + 1], 0, first + left);
    if (first >= std::min(end, total)) continue;
    ranges.emplace_back(first, std::min(end, total));
    left -= ranges.back().second - first;
  }
  answer.kind = axis_event_t::EVENT_DONE;
  answer.code = kNotAvailable;
  answer.text = total == 0 ? "the recording is in progress" : "samples are sent again";
  answer.items = {{"total_samples", total}};
  // Only one repetition runs at a time, which limits the rate of messages. The client requests the
  // remaining samples later.
  if (!repeating_ && !ranges.empty()) loop_.spawn(repeat_samples(std::move(ranges)));
  return answer;
}

Task<void> GatewayCommands::repeat_samples(std::vector<Range> ranges) {
  repeating_ = true;
  const Id id = recording_.id;
  for (const Range &range : ranges) {
    co_await publish_samples(id, range);
    co_await loop_.sleep(kBlockTime);
  }
  repeating_ = false;
}

}  // namespace forceaxis::nodes
