// State-space form of a plant in one mode, and frequency responses, for forceaxis.linear.
#include "sim/linear/linear.hpp"

#include <pybind11/complex.h>
#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <complex>
#include <map>
#include <string>
#include <vector>

#include "host/python/binding/model.hpp"
#include "host/python/binding/parts.hpp"
#include "sim/matrix/extended.hpp"
#include "sim/matrix/hessenberg.hpp"

namespace py = pybind11;
using forceaxis::sim::BoundaryResponse;
using forceaxis::sim::ExtendedMatrix;
using forceaxis::sim::kGround;
using forceaxis::sim::LinearMode;
using forceaxis::sim::Model;

namespace {

py::dict linear(const std::filesystem::path &file, const std::vector<std::string> &inputs,
                const std::vector<std::string> &outputs, const Overrides &overrides,
                const std::map<std::string, std::string> &modes, bool free, bool drive) {
  const Model model = load(file, overrides);
  auto result = forceaxis::sim::linearise(model, {modes, free, drive}, inputs, outputs);
  py::dict d;
  d["A"] = std::move(result.A);
  d["B"] = std::move(result.B);
  d["C"] = std::move(result.C);
  d["D"] = std::move(result.D);
  d["states"] = std::move(result.states);
  return d;
}

// Returns the parameters of the drive with their keys, without the parameters that act only outside
// the linear range around the error 0.
py::dict drive_values(const forceaxis::sim::Drive &drive) {
  using py::literals::operator""_a;
  if (const auto *perfect = std::get_if<forceaxis::sim::PerfectDrive>(&drive.type))
    return py::dict("force_per_volt"_a = perfect->force_per_volt);
  if (const auto *simple = std::get_if<forceaxis::sim::FirstOrderDrive>(&drive.type))
    return py::dict("k_act"_a = simple->k_act, "a_act"_a = simple->a_act,
                    "velocity_per_volt"_a = simple->velocity_per_volt);
  if (const auto *torque = std::get_if<forceaxis::sim::TorqueDrive>(&drive.type))
    return py::dict("current_per_volt"_a = torque->current_per_volt,
                    "k_force"_a = torque->motor.force_per_amp,
                    "current_bandwidth"_a = torque->motor.rate, "damping"_a = torque->damping);
  if (const auto *velocity = std::get_if<forceaxis::sim::VelocityDrive>(&drive.type)) {
    py::dict values("velocity_per_volt"_a = velocity->velocity_per_volt,
                    "k_force"_a = velocity->motor.force_per_amp,
                    "current_bandwidth"_a = velocity->motor.rate,
                    "k_velocity"_a = velocity->k_velocity);
    if (velocity->integral_time) values["integral_time"] = *velocity->integral_time;
    return values;
  }
  if (const auto *stepper = std::get_if<forceaxis::sim::StepperDrive>(&drive.type))
    return py::dict("velocity_per_volt"_a = stepper->velocity_per_volt,
                    "holding_force"_a = stepper->holding_force, "full_step"_a = stepper->full_step,
                    "damping"_a = stepper->damping);
  const auto &motor = std::get<forceaxis::sim::DcMotor>(drive.type);
  return py::dict("k_preamp_cmd"_a = motor.k_preamp_cmd, "k_preamp_fdbk"_a = motor.k_preamp_fdbk,
                  "a_preamp_fdbk"_a = motor.a_preamp_fdbk, "k_tach"_a = motor.k_tach,
                  "k_torque"_a = motor.k_torque, "k_back_emf"_a = motor.k_back_emf,
                  "L"_a = motor.inductance, "R"_a = motor.resistance, "r_trans"_a = motor.r_trans,
                  "b_m"_a = motor.b_m, "k_current"_a = motor.k_current, "k_amp"_a = motor.k_amp);
}

// Returns rate in Hz, phase in s, latency in s and order of the filter of the samples, or None for
// an ADC whose code is fresh in each tick.
py::object sampling(const forceaxis::sim::Adc &adc) {
  if (!adc.sampling) return py::none();
  const auto &[rate_hz, phase_s, phase_known, latency_s] = *adc.sampling;
  return py::make_tuple(rate_hz, phase_known ? py::cast(phase_s) : py::none(), latency_s,
                        adc.sinc_order);
}

py::list structures_of(const Model &model) {
  py::list structures;
  for (const auto &structure : model.structures) {
    std::vector<double> modal_masses;
    std::vector<std::vector<double>> shapes;
    for (const auto &mode : structure.modes) {
      modal_masses.push_back(mode.mass);
      shapes.push_back(mode.shape);
    }
    structures.append(py::dict(
        py::arg("name") = structure.name, py::arg("ports") = py::tuple(py::cast(structure.ports)),
        py::arg("modal_masses_kg") = modal_masses, py::arg("shapes") = shapes));
  }
  return structures;
}

// Returns the data of a model, other than the equations, that a linear analysis needs.
py::dict facts(const std::filesystem::path &file, const Overrides &overrides) {
  const Model model = load(file, overrides);
  const std::vector<std::string> points = model.point_names();
  const auto name = [&](int point) {
    return point == kGround ? std::string("ground") : points[static_cast<std::size_t>(point)];
  };
  py::dict masses;
  for (const auto &body : model.bodies) masses[py::str(body.name)] = body.mass;
  py::list signals;
  py::dict units;
  for (const auto &signal : model.signal_list())
    units[py::str(signal.name)] = forceaxis::sim::unit_of(signal.dimension);
  py::dict parameters;
  for (const auto &p : model.parameters)
    if (p.used) parameters[py::str(p.name)] = py::make_tuple(p.value, p.unit);
  py::dict d;
  d["title"] = model.title;
  d["masses_kg"] = masses;
  d["structures"] = structures_of(model);
  d["signals"] = units;
  d["parameters"] = parameters;
  py::list contacts;
  for (const auto &contact : model.contacts)
    contacts.append(
        py::dict(py::arg("name") = contact.name,
                 py::arg("between") = py::make_tuple(name(contact.ends.a), name(contact.ends.b))));
  d["contacts"] = contacts;
  py::dict switches;
  for (const auto &s : forceaxis::sim::switches_of(model))
    switches[py::str(s.element)] = py::tuple(py::cast(s.states));
  d["switches"] = switches;
  d["drive"] = py::none();
  if (model.drive) {
    static const char *const kTypes[] = {"dc_motor", "first_order", "perfect",
                                         "torque",   "velocity",    "stepper"};
    d["drive"] = py::dict(
        py::arg("type") = kTypes[model.drive->type.index()],
        py::arg("body") = name(model.drive->body),
        py::arg("reaction") = name(model.drive->reaction),
        py::arg("values") = drive_values(*model.drive),
        py::arg("bus") = py::make_tuple(model.drive->bus.ticks, model.drive->bus.delay_ticks_out,
                                        model.drive->bus.delay_ticks_in));
  }
  d["reading"] = py::none();
  if (const auto &adc = model.adc[0])
    d["reading"] = py::dict(py::arg("signal") = adc->signal,
                            py::arg("per_count") = adc->per_count * (1 << (adc->bits - 8)),
                            py::arg("bits") = adc->bits, py::arg("sampling") = sampling(*adc));
  d["encoder"] = py::none();
  if (const auto &encoder = model.encoder)
    d["encoder"] = py::dict(py::arg("body") = name(encoder->body),
                            py::arg("reference") = name(encoder->reference),
                            py::arg("scale") = encoder->scale);
  d["volts_per_code"] = model.dac.volts_per_code();
  d["volts_per_step"] = model.dac.volts_per_step();
  return d;
}

using Points = py::array_t<std::complex<double>, py::array::c_style | py::array::forcecast>;

py::array_t<std::complex<double>> response(const Eigen::MatrixXd &H, const Eigen::MatrixXd &B,
                                           const Eigen::MatrixXd &C, const Eigen::MatrixXd &D,
                                           const Points &points) {
  const auto count = static_cast<std::size_t>(points.size());
  py::array_t<std::complex<double>> values(
      {points.size(), static_cast<py::ssize_t>(C.rows()), static_cast<py::ssize_t>(B.cols())});
  forceaxis::sim::hessenberg_response(
      H, B, C, D, {points.data(), count},
      {values.mutable_data(), static_cast<std::size_t>(values.size())});
  return values;
}

py::array_t<std::complex<double>> complex_array(const std::vector<std::complex<double>> &values) {
  return py::array_t<std::complex<double>>(static_cast<py::ssize_t>(values.size()), values.data());
}

using Frequencies = py::array_t<double, py::array::c_style | py::array::forcecast>;

py::tuple boundary(const BoundaryResponse &response, const Frequencies &w) {
  py::array_t<std::complex<double>> values(w.size());
  py::array_t<std::complex<double>> slopes(w.size());
  py::array_t<double> rounding(w.size());
  for (py::ssize_t k = 0; k < w.size(); ++k) {
    const auto value = response.at(w.data()[k]);
    values.mutable_data()[k] = value.response;
    slopes.mutable_data()[k] = value.slope;
    rounding.mutable_data()[k] = value.rounding;
  }
  return py::make_tuple(values, slopes, rounding);
}

void add_extended(py::module_ &m) {
  namespace sim = forceaxis::sim;
  m.def("balance", &sim::balance, py::arg("A"),
        "d: in diag(1/d) A diag(d) rows weigh about as much as their columns; powers of 2");
  m.def(
      "eigenvalues", [](const ExtendedMatrix &A) { return complex_array(sim::eigenvalues(A)); },
      py::arg("A"), "Returns the n eigenvalues of A, computed in extended precision.");
  m.def("solve", &sim::solve, py::arg("A"), py::arg("B"),
        "Returns the solution X of A X = B, computed in extended precision.");
  m.def("sampled", &sim::sampled, py::arg("A"), py::arg("B"), py::arg("T"),
        "Returns e^(A T) - 1 and the integral of e^(A t) B over T side by side, in extended "
        "precision.");
  m.def(
      "hessenberg",
      [](const ExtendedMatrix &A, const ExtendedMatrix &B, const ExtendedMatrix &C) {
        auto found = sim::hessenberg(A, B, C);
        return py::make_tuple(std::move(found.H), std::move(found.B), std::move(found.C));
      },
      py::arg("A"), py::arg("B"), py::arg("C"),
      "Returns H, Q^T B and C Q with H = Q^T A Q, for hessenberg_response().");
  py::class_<BoundaryResponse>(
      m, "BoundaryResponse",
      "The response C (p - A)^-1 B + D from one input to one output on the stability boundary, in "
      "extended precision: p = j w for dt = 0, otherwise p = (1 + j w dt / 2) / (1 - j w dt / 2)")
      .def(py::init<ExtendedMatrix, ExtendedMatrix, ExtendedMatrix, double, double>(), py::arg("A"),
           py::arg("B"), py::arg("C"), py::arg("D"), py::arg("dt"))
      .def("__call__", &boundary, py::arg("w"),
           "Returns the arrays (response, dG/dw, error of the response by rounding of the entries) "
           "for "
           "an array of m frequencies w.");
}

}  // namespace

void add_linear(py::module_ &m) {
  m.def("linear", &linear, py::arg("model"), py::arg("inputs"), py::arg("outputs"),
        py::arg("overrides") = Overrides{}, py::arg("modes") = std::map<std::string, std::string>{},
        py::arg("free") = false, py::arg("drive") = true,
        "Returns A, B, C, D and the names of the states in one mode. See "
        "forceaxis.linear.linearise.");
  m.def(
      "facts", &facts, py::arg("model"), py::arg("overrides") = Overrides{},
      "Returns the data of a model: masses, structures (name, ports, modal masses, shapes: modes x "
      "ports), signals with units, used parameters (value, unit), "
      "contacts (name, between), switches (states of each element), drive (values: parameters by "
      "key), reading (per_count: unit of the signal per 8-bit count), encoder, volts_per_code, "
      "volts_per_step");
  m.def("hessenberg_response", &response, py::arg("H"), py::arg("B"), py::arg("C"), py::arg("D"),
        py::arg("points"),
        "Returns C (s I - H)^-1 B + D as an array (points, outputs, inputs). H is an upper "
        "Hessenberg matrix.");
  add_extended(m);
}
