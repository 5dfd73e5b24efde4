#ifndef TESTS_UNIT_DRIVE402_MODEL_HPP_
#define TESTS_UNIT_DRIVE402_MODEL_HPP_

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

#include "firmware/port/host/firmware.hpp"
#include "tests/firmware/unit/wide.hpp"
#include "tests/support/frames.hpp"

// What a master of a CiA 402 drive has to answer to any frames, written from the standard and from
// the manual in drive402.h: instants in place of counters, and none of the master's code. Of the
// firmware it has the names and the types of the interface alone.
class DriveModel {
 public:
  explicit DriveModel(const drive402_config_t &config) : config_(config) {
    const uint32_t id = config.node_id, rpdo = 0x200 + id;
    uint32_t tpdo = 0x40000180 + id;
    const uint32_t target = config.mode == 8   ? 0x607A0020
                            : config.mode == 9 ? 0x60FF0020
                                               : 0x60710010;
    for (int i = 0; i < config.extra_count; ++i) {
      const auto &e = config.extra[i];
      list_.push_back({{e.index, e.sub, e.bytes, e.value}, true, true});
    }
    Add(0, {0x1005, 0, 4, 0x80});
    if (!(config.without & 2)) list_.push_back({{0x1006, 0, 4, 0}, true, false});
    list_.push_back({{0x1019, 0, 1, 0}, true, true});
    Add(1, {0x1006, 0, 4, 1000u * config.cycle_ms});
    Add(4, {0x1016, 1, 4, config.own_node_id << 16 | config.heartbeat_timeout_ms});
    Add(5, {0x1017, 0, 2, config.heartbeat_ms});
    Add(3, {0x6007, 0, 2, static_cast<uint16_t>(config.abort_option)});
    Map(6, 0x400, rpdo, config.rpdo_type, {0x60400010, target});
    if (config.without & 1 << 12) tpdo &= 0x7FF;
    Map(8, 0x800, tpdo, 1,
        config.without & 1 << 11 ? std::vector<uint32_t>{0x60410010, 0x60640020}
                                 : std::vector<uint32_t>{0x60410010, 0x60640020, 0x60770010});
    Add(2, {0x60C2, 1, 1, config.cycle_ms});
    Add(2, {0x60C2, 2, 1, 0xFD});
    Add(10, {0x6060, 0, 1, config.mode});
    Stand();
  }

  void Bus(bool off, int lost) {
    if (off) Fail(DRIVE402_BUS_OFF);
    if (lost > 0) Fail(DRIVE402_FRAMES_LOST);
  }

  void Receive(const Frame &f) {
    if (f.id == 0x80 + config_.node_id && f.data.size() == 8) {
      const int code = f.data[0] | f.data[1] << 8;
      if (code != 0) error_code_ = code;
      // CiA 301: byte 2 is the error register (1001h), 0 while there is no error.
      if (code != 0 && f.data[2] != 0 && phase_ == kRun) Fail(DRIVE402_DRIVE_EMERGENCY);
    } else if (f.id == 0x180 + config_.node_id && sync_at_ >= 0) {
      if (f.data.size() == (config_.without & 1 << 11 ? 6 : 8)) {
        Sample(f.data);
      } else {
        other_length_ = true;
      }
    } else if (f.id == 0x580 + config_.node_id && f.data.size() == 8) {
      Answer(f.data);
    } else if (f.id == 0x700 + config_.node_id && f.data.size() == 1) {
      Heartbeat(f.data[0] & 0x7F);
    }
  }

  // The frames of a tick; `kept`: not all of the last tick were fetched.
  std::vector<Frame> Tick(const drive402_command_t &command, bool kept) {
    std::vector<Frame> out;
    if (kept) Fail(DRIVE402_FRAMES_KEPT);
    if (command.reset && !reset_before_) Reset();
    reset_before_ = command.reset != 0;
    if (phase_ >= kStart || sync_at_ >= 0) Cycle(command, out);
    answered_ = reason_ != 0;
    Work(out);
    if (now_ >= beat_) {
      out.push_back({static_cast<uint16_t>(0x700 + config_.own_node_id), {5}});
      beat_ = now_ + Ticks(config_.heartbeat_ms);
    }
    ++now_;
    return out;
  }

