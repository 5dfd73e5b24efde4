// The process of the plant, in a run whose firmware runs in another process.
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include "host/link/chip_side.hpp"
#include "host/link/lcm_transport.hpp"
#include "host/link/linked_run.hpp"
#include "host/python/binding/parts.hpp"
#include "host/python/binding/result.hpp"
#include "host/python/binding/table.hpp"
#include "host/run/replay.hpp"

namespace py = pybind11;

namespace {

using forceaxis::host::item;
using forceaxis::host::LinkOptions;
using forceaxis::host::LinkReport;
using forceaxis::host::Within;

std::chrono::milliseconds milliseconds_of(double seconds) {
  return std::chrono::milliseconds(static_cast<std::int64_t>(seconds * 1000 + 0.5));
}

// Speed of a run over a connection, and numbers of messages.
struct LinkDetails {
  static constexpr const char *kName = "LinkDetails";
  static constexpr const char *kMeaning =
      "Speed of a run over a connection, and numbers of messages.";
  LinkReport report;

  double ticks_per_s() const {
    return report.seconds > 0 ? static_cast<double>(report.ticks - 1) / report.seconds : 0;
  }
  double real_time() const { return ticks_per_s() / forceaxis::sim::kTickRateHz; }
  table::Ordered<std::int64_t> statistics() const {
    const auto &s = report.statistics;
    const auto &injected = report.injected;
    return {{"sent", s.sent},
            {"received", s.received},
            {"repeated", s.repeated},
            {"duplicates", s.duplicates},
            {"foreign", s.foreign},
            {"dropped", injected.dropped},
            {"doubled", injected.doubled},
            {"flipped", injected.flipped},
            {"on_wire", s.sent - injected.dropped + injected.doubled}};
  }

  static constexpr auto items() {
    using L = LinkDetails;
    return std::tuple{item("ticks_per_s", &L::ticks_per_s),
                      item("real_time", &L::real_time, "ratio of simulated time to elapsed time"),
                      item("overruns", Within{&L::report, &LinkReport::overruns}),
                      item("statistics", &L::statistics,
                           "{name of an event, such as repeated: number of messages}")};
  }
};

struct ChipDetails {
  static constexpr const char *kName = "ChipDetails";
  static constexpr const char *kMeaning = "Speed of a run on an emulated chip.";
  forceaxis::host::ChipCounts counts{};
  double seconds = 0;

  double ticks_per_s() const { return static_cast<double>(counts.ticks) / seconds; }

  static constexpr auto items() {
    using C = forceaxis::host::ChipCounts;
    using D = ChipDetails;
    return std::tuple{item("interrupts", Within{&D::counts, &C::interrupts},
                           "number of interrupts in which the chip has computed a tick"),
                      item("ticks", Within{&D::counts, &C::ticks}),
                      item("late_ticks", Within{&D::counts, &C::late_ticks},
                           "number of ticks that the main loop had not completed before the next "
                           "one"),
                      item("ticks_per_s", &D::ticks_per_s)};
  }
};

struct JournalHeader {
  static constexpr const char *kName = "JournalHeader";
  static constexpr const char *kMeaning = "What a journal of axis_node says about its run.";
  forceaxis::host::Journal journal;

  std::string experiment() const { return journal.experiment.string(); }
  std::size_t entries() const { return journal.entries.size(); }
  std::optional<std::int64_t> ticks() const {
    return journal.ticks < 0 ? std::nullopt : std::optional<std::int64_t>(journal.ticks);
  }
  std::int64_t replayed() const { return journal.known_ticks(); }

  static constexpr auto items() {
    using J = forceaxis::host::Journal;
    using H = JournalHeader;
    return std::tuple{
        item("experiment", &H::experiment),
        item("overrides", Within{&H::journal, &J::overrides}),
        item("entries", &H::entries),
        item("ticks", &H::ticks,
             "number of ticks of the recorded run; None if the journal is incomplete"),
        item("replayed", &H::replayed, "number of ticks that a replay repeats"),
        item("trace_hash", Within{&H::journal, &J::trace_hash},
             "trace hash of the recorded run; empty if the journal is incomplete")};
  }
};

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
  return py::make_tuple(std::move(result), table::object(LinkDetails{report}));
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
  return py::make_tuple(std::move(result), table::object(ChipDetails{counts, took.count()}));
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
  return py::make_tuple(std::move(result), table::object(JournalHeader{std::move(journal)}));
}

}  // namespace

void add_link(py::module_ &m) {
  table::add_results<LinkDetails, ChipDetails, JournalHeader>();
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
      "Repeats the run of a journal of axis_node in this process. Returns (Result, "
      "{experiment, overrides, entries, ticks, trace_hash}), where ticks and trace_hash are those "
      "of the recorded run. If the journal has no end, ticks is None and trace_hash is empty. "
      "Raises InputError.");
}
