#pragma once
// The writes of an experiment to a firmware in any process: the initial ones at power-up, those of
// each [[at]] before its tick.
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "host/run/experiment.hpp"

namespace forceaxis::host {

// A write of an [[at]] that the firmware refused, as it must in some states.
struct Refusal {
  std::int64_t tick;
  std::string object;
  std::string reason;
};

class ExperimentWrites {
 public:
  // Performs a write before this tick; returns FW_OK or FW_ERROR_.
  using Write = std::function<int(std::int64_t tick, const ObjectWrite &)>;

  // The experiment must outlive this.
  explicit ExperimentWrites(const Experiment &experiment)
      : experiment_(&experiment), action_(experiment.actions.begin()) {}

  // Objects that limit each other are retried until all are accepted. Throws sim::InputError if one
  // stays refused.
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
