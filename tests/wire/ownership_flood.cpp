// Random masters against an oracle of who may do what, on an axis that presses, bounces and is
// struck.
//
// usage: ownership_flood TICKS SEED
//
// CANopen (SDO, RPDO, NMT, state of the bus), Modbus RTU and the sources behind a gateway write
// controlwords, command_source, modes and targets in any order, sensors fail, a second node of the
// same id speaks up, time passes. For most of it the owner presses on a part that is struck away
// and comes back (contact_scene.hpp), in every force mode, with caps, limits, laws and bias drawn
// anew.
//
// The oracle is written from the rules in docs/ and the meanings in axis_objects.toml,
// not from the firmware. It knows the answer to each write, the owner after each tick, whether the
// axis is held or halted, that the amplifier is on only for an owner who enabled it and off in the
// first tick after a stop and after a fault between two ticks; what the axis may do in a tick is
// judged by press_oracle.hpp, as in canopen_flood. The first difference ends the run with status 1.
// The last line has the counts and a hash of all outputs.

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "firmware/port/host/firmware.hpp"
#include "tests/support/frames.hpp"
#include "tests/wire/contact_scene.hpp"
#include "tests/wire/drawn_press.hpp"
#include "tests/wire/press_oracle.hpp"

namespace {

constexpr uint8_t kNode = 5;
constexpr int kHalt = 0x100;
enum Bus { kCanopen, kModbus, kLcm };
enum Answer { kDone, kLocked, kNotNow, kEither, kNone };

bool Enables(int word) { return (word & 0x8F) == 0x0F; }
bool Lowers(int word) { return (word & 0x80) == 0 && !Enables(word); }

// CiA 402's states, by the statusword.
enum State { kOff, kReady, kEnabled, kQuickStop, kFault };
State StateOf(int status) {
  if ((status & 0x4F) == 0x08 || (status & 0x4F) == 0x0F) return kFault;
  switch (status & 0x6F) {
    case 0x21:
    case 0x23:
      return kReady;
    case 0x27:
      return kEnabled;
    case 0x07:
      return kQuickStop;
    default:
      return kOff;
  }
}

struct Oracle {
  int owner = kCanopen;
  bool held = false;
  bool may_move = false;  // somebody who might has enabled it, and nobody has stopped it since
  int word = 0;           // the owner's controlword, and the halt of others
  int silent = 0, watchdog = 1500;
  bool wrote = false;
  bool on_can = true;  // the owner reaches the axis over CAN, as all do but Modbus RTU

  void Stop(State state, bool by_owner) {
    may_move = false;
    if (!by_owner && state != kOff && state != kFault) held = true;
  }

  Answer Controlword(int source, int asked, State state, bool serial) {
    const bool halts = (asked & kHalt) != 0;
    if (source != owner) {
      if (!halts && !Lowers(asked)) return kLocked;
      const bool moved = may_move;
      Halt(asked, state);
      Stop(state, false);
      may_move = moved && !Lowers(asked);
      return kDone;
    }
    if (held && Enables(asked)) {
      Halt(asked, state);
      return halts ? Fed() : kNotNow;
    }
    held = false;
    // A halt ends with a word that enables, not with one that commands nothing.
    word = asked | (state == kEnabled && !Enables(asked) ? word & kHalt : 0);
    if (Enables(asked)) may_move = true;
    if (Lowers(asked)) may_move = false;
    // Modbus on the line and through a gateway are one owner; what enables it over CAN is lost with
    // it.
    if (Enables(asked) && state == kReady && !serial) on_can = true;
    return Fed();
  }

  void Halt(int asked, State state) {
    if (state != kOff && state != kFault) word |= asked & kHalt;
  }

  Answer NativeModeOff(int source, State state) {
    Stop(state, source == owner);
    return source == owner ? Fed() : kDone;
  }

  Answer Take(int source, int wanted, bool still, bool serial, State state) {
    if (source != owner && (wanted != source || !still)) return kLocked;
    const bool powered = state == kEnabled || state == kQuickStop;
    const bool by_can = wanted != kModbus || !serial;
    if (by_can || wanted != owner || !powered) on_can = by_can;
    if (wanted != owner) silent = 0;
    owner = wanted;
    wrote = wanted == source;
    return kDone;
  }