  drive402_feedback_t Say() const {
    drive402_feedback_t said{};
    said.position_cnt = position_;
    said.torque = torque_;
    said.age_ticks =
        sampled_at_ ? static_cast<uint16_t>(std::min(now_ - *sampled_at_, 65535L)) : 65535;
    said.statusword = static_cast<uint16_t>(word_);
    said.error_code = static_cast<uint16_t>(error_code_);
    said.fitted = 1;
    said.on = On();
    said.fault = reason_ != 0 || Is("fault") || Is("fault reaction active");
    said.limit = word_ >> 11 & 1;
    said.saturated = saturated_;
    said.phase = static_cast<uint8_t>(phase_);
    said.state = StateNumber();
    said.reason = static_cast<uint8_t>(reason_);
    said.failed_index = static_cast<uint16_t>(failed_index_);
    said.failed_sub = static_cast<uint8_t>(failed_sub_);
    said.abort_code = abort_code_;
    return said;
  }

  // The state of the drive by its name in the standard.
  static std::string_view NameOf(int word) {
    const auto bit = [word](int n) { return (word >> n & 1) != 0; };
    const int low = word & 0x0F;
    if (!bit(6)) {
      if (low == 0x00) return "not ready to switch on";
      if (low == 0x08) return "fault";
      if (low == 0x0F) return "fault reaction active";
      if (bit(5) && low == 0x01) return "ready to switch on";
      if (bit(5) && low == 0x03) return "switched on";
      if (bit(5) && low == 0x07) return "operation enabled";
      if (!bit(5) && low == 0x07) return "quick stop active";
      return "";
    }
    return low == 0x00 ? "switch on disabled" : "";
  }

 private:
  enum Phase { kReset, kConfigure, kStart, kRun };
  enum Transfer { kIdle, kDue, kSent, kTaken, kAborted, kUnexpected, kTimedOut };
  using Entry = std::tuple<int, int, int, uint32_t>;  // index, sub, bytes, value
  struct Step {
    Entry entry;
    bool written, compared;
  };

  bool Lacks(int bit) const { return (config_.without >> bit & 1) != 0; }
  bool Differs(int bit) const { return (config_.differs >> bit & 1) != 0; }

  // An object of the configuration, with the number of its bit in `without` and `differs`.
  void Add(int bit, const Entry &entry) {
    if (!Lacks(bit)) list_.push_back({entry, true, !Differs(bit)});
  }

  // A PDO; bit + 1 is that of its transmission type. A fixed mapping is compared alone.
  void Map(int bit, int base, uint32_t cob_id, uint32_t type, const std::vector<uint32_t> &mapped) {
    const bool fixed = Lacks(bit);
    const auto add = [&](int index, int sub, int bytes, uint32_t value) {
      if (!fixed || !Differs(bit))
        list_.push_back({{index, sub, bytes, value}, !fixed, !Differs(bit)});
    };
    if (!fixed) add(0x1000 + base, 1, 4, 0x80000000 | cob_id);
    Add(bit + 1, {0x1000 + base, 2, 1, type});
    if (!fixed) list_.push_back({{0x1200 + base, 0, 1, 0}, true, false});
    for (size_t i = 0; i < mapped.size(); ++i) {
      add(0x1200 + base, static_cast<int>(i + 1), 4, mapped[i]);
    }
    add(0x1200 + base, 0, 1, static_cast<uint32_t>(mapped.size()));
    add(0x1000 + base, 1, 4, cob_id);
  }

  static long Ticks(long ms) { return (3 * ms + 1) / 2; }

  void Fail(int reason) {
    if (reason_ == 0) reason_ = reason;
  }

  void FailAt(int reason, uint32_t abort_code = 0) {
    if (reason_ != 0) return;
    std::tie(failed_index_, failed_sub_) = std::tie(std::get<0>(asked_), std::get<1>(asked_));
    abort_code_ = abort_code;
    reason_ = reason;
  }

  bool Is(std::string_view name) const { return state_ == name; }

