// Evaluation of force laws over a set of plants, for forceaxis.design.
#include <pybind11/complex.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <exception>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "host/python/binding/model.hpp"
#include "host/python/binding/parts.hpp"
#include "sim/linear/law_grid.hpp"

namespace py = pybind11;
using forceaxis::sim::ForcePlant;
using forceaxis::sim::GainLimit;
using forceaxis::sim::LawBounds;
using forceaxis::sim::LawGrid;
using forceaxis::sim::LawSection;
using forceaxis::sim::LawShape;
using forceaxis::sim::LoopFigures;
using forceaxis::sim::PreciseFigures;
using forceaxis::sim::RampResponse;

namespace {

// Smallest and largest density of a frequency grid, and largest sampling period in s.
constexpr double kDensityMin = 0.1, kDensityMax = 100, kTickMax_s = 1;

using Numbers = py::array_t<double, py::array::c_style | py::array::forcecast>;
using Complexes = py::array_t<std::complex<double>>;

// One plant of a set: values of the parameters, and state of each element.
using PlantKey = std::pair<Overrides, std::map<std::string, std::string>>;

// Calls work(i) for i = 0 .. count - 1 on some threads. Each call writes its own result, so the
// results do not depend on the number of threads. Throws the exception of the call with the lowest
// index that has thrown one.
template <typename Work>
void in_parallel(std::size_t count, unsigned threads, const Work &work) {
  std::atomic<std::size_t> next{0};
  std::vector<std::exception_ptr> errors(count);
  const auto run = [&] {
    for (std::size_t i = next++; i < count; i = next++) try {
        work(i);
      } catch (...) {
        errors[i] = std::current_exception();
      }
  };
  std::vector<std::jthread> pool;  // the destructor joins all threads, also if one of them cannot
                                   // be started
  for (std::size_t i = 1; i < std::min<std::size_t>(threads, count); ++i) pool.emplace_back(run);
  run();
  pool.clear();
  for (const auto &error : errors)
    if (error) std::rethrow_exception(error);
}

// The frequency grid for the plants in which the command acts on the force. `kept` has the indices
// of these plants in the given list. If the phase of their sensor is not known, the grid has the
// same plants again for the second phase, then for the third phase, and so on. The figures of a
// plant are then the worst figures over all phases.
struct Grid {
  std::vector<std::size_t> kept;
  std::optional<LawGrid> grid;
  std::vector<int> delays;
};

// Throws ValueError with the text `text` unless the condition `holds` is true.
void expect(bool holds, const char *text) {
  if (!holds) throw py::value_error(text);
}

const LawGrid &plants_of(const Grid &grid) {
  expect(grid.grid.has_value(), "LawGrid: expected a plant with a path to the force, got none");
  return *grid.grid;
}

std::size_t index_of(const Grid &grid, std::size_t plant) {
  expect(plant < grid.kept.size(), "plant: expected an index of LawGrid.kept");
  return plant;
}

const ForcePlant &plant_at(const Grid &grid, std::size_t plant) {
  return plants_of(grid).plants()[index_of(grid, plant)];
}

// Returns the plants of a grid. Throws ValueError if `bounds` does not have one value for each
// delay of the grid.
const LawGrid &plants_of(const Grid &grid, const LawBounds &bounds) {
  expect(bounds.ms.size() == grid.delays.size(), "ms: expected one value for each delay");
  return plants_of(grid);
}

LawBounds bounds_of(std::vector<double> ms, double gain_margin, double phase_margin_deg,
                    double hf_gain) {
  for (const double one : ms) expect(one > 1, "ms: expected numbers above 1");
  expect(gain_margin > 0, "gain_margin: expected a number above 0");
  expect(phase_margin_deg >= 0 && phase_margin_deg < 90,
         "phase_margin_deg: expected a number from 0 to 90");
  expect(hf_gain > 0, "hf_gain: expected a number above 0");
  return {std::move(ms), gain_margin, phase_margin_deg, hf_gain};
}

std::unique_ptr<Grid> grid_of(const forceaxis::sim::ModelFile &model,
                              const std::vector<PlantKey> &keys, const std::vector<int> &delays,
                              double density, double tick_s, unsigned threads, bool all_phases) {
  expect(!delays.empty() && *std::min_element(delays.begin(), delays.end()) >= 0,
         "delays: expected one delay in ticks or more, each at least 0");
  expect(density >= kDensityMin && density <= kDensityMax,
         "density: expected a number from 0.1 to 100");
  expect(tick_s > 0 && tick_s <= kTickMax_s, "tick_s: expected a number above 0, at most 1");
  const py::gil_scoped_release released;
  std::vector<std::optional<ForcePlant>> plants(keys.size());
  in_parallel(keys.size(), threads, [&](std::size_t i) {
    const auto &[overrides, states] = keys[i];
    plants[i] = ForcePlant::of(load(model, overrides), {states, false, true}, tick_s);
  });
  auto result = std::make_unique<Grid>();
  std::vector<ForcePlant> kept;
  for (std::size_t i = 0; i < plants.size(); ++i)
    if (plants[i]) {
      result->kept.push_back(i);
      kept.push_back(std::move(*plants[i]));
    }
  std::vector<std::vector<ForcePlant>> others(kept.size());
  in_parallel(kept.size(), threads,
              [&](std::size_t i) { others[i] = kept[i].with_other_phases(all_phases); });
  for (std::size_t phase = 0; !others.empty() && phase < others.front().size(); ++phase)
    for (auto &plant : others) kept.push_back(std::move(plant[phase]));
  result->delays = delays;
  if (!kept.empty()) result->grid.emplace(std::move(kept), delays, density);
  return result;
}

Complexes complex_array(const std::vector<std::complex<double>> &values) {
  return Complexes(static_cast<py::ssize_t>(values.size()), values.data());
}

LawShape law_of(double integral_rad_per_s, const std::vector<std::array<double, 5>> &sections) {
  LawShape law;
  law.integral_rad_per_s = integral_rad_per_s;
  for (const auto &section : sections) law.sections.push_back(LawSection::of(section));
  return law;
}

py::tuple law_coefficients(const std::vector<double> &numbers, double tick_s) {
  const auto law = LawShape::of_logarithms(numbers, tick_s, std::numeric_limits<double>::max());
  expect(law.has_value(), "numbers: expected logarithms of finite coefficients");
  std::vector<std::array<double, 5>> sections;
  for (const LawSection &section : law->sections) sections.push_back(section.coefficients());
  return py::make_tuple(law->integral_rad_per_s, sections);
}

// Returns an array of shape (laws, 2) with the bandwidth in Hz and the largest gain of each law.
// `numbers` has one row for each law.
py::array_t<double> evaluate(const Grid &grid, const Numbers &numbers, const LawBounds &bounds,
                             const RampResponse *ramp, const std::vector<double> &floors_hz,
                             double coefficient_max, unsigned threads) {
  const LawGrid &own = plants_of(grid, bounds);
  expect(numbers.ndim() == 2 && (numbers.shape(1) == 0 || numbers.shape(1) % 4 == 1),
         "numbers: expected an array (laws, numbers) with 0, 1, 5, 9, .. numbers");
  const auto count = static_cast<std::size_t>(numbers.shape(0));
  expect(floors_hz.empty() || floors_hz.size() == count,
         "floors_hz: expected one value for each law, or none");
  const auto width = static_cast<std::size_t>(numbers.shape(1));
  py::array_t<double> values({numbers.shape(0), py::ssize_t{2}});
  double *const out = values.mutable_data();
  const double *const in = numbers.data();
  const double tick_s = own.plants().front().tick_s();
  const py::gil_scoped_release released;
  in_parallel(count, threads, [&](std::size_t i) {
    const auto law = LawShape::of_logarithms({in + i * width, width}, tick_s, coefficient_max);
    const auto value =
        law ? own.evaluate(*law, bounds, ramp, floors_hz.empty() ? 0.0 : floors_hz[i])
            : forceaxis::sim::LawValue{};
    out[2 * i] = value.bandwidth_hz;
    out[2 * i + 1] = value.gain;
  });
  return values;
}

py::tuple largest_gain(const Grid &grid, const LawShape &law, double hf_gain,
                       const LawBounds &bounds) {
  static const char *const kNames[] = {"hf", "ms", "gm", "pm"};
  const GainLimit limit = plants_of(grid, bounds).largest_gain(law, hf_gain, bounds);
  return py::make_tuple(limit.gain, kNames[static_cast<int>(limit.bound)],
                        limit.plant % grid.kept.size(), limit.delay, limit.frequency_hz);
}

// Replaces each figure of `worst` that is better than the same figure of `other`.
void add_worse(LoopFigures &worst, const LoopFigures &other) {
  worst = {std::min(worst.fS_hz, other.fS_hz), std::min(worst.fT_hz, other.fT_hz),
           std::max(worst.Ms, other.Ms), std::min(worst.gain_margin, other.gain_margin),
           std::min(worst.phase_margin_rad, other.phase_margin_rad)};
}
void add_worse(PreciseFigures &worst, const PreciseFigures &other) {
  worst = {worst.known_stable && other.known_stable,
           std::min(worst.fS_hz, other.fS_hz),
           std::min(worst.fT_hz, other.fT_hz),
           std::max(worst.Ms, other.Ms),
           std::min(worst.gain_margin, other.gain_margin),
           std::min(worst.phase_margin_rad, other.phase_margin_rad),
           worst.sag || other.sag};
}

// Returns an array of shape (plants, delays, 6) with the precise figures of each loop. A loop that
// is not known to be stable has NaN in all columns.
py::array_t<double> precise(const Grid &grid, const LawShape &law, const std::vector<double> &gains,
                            unsigned threads) {
  const LawGrid &own = plants_of(grid);
  expect(gains.size() == grid.kept.size(), "gains: expected one gain for each plant");
  constexpr std::size_t kColumns = 6;
  const std::size_t delays = grid.delays.size();
  py::array_t<double> values({static_cast<py::ssize_t>(grid.kept.size()),
                              static_cast<py::ssize_t>(delays),
                              static_cast<py::ssize_t>(kColumns)});
  double *const out = values.mutable_data();
  const py::gil_scoped_release released;
  in_parallel(grid.kept.size() * delays, threads, [&](std::size_t i) {
    PreciseFigures f = own.precise(law, gains[i / delays], i / delays, i % delays);
    for (std::size_t p = grid.kept.size() + i / delays; p < own.plants().size() && f.known_stable;
         p += grid.kept.size())
      add_worse(f, own.precise(law, gains[i / delays], p, i % delays));
    const std::array<double, kColumns> row{
        f.fS_hz, f.fT_hz, f.Ms, f.gain_margin, f.phase_margin_rad, f.sag ? 1.0 : 0.0};
    for (std::size_t k = 0; k < kColumns; ++k)
      out[i * kColumns + k] = f.known_stable ? row[k] : std::numeric_limits<double>::quiet_NaN();
  });
  return values;
}

py::array_t<double> figures(const Grid &grid, const LawShape &law, double gain) {
  auto all = plants_of(grid).figures(law, gain);
  const std::size_t loops = grid.kept.size() * grid.delays.size();
  for (std::size_t i = loops; i < all.size(); ++i) add_worse(all[i % loops], all[i]);
  all.resize(loops);
  py::array_t<double> values({static_cast<py::ssize_t>(grid.kept.size()),
                              static_cast<py::ssize_t>(grid.delays.size()), py::ssize_t{5}});
  double *out = values.mutable_data();
  for (const auto &f : all)
    for (const double value : {f.fS_hz, f.fT_hz, f.Ms, f.gain_margin, f.phase_margin_rad})
      *out++ = value;
  return values;
}

std::unique_ptr<RampResponse> ramp_of(const Grid &grid, const std::vector<std::size_t> &indices,
                                      double ramp_s) {
  expect(!indices.empty(), "plants: expected one index or more, got none");
  expect(ramp_s > 0 && ramp_s < 1e6, "ramp_s: expected a number above 0, below 1e6");
  std::vector<const ForcePlant *> plants;
  for (const std::size_t i : indices) plants.push_back(&plant_at(grid, i));
  return std::make_unique<RampResponse>(plants, grid.delays, ramp_s);
}

}  // namespace