  // What every source may write, to read and acknowledge results: it keeps no owner.
  Answer Open() const { return kDone; }

  Answer Other(int source) { return source == owner ? kEither : kLocked; }

  Answer Fed() {
    wrote = true;
    return kDone;
  }

  // NMT stop, resets, bus off.
  void BusStops(State state) {
    may_move = false;
    if (!on_can) {
      if (state == kEnabled || state == kQuickStop) held = true;
    } else {
      owner = kCanopen;
      on_can = true;
    }
  }

  // Before each tick.
  void Time() {
    if (owner == kCanopen) return;
    silent = wrote ? 1 : silent + 1;
    wrote = false;
    if (silent > watchdog) {
      owner = kCanopen;
      on_can = true;
      may_move = false;
    }
  }
};

class Flood {
 public:
  explicit Flood(uint64_t seed) : random_(seed) {
    fw_config_t config{};
    config.node_id = kNode;
    config.buses = 1;
    fw_init(&fw_, &config);
    inputs_.sensor_valid = 1;
    inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
    SetUp();
  }

  void Run(uint64_t ticks) {
    while (ticks_ < ticks) {
      for (uint32_t n = Below(4); n > 0; --n) Act();
      Tick();
      if (OneIn(40)) {
        for (uint32_t n = Below(OneIn(10) ? 400 : 30); n > 0; --n) {
          if (OneIn(10)) WriteOpen();
          Tick();
        }
      }
      if (OneIn(150)) Press();
    }
    std::printf("%s; %llu strikes; %llu writes, %llu of them refused; hash %016llx\n",
                rules_.counts().text().c_str(), Long(strikes_), Long(writes_), Long(refused_),
                Long(hash_));
  }

 private:
  static unsigned long long Long(uint64_t n) { return n; }
  uint32_t Below(uint32_t n) { return static_cast<uint32_t>(random_() % n); }
  bool OneIn(uint32_t n) { return Below(n) == 0; }

  int32_t Read(uint16_t object) const {
    int32_t value = 0;
    fw_object_read(&fw_, object, &value);
    return value;
  }
  State Now() const { return StateOf(Read(AXIS_OBJ_STATUSWORD)); }
  void Set(uint16_t object, int32_t value) {
    if (fw_object_write(&fw_, FW_SOURCE_LOCAL, object, value) != FW_OK) Fail("set-up", value, 0);
  }

  [[noreturn]] void Fail(const char *what, int64_t got, int64_t expected) const {
    Fail(std::string(what) + " is " + std::to_string(got) + ", expected " +
         std::to_string(expected));
  }
  [[noreturn]] void Fail(const std::string &what) const {
    std::printf("tick %llu: %s\n", Long(ticks_), what.c_str());
    std::exit(1);
  }

  // After a power-up: no option asks for a ramp; the loss of an owner is a fault, or not.
  void SetUp() {
    for (uint16_t object : {AXIS_OBJ_QUICK_STOP_OPTION, AXIS_OBJ_DISABLE_OPERATION_OPTION,
                            AXIS_OBJ_SHUTDOWN_OPTION, AXIS_OBJ_FAULT_REACTION_OPTION}) {
      Set(object, 0);
    }
    Set(AXIS_OBJ_ABORT_CONNECTION_OPTION, 1 + static_cast<int>(Below(2)));
    Set(AXIS_OBJ_POSITION_GAIN, 5 * 256);
    Set(AXIS_OBJ_HOMING_METHOD, -1);
    DrawLaw();
    const int ms = 10 + static_cast<int>(Below(200));
    Set(AXIS_OBJ_WATCHDOG, ms);
    oracle_ = Oracle{};
    oracle_.watchdog = (3 * ms + 1) / 2;
    Frame({0, {1, kNode}});
    nmt_ = kOperational;
  }

