#pragma once
// The firmware's side of a run: the firmware of one axis, the writes of the experiment, and a trace
// hash. The firmware's side and the plant's side exchange only records. Functions that run in every
// tick are inline, so that the records of a run in one process need not be stored in memory.
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "firmware/port/host/axis_host.h"
#include "host/run/experiment_writes.hpp"
#include "host/run/records.hpp"
#include "host/run/result.hpp"
#include "host/run/trace_hash.hpp"
#include "sim/model/elements/dac.hpp"

namespace forceaxis::host {

struct FirmwareOptions {
  // true: the trace hash for hash() is computed.
  bool hash = false;
  // Configuration of the firmware. If the pointer is NULL, the axis has no bus.
  const fw_config_t *config = nullptr;
  // File of the parameter store in `config`, for errors. If it is empty, a loaded set is not
  // compared with the model.
  std::string store = {};
  // Function that is called with every write of the experiment before the firmware receives the
  // write. The tick of initial writes is 0.
  std::function<void(std::int64_t, const ObjectWrite &)> writing = {};
};

class FirmwareSide {
 public:
  // Powers up the firmware and makes the initial writes by ExperimentWrites::write_initial().
  // Parameters that the firmware has loaded from its store remain.
  // Throws sim::InputError if the firmware refuses an initial write, or if it has loaded another
  // resolution than that of the model's ADCs. The experiment must exist as long as this object.
  FirmwareSide(const Experiment &experiment, const FirmwareOptions &options);

  // Makes the writes of the experiment for the next tick, then computes this tick of the firmware.
  LinkOutputs tick(const LinkInputs &in) {
    if (writes_.due(in.tick)) write_due(in.tick);
    axis_inputs_t inputs{};
    inputs.encoder_cnt = in.encoder_cnt;
    inputs.adc_code[0] = in.adc0_code;
    inputs.adc_code[1] = in.adc1_code;
    inputs.din = in.din;
    inputs.sensor_valid = in.sensor_valid;
    inputs.drive = in.drive;
    inputs.position_age = in.position_age;
    inputs.force_age = in.force_age;
    const LinkOutputs out = run_tick(inputs, in.tick, in.axis);
    if (options_.hash) hash_.add(tick_record(in, out));
    last_ = inputs;
    next_tick_ = in.tick + 1;
    return out;
  }

  // Computes one tick after the plant has stopped sending. sensor_valid is 0, and the other inputs
  // are those of the last tick. The trace does not contain this tick. The firmware outputs DAC code
  // 0, disables the drive and latches the fault sensor_invalid.
  LinkOutputs lose_sensors(std::uint8_t axis) {
    axis_inputs_t inputs = last_;
    inputs.sensor_valid = 0;
    return run_tick(inputs, next_tick_, axis);
  }

  // Appends the raw values of the experiment's traced objects to `objects`.
  void trace(std::vector<std::int32_t> &objects) const {
    for (const std::uint16_t object : experiment_->trace.objects) objects.push_back(read(object));
  }

  // Discards all messages that the firmware has queued for its buses.
  void discard_output();

  // Returns the trace hash of 64 hexadecimal digits. No tick may follow this call.
  std::string hash() { return hash_.hex(); }

  // Returns the result of the last cycle, or nothing if the experiment has no program.
  std::optional<CycleResult> cycle() const;

  std::int64_t next_tick() const { return next_tick_; }
  // Returns the raw value of an object (AXIS_OBJ_). For an unsigned object, the result has the same
  // 32 bits.
  std::int32_t read(std::uint16_t object) const;
  const std::vector<Refusal> &refused() const { return writes_.refused(); }
  fw_t *axis() { return axis_.get(); }

 private:
  struct Deleter {
    void operator()(fw_t *axis) const { axis_host_destroy(axis); }
  };

  ExperimentWrites::Write writer();
  void check_loaded() const;
  // Call this function after a tick that has begun a save. In a tick, only LSS begins one, of the
  // node id and the bit rate; without a stored set, all other parameters are saved as defaults,
  // which would replace [firmware] at the next power-up. So the first set that an axis saves has
  // the present values. `before`: store_state before the tick; restored defaults stay restored.
  void complete_first_save(std::uint8_t before);
  void write_due(std::int64_t tick) { writes_.write_due(tick, writer()); }
  LinkOutputs run_tick(const axis_inputs_t &inputs, std::int64_t tick, std::uint8_t axis) {
    axis_outputs_t outputs{};
    const std::uint8_t before = axis_->device_signals.store_state;
    fw_tick(axis_.get(), &inputs, &outputs);
    if (before != AXIS_STORE_STATE_SAVING &&
        axis_->device_signals.store_state == AXIS_STORE_STATE_SAVING)
      complete_first_save(before);
    const auto out =
        static_cast<std::uint8_t>((outputs.amp_enable ? 1 : 0) | (outputs.brake_release ? 2 : 0));
    return {tick,
            axis_host_dac_code(&outputs, experiment_->model->dac->bits),
            out,
            signals_->fault,
            signals_->limit_reason,
            axis};
  }

  FirmwareOptions options_;
  const Experiment *experiment_;
  const axis_signals_t *signals_;
  std::unique_ptr<fw_t, Deleter> axis_;
  ExperimentWrites writes_;
  axis_inputs_t last_{};  // inputs of the last tick
  std::int64_t next_tick_ = 0;
  TraceHash hash_;
};

}  // namespace forceaxis::host
