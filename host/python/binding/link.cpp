// The plant's end of a run whose firmware runs in another process.
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include "host/link/chip_side.hpp"
#include "host/link/lcm_transport.hpp"
#include "host/link/linked_run.hpp"
#include "host/python/binding/parts.hpp"
#include "host/python/binding/result.hpp"
#include "host/run/replay.hpp"

namespace py = pybind11;

namespace {

using forceaxis::host::LinkOptions;
using forceaxis::host::LinkReport;

std::chrono::milliseconds milliseconds_of(double seconds) {
  return std::chrono::milliseconds(static_cast<std::int64_t>(seconds * 1000 + 0.5));
}

py::dict to_dict(const LinkReport &r) {
  const double rate = r.seconds > 0 ? static_cast<double>(r.ticks - 1) / r.seconds : 0;
  py::dict d, s;
  s["sent"] = r.statistics.sent;
  s["received"] = r.statistics.received;
  s["repeated"] = r.statistics.repeated;
  s["duplicates"] = r.statistics.duplicates;
  s["foreign"] = r.statistics.foreign;
  s["dropped"] = r.injected.dropped;
  s["doubled"] = r.injected.doubled;
  s["flipped"] = r.injected.flipped;
  s["on_wire"] = r.statistics.sent - r.injected.dropped + r.injected.doubled;
  d["ticks_per_s"] = rate;
  d["real_time"] = rate / forceaxis::sim::kTickRateHz;
  d["overruns"] = r.overruns;
  d["statistics"] = s;
  return d;
}

py::tuple run_linked(const std::filesystem::path &file, const std::vector<std::string> &overrides,
                     const std::string &kind, std::int64_t run_id, const std::string &lcm_url,
                     const std::string &can_interface, double start_timeout_s, double timeout_s,
                     const std::string &inject, bool real_time, bool trace) {
  LinkOptions options;
  options.kind = kind;
  options.run_id = run_id;
  options.lcm_url = lcm_url;
  options.can_interface = can_interface;
  options.timeouts = {milliseconds_of(start_timeout_s), milliseconds_of(timeout_s)};
  if (!inject.empty()) options.injection = forceaxis::host::injection_of(inject);
  auto result = std::make_unique<Result>();
  LinkReport report;
  try {
    const py::gil_scoped_release release;
    result->experiment = forceaxis::host::load_experiment(file, overrides);
    expect_used(result->experiment);
    forceaxis::host::LinkedPlants plants({&result->experiment, 1}, 1,
                                         {.trace = trace, .audit = trace, .stop = interrupted},
                                         options);
    result->run = std::move(plants.run(real_time).front());
    report = plants.report();
  } catch (const forceaxis::host::RunStopped &) {
    throw py::error_already_set();
  }
  return py::make_tuple(std::move(result), to_dict(report));
}

py::tuple run_on_chip(const std::filesystem::path &file, const std::vector<std::string> &overrides,
                      int to_fd, int from_fd, double timeout_s, bool trace) {
  auto result = std::make_unique<Result>();
  forceaxis::host::ChipCounts counts{};
  const auto begin = std::chrono::steady_clock::now();
  try {
    const py::gil_scoped_release release;
    result->experiment = forceaxis::host::load_experiment(file, overrides);
    expect_used(result->experiment);
    auto run = forceaxis::host::run_on_chip(
        result->experiment, {.trace = trace, .audit = trace, .stop = interrupted},
        {.to_fd = to_fd, .from_fd = from_fd, .patience = milliseconds_of(timeout_s)});
    result->run = std::move(run.result);
    counts = run.counts;
  } catch (const forceaxis::host::RunStopped &) {
    throw py::error_already_set();
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  py::dict report;
  report["interrupts"] = counts.interrupts;
  report["ticks"] = counts.ticks;
  report["late_ticks"] = counts.late_ticks;
  report["ticks_per_s"] = counts.ticks / took.count();
  return py::make_tuple(std::move(result), report);
}

// Largest number of ticks for which a replay stores the trace. This number is ten minutes of ticks,
// about 100 MB.
constexpr std::int64_t kLongestTrace = 900'001;

py::tuple replay(const std::filesystem::path &file) {
  auto result = std::make_unique<Result>();
  forceaxis::host::Journal journal;
  try {
    const py::gil_scoped_release release;
    journal = forceaxis::host::read_journal(file);
    result->experiment = journal.load();
    if (result->experiment.hash != journal.inputs_hash) {
      throw forceaxis::sim::InputError(
          file.string(), "inputs_hash",
          "expected the experiment and model that the journal was made with, " +
              journal.experiment.string() + " or its model has changed since");
    }
    result->run = forceaxis::host::replay(
        journal, result->experiment,
        {.trace = journal.known_ticks() <= kLongestTrace, .stop = interrupted});
  } catch (const forceaxis::host::RunStopped &) {
    throw py::error_already_set();
  }
  py::dict header;
  header["experiment"] = journal.experiment.string();
  header["overrides"] = journal.overrides;
  header["entries"] = journal.entries.size();
  header["ticks"] = journal.ticks < 0 ? py::object(py::none()) : py::cast(journal.ticks);
  header["replayed"] = journal.known_ticks();
  header["trace_hash"] = journal.trace_hash;
  return py::make_tuple(std::move(result), header);
}

}  // namespace

void add_link(py::module_ &m) {
  py::register_exception<forceaxis::host::TransportError>(m, "TransportError", PyExc_RuntimeError);
  py::register_exception<forceaxis::host::LinkSilent>(m, "LinkSilent", PyExc_RuntimeError);
  m.def(
      "lcm_url_of", [](std::int64_t run_id) { return forceaxis::host::lcm_url_of(run_id); },
      py::arg("run_id"), "Returns the default LCM URL for the records of a run.");
  m.def("run_linked", &run_linked, py::arg("experiment"), py::arg("overrides"), py::arg("kind"),
        py::arg("run_id"), py::arg("lcm_url") = "", py::arg("can_interface") = "vcan1",
        py::arg("start_timeout_s") = 5.0, py::arg("timeout_s") = 1.0, py::arg("inject") = "",
        py::arg("real_time") = false, py::arg("trace") = true,
        "Runs one experiment with the plant in this process and the firmware in an axis_node, as "
        "axis 1. "
        "Returns (Result, {ticks_per_s, real_time, overruns, statistics}). Raises InputError, "
        "SimulationError, TransportError, LinkSilent, ValueError for `inject`.");
  m.def(
      "run_on_chip", &run_on_chip, py::arg("experiment"), py::arg("overrides"), py::arg("to_fd"),
      py::arg("from_fd"), py::arg("timeout_s") = 5.0, py::arg("trace") = true,
      "Runs one experiment with the plant in this process and the firmware on an emulated chip at "
      "the other end of two pipes. Returns (Result, {interrupts, ticks, late_ticks, ticks_per_s}); "
      "a late tick is one that the main loop of the chip had not completed before the next one. "
      "Raises InputError, SimulationError, TransportError.");
  m.def(
      "replay", &replay, py::arg("journal"),
      "Repeats the run of a journal from axis_node --journal in this process. Returns (Result, "
      "{experiment, overrides, entries, ticks, trace_hash}), where ticks and trace_hash are those "
      "of the recorded run. If the journal has no end, ticks is None and trace_hash is empty. "
      "Raises InputError.");
}
