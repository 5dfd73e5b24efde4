// Floods the CANopen node with random frames and logs what happens, for canopen_model.py.
//
// usage: canopen_flood FRAMES SEED
//
// Frames are made as clients make them (configuration, mapping sequences, segmented transfers, NMT,
// SYNC, heartbeats, PDOs) and then, now and then, broken: bits flipped, bytes cut, remote, any
// identifier. Time passes between them, output is taken late or not at all for a while. For most of
// that time a plausible master presses: it sets the axis up, enables it, is supervised by a
// heartbeat, and presses on a part that is struck away and comes back (contact_scene.hpp), in every
// force mode, until it falls silent or the others' frames stop it.
//
// What the axis may do in a tick is judged here by press_oracle.hpp, as in ownership_flood: the
// first difference ends the run with status 1. Owners and stops are the model's. The counts go to
// the standard error output.
//
// The log is one record of 16 bytes each, little-endian: kind u8, a u8, b u16, c u32, d u64.
//   1 frame in     a length (bit 7: remote), b identifier, d data
//   2 tick done    a contact 1, force saturated 2, limit cycle 4, force is controlled 8,
//                  calibration expired 16, the force law is restricted 32, gain halvings from bit 6
//                  on; b bit 0, the amplifier is on; bit 1, by the options the loss of the owner
//                  switches it off at once; bit 2, so does a controlword; c error code, fault (also
//                  one that is to be latched) in bits 16 to 23, active mode in 24 to 31
//   3 frame out    as 1
//   4 no more frames out (not repeated while nothing has changed)
//   5 state        a NMT, b SYNC count, c error register, history count, owner; d lost frames.
//                  Logged when it has changed; otherwise it has not
//   6 TPDO a's mapped objects now hold d (logged when it changes)
//   7 a: bits 0 to 3, RPDOs of which an object refused its value when last taken over; bit 4, the
//     owner has written since the last tick; before 1
//   8 the finished recording has c bytes
//   9 the recording was stopped or armed
//  10 c frames were lost on the way in
//  11 the bus is in state a
//  12 object b has the value c
//  13 of the drive, for the next frame or state of the bus: a bit 0, it was powered or active
//     before; bit 1, it is enabled for a master that is not supervised; bit 2, a stored parameter
//     outside the communication part was changed; b stopped_by, if new (logged when it changes)

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "firmware/port/host/firmware.hpp"
#include "tests/wire/contact_scene.hpp"
#include "tests/wire/drawn_press.hpp"
#include "tests/wire/drive_record.hpp"
#include "tests/wire/press_oracle.hpp"

namespace {

constexpr uint8_t kNode = 5;
// Requests to the SDO servers; those of a gateway once EnableServers() has come through.
constexpr uint16_t kServers[] = {0x605, 0x680, 0x682};

enum Kind : uint8_t {
  kFrameIn = 1,
  kTick,
  kFrameOut,
  kNoMore,
  kState,
  kValue,
  kRefused,
  kRecording,
  kReplaced,
  kLost,
  kBus,
  kObject,
  kDrive
};

struct Record {
  uint8_t kind, a;
  uint16_t b;
  uint32_t c;
  uint64_t d;
};
static_assert(sizeof(Record) == 16);

class Flood {
 public:
  explicit Flood(uint64_t seed) : random_(seed) {
    fw_config_t config{};
    config.recorder_buffer = buffer_;
    config.recorder_bytes = sizeof(buffer_);
    config.node_id = kNode;
    config.buses = 1;
    fw_init(&fw_, &config);
    inputs_.sensor_valid = 1;
    inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
    LogValues();
    LogState();
    EnableServers();
  }

  void Run(uint64_t frames) {
    while (sent_ < frames) {
      Step();
      if (sent_ - dumped_ >= 256) Dump();
    }
    LeaveTransfers();
    Dump();
    Flush();
    std::fprintf(stderr, "%s; %ld strikes\n", rules_.counts().text().c_str(), strikes_);
  }

 private:
  uint32_t Below(uint32_t n) { return static_cast<uint32_t>(random_() % n); }
  bool OneIn(uint32_t n) { return Below(n) == 0; }

  template <typename T, size_t N>
  T Pick(const T (&of)[N]) {
    return of[Below(N)];
  }

  void Log(uint8_t kind, uint8_t a = 0, uint16_t b = 0, uint32_t c = 0, uint64_t d = 0) {
    log_.push_back({kind, a, b, c, d});
    if (log_.size() >= 65536) Flush();
  }

  void Flush() {
    if (std::fwrite(log_.data(), sizeof(Record), log_.size(), stdout) != log_.size()) std::exit(1);
    log_.clear();
  }

  int32_t Read(uint16_t object) const {
    int32_t value = 0;
    fw_object_read(&fw_, object, &value);
    return value;
  }

  void LogState() {
    const Record now{kState, static_cast<uint8_t>(Read(AXIS_OBJ_NMT_STATE)),
                     static_cast<uint16_t>(Read(AXIS_OBJ_SYNC_COUNT)),
                     static_cast<uint32_t>(Read(AXIS_OBJ_ERROR_REGISTER) |
                                           Read(AXIS_OBJ_ERROR_HISTORY_COUNT) << 8 |
                                           Read(AXIS_OBJ_COMMAND_SOURCE) << 16),
                     static_cast<uint64_t>(Read(AXIS_OBJ_CAN_LOST))};
    if (std::memcmp(&now, &state_, sizeof(now)) == 0) return;
    state_ = now;
    told_empty_ = false;
    log_.push_back(now);
  }

