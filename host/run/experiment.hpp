#pragma once
// An experiment: the plant, the objects of the firmware, timed actions and the criterion of the
// verdict. Experiments are read from TOML files. Every error is an InputError that names the file,
// the key and the expected value.
//
// The rows of the structs declare the keys of the file. docs/guide/reference/experiment.md is
// generated from these rows. object_values.hpp describes the objects of the firmware. An override
// is a text such as "firmware.force_gain=7", "experiment.duration_s=2", "verdict.window_s=2" or
// "m_r=140", at most one for each name, and takes precedence over the file.
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <variant>
#include <vector>

#include "host/run/cycle_file.hpp"
#include "host/run/experiment_format.hpp"
#include "host/run/item.hpp"
#include "host/run/object_values.hpp"
#include "sim/hybrid/drive_bus.hpp"
#include "sim/hybrid/mode.hpp"
#include "sim/model/field.hpp"
#include "sim/model/model.hpp"
#include "sim/model/toml_forward.hpp"

namespace forceaxis::host {

inline constexpr double kLongestRun_s = 600;

// What the values of an experiment file may name: the points of the model, and all that the file
// has given before (experiment.cpp).
struct ExperimentNames;

struct Impulse {
  static constexpr std::string_view kMeaning = "An impulse on a body.";
  std::string body;
  double impulse_N_s = 0.0;

  static constexpr auto rows() {
    using sim::Dimension, sim::Sign, sim::field;
    using namespace sim::format;
    return std::tuple{
        field(&Impulse::body, other("body", "body", "", "A body of the model.")),
        field(&Impulse::impulse_N_s, needed("N_s", Dimension::impulse, Sign::any,
                                            "The impulse, positive towards the workpiece."))};
  }
};

// The code of ADC 0 that the firmware reads. `live`: the converted signal of the plant, without a
// failure. `held`: the code of the previous tick. `high` and `low`: the highest and the lowest
// code. `zero`: the code for the force 0, as with a disconnected sensor. `silent`: the last code
// with an increasing age, as from a converter that no longer sends.
enum class ForceSensor : std::uint8_t { live, held, high, low, zero, silent };

struct SensorFailure {
  static constexpr std::string_view kMeaning = "A failure of a sensor, or its end.";
  ForceSensor force = ForceSensor::live;

  static constexpr auto rows() {
    using namespace sim::format;
    return std::tuple{field(
        &SensorFailure::force,
        choice("force", "live, held, high, low, zero, silent", "", "choose one of these texts",
               "What ADC 0 converts from this instant on: the signal of the plant (live), the code "
               "of the previous tick (held), an end of its range (high, low), or the code of no "
               "force in the model (zero). With silent no new code arrives: the last one becomes "
               "older."))};
  }
  void complete(const sim::Section &section, const ExperimentNames &names) const;
};

struct DriveState {
  static constexpr std::string_view kMeaning =
      "A failure of a drive that has `enable_ticks` in the model, or its end.";
  sim::DriveFailure failure = sim::DriveFailure::none;

  static constexpr auto rows() {
    using namespace sim::format;
    return std::tuple{field(
        &DriveState::failure,
        choice(
            "failure", "none, off, fault, silent", "", "choose one of these texts",
            "The drive has switched itself off (off), also with a fault (fault), or its frames do "
            "not arrive any more while it still receives frames (silent). With none it works "
            "again, and is on `enable_ticks` later if it is enabled."))};
  }
  void complete(const sim::Section &section, const ExperimentNames &names) const;
};

// The actions in one table [[at]] of an experiment.
struct Action {
  static constexpr std::string_view kMeaning =
      "Actions at one instant. At least one of the tables must be given.";
  double time_s = 0.0;
  std::int64_t tick = 0;  // number of the tick before which the actions are applied
  std::optional<Impulse> impulse;
  std::vector<ObjectWrite> writes;
  std::optional<SensorFailure> sensor;
  std::optional<DriveState> drive;

