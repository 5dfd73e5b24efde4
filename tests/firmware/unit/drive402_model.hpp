#ifndef TESTS_UNIT_DRIVE402_MODEL_HPP_
#define TESTS_UNIT_DRIVE402_MODEL_HPP_

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string_view>
#include <tuple>
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
    const uint32_t id = config.node_id, rpdo = 0x200 + id, tpdo = 0x40000180 + id;
    const uint32_t target = config.mode == 8   ? 0x607A0020
                            : config.mode == 9 ? 0x60FF0020
                                               : 0x60710010;
    for (int i = 0; i < config.extra_count; ++i) {
      const auto &e = config.extra[i];
      list_.emplace_back(e.index, e.sub, e.bytes, e.value);
    }
    if (!(config.without & 1)) list_.emplace_back(0x1005, 0, 4, 0x80);
    if (!(config.without & 2)) list_.emplace_back(0x1006, 0, 4, 1000u * config.cycle_ms);
    list_.emplace_back(0x1016, 1, 4, config.own_node_id << 16 | config.heartbeat_timeout_ms);
    list_.emplace_back(0x1017, 0, 2, config.heartbeat_ms);
    if (!(config.without & 8)) {
      list_.emplace_back(0x6007, 0, 2, static_cast<uint16_t>(config.abort_option));
    }
    const std::vector<std::tuple<int, uint32_t, uint32_t, std::vector<uint32_t>>> pdos{
        {0x400, rpdo, config.rpdo_type, {0x60400010, target}},
        {0x800, tpdo, 1, {0x60410010, 0x60640020, 0x60770010}},
    };
    for (const auto &[base, cob_id, type, mapped] : pdos) {
      list_.emplace_back(0x1000 + base, 1, 4, 0x80000000 | cob_id);
      list_.emplace_back(0x1000 + base, 2, 1, type);
      list_.emplace_back(0x1200 + base, 0, 1, 0);
      for (size_t i = 0; i < mapped.size(); ++i) {
        list_.emplace_back(0x1200 + base, static_cast<int>(i + 1), 4, mapped[i]);
      }
      list_.emplace_back(0x1200 + base, 0, 1, static_cast<uint32_t>(mapped.size()));
      list_.emplace_back(0x1000 + base, 1, 4, cob_id);
    }
    if (!(config.without & 4)) {
      list_.emplace_back(0x60C2, 1, 1, config.cycle_ms);
      list_.emplace_back(0x60C2, 2, 1, 0xFD);
    }
    list_.emplace_back(0x6060, 0, 1, config.mode);
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
    } else if (f.id == 0x180 + config_.node_id && f.data.size() == 8 && sync_at_ >= 0) {
      Sample(f.data);
    } else if (f.id == 0x580 + config_.node_id && f.data.size() == 8) {
      if (asked_ && !answer_ && f.data[1] == (std::get<0>(*asked_) & 0xFF) &&
          f.data[2] == std::get<0>(*asked_) >> 8 && f.data[3] == std::get<1>(*asked_)) {
        answer_ = f.data;
      }
    } else if (f.id == 0x700 + config_.node_id && f.data.size() == 1) {
      Heartbeat(f.data[0] & 0x7F);
    }
  }

  // The frames of a tick; `kept`: not all of the last tick were fetched.
  std::vector<Frame> Tick(const drive402_command_t &command, bool kept) {
    std::vector<Frame> out;
    if (kept) Fail(DRIVE402_FRAMES_KEPT);
    if (command.reset && !reset_before_ && answered_) Reset();
    reset_before_ = command.reset != 0;
    if (phase_ >= kStart) Cycle(command, out);
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
  using Entry = std::tuple<int, int, int, uint32_t>;  // index, sub, bytes, value

  static long Ticks(long ms) { return (3 * ms + 1) / 2; }

  void Fail(int reason) {
    if (reason_ == 0) reason_ = reason;
  }

  void FailAt(int reason, uint32_t abort_code = 0) {
    if (reason_ != 0) return;
    std::tie(failed_index_, failed_sub_) = std::tie(std::get<0>(*asked_), std::get<1>(*asked_));
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

  bool On() const {
    return phase_ == kRun && reason_ == 0 && Is("operation enabled") && displayed_ &&
           last_control_ == 0x0F;
  }

  // No cyclic frame was exchanged, the drive stands.
  void Stand() {
    word_ = 0;
    state_ = NameOf(word_);
    sampled_at_.reset();
    sync_at_ = -1;
    samples_ = missing_ = 0;
    stop_until_ = -1;
    last_control_ = 0;
    saturated_ = displayed_ = was_on_ = reset_waits_ = false;
    reset_until_ = -1;
  }

  void Go(Phase phase) {
    phase_ = phase;
    sent_at_ = -1;
    next_ = 0;
    asked_.reset();
    answer_.reset();
  }

  void Reset() {
    const bool in_place =
        phase_ == kRun && (reason_ == DRIVE402_DRIVE_FAULT || reason_ == DRIVE402_DRIVE_OFF ||
                           reason_ == DRIVE402_DRIVE_EMERGENCY);
    reason_ = failed_index_ = failed_sub_ = 0;
    abort_code_ = 0;
    if (in_place) {
      reset_waits_ = true;
    } else {
      Stand();
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
    torque_ = static_cast<int16_t>(data[6] | data[7] << 8);
    answered_start_ = true;
  }

  void Cycle(const drive402_command_t &command, std::vector<Frame> &out) {
    const bool begins = sync_at_ < 0 || now_ - sync_at_ == Ticks(config_.cycle_ms);
    if (begins) {
      if (phase_ == kRun && sync_at_ >= 0) {
        missing_ = samples_ > 0 ? 0 : std::min(missing_ + 1, 2);
        if (missing_ == 2) Fail(DRIVE402_TPDO_MISSING);
      }
      samples_ = 0;
      sync_at_ = now_;
      out.push_back({0x80, {}});
    }
    if (phase_ == kRun) Observe(command.enable != 0);
    const bool wanted = phase_ == kRun && command.enable && reason_ == 0;
    const bool stops = last_control_ == 0x0F && !wanted;
    if (stops) stop_until_ = now_ + Ticks(config_.quick_stop_ms);
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
  }

  void Observe(bool enabled) {
    if (!Is("fault") && !Is("fault reaction active")) {
      reset_waits_ = false;
      reset_until_ = -1;
    } else if (!reset_waits_ && now_ >= reset_until_) {
      Fail(DRIVE402_DRIVE_FAULT);
    }
    if (enabled && was_on_ && !Is("operation enabled")) Fail(DRIVE402_DRIVE_OFF);
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
      reset_waits_ = false;
      reset_until_ = now_ + Ticks(config_.wait_ms);
      return 0x80;
    }
    if (!wanted) return 0x00;
    if (Is("switch on disabled")) return 0x06;
    if (Is("ready to switch on")) return 0x07;
    if (Is("switched on") || Is("operation enabled")) return 0x0F;
    return 0x00;
  }

  void Ask(const Entry &entry, bool writes, std::vector<Frame> &out) {
    const auto &[index, sub, bytes, value] = entry;
    Bytes data{static_cast<uint8_t>(!writes      ? 0x40
                                    : bytes == 4 ? 0x23
                                    : bytes == 2 ? 0x2B
                                                 : 0x2F),
               static_cast<uint8_t>(index & 0xFF), static_cast<uint8_t>(index >> 8),
               static_cast<uint8_t>(sub)};
    Bytes tail = LittleEndian(writes ? value : 0, bytes);
    tail.resize(4);
    data.insert(data.end(), tail.begin(), tail.end());
    out.push_back({static_cast<uint16_t>(0x600 + config_.node_id), data});
    asked_ = entry;
    answer_.reset();
    writing_ = writes;
    asked_at_ = now_;
  }

  // The value of an answer to the present request; without one the reason is set.
  std::optional<uint32_t> Value(int &reason, uint32_t &abort_code) const {
    const int bytes = std::get<2>(*asked_);
    const Bytes &a = *answer_;
    const uint32_t all =
        static_cast<uint32_t>(a[4] | a[5] << 8 | a[6] << 16) | static_cast<uint32_t>(a[7]) << 24;
    const int good = writing_ ? 0x60 : bytes == 4 ? 0x43 : bytes == 2 ? 0x4B : 0x4F;
    if (a[0] == 0x80) {
      reason = DRIVE402_SDO_ABORTED;
      abort_code = all;
      return std::nullopt;
    }
    if (a[0] != good) {
      reason = DRIVE402_SDO_UNEXPECTED;
      return std::nullopt;
    }
    return bytes == 4 ? all : all & ((1u << 8 * bytes) - 1);
  }

  // The end of a request: its value, or the reason of its failure.
  bool Ended(std::optional<uint32_t> &value, int &reason, uint32_t &abort_code) const {
    if (answer_) {
      value = Value(reason, abort_code);
      return true;
    }
    reason = DRIVE402_SDO_TIMEOUT;
    return now_ - asked_at_ >= Ticks(config_.sdo_timeout_ms);
  }

  void Configure(std::vector<Frame> &out) {
    if (!asked_) return Ask(list_[0], true, out);
    std::optional<uint32_t> value;
    int reason = 0;
    uint32_t abort_code = 0;
    if (!Ended(value, reason, abort_code)) return;
    if (!value) return FailAt(reason, abort_code);
    if (writing_) return Ask(list_[next_], false, out);
    const int bits = 8 * std::get<2>(*asked_);
    const uint32_t wanted = std::get<3>(*asked_) & (bits == 32 ? 0xFFFFFFFF : (1u << bits) - 1);
    if (*value != wanted) return FailAt(DRIVE402_SDO_DIFFERS);
    if (++next_ < list_.size()) return Ask(list_[next_], true, out);
    Go(kStart);
    Stand();
    operational_ = answered_start_ = false;
  }

  void Nmt(int command, std::vector<Frame> &out) {
    out.push_back({0, {static_cast<uint8_t>(command), config_.node_id}});
    sent_at_ = now_;
  }

  bool Waited() const { return now_ - sent_at_ >= Ticks(config_.wait_ms); }

  void Watch(std::vector<Frame> &out) {
    if (now_ - heard_at_ >= Ticks(config_.heartbeat_timeout_ms)) Fail(DRIVE402_HEARTBEAT_LOST);
    if (asked_) {
      std::optional<uint32_t> value;
      int reason = 0;
      uint32_t abort_code = 0;
      if (!Ended(value, reason, abort_code)) return;
      if (std::get<0>(*asked_) == 0x603F) {
        if (value.value_or(0) != 0) error_code_ = static_cast<int>(*value);
      } else if (!value) {
        FailAt(reason, abort_code);
      } else {
        displayed_ = *value == config_.mode;
        if (was_on_ && !displayed_) FailAt(DRIVE402_MODE_LOST);
      }
      asked_.reset();
      read_at_ = now_ + 15;
    }
    if (now_ >= read_at_)
      Ask(Is("fault") ? Entry{0x603F, 0, 2, 0} : Entry{0x6061, 0, 1, 0}, false, out);
  }

  void Work(std::vector<Frame> &out) {
    if (phase_ == kRun) return Watch(out);
    if (reason_ != 0) return;
    switch (phase_) {
      case kReset:
        if (sent_at_ < 0) return Nmt(0x81, out);
        if (Waited()) Fail(DRIVE402_BOOT_TIMEOUT);
        return;
      case kConfigure:
        return Configure(out);
      default:
        if (sent_at_ < 0) return Nmt(0x01, out);
        if (operational_ && answered_start_) {
          Go(kRun);
          read_at_ = now_ + 1;
        } else if (Waited()) {
          Fail(DRIVE402_START_TIMEOUT);
        }
    }
  }

  drive402_config_t config_;
  std::vector<Entry> list_;
  Phase phase_ = kReset;
  long now_ = 0;  // number of the next tick
  int reason_ = 0, failed_index_ = 0, failed_sub_ = 0;
  uint32_t abort_code_ = 0;
  bool answered_ = false;  // the last cyclic frames knew of the failure
  bool reset_before_ = false;
  long sent_at_ = -1;  // the NMT command of the phase
  long beat_ = 0, heard_at_ = 0;
  bool operational_ = false, answered_start_ = false;
  // SDO
  std::optional<Entry> asked_;
  std::optional<Bytes> answer_;
  bool writing_ = false;
  long asked_at_ = 0, read_at_ = 0;
  size_t next_ = 0;
  // cycle
  long sync_at_ = -1, stop_until_ = -1, reset_until_ = -1;
  std::optional<long> sampled_at_;
  int samples_ = 0, missing_ = 0, last_control_ = 0, word_ = 0, error_code_ = 0;
  int32_t position_ = 0;
  int16_t torque_ = 0;
  std::string_view state_;
  bool saturated_ = false, displayed_ = false, was_on_ = false, reset_waits_ = false;
};

#endif