  // The stored parameters outside the communication part, while there is a verified configuration
  // that a change of them ends.
  std::vector<int32_t> Stored() const {
    std::vector<int32_t> values;
    for (uint16_t object = 1; object < AXIS_OBJ_COUNT && verified_; ++object) {
      const axis_object_t &entry = axis_objects[object];
      if (entry.stored != 0 && entry.block != AXIS_BLOCK_CANOPEN_PARAMETER) {
        values.push_back(Read(object));
      }
    }
    return values;
  }

  void NoteStored() {
    verified_ = Read(AXIS_OBJ_CONFIGURATION_DATE) != 0 || Read(AXIS_OBJ_CONFIGURATION_TIME) != 0;
    stored_ = Stored();
  }

  // Of the drive, for the frame that follows.
  void LogDrive(const DriveBefore &before) {
    const uint8_t changed = stored_ != Stored() ? 4 : 0;
    const Record now{kDrive, static_cast<uint8_t>(before.bits(fw_) | changed), before.stopper(fw_),
                     0, 0};
    if (now.a == drive_.a && now.a < 2 && now.b == 0 && drive_.b == 0) return;
    drive_ = now;
    log_.push_back(now);
  }

  // What the TPDOs' objects hold, packed here from the mapping as a client reads it.
  void LogValues() {
    for (uint8_t i = 0; i < 4; ++i) {
      const uint8_t mapped = fw_.canopen.params.tpdo_mapped[i];
      uint64_t value = 0;
      unsigned bit = 0;
      for (uint8_t k = 0; k < mapped; ++k) {
        const uint32_t entry = fw_.canopen.params.tpdo_mapping[8 * i + k];
        const axis_address_t *at = dictionary_address(static_cast<uint16_t>(entry >> 16),
                                                      static_cast<uint8_t>(entry >> 8));
        const unsigned width = entry & 0xFF;
        const uint64_t mask = (uint64_t{1} << width) - 1;
        value |= (static_cast<uint64_t>(static_cast<uint32_t>(Read(at->value))) & mask) << bit;
        bit += width;
      }
      if (value != values_[i]) {
        values_[i] = value;
        Log(kValue, i, 0, 0, value);
      }
    }
    const int found = dictionary_domain_size(&fw_.objects, DICTIONARY_RECORDING);
    const uint32_t size = found < 0 ? 0 : static_cast<uint32_t>(found);
    if (size != recording_) {
      recording_ = size;
      Log(kRecording, 0, 0, size);
    }
  }

  void Drain() {
    can_frame_t frame{};
    while (fw_can_transmit(&fw_, &frame)) {
      uint64_t data = 0;
      for (int i = 0; i < frame.length; ++i)
        data |= static_cast<uint64_t>(frame.data[i]) << (8 * i);
      told_empty_ = false;
      Log(kFrameOut, frame.length, frame.id, 0, data);
    }
    if (!told_empty_) Log(kNoMore);
    told_empty_ = true;
  }

  // Bits 1 and 2 of a tick.
  uint16_t SwitchedOff() const {
    const int lost = Read(AXIS_OBJ_ABORT_CONNECTION_OPTION);
    const bool by_loss = lost == 2 || (lost == 1 && Read(AXIS_OBJ_FAULT_REACTION_OPTION) == 0);
    // Not while it slows down, as an option asked for it by then.
    const int state = Read(AXIS_OBJ_DRIVE_STATE);
    const bool slows = state == AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE ||
                       state == AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE || fw_.drive.leaving != 0;
    const bool by_word = !slows && Read(AXIS_OBJ_QUICK_STOP_OPTION) == 0 &&
                         Read(AXIS_OBJ_SHUTDOWN_OPTION) == 0 &&
                         Read(AXIS_OBJ_DISABLE_OPERATION_OPTION) == 0;
    return static_cast<uint16_t>(by_loss << 1 | by_word << 2);
  }

  void Tick() {
    inputs_.encoder_cnt = scene_.Encoder();
    inputs_.adc_code[0] = scene_.Reading();
    const uint16_t switched_off = SwitchedOff();
    rules_.Before(fw_);
    fw_tick(&fw_, &inputs_, &outputs_);
    const std::string wrong = rules_.After(fw_, inputs_, outputs_);
    if (!wrong.empty()) {
      std::fprintf(stderr, "tick %ld: %s\n", rules_.counts().ticks, wrong.c_str());
      std::exit(1);
    }
    scene_.Step(outputs_.dac_code, outputs_.amp_enable != 0);
    LogValues();
    const uint8_t fault = fw_.axis.signals.fault;
    Log(kTick,
        static_cast<uint8_t>(Read(AXIS_OBJ_CONTACT) | Read(AXIS_OBJ_FORCE_SATURATED) << 1 |
                             Read(AXIS_OBJ_LIMIT_CYCLE) << 2 | fw_.drive.controlled << 3 |
                             Read(AXIS_OBJ_CALIBRATION_EXPIRED) << 4 | fw_.drive.restricted << 5 |
                             Read(AXIS_OBJ_GAIN_HALVINGS) << 6),
        static_cast<uint16_t>(switched_off | (outputs_.amp_enable & outputs_.brake_release)),
        static_cast<uint32_t>(Read(AXIS_OBJ_ERROR_CODE) |
                              (fault != AXIS_FAULT_NONE ? fault : fw_.drive.fault) << 16) |
            static_cast<uint32_t>(Read(AXIS_OBJ_ACTIVE_MODE)) << 24);
    LogState();
  }

