// Plays an axis_node's journal again, in process, and logs for canopen_model.py what its CANopen
// node did, in the records of canopen_flood.cpp.
//
// usage: canopen_replay JOURNAL >LOG
//
// The last record is 14, trace hash: the first half of its digits in d. It and the frames out are
// compared with those of axis_node itself, so that what the log says holds for that one.

#include <cstdint>
#include <cstdio>
#include <exception>
#include <string>
#include <variant>

#include "firmware/port/host/firmware.hpp"
#include "host/run/firmware_side.hpp"
#include "host/run/plant_side.hpp"
#include "host/run/replay.hpp"
#include "tests/wire/drive_record.hpp"

namespace {

using namespace forceaxis;

enum Kind : uint8_t {
  kFrameIn = 1,
  kTick,
  kFrameOut,
  kNoMore,
  kState,
  kValue,
  kRefused,
  kRecording,
  kLost = 10,
  kBus,
  kObject,
  kDrive,
  kHash
};

struct Record {
  uint8_t kind, a;
  uint16_t b;
  uint32_t c;
  uint64_t d;
};
static_assert(sizeof(Record) == 16);

constexpr std::int64_t kTicksPerDump = 1500;

uint64_t data_of(const can_frame_t &frame) {
  uint64_t data = 0;
  for (int i = 0; i < 8; ++i) data |= static_cast<uint64_t>(frame.data[i]) << (8 * i);
  return data;
}

class Log {
 public:
  explicit Log(fw_t *axis) : fw_(axis) {
    values();
    state();
  }

  void add(uint8_t kind, uint8_t a = 0, uint16_t b = 0, uint32_t c = 0, uint64_t d = 0) {
    const Record record{kind, a, b, c, d};
    std::fwrite(&record, sizeof record, 1, stdout);
  }

  int32_t read(uint16_t object) const {
    int32_t value = 0;
    fw_object_read(fw_, object, &value);
    return value;
  }

  void state() {
    const auto word = [this](uint16_t object) { return static_cast<uint32_t>(read(object)); };
    add(kState, static_cast<uint8_t>(word(AXIS_OBJ_NMT_STATE)),
        static_cast<uint16_t>(word(AXIS_OBJ_SYNC_COUNT)),
        word(AXIS_OBJ_ERROR_REGISTER) | word(AXIS_OBJ_ERROR_HISTORY_COUNT) << 8 |
            word(AXIS_OBJ_COMMAND_SOURCE) << 16,
        word(AXIS_OBJ_CAN_LOST));
  }

  // What the TPDOs' objects hold, packed from the mapping as a client reads it.
  void values() {
    for (uint8_t i = 0; i < 4; ++i) {
      uint64_t value = 0;
      unsigned bit = 0;
      for (uint8_t k = 0; k < fw_->canopen.params.tpdo_mapped[i]; ++k) {
        const uint32_t entry = fw_->canopen.params.tpdo_mapping[8 * i + k];
        const axis_address_t *at = dictionary_address(static_cast<uint16_t>(entry >> 16),
                                                      static_cast<uint8_t>(entry >> 8));
        const unsigned width = entry & 0xFF;
        const uint64_t mask = (uint64_t{1} << width) - 1;
        value |= (static_cast<uint64_t>(static_cast<uint32_t>(read(at->value))) & mask) << bit;
        bit += width;
      }
      if (value != values_[i]) add(kValue, i, 0, 0, value);
      values_[i] = value;
    }
    const int found = dictionary_domain_size(&fw_->objects, DICTIONARY_RECORDING);
    const uint32_t size = found < 0 ? 0 : static_cast<uint32_t>(found);
    if (size != recording_) add(kRecording, 0, 0, size);
    recording_ = size;
  }

  // Before the frame that is judged by it.
  void refused() {
    uint8_t now = 0;
    for (unsigned i = 0; i < 4; ++i) {
      if ((fw_->canopen.rpdo[i].reported & PDO_REPORTED_REFUSED) != 0) now |= uint8_t(1u << i);
    }
    const bool wrote = (fw_->objects.writers >> fw_->device.command_source & 1) != 0;
    if (fw_->source_silence == 0 || wrote) now |= 0x10;
    if (now != refused_) add(kRefused, now);
    refused_ = now;
  }

