#include "host/link/firmware_side.hpp"

#include <array>
#include <new>

#include "firmware/objects/generated/axis_objects.h"
#include "host/link/objects.hpp"

namespace forceaxis::host {
namespace {

const char *refusal_text(int error) {
  switch (error) {
    case FW_ERROR_RANGE:
      return "outside its range or at odds with another object";
    case FW_ERROR_STATE:
      return "not in this state of the axis: a fault is latched, or it must be disabled or idle";
    default:
      return "cannot be written";
  }
}

}  // namespace

FirmwareSide::FirmwareSide(const Experiment &experiment, const FirmwareOptions &options)
    : experiment_(&experiment),
      options_(options),
      axis_(options.config ? axis_host_create_with(options.config) : axis_host_create()),
      action_(experiment.actions.begin()) {
  if (!axis_) throw std::bad_alloc();
  signals_ = axis_host_signals(axis_.get());
  write_initial();
}

int FirmwareSide::write(std::int64_t tick, const ObjectWrite &w) {
  if (options_.writing) options_.writing(tick, w);
  return axis_host_write(axis_.get(), w.object, w.raw);
}

void FirmwareSide::write_initial() {
  std::vector<ObjectWrite> left = experiment_->initial;
  while (!left.empty()) {
    std::vector<ObjectWrite> refused;
    for (const ObjectWrite &w : left) {
      if (write(0, w) != FW_OK) refused.push_back(w);
    }
    if (refused.size() == left.size()) {
      const ObjectWrite &w = refused.front();
      throw sim::InputError(
          experiment_->file.string(), std::string("firmware.") + object_meta(w.object).name,
          "expected a value that the firmware takes beside the others, it refused " +
              std::to_string(w.raw) + " (raw): " + refusal_text(write(0, w)));
    }
    left = refused;
  }
}

std::int32_t FirmwareSide::read(std::uint16_t object) const {
  std::int32_t value = 0;
  axis_host_read(axis_.get(), object, &value);
  return value;
}

LinkOutputs FirmwareSide::run_tick(std::int64_t tick, std::uint8_t axis) {
  axis_outputs_t outputs{};
  axis_host_tick(axis_.get(), &inputs_, &outputs);
  return {tick,
          outputs.dac_code,
          static_cast<std::uint8_t>((outputs.amp_enable ? 1 : 0) | (outputs.brake_release ? 2 : 0)),
          signals_->fault,
          signals_->limit_reason,
          axis};
}

LinkOutputs FirmwareSide::tick(const LinkInputs &in) {
  for (; action_ != experiment_->actions.end() && action_->tick <= in.tick; ++action_) {
    for (const ObjectWrite &w : action_->writes) {
      const int error = write(in.tick, w);
      if (error != FW_OK) {
        refused_.push_back({in.tick, object_meta(w.object).name, refusal_text(error)});
      }
    }
  }
  inputs_.encoder_cnt = in.encoder_cnt;
  inputs_.adc_code[0] = in.adc0_code;
  inputs_.adc_code[1] = in.adc1_code;
  inputs_.din = in.din;
  inputs_.sensor_valid = in.sensor_valid;
  const LinkOutputs out = run_tick(in.tick, in.axis);
  if (options_.hash) hash_.add(tick_record(in, out));
  next_tick_ = in.tick + 1;
  return out;
}

LinkOutputs FirmwareSide::lose_sensors(std::uint8_t axis) {
  inputs_.sensor_valid = 0;
  return run_tick(next_tick_, axis);
}

void FirmwareSide::discard_output() {
  can_frame_t frame;
  while (axis_host_can_transmit(axis_.get(), &frame)) {
  }
  std::array<std::uint8_t, 512> bytes;
  while (axis_host_modbus_transmit(axis_.get(), bytes.data(), bytes.size()) > 0) {
  }
}

}  // namespace forceaxis::host