  // Of a disabled axis: the part, the law, and what bounds it.
  void DrawLaw() {
    scene_.Take(drawn_.Shape());
    for (const auto &one : drawn_.Law(scene_.Encoder())) Set(one.object, one.value);
    switch_pos_ = OneIn(3) ? scene_.Encoder() + 150 : INT32_MAX;
    switch_neg_ = OneIn(3) ? scene_.Encoder() - 150 : INT32_MIN;
  }

  void Frame(const ::Frame &frame) {
    can_frame_t f{};
    f.id = frame.id;
    f.length = static_cast<uint8_t>(frame.data.size());
    for (size_t i = 0; i < frame.data.size(); ++i) f.data[i] = frame.data[i];
    fw_can_receive(&fw_, &f);
  }

  void Drain(uint8_t sdo[8]) {
    for (can_frame_t f{}; fw_can_transmit(&fw_, &f);) {
      if (f.id == 0x580 + kNode && sdo != nullptr) std::copy_n(f.data, 8, sdo);
    }
  }

  Answer WriteSdo(uint16_t object, int32_t value) {
    const axis_address_t *at = nullptr;
    for (const axis_address_t &a : axis_addresses) {
      if (a.what == AXIS_ADDRESS_OBJECT && a.value == object) at = &a;
    }
    const int bytes = value_bytes(axis_objects[object].type);
    Bytes data{static_cast<uint8_t>(0x23 | (4 - bytes) << 2), static_cast<uint8_t>(at->index),
               static_cast<uint8_t>(at->index >> 8), at->sub};
    for (uint8_t b : LittleEndian(static_cast<uint32_t>(value), 4)) data.push_back(b);
    uint8_t answer[8] = {};
    Drain(nullptr);
    Frame({0x600 + kNode, data});
    Drain(answer);
    if (answer[0] == 0) return kNone;
    if (answer[0] == 0x60) return kDone;
    const int code = answer[4] | answer[5] << 8 | answer[6] << 16 | answer[7] << 24;
    return code == 0x08000021 ? kLocked : kNotNow;
  }

  Answer WriteRtu(uint16_t object, int32_t value) {
    uint16_t first = 0;
    for (const axis_register_t &r : axis_holding) {
      if (r.object == object) first = r.first;
    }
    const auto word = static_cast<uint32_t>(value);
    Bytes frame{kNode,
                6,
                static_cast<uint8_t>(first >> 8),
                static_cast<uint8_t>(first),
                static_cast<uint8_t>(word >> 8),
                static_cast<uint8_t>(word)};
    const uint16_t crc = Crc16(frame);
    frame.push_back(static_cast<uint8_t>(crc));
    frame.push_back(static_cast<uint8_t>(crc >> 8));
    fw_modbus_receive(&fw_, frame.data(), static_cast<uint16_t>(frame.size()));
    std::array<uint8_t, 16> answer{};
    const uint16_t n = fw_modbus_transmit(&fw_, answer.data(), answer.size());
    return n == 0 ? kNone : answer[1] == 6 ? kDone : kNotNow;
  }

  // By the source's way; which exception Modbus gives says no more than "not now".
  void Write(int source, uint16_t object, int32_t value, Answer expected) {
    Write(source, object, value, expected, source == kModbus && OneIn(2));
  }
  void Write(int source, uint16_t object, int32_t value, Answer expected, bool serial) {
    Answer got;
    if (source == kCanopen) {
      got = WriteSdo(object, value);
      if (nmt_ == kStopped) expected = kNone;
    } else if (serial) {
      got = WriteRtu(object, value);
      if (expected == kLocked) expected = kNotNow;
    } else {
      const int refusal = fw_object_write(&fw_, static_cast<uint8_t>(source), object, value);
      got = refusal == FW_OK ? kDone : refusal == FW_ERROR_LOCKED ? kLocked : kNotNow;
    }
    if (Now() != kEnabled) rules_.Leave();
    ++writes_;
    refused_ += got != kDone;
    if (expected == kEither && (got == kDone || got == kNotNow)) {
      if (got == kDone) oracle_.wrote = true;
      return;
    }
    if (got != expected) Fail("the answer to a write", got, expected);
  }