  // What the model cannot know is not touched from the bus: a count that moves after the TPDOs of
  // its tick, as does what a tare finds, the recorder, which this program runs itself, the start of
  // an excitation, which takes contact, and a calibration.
  static bool IsHidden(const can_frame_t &frame) {
    const uint32_t word = frame.data[4] | frame.data[5] << 8 | frame.data[6] << 16 |
                          static_cast<uint32_t>(frame.data[7]) << 24;
    const bool request = frame.id >= 0x600 && frame.length == 8;
    const uint16_t index = static_cast<uint16_t>(frame.data[1] | frame.data[2] << 8);
    const uint32_t mapped = word >> 16;
    const auto is_command = [](int at) {
      return at == 0x2107 || at == 0x2030 || at == 0x2231 || at == 0x2237;
    };
    return request && (is_command(index) || is_command(mapped) || mapped == 0x2309);
  }

  void Break(can_frame_t &frame) {
    if (OneIn(40)) frame.data[Below(8)] ^= static_cast<uint8_t>(1u << Below(8));
    if (OneIn(150)) frame.length = static_cast<uint8_t>(Below(9));
    if (OneIn(300)) frame.remote = 1;
    if (OneIn(400)) frame.id = static_cast<uint16_t>(Below(0x800));
  }

  void Send(can_frame_t frame) {
    if (!whole_) Break(frame);
    for (int i = frame.length; i < 8; ++i) frame.data[i] = 0;
    if (IsHidden(frame)) return;
    NoteStored();
    const DriveBefore before(fw_, is_no_request(frame.id));
    fw_can_receive(&fw_, &frame);
    LogDrive(before);
    if (Read(AXIS_OBJ_DRIVE_STATE) != AXIS_DRIVE_STATE_OPERATION_ENABLED) rules_.Leave();
    uint8_t refused = 0;
    for (unsigned i = 0; i < 4; ++i) {
      if ((fw_.canopen.rpdo[i].reported & PDO_REPORTED_REFUSED) != 0) refused |= uint8_t(1u << i);
    }
    // The model needs this only for what the drive judges; within a tick it cannot be distinguished
    // from an earlier write.
    const bool wrote = (fw_.objects.writers >> fw_.device.command_source & 1) != 0;
    if (fw_.source_silence == 0 || wrote) refused |= 0x10;
    if (refused != refused_) {
      refused_ = refused;
      Log(kRefused, refused);
    }
    uint64_t data = 0;
    for (int i = 0; i < 8; ++i) data |= static_cast<uint64_t>(frame.data[i]) << (8 * i);
    Log(kFrameIn, static_cast<uint8_t>(frame.length | frame.remote << 7), frame.id, 0, data);
    LogValues();
    LogState();
    ++sent_;
    if (!lazy_) Drain();
  }

  void Send(uint16_t id, std::vector<uint8_t> data) {
    can_frame_t frame{};
    frame.id = id;
    frame.length = static_cast<uint8_t>(data.size());
    for (size_t i = 0; i < data.size(); ++i) frame.data[i] = data[i];
    Send(frame);
  }

  void Request(uint8_t command, uint16_t index, uint8_t sub, uint32_t value) {
    can_frame_t frame{};
    frame.id = server_ != 0 ? server_ : kServers[OneIn(4) ? 1 + Below(2) : 0];
    frame.length = 8;
    frame.data[0] = command;
    frame.data[1] = static_cast<uint8_t>(index);
    frame.data[2] = static_cast<uint8_t>(index >> 8);
    frame.data[3] = sub;
    for (int i = 0; i < 4; ++i) frame.data[4 + i] = static_cast<uint8_t>(value >> (8 * i));
    Send(frame);
  }

  void Write(uint16_t index, uint8_t sub, uint32_t value, int bytes) {
    Request(static_cast<uint8_t>(0x23 | (4 - bytes) << 2), index, sub, value);
  }

  uint32_t CobId(bool transmit = false) {
    static constexpr uint32_t flags[] = {0, 0, 0, 0x40000000, 0x80000000, 0xC0000000};
    static constexpr uint32_t ids[] = {0x205, 0x305, 0x405, 0x505, 0x222};
    static constexpr uint32_t transmitted[] = {0x185, 0x285, 0x385, 0x485};
    const uint32_t id = OneIn(20) ? Below(0x800) : transmit ? Pick(transmitted) : Pick(ids);
    const uint32_t no_remote = transmit && !OneIn(10) ? 0x40000000 : 0;
    return Pick(flags) | no_remote | id | (OneIn(60) ? 1u << Below(32) : 0);
  }

  // The other SDO servers, as a gateway sets them up; any step may be missing or another one.
  void EnableServers() {
    server_ = kServers[0];
    for (uint16_t index : {0x1201, 0x1202}) {
      for (uint8_t sub : {1, 2}) {
        if (OneIn(20)) continue;
        const uint32_t id = 0x680 + 2u * (index - 0x1201) + sub - 1;
        Write(index, sub, OneIn(30) ? CobId() : OneIn(30) ? id | 0x80000000 : id, 4);
      }
    }
    server_ = 0;
  }

