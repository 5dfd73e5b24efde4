#pragma once
// An experiment: its plant, the firmware's objects, timed actions, and the criterion of stability.
// Read from TOML; every mistake is an InputError that names file, key and what was expected.
//
// Its tables and keys are declared in experiment_format.cpp; docs/guide/reference/experiment.md is
// written from there. Objects of the firmware: object_values.hpp. Overrides are texts, each name
// once, "firmware.force_gain=7", "experiment.duration_s=2", "verdict.window_s=2" or "m_r=140"; they
// take precedence over the file.
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "host/run/object_values.hpp"
#include "sim/hybrid/mode.hpp"
#include "sim/model/model.hpp"
#include "sim/model/toml_forward.hpp"

namespace forceaxis::host {

struct Impulse {
  std::string body;
  double impulse_N_s;
};

// What ADC 0 reads: the plant's signal ("live"), the code of the tick before ("held"), an end of
// its range ("high", "low"), or the model's code of no force ("zero"), as a disconnected sensor
// does.
enum class ForceSensor : std::uint8_t { live, held, high, low, zero };

// One [[at]].
struct Action {
  std::int64_t tick;  // applied before it
  std::vector<ObjectWrite> writes;
  std::vector<Impulse> impulses;
  std::optional<ForceSensor> force_sensor;
};

// What a run is judged by, see verdict.hpp: over its last `window_s` where nothing else is said. A
// limit that is absent is not checked.
struct Criterion {
  double window_s = 1.0;                            // > 0
  std::optional<double> force_ripple_max_count;     // peak to peak of the force ADC, 8-bit counts
  std::optional<double> position_ripple_max_count;  // peak to peak of the encoder, counts
  // Contacts stay pressed throughout the window: those named, "tip" or ["tip", "grip"], or, of
  // `contact_held = true`, every one of the model; then `contacts` is empty.
  bool contact_held = false;
  std::vector<std::string> contacts = {};
  // Of an experiment that controls force, see HeldForce; errors are magnitudes.
  std::optional<double> held_force_error_max_N;
  std::optional<double> held_force_error_max_percent;
  std::optional<double> overshoot_max_percent;
  std::optional<double> settle_max_s;
  std::optional<double> peak_force_max_percent;
  // Over the whole run, see Metrics.
  std::optional<double> peak_force_max_N;
  std::optional<double> contact_losses_max;
  std::optional<double> saturated_max_s;

  bool judges_force() const {
    return held_force_error_max_N || held_force_error_max_percent || overshoot_max_percent ||
           settle_max_s || peak_force_max_percent;
  }
  bool judges_run() const { return peak_force_max_N || contact_losses_max || saturated_max_s; }
};

// What the plot of a run shows.
struct Plot {
  std::vector<std::vector<std::string>> rows;  // columns of the trace; empty: not given
  std::optional<double> from_s;
  std::optional<double> to_s;  // > from_s
};

struct Experiment {
  std::filesystem::path file;
  std::string hash;  // SHA-256 over the experiment, its model files and the overrides; see with()
  std::string title;
  std::string figure;
  std::string shows;
  std::shared_ptr<const sim::Model> model;
  std::shared_ptr<sim::ModeCache> modes;  // of that model
  std::uint64_t seed = 0;
  std::int64_t ticks = 0;  // steps of the plant; the controller is evaluated ticks + 1 times
  std::vector<ObjectWrite> initial;
  std::vector<Action> actions;  // by tick
  std::optional<Criterion> criterion;
  Plot plot;
  std::vector<std::uint16_t> traced;          // objects of [trace]
  std::shared_ptr<const toml::table> expect;  // [expect], or nullptr
  std::vector<std::string> unused;            // parameters that [set] overrides and nothing uses
};

// An experiment file, read once for many variants. Model and modes of the last kKeptModels
// different sets of model parameters are kept and shared, so that a variant in the firmware's
// objects alone costs little more than its run. with() may be called from any number of threads.
class ExperimentFile {
 public:
  static constexpr std::size_t kKeptModels = 64;  // about 1 MB each

  // Throws sim::InputError. With a text that is read in place of the file's, which need not exist:
  // messages name it, and the model's path is relative to its folder.
  explicit ExperimentFile(const std::filesystem::path &file,
                          const std::optional<std::string> &text = std::nullopt);
  ~ExperimentFile();

  // The experiment under these overrides, without its hash. Throws sim::InputError.
  Experiment with(std::span<const std::string> overrides);

 private:
  struct Variant;
  struct Contents;
  std::shared_ptr<Variant> variant(const std::string &key);

  std::unique_ptr<Contents> contents_;
};

// One experiment of a file, or of a text in its place, with its hash. Throws sim::InputError.
Experiment load_experiment(const std::filesystem::path &file,
                           std::span<const std::string> overrides = {},
                           const std::optional<std::string> &text = std::nullopt);

// The columns of a run's trace: codes and states, then the signals of the model; those of [trace]
// come in addition.
std::vector<std::string> trace_columns(const sim::Model &model);

// Takes duration and verdict away: the run lasts until it is ended. Its actions stay. The tick in
// the trace hash has 32 bits and wraps after 33 days; nothing else does.
inline constexpr std::int64_t kEndlessTicks = 1'000'000'000'000'000;
void make_endless(Experiment &experiment);

// Refuses a [verdict] that limits the force of an experiment that controls none. Of a run, not of
// reading: an axis of make_endless() has no verdict, whatever its file says. Throws
// sim::InputError.
void expect_judged(const Experiment &experiment);

// Refuses parameters in [set] that change nothing. Throws sim::InputError.
void expect_used(const Experiment &experiment);

}  // namespace forceaxis::host