  uint8_t StateNumber() const {
    for (uint8_t i = 0; i < DRIVE402_UNKNOWN; ++i) {
      if (state_ == drive402_state_text(i)) return i;
    }
    return DRIVE402_UNKNOWN;
  }

  // Bits 9 and 12 of the statusword, where the drive has them.
  bool Remote() const { return Lacks(13) || (word_ >> 9 & 1) != 0; }
  bool Follows() const {
    return Is("operation enabled") && Remote() && (Lacks(14) || (word_ >> 12 & 1) != 0);
  }

  bool On() const {
    return phase_ == kRun && reason_ == 0 && Follows() && displayed_ && last_control_ == 0x0F;
  }

  // No cyclic frame was exchanged, the drive stands.
  void Stand() {
    word_ = 0;
    state_ = NameOf(word_);
    sampled_at_.reset();
    sync_at_ = -1;
    samples_ = missing_ = doubled_ = 0;
    other_length_ = answered_start_ = false;
    stop_until_ = -1;
    last_control_ = 0;
    saturated_ = displayed_ = was_on_ = reset_waits_ = false;
  }

  void Go(Phase phase) {
    phase_ = phase;
    sent_at_ = -1;
    next_ = 0;
    asked_ = {};
    transfer_ = kIdle;
    request_at_ = -100;
    writing_ = repeated_ = segmented_ = late_ack_ = false;
    second_answers_ = 0;
  }

  void Reset() {
    const bool in_place =
        phase_ == kRun && (reason_ == DRIVE402_DRIVE_FAULT || reason_ == DRIVE402_DRIVE_OFF ||
                           reason_ == DRIVE402_DRIVE_EMERGENCY || reason_ == DRIVE402_NOT_REMOTE ||
                           reason_ == DRIVE402_NOT_ENABLED || reason_ == DRIVE402_TARGET_IGNORED);
    reset_asked_ = phase_ != kRun || (reason_ != 0 && !in_place);
    if (!answered_) return;
    reason_ = failed_index_ = failed_sub_ = 0;
    abort_code_ = 0;
    if (in_place) {
      reset_waits_ = true;
      Wait();
    } else {
      Go(kReset);
    }
  }

  void Heartbeat(int state) {
    if (state == 0) {
      if (phase_ >= kStart) {
        Fail(DRIVE402_BOOTED);
      } else if (reason_ == 0 && (phase_ == kConfigure || sent_at_ >= 0)) {
        Go(kConfigure);
      }
      return;
    }
    heard_at_ = now_;  // between the last tick and this one
    operational_ = state == 5;
    if (phase_ == kRun && state != 5) Fail(DRIVE402_NOT_OPERATIONAL);
  }

  void Sample(const Bytes &data) {
    const bool late = missing_ > 0 && samples_ == 0;
    ++samples_;
    sampled_at_ = sync_at_ - (late ? Ticks(config_.cycle_ms) : 0);
    word_ = data[0] | data[1] << 8;
    state_ = NameOf(word_);
    position_ = static_cast<int32_t>(static_cast<uint32_t>(data[2] | data[3] << 8 | data[4] << 16) |
                                     static_cast<uint32_t>(data[5]) << 24);
    if (data.size() == 8) torque_ = static_cast<int16_t>(data[6] | data[7] << 8);
    answered_start_ = true;
  }