  uint32_t Entry(bool transmit) {
    if (!transmit && OneIn(5)) {
      static constexpr uint32_t dummies[] = {0x00010001, 0x00020008, 0x00030010, 0x00040020,
                                             0x00050008, 0x00060010, 0x00070020};
      return Pick(dummies);
    }
    const axis_address_t &at = axis_addresses[Below(AXIS_ADDRESSES_COUNT)];
    uint32_t width = 8;
    if (at.what == AXIS_ADDRESS_OBJECT) width = 8u * value_bytes(axis_objects[at.value].type);
    static constexpr uint32_t common[] = {0x60410010, 0x60640020, 0x60400010, 0x607A0020,
                                          0x60710010, 0x60770010, 0x60610008, 0x20230020,
                                          0x201F0020, 0x23010008};
    if (OneIn(2)) return Pick(common);
    return static_cast<uint32_t>(at.index) << 16 | static_cast<uint32_t>(at.sub) << 8 | width;
  }

  // The sequence of a client that maps a PDO anew; any step may be missing.
  void Remap() {
    const bool transmit = OneIn(2);
    const uint16_t pdo = static_cast<uint16_t>((transmit ? 0x1800 : 0x1400) + Below(4));
    const uint32_t cob_id = CobId(transmit) & 0x7FFFFFFF;
    const uint8_t count = static_cast<uint8_t>(1 + Below(OneIn(4) ? 9 : 4));
    const auto step = [&] { return !OneIn(25); };
    server_ = kServers[0];
    if (step()) Write(pdo, 1, 0x80000000 | cob_id, 4);
    if (OneIn(2)) Write(pdo, 2, OneIn(3) ? Below(256) : OneIn(2) ? 255 : Below(4), 1);
    if (OneIn(3)) Write(pdo, 3, Below(200), 2);
    if (OneIn(3)) Write(pdo, 5, Below(40), 2);
    if (transmit && OneIn(3)) Write(pdo, 6, Below(9), 1);
    if (step()) Write(static_cast<uint16_t>(pdo + 0x200), 0, 0, 1);
    for (uint8_t i = 1; i <= count && i <= 8; ++i) {
      if (step()) Write(static_cast<uint16_t>(pdo + 0x200), i, Entry(transmit), 4);
    }
    if (step()) Write(static_cast<uint16_t>(pdo + 0x200), 0, count, 1);
    if (step()) Write(pdo, 1, cob_id, 4);
    server_ = 0;
  }

  void Configure() {
    switch (Below(13)) {
      case 11:
        return OneIn(3) ? Write(0x1019, 0,
                                OneIn(3)   ? Below(256)
                                : OneIn(2) ? 0
                                           : 8,
                                1)
                        : Write(0x1020, static_cast<uint8_t>(1 + Below(2)), Below(1000), 4);
      case 0:
        return Write(0x1017, 0, Below(60), 2);
      case 1:
        return Write(0x1016, static_cast<uint8_t>(Below(6)), (10 + Below(4)) << 16 | Below(80), 4);
      case 2:
        return Write(0x1029, 1, Below(4), 1);
      case 3:
        return Write(0x1014, 0, OneIn(3) ? CobId() : OneIn(2) ? 0x85 : 0x80000085, 4);
      case 4:
        return Write(0x1015, 0, Below(300), 2);
      case 5:
        return Write(0x1005, 0, OneIn(8) ? CobId() : 0x80, 4);
      case 6:
        return Write(0x1003, static_cast<uint8_t>(Below(2)), Below(2), 1);
      case 7:
        return Write(static_cast<uint16_t>((OneIn(2) ? 0x1400 : 0x1800) + Below(4)), 2, Below(256),
                     1);
      case 8:
        return Write(static_cast<uint16_t>((OneIn(2) ? 0x1400 : 0x1800) + Below(4)), 5, Below(50),
                     2);
      case 9:
        if (OneIn(2)) return Write(static_cast<uint16_t>(0x1400 + Below(4)), 1, CobId(), 4);
        return Write(static_cast<uint16_t>(0x1800 + Below(4)), 1, CobId(true), 4);
      case 10:
        return Write(OneIn(2) ? 0x1010 : 0x1011, 1, OneIn(2) ? 0x65766173 : 0x64616F6C, 4);
      default: {
        const uint32_t source = Below(3);
        server_ = kServers[OneIn(8) ? Below(3) : source];
        if (OneIn(4) || source == 0) Write(0x2301, 0, source, 1);
        server_ = 0;
      }
    }
  }

  // Any address, often with its own length.
  void WriteAny() {
    const axis_address_t &at = axis_addresses[Below(AXIS_ADDRESSES_COUNT)];
    int bytes = 1 + static_cast<int>(Below(4));
    uint32_t value = static_cast<uint32_t>(random_());
    if (at.what == AXIS_ADDRESS_OBJECT && !OneIn(6)) {
      const axis_object_t &object = axis_objects[at.value];
      bytes = value_bytes(object.type);
      if (OneIn(2)) value = static_cast<uint32_t>(object.min) + Below(5) - 1;
      if (OneIn(4)) value = static_cast<uint32_t>(object.max) + Below(3) - 1;
    }
    // Time-outs of the lock would be over in a moment or take minutes.
    if (at.index == 0x2302) value = 10 + Below(200);
    Write(at.index, static_cast<uint8_t>(at.sub + (OneIn(30) ? Below(9) : 0)), value, bytes);
  }

