// The Python side of the in-process run: experiments in, NumPy arrays out.
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

#include "host/link/experiment.hpp"
#include "host/link/run.hpp"

namespace py = pybind11;

void add_bench(py::module_ &m);   // bench.cpp
void add_excite(py::module_ &m);  // excite.cpp
void add_linear(py::module_ &m);  // linear.cpp
void add_plant(py::module_ &m);   // plant.cpp

using forceaxis::host::Criterion;
using forceaxis::host::Experiment;
using forceaxis::host::ExperimentFile;
using forceaxis::host::Metrics;
using forceaxis::host::RunResult;

py::dict energy_dict(const forceaxis::sim::EnergyAudit &e) {
  py::dict dissipated;
  for (const auto &damper : e.dissipated) dissipated[py::str(damper.element)] = damper.energy;
  py::dict d;
  d["initial_J"] = e.initial;
  d["supplied_J"] = e.supplied;
  d["dissipated_J"] = dissipated;
  d["kinetic_J"] = e.kinetic;
  d["stored_J"] = e.stored;
  d["discarded_J"] = e.discarded;
  d["residual_J"] = e.residual;
  return d;
}

namespace {

template <class T, class Rows, class Get>
py::array_t<T> column(const Rows &rows, Get get) {
  py::array_t<T> values(static_cast<py::ssize_t>(rows.size()));
  T *out = values.mutable_data();
  for (const auto &row : rows) *out++ = static_cast<T>(get(row));
  return values;
}

py::dict to_dict(const Metrics &m) {
  py::dict d;
  d["force_ripple_count"] = m.force_ripple_count;
  d["position_ripple_count"] = m.position_ripple_count;
  d["contact_losses"] = m.contact_losses;
  d["in_contact"] = m.in_contact;
  d["peak_force_N"] = m.peak_force_N;
  d["final_force_N"] = m.final_force_N;
  d["saturated_ticks"] = m.saturated_ticks;
  d["last_adc_change_tick"] = m.last_adc_change_tick;
  return d;
}

py::object to_dict(const std::optional<Criterion> &c) {
  if (!c) return py::none();
  py::dict d;
  d["window_s"] = c->window_s;
  d["force_ripple_max_count"] = c->force_ripple_max_count;
  d["position_ripple_max_count"] = c->position_ripple_max_count;
  d["contact_held"] = c->contact_held;
  return d;
}

Criterion criterion_from(const py::dict &d) {
  Criterion c;
  c.window_s = d["window_s"].cast<double>();
  c.force_ripple_max_count = d["force_ripple_max_count"].cast<std::optional<double>>();
  c.position_ripple_max_count = d["position_ripple_max_count"].cast<std::optional<double>>();
  c.contact_held = d["contact_held"].cast<bool>();
  return c;
}

Metrics metrics_from(const py::dict &d) {
  Metrics m;
  m.force_ripple_count = d["force_ripple_count"].cast<double>();
  m.position_ripple_count = d["position_ripple_count"].cast<double>();
  m.contact_losses = d["contact_losses"].cast<std::int64_t>();
  m.in_contact = d["in_contact"].cast<bool>();
  return m;
}

struct Result {
  Experiment experiment;
  RunResult run;

  py::dict columns() const {
    py::dict d;
    const auto &records = run.records;
    d["encoder"] = column<std::int32_t>(records, [](const auto &r) { return r.encoder_cnt; });
    d["adc0"] = column<std::uint16_t>(records, [](const auto &r) { return r.adc0_code; });
    d["adc1"] = column<std::uint16_t>(records, [](const auto &r) { return r.adc1_code; });
    d["din"] = column<std::uint8_t>(records, [](const auto &r) { return r.din; });
    d["dac"] = column<std::int16_t>(records, [](const auto &r) { return r.dac_code; });
    d["out"] = column<std::uint8_t>(records, [](const auto &r) { return r.out; });
    d["fault"] = column<std::uint8_t>(run.firmware, [](const auto &r) { return r.fault; });
    d["limit_reason"] =
        column<std::uint8_t>(run.firmware, [](const auto &r) { return r.limit_reason; });
    const std::size_t width = run.signal_names.size();
    for (std::size_t j = 0; j < width; ++j) {
      py::array_t<double> values(static_cast<py::ssize_t>(records.size()));
      double *out = values.mutable_data();
      for (std::size_t k = 0; k < records.size(); ++k) out[k] = run.signals[k * width + j];
      d[py::str(run.signal_names[j])] = values;
    }
    return d;
  }

