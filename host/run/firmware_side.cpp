#include "host/run/firmware_side.hpp"

#include <array>
#include <new>

namespace forceaxis::host {
namespace {

// Returns an axis whose output has at most the bits of the model's DAC.
fw_t *power_up(const Experiment &experiment, const fw_config_t *given) {
  fw_config_t config = given ? *given : fw_config_t{};
  config.dac_bits = static_cast<std::uint8_t>(experiment.model->dac.bits);
  return axis_host_create_with(&config);
}

}  // namespace

FirmwareSide::FirmwareSide(const Experiment &experiment, const FirmwareOptions &options)
    : options_(options),
      experiment_(&experiment),
      axis_(power_up(experiment, options.config)),
      writes_(experiment) {
  if (!axis_) throw std::bad_alloc();
  signals_ = &axis_->axis.signals;
  // Some traced values of the drive exist only while the drive function runs. This write of an
  // unchanged value starts the drive function and does not change the outputs.
  if (!experiment.traced.empty())
    fw_object_write(axis_.get(), FW_SOURCE_LOCAL, AXIS_OBJ_VELOCITY_THRESHOLD,
                    read(AXIS_OBJ_VELOCITY_THRESHOLD));
  writes_.write_initial(writer());
}

ExperimentWrites::Write FirmwareSide::writer() {
  return [this](std::int64_t tick, const ObjectWrite &w) {
    if (options_.writing) options_.writing(tick, w);
    return fw_object_write(axis_.get(), FW_SOURCE_LOCAL, w.object, w.raw);
  };
}

std::int32_t FirmwareSide::read(std::uint16_t object) const {
  std::int32_t value = 0;
  fw_object_read(axis_.get(), object, &value);
  return value;
}

void FirmwareSide::discard_output() {
  can_frame_t frame;
  while (fw_can_transmit(axis_.get(), &frame)) {
  }
  std::array<std::uint8_t, 512> bytes;
  while (fw_modbus_transmit(axis_.get(), bytes.data(), bytes.size()) > 0) {
  }
}

}  // namespace forceaxis::host