  void ReadAny() {
    static constexpr uint16_t segmented[] = {0x1008, 0x1009, 0x100A, 0x2120};
    const axis_address_t &at = axis_addresses[Below(AXIS_ADDRESSES_COUNT)];
    if (OneIn(4)) {
      Request(0x40, Pick(segmented), 0, 0);
    } else {
      Request(0x40, at.index, static_cast<uint8_t>(at.sub + (OneIn(20) ? 1 : 0)), 0);
    }
  }

  void UploadSegments() {
    static constexpr uint16_t segmented[] = {0x1008, 0x1009, 0x100A, 0x100A, 0x2120, 0x2120};
    server_ = Pick(kServers);
    Request(0x40, Pick(segmented), 0, 0);
    uint8_t toggle = 0;
    for (uint32_t i = Below(12); i > 0; --i) {
      Request(static_cast<uint8_t>(0x60 | toggle), 0, 0, 0);
      if (!OneIn(40)) toggle ^= 0x10;
      if (OneIn(30)) Ticks();
    }
    if (OneIn(10)) Request(0x80, 0x1008, 0, 0x08000000);
    server_ = 0;
  }

  void DownloadSegments() {
    const axis_address_t &at = axis_addresses[Below(AXIS_ADDRESSES_COUNT)];
    uint32_t size = 1 + Below(5);
    if (at.what == AXIS_ADDRESS_OBJECT && !OneIn(5))
      size = value_bytes(axis_objects[at.value].type);
    server_ = OneIn(4) ? kServers[0] : Pick(kServers);
    Request(OneIn(2) ? 0x21 : 0x20, at.index, at.sub, size);
    uint8_t toggle = 0;
    uint32_t left = size;
    while (left > 0 && !OneIn(15)) {
      const uint32_t count = OneIn(3) ? 1 + Below(left) : left;
      left -= count;
      const uint32_t last = (left == 0) != OneIn(30) ? 1 : 0;
      Request(static_cast<uint8_t>(toggle | (7 - count) << 1 | last),
              static_cast<uint16_t>(random_() & 3), 0, 0);
      if (!OneIn(30)) toggle ^= 0x10;
    }
    server_ = 0;
  }

  // Uploads by blocks, some with requests that are wrong or missing.
  void UploadBlocks() {
    static constexpr uint16_t texts[] = {0x1008, 0x1009, 0x100A, 0x2120, 0x2120, 0x1018};
    server_ = Pick(kServers);
    const uint16_t index = Pick(texts);
    uint32_t block = OneIn(20) ? Below(256) : 1 + Below(OneIn(3) ? 3 : 127);
    const uint32_t threshold = OneIn(6) ? Below(20) : 0;
    Request(OneIn(3) ? 0xA0 : 0xA4, index, index == 0x1018 ? 4 : 0, block | threshold << 8);
    if (!OneIn(20)) Request(0xA3, 0, 0, 0);
    for (uint32_t blocks = Below(6); blocks > 0; --blocks) {
      Ticks(1 + Below(6));
      // Mostly as many as were sent, as the server knows.
      const uint8_t sent =
          fw_.canopen.sdo[server_ == kServers[0]   ? 0
                          : server_ == kServers[1] ? 1
                                                   : 2]
              .sequence;
      uint32_t good = OneIn(4) ? Below(sent + 1u) : sent;
      if (OneIn(40)) good = Below(256);
      if (OneIn(3)) block = OneIn(20) ? Below(256) : 1 + Below(127);
      Request(0xA2, static_cast<uint16_t>(good | block << 8), 0, 0);
    }
    if (OneIn(100)) Ticks(8000);  // longer than a request may take
    if (OneIn(2)) Request(0xA1, 0, 0, 0);
    if (OneIn(10)) Request(0x80, index, 0, 0x08000000);
    server_ = 0;
  }

  static uint16_t Crc(uint32_t value, uint32_t bytes) {
    uint32_t crc = 0;
    for (uint32_t bit = 0; bit < 8 * bytes; ++bit) {
      const uint32_t one = (crc >> 15 ^ value >> (bit / 8 * 8 + 7 - bit % 8)) & 1;
      crc = (crc << 1 ^ (one != 0 ? 0x1021u : 0)) & 0xFFFF;
    }
    return static_cast<uint16_t>(crc);
  }

  void DownloadBlocks() {
    const axis_address_t &at = axis_addresses[Below(AXIS_ADDRESSES_COUNT)];
    uint32_t bytes = 1 + Below(4);
    if (at.what == AXIS_ADDRESS_OBJECT && !OneIn(8))
      bytes = value_bytes(axis_objects[at.value].type);
    const uint32_t value = at.index == 0x2302 ? 10 + Below(200) : Below(300);
    server_ = OneIn(2) ? kServers[0] : Pick(kServers);
    const bool sized = OneIn(2), with_crc = OneIn(2);
    Request(static_cast<uint8_t>(0xC0 | sized << 1 | with_crc << 2), at.index, at.sub,
            OneIn(10) ? Below(9) : bytes);
    const uint8_t head = static_cast<uint8_t>(OneIn(15) ? Below(256) : 0x81);
    for (uint32_t i = OneIn(10) ? Below(3) : 1; i > 0; --i) {
      Request(head, static_cast<uint16_t>(value), static_cast<uint8_t>(value >> 16), value >> 24);
    }
    if (OneIn(15)) Ticks();
    const uint16_t crc = static_cast<uint16_t>(Crc(value, bytes) ^ (OneIn(10) ? 1 : 0));
    Request(static_cast<uint8_t>(0xC1 | (7 - bytes) << 2), crc, 0, 0);
    server_ = 0;
  }

