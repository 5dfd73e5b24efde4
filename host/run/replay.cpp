#include "host/run/replay.hpp"

#include <algorithm>
#include <variant>
#include <vector>

#include "firmware/port/host/store_file.h"
#include "host/run/firmware_side.hpp"
#include "host/run/plant_side.hpp"

namespace forceaxis::host {
namespace {

// The store or the incident archive of a replay, in memory. At first, it has the content from the
// start of the journal.
class RamStore {
 public:
  RamStore(std::span<const std::uint8_t> image, std::uint32_t sector_bytes)
      : bytes_(2 * std::size_t{sector_bytes}, 0xFF) {
    std::copy_n(image.begin(), std::min(image.size(), bytes_.size()), bytes_.begin());
    memory_.context = this;
    memory_.sector_bytes = sector_bytes;
    memory_.read = [](void *context, std::uint32_t address, std::uint8_t *bytes,
                      std::uint32_t count) {
      std::copy_n(&static_cast<RamStore *>(context)->bytes_[address], count, bytes);
    };
    memory_.program = [](void *context, std::uint32_t address, const std::uint8_t *bytes,
                         std::uint32_t count) {
      // A write changes bits only from 1 to 0, as in flash memory.
      std::uint8_t *to = &static_cast<RamStore *>(context)->bytes_[address];
      for (std::uint32_t i = 0; i < count; ++i) to[i] &= bytes[i];
      return true;
    };
    memory_.erase = [](void *context, std::uint8_t sector) {
      auto &store = *static_cast<RamStore *>(context);
      const std::uint32_t bytes = store.memory_.sector_bytes;
      std::fill_n(&store.bytes_[sector * bytes], bytes, std::uint8_t{0xFF});
      return true;
    };
  }
  RamStore(const RamStore &) = delete;
  RamStore &operator=(const RamStore &) = delete;

  const store_memory_t *memory() const { return &memory_; }

 private:
  std::vector<std::uint8_t> bytes_;
  store_memory_t memory_{};
};

// Passes each kind of journal entry to the firmware.
struct Applier {
  FirmwareSide &firmware;
  fw_t *axis = firmware.axis();
  void operator()(const ObjectWrite &w) const {
    fw_object_write(axis, FW_SOURCE_LOCAL, w.object, w.raw);
  }
  void operator()(const can_frame_t &frame) const { fw_can_receive(axis, &frame); }
  void operator()(const Journal::FramesLost &l) const { fw_can_lost(axis, l.count); }
  void operator()(const Journal::BusState &b) const { fw_can_bus(axis, b.state); }
  void operator()(const Journal::Overrun &) const { fw_overrun(axis, 0); }
  void operator()(const Journal::Sensorless &s) const {
    for (std::int64_t i = 0; i < s.count; ++i) {
      firmware.lose_sensors(1);
      firmware.discard_output();
    }
  }
  void operator()(const Journal::ModbusBytes &m) const {
    fw_modbus_receive(axis, m.bytes.data(), static_cast<std::uint16_t>(m.bytes.size()));
  }
};

}  // namespace

void replay_entry(const Journal::Entry &entry, FirmwareSide &firmware) {
  std::visit(Applier{firmware}, entry.what);
}

RunResult replay(const Journal &journal, const Experiment &experiment, const RunOptions &options) {
  // Experiment without writes, because the journal contains the writes.
  Experiment silent = experiment;
  silent.initial.clear();
  for (Action &action : silent.actions) action.writes.clear();
  RamStore store(journal.store, STORE_FILE_SECTOR_BYTES);
  RamStore archive(journal.archive, ARCHIVE_FILE_SECTOR_BYTES);
  fw_config_t config{};
  config.hardware = "host";
  config.node_id = journal.node_id;
  config.buses = journal.buses;
  config.serial_number = journal.serial_number;
  config.modbus_baud = journal.modbus_baud;
  if (journal.has_store) config.memory = store.memory();
  if (journal.has_archive) config.archive = archive.memory();
  FirmwareSide firmware(silent, {.hash = true, .config = &config});
  PlantSide plant(experiment, options);
  std::vector<std::int32_t> objects;
  auto entry = journal.entries.begin();
  while (plant.running() && plant.tick() < journal.known_ticks()) {
    for (; entry != journal.entries.end() && entry->tick <= plant.tick(); ++entry) {
      replay_entry(*entry, firmware);
    }
    plant.act(firmware.tick(plant.sense()));
    if (options.trace) firmware.trace(objects);
    firmware.discard_output();
  }
  RunResult result = plant.finish();
  result.objects = std::move(objects);
  result.cycle = firmware.cycle();
  result.firmware_hash = firmware.hash();
  return result;
}

}  // namespace forceaxis::host
