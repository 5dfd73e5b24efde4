#pragma once
// The plant's side of a run: plant, impulses, trace, metrics and verdict. The plant's side and the
// firmware's side exchange only records. Functions that run in every tick are inline, as in
// firmware_side.hpp.
//
//   PlantSide plant(experiment, options);
//   while (plant.running()) plant.act(answer(plant.sense()));
//   RunResult result = plant.finish();
#include <algorithm>
#include <cstdint>
#include <optional>
#include <vector>

#include "host/run/experiment.hpp"
#include "host/run/records.hpp"
#include "host/run/result.hpp"
#include "host/run/trace_hash.hpp"
#include "sim/hybrid/plant.hpp"
#include "sim/model/elements/dac.hpp"
#include "sim/model/elements/encoder.hpp"

namespace forceaxis::host {

class PlantSide {
 public:
  // The experiment must exist as long as this object.
  PlantSide(const Experiment &experiment, const RunOptions &options);

  // Returns true if the run has a further tick. The firmware computes a tick at the start and at
  // the end of the run, so the total is Experiment::ticks + 1.
  bool running() const { return tick_ <= experiment_->ticks; }
  std::int64_t tick() const { return tick_; }
  const sim::Plant &plant() const { return plant_; }

  // Applies the actions of the next tick, then returns the sensor codes for this tick. Must be
  // called once in each tick. The result is valid until the next call.
  const LinkInputs &sense() {
    if (due()) act_due();
    const sim::SensorCodes &codes = plant_.codes();
    in_.tick = tick_;
    in_.encoder_cnt = codes.encoder;
    in_.position_age = codes.encoder_age;
    in_.drive = codes.drive;
    in_.force_age = force_sensor_ != ForceSensor::silent ? codes.force_age
                    : in_.force_age < kOldest ? static_cast<std::uint8_t>(in_.force_age + 1)
                                              : kOldest;
    in_.adc0_code =
        force_sensor_ == ForceSensor::live ? codes.adc[0] : failed_reading(codes.adc[0]);
    in_.adc1_code = codes.adc[1];
    in_.din = static_cast<std::uint8_t>(kEnabled | codes.switches);
    return in_;
  }

  // Records the outputs of the firmware and simulates the plant to the next tick. Throws
  // sim::SimulationError if the simulation cannot continue, and RunStopped if options.stop returns
  // true.
  void act(const LinkOutputs &out) {
    if (tick_ % kTicksBetweenAsking == 0 && options_.stop && options_.stop()) throw RunStopped();
    const TickRecord record = tick_record(in_, out);
    hash_.add(record);
    if (first_fault_ == kNoFault) first_fault_ = out.fault;
    for (const std::size_t i : contact_forces_) {
      metrics_.peak_force_N = std::max(metrics_.peak_force_N, plant_.signal_at(i));
    }
    if (untouched_ > 0) look_for_contact();
    if (tick_ > 0 && record.adc0_code != adc0_before_) metrics_.last_adc_change_tick = tick_;
    adc0_before_ = record.adc0_code;
    const bool saturated = record.dac_code == dac_top_ || record.dac_code == dac_bottom_;
    metrics_.saturated_run_ticks += saturated;
    if (tick_ == window_start_) begin_window();
    if (tick_ >= window_start_) {
      force_.add(record.adc0_code);
      position_.add(record.encoder_cnt);
      position_sum_ += record.encoder_cnt;
      metrics_.saturated_ticks += saturated;
      look_at_reading(record.adc0_code);
      if (tick_ >= second_half_) {
        force_late_.add(record.adc0_code);
        position_late_.add(record.encoder_cnt);
      }
    }
    if (force_task_) task_force_.push_back(plant_.signal_at(task_place_));
    if (options_.trace) keep(record, out);
    if (tick_ < experiment_->ticks)
      plant_.step(out.dac_code, (out.out & 1) != 0, (out.out & 2) != 0);
    ++tick_;
  }

  // Returns the result of the run after the last tick. The list RunResult::refused is empty.
  RunResult finish();

