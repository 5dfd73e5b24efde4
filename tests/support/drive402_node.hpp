#ifndef TESTS_SUPPORT_DRIVE402_NODE_HPP_
#define TESTS_SUPPORT_DRIVE402_NODE_HPP_

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/frames.hpp"

// A drive as CiA 301 and IEC 61800-7-201 (CiA 402) describe it, for tests of its master: NMT,
// expedited SDO, one RPDO and one TPDO by their mapping, heartbeats, states. Nothing of the
// firmware is used. It answers a frame at once; time passes by Tick(), 1/1500 s.
class DriveNode {
 public:
  // Names of the standard.
  enum State {
    kNotReady,
    kSwitchOnDisabled,
    kReady,
    kSwitchedOn,
    kOperationEnabled,
    kQuickStopActive,
    kFaultReaction,
    kFault
  };
  static constexpr uint8_t kPreOperational = 127, kOperational = 5, kStopped = 4;
  using Address = std::pair<uint16_t, uint8_t>;

  explicit DriveNode(uint8_t id) : id_(id) { Reset(); }

  // The lowest seven bits of the statusword in each state, x read as 0 but for bit 5.
  static uint16_t Coding(State state) {
    static const std::map<State, uint16_t> bits{
        {kNotReady, 0x00},   {kSwitchOnDisabled, 0x40}, {kReady, 0x21},
        {kSwitchedOn, 0x23}, {kOperationEnabled, 0x27}, {kQuickStopActive, 0x07},
        {kFault, 0x08},      {kFaultReaction, 0x0F},
    };
    return bits.at(state);
  }

  // Power-up, or the NMT command reset node: defaults, boot-up message, pre-operational.
  void Reset() {
    objects_ = {
        {{0x1005, 0}, {0x80, 4}},
        {{0x1006, 0}, {0, 4}},
        {{0x1016, 1}, {0, 4}},
        {{0x1017, 0}, {0, 2}},
        {{0x1400, 1}, {0x200u + id_, 4}},
        {{0x1400, 2}, {255, 1}},
        {{0x1600, 0}, {1, 1}},
        {{0x1600, 1}, {0x60400010, 4}},
        {{0x1600, 2}, {0, 4}},
        {{0x1800, 1}, {0x40000180u + id_, 4}},
        {{0x1800, 2}, {255, 1}},
        {{0x1A00, 0}, {1, 1}},
        {{0x1A00, 1}, {0x60410010, 4}},
        {{0x1A00, 2}, {0, 4}},
        {{0x1A00, 3}, {0, 4}},
        {{0x603F, 0}, {0, 2}},
        {{0x6007, 0}, {1, 2}},
        {{0x6040, 0}, {0, 2}},
        {{0x6041, 0}, {0, 2}},
        {{0x605A, 0}, {2, 2}},
        {{0x6060, 0}, {0, 1}},
        {{0x6061, 0}, {0, 1}},
        {{0x6064, 0}, {0, 4}},
        {{0x6071, 0}, {0, 2}},
        {{0x6077, 0}, {0, 2}},
        {{0x607A, 0}, {0, 4}},
        {{0x60C2, 1}, {1, 1}},
        {{0x60C2, 2}, {0xFD, 1}},
        {{0x60FF, 0}, {0, 4}},
    };
    for (const auto &[at, value] : at_reset) {
      if (at.first == 0x1019) objects_[at] = {0, 1};
      objects_.at(at).first = value;
    }
    state = kSwitchOnDisabled;
    nmt = kPreOperational;
    consumer_ticks_ = -1;
    Send(0x700 + id_, {0});
    producer_ticks_ = 0;
  }

  uint32_t Get(uint16_t index, uint8_t sub = 0) const { return objects_.at({index, sub}).first; }
  void Set(uint16_t index, uint32_t value, uint8_t sub = 0) {
    objects_.at({index, sub}).first = value;
  }

  void Receive(const Frame &frame) {
    if (dead) return;
    const uint32_t rpdo = Get(0x1400, 1);
    if (frame.id == 0) {
      Nmt(frame.data);
    } else if (frame.id == 0x80 && nmt == kOperational) {
      Synchronise();
    } else if (frame.id == 0x600 + id_ && nmt != kStopped) {
      Serve(frame.data);
    } else if (frame.id == (Get(0x1016, 1) >> 16) + 0x700) {
      consumer_ticks_ = static_cast<int>((Get(0x1016, 1) & 0xFFFF) * 3 + 1) / 2;
    } else if (frame.id == rpdo && nmt == kOperational) {
      if (Get(0x1400, 2) <= 240) {
        waiting_ = frame.data;
      } else {
        Apply(frame.data);
      }
    }
  }