  void WriteObject(uint16_t object, int32_t value) {
    for (const axis_address_t &at : axis_addresses) {
      if (at.what != AXIS_ADDRESS_OBJECT || at.value != object) continue;
      Write(at.index, at.sub, static_cast<uint32_t>(value), value_bytes(axis_objects[object].type));
      return;
    }
  }

  // The way to an axis that is active in any mode, so that time-outs and resets find one.
  void Enable() {
    server_ = kServers[0];
    static constexpr int modes[] = {1, 3, 4, 8, 10};
    WriteObject(AXIS_OBJ_MODES_OF_OPERATION, Pick(modes));
    SwitchOn();
    server_ = 0;
  }

  void SwitchOn() {
    for (int word : {0x80, 0x00, 0x06, 0x07, 0x0F}) {
      WriteObject(AXIS_OBJ_CONTROLWORD, word);
      Tick();
    }
  }

  // Of a disabled axis: the part, the law, and what bounds it.
  void SetUp() {
    Send(0, {1, kNode});
    if (OneIn(4)) Send(0, {128, kNode});
    for (const int at : {Read(AXIS_OBJ_COMMAND_SOURCE), 0}) {
      server_ = kServers[at];
      WriteObject(AXIS_OBJ_COMMAND_SOURCE, 0);
    }
    WriteObject(AXIS_OBJ_CONTROLWORD, 0x80);
    WriteObject(AXIS_OBJ_CONTROLWORD, 0x00);
    Tick();
    scene_.Take(drawn_.Shape());
    for (uint16_t object :
         {AXIS_OBJ_QUICK_STOP_OPTION, AXIS_OBJ_SHUTDOWN_OPTION, AXIS_OBJ_DISABLE_OPERATION_OPTION,
          AXIS_OBJ_FAULT_REACTION_OPTION, AXIS_OBJ_FIRST_MOTION_TEST}) {
      WriteObject(object, 0);
    }
    static constexpr int losses[] = {1, 1, 2};
    const int loss = Pick(losses);
    const auto law = drawn_.Law(scene_.Encoder());
    WriteObject(AXIS_OBJ_ABORT_CONNECTION_OPTION, loss);
    WriteObject(AXIS_OBJ_POSITION_GAIN, 5 * 256);
    WriteObject(AXIS_OBJ_FEED, 0);
    WriteObject(AXIS_OBJ_ADC_BITS, 8);
    WriteObject(AXIS_OBJ_FORCE_ZERO_CODE, 0);
    WriteObject(AXIS_OBJ_FORCE_SIGN, 1);
    for (const auto &one : law) WriteObject(one.object, one.value);
    // What others left to watch an RPDO or a node that this master does not send.
    if (!OneIn(5)) {
      for (uint16_t i = 0; i < 4; ++i) Write(static_cast<uint16_t>(0x1400 + i), 5, 0, 2);
      for (uint8_t i = 2; i <= 4; ++i) Write(0x1016, i, 0, 4);
    }
    // Half of the masters are supervised; this one may forget to say that it is there.
    beats_ = OneIn(2) ? 0 : 20 + Below(60);
    Write(0x1016, 1, beats_ == 0 ? 0 : 10u << 16 | beats_, 4);
    WriteObject(AXIS_OBJ_MODES_OF_OPERATION, drawn_.Mode());
  }

  // What the master wants of the force modes.
  void Ask() {
    const int force = drawn_.Force();
    if (Read(AXIS_OBJ_MODES_OF_OPERATION) < 0) {
      WriteObject(AXIS_OBJ_FORCE_SETPOINT, force / 40 * 256);
      WriteObject(AXIS_OBJ_TARGET_POSITION, scene_.Encoder() + force / 10);
      WriteObject(AXIS_OBJ_TARGET_VELOCITY, 5 * force);
    } else {
      WriteObject(AXIS_OBJ_TARGET_FORCE, force);
    }
  }

  bool IsEnabled() const {
    return Read(AXIS_OBJ_DRIVE_STATE) == AXIS_DRIVE_STATE_OPERATION_ENABLED;
  }

  // A master that sets the axis up, enables it and presses for some ticks. Now and then others send
  // what they like, unless it is quiet, so that what nobody goes on with is over.
  void Press(uint32_t ticks) {
    const bool quiet = OneIn(2);
    pressing_ = true;
    whole_ = !OneIn(4);
    SetUp();
    if (quiet && ticks > 7500) {
      // A gateway begins what it never ends.
      EnableServers();
      server_ = kServers[1 + Below(2)];
      Request(0x40, 0x100A, 0, 0);
    }
    bool silent = false;
    uint32_t stopped = 100;  // for so long it has not been enabled
    for (; ticks > 0; --ticks) {
      if (stopped >= 8 && OneIn(5)) {
        server_ = kServers[0];
        if (stopped % 8 == 0) Send(0, {1, kNode});
        if (stopped > 100) {
          Send(0, {129, kNode});
          Tick();
          Tick();
          SetUp();
        }
        SwitchOn();
        Ask();
        silent = false;
      }
      if (beats_ != 0 && !silent && ticks % 16 == 0) Send(0x70A, {5});
      if (ticks % 64 == 0 && !OneIn(20)) {
        server_ = kServers[0];
        Ask();
      }
      if (OneIn(60)) {
        ++strikes_;
        scene_.Strike((OneIn(3) ? -1 : 1) * static_cast<double>(1 + Below(60)));
      }
      if (OneIn(500)) scene_.Move(OneIn(2) ? 100.0 : -100.0);
      if (OneIn(2000)) silent = true;
      if (OneIn(4000)) Send(0x700 + kNode, {5});  // another node of its id
      if (OneIn(1500)) (OneIn(2) ? inputs_.sensor_valid : inputs_.din) = 0;
      server_ = 0;
      if (!quiet && OneIn(40)) {
        const bool whole = std::exchange(whole_, false);
        Step();
        whole_ = whole;
      }
      Tick();
      inputs_.sensor_valid = 1;
      inputs_.din = AXIS_DIGITAL_INPUTS_ENABLE;
      if (!lazy_) Drain();
      stopped = IsEnabled() ? 0 : stopped + 1;
    }
    whole_ = false;
    pressing_ = false;
  }