  DriveBefore before(const can_frame_t *frame) const {
    return DriveBefore(*fw_, frame != nullptr && is_no_request(frame->id));
  }
  void drive(const DriveBefore &before) { add(kDrive, before.bits(*fw_), before.stopper(*fw_)); }

  void taken_in() {
    values();
    state();
  }

  void ticked() {
    values();
    add(kTick, 0, 0,
        static_cast<uint32_t>(read(AXIS_OBJ_ERROR_CODE) | read(AXIS_OBJ_FAULT) << 16) |
            static_cast<uint32_t>(read(AXIS_OBJ_ACTIVE_MODE)) << 24);
    state();
    for (can_frame_t frame; fw_can_transmit(fw_, &frame);) {
      uint64_t data = data_of(frame);
      if (frame.length < 8) data &= (uint64_t{1} << (8 * frame.length)) - 1;
      add(kFrameOut, frame.length, frame.id, 0, data);
    }
    add(kNoMore);
    state();
  }

  // Every object of the communication part.
  void dump() {
    for (uint16_t object = 1; object < AXIS_OBJ_COUNT; ++object) {
      const uint8_t block = axis_objects[object].block;
      if (block != AXIS_BLOCK_CANOPEN_PARAMETER && block != AXIS_BLOCK_CANOPEN_SIGNAL) continue;
      add(kObject, 0, object, static_cast<uint32_t>(read(object)));
    }
  }

 private:
  fw_t *fw_;
  uint64_t values_[4]{};
  uint32_t recording_ = 0;
  uint8_t refused_ = 0;
};

int replay(const char *file) {
  const host::Journal journal = host::read_journal(file);
  host::Experiment experiment = journal.load();
  experiment.initial.clear();  // the journal has them
  for (host::Action &action : experiment.actions) action.writes.clear();
  fw_config_t config{};
  config.hardware = "host";
  config.node_id = journal.node_id;
  config.buses = journal.buses;
  config.serial_number = journal.serial_number;
  config.modbus_baud = journal.modbus_baud;
  host::FirmwareSide firmware(experiment, {.hash = true, .config = &config});
  host::PlantSide plant(experiment, {});
  auto entry = journal.entries.begin();
  const auto end = journal.entries.end();
  for (; entry != end && std::holds_alternative<host::ObjectWrite>(entry->what); ++entry) {
    replay_entry(*entry, firmware);
  }
  Log log(firmware.axis());
  while (plant.running() && plant.tick() < journal.known_ticks()) {
    for (; entry != end && entry->tick <= plant.tick(); ++entry) {
      const auto *const frame = std::get_if<can_frame_t>(&entry->what);
      const DriveBefore before = log.before(frame);
      replay_entry(*entry, firmware);
      if (frame != nullptr) {
        log.refused();
        log.drive(before);
        log.add(kFrameIn, static_cast<uint8_t>(frame->length | frame->remote << 7), frame->id, 0,
                data_of(*frame));
      } else if (const auto *lost = std::get_if<host::Journal::FramesLost>(&entry->what)) {
        log.add(kLost, 0, 0, lost->count);
      }
      log.taken_in();
    }
    plant.act(firmware.tick(plant.sense()));
    log.ticked();
    if (plant.tick() % kTicksPerDump == 0) log.dump();
  }
  log.add(kHash, 0, 0, 0, std::stoull(firmware.hash().substr(0, 16), nullptr, 16));
  return 0;
}

}  // namespace

int main(int count, char **arguments) {
  if (count != 2) {
    std::fprintf(stderr, "usage: canopen_replay JOURNAL >LOG\n");
    return 2;
  }
  try {
    return replay(arguments[1]);
  } catch (const std::exception &error) {
    std::fprintf(stderr, "canopen_replay: %s\n", error.what());
    return 1;
  }
}