  void Tick() {
    if (dead) return;
    const int period = static_cast<int>(Get(0x1017) * 3 + 1) / 2;
    if (period > 0 && ++producer_ticks_ >= period) {
      producer_ticks_ = 0;
      if (!mute_heartbeat) Send(0x700 + id_, {nmt});
    }
    if (consumer_ticks_ > 0 && --consumer_ticks_ == 0) Lost();
    if (state == kFaultReaction) state = kFault;
  }

  // Transition 13, with an emergency message of this code, or 0 for none.
  void Fail(uint16_t code) {
    state = kFaultReaction;
    Set(0x603F, code);
    if (code != 0) Emergency(code);
  }

  // With the error register (1001h), of which bit 0 is set by any error.
  void Emergency(uint16_t code, uint8_t error_register = 1) {
    Bytes data = LittleEndian(code, 2);
    data.push_back(error_register);
    data.resize(8);
    Send(0x80 + id_, data);
  }

  void Send(int id, const Bytes &data) { out.push_back({static_cast<uint16_t>(id), data}); }

  // With bit 12, by which an enabled drive says that it follows its target.
  uint16_t Statusword() const {
    const int follows = state == kOperationEnabled ? 0x1000 : 0;
    return static_cast<uint16_t>((Coding(state) | extra_status | follows) & ~missing_status);
  }

  State state;
  uint8_t nmt;
  bool dead = false;  // neither receives nor sends
  bool mute_heartbeat = false;
  bool mute_pdo = false;
  bool fault_stays = false;              // a fault reset does nothing
  std::map<Address, uint32_t> at_reset;  // values that a reset gives, of 1019h too
  std::set<Address> read_only;           // objects whose download is refused
  bool stays_disabled = false;           // transition 2 does not come: no power
  bool doubled = false;                  // TPDOs and answers to downloads come twice
  bool short_pdo = false;                // its TPDOs lack a byte
  uint16_t extra_status = 0x0200;        // bit 9, remote
  uint16_t missing_status = 0;           // bits of the statusword that stay 0
  std::optional<uint8_t> mode_shown;     // instead of the mode that is commanded
  std::vector<Frame> out;
  std::vector<Address> written;  // every object that was written, in this order
  // Replaces the answer to an SDO request; nullopt: no answer.
  std::function<std::optional<Bytes>(const Bytes &request, const Bytes &answer)> answers;

 private:
  void Nmt(const Bytes &data) {
    if (data.size() != 2 || (data[1] != 0 && data[1] != id_)) return;
    switch (data[0]) {
      case 0x01:
        nmt = kOperational;
        break;
      case 0x02:
        nmt = kStopped;
        break;
      case 0x80:
        nmt = kPreOperational;
        break;
      case 0x81:
      case 0x82:
        Reset();
        break;
      default:
        break;
    }
  }

  static Bytes Answer(uint8_t command, const Bytes &request, uint32_t value) {
    Bytes answer{command, request[1], request[2], request[3]};
    const Bytes bytes = LittleEndian(value, 4);
    answer.insert(answer.end(), bytes.begin(), bytes.end());
    return answer;
  }

  void Serve(const Bytes &request) {
    const Bytes answer = request.size() == 8 ? Transfer(request) : Bytes{};
    const std::optional<Bytes> sent = answers ? answers(request, answer) : std::optional(answer);
    if (sent) Send(0x580 + id_, *sent);
    if (sent && doubled && (*sent)[0] == 0x60) Send(0x580 + id_, *sent);
  }

  Bytes Transfer(const Bytes &request) {
    const Address at{static_cast<uint16_t>(request[1] | request[2] << 8), request[3]};
    const auto found = objects_.find(at);
    if (found == objects_.end()) return Answer(0x80, request, 0x06020000);
    const int bytes = found->second.second;
    if (request[0] == 0x40) {
      uint32_t value = found->second.first;
      if (at.first == 0x6061) value = mode_shown.value_or(static_cast<uint8_t>(Get(0x6060)));
      if (at.first == 0x6041) value = Statusword();
      return Answer(static_cast<uint8_t>(0x43 | (4 - bytes) << 2), request, value);
    }
    if (request[0] != (0x23 | (4 - bytes) << 2)) return Answer(0x80, request, 0x06070010);
    if (read_only.contains(at)) return Answer(0x80, request, 0x06010002);
    // CiA 301: the counter of SYNC is changed only while 1006h is 0.
    if (at.first == 0x1019 && Get(0x1006) != 0) return Answer(0x80, request, 0x08000022);
    const uint32_t value =
        request[4] | request[5] << 8 | request[6] << 16 | static_cast<uint32_t>(request[7]) << 24;
    // CiA 301: a mapping is changed only while the PDO does not exist and no object is mapped.
    const bool mapping = at.first == 0x1600 || at.first == 0x1A00;
    if (mapping && (Get(static_cast<uint16_t>(at.first - 0x200), 1) >> 31) == 0) {
      return Answer(0x80, request, 0x06010000);
    }
    if (mapping && at.second != 0 && Get(at.first) != 0) return Answer(0x80, request, 0x06010000);
    found->second.first = value;
    written.push_back(at);
    return Answer(0x60, request, 0);
  }