  void Cycle(const drive402_command_t &command, std::vector<Frame> &out) {
    const bool begins = sync_at_ < 0 || now_ - sync_at_ == Ticks(config_.cycle_ms);
    if (begins) {
      // A second TPDO that is no late one, in two cycles in succession.
      doubled_ = samples_ > 1 && missing_ == 0 && phase_ != kReset && !Lacks(9) ? doubled_ + 1 : 0;
      if (doubled_ > 1) {
        doubled_ = 1;
        Fail(DRIVE402_DOUBLED);
      }
      missing_ = samples_ > 0 || phase_ != kRun ? 0 : std::min(missing_ + 1, 2);
      if (missing_ == 2) Fail(DRIVE402_TPDO_MISSING);
      samples_ = 0;
      sync_at_ = now_;
      out.push_back({0x80, {}});
    }
    if (phase_ == kRun) Observe(command.enable != 0);
    const bool wanted = phase_ == kRun && command.enable && reason_ == 0;
    const bool stops = last_control_ == 0x0F && !wanted;
    if (stops) {
      stop_until_ = now_ + Ticks(config_.quick_stop_ms);
    } else if (Is("switch on disabled") || Is("fault")) {
      stop_until_ = -1;
    }
    if (begins || stops) {
      const int64_t target = Target(command.target, wanted);
      last_control_ = Control(wanted);
      Bytes data = LittleEndian(static_cast<uint32_t>(last_control_), 2);
      const Bytes bytes =
          LittleEndian(static_cast<uint32_t>(target), config_.mode == DRIVE402_CST ? 2 : 4);
      data.insert(data.end(), bytes.begin(), bytes.end());
      out.push_back({static_cast<uint16_t>(0x200 + config_.node_id), data});
    }
    was_on_ = wanted && On();
    // The wait for the drive: while it is to come on, or its fault to go.
    const bool waits = wanted ? !was_on_ : reset_waits_;
    if (phase_ == kRun && (now_ <= stop_until_ || !waits)) Wait();
  }

  void Wait() { wait_until_ = now_ + Ticks(config_.wait_ms) + 1; }

  int OffReason() const {
    if (!Remote()) return DRIVE402_NOT_REMOTE;
    if (!Is("operation enabled")) return was_on_ ? DRIVE402_DRIVE_OFF : DRIVE402_NOT_ENABLED;
    return displayed_ ? DRIVE402_TARGET_IGNORED : DRIVE402_MODE_LOST;
  }

  void Observe(bool enabled) {
    const bool faulted = Is("fault") || Is("fault reaction active");
    const bool late = now_ >= wait_until_;
    if (faulted && (!reset_waits_ || late)) Fail(DRIVE402_DRIVE_FAULT);
    if ((enabled && late) || (was_on_ && !Follows())) Fail(OffReason());
    if (!faulted || reason_ != 0) reset_waits_ = false;
  }

  int64_t Target(int32_t target, bool wanted) {
    saturated_ = false;
    if (!wanted || !On()) return config_.mode == DRIVE402_CSP ? position_ : 0;
    const Wide exact =
        FloorDivide(static_cast<Wide>(target) * config_.scale_num * 2 + config_.scale_den,
                    static_cast<Wide>(config_.scale_den) * 2);
    const Wide limited = Clamp(exact, -config_.target_max, config_.target_max);
    saturated_ = limited != exact;
    return static_cast<int64_t>(limited);
  }

  int Control(bool wanted) {
    if (now_ <= stop_until_) return 0x02;
    if (reset_waits_ && Is("fault")) {
      return 0x80;
    }
    if (!wanted) return 0x00;
    if (Is("switch on disabled")) return 0x06;
    if (Is("ready to switch on")) return 0x07;
    if (Is("switched on") || Is("operation enabled")) return 0x0F;
    return 0x00;
  }

  static std::pair<int, int> Address(const Entry &entry) {
    return {std::get<0>(entry), std::get<1>(entry)};
  }

  // Begins a transfer; its request is sent when the last one is 5 ticks old.
  void Ask(const Entry &entry, bool writes) {
    asked_ = entry;
    writing_ = writes;
    transfer_ = kDue;
    repeated_ = segmented_ = false;
    if (writes) late_ack_ = false;
  }

  void SendRequest(std::vector<Frame> &out) {
    if (transfer_ == kSent && now_ - request_at_ >= Ticks(config_.sdo_timeout_ms)) {
      late_ack_ = late_ack_ || (writing_ && !repeated_);
      transfer_ = std::exchange(repeated_, true) ? kTimedOut : kDue;
      segmented_ = segmented_ && transfer_ == kTimedOut;
    }
    if (transfer_ != kDue || now_ < request_at_ + 5) return;
    const auto &[index, sub, bytes, value] = asked_;
    Bytes data(8, 0);
    if (segmented_) {
      data[0] = 0x60;
    } else {
      data[0] = static_cast<uint8_t>(!writing_    ? 0x40
                                     : bytes == 4 ? 0x23
                                     : bytes == 2 ? 0x2B
                                                  : 0x2F);
      data[1] = static_cast<uint8_t>(index & 0xFF);
      data[2] = static_cast<uint8_t>(index >> 8);
      data[3] = static_cast<uint8_t>(sub);
      for (int i = 0; writing_ && i < bytes; ++i)
        data[4 + i] = static_cast<uint8_t>(value >> 8 * i);
    }
    out.push_back({static_cast<uint16_t>(0x600 + config_.node_id), data});
    transfer_ = kSent;
    request_at_ = now_;
  }