  py::list refused() const {
    py::list list;
    for (const auto &r : run.refused) {
      py::dict d;
      d["tick"] = r.tick;
      d["object"] = r.object;
      d["reason"] = r.reason;
      list.append(d);
    }
    return list;
  }

  py::list events() const {
    py::list list;
    for (const auto &e : run.events) list.append(py::make_tuple(e.time_s, e.element, e.from, e.to));
    return list;
  }
};

std::unique_ptr<Result> run_one(const std::filesystem::path &file,
                                const std::vector<std::string> &overrides) {
  py::gil_scoped_release release;
  auto result = std::make_unique<Result>();
  result->experiment = forceaxis::host::load_experiment(file, overrides);
  if (!result->experiment.unused.empty()) {
    throw forceaxis::sim::InputError(file.string(), "set." + result->experiment.unused.front(),
                                     "expected a parameter that the model or the experiment uses, "
                                     "this one changes nothing here; remove it");
  }
  const auto interrupted = [] {
    const py::gil_scoped_acquire acquire;
    return PyErr_CheckSignals() != 0;
  };
  try {
    result->run = forceaxis::host::run(result->experiment, {.stop = interrupted});
  } catch (const forceaxis::host::RunStopped &) {
    const py::gil_scoped_acquire acquire;
    throw py::error_already_set();
  }
  return result;
}

// Parameters of the model that [set] or --set moved.
std::vector<std::string> overridden(const forceaxis::sim::Model &model) {
  std::vector<std::string> names;
  for (const auto &p : model.parameters) {
    if (p.overridden && p.used) names.push_back(p.name);
  }
  return names;
}

// What an experiment is, without running it.
py::dict inputs(const std::filesystem::path &file, const std::vector<std::string> &overrides) {
  const Experiment e = forceaxis::host::load_experiment(file, overrides);
  py::dict parameters;
  for (const auto &p : e.model->parameters) {
    py::dict d;
    d["value"] = p.value;
    d["unit"] = p.unit;
    parameters[py::str(p.name)] = d;
  }
  py::dict d;
  d["title"] = e.title;
  d["inputs_hash"] = e.hash;
  d["criterion"] = to_dict(e.criterion);
  d["parameters"] = parameters;
  d["unused"] = e.unused;
  return d;
}

// Experiment files, each read once.
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
  RunResult run;
  std::string error;  // of a failed run, whose other members mean nothing
};

py::dict to_dict(const Outcome &o) {
  py::dict d;
  if (!o.error.empty()) {
    d["error"] = o.error;
    return d;
  }
  d["verdict"] = o.run.verdict;
  d["fault"] = o.run.fault;
  d["metrics"] = to_dict(o.run.metrics);
  d["criterion"] = to_dict(o.criterion);
  d["overridden"] = o.overridden;
  d["trace_hash"] = o.run.trace_hash;
  d["edge_margin"] = o.run.edge_margin;
  return d;
}

// Metrics and verdict only. Jobs are independent, so the number of threads changes no result.
py::list run_many(const std::vector<Job> &jobs, unsigned threads, const py::object &progress,
                  bool keep_going, const py::object &finished, Experiments *experiments) {
  Experiments own;
  std::vector<ExperimentFile *> files;
  for (const Job &job : jobs) files.push_back(&(experiments ? *experiments : own)[job.first]);
  std::vector<Outcome> outcomes(jobs.size());
  std::atomic<std::size_t> next{0};
  std::atomic<bool> stop{false};
  std::mutex mutex;  // guards the three below
  std::condition_variable changed;
  std::exception_ptr failure;
  std::vector<std::size_t> fresh;  // done and not yet told
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
  std::size_t told = 0;
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
      told += done.size();
      if (!progress.is_none()) progress(told, jobs.size());
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

}  // namespace