  // A client of each server begins a transfer and sends nothing more until the transfer times out.
  void LeaveTransfers() {
    whole_ = true;
    JoinBus();
    Send(0, {128, kNode});
    EnableServers();
    for (const uint16_t server : kServers) {
      server_ = server;
      Request(0x40, 0x100A, 0, 0);
    }
    for (uint32_t i = 0; i < 8000; ++i) {
      Tick();
      Drain();
    }
  }

  void Nmt() {
    static constexpr uint8_t commands[] = {1, 1, 1, 1, 1, 1, 2, 128, 128, 129, 130, 3};
    const uint8_t command = Pick(commands);
    if (command >= 129 && !OneIn(4)) return;
    Send(0, {command, static_cast<uint8_t>(OneIn(3) ? 0 : OneIn(10) ? 6 : kNode)});
  }

  void Pdo() {
    const uint32_t cob_id = fw_.canopen.params.rpdo_cob_id[Below(4)];
    std::vector<uint8_t> data(OneIn(12) ? Below(9) : 8);
    for (uint8_t i = 0; i < 4; ++i) {
      if (fw_.canopen.params.rpdo_cob_id[i] == cob_id && data.size() == 8 && !OneIn(12)) {
        data.resize((fw_.canopen.rpdo[i].bits + 7u) / 8u);
      }
    }
    for (uint8_t &byte : data) byte = static_cast<uint8_t>(OneIn(2) ? Below(3) : Below(256));
    Send(static_cast<uint16_t>(cob_id & 0x7FF), data);
  }

  void Sync() {
    const uint16_t id = static_cast<uint16_t>(fw_.canopen.params.sync_cob_id & 0x7FF);
    const bool counts = (fw_.canopen.params.sync_counter_overflow != 0) != OneIn(30);
    counter_ = static_cast<uint8_t>(counter_ % 8 + 1);
    Send(id, counts ? std::vector<uint8_t>{counter_} : std::vector<uint8_t>{});
  }

  // Requests of an LSS master, mostly in the right order.
  void Lss() {
    const canopen_signals_t &own = fw_.canopen.signals;
    const uint32_t parts[] = {own.vendor_id, own.product_code, own.revision_number,
                              own.serial_number};
    const auto send = [&](uint8_t command, uint32_t value) {
      Send(LSS_REQUEST_ID,
           {command, static_cast<uint8_t>(value), static_cast<uint8_t>(value >> 8),
            static_cast<uint8_t>(value >> 16), static_cast<uint8_t>(value >> 24), 0, 0, 0});
    };
    switch (Below(4)) {
      case 0:
        send(0x04, OneIn(10) ? Below(256) : Below(2));
        break;
      case 1:
        for (uint8_t i = 0; i < 4; ++i) {
          if (!OneIn(10)) send(static_cast<uint8_t>(0x40 + i), parts[i] + (OneIn(10) ? 1 : 0));
        }
        break;
      case 2:
        for (uint8_t i = 0; i < 6; ++i) {
          const uint32_t part = parts[i < 2 ? i : i / 2 + 1];
          if (!OneIn(10)) send(static_cast<uint8_t>(0x46 + i), part + (OneIn(5) ? 1 : 0));
        }
        break;
      default: {
        static constexpr uint8_t commands[] = {0x11, 0x13, 0x17, 0x4C, 0x51, 0x5A, 0x5D, 0x5E};
        const uint8_t command = OneIn(10) ? 0x15 : Pick(commands);
        send(command, command == 0x15 ? Below(20) : OneIn(2) ? Below(256) : Below(12) << 8);
      }
    }
  }

  void Ticks() { Ticks(OneIn(2000) ? 8000 : OneIn(120) ? Below(400) : 1 + Below(3)); }

  // What takes long is spent with pressing.
  void Ticks(uint32_t ticks) {
    if (ticks > 100 && !pressing_) return Press(ticks);
    for (uint32_t i = 0; i < ticks; ++i) {
      Tick();
      if (!lazy_) Drain();
    }
  }

