#include "host/run/firmware_side.hpp"

#include <array>
#include <iterator>
#include <new>

#include "firmware/port/host/firmware.hpp"
#include "host/run/objects.hpp"

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
  if (experiment.cycle) {
    const auto &record = experiment.cycle->record;
    const cycle_check_t check = fw_select_program(axis_.get(), record.data(),
                                                  static_cast<std::uint32_t>(4 * record.size()));
    if (check.reason != CYCLE_ACCEPTED)
      throw sim::InputError(experiment.file.string(), "cycle",
                            "expected a program that the firmware accepts, got reason " +
                                std::to_string(check.reason) + ", part " +
                                std::to_string(check.number) +
                                "; report this as an error of "
                                "forceaxis");
  }
  writes_.write_initial(writer());
}

std::optional<CycleResult> FirmwareSide::cycle() const {
  if (!experiment_->cycle) return std::nullopt;
  const CycleProgram &program = *experiment_->cycle;
  const cycle_t &own = axis_->drive.cycle;
  CycleResult result;
  result.state = enum_text(AXIS_OBJ_CYCLE_STATE, read(AXIS_OBJ_CYCLE_STATE));
  result.outcome = enum_text(AXIS_OBJ_CYCLE_OUTCOME, own.outcome);
  result.cycles = read(AXIS_OBJ_CYCLE_COUNT);
  if (own.state != CYCLE_DONE) return result;
  if (own.outcome != CYCLE_BY_PROGRAM) result.failed_phase = program.phases[own.failed_phase];
  static const char *const kVerdicts[] = {"good",  "below",       "above",  "wrong side",
                                          "again", "not reached", "aborted"};
  static_assert(std::size(kVerdicts) == CYCLE_VERDICTS);
  for (std::size_t i = 0; i < program.elements.size(); ++i) {
    const cycle_element_result_t figure = cycle_result(&own, static_cast<std::uint8_t>(i));
    result.figures.push_back({figure.value * program.elements[i].per_value, figure.found_tick,
                              kVerdicts[figure.verdict]});
  }
  return result;
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
