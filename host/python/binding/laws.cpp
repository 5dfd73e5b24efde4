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
using forceaxis::sim::RampResponse;

namespace {

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
  std::vector<std::jthread> pool;  // joined also if a thread cannot be started
  for (std::size_t i = 1; i < std::min<std::size_t>(threads, count); ++i) pool.emplace_back(run);
  run();
  pool.clear();
  for (const auto &error : errors)
    if (error) std::rethrow_exception(error);
}

// The grid of the plants with a path from the command to the force, and the indices of these plants
// in the given list.
struct Grid {
  std::vector<std::size_t> kept;
  std::optional<LawGrid> grid;
  std::vector<int> delays;
};

std::unique_ptr<Grid> grid_of(const forceaxis::sim::ModelFile &model,
                              const std::vector<PlantKey> &keys, const std::vector<int> &delays,
                              double density, double tick_s, unsigned threads) {
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

// Returns an array (laws, 2) with the bandwidth in Hz and the largest gain of each law. `numbers`
// has one row for each law.
py::array_t<double> evaluate(const Grid &grid, const Numbers &numbers, const LawBounds &bounds,
                             const RampResponse *ramp, const std::vector<double> &floors_hz,
                             double coefficient_max, unsigned threads) {
  if (numbers.ndim() != 2) throw py::value_error("numbers: expected an array (laws, numbers)");
  const auto count = static_cast<std::size_t>(numbers.shape(0));
  if (!floors_hz.empty() && floors_hz.size() != count)
    throw py::value_error("floors_hz: expected one value for each law, or none");
  const auto width = static_cast<std::size_t>(numbers.shape(1));
  py::array_t<double> values({numbers.shape(0), py::ssize_t{2}});
  double *const out = values.mutable_data();
  const double *const in = numbers.data();
  const double tick_s = grid.grid.value().plants().front().tick_s();
  const py::gil_scoped_release released;
  in_parallel(count, threads, [&](std::size_t i) {
    const auto law = LawShape::of_logarithms({in + i * width, width}, tick_s, coefficient_max);
    const auto value =
        law ? grid.grid->evaluate(*law, bounds, ramp, floors_hz.empty() ? 0.0 : floors_hz[i])
            : forceaxis::sim::LawValue{};
    out[2 * i] = value.bandwidth_hz;
    out[2 * i + 1] = value.gain;
  });
  return values;
}

py::tuple largest_gain(const Grid &grid, const LawShape &law, double hf_gain,
                       const LawBounds &bounds) {
  static const char *const kNames[] = {"hf", "ms", "mt", "gm", "pm"};
  const GainLimit limit = grid.grid.value().largest_gain(law, hf_gain, bounds);
  return py::make_tuple(limit.gain, kNames[static_cast<int>(limit.bound)], limit.plant, limit.delay,
                        limit.frequency_hz);
}

// Returns an array (plants, delays, 6). A loop that is not known to be stable has NaN in all
// columns.
py::array_t<double> precise(const Grid &grid, const LawShape &law, const std::vector<double> &gains,
                            unsigned threads) {
  if (gains.size() != grid.kept.size())
    throw py::value_error("gains: expected one gain for each plant");
  constexpr std::size_t kColumns = 6;
  const std::size_t delays = grid.delays.size();
  py::array_t<double> values({static_cast<py::ssize_t>(grid.kept.size()),
                              static_cast<py::ssize_t>(delays),
                              static_cast<py::ssize_t>(kColumns)});
  double *const out = values.mutable_data();
  const LawGrid &own = grid.grid.value();
  const py::gil_scoped_release released;
  in_parallel(grid.kept.size() * delays, threads, [&](std::size_t i) {
    const auto f = own.precise(law, gains[i / delays], i / delays, i % delays);
    const std::array<double, kColumns> row{
        f.fS_hz, f.fT_hz, f.Ms, f.gain_margin, f.phase_margin_rad, f.sag ? 1.0 : 0.0};
    for (std::size_t k = 0; k < kColumns; ++k)
      out[i * kColumns + k] = f.known_stable ? row[k] : std::numeric_limits<double>::quiet_NaN();
  });
  return values;
}

py::array_t<double> figures(const Grid &grid, const LawShape &law, double gain) {
  const auto all = grid.grid.value().figures(law, gain);
  py::array_t<double> values({static_cast<py::ssize_t>(grid.kept.size()),
                              static_cast<py::ssize_t>(grid.delays.size()), py::ssize_t{7}});
  double *out = values.mutable_data();
  for (const auto &f : all)
    for (const double value :
         {f.fS_hz, f.fT_hz, f.last_fT_hz, f.Ms, f.Mt, f.gain_margin, f.phase_margin_rad})
      *out++ = value;
  return values;
}

std::unique_ptr<RampResponse> ramp_of(const Grid &grid, const std::vector<std::size_t> &indices,
                                      double ramp_s) {
  std::vector<const ForcePlant *> plants;
  for (const std::size_t i : indices) plants.push_back(&grid.grid.value().plants().at(i));
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
  py::class_<LawBounds>(m, "LawBounds", "Bounds that all loops have to keep.")
      .def(py::init<std::vector<double>, double, double, double, double>(), py::arg("ms"),
           py::arg("mt"), py::arg("gain_margin"), py::arg("phase_margin_deg"), py::arg("hf_gain"),
           "ms: largest |S| for each delay. mt: largest |T|, infinity: no bound. phase_margin_deg: "
           "0: "
           "no bound. hf_gain: in DAC codes per 8-bit count.");
  py::class_<RampResponse>(m, "LawRamp", "Force loops that have to follow a ramp of the set-point.")
      .def("excess", &RampResponse::excess, py::arg("law"), py::arg("gain"),
           "Returns the largest excess of the force over its band, as a share of the set-point.");
  py::class_<Grid>(m, "LawGrid",
                   "Frequency responses of a set of plants, on which force laws are evaluated. See "
                   "forceaxis.design.grid.")
      .def(py::init(&grid_of), py::arg("model"), py::arg("plants"), py::arg("delays"),
           py::arg("density"), py::arg("tick_s"), py::arg("threads") = 1,
           "plants: (overrides, states) of each plant. delays: in ticks.")
      .def_readonly("kept", &Grid::kept,
                    "indices of the plants with a path from the command to the force")
      .def(
          "frequency_hz",
          [](const Grid &grid, std::size_t plant) {
            const auto hz = grid.grid.value().frequency_hz(plant);
            return py::array_t<double>(static_cast<py::ssize_t>(hz.size()), hz.data());
          },
          py::arg("plant"), "Returns the grid frequencies of a plant in Hz.")
      .def(
          "response",
          [](const Grid &grid, std::size_t plant) {
            return complex_array(grid.grid.value().response(plant));
          },
          py::arg("plant"), "Returns the response of a plant in 8-bit counts per DAC code.")
      .def(
          "count_per_code",
          [](const Grid &grid, std::size_t plant) {
            return grid.grid.value().plants().at(plant).count_per_code();
          },
          py::arg("plant"),
          "Returns the 8-bit counts per DAC code of a plant with a response of 1 in its own units.")
      .def(
          "poles",
          [](const Grid &grid, std::size_t plant) {
            return complex_array(grid.grid.value().plants().at(plant).poles());
          },
          py::arg("plant"), "Returns the poles of a plant in 1/s.")
      .def(
          "zeros",
          [](const Grid &grid, std::size_t plant) {
            return complex_array(grid.grid.value().plants().at(plant).zeros());
          },
          py::arg("plant"), "Returns the zeros of a plant in 1/s.")
      .def(
          "noise_gain",
          [](const Grid &grid, const LawShape &law) { return grid.grid.value().noise_gain(law); },
          py::arg("law"),
          "Returns the largest magnitude of a law at the grid frequencies, without its integral.")
      .def("ramp", &ramp_of, py::arg("plants"), py::arg("ramp_s"), py::keep_alive<0, 1>(),
           "Returns the loops around some plants (indices) that have to follow a ramp.")
      .def(
          "evaluate", &evaluate, py::arg("numbers"), py::arg("bounds"), py::arg("ramp"),
          py::arg("floors_hz"), py::arg("coefficient_max"), py::arg("threads") = 1,
          "Returns (bandwidth in Hz, largest gain) of each law, an array (laws, 2). numbers: one "
          "row of logarithms of the parameters for each law. floors_hz: for each law the bandwidth "
          "below which the ramp is not computed; empty: 0.")
      .def("largest_gain", &largest_gain, py::arg("law"), py::arg("hf_gain"), py::arg("bounds"),
           "Returns (gain, bound, plant, delay, frequency in Hz): the largest gain that the bounds "
           "permit, and the point at which the bound hf, ms, mt, gm or pm is reached.")
      .def(
          "gains",
          [](const Grid &grid, const LawShape &law, double hf_gain, const LawBounds &bounds) {
            std::vector<double> gains;
            for (const GainLimit &limit : grid.grid.value().limits(law, hf_gain, bounds))
              gains.push_back(limit.gain);
            return py::array_t<double>(static_cast<py::ssize_t>(gains.size()), gains.data());
          },
          py::arg("law"), py::arg("hf_gain"), py::arg("bounds"),
          "Returns the largest gain that the bounds permit for each plant alone.")
      .def("precise", &precise, py::arg("law"), py::arg("gains"), py::arg("threads") = 1,
           "Returns an array (plants, delays, 6) with one gain of the law for each plant: fS, fT "
           "in Hz, "
           "Ms, gain margin, phase margin in rad, 1 if |T| sags. All are NaN for a loop that is "
           "not known to be stable.")
      .def(
          "figures", &figures, py::arg("law"), py::arg("gain"),
          "Returns an array (plants, delays, 7): fS, fT, last fT in Hz, Ms, Mt, gain margin, phase "
          "margin in rad.");
}