  static constexpr auto rows() {
    using sim::field;
    using namespace sim::format;
    return std::tuple{
        field(&Action::time_s,
              ranged("time_s", sim::Dimension::time, 0.0, kLongestRun_s, "",
                     "Time of the action, at most duration_s, rounded up to a tick. The action "
                     "applies before that tick.")),
        field(&Action::impulse, table("impulse", sim::kFormat<Impulse>)),
        field(&Action::writes, table("firmware", kFirmwareAtFormat)),
        field(&Action::sensor, table("sensor", sim::kFormat<SensorFailure>)),
        field(&Action::drive, table("drive", sim::kFormat<DriveState>))};
  }
  void complete(sim::Section &section, const ExperimentNames &names);
};

// The contacts that must stay closed, from the key contact_held.
struct HeldContacts {
  // names of the contacts; an empty list: all contacts of the model
  std::vector<std::string> names;
};

// The limits of the verdict (verdict.hpp). A limit applies to the time window of the verdict, which
// is the last `window_s` of the run, unless a comment states otherwise. A limit without a value is
// not checked.
struct Criterion {
  static constexpr const char *kName = "Criterion";
  static constexpr const char *kMeaning =
      "The limits of the table [verdict]. None means that the experiment does not have the limit.";
  double window_s = 1.0;
  std::optional<double> force_ripple_max_count;
  std::optional<double> position_ripple_max_count;
  std::optional<double> position_error_max_count;
  // Contacts that must stay closed throughout the window.
  std::optional<HeldContacts> contact_held;
  // Limits for an experiment that controls force. HeldForce explains the quantities. Errors are
  // magnitudes.
  std::optional<double> held_force_error_max_N;
  std::optional<double> held_force_error_max_percent;
  std::optional<double> overshoot_max_percent;
  std::optional<double> settle_max_s;
  std::optional<double> peak_force_max_percent;
  // Limits that apply to the complete run. Metrics explains the quantities.
  std::optional<double> peak_force_max_N;
  std::optional<double> contact_losses_max;
  std::optional<double> saturated_max_s;

  struct Held {
    using Value = std::variant<bool, std::vector<std::string>>;
    Value operator()(const Criterion &c) const {
      if (!c.contact_held || c.contact_held->names.empty()) return c.contact_held.has_value();
      return c.contact_held->names;
    }
    void set(Criterion &c, const Value &value) const {
      if (const auto *names = std::get_if<std::vector<std::string>>(&value))
        c.contact_held = HeldContacts{*names};
      else
        c.contact_held = std::get<bool>(value) ? std::optional(HeldContacts{}) : std::nullopt;
    }
  };
  static constexpr auto limits() {
    using sim::field;
    using sim::format::ranged;
    using D = sim::Dimension;
    constexpr double kTick_s = 1.0 / sim::kTickRateHz;
    return std::tuple{
        field(
            &Criterion::window_s,
            ranged(
                "window_s", D::time, kTick_s, kLongestRun_s,
                "1 s, or duration_s if that is shorter",
                "Length of the window at the end of the run over which the verdict is evaluated.")),
        field(&Criterion::force_ripple_max_count,
              ranged("force_ripple_max_count", D::count, 0.0, 1e9, "not checked",
                     "Largest peak-to-peak ripple of the measured force, in counts at 8 bits.")),
        field(&Criterion::position_ripple_max_count,
              ranged("position_ripple_max_count", D::count, 0.0, 1e12, "not checked",
                     "Largest peak-to-peak ripple of the encoder, in counts.")),
        field(&Criterion::position_error_max_count,
              ranged("position_error_max_count", D::count, 0.0, 1e12, "not checked",
                     "Largest distance of the mean position in the window from the last set-point, "
                     "in counts.")),
        field(&Criterion::held_force_error_max_N,
              ranged("held_force_error_max_N", D::force, 0.0, 1e9, "not checked",
                     "Largest difference between the mean force in the window and the set-point.")),
        field(&Criterion::held_force_error_max_percent,
              ranged("held_force_error_max_percent", D::ratio, 0.0, 1e9, "not checked",
                     "Largest error of the mean force in the window, in percent of the force "
                     "set-point.")),
        field(&Criterion::overshoot_max_percent,
              ranged("overshoot_max_percent", D::ratio, 0.0, 1e9, "not checked",
                     "Largest excess of the force over the last set-point, in percent of the "
                     "set-point.")),
        field(&Criterion::settle_max_s,
              ranged("settle_max_s", D::time, 0.0, kLongestRun_s, "not checked",
                     "Longest time until the force stays within 5 % of its mean in the window.")),
        field(&Criterion::peak_force_max_N,
              ranged("peak_force_max_N", D::force, 0.0, 1e9, "not checked",
                     "Largest force of any contact over the complete run.")),
        field(&Criterion::peak_force_max_percent,
              ranged("peak_force_max_percent", D::ratio, 0.0, 1e9, "not checked",
                     "Largest force of any contact over the complete run, in percent of the last "
                     "set-point.")),
        field(&Criterion::contact_losses_max,
              ranged("contact_losses_max", D::count, 0.0, 1e9, "not checked",
                     "Largest number of losses of the contacts of contact_held, or of all "
                     "contacts, in the run.")),
        field(&Criterion::saturated_max_s,
              ranged("saturated_max_s", D::time, 0.0, kLongestRun_s, "not checked",
                     "Longest total time of the DAC code at an end of its range, over the complete "
                     "run."))};
  }
  static constexpr auto rows() {
    return sim::rows_of(
        limits(),
        sim::field(&Criterion::contact_held,
                   sim::format::other("contact_held", "flag, contact or list of contacts", "false",
                                      "Contacts that must stay closed; true: every contact of the "
                                      "model.")));
  }
  void complete(const sim::Section &section, const ExperimentNames &names);
  static constexpr auto items() {
    return std::tuple_cat(
        items_of(limits()),
        std::tuple{item("contact_held", Held{},
                        "True if all contacts must remain closed, or a list of contacts that must "
                        "remain closed")});
  }