PYBIND11_MODULE(_core, m) {
  m.doc() = "The firmware's tick around the plant, in process.";
  m.attr("TICKS_PER_SECOND") = static_cast<int>(forceaxis::sim::kTickRateHz);
  m.attr("FIRMWARE_HASH") = FORCEAXIS_FIRMWARE_HASH;
  m.attr("SIMULATOR_HASH") = FORCEAXIS_SIMULATOR_HASH;
  py::register_exception<forceaxis::sim::InputError>(m, "InputError", PyExc_ValueError);
  py::register_exception<forceaxis::sim::SimulationError>(m, "SimulationError", PyExc_RuntimeError);

  py::class_<Result>(m, "Result", "A finished run with its trace.")
      .def_property_readonly("title", [](const Result &r) { return r.experiment.title; })
      .def_property_readonly("figure", [](const Result &r) { return r.experiment.figure; })
      .def_property_readonly("shows", [](const Result &r) { return r.experiment.shows; })
      .def_property_readonly("verdict", [](const Result &r) { return r.run.verdict; })
      .def_property_readonly("fault", [](const Result &r) { return r.run.fault; })
      .def_property_readonly("trace_hash", [](const Result &r) { return r.run.trace_hash; })
      .def_property_readonly("inputs_hash", [](const Result &r) { return r.experiment.hash; })
      .def_property_readonly("seed", [](const Result &r) { return r.experiment.seed; })
      .def_property_readonly("edge_margin", [](const Result &r) { return r.run.edge_margin; })
      .def_property_readonly("event_count", [](const Result &r) { return r.run.event_count; })
      .def_property_readonly("refused", &Result::refused,
                             "writes of [[at]] that the firmware refused: tick, object, reason")
      .def_property_readonly("events", &Result::events, "(time_s, element, from, to), located")
      .def_property_readonly(
          "energy", [](const Result &r) { return energy_dict(r.run.energy); },
          "J; mechanical energy audit")
      .def_property_readonly("metrics", [](const Result &r) { return to_dict(r.run.metrics); })
      .def_property_readonly("criterion",
                             [](const Result &r) { return to_dict(r.experiment.criterion); })
      .def_property_readonly("tick",
                             [](const Result &r) {
                               return column<std::uint32_t>(r.run.records,
                                                            [](const auto &x) { return x.tick; });
                             })
      .def("columns", &Result::columns,
           "name -> array, one value a tick: codes, firmware state, then the plant's true signals");

  m.def("run", &run_one, py::arg("experiment"), py::arg("overrides") = std::vector<std::string>{},
        "Run one experiment file with overrides NAME=VALUE. Raises InputError.");
  m.def("inputs", &inputs, py::arg("experiment"), py::arg("overrides") = std::vector<std::string>{},
        "Read an experiment without running it: title, inputs_hash, criterion, parameters with "
        "value and unit, and the overrides that change nothing. Raises InputError.");
  py::class_<Experiments>(m, "Experiments",
                          "Experiment files as they were first read, with the models and modes "
                          "met last: for several run_many() calls.")
      .def(py::init<>());
  m.def("run_many", &run_many, py::arg("jobs"), py::arg("threads") = 1,
        py::arg("progress") = py::none(), py::arg("keep_going") = false,
        py::arg("finished") = py::none(), py::arg("experiments") = nullptr,
        "Run (experiment, overrides) pairs on `threads` threads. Returns verdict, metrics, "
        "criterion and hash of each, in order. A job that fails ends all and its error is raised; "
        "with keep_going it becomes {\"error\": text} instead. Now and then, progress(done, total) "
        "is called and finished(index, result) for every job done since.");
  m.def(
      "judge",
      [](const py::dict &criterion, const py::dict &metrics, const std::string &fault) {
        return forceaxis::host::judge(criterion_from(criterion), metrics_from(metrics),
                                      fault != "none");
      },
      py::arg("criterion"), py::arg("metrics"), py::arg("fault"),
      "The verdict that another criterion gives on a finished run's metrics (same window).");

  add_linear(m);
  add_bench(m);
  add_excite(m);
  add_plant(m);
}
