#pragma once
// Writes the objects of an experiment to the firmware, which may run in another process: the
// initial writes at power-up, and the writes of each table [[at]] before the tick of this table.
#include <cstdint>
#include <functional>
#include <string>
#include <tuple>
#include <vector>

#include "host/run/experiment.hpp"
#include "host/run/item.hpp"

namespace forceaxis::host {

// A write of a table [[at]] that the firmware has refused, for example because of the state of the
// drive.
struct Refusal {
  static constexpr const char *kName = "RefusedWrite";
  static constexpr const char *kMeaning =
      "A refused write: the firmware refused the write to an object in [[at]] of the experiment.";
  std::int64_t tick;
  std::string object;
  std::string reason;

  static constexpr auto items() {
    return std::tuple{item("tick", &Refusal::tick), item("object", &Refusal::object),
                      item("reason", &Refusal::reason)};
  }
};

// Returns the text that explains an error FW_ERROR_ to the user. The error is the answer to a
// refused write.
const char *refusal_text(int error);

class ExperimentWrites {
 public:
  // Function that writes an object before a tick and returns FW_OK or FW_ERROR_.
  using Write = std::function<int(std::int64_t tick, const ObjectWrite &)>;

  // The experiment must exist as long as this ExperimentWrites.
  explicit ExperimentWrites(const Experiment &experiment)
      : experiment_(&experiment), action_(experiment.actions.begin()) {}

  // Makes the initial writes. One object can limit the value of another object, so refused writes
  // are repeated until the firmware has accepted all writes. Throws sim::InputError if the firmware
  // finally refuses a write. `has_stored`: the axis has loaded parameters that it stored. They
  // remain, unless an override gives another value, because [firmware] is the state of an axis that
  // has stored nothing.
  void write_initial(const Write &write, bool has_stored = false) const;

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
