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
#include "host/python/binding/table.hpp"
#include "host/run/item.hpp"
#include "sim/matrix/extended.hpp"
#include "sim/matrix/hessenberg.hpp"
#include "sim/model/elements/all.hpp"

namespace py = pybind11;
using forceaxis::host::item;
using forceaxis::sim::BoundaryResponse;
using forceaxis::sim::ExtendedMatrix;
using forceaxis::sim::kGround;
using forceaxis::sim::LinearMode;
using forceaxis::sim::Model;

namespace {

using Pair = std::tuple<std::string, std::string>;
// Samples of a converter: rate in Hz, phase in s (None for any phase), latency in s, and order of
// the filter.
using Samples = std::tuple<double, std::optional<double>, double, int>;

struct LinearTable {
  static constexpr const char *kName = "LinearTable";
  static constexpr const char *kMeaning = "The linear equations of a model in one mode.";
  static constexpr bool kDict = true;
  Eigen::MatrixXd A;
  Eigen::MatrixXd B;
  Eigen::MatrixXd C;
  Eigen::MatrixXd D;
  std::vector<std::string> states;
  double volts_per_code;

  static constexpr auto items() {
    return std::tuple{
        item("A", &LinearTable::A),           item("B", &LinearTable::B),
        item("C", &LinearTable::C),           item("D", &LinearTable::D),
        item("states", &LinearTable::states), item("volts_per_code", &LinearTable::volts_per_code)};
  }
};

struct StructureTable {
  static constexpr const char *kName = "StructureTable";
  static constexpr const char *kMeaning =
      "A structure of a model that is given by its modes; for the fields see StructureFacts.";
  static constexpr bool kDict = true;
  std::string name;
  table::Fixed<std::string> ports;
  std::vector<double> modal_masses_kg;
  std::vector<std::vector<double>> shapes;

  static constexpr auto items() {
    return std::tuple{item("name", &StructureTable::name), item("ports", &StructureTable::ports),
                      item("modal_masses_kg", &StructureTable::modal_masses_kg),
                      item("shapes", &StructureTable::shapes, "modes x ports")};
  }
};

struct ContactTable {
  static constexpr const char *kName = "ContactTable";
  static constexpr const char *kMeaning =
      "A contact of a model and the two points between which it acts.";
  static constexpr bool kDict = true;
  std::string name;
  Pair between;

  static constexpr auto items() {
    return std::tuple{item("name", &ContactTable::name), item("between", &ContactTable::between)};
  }
};

struct DriveTable {
  static constexpr const char *kName = "DriveTable";
  static constexpr const char *kMeaning = "The drive of a model; for the fields see DriveFacts.";
  static constexpr bool kDict = true;
  std::string type;
  std::string body;
  std::string reaction;
  table::Ordered<double> values;
  std::tuple<int, int, int> bus;

  static constexpr auto items() {
    return std::tuple{item("type", &DriveTable::type), item("body", &DriveTable::body),
                      item("reaction", &DriveTable::reaction),
                      item("values", &DriveTable::values, "{key: parameter}"),
                      item("bus", &DriveTable::bus)};
  }
};

struct ReadingTable {
  static constexpr const char *kName = "ReadingTable";
  static constexpr const char *kMeaning =
      "The force sensor of a model; for the fields see SensorFacts.";
  static constexpr bool kDict = true;
  std::string signal;
  double per_count;
  int bits;
  std::optional<Samples> sampling;

  static constexpr auto items() {
    return std::tuple{
        item("signal", &ReadingTable::signal),
        item("per_count", &ReadingTable::per_count, "unit of the signal per 8-bit count"),
        item("bits", &ReadingTable::bits), item("sampling", &ReadingTable::sampling)};
  }
};

struct EncoderTable {
  static constexpr const char *kName = "EncoderTable";
  static constexpr const char *kMeaning =
      "The encoder of a model; for the fields see EncoderFacts.";
  static constexpr bool kDict = true;
  std::string body;
  std::string reference;
  double scale;