  bool limits_force() const {
    return held_force_error_max_N || held_force_error_max_percent || overshoot_max_percent ||
           settle_max_s || peak_force_max_percent;
  }
  bool limits_position() const { return position_ripple_max_count || position_error_max_count; }
  bool limits_any() const {
    return contact_held || force_ripple_max_count || limits_position() || limits_force() ||
           limits_run();
  }
  bool limits_run() const { return peak_force_max_N || contact_losses_max || saturated_max_s; }
};

inline constexpr sim::TableFormat kVerdictFormat{
    "Limits for the verdict of the run; at least one must be given. `stable`: no limit "
    "is missed. `unstable`: a fault is latched, a ripple is above its limit and does not "
    "decay (it has more than 60 % of its value in the second half of the window), or "
    "contact is lost in the window. `not_met`: another limit is missed, or the contact "
    "is made after the start of the window. `never_in_contact`: the limits need a "
    "contact, and it was never made. With any limits, a run is not stable if the DAC "
    "code, or the measured force that a limit uses, is at an end of its range in the "
    "window; if the force set-point is outside the measuring range; or if force is "
    "controlled and contact is lost in the window. Without this table the run has no "
    "verdict.",
    sim::kKeysOf<Criterion>};

// The columns and the time range of the plot of a run.
struct Plot {
  static constexpr const char *kName = "PlotTable";
  static constexpr const char *kMeaning = "Content of the figure of a run.";
  // Names of the columns of the trace in each diagram.
  std::vector<std::vector<std::string>> diagrams = {{"encoder"}, {"adc0"}, {"dac"}};
  std::optional<double> from_s;
  std::optional<double> to_s;

  static constexpr auto rows() {
    using sim::field;
    using namespace sim::format;
    using D = sim::Dimension;
    return std::tuple{
        field(&Plot::diagrams,
              other("rows", "list of lists of columns", "encoder, adc0 and dac",
                    "Columns of the trace. One diagram shows the columns of one row.")),
        field(&Plot::from_s,
              ranged("from_s", D::time, 0.0, 1e6, "the start", "Start of the time axis.")),
        field(&Plot::to_s, ranged("to_s", D::time, 0.0, 1e6, "the end",
                                  "End of the time axis, later than from_s."))};
  }
  static constexpr auto items() { return items_of(rows()); }
  void complete(const sim::Section &section, const ExperimentNames &names) const;
};

// Objects (AXIS_OBJ_) whose values become columns of the trace.
struct Trace {
  static constexpr std::string_view kMeaning =
      "Further columns of the trace. They exist only if firmware and plant run in one process.";
  std::vector<std::uint16_t> objects;

  static constexpr auto rows() {
    return std::tuple{sim::field(
        &Trace::objects,
        sim::format::other("objects", "list of objects", "",
                           "Objects of the firmware whose values after each tick become columns "
                           "of the trace."))};
  }
};

struct Experiment {
  static constexpr std::string_view kMeaning =
      "An experiment: a plant, values for objects of the firmware, timed actions, and expected "
      "results.";
  std::filesystem::path file;
  // SHA-256 over the experiment file, its model files and the overrides. Empty in an experiment
  // from with().
  std::string hash;
  std::string title;
  std::string figure;
  std::string shows;
  std::string model_file;  // path of the model as the experiment file gives it, relative to the
                           // folder of that file
  std::string cycle_file;  // path of the cycle program as the experiment file gives it; empty
                           // without a program
  std::vector<sim::Override> set;
  std::shared_ptr<const sim::Model> model;
  std::shared_ptr<sim::ModeCache> modes;  // cache of the matrices of modes, which all plants of the
                                          // model share
  int seed = 0;
  double duration_s = 0.0;
  // Number of ticks that the plant simulates. The firmware computes ticks + 1 ticks.
  std::int64_t ticks = 0;
  std::vector<ObjectWrite> initial;
  // Objects whose values in `initial` come from an override of [firmware].
  std::vector<std::uint16_t> overridden;
  // Actions of the experiment, sorted by tick.
  std::vector<Action> actions;
  // Program of the press cycle that mode -9 runs; NULL if the experiment has no program.
  std::shared_ptr<const CycleProgram> cycle;
  std::optional<Criterion> criterion;
  Plot plot;
  Trace trace;
  // Table [expect] of the file, or nullptr if the file has no such table.
  std::shared_ptr<const toml::table> expect;
  // Names of the parameters in the table [set] that neither the model nor the experiment uses.
  std::vector<std::string> unused;