  // What was received takes effect, and the values of this instant are sent.
  void Synchronise() {
    if (waiting_) Apply(*waiting_);
    waiting_.reset();
    Set(0x6041, Statusword());
    Bytes data;
    for (uint32_t i = 1; i <= Get(0x1A00); ++i) {
      const uint32_t entry = Get(0x1A00, static_cast<uint8_t>(i));
      const Bytes bytes = LittleEndian(Get(static_cast<uint16_t>(entry >> 16)), (entry & 0xFF) / 8);
      data.insert(data.end(), bytes.begin(), bytes.end());
    }
    const uint32_t cob_id = Get(0x1800, 1);
    if (short_pdo && !data.empty()) data.pop_back();
    const int copies = (cob_id >> 31) != 0 || Get(0x1800, 2) != 1 || mute_pdo ? 0 : doubled ? 2 : 1;
    for (int i = 0; i < copies; ++i) Send(cob_id & 0x7FF, data);
  }

  void Apply(const Bytes &data) {
    size_t at = 0;
    for (uint32_t i = 1; i <= Get(0x1600); ++i) {
      const uint32_t entry = Get(0x1600, static_cast<uint8_t>(i));
      const int bytes = static_cast<int>(entry & 0xFF) / 8;
      if (at + static_cast<size_t>(bytes) > data.size()) return;
      uint32_t value = 0;
      for (int k = bytes; k-- > 0;) value = value << 8 | data[at + static_cast<size_t>(k)];
      at += static_cast<size_t>(bytes);
      const uint16_t before = static_cast<uint16_t>(Get(0x6040));
      Set(static_cast<uint16_t>(entry >> 16), value);
      if (entry >> 16 == 0x6040) Command(before, static_cast<uint16_t>(value));
    }
  }

  // Table "command coding" and the transitions of the state machine.
  void Command(uint16_t before, uint16_t word) {
    if ((word & 0x80) != 0) {
      if ((before & 0x80) == 0 && state == kFault && !fault_stays) state = kSwitchOnDisabled;  // 15
      return;
    }
    const bool disable_voltage = (word & 0x02) == 0;
    const bool quick_stop = (word & 0x06) == 0x02;
    const bool shutdown = (word & 0x07) == 0x06;
    const bool switch_on = (word & 0x0F) == 0x07;
    const bool enable = (word & 0x0F) == 0x0F;
    switch (state) {
      case kSwitchOnDisabled:
        if (shutdown && !stays_disabled) state = kReady;  // 2
        break;
      case kReady:
        if (switch_on) state = kSwitchedOn;                            // 3
        if (disable_voltage || quick_stop) state = kSwitchOnDisabled;  // 7
        break;
      case kSwitchedOn:
        if (enable) state = kOperationEnabled;                         // 4
        if (shutdown) state = kReady;                                  // 6
        if (disable_voltage || quick_stop) state = kSwitchOnDisabled;  // 10
        break;
      case kOperationEnabled:
        if (switch_on) state = kSwitchedOn;              // 5
        if (shutdown) state = kReady;                    // 8
        if (disable_voltage) state = kSwitchOnDisabled;  // 9
        if (quick_stop) state = kQuickStopActive;        // 11
        break;
      case kQuickStopActive:
        if (disable_voltage) state = kSwitchOnDisabled;  // 12
        if (enable) state = kOperationEnabled;           // 16
        break;
      default:
        break;
    }
  }

  // The master's heartbeat is missing: 6007h.
  void Lost() {
    if (state != kOperationEnabled) return;
    switch (Get(0x6007)) {
      case 1:
        Fail(0x8130);
        break;
      case 2:
        state = kSwitchOnDisabled;
        break;
      case 3:
        state = kQuickStopActive;
        break;
      default:
        break;
    }
  }

  uint8_t id_;
  std::map<Address, std::pair<uint32_t, int>> objects_;  // value and bytes
  std::optional<Bytes> waiting_;
  int producer_ticks_ = 0;
  int consumer_ticks_ = -1;
};

#endif
