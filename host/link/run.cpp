#include "host/link/run.hpp"

#include "host/link/firmware_side.hpp"
#include "host/link/plant_side.hpp"

namespace forceaxis::host {

// Flat: both sides in one loop.
[[gnu::flatten]] RunResult run(const Experiment &experiment, const RunOptions &options) {
  PlantSide plant(experiment, options);
  FirmwareSide firmware(experiment, {.hash = options.firmware_hash});
  while (plant.running()) plant.act(firmware.tick(plant.sense()));
  RunResult result = plant.finish();
  result.refused = firmware.refused();
  if (options.firmware_hash) result.firmware_hash = firmware.hash();
  return result;
}

std::string judge(const Criterion &criterion, const Metrics &metrics, bool faulted) {
  const bool held = !criterion.contact_held || (metrics.in_contact && metrics.contact_losses == 0);
  const bool calm = metrics.force_ripple_count <=
                        criterion.force_ripple_max_count.value_or(metrics.force_ripple_count) &&
                    metrics.position_ripple_count <=
                        criterion.position_ripple_max_count.value_or(metrics.position_ripple_count);
  return held && calm && !faulted ? "stable" : "unstable";
}

}  // namespace forceaxis::host