void add_laws(py::module_ &m) {
  py::class_<forceaxis::sim::ModelFile>(m, "ModelFile",
                                        "A model file that is read once, for many plants.")
      .def(py::init<const std::filesystem::path &>(), py::arg("path"));
  py::class_<LawShape>(m, "LawShape", "A force law with the gain 1.")
      .def(py::init(&law_of), py::arg("integral_rad_per_s"), py::arg("sections"),
           "Makes the law from the integral rate in 1/s and the sections (b0, b1, b2, a1, a2).")
      .def_property_readonly("hf_gain", &LawShape::hf_gain,
                             "gain at high frequency, as the firmware computes it");
  m.def("law_coefficients", &law_coefficients, py::arg("numbers"), py::arg("tick_s"),
        "Returns (integral rate in rad/s, sections (b0, b1, b2, a1, a2)) of the law with these "
        "logarithms, as LawGrid.evaluate computes them.");
  py::class_<LawBounds>(m, "LawBounds", "Bounds that all loops have to keep.")
      .def(py::init(&bounds_of), py::arg("ms"), py::arg("gain_margin"), py::arg("phase_margin_deg"),
           py::arg("hf_gain"),
           "ms: largest |S| for each delay. phase_margin_deg: 0: no bound. hf_gain: in DAC codes "
           "per 8-bit count.");
  py::class_<RampResponse>(m, "LawRamp", "Force loops that have to follow a ramp of the set-point.")
      .def(
          "excess",
          [](const RampResponse &ramp, const LawShape &law, double gain) {
            return ramp.excess(law, gain);
          },
          py::arg("law"), py::arg("gain"),
          "Returns the largest excess of the force over its band, as a share of the set-point.");
  py::class_<Grid>(m, "LawGrid",
                   "Frequency responses of a set of plants, on which force laws are evaluated. See "
                   "forceaxis.design.grid.")
      .def(py::init(&grid_of), py::arg("model"), py::arg("plants"), py::arg("delays"),
           py::arg("density"), py::arg("tick_s"), py::arg("threads") = 1,
           py::arg("all_phases") = false,
           "plants: (overrides, states) of each plant. delays: in ticks. all_phases: of a sensor "
           "without a known phase, not only the oldest and the newest readings.")
      .def_readonly("kept", &Grid::kept,
                    "indices of the plants with a path from the command to the force")
      .def_property_readonly(
          "exact",
          [](const Grid &grid) { return !grid.grid || grid.grid->plants().front().exact(); },
          "True if one code leaves the period after which the ticks of the loops repeat. Otherwise "
          "figures are those of a mean age of the readings.")
      .def_property_readonly(
          "free",
          [](const Grid &grid) {
            return grid.grid && grid.grid->plants().size() > grid.kept.size();
          },
          "True if the sensor has no known phase, so that each plant has several phases")
      .def(
          "frequency_hz",
          [](const Grid &grid, std::size_t plant) {
            const auto hz = plants_of(grid).frequency_hz(index_of(grid, plant));
            return py::array_t<double>(static_cast<py::ssize_t>(hz.size()), hz.data());
          },
          py::arg("plant"), "Returns the grid frequencies of a plant in Hz.")
      .def(
          "response",
          [](const Grid &grid, std::size_t plant) {
            return complex_array(plants_of(grid).response(index_of(grid, plant)));
          },
          py::arg("plant"), "Returns the response of a plant in 8-bit counts per DAC code.")
      .def(
          "count_per_code",
          [](const Grid &grid, std::size_t plant) {
            return plant_at(grid, plant).count_per_code();
          },
          py::arg("plant"),
          "Returns the 8-bit counts per DAC code of a plant with a response of 1 in its own units.")
      .def(
          "poles",
          [](const Grid &grid, std::size_t plant) {
            return complex_array(plant_at(grid, plant).poles());
          },
          py::arg("plant"), "Returns the poles of a plant in 1/s.")
      .def(
          "zeros",
          [](const Grid &grid, std::size_t plant) {
            return complex_array(plant_at(grid, plant).zeros());
          },
          py::arg("plant"), "Returns the zeros of a plant in 1/s.")
      .def(
          "noise_gain",
          [](const Grid &grid, const LawShape &law) { return plants_of(grid).noise_gain(law); },
          py::arg("law"),
          "Returns the largest magnitude of a law at the grid frequencies, without its integral.")
      .def("ramp", &ramp_of, py::arg("plants"), py::arg("ramp_s"),
           "Returns the loops around some plants (indices) that have to follow a ramp.")
      .def(
          "evaluate", &evaluate, py::arg("numbers"), py::arg("bounds"), py::arg("ramp"),
          py::arg("floors_hz"), py::arg("coefficient_max"), py::arg("threads") = 1,
          "Returns (bandwidth in Hz, largest gain) of each law, an array (laws, 2). numbers: one "
          "row of logarithms of the parameters for each law. floors_hz: for each law the bandwidth "
          "below which the evaluation may end early, with values that are too large; empty: 0.")
      .def("largest_gain", &largest_gain, py::arg("law"), py::arg("hf_gain"), py::arg("bounds"),
           "Returns (gain, bound, plant, delay, frequency in Hz): the largest gain that the bounds "
           "permit, and the point at which the bound hf, ms, gm or pm is reached.")
      .def(
          "gains",
          [](const Grid &grid, const LawShape &law, double hf_gain, const LawBounds &bounds) {
            const auto all = plants_of(grid, bounds).limits(law, hf_gain, bounds);
            std::vector<double> gains(grid.kept.size());
            for (std::size_t i = 0; i < all.size(); ++i)
              gains[i % gains.size()] =
                  i < gains.size() ? all[i].gain : std::min(gains[i % gains.size()], all[i].gain);
            return py::array_t<double>(static_cast<py::ssize_t>(gains.size()), gains.data());
          },
          py::arg("law"), py::arg("hf_gain"), py::arg("bounds"),
          "Returns the largest gain that the bounds permit for each plant alone.")
      .def("precise", &precise, py::arg("law"), py::arg("gains"), py::arg("threads") = 1,
           "Returns an array (plants, delays, 6) with one gain of the law for each plant: fS, fT "
           "in Hz, "
           "Ms, gain margin, phase margin in rad, 1 if |T| sags. All are NaN for a loop that is "
           "not known to be stable.")
      .def("figures", &figures, py::arg("law"), py::arg("gain"),
           "Returns an array (plants, delays, 5): fS, fT in Hz, Ms, gain margin, phase margin in "
           "rad. The loops have to be stable.");
}