  int Word() {
    static constexpr int kWords[] = {0x00, 0x02, 0x06, 0x06, 0x07, 0x0F, 0x0F, 0x0F, 0x80, 0x1F};
    const int word = OneIn(8) ? static_cast<int>(Below(65536)) : kWords[Below(10)];
    return OneIn(12) ? word | kHalt : word;
  }

  // A source that cannot be heard asks for nothing.
  bool Heard(int source) const { return source != kCanopen || nmt_ != kStopped; }

  void Act() {
    const int source = OneIn(2) ? oracle_.owner : static_cast<int>(Below(3));
    const State state = Now();
    const bool heard = Heard(source);
    switch (Below(20)) {
      case 0: {
        const int wanted = static_cast<int>(OneIn(3) ? Below(3) : static_cast<uint32_t>(source));
        const bool still = (state == kOff || state == kReady || state == kFault) &&
                           Read(AXIS_OBJ_ACTIVE_MODE) == AXIS_MODE_DISABLED;
        const bool serial = source == kModbus && OneIn(2);
        Write(source, AXIS_OBJ_COMMAND_SOURCE, wanted,
              heard ? oracle_.Take(source, wanted, still, serial, state) : kNone, serial);
        break;
      }
      case 1:
        if (OneIn(4)) {
          Write(source, AXIS_OBJ_MODE, 0, heard ? oracle_.NativeModeOff(source, state) : kNone);
        }
        break;
      case 2:
      case 3: {
        static constexpr int kModes[] = {-2, -2, 3, 4, 1, 8, 6};
        Write(source, AXIS_OBJ_MODES_OF_OPERATION, kModes[Below(7)], oracle_.Other(source));
        break;
      }
      case 4:
        Write(source, AXIS_OBJ_OPEN_LOOP_CODE, static_cast<int>(Below(1000)),
              oracle_.Other(source));
        break;
      case 5:
        if (OneIn(30)) Nmt();
        break;
      case 6:
        if (OneIn(60)) BusOff();
        break;
      case 7:
        if (OneIn(30)) {
          (OneIn(2) ? inputs_.sensor_valid : inputs_.din) = 0;
          oracle_.may_move = false;
          Tick();
          inputs_.sensor_valid = 1;
          inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
        }
        break;
      case 8:
      case 9:
        if (nmt_ == kOperational) {
          const int word = Word();
          if (oracle_.owner == kCanopen) oracle_.wrote = true;
          (void)oracle_.Controlword(kCanopen, word, state, false);
          Frame(
              {0x200 + kNode, {static_cast<uint8_t>(word), static_cast<uint8_t>(word >> 8), 0xFE}});
          if (Now() != kEnabled) rules_.Leave();
        }
        break;
      default: {
        const int word = Word();
        const bool serial = source == kModbus && OneIn(2);
        Write(source, AXIS_OBJ_CONTROLWORD, word,
              heard ? oracle_.Controlword(source, word, state, serial) : kNone, serial);
        break;
      }
    }
  }

  void WriteOpen() {
    static constexpr uint16_t kOpen[] = {AXIS_OBJ_CYCLE_RESULT_ELEMENT,
                                         AXIS_OBJ_CYCLE_RESULT_NUMBER, AXIS_OBJ_CYCLE_CURVE_FIRST,
                                         AXIS_OBJ_CYCLE_ACKNOWLEDGE};
    const uint16_t object = kOpen[Below(4)];
    const int source = static_cast<int>(Below(3));
    // No part was pressed, so 0 alone is a number that can be acknowledged.
    const auto value = object == AXIS_OBJ_CYCLE_ACKNOWLEDGE ? 0 : static_cast<int32_t>(Below(16));
    const bool serial = object == AXIS_OBJ_CYCLE_RESULT_ELEMENT && source == kModbus && OneIn(2);
    Write(source, object, value, oracle_.Open(), serial);
  }

  void Command(int word) {
    const int source = oracle_.owner;
    const bool serial = source == kModbus && OneIn(2);
    Write(source, AXIS_OBJ_CONTROLWORD, word,
          Heard(source) ? oracle_.Controlword(source, word, Now(), serial) : kNone, serial);
  }

