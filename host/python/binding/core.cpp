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

#include "host/python/binding/energy.hpp"
#include "host/python/binding/parts.hpp"
#include "host/python/binding/result.hpp"
#include "host/python/binding/toml.hpp"
#include "host/run/experiment.hpp"
#include "host/run/journal.hpp"
#include "host/run/objects.hpp"
#include "host/run/run.hpp"

extern "C" {
#include "firmware/app/fw.h"
}

namespace py = pybind11;

using forceaxis::host::Criterion;
using forceaxis::host::Experiment;
using forceaxis::host::ExperimentFile;
using forceaxis::host::item;
using forceaxis::host::Metrics;
using forceaxis::host::RunResult;
using forceaxis::host::Within;

namespace {

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
std::optional<py::dict> expect_of(const Experiment &e) {
  if (!e.expect) return std::nullopt;
  return ::to_dict(*e.expect);
}

// Returns the reason why the table [verdict] of the experiment cannot be evaluated, or nothing.
std::optional<std::string> not_evaluable(const Experiment &e) {
  try {
    forceaxis::host::expect_evaluable(e);
    return std::nullopt;
  } catch (const forceaxis::sim::InputError &error) {
    return error.what();
  }
}

struct Parameter {
  static constexpr const char *kName = "ParameterTable";
  static constexpr const char *kMeaning = "A parameter of the model.";
  static constexpr bool kDict = true;
  double value;
  std::string unit;

  static constexpr auto items() {
    return std::tuple{item("value", &Parameter::value), item("unit", &Parameter::unit)};
  }
};

// The inputs of an experiment that is read but not run.
struct Inputs {
  static constexpr const char *kName = "Inputs";
  static constexpr const char *kMeaning = "The experiment that inputs() has read.";
  static constexpr bool kDict = true;
  Experiment e;

  std::string title() const { return e.title; }
  std::string model() const { return e.model->file; }
  std::vector<std::string> contacts() const { return contact_names(*e.model); }
  table::Ordered<Converter> converters() const { return converters_of(*e.model); }
  table::Ordered<double> firmware() const {
    table::Ordered<double> all;
    for (const auto &w : e.initial) {
      const auto &meta = forceaxis::host::object_meta(w.object);
      const double raw = meta.min < 0 ? static_cast<double>(w.raw)
                                      : static_cast<double>(static_cast<std::uint32_t>(w.raw));
      all.emplace_back(meta.name, raw * meta.scale);
    }
    return all;
  }
  std::optional<py::dict> expect() const { return expect_of(e); }
  std::optional<std::string> why() const { return not_evaluable(e); }
  table::Ordered<Parameter> parameters() const {
    table::Ordered<Parameter> all;
    for (const auto &p : e.model->parameters) all.push_back({p.name, {p.value, p.unit}});
    return all;
  }

