// The Python interface for runs in one process. The inputs are experiments, the outputs are NumPy
// arrays.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <atomic>
#include <condition_variable>
#include <exception>
#include <map>
#include <mutex>
#include <thread>

#include "firmware/port/host/firmware.hpp"
#include "host/python/binding/energy.hpp"
#include "host/python/binding/parts.hpp"
#include "host/python/binding/result.hpp"
#include "host/python/binding/toml.hpp"
#include "host/run/experiment.hpp"
#include "host/run/journal.hpp"
#include "host/run/objects.hpp"
#include "host/run/run.hpp"

namespace py = pybind11;

using forceaxis::host::Criterion;
using forceaxis::host::Experiment;
using forceaxis::host::ExperimentFile;
using forceaxis::host::Metrics;
using forceaxis::host::RunResult;

namespace {

Criterion criterion_from(const py::dict &d) {
  Criterion c;
  c.window_s = d["window_s"].cast<double>();
  c.force_ripple_max_count = d["force_ripple_max_count"].cast<std::optional<double>>();
  c.position_ripple_max_count = d["position_ripple_max_count"].cast<std::optional<double>>();
  const auto limit = [&d](const char *key) {
    return d.contains(key) ? d[key].cast<std::optional<double>>() : std::nullopt;
  };
  c.held_force_error_max_N = limit("held_force_error_max_N");
  c.held_force_error_max_percent = limit("held_force_error_max_percent");
  c.overshoot_max_percent = limit("overshoot_max_percent");
  c.settle_max_s = limit("settle_max_s");
  c.peak_force_max_N = limit("peak_force_max_N");
  c.peak_force_max_percent = limit("peak_force_max_percent");
  c.contact_losses_max = limit("contact_losses_max");
  c.saturated_max_s = limit("saturated_max_s");
  // `contact_held` is true or a list of names.
  c.contact_held = static_cast<bool>(py::bool_(d["contact_held"]));
  return c;
}

Metrics metrics_from(const py::dict &d) {
  Metrics m;
  const auto number = [&d](const char *key) { return d[key].cast<double>(); };
  const auto whole = [&d](const char *key) { return d[key].cast<std::int64_t>(); };
  m.window_ticks = whole("window_ticks");
  m.window_start_s = number("window_start_s");
  m.force_ripple = {number("force_ripple_count"), number("force_ripple_late_count")};
  m.position_ripple = {number("position_ripple_count"), number("position_ripple_late_count")};
  m.contacts = whole("contacts");
  m.contact_losses = whole("contact_losses");
  m.contact_losses_run = whole("contact_losses_run");
  m.first_contact_s = d["first_contact_s"].cast<std::optional<double>>();
  m.contact_at_window = d["contact_at_window"].cast<bool>();
  m.in_contact = d["in_contact"].cast<bool>();
  m.peak_force_N = number("peak_force_N");
  m.saturated_ticks = whole("saturated_ticks");
  m.saturated_run_ticks = whole("saturated_run_ticks");
  m.reading_range_ticks = whole("reading_range_ticks");
  m.setpoint_beyond_N = d["setpoint_beyond_N"].cast<std::optional<double>>();
  m.reading_end_N = number("reading_end_N");
  if (!d.contains("held_force") || d["held_force"].is_none()) return m;
  const py::dict force = d["held_force"];
  forceaxis::host::HeldForce &held = m.held_force.emplace();
  held.setpoint_N = force["setpoint_N"].cast<double>();
  held.held_N = force["held_N"].cast<double>();
  held.error_N = force["error_N"].cast<double>();
  held.error_percent = force["error_percent"].cast<double>();
  held.overshoot_percent = force["overshoot_percent"].cast<double>();
  held.settle_s = force["settle_s"].cast<std::optional<double>>().value_or(held.settle_s);
  return m;
}

std::unique_ptr<Result> run_one(const std::filesystem::path &file,
                                const std::vector<std::string> &overrides, bool firmware_hash,
                                const std::optional<std::string> &text) {
  py::gil_scoped_release release;
  auto result = std::make_unique<Result>();
  result->experiment = forceaxis::host::load_experiment(file, overrides, text);
  expect_used(result->experiment);
  try {
    result->run = forceaxis::host::run(result->experiment,
                                       {.firmware_hash = firmware_hash, .stop = interrupted});
  } catch (const forceaxis::host::RunStopped &) {
    const py::gil_scoped_acquire acquire;
    throw py::error_already_set();
  }
  return result;
}

std::vector<std::string> contact_names(const forceaxis::sim::Model &model) {
  std::vector<std::string> names;
  for (const auto &contact : model.contacts) names.push_back(contact.name);
  return names;
}

// Returns the table [expect] of an experiment, or None if the file has no such table.
py::object expect_of(const Experiment &e) {
  return e.expect ? py::object(::to_dict(*e.expect)) : py::none();
}

py::dict plot_of(const Experiment &e) {
  py::dict d;
  if (!e.plot.rows.empty()) d["rows"] = e.plot.rows;
  if (e.plot.from_s) d["from_s"] = *e.plot.from_s;
  if (e.plot.to_s) d["to_s"] = *e.plot.to_s;
  return d;
}

forceaxis::host::CycleProgram cycle_program(const std::filesystem::path &file,
                                            const std::vector<std::string> &overrides) {
  Experiment experiment = forceaxis::host::load_experiment(file, overrides, std::nullopt);
  if (!experiment.cycle)
    throw forceaxis::sim::InputError(file.string(), "cycle",
                                     "expected the file of a program, the key is missing");
  return *std::move(experiment.cycle);
}

// Returns the record of an experiment's program (firmware/cycle/program.h).
py::bytes cycle_record(const std::filesystem::path &file,
                       const std::vector<std::string> &overrides) {
  const auto record = cycle_program(file, overrides).record;
  return {reinterpret_cast<const char *>(record.data()), record.size() * sizeof(record[0])};
}

// Returns the value in SI units of one unit of the firmware, for each element of the program.
std::vector<double> cycle_scales(const std::filesystem::path &file,
                                 const std::vector<std::string> &overrides) {
  std::vector<double> scales;
  for (const auto &element : cycle_program(file, overrides).elements)
    scales.push_back(element.per_value);
  return scales;
}

// Returns the last cycle of a run of this program, or None if the run had no program.
py::object cycle_of(const RunResult &run, const forceaxis::host::CycleProgram *own) {
  if (!run.cycle) return py::none();
  const forceaxis::host::CycleProgram &program = *own;
  py::dict d;
  d["title"] = program.title;
  d["state"] = run.cycle->state;
  d["outcome"] = run.cycle->outcome;
  d["failed_phase"] = run.cycle->failed_phase;
  d["cycles"] = run.cycle->cycles;
  d["invalid_ticks"] = run.cycle->invalid_ticks;
  d["phases"] = program.phases;
  py::list figures;
  for (std::size_t i = 0; i < run.cycle->figures.size(); ++i) {
    const forceaxis::host::CycleFigure &figure = run.cycle->figures[i];
    py::dict f;
    f["name"] = program.elements[i].name;
    f["kind"] = program.elements[i].kind;
    f["value"] = figure.value;
    f["unit"] = program.elements[i].unit;
    f["tick"] = figure.tick;
    f["verdict"] = figure.verdict;
    figures.append(f);
  }
  d["figures"] = figures;
  return d;
}

// Returns the reason why the table [verdict] of the experiment cannot be evaluated, or None.
py::object not_evaluable(const Experiment &e) {
  try {
    forceaxis::host::expect_evaluable(e);
    return py::none();
  } catch (const forceaxis::sim::InputError &error) {
    return py::cast(std::string(error.what()));
  }
}

// Returns the inputs of an experiment without a run.
py::dict inputs(const std::filesystem::path &file, const std::vector<std::string> &overrides,
                const std::optional<std::string> &text) {
  const Experiment e = forceaxis::host::load_experiment(file, overrides, text);
  py::dict parameters;
  for (const auto &p : e.model->parameters) {
    py::dict d;
    d["value"] = p.value;
    d["unit"] = p.unit;
    parameters[py::str(p.name)] = d;
  }
  py::dict d;
  py::dict firmware;
  for (const auto &w : e.initial) {
    const auto &meta = forceaxis::host::object_meta(w.object);
    const double raw = meta.min < 0 ? static_cast<double>(w.raw)
                                    : static_cast<double>(static_cast<std::uint32_t>(w.raw));
    firmware[py::str(meta.name)] = raw * meta.scale;
  }
  d["title"] = e.title;
  d["model"] = e.model->file;
  d["contacts"] = contact_names(*e.model);
  d["converters"] = converters_of(*e.model);
  d["firmware"] = firmware;
  d["expect"] = expect_of(e);
  d["inputs_hash"] = e.hash;
  d["criterion"] = to_dict(e.criterion);
  d["not_evaluable"] = not_evaluable(e);
  d["parameters"] = parameters;
  d["unused"] = e.unused;
  return d;
}

// A cache of experiment files, so that each file is read only once.
class Experiments {
 public:
  ExperimentFile &operator[](const std::string &file) {
    auto &entry = files_[file];
    if (!entry) entry = std::make_unique<ExperimentFile>(file);
    return *entry;
  }

