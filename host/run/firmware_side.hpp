#pragma once
// The firmware's side of a run: one axis, the writes of its experiment at their ticks, and its own
// trace hash. It depends on the plant through the records alone. What runs every tick is inline, so
// that in process the records need not pass through memory.
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "firmware/port/host/axis_host.h"
#include "host/run/experiment_writes.hpp"
#include "host/run/records.hpp"
#include "host/run/trace_hash.hpp"

namespace forceaxis::host {

struct FirmwareOptions {
  bool hash = false;                    // compute the hash for hash()
  const fw_config_t *config = nullptr;  // NULL: an axis on no bus
  // Called with every write of the experiment before the firmware receives it; initial writes have
  // tick 0.
  std::function<void(std::int64_t, const ObjectWrite &)> writing = {};
};

class FirmwareSide {
 public:
  // Powers up and makes the initial writes, as ExperimentWrites::write_initial(). Throws
  // sim::InputError if the firmware refuses one. The experiment must outlive the side.
  FirmwareSide(const Experiment &experiment, const FirmwareOptions &options);

  // The coming tick: the writes due, then the firmware's own tick.
  LinkOutputs tick(const LinkInputs &in) {
    if (writes_.due(in.tick)) write_due(in.tick);
    axis_inputs_t inputs{};
    inputs.encoder_cnt = in.encoder_cnt;
    inputs.adc_code[0] = in.adc0_code;
    inputs.adc_code[1] = in.adc1_code;
    inputs.din = in.din;
    inputs.sensor_valid = in.sensor_valid;
    const LinkOutputs out = run_tick(inputs, in.tick, in.axis);
    if (options_.hash) hash_.add(tick_record(in, out));
    last_ = inputs;
    next_tick_ = in.tick + 1;
    return out;
  }

  // The tick after the plant fell silent: sensor_valid 0, the last values otherwise. It is no part
  // of the trace. The firmware answers code 0, disabled, fault sensor_invalid.
  LinkOutputs lose_sensors(std::uint8_t axis) {
    axis_inputs_t inputs = last_;
    inputs.sensor_valid = 0;
    return run_tick(inputs, next_tick_, axis);
  }

  // Appends the raw values of the experiment's traced objects.
  void trace(std::vector<std::int32_t> &objects) const {
    for (const std::uint16_t object : experiment_->traced) objects.push_back(read(object));
  }

  // Fetches and drops what the firmware transmits on its buses.
  void discard_output();

  // The trace hash, 64 hexadecimal digits; ends it.
  std::string hash() { return hash_.hex(); }

  std::int64_t next_tick() const { return next_tick_; }
  // The raw value of an object (AXIS_OBJ_); an unsigned object's bits.
  std::int32_t read(std::uint16_t object) const;
  const std::vector<Refusal> &refused() const { return writes_.refused(); }
  fw_t *axis() { return axis_.get(); }

 private:
  struct Deleter {
    void operator()(fw_t *axis) const { axis_host_destroy(axis); }
  };

  ExperimentWrites::Write writer();
  void write_due(std::int64_t tick) { writes_.write_due(tick, writer()); }
  LinkOutputs run_tick(const axis_inputs_t &inputs, std::int64_t tick, std::uint8_t axis) {
    axis_outputs_t outputs{};
    fw_tick(axis_.get(), &inputs, &outputs);
    const auto out =
        static_cast<std::uint8_t>((outputs.amp_enable ? 1 : 0) | (outputs.brake_release ? 2 : 0));
    return {tick, outputs.dac_code, out, signals_->fault, signals_->limit_reason, axis};
  }

  FirmwareOptions options_;
  const Experiment *experiment_;
  const axis_signals_t *signals_;
  std::unique_ptr<fw_t, Deleter> axis_;
  ExperimentWrites writes_;
  axis_inputs_t last_{};  // of the last tick
  std::int64_t next_tick_ = 0;
  TraceHash hash_;
};

}  // namespace forceaxis::host