  // The owner enables the axis and presses with it, while the part is struck, moves away and comes
  // back, and others do as they like now and then.
  void Press() {
    if (nmt_ != kOperational) {
      Frame({0, {1, kNode}});
      nmt_ = kOperational;
    }
    Command(0x80);
    Command(0x00);
    Tick();
    const State stopped = Now();
    const bool off = Read(AXIS_OBJ_ACTIVE_MODE) == AXIS_MODE_DISABLED;
    if (off && (stopped == kOff || stopped == kReady)) DrawLaw();
    const int mode = drawn_.Mode();
    Write(oracle_.owner, AXIS_OBJ_MODES_OF_OPERATION, mode, oracle_.Other(oracle_.owner));
    Command(0x06);
    Command(0x07);
    Command(0x0F);
    for (uint32_t n = 200 + Below(OneIn(4) ? 3000 : 700); n > 0; --n) {
      Tick();
      if (n % 10 == 0 && !OneIn(100)) Ask(mode);
      if (OneIn(60)) {
        ++strikes_;
        scene_.Strike((OneIn(3) ? -1 : 1) * static_cast<double>(1 + Below(60)));
      }
      if (OneIn(500)) scene_.Move(OneIn(2) ? 100.0 : -100.0);
      if (OneIn(250)) Act();
      if (OneIn(2000)) Duplicate();
      const State state = Now();
      if (state != kEnabled && OneIn(20)) return;
    }
  }

  // What the owner wants of a force mode.
  void Ask(int mode) {
    const int force = drawn_.Force();
    if (mode >= 0) {
      Write(oracle_.owner, AXIS_OBJ_TARGET_FORCE, force, oracle_.Other(oracle_.owner));
    } else {
      // In process, as the port itself does: the serial line writes no 32 bits at once.
      Set(AXIS_OBJ_FORCE_SETPOINT, force / 40 * 256);
      Set(AXIS_OBJ_TARGET_POSITION, scene_.Encoder() + force / 10);
      Set(AXIS_OBJ_TARGET_VELOCITY, 5 * force);
      Write(oracle_.owner, AXIS_OBJ_TARGET_FORCE, force, oracle_.Other(oracle_.owner));
    }
  }

  // A frame that only a node of this id would send: a fault that acts in the coming tick, whoever
  // tries to reset it before.
  void Duplicate() {
    must_fault_ = Read(AXIS_OBJ_FAULT) == 0;  // the first one stays
    Frame({0x700 + kNode, {5}});
    oracle_.may_move = false;
    if (OneIn(2)) {
      Write(oracle_.owner, AXIS_OBJ_FAULT_RESET, 1, oracle_.Other(oracle_.owner), false);
    } else if (OneIn(2)) {
      for (int word : {0x80, 0x06, 0x07, 0x0F}) Command(word);
      oracle_.may_move &= !must_fault_;
    }
    Tick();
  }

  void Nmt() {
    static constexpr uint8_t kCommands[] = {1, 2, 128, 129, 130};
    const uint8_t command = kCommands[Below(5)];
    const State state = Now();
    Frame({0, {command, kNode}});
    switch (command) {
      case 1:
        nmt_ = kOperational;
        break;
      case 2:
        oracle_.BusStops(state);
        nmt_ = kStopped;
        break;
      case 128:
        nmt_ = kPreOperational;
        break;
      default:
        oracle_.BusStops(state);
        nmt_ = kPreOperational;
        // A reset of the node waits for the brake.
        const int engages = command == 129 ? Read(AXIS_OBJ_BRAKE_ENGAGE_TICKS) : 0;
        for (int i = 0; i < 3 + engages; ++i) Step();
        if (command == 129) {
          if (Read(AXIS_OBJ_COMMAND_SOURCE) != kCanopen || outputs_.amp_enable != 0) {
            Fail("the owner after a reset", Read(AXIS_OBJ_COMMAND_SOURCE), kCanopen);
          }
          SetUp();
        } else {
          for (int i = 0; i < 3; ++i) oracle_.Time();
          Compare();
        }
        break;
    }
  }

