#pragma once
// The result of a run in one process or over a link: trace, metrics, energy balance and verdict.
#include <cstdint>
#include <functional>
#include <optional>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

#include "host/run/experiment.hpp"
#include "host/run/experiment_writes.hpp"
#include "host/run/held_force.hpp"
#include "host/run/records.hpp"
#include "host/run/verdict.hpp"
#include "sim/hybrid/plant.hpp"

namespace forceaxis::host {

// State of the firmware after a tick, as values AXIS_FAULT_ and AXIS_LIMIT_REASON_.
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
  // Peak-to-peak ripple of the signal in the complete time window of the verdict.
  double count = 0;
  // Peak-to-peak ripple of the signal in the second half of the time window.
  double late_count = 0;
};

// Metrics over the time window of the criterion, or over the last second if the experiment has no
// criterion.
struct Metrics {
  static constexpr const char *kName = "Metrics";
  static constexpr const char *kMeaning =
      "The quantities of a run from which the verdict is evaluated.";
  std::int64_t window_ticks = 0;
  double window_start_s = 0;
  Ripple force_ripple;
  Ripple position_ripple;
  std::optional<double> position_error_count;
  std::int64_t contacts = 0;
  std::int64_t contact_losses = 0;
  std::int64_t contact_losses_run = 0;
  std::optional<double> first_contact_s;
  bool contact_at_window = false;
  bool in_contact = false;
  double peak_force_N = 0;
  double final_force_N = 0;
  std::int64_t saturated_ticks = 0;
  std::int64_t saturated_run_ticks = 0;
  std::int64_t reading_range_ticks = 0;
  std::optional<double> setpoint_beyond_N;
  double reading_end_N = 0;
  std::int64_t last_adc_change_tick = 0;
  std::optional<HeldForce> held_force;

  static constexpr auto items() {
    using M = Metrics;
    return std::tuple{
        item("window_ticks", &M::window_ticks),
        item("window_start_s", &M::window_start_s),
        item("force_ripple_count", Within{&M::force_ripple, &Ripple::count},
             "force ripple in the window of the verdict, in 8-bit counts"),
        item("force_ripple_late_count", Within{&M::force_ripple, &Ripple::late_count},
             "force ripple in the second half of the window, in 8-bit counts"),
        item("position_ripple_count", Within{&M::position_ripple, &Ripple::count},
             "position ripple in the window of the verdict, in encoder counts"),
        item("position_ripple_late_count", Within{&M::position_ripple, &Ripple::late_count},
             "position ripple in the second half of the window, in encoder counts"),
        item("position_error_count", &M::position_error_count,
             "mean position in the window minus the last position set-point in counts; None "
             "without one"),
        item("contacts", &M::contacts,
             "number of contacts that the criterion names, or of all contacts of the model"),
        item("contact_losses", &M::contact_losses, "number of contact losses in the window"),
        item("contact_losses_run", &M::contact_losses_run,
             "number of contact losses in the whole run"),
        item("first_contact_s", &M::first_contact_s,
             "first time at which each of `contacts` was closed at least once; None if one never "
             "closed"),
        item("contact_at_window", &M::contact_at_window,
             "True if all contacts that `contacts` counts are closed at the start of the window"),
        item("in_contact", &M::in_contact,
             "True if all contacts that `contacts` counts are closed at the end of the run"),
        item("peak_force_N", &M::peak_force_N, "largest contact force in the whole run"),
        item("final_force_N", &M::final_force_N,
             "force of the first contact of the model at the last tick"),
        item("saturated_ticks", &M::saturated_ticks,
             "number of ticks of the window in which the DAC code is at an end of the DAC range"),
        item("saturated_run_ticks", &M::saturated_run_ticks,
             "number of ticks of the whole run in which the DAC code is at an end of the DAC "
             "range"),
        item("reading_range_ticks", &M::reading_range_ticks,
             "number of ticks of the window with the force at an end of the measurable range, "
             "except force 0"),
        item("setpoint_beyond_N", &M::setpoint_beyond_N,
             "last force set-point if it is outside the range of the measured force; otherwise "
             "None"),
        item("reading_end_N", &M::reading_end_N,
             "end of the measured range that the set-point exceeds or the force last reached; "
             "otherwise 0"),
        item("last_adc_change_tick", &M::last_adc_change_tick,
             "last tick in which the code of ADC 0 changed; 0 if it never changed"),
        item("held_force", &M::held_force,
             "the controlled force; None if the experiment controls no force")};
  }
};

// Value of one evaluation element in a press cycle, and the verdict on this value.
struct CycleFigure {
  static constexpr const char *kName = "CycleFigure";
  static constexpr const char *kMeaning =
      "The figure of an evaluation element over the last cycle of a run.";
  std::string name;
  std::string kind;
  double value = 0;
  std::string unit;
  std::uint32_t tick = 0;
  std::string verdict;

  static constexpr auto items() {
    return std::tuple{
        item("name", &CycleFigure::name),
        item("kind", &CycleFigure::kind, "kind of evaluation element: peak, window, ..."),
        item("value", &CycleFigure::value,
             "value of the evaluation element in `unit`; 0 if the element found no value"),
        item("unit", &CycleFigure::unit, "empty for a number"),
        item("tick", &CycleFigure::tick, "tick of the sample that gave the value"),
        item("verdict", &CycleFigure::verdict,
             "verdict: good, below, above, wrong side, again, not reached or aborted")};
  }
};

// Result of the last press cycle of a run.
struct CycleResult {
  static constexpr const char *kName = "CycleReport";
  static constexpr const char *kMeaning = "The last cycle of a run.";
  std::string title;
  std::string state;
  std::string outcome;
  std::string failed_phase;
  std::int64_t cycles = 0;
  std::int64_t invalid_ticks = 0;
  std::vector<std::string> phases;
  std::vector<CycleFigure> figures;

  static constexpr auto items() {
    using C = CycleResult;
    return std::tuple{
        item("title", &C::title, "title of the program"),
        item("state", &C::state, "value of the object cycle_state"),
        item("outcome", &C::outcome, "value of the object cycle_outcome"),
        item("failed_phase", &C::failed_phase,
             "name of the phase in which the cycle failed; empty if it ended as its program "
             "intends"),
        item("cycles", &C::cycles, "number of cycles that were started"),
        item("invalid_ticks", &C::invalid_ticks,
             "number of ticks in evaluated phases whose sample is not valid; 0 before the end of a "
             "cycle"),
        item("phases", &C::phases, "names by number"),
        item("figures", &C::figures,
             "values of the evaluation elements in their order; empty before the end of a cycle")};
  }
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
  std::vector<Missed> missed;        // limits of the verdict that the run exceeds, found by
                                     // evaluate()
  std::optional<CycleResult> cycle;  // result of the last press cycle; empty if the experiment has
                                     // no cycle program
};

}  // namespace forceaxis::host