  // The keys whose values do not depend on the model.
  static constexpr auto head() {
    using sim::Sign, sim::field;
    using namespace sim::format;
    using E = Experiment;
    return std::tuple{
        field(&E::title, other("title", "text", "", "Title of the experiment.")),
        field(&E::figure, other("figure", "text", "empty",
                                "Number of the figure of the thesis that the experiment repeats.")),
        field(&E::shows, other("shows", "text", "empty", "What the experiment demonstrates.")),
        field(&E::model_file,
              other("model", "file name", "", "File of the model, relative to this file.")),
        field(&E::duration_s, needed("duration_s", sim::Dimension::time, Sign::positive,
                                     "Duration, at most 600 s, rounded up to a tick of 1/1500 s.")),
        field(&E::seed,
              integer("seed", 0, 0x7FFFFFFF, 0.0, "Seed of the measurement noise of the model.")),
        field(&E::cycle_file,
              other("cycle", "file name", "none",
                    "File of the program that the mode of operation `cycle` runs, relative to "
                    "this file.")),
        field(&E::set, table("set", kSetFormat))};
  }
  // The tables whose values may name parameters or signals of the model. A table may also name what
  // a table before it defines.
  static constexpr auto tables() {
    using sim::field, sim::kFormat;
    using namespace sim::format;
    using E = Experiment;
    return std::tuple{field(&E::initial, table("firmware", kFirmwareFormat)),
                      field(&E::actions, table("at", kFormat<Action>, true)),
                      field(&E::criterion, table("verdict", kVerdictFormat)),
                      field(&E::trace, table("trace", kFormat<Trace>)),
                      field(&E::plot, table("plot", kFormat<Plot>)),
                      field(&E::expect, table("expect", kExpectFormat))};
  }
  static constexpr auto rows() { return sim::rows_of(head(), tables()); }
};

// An experiment file that is read once for many variants. The models and modes of the last
// kKeptModels sets of model parameters are kept, and the variants share them. So a variant that
// changes only objects of the firmware needs little more time than its run. Any number of threads
// may call with().
class ExperimentFile {
 public:
  // Largest number of models that are kept, each of about 1 MB.
  static constexpr std::size_t kKeptModels = 64;

  // Reads the file. If `text` is given, this text is read in place of the file, and the file need
  // not exist. Messages name the file, and the path of the model is relative to the folder of the
  // file. Throws sim::InputError.
  explicit ExperimentFile(const std::filesystem::path &file,
                          const std::optional<std::string> &text = std::nullopt);
  ~ExperimentFile();

  // Returns the experiment with these overrides. The member `hash` is empty. Throws
  // sim::InputError.
  Experiment with(std::span<const std::string> overrides);

 private:
  struct Variant;
  struct Contents;
  std::shared_ptr<Variant> variant(const std::string &key);

  std::unique_ptr<Contents> contents_;
};

// Reads an experiment from a file, or from `text` in place of the file, and sets the member `hash`.
// Throws sim::InputError.
Experiment load_experiment(const std::filesystem::path &file,
                           std::span<const std::string> overrides = {},
                           const std::optional<std::string> &text = std::nullopt);

// Reads an experiment like load_experiment(), and refuses one that names no program of a cycle.
Experiment load_cycle_experiment(const std::filesystem::path &file,
                                 std::span<const std::string> overrides);

// Returns the names of the columns of a trace: codes and states, followed by the signals of the
// model. Columns for objects in the table [trace] are not included.
std::vector<std::string> trace_columns(const sim::Model &model);

// Removes duration and verdict, but not the actions, from an experiment. Its run then lasts until
// the user ends the run. The tick number in the trace hash has 32 bits and wraps after 33 days; no
// other number wraps.
inline constexpr std::int64_t kEndlessTicks = 1'000'000'000'000'000;
void make_endless(Experiment &experiment);

// Refuses a [verdict] that limits the force if the experiment does not control force. This check is
// made before a run and not when the file is read, because make_endless() removes the verdict.
// Throws sim::InputError.
void expect_evaluable(const Experiment &experiment);

// Refuses parameters in the table [set] that have no effect. Throws sim::InputError.
void expect_used(const Experiment &experiment);

}  // namespace forceaxis::host