  void Record_() {
    const int32_t arm = OneIn(4) ? 0 : 1;
    if (arm != 0) {
      fw_object_write(&fw_, FW_SOURCE_LOCAL, AXIS_OBJ_RECORDER_SIGNAL_1, 0x201F00);
      fw_object_write(&fw_, FW_SOURCE_LOCAL, AXIS_OBJ_RECORDER_LENGTH,
                      static_cast<int32_t>(1 + Below(20)));
      fw_object_write(&fw_, FW_SOURCE_LOCAL, AXIS_OBJ_RECORDER_DECIMATION, 1);
      fw_object_write(&fw_, FW_SOURCE_LOCAL, AXIS_OBJ_RECORDER_TRIGGER_EDGE, 0);
      fw_object_write(&fw_, FW_SOURCE_LOCAL, AXIS_OBJ_RECORDER_PRETRIGGER, 0);
    }
    if (fw_object_write(&fw_, FW_SOURCE_LOCAL, AXIS_OBJ_RECORDER_ARM, arm) == FW_OK) Log(kReplaced);
    LogValues();
    LogState();
  }

  void Bus() {
    const uint8_t state = static_cast<uint8_t>(Below(3));
    NoteStored();
    const DriveBefore before(fw_, true);
    fw_can_bus(&fw_, state);
    LogDrive(before);
    Log(kBus, state);
    LogValues();
    LogState();
    if (state == CAN_BUS_OFF && OneIn(2)) {
      Ticks();
      JoinBus();
    }
  }

  // The controller is on the bus, whatever it was before.
  void JoinBus() {
    fw_can_bus(&fw_, CAN_BUS_ACTIVE);
    Log(kBus, CAN_BUS_ACTIVE);
    LogValues();
    LogState();
  }

  void Lose() {
    const uint16_t frames = static_cast<uint16_t>(1 + Below(3));
    fw_can_lost(&fw_, frames);
    told_empty_ = false;
    Log(kLost, 0, 0, frames);
    LogState();
  }

  void Step() {
    if (OneIn(300)) lazy_ = true;
    if (OneIn(20)) {
      lazy_ = false;
      Drain();
    }
    if (OneIn(3)) Ticks();
    const uint32_t choice = Below(1000);
    if (choice < 60) {
      Nmt();
    } else if (choice < 180) {
      Sync();
    } else if (choice < 380) {
      Pdo();
    } else if (choice < 480) {
      Send(static_cast<uint16_t>(0x700 + 10 + Below(4)),
           std::vector<uint8_t>{static_cast<uint8_t>(OneIn(2) ? 5 : 127)});
    } else if (choice < 600) {
      Configure();
    } else if (choice < 660) {
      Remap();
    } else if (choice < 760) {
      WriteAny();
    } else if (choice < 860) {
      ReadAny();
    } else if (choice < 885) {
      UploadSegments();
    } else if (choice < 900) {
      UploadBlocks();
    } else if (choice < 936) {
      DownloadSegments();
    } else if (choice < 950) {
      DownloadBlocks();
    } else if (choice < 980) {
      std::vector<uint8_t> data(8);
      for (uint8_t &byte : data) byte = static_cast<uint8_t>(Below(256));
      Request(data[0], static_cast<uint16_t>(random_()), data[1], static_cast<uint32_t>(random_()));
    } else if (choice < 982) {
      Enable();
    } else if (choice < 983) {
      if (!pressing_) Press(100 + Below(800));
    } else if (choice < 985) {
      EnableServers();
    } else if (choice < 990) {
      Record_();
    } else if (choice < 991) {
      Lss();
    } else if (choice < 993) {
      Bus();
    } else if (choice < 996) {
      Lose();
    } else {
      std::vector<uint8_t> data(Below(9));
      for (uint8_t &byte : data) byte = static_cast<uint8_t>(Below(256));
      Send(static_cast<uint16_t>(Below(0x800)), data);
    }
  }

  // Every object of the communication part.
  void Dump() {
    dumped_ = sent_;
    for (uint16_t object = 1; object < AXIS_OBJ_COUNT; ++object) {
      const uint8_t block = axis_objects[object].block;
      if (block != AXIS_BLOCK_CANOPEN_PARAMETER && block != AXIS_BLOCK_CANOPEN_SIGNAL) continue;
      Log(kObject, 0, object, static_cast<uint32_t>(Read(object)));
    }
  }

  std::mt19937_64 random_;
  fw_t fw_{};
  axis_inputs_t inputs_{};
  axis_outputs_t outputs_{};
  uint8_t buffer_[FW_RECORDER_BYTES]{};
  std::vector<Record> log_;
  Record state_{};
  uint64_t values_[4]{};
  uint32_t recording_ = 0;
  uint8_t refused_ = 0;
  Record drive_{};
  std::vector<int32_t> stored_;
  bool verified_ = false;
  uint8_t counter_ = 0;
  uint16_t server_ = 0;
  struct Draw {
    Flood *flood;
    uint32_t operator()(uint32_t n) const { return flood->Below(n); }
  };
  DrawnPress<Draw> drawn_{Draw{this}};
  ContactScene scene_;
  PressOracle rules_;
  long strikes_ = 0;
  bool pressing_ = false;  // in Press()
  bool whole_ = false;     // no frame is broken
  uint32_t beats_ = 0;     // ms within which the master must be heard
  bool lazy_ = false;
  bool told_empty_ = false;
  uint64_t sent_ = 0;
  uint64_t dumped_ = 0;
};

}  // namespace

int main(int count, char **arguments) {
  if (count != 3) {
    std::fprintf(stderr, "usage: canopen_flood FRAMES SEED\n");
    return 2;
  }
  static Flood flood(std::strtoull(arguments[2], nullptr, 10));
  flood.Run(std::strtoull(arguments[1], nullptr, 10));
  return 0;
}
