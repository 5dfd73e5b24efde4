#include "host/run/firmware_side.hpp"

#include <array>
#include <new>

#include "firmware/port/host/firmware.hpp"
#include "host/run/cycle_result.hpp"
#include "sim/model/elements/adc.hpp"
#include "sim/model/elements/dac.hpp"

namespace forceaxis::host {
namespace {

// Returns an axis whose output has at most the bits of the model's DAC.
fw_t *power_up(const Experiment &experiment, const fw_config_t *given) {
  fw_config_t config = given ? *given : fw_config_t{};
  config.dac_bits = static_cast<std::uint8_t>(experiment.model->dac->bits);
  return axis_host_create_with(&config);
}

// Returns true if an axis in this state of its store (AXIS_STORE_STATE_) has loaded a parameter set
// at power-up.
bool has_loaded(std::int32_t store_state) {
  return store_state == AXIS_STORE_STATE_LOADED || store_state == AXIS_STORE_STATE_LOADED_OLDER ||
         store_state == AXIS_STORE_STATE_LOADED_PARTLY ||
         store_state == AXIS_STORE_STATE_LOADED_OLD_DEFAULTS;
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
  if (!experiment.trace.objects.empty())
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
  const bool is_loaded = has_loaded(read(AXIS_OBJ_STORE_STATE));
  writes_.write_initial(writer(), is_loaded);
  if (is_loaded && !options.store.empty()) check_loaded();
}

// Refuses a store of an axis with other converters, because the firmware would read wrong forces.
void FirmwareSide::check_loaded() const {
  const std::int32_t bits = read(AXIS_OBJ_ADC_BITS);
  for (const auto &adc : experiment_->model->adc) {
    if (adc && adc->bits != bits) {
      throw sim::InputError(options_.store, "adc_bits",
                            "expected " + std::to_string(adc->bits) +
                                ", the resolution of the model's ADC in bits, got the stored " +
                                std::to_string(bits) +
                                "; name the store of an axis with this model, or override "
                                "firmware.adc_bits and store anew");
    }
  }
}

std::optional<CycleResult> FirmwareSide::cycle() const {
  if (!experiment_->cycle) return std::nullopt;
  const CycleProgram &program = *experiment_->cycle;
  const cycle_t &own = axis_->drive.cycle;
  CycleValues values{.state = read(AXIS_OBJ_CYCLE_STATE),
                     .outcome = read(AXIS_OBJ_CYCLE_OUTCOME),
                     .cycles = read(AXIS_OBJ_CYCLE_COUNT),
                     .failed_phase = {},
                     .elements = {}};
  // A client of a bus may have selected another program, whose phases and elements have no names
  // here.
  const void *const record = program.record.data();
  if (cycle_is_done(values.state) && axis_->drive.program == record) {
    values.failed_phase = own.failed_phase;
    values.invalid_ticks = own.invalid_ticks;
    for (std::size_t i = 0; i < program.elements.size(); ++i) {
      const cycle_element_result_t found = cycle_result(&own, static_cast<std::uint8_t>(i));
      values.elements.push_back({found.value, found.verdict + 1, found.found_tick});
    }
  }
  return cycle_result_of(program, values);
}

ExperimentWrites::Write FirmwareSide::writer() {
  return [this](std::int64_t tick, const ObjectWrite &w) {
    if (options_.writing) options_.writing(tick, w);
    return fw_object_write(axis_.get(), FW_SOURCE_LOCAL, w.object, w.raw);
  };
}

void FirmwareSide::complete_first_save(std::uint8_t before) {
  store_t &store = axis_->store;
  if (store.set != STORE_NOWHERE || before == AXIS_STORE_STATE_RESTORED) return;
  store.first = AXIS_OBJ_NONE;
  store.last = AXIS_OBJ_COUNT;
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