 private:
  std::map<std::string, std::unique_ptr<ExperimentFile>> files_;
};

using Job = std::pair<std::string, std::vector<std::string>>;

struct Outcome {
  std::optional<Criterion> criterion;
  std::vector<std::string> overridden;
  std::shared_ptr<const forceaxis::host::CycleProgram> program;
  RunResult run;
  // Text of the error if the run has failed. The other members are then not set.
  std::string error;
};

py::dict to_dict(const Outcome &o) {
  py::dict d;
  if (!o.error.empty()) {
    d["error"] = o.error;
    return d;
  }
  d["verdict"] = o.run.verdict;
  d["missed"] = to_list(o.run.missed);
  d["fault"] = o.run.fault;
  d["metrics"] = ::to_dict(o.run.metrics);
  d["criterion"] = ::to_dict(o.criterion);
  d["overridden"] = o.overridden;
  d["trace_hash"] = o.run.trace_hash;
  d["edge_margin"] = o.run.edge_margin;
  d["cycle"] = cycle_of(o.run, o.program.get());
  return d;
}

// Computes many runs and returns only metrics and verdicts. The results do not depend on the number
// of threads, because the runs are independent.
py::list run_many(const std::vector<Job> &jobs, unsigned threads, const py::object &progress,
                  bool keep_going, const py::object &finished, Experiments *experiments) {
  Experiments own;
  std::vector<ExperimentFile *> files;
  for (const Job &job : jobs) files.push_back(&(experiments ? *experiments : own)[job.first]);
  std::vector<Outcome> outcomes(jobs.size());
  std::atomic<std::size_t> next{0};
  std::atomic<bool> stop{false};
  std::mutex mutex;  // lock for changed, failure and fresh
  std::condition_variable changed;
  std::exception_ptr failure;
  std::vector<std::size_t> fresh;  // indices of the jobs that are complete but not yet reported
  unsigned working = std::max(1U, std::min(threads, static_cast<unsigned>(jobs.size())));

  const auto run_job = [&](std::size_t i) {
    try {
      const Experiment e = files[i]->with(jobs[i].second);
      outcomes[i] = {e.criterion, overridden(*e.model), e.cycle,
                     forceaxis::host::run(
                         e, {.trace = false, .audit = false, .stop = [&] { return stop.load(); }}),
                     ""};
    } catch (const forceaxis::host::RunStopped &) {
      return;
    } catch (const std::exception &error) {
      outcomes[i].error = error.what();
      const std::lock_guard lock(mutex);
      if (!keep_going && !failure) failure = std::current_exception();
      if (!keep_going) stop = true;
    }
    const std::lock_guard lock(mutex);
    fresh.push_back(i);
  };
  const auto work = [&] {
    for (std::size_t i; !stop && (i = next++) < jobs.size();) run_job(i);
    const std::lock_guard lock(mutex);
    if (--working == 0) changed.notify_one();
  };
  std::vector<std::thread> pool;
  for (unsigned i = working; i > 0; --i) pool.emplace_back(work);
  const auto join = [&] {
    const py::gil_scoped_release release;
    for (std::thread &t : pool) t.join();
  };

  std::vector<py::dict> results(jobs.size());
  std::size_t reported = 0;
  try {
    for (bool over = false; !over;) {
      std::vector<std::size_t> done;
      {
        const py::gil_scoped_release release;
        std::unique_lock lock(mutex);
        over = changed.wait_for(lock, std::chrono::milliseconds(50), [&] { return working == 0; });
        done.swap(fresh);
      }
      if (PyErr_CheckSignals() != 0) throw py::error_already_set();
      for (const std::size_t i : done) {
        results[i] = to_dict(outcomes[i]);
        outcomes[i] = {};
        if (!finished.is_none()) finished(i, results[i]);
      }
      reported += done.size();
      if (!progress.is_none()) progress(reported, jobs.size());
    }
  } catch (...) {
    stop = true;
    join();
    throw;
  }
  join();
  if (failure) std::rethrow_exception(failure);
  return py::cast(results);
}

// Returns the first word of a record as four characters, in the order of the bytes in memory.
std::string magic_text(std::uint32_t magic) {
  std::string text;
  for (int shift = 0; shift < 32; shift += 8) text += static_cast<char>(magic >> shift & 0xFF);
  return text;
}

}  // namespace

