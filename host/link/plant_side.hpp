#pragma once
// The plant's side of a run: plant, impulses, trace, metrics and verdict. It knows nothing of the
// firmware but the records.
//
//   PlantSide plant(experiment, options);
//   while (plant.running()) plant.act(answer(plant.sense()));
//   RunResult result = plant.finish();
#include <cstdint>
#include <vector>

#include "host/link/experiment.hpp"
#include "host/link/records.hpp"
#include "host/link/run.hpp"
#include "host/link/trace_hash.hpp"
#include "sim/hybrid/plant.hpp"

namespace forceaxis::host {

class PlantSide {
 public:
  // The experiment must outlive the side.
  PlantSide(const Experiment &experiment, const RunOptions &options);

  // Whether a tick is left; the controller is evaluated at both ends, ticks + 1 times.
  bool running() const { return tick_ <= experiment_->ticks; }
  std::int64_t tick() const { return tick_; }

  // What the sensors say in the coming tick, after the impulses due. Once a tick; stays until the
  // next.
  const LinkInputs &sense();

  // What the firmware answered to it: recorded, then the plant steps to the next tick. Throws
  // sim::SimulationError if it cannot be stepped on, RunStopped if options.stop says so.
  void act(const LinkOutputs &out);

  // After the last tick. `refused` is left empty.
  RunResult finish();

 private:
  // Peak to peak over the ticks of the window.
  template <class T>
  class Ripple {
   public:
    void add(T value) {
      low_ = empty_ || value < low_ ? value : low_;
      high_ = empty_ || value > high_ ? value : high_;
      empty_ = false;
    }
    double peak_to_peak() const { return static_cast<double>(high_) - static_cast<double>(low_); }

   private:
    bool empty_ = true;
    T low_{}, high_{};
  };

  const Experiment *experiment_;
  RunOptions options_;
  sim::Plant plant_;
  RunResult result_;
  std::vector<Action>::const_iterator action_;
  std::vector<std::size_t> contact_forces_;  // places of their signals
  std::size_t width_;
  std::int64_t window_start_;
  std::int64_t losses_before_window_ = 0;
  std::int64_t tick_ = 0;
  LinkInputs in_{};
  std::uint16_t adc0_before_ = 0;
  std::uint8_t first_fault_;
  Ripple<int> force_;
  Ripple<std::int64_t> position_;
  Metrics metrics_;
  TraceHash hash_;
};

}  // namespace forceaxis::host
