#pragma once
// The result of a run, in process or linked: trace, metrics, energy audit, verdict.
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

// Peak to peak, in counts.
struct Ripple {
  double count = 0;       // over the window
  double late_count = 0;  // over its second half
};

// Over the criterion's window, or the last second without a criterion.
struct Metrics {
  std::int64_t window_ticks = 0;
  double window_start_s = 0;
  Ripple force_ripple;     // of adc0, scaled to 8-bit counts
  Ripple position_ripple;  // of the encoder
  // Of the contacts that the criterion names, else of all.
  std::int64_t contacts = 0;              // how many
  std::int64_t contact_losses = 0;        // contacts leaving "pressed", located events
  std::int64_t contact_losses_run = 0;    // the same over the whole run
  std::optional<double> first_contact_s;  // of the last of them, see PlantSide; none: never
  bool contact_at_window = false;         // every one pressed when the window begins
  bool in_contact = false;                // every one pressed at the end of the run
  double peak_force_N = 0;                // over the whole run, of all contacts, at ticks
  double final_force_N = 0;               // at the last tick, of the first contact
  // The DAC at an end of its range, in the window and over the whole run.
  std::int64_t saturated_ticks = 0;
  std::int64_t saturated_run_ticks = 0;
  std::int64_t reading_range_ticks = 0;     // in the window, adc0 at an end but its zero code
  std::optional<double> setpoint_beyond_N;  // the last set-point of force, if adc0 cannot read it
  double reading_end_N = 0;                 // the end of the range that it is beyond
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
  std::string verdict;         // of judge(), or "" without a criterion
  std::vector<Missed> missed;  // of judge()
};

}  // namespace forceaxis::host