  static constexpr auto items() {
    using I = Inputs;
    return std::tuple{
        item("title", &I::title),
        item("model", &I::model),
        item("contacts", &I::contacts),
        item("converters", &I::converters),
        item("firmware", &I::firmware, "{object: value at the start}"),
        item("expect", &I::expect),
        item("inputs_hash", Within{&I::e, &Experiment::hash}),
        item("criterion", Within{&I::e, &Experiment::criterion}),
        item("not_evaluable", &I::why, "reason why [verdict] cannot be evaluated, or None"),
        item("parameters", &I::parameters),
        item("unused", Within{&I::e, &Experiment::unused}, "overrides that have no effect")};
  }
};

py::object inputs(const std::filesystem::path &file, const std::vector<std::string> &overrides,
                  const std::optional<std::string> &text) {
  return table::object(Inputs{forceaxis::host::load_experiment(file, overrides, text)});
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
  static constexpr const char *kName = "RunOutcome";
  static constexpr const char *kMeaning =
      "A result of run_many(). A run that has failed has only the text `error`.";
  static constexpr bool kDict = true, kPartial = true;
  std::optional<Criterion> criterion;
  std::vector<std::string> overridden;
  RunResult run;
  std::string error;

  static constexpr auto items() {
    using R = RunResult;
    constexpr auto run = &Outcome::run;
    return std::tuple{item("error", &Outcome::error),
                      item("verdict", Within{run, &R::verdict}),
                      item("missed", Within{run, &R::missed}),
                      item("fault", Within{run, &R::fault}),
                      item("metrics", Within{run, &R::metrics}),
                      item("criterion", &Outcome::criterion),
                      item("overridden", &Outcome::overridden),
                      item("trace_hash", Within{run, &R::trace_hash}),
                      item("edge_margin", Within{run, &R::edge_margin}),
                      item("cycle", Within{run, &R::cycle})};
  }
};

py::dict to_dict(const Outcome &o) {
  if (!o.error.empty()) return py::dict(py::arg("error") = o.error);
  py::dict d = table::object(o);
  PyDict_DelItemString(d.ptr(), "error");
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
  std::mutex mutex;  // lock that protects `changed`, `failure` and `fresh`
  std::condition_variable changed;
  std::exception_ptr failure;
  std::vector<std::size_t> fresh;  // indices of the jobs that are complete but not yet reported
  unsigned working = std::max(1U, std::min(threads, static_cast<unsigned>(jobs.size())));

  const auto run_job = [&](std::size_t i) {
    try {
      const Experiment e = files[i]->with(jobs[i].second);
      outcomes[i] = {e.criterion, overridden(*e.model),
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
  m.attr("FIRMWARE_HASH") = kFirmwareHash;
  m.attr("SIMULATOR_HASH") = kSimulatorHash;
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
          "plot", [](const Result &r) { return table::object(r.experiment.plot); },
          "table [plot] of the experiment")
      .def_property_readonly("verdict", [](const Result &r) { return r.run.verdict; })
      .def_property_readonly(
          "missed", [](const Result &r) { return table::object(r.run.missed); },
          "limits that the run missed, each with limit, verdict, value (None: infinite), bound, "
          "unit")
      .def_property_readonly("fault", [](const Result &r) { return r.run.fault; })
      .def_property_readonly(
          "cycle", [](const Result &r) { return table::object(r.run.cycle); },
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
          "refused", [](const Result &r) { return table::object(r.run.refused); },
          "writes of [[at]] that the firmware has refused, each with tick, object and reason")
      .def_property_readonly(
          "events", &Result::events,
          "list of (time_s, element, from, to) with the exact time of each change")
      .def_property_readonly(
          "energy", [](const Result &r) { return table::object(Energy{r.run.energy}); },
          "energy balance of the plant in J")
      .def_property_readonly("metrics",
                             [](const Result &r) { return table::object(r.run.metrics); })
      .def_property_readonly("criterion",
                             [](const Result &r) { return table::object(r.experiment.criterion); })
      .def_property_readonly("tick",
                             [](const Result &r) {
                               return column<std::uint32_t>(r.run.records,
                                                            [](const auto &x) { return x.tick; });
                             })
      .def_property_readonly("objects", &Result::objects, "objects in the table [trace] -> unit")
      .def_property_readonly(
          "setpoints", &Result::setpoints,
          "list of (time_s, force in N) of all force set-points; [] without a force on ADC 0")
      .def_property_readonly(
          "limited_setpoints", &Result::limited_setpoints,
          "list of (set-point, limit in N) of force set-points above the limit of the force")
      .def_property_readonly("impulses", &Result::impulses,
                             "list of (time_s, body, impulse in N s)")
      .def_property_readonly("contacts", &Result::contacts, "names of the contacts of the model")
      .def_property_readonly("signal_units", &Result::signal_units, "signal of the model -> unit")
      .def_property_readonly(
          "converters",
          [](const Result &r) { return table::object(converters_of(*r.experiment.model)); },
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
  m.def(
      "cycle_program",
      [](const std::filesystem::path &file, const std::vector<std::string> &overrides) {
        return table::object(*forceaxis::host::load_cycle_experiment(file, overrides).cycle);
      },
      py::arg("experiment"), py::arg("overrides") = std::vector<std::string>{},
      "Returns the program of a cycle that an experiment names: what its file describes, and the "
      "record that an axis takes in object 2435h:1. Raises InputError, also for an experiment "
      "without a program.");
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
      [](const py::object &criterion, const py::object &metrics, const std::string &fault) {
        const auto evaluated = forceaxis::host::evaluate(
            table::from<Criterion>(criterion), table::from<Metrics>(metrics), fault != "none");
        return py::make_tuple(evaluated.verdict, table::object(evaluated.missed));
      },
      py::arg("criterion"), py::arg("metrics"), py::arg("fault"),
      "Returns (verdict, missed limits) of a finished run by another criterion with the same "
      "window.");

  table::add_results<forceaxis::host::HeldForce, Metrics, Criterion, forceaxis::host::Missed,
                     Energy, forceaxis::host::Refusal, forceaxis::host::CycleFigure,
                     forceaxis::host::CycleResult, forceaxis::host::CycleEnd,
                     forceaxis::host::CyclePhase, forceaxis::host::CycleElement,
                     forceaxis::host::CycleProgram, Converter, forceaxis::host::Plot, Parameter,
                     Inputs, Outcome>();
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
  m.def(
      "result_types",
      [] {
        py::list types;
        for (const auto describe : table::described) describe(types);
        return types;
      },
      "Returns the types of results for tools/gen_results.py: name, meaning, whether it is a dict, "
      "and (field, type, meaning) of each field.");
}
