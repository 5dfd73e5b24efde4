#pragma once
// The result of a run, in process or linked: trace, metrics, energy audit, verdict.
#include <cmath>
#include <cstdint>
#include <functional>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "host/run/experiment.hpp"
#include "host/run/experiment_writes.hpp"
#include "host/run/held_force.hpp"
#include "host/run/records.hpp"
#include "sim/hybrid/plant.hpp"

namespace forceaxis::host {

// The firmware's own state after each tick: AXIS_FAULT_ and AXIS_LIMIT_REASON_.
struct FirmwareRecord {
  std::uint8_t fault;
  std::uint8_t limit_reason;
};

struct RunOptions {
  bool trace = true;  // keep records and signals; false: only metrics, hash and verdict
  bool audit = true;  // energy audit
  // Hash the firmware's side too; over a link that is always done. In process the two hashes can
  // only agree.
  bool firmware_hash = false;
  // Called every 1024 ticks; true ends the run with RunStopped.
  std::function<bool()> stop = {};
};

struct RunStopped : std::runtime_error {
  RunStopped() : std::runtime_error("the run was stopped") {}
};

// Over the criterion's window, or the last second without a criterion.
struct Metrics {
  double force_ripple_count = 0;     // peak to peak of adc0, scaled to 8-bit counts
  double position_ripple_count = 0;  // peak to peak of the encoder, counts
  // Of the contacts that the criterion names, else of all.
  std::int64_t contact_losses = 0;        // contacts leaving "pressed", located events
  bool in_contact = false;                // every one pressed at the end of the run
  double peak_force_N = 0;                // over the whole run, of all contacts, at ticks
  double final_force_N = 0;               // at the last tick, of the first contact
  int saturated_ticks = 0;                // in the window, DAC at a rail
  std::int64_t last_adc_change_tick = 0;  // of adc0's code, over the whole run; 0: it never changed
  std::optional<HeldForce> held_force;    // where the experiment has a ForceTask
};

struct RunResult {
  std::vector<TickRecord> records;
  std::vector<FirmwareRecord> firmware;
  std::vector<std::string> signal_names;
  std::vector<double> signals;  // records x signal_names, by rows; units: sim::SignalInfo
  // Raw values of the objects of [trace] after each tick, by rows; empty over a link.
  std::vector<std::int32_t> objects;
  std::vector<sim::Event> events;  // the first 100,000
  std::int64_t event_count = 0;
  sim::EnergyAudit energy;
  double edge_margin = 0;     // LSB, see sim::Plant::edge_margin()
  std::string trace_hash;     // 64 hexadecimal digits, the plant's side
  std::string firmware_hash;  // the firmware's side, if RunOptions requests it
  Metrics metrics;
  std::string fault;  // name of the first fault of the run, "none"
  std::vector<Refusal> refused;
  std::string verdict;  // "stable", "unstable", or "" without a criterion
};

inline bool holds_force(const Criterion &criterion, const HeldForce &force) {
  const auto within = [](double value, const std::optional<double> &limit) {
    return value <= limit.value_or(value);
  };
  return within(std::fabs(force.error_N), criterion.held_force_error_max_N) &&
         within(force.error_percent, criterion.held_force_error_max_percent) &&
         within(force.overshoot_percent, criterion.overshoot_max_percent) &&
         within(force.settle_s, criterion.settle_max_s);
}

// "stable" or "unstable" from metrics alone, so that thresholds can be varied without a run.
inline std::string judge(const Criterion &criterion, const Metrics &metrics, bool faulted) {
  const bool held = !criterion.contact_held || (metrics.in_contact && metrics.contact_losses == 0);
  const bool calm = metrics.force_ripple_count <=
                        criterion.force_ripple_max_count.value_or(metrics.force_ripple_count) &&
                    metrics.position_ripple_count <=
                        criterion.position_ripple_max_count.value_or(metrics.position_ripple_count);
  const bool accurate = !criterion.judges_force() || (metrics.held_force.has_value() &&
                                                      holds_force(criterion, *metrics.held_force));
  return held && calm && accurate && !faulted ? "stable" : "unstable";
}

}  // namespace forceaxis::host