PYBIND11_MODULE(_core, m) {
  m.doc() = "The firmware, the simulated plant and runs of both in one process.";
  static_assert(static_cast<int>(forceaxis::sim::kTickRateHz) == FX_TICK_RATE_HZ);
  m.attr("TICKS_PER_SECOND") = static_cast<int>(forceaxis::sim::kTickRateHz);
  m.attr("FIRMWARE_HASH") = FORCEAXIS_FIRMWARE_HASH;
  m.attr("SIMULATOR_HASH") = FORCEAXIS_SIMULATOR_HASH;
  m.attr("FIRMWARE_VERSION") = FW_VERSION;
  m.attr("FILE_FORMAT") = forceaxis::sim::kFileFormat;
  m.attr("JOURNAL_FORMAT") = forceaxis::host::kJournalTitle;
  m.attr("PARAMETER_SET_FORMAT") = magic_text(RECORD_SET);
  py::register_exception<forceaxis::sim::InputError>(m, "InputError", PyExc_ValueError);
  py::register_exception<forceaxis::sim::SimulationError>(m, "SimulationError", PyExc_RuntimeError);

  py::class_<Result>(m, "Result", "A finished run with its trace.")
      .def_property_readonly("title", [](const Result &r) { return r.experiment.title; })
      .def_property_readonly("figure", [](const Result &r) { return r.experiment.figure; })
      .def_property_readonly("shows", [](const Result &r) { return r.experiment.shows; })
      .def_property_readonly("model", [](const Result &r) { return r.experiment.model->file; })
      .def_property_readonly(
          "plot", [](const Result &r) { return plot_of(r.experiment); },
          "table [plot] of the experiment: the given keys of rows, from_s and to_s")
      .def_property_readonly("verdict", [](const Result &r) { return r.run.verdict; })
      .def_property_readonly(
          "missed", [](const Result &r) { return to_list(r.run.missed); },
          "limits that the run missed, each with limit, verdict, value (None: infinite), bound, "
          "unit")
      .def_property_readonly("fault", [](const Result &r) { return r.run.fault; })
      .def_property_readonly(
          "cycle", [](const Result &r) { return cycle_of(r.run, r.experiment.cycle.get()); },
          "result of the last cycle: title, state, outcome, failed_phase, cycles, invalid_ticks, "
          "phases and "
          "figures, each with name, kind, value, unit, tick and verdict; None without a program")
      .def_property_readonly("trace_hash", [](const Result &r) { return r.run.trace_hash; })
      .def_property_readonly(
          "firmware_hash", [](const Result &r) { return r.run.firmware_hash; },
          "trace hash of the firmware's side; empty unless firmware_hash was requested")
      .def_property_readonly("overridden",
                             [](const Result &r) { return overridden(*r.experiment.model); })
      .def_property_readonly("inputs_hash", [](const Result &r) { return r.experiment.hash; })
      .def_property_readonly("seed", [](const Result &r) { return r.experiment.seed; })
      .def_property_readonly("edge_margin", [](const Result &r) { return r.run.edge_margin; })
      .def_property_readonly("event_count", [](const Result &r) { return r.run.event_count; })
      .def_property_readonly(
          "refused", &Result::refused,
          "writes of [[at]] that the firmware has refused, each with tick, object and reason")
      .def_property_readonly(
          "events", &Result::events,
          "list of (time_s, element, from, to) with the exact time of each change")
      .def_property_readonly(
          "energy", [](const Result &r) { return energy_dict(r.run.energy); },
          "energy balance of the plant in J")
      .def_property_readonly("metrics", [](const Result &r) { return to_dict(r.run.metrics); })
      .def_property_readonly("criterion",
                             [](const Result &r) { return to_dict(r.experiment.criterion); })
      .def_property_readonly("tick",
                             [](const Result &r) {
                               return column<std::uint32_t>(r.run.records,
                                                            [](const auto &x) { return x.tick; });
                             })
      .def_property_readonly("objects", &Result::objects, "objects in the table [trace] -> unit")
      .def_property_readonly(
          "setpoints", &Result::setpoints,
          "list of (time_s, force in N) of all force set-points; [] without a force on ADC 0")
      .def_property_readonly("impulses", &Result::impulses,
                             "list of (time_s, body, impulse in N s)")
      .def_property_readonly("contacts", &Result::contacts, "names of the contacts of the model")
      .def_property_readonly("signal_units", &Result::signal_units, "signal of the model -> unit")
      .def_property_readonly("converters", &Result::converters,
                             "column of codes -> signal, unit, per_code, zero, bits")
      .def("columns", &Result::columns,
           "name -> array with one value for each tick: codes, firmware state, then true signals");

  m.def("run", &run_one, py::arg("experiment"), py::arg("overrides") = std::vector<std::string>{},
        py::arg("firmware_hash") = false, py::arg("text") = py::none(),
        "Runs one experiment file with overrides NAME=VALUE. firmware_hash: the firmware's side "
        "computes a trace hash too. text: content that is read in place of the file. Raises "
        "InputError.");
  m.def("inputs", &inputs, py::arg("experiment"), py::arg("overrides") = std::vector<std::string>{},
        py::arg("text") = py::none(),
        "Reads an experiment without a run. Returns title, model, contacts, converters, firmware "
        "(object -> value at the start), expect, inputs_hash, criterion, not_evaluable (the reason "
        "why [verdict] cannot be evaluated, or None), the parameters with value and unit, and the "
        "overrides that have no effect. text: content that is read in place of the file. Raises "
        "InputError.");
  m.def("cycle_record", &cycle_record, py::arg("experiment"),
        py::arg("overrides") = std::vector<std::string>{},
        "Returns the record of an experiment's program of a cycle, as an axis takes it in object "
        "2435h:1. Raises InputError, also for an experiment without a program.");
  m.def("cycle_scales", &cycle_scales, py::arg("experiment"),
        py::arg("overrides") = std::vector<std::string>{},
        "Returns, for each element of an experiment's program, the value in SI units of one unit "
        "of the firmware (object cycle_result_value). Raises InputError as cycle_record().");
  py::class_<Experiments>(
      m, "Experiments",
      "Experiment files with the content that was read first, and the models and "
      "modes used last, for several calls of run_many().")
      .def(py::init<>());
  m.def("run_many", &run_many, py::arg("jobs"), py::arg("threads") = 1,
        py::arg("progress") = py::none(), py::arg("keep_going") = false,
        py::arg("finished") = py::none(), py::arg("experiments") = nullptr,
        "Runs (experiment, overrides) pairs on `threads` threads. Returns verdict, metrics, "
        "criterion, hash and cycle of each pair, in order. If a run fails, all runs end and its "
        "error is raised. With keep_going, the result of a failed run is {\"error\": text} "
        "instead. At intervals, calls progress(done, total), and finished(index, result) for each "
        "new result.");
  m.def(
      "evaluate",
      [](const py::dict &criterion, const py::dict &metrics, const std::string &fault) {
        const auto evaluated = forceaxis::host::evaluate(criterion_from(criterion),
                                                         metrics_from(metrics), fault != "none");
        return std::pair(evaluated.verdict, to_list(evaluated.missed));
      },
      py::arg("criterion"), py::arg("metrics"), py::arg("fault"),
      "Returns (verdict, missed limits) of a finished run by another criterion with the same "
      "window.");

  add_laws(m);
  add_linear(m);
  add_bench(m);
  add_contacts(m);
  add_cycle(m);
  add_drive402(m);
  add_excite(m);
  add_fmu(m);
  add_link(m);
  add_live(m);
  add_objects(m);
  add_plant(m);
  add_toml(m);
}
