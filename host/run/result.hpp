#pragma once
// The result of a run in one process or over a link: trace, metrics, energy audit and verdict.
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
#include "host/run/verdict.hpp"
#include "sim/hybrid/plant.hpp"

namespace forceaxis::host {

// State of the firmware after each tick: AXIS_FAULT_ and AXIS_LIMIT_REASON_.
struct FirmwareRecord {
  std::uint8_t fault;
  std::uint8_t limit_reason;
};

struct RunOptions {
  // Keeps records and signals of each tick. If false, the result has only metrics, hash and
  // verdict.
  bool trace = true;
  bool audit = true;  // computes the energy audit
  // Compute the trace hash on the firmware's side too. A run over a link always computes it. In one
  // process, the two hashes are always equal.
  bool firmware_hash = false;
  // Called every 1024 ticks. If it returns true, the run ends with RunStopped.
  std::function<bool()> stop = {};
};

struct RunStopped : std::runtime_error {
  RunStopped() : std::runtime_error("the run was stopped") {}
};

// Peak-to-peak ripple, in counts.
struct Ripple {
  double count = 0;       // ripple over the window
  double late_count = 0;  // ripple in the second half of the window, in counts
};

// Metrics over the window of the criterion, or over the last second if the experiment has no
// criterion.
struct Metrics {
  std::int64_t window_ticks = 0;
  double window_start_s = 0;
  Ripple force_ripple;     // ripple of adc0, converted to 8-bit counts
  Ripple position_ripple;  // of the encoder
  // Contacts that the criterion names, or all contacts of the model.
  std::int64_t contacts = 0;  // number of contacts of the criterion or of the model
  // Number of contact losses in the window.
  std::int64_t contact_losses = 0;
  std::int64_t contact_losses_run = 0;  // number of contact losses over the complete run
  // Time in s at which the last of the criterion's contacts closed for the first time; empty if one
  // never closed. See PlantSide.
  std::optional<double> first_contact_s;
  bool contact_at_window = false;  // All contacts are closed at the start of the window.
  bool in_contact = false;         // All contacts are closed at the end of the run.
  double peak_force_N = 0;         // largest force of any contact at a tick of the complete run
  double final_force_N = 0;        // force of the first contact at the last tick
  // Ticks at which the DAC is at an end of its range, in the window and over the complete run.
  std::int64_t saturated_ticks = 0;
  std::int64_t saturated_run_ticks = 0;
  // Ticks of the window in which the code of adc0 is at an end of its range and is not the zero
  // code.
  std::int64_t reading_range_ticks = 0;
  std::optional<double> setpoint_beyond_N;  // last force set-point, if it is outside the range of
                                            // adc0
  double reading_end_N = 0;                 // end of the range of adc0 that the set-point exceeds
  // Tick of the last change of the code of adc0 in the complete run; 0 if it never changed.
  std::int64_t last_adc_change_tick = 0;
  std::optional<HeldForce> held_force;  // controlled force, if the experiment has a ForceTask
};

struct RunResult {
  std::vector<TickRecord> records;
  std::vector<FirmwareRecord> firmware;
  std::vector<std::string> signal_names;
  // Values of all signals, with one row for each record and one column for each of signal_names, in
  // the units of sim::SignalInfo.
  std::vector<double> signals;
  // Raw values of the objects of [trace], one row for each tick. Empty over a link.
  std::vector<std::int32_t> objects;
  std::vector<sim::Event> events;  // the first 100,000 events of the run
  std::int64_t event_count = 0;
  sim::EnergyAudit energy;
  double edge_margin = 0;  // smallest distance in LSB of a converted value to a change of its code
  std::string trace_hash;  // trace hash of the plant's side, 64 hexadecimal digits
  // Trace hash of the firmware's side, if RunOptions requests it.
  std::string firmware_hash;
  Metrics metrics;
  std::string fault;  // name of the first fault of the run, or "none"
  std::vector<Refusal> refused;
  std::string verdict;         // verdict of evaluate(), or "" without a criterion
  std::vector<Missed> missed;  // limits that the run has missed, from evaluate()
};

}  // namespace forceaxis::host
