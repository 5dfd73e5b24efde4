#include "host/run/experiment_writes.hpp"

#include <algorithm>

#include "firmware/port/host/axis_host.h"
#include "host/run/objects.hpp"

namespace forceaxis::host {
const char *refusal_text(int error) {
  switch (error) {
    case FW_ERROR_RANGE:
      return "the value is out of range or contradicts another object";
    case FW_ERROR_STATE:
      return "not in this state of the axis: a fault is latched, or the axis must be disabled or "
             "idle";
    default:
      return "cannot be written";
  }
}

void ExperimentWrites::write_initial(const Write &write, bool has_stored) const {
  std::vector<ObjectWrite> remaining = experiment_->initial;
  if (has_stored) {
    const std::vector<std::uint16_t> &given = experiment_->overridden;
    std::erase_if(remaining, [&given](const ObjectWrite &w) {
      return object_meta(w.object).stored != 0 && std::ranges::find(given, w.object) == given.end();
    });
  }
  while (!remaining.empty()) {
    std::vector<ObjectWrite> refused;
    for (const ObjectWrite &w : remaining) {
      if (write(0, w) != FW_OK) refused.push_back(w);
    }
    if (refused.size() == remaining.size()) {
      const ObjectWrite &w = refused.front();
      throw sim::InputError(
          experiment_->file.string(), std::string("firmware.") + object_meta(w.object).name,
          "expected a value that the firmware accepts with the other values, but it refused " +
              std::to_string(w.raw) + " (raw): " + refusal_text(write(0, w)));
    }
    remaining = refused;
  }
}

void ExperimentWrites::write_due(std::int64_t tick, const Write &write) {
  for (; due(tick); ++action_) {
    for (const ObjectWrite &w : action_->writes) {
      const int error = write(tick, w);
      if (error != FW_OK) {
        refused_.push_back({tick, object_meta(w.object).name, refusal_text(error)});
      }
    }
  }
}

}  // namespace forceaxis::host
