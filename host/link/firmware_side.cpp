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

void FirmwareSide::write_due(std::int64_t tick) {
  for (; due(tick); ++action_) {
    for (const ObjectWrite &w : action_->writes) {
      const int error = write(tick, w);
      if (error != FW_OK) {
        refused_.push_back({tick, object_meta(w.object).name, refusal_text(error)});
      }
    }
  }
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