  // The value of the object in so many bytes of an answer.
  void Take(const uint8_t *data, int count) {
    const int bytes = std::get<2>(asked_);
    value_ = 0;
    for (int i = 0; i < bytes; ++i) value_ |= static_cast<uint32_t>(data[i]) << 8 * i;
    transfer_ = count >= bytes ? kTaken : kUnexpected;
  }

  // CiA 301: answers of an SDO server.
  void Answer(const Bytes &a) {
    const int command = a[0] >> 5;
    if (transfer_ == kSent && segmented_ && command == 0) {
      const bool whole = (a[0] >> 4 & 1) == 0 && (a[0] & 1) == 1;
      return Take(&a[1], whole ? 7 - (a[0] >> 1 & 7) : 0);
    }
    if (std::pair{a[1] | a[2] << 8, int{a[3]}} != Address(asked_)) return;
    const bool acknowledges = a[0] == 0x60;
    if (acknowledges && !(transfer_ == kSent && writing_)) {
      if (!late_ack_) second_answers_ = std::min(second_answers_ + 1, 255);
      return;
    }
    if (transfer_ != kSent) return;
    if (a[0] == 0x80) {
      transfer_ = kAborted;
      value_ = static_cast<uint32_t>(a[4] | a[5] << 8 | a[6] << 16) | static_cast<uint32_t>(a[7])
                                                                          << 24;
    } else if (writing_) {
      transfer_ = acknowledges ? kTaken : kUnexpected;
    } else if (command != 2) {
      transfer_ = kUnexpected;
    } else if ((a[0] & 2) != 0) {
      Take(&a[4], (a[0] & 1) != 0 ? 4 - (a[0] >> 2 & 3) : 4);
    } else {
      segmented_ = true;
      transfer_ = kDue;
    }
  }

  int TransferReason() const {
    return transfer_ == kTimedOut  ? DRIVE402_SDO_TIMEOUT
           : transfer_ == kAborted ? DRIVE402_SDO_ABORTED
                                   : DRIVE402_SDO_UNEXPECTED;
  }

  void Configure(std::vector<Frame> &out) {
    if (transfer_ == kIdle) AskNext();
    SendRequest(out);
    if (transfer_ == kDue || transfer_ == kSent) return;
    if (second_answers_ > 1) return Fail(DRIVE402_DOUBLED);
    if (transfer_ != kTaken && transfer_ != kAborted) return FailAt(TransferReason(), refused_);
    const Step &step = list_[next_];
    if (writing_ && step.compared) {
      const uint32_t refused = transfer_ == kAborted ? value_ : 0;
      Ask(step.entry, false);
      refused_ = refused;
      return;
    }
    const bool optional = std::get<0>(step.entry) == 0x1019;
    if (step.compared && transfer_ == kAborted && !optional) {
      return FailAt(DRIVE402_SDO_ABORTED, refused_ != 0 ? refused_ : value_);
    }
    if (step.compared && transfer_ == kTaken && !Same(step.entry)) {
      return FailAt(refused_ != 0 ? DRIVE402_SDO_ABORTED : DRIVE402_SDO_DIFFERS, refused_);
    }
    ++next_;
    AskNext();
  }

  bool Same(const Entry &entry) const {
    const int bits = 8 * std::get<2>(entry);
    const bool cob_id = std::get<0>(entry) == 0x1400 || std::get<0>(entry) == 0x1800;
    const uint32_t mask = cob_id && std::get<1>(entry) == 1 ? 0xBFFFFFFF
                          : bits == 32                      ? 0xFFFFFFFF
                                                            : (1u << bits) - 1;
    return ((value_ ^ std::get<3>(entry)) & mask) == 0;
  }