 private:
  // Computes the peak-to-peak value of a quantity over several ticks.
  template <class T>
  class Span {
   public:
    void add(T value) {
      low_ = empty_ || value < low_ ? value : low_;
      high_ = empty_ || value > high_ ? value : high_;
      empty_ = false;
    }
    double width() const { return static_cast<double>(high_) - static_cast<double>(low_); }

   private:
    bool empty_ = true;
    T low_{}, high_{};
  };

  // Number of ticks between two calls of the function options.stop.
  static constexpr std::int64_t kTicksBetweenAsking = 1024;
  static constexpr std::uint8_t kEnabled = 1;  // has the same value as AXIS_DIGITAL_INPUTS_ENABLE
                                               // of the firmware
  // has the same value as AXIS_FAULT_NONE of the firmware
  static constexpr std::uint8_t kNoFault = 0;
  static constexpr std::uint8_t kOldest = 255;  // largest age in LinkInputs

  bool due() const { return action_ != experiment_->actions.end() && action_->tick <= tick_; }
  void act_due();
  // Returns the ADC code that replaces `code` while the force sensor has failed.
  std::uint16_t failed_reading(std::uint16_t code) const;
  void keep(const TickRecord &record, const LinkOutputs &out);
  // Computes the codes at the ends of the range of the force reading. This range ends where the
  // converter saturates, or where the sensor or its electronics saturate earlier.
  void find_reading_ends(const sim::Adc &adc);
  // Returns the force of a code of ADC 0.
  double reading_N(int code) const;
  // Counts a tick at which the force reading is at an end of its range.
  void look_at_reading(int code) {
    if ((code > adc_low_ && code < adc_high_) || code == adc_zero_) return;
    ++metrics_.reading_range_ticks;
    if (plant_.model().adc[0])
      metrics_.reading_end_N = reading_N(code <= adc_low_ ? adc_low_ : adc_high_);
  }
  void look_for_contact();
  void begin_window();
  bool all_pressed() const;
  // Returns the first time at which every contact of the criterion has been closed at least once.
  // If the criterion names no contact, returns the time at which any contact of the model closed
  // first.
  std::optional<double> first_contact_s() const;
  void check_setpoint();
  // Returns the number of contact losses of the criterion's contacts since the start. Backlashes
  // and stops are not counted.
  std::int64_t contact_losses() const;

  const Experiment *experiment_;
  RunOptions options_;
  sim::Plant plant_;
  RunResult result_;
  std::vector<Action>::const_iterator action_;
  // Signal indices of the forces of all contacts.
  std::vector<std::size_t> contact_forces_;
  // Names of the criterion's contacts.
  std::vector<std::string> held_;
  // Signal indices of the forces of the criterion's contacts.
  std::vector<std::size_t> held_forces_;
  std::size_t width_;
  // First tick at which each contact in `held_` was closed, or -1 before this tick. `untouched_` is
  // the number of contacts that have not been closed yet.
  std::vector<std::int64_t> first_pressed_;
  std::size_t untouched_ = 0;
  // Largest and smallest output of the firmware, 2047 and -2048 codes, in codes of the DAC.
  int dac_top_, dac_bottom_;
  // Codes of ADC 0 at the ends of the range of the force reading.
  int adc_low_ = 0, adc_high_ = -1;
  int adc_zero_ = -1;  // code of ADC 0 at force 0
  std::int64_t window_start_;
  std::int64_t second_half_;  // first tick in the second half of the verdict's time window
  std::int64_t losses_before_window_ = 0;
  std::int64_t tick_ = 0;
  LinkInputs in_{};
  ForceSensor force_sensor_ = ForceSensor::live;
  std::uint16_t adc0_before_ = 0;
  std::uint8_t first_fault_ = kNoFault;
  std::optional<ForceTask> force_task_;
  std::size_t task_place_ = 0;      // index of the force signal, which ForceTask::signal names
  std::vector<double> task_force_;  // value in N, at each tick, of the signal ForceTask::signal
  Span<int> force_, force_late_;
  Span<std::int64_t> position_, position_late_;
  double position_sum_ = 0.0;  // sum of the encoder counts in the time window of the verdict
  Metrics metrics_;
  TraceHash hash_;
};

}  // namespace forceaxis::host