  void BusOff() {
    oracle_.BusStops(Now());
    fw_can_bus(&fw_, CAN_BUS_OFF);
    for (uint32_t n = Below(5); n > 0; --n) Tick();
    fw_can_bus(&fw_, CAN_BUS_ACTIVE);
    // 1029h: a communication error ends the operational state.
    if (nmt_ == kOperational) nmt_ = kPreOperational;
  }

  void Step() {
    inputs_.encoder_cnt = scene_.Encoder();
    inputs_.adc_code[0] = scene_.Reading();
    const int ends = (inputs_.encoder_cnt >= switch_pos_ ? AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE : 0) |
                     (inputs_.encoder_cnt <= switch_neg_ ? AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE : 0);
    inputs_.din = static_cast<uint8_t>((inputs_.din & AXIS_DIGITAL_INPUTS_ENABLE) | ends);
    rules_.Before(fw_);
    fw_tick(&fw_, &inputs_, &outputs_);
    ++ticks_;
    for (uint64_t value : {static_cast<uint64_t>(static_cast<uint16_t>(outputs_.dac_code)),
                           uint64_t{outputs_.amp_enable}, uint64_t{fw_.device.command_source},
                           uint64_t{fw_.drive.signals.statusword}}) {
      hash_ = (hash_ ^ value) * 0x100000001B3u;
    }
    const std::string wrong = rules_.After(fw_, inputs_, outputs_);
    if (!wrong.empty()) Fail(wrong);
    if (must_fault_ && (outputs_.amp_enable != 0 || outputs_.dac_code != 0)) {
      Fail("the amplifier in the tick of a fault", 1, 0);
    }
    if (must_fault_ && Read(AXIS_OBJ_FAULT) == 0) Fail("the fault", 0, 1);
    must_fault_ = false;
    scene_.Step(outputs_.dac_code, outputs_.amp_enable != 0);
    if (OneIn(4)) Drain(nullptr);
  }

  void Compare() {
    if (Read(AXIS_OBJ_COMMAND_SOURCE) != oracle_.owner) {
      Fail("the owner", Read(AXIS_OBJ_COMMAND_SOURCE), oracle_.owner);
    }
    if ((Read(AXIS_OBJ_STOPPED_BY) != 0) != oracle_.held) {
      Fail("held", Read(AXIS_OBJ_STOPPED_BY), oracle_.held);
    }
    if (Read(AXIS_OBJ_CONTROLWORD) != oracle_.word) {
      Fail("the controlword", Read(AXIS_OBJ_CONTROLWORD), oracle_.word);
    }
    // Behind a closed brake the amplifier may be on (code_oracle.hpp).
    if (!oracle_.may_move && outputs_.brake_release != 0) Fail("the brake", 1, 0);
  }

  void Tick() {
    oracle_.Time();
    Step();
    Compare();
  }

  enum { kPreOperational, kOperational, kStopped } nmt_ = kPreOperational;
  std::mt19937_64 random_;
  fw_t fw_{};
  axis_inputs_t inputs_{};
  axis_outputs_t outputs_{};
  Oracle oracle_;
  PressOracle rules_;
  struct Draw {
    Flood *flood;
    uint32_t operator()(uint32_t n) const { return flood->Below(n); }
  };
  DrawnPress<Draw> drawn_{Draw{this}};
  ContactScene scene_;
  bool must_fault_ = false;
  int32_t switch_pos_ = INT32_MAX, switch_neg_ = INT32_MIN;
  uint64_t ticks_ = 0, strikes_ = 0, writes_ = 0, refused_ = 0;
  uint64_t hash_ = 0xCBF29CE484222325u;
};

}  // namespace

int main(int count, char **arguments) {
  if (count != 3) {
    std::fprintf(stderr, "usage: ownership_flood TICKS SEED\n");
    return 2;
  }
  Flood(std::strtoull(arguments[2], nullptr, 10)).Run(std::strtoull(arguments[1], nullptr, 10));
  return 0;
}