  void AskNext() {
    refused_ = 0;
    if (next_ < list_.size()) return Ask(list_[next_].entry, list_[next_].written);
    Go(kStart);
    operational_ = false;
  }

  void Nmt(int command, std::vector<Frame> &out) {
    out.push_back({0, {static_cast<uint8_t>(command), config_.node_id}});
    sent_at_ = now_;
  }

  bool Waited() const { return now_ - sent_at_ >= Ticks(config_.wait_ms); }

  void Watch(std::vector<Frame> &out) {
    if (now_ - heard_at_ >= Ticks(config_.heartbeat_timeout_ms)) Fail(DRIVE402_HEARTBEAT_LOST);
    if (transfer_ == kIdle && now_ >= read_at_) {
      Ask(Is("fault") ? Entry{0x603F, 0, 2, 0} : Entry{0x6061, 0, 1, 0}, false);
    }
    SendRequest(out);
    if (transfer_ == kIdle || transfer_ == kDue || transfer_ == kSent) return;
    if (std::get<0>(asked_) == 0x603F) {
      if (transfer_ == kTaken && value_ != 0) error_code_ = static_cast<int>(value_);
    } else if (transfer_ != kTaken) {
      FailAt(TransferReason(), transfer_ == kAborted ? value_ : 0);
    } else {
      displayed_ = value_ == config_.mode;
      if (was_on_ && !displayed_) FailAt(DRIVE402_MODE_LOST);
    }
    transfer_ = kIdle;
    read_at_ = now_ + 15;
  }

  void Work(std::vector<Frame> &out) {
    if (phase_ == kRun) return Watch(out);
    if (reason_ != 0) return;
    switch (phase_) {
      case kReset:
        if (now_ < stop_until_) return;
        if (sent_at_ < 0) {
          Stand();
          return Nmt(0x81, out);
        }
        if (Waited()) Fail(DRIVE402_BOOT_TIMEOUT);
        return;
      case kConfigure:
        return Configure(out);
      default:
        if (sent_at_ < 0) return Nmt(0x01, out);
        if (operational_ && answered_start_) {
          Go(kRun);
          Wait();
          reset_waits_ = std::exchange(reset_asked_, false);
          read_at_ = now_ + 1;
        } else if (Waited()) {
          Fail(answered_start_ ? DRIVE402_START_TIMEOUT
               : other_length_ ? DRIVE402_TPDO_LENGTH
                               : DRIVE402_NO_TPDO);
        }
    }
  }

  drive402_config_t config_;
  std::vector<Step> list_;
  Phase phase_ = kReset;
  long now_ = 0;  // number of the next tick
  int reason_ = 0, failed_index_ = 0, failed_sub_ = 0;
  uint32_t abort_code_ = 0;
  bool reset_asked_ = false;  // before the drive runs
  bool answered_ = false;     // the last cyclic frames knew of the failure
  bool reset_before_ = false;
  long sent_at_ = -1;  // the NMT command of the phase
  long beat_ = 0, heard_at_ = 0;
  bool operational_ = false, answered_start_ = false;
  // SDO
  Entry asked_{};
  Transfer transfer_ = kIdle;
  uint32_t value_ = 0, refused_ = 0;
  bool writing_ = false, repeated_ = false, segmented_ = false, late_ack_ = false;
  int second_answers_ = 0;
  long request_at_ = -100, read_at_ = 0;
  size_t next_ = 0;
  // cycle
  long sync_at_ = -1, stop_until_ = -1, wait_until_ = 0;
  std::optional<long> sampled_at_;
  int samples_ = 0, missing_ = 0, doubled_ = 0, last_control_ = 0, word_ = 0, error_code_ = 0;
  int32_t position_ = 0;
  int16_t torque_ = 0;
  std::string_view state_;
  bool other_length_ = false, saturated_ = false, displayed_ = false, was_on_ = false,
       reset_waits_ = false;
};

#endif
