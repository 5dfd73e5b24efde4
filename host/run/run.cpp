#include "host/run/run.hpp"

#include "host/run/firmware_side.hpp"
#include "host/run/plant_side.hpp"

namespace forceaxis::host {

// The attribute makes the compiler inline plant and firmware into one loop.
[[gnu::flatten]] RunResult run(const Experiment &experiment, const RunOptions &options) {
  PlantSide plant(experiment, options);
  FirmwareSide firmware(experiment, {.hash = options.firmware_hash});
  std::vector<std::int32_t> objects;
  while (plant.running()) {
    plant.act(firmware.tick(plant.sense()));
    if (options.trace) firmware.trace(objects);
  }
  RunResult result = plant.finish();
  result.objects = std::move(objects);
  result.refused = firmware.refused();
  result.cycle = firmware.cycle();
  if (options.firmware_hash) result.firmware_hash = firmware.hash();
  return result;
}

}  // namespace forceaxis::host