  static constexpr auto items() {
    return std::tuple{item("body", &EncoderTable::body),
                      item("reference", &EncoderTable::reference),
                      item("scale", &EncoderTable::scale)};
  }
};

struct FactsTable {
  static constexpr const char *kName = "FactsTable";
  static constexpr const char *kMeaning =
      "The contents of a model file; for the fields see PlantFacts.";
  static constexpr bool kDict = true;
  std::string title;
  table::Ordered<double> masses_kg;
  std::vector<StructureTable> structures;
  table::Ordered<std::string> signals;
  table::Ordered<std::tuple<double, std::string>> parameters;
  std::vector<ContactTable> contacts;
  table::Ordered<table::Fixed<std::string>> switches;
  std::optional<DriveTable> drive;
  std::optional<ReadingTable> reading;
  std::optional<EncoderTable> encoder;
  double volts_per_code;
  double volts_per_step;

  static constexpr auto items() {
    return std::tuple{
        item("title", &FactsTable::title),
        item("masses_kg", &FactsTable::masses_kg),
        item("structures", &FactsTable::structures),
        item("signals", &FactsTable::signals, "{signal: unit}"),
        item("parameters", &FactsTable::parameters, "{used parameter: value and unit}"),
        item("contacts", &FactsTable::contacts),
        item("switches", &FactsTable::switches, "{element: its states}"),
        item("drive", &FactsTable::drive),
        item("reading", &FactsTable::reading),
        item("encoder", &FactsTable::encoder),
        item("volts_per_code", &FactsTable::volts_per_code),
        item("volts_per_step", &FactsTable::volts_per_step)};
  }
};

py::object linear(const std::filesystem::path &file, const std::vector<std::string> &inputs,
                  const std::vector<std::string> &outputs, const Overrides &overrides,
                  const std::map<std::string, std::string> &modes, bool free, bool drive) {
  const Model model = load(file, overrides);
  auto found = forceaxis::sim::linearise(model, {modes, free, drive}, inputs, outputs);
  return table::object(LinearTable{std::move(found.A), std::move(found.B), std::move(found.C),
                                   std::move(found.D), std::move(found.states),
                                   model.dac->volts_per_code()});
}

// Returns the parameters of the drive with their keys, without the parameters that act only outside
// the linear range around the error 0.
table::Ordered<double> drive_values(const forceaxis::sim::Drive &drive) {
  if (const auto *perfect = std::get_if<forceaxis::sim::PerfectDrive>(&drive.type))
    return {{"force_per_volt", perfect->force_per_volt}};
  if (const auto *simple = std::get_if<forceaxis::sim::FirstOrderDrive>(&drive.type))
    return {{"k_act", simple->k_act},
            {"a_act", simple->a_act},
            {"velocity_per_volt", simple->velocity_per_volt}};
  if (const auto *torque = std::get_if<forceaxis::sim::TorqueDrive>(&drive.type))
    return {{"current_per_volt", torque->current_per_volt},
            {"k_force", torque->motor.force_per_amp},
            {"current_bandwidth", torque->motor.rate},
            {"damping", torque->damping}};
  if (const auto *velocity = std::get_if<forceaxis::sim::VelocityDrive>(&drive.type)) {
    table::Ordered<double> values{{"velocity_per_volt", velocity->velocity_per_volt},
                                  {"k_force", velocity->motor.force_per_amp},
                                  {"current_bandwidth", velocity->motor.rate},
                                  {"k_velocity", velocity->k_velocity}};
    if (velocity->integral_time) values.emplace_back("integral_time", *velocity->integral_time);
    return values;
  }
  if (const auto *stepper = std::get_if<forceaxis::sim::StepperDrive>(&drive.type))
    return {{"velocity_per_volt", stepper->velocity_per_volt},
            {"holding_force", stepper->holding_force},
            {"full_step", stepper->full_step},
            {"damping", stepper->damping}};
  const auto &motor = std::get<forceaxis::sim::DcMotor>(drive.type);
  return {{"k_preamp_cmd", motor.k_preamp_cmd},
          {"k_preamp_fdbk", motor.k_preamp_fdbk},
          {"a_preamp_fdbk", motor.a_preamp_fdbk},
          {"k_tach", motor.k_tach},
          {"k_torque", motor.k_torque},
          {"k_back_emf", motor.k_back_emf},
          {"L", motor.inductance},
          {"R", motor.resistance},
          {"r_trans", motor.r_trans},
          {"b_m", motor.b_m},
          {"k_current", motor.k_current},
          {"k_amp", motor.k_amp}};
}

// Returns the samples of an ADC, or nothing for an ADC that samples in each tick.
std::optional<Samples> sampling(const forceaxis::sim::Adc &adc) {
  if (!adc.sampling) return std::nullopt;
  const auto &[rate_hz, phase_s, phase_known, latency_s] = *adc.sampling;
  return Samples(rate_hz, phase_known ? std::optional(phase_s) : std::nullopt, latency_s,
                 adc.sinc_order);
}

std::vector<StructureTable> structures_of(const Model &model) {
  std::vector<StructureTable> structures;
  for (const auto &structure : model.structures) {
    StructureTable &found = structures.emplace_back();
    found.name = structure.name;
    found.ports = {structure.ports};
    for (const auto &mode : structure.modes) {
      found.modal_masses_kg.push_back(mode.mass);
      found.shapes.push_back(mode.shape);
    }
  }
  return structures;
}

// Returns the data of a model, other than the equations, that a linear analysis needs.
py::object facts(const std::filesystem::path &file, const Overrides &overrides) {
  const Model model = load(file, overrides);
  const std::vector<std::string> points = model.point_names();
  const auto name = [&](int point) {
    return point == kGround ? std::string("ground") : points[static_cast<std::size_t>(point)];
  };
  FactsTable d{};
  d.title = model.title;
  for (const auto &body : model.bodies) d.masses_kg.emplace_back(body.name, body.mass);
  d.structures = structures_of(model);
  for (const auto &signal : model.signal_list())
    d.signals.emplace_back(signal.name, forceaxis::sim::unit_of(signal.dimension));
  for (const auto &p : model.parameters)
    if (p.used) d.parameters.push_back({p.name, {p.value, p.unit}});
  for (const auto &contact : model.contacts)
    d.contacts.push_back({contact.name, {name(contact.ends.a), name(contact.ends.b)}});
  for (const auto &s : forceaxis::sim::switches_of(model))
    d.switches.push_back({s.element, {s.states}});
  if (const auto &drive = model.drive) {
    static const char *const kTypes[] = {"dc_motor", "first_order", "perfect",
                                         "torque",   "velocity",    "stepper"};
    d.drive = {kTypes[drive->type.index()],
               name(drive->body),
               name(drive->reaction),
               drive_values(*drive),
               {drive->bus.ticks, drive->bus.delay_ticks_out, drive->bus.delay_ticks_in}};
  }
  if (const auto &adc = model.adc[0])
    d.reading = {adc->signal, adc->per_count * (1 << (adc->bits - 8)), adc->bits, sampling(*adc)};
  if (const auto &encoder = model.encoder)
    d.encoder = {name(encoder->body), name(encoder->reference), encoder->scale};
  d.volts_per_code = model.dac->volts_per_code();
  d.volts_per_step = model.dac->volts_per_step();
  return table::object(d);
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
  table::add_results<LinearTable, StructureTable, ContactTable, DriveTable, ReadingTable,
                     EncoderTable, FactsTable>();
  m.def("linear", &linear, py::arg("model"), py::arg("inputs"), py::arg("outputs"),
        py::arg("overrides") = Overrides{}, py::arg("modes") = std::map<std::string, std::string>{},
        py::arg("free") = false, py::arg("drive") = true,
        "Returns A, B, C, D, the names of the states in one mode, and V per DAC code. See "
        "forceaxis.linear.linearise.");
  m.def("facts", &facts, py::arg("model"), py::arg("overrides") = Overrides{},
        "Returns the data of a model.");
  m.def("hessenberg_response", &response, py::arg("H"), py::arg("B"), py::arg("C"), py::arg("D"),
        py::arg("points"),
        "Returns C (s I - H)^-1 B + D as an array (points, outputs, inputs). H is an upper "
        "Hessenberg matrix.");
  add_extended(m);
}
