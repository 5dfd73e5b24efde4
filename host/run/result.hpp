#pragma once
// The result of a run in one process or over a link: trace, metrics, energy balance and verdict.
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

// State of the firmware after a tick, as AXIS_FAULT_ and AXIS_LIMIT_REASON_.
struct FirmwareRecord {
  std::uint8_t fault;
  std::uint8_t limit_reason;
};

struct RunOptions {
  // true: the result has the records and signals of each tick. false: the result has only metrics,
  // hash and verdict.
  bool trace = true;
  // true: the run computes the energy balance.
  bool audit = true;
  // true: the firmware's side also computes a trace hash. A run over a link always computes this
  // hash. In one process, the hashes of plant and firmware are always equal.
  bool firmware_hash = false;
  // Function that is called every 1024 ticks. If the function returns true, the run ends with
  // RunStopped.
  std::function<bool()> stop = {};
};

struct RunStopped : std::runtime_error {
  RunStopped() : std::runtime_error("the run was stopped") {}
};

// Peak-to-peak ripple of a quantity in counts.
struct Ripple {
  double count = 0;       // peak-to-peak ripple in the complete window
  double late_count = 0;  // peak-to-peak ripple in the second half of the window
};

// Metrics over the window of the criterion, or over the last second if the experiment has no
// criterion.
struct Metrics {
  std::int64_t window_ticks = 0;
  double window_start_s = 0;
  // Ripple of the code of ADC 0, in 8-bit counts.
  Ripple force_ripple;
  // Ripple of the encoder.
  Ripple position_ripple;
  // Number of contacts that the criterion names. If the criterion names no contact, number of all
  // contacts in the model.
  std::int64_t contacts = 0;
  // Number of contact losses in the window of the criterion.
  std::int64_t contact_losses = 0;
  // Number of contact losses in the complete run.
  std::int64_t contact_losses_run = 0;
  // Time in s at which each contact of the criterion had been closed at least once; empty if a
  // contact never closed. See PlantSide.
  std::optional<double> first_contact_s;
  // true: all contacts of the criterion are closed at the start of the window.
  bool contact_at_window = false;
  // true: all contacts of the criterion are closed at the end of the run.
  bool in_contact = false;
  // Largest contact force at any tick of the complete run.
  double peak_force_N = 0;
  // Force of the first contact of the model at the last tick.
  double final_force_N = 0;
  // Number of ticks at which the DAC code is at an end of its range, in the window and in the
  // complete run.
  std::int64_t saturated_ticks = 0;
  std::int64_t saturated_run_ticks = 0;
  // Number of ticks in the window at which the code of ADC 0 is at an end of its range, or at the
  // limit of the sensor or its electronics, and is not the code of the force 0.
  std::int64_t reading_range_ticks = 0;
  // Last force set-point in N, if ADC 0 cannot measure this force; otherwise empty.
  std::optional<double> setpoint_beyond_N;
  // Largest or smallest force in N that ADC 0 can measure: the one that the set-point exceeds, or
  // the one at which the force reading was last in the window; otherwise 0.
  double reading_end_N = 0;
  // Tick of the last change of the code of ADC 0 in the complete run; 0 if this code never changed.
  std::int64_t last_adc_change_tick = 0;
  // Measured values of the controlled force; empty without a ForceTask.
  std::optional<HeldForce> held_force;
};

// Value of one evaluation element in a cycle, and the verdict on it.
struct CycleFigure {
  double value = 0;  // in the unit of CycleElement
  std::uint32_t tick = 0;
  std::string verdict;  // "good", "below", "above", "wrong side", "again", "not reached", "aborted"
};

// Result of the last cycle of a run.
struct CycleResult {
  std::string state;         // cycle_state of the firmware
  std::string outcome;       // cycle_outcome
  std::string failed_phase;  // phase in which the cycle failed; "" if it ended by its program
  std::vector<CycleFigure> figures;  // one for each evaluation element; empty before the end of a
                                     // cycle
  std::int64_t cycles = 0;           // number of cycles that were started
  // number of ticks in evaluated phases whose sample is not valid; 0 before the end of a cycle
  std::int64_t invalid_ticks = 0;
};

struct RunResult {
  std::vector<TickRecord> records;
  std::vector<FirmwareRecord> firmware;
  std::vector<std::string> signal_names;
  // Values of all signals in the units of sim::SignalInfo, with one row for each tick and one
  // column for each name in signal_names.
  std::vector<double> signals;
  // Raw values of the objects in the table [trace], one row for each tick. Empty in a run with
  // axis_node.
  std::vector<std::int32_t> objects;
  std::vector<sim::Event> events;  // first events of the run, at most 100,000
  std::int64_t event_count = 0;
  sim::EnergyAudit energy;
  // Smallest distance in LSB between a converted value and a value at which the code changes.
  double edge_margin = 0;
  // Trace hash of the plant's side, 64 hexadecimal digits.
  std::string trace_hash;
  // Trace hash of the firmware's side; empty unless RunOptions requests this hash.
  std::string firmware_hash;
  Metrics metrics;
  std::string fault;  // name of the first fault in the run, or "none"
  std::vector<Refusal> refused;
  std::string verdict;               // verdict of evaluate(); "" if the experiment has no criterion
  std::vector<Missed> missed;        // limits that the run has missed, by evaluate()
  std::optional<CycleResult> cycle;  // empty without a program
};

}  // namespace forceaxis::host
