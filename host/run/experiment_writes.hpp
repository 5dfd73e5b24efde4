#pragma once
// The writes of an experiment to a firmware in any process: the initial writes at power-up, and the
// writes of each table [[at]] before its tick.
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "host/run/experiment.hpp"

namespace forceaxis::host {

// A write of a table [[at]] that the firmware has refused. In some states of the drive, the
// firmware must refuse a write.
struct Refusal {
  std::int64_t tick;
  std::string object;
  std::string reason;
};

class ExperimentWrites {
 public:
  // Writes an object before a tick. Returns FW_OK or FW_ERROR_.
  using Write = std::function<int(std::int64_t tick, const ObjectWrite &)>;

  // The experiment must exist as long as this object.
  explicit ExperimentWrites(const Experiment &experiment)
      : experiment_(&experiment), action_(experiment.actions.begin()) {}

  // Makes the initial writes. Objects can limit each other, so refused writes are tried again until
  // all are accepted. Throws sim::InputError if the firmware still refuses a write.
  void write_initial(const Write &write) const;

  bool due(std::int64_t tick) const {
    return action_ != experiment_->actions.end() && action_->tick <= tick;
  }
  void write_due(std::int64_t tick, const Write &write);

  const std::vector<Refusal> &refused() const { return refused_; }

 private:
  const Experiment *experiment_;
  std::vector<Action>::const_iterator action_;
  std::vector<Refusal> refused_;
};

}  // namespace forceaxis::host
