#include "sim/linear/linear.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <utility>

#include "sim/hybrid/network.hpp"
#include "sim/model/elements/all.hpp"

namespace forceaxis::sim {
namespace {

using std::string;

string listed(const std::vector<string> &names) {
  string text;
  for (const string &name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

ModeKey key_of(const Network &network, const Model &model, const LinearMode &mode) {
  auto states = mode.states;
  if (!mode.free)
    for (const Contact &contact : model.contacts) states.try_emplace(contact.name, "pressed");
  ModeKey key = network.analysed_key();
  const auto &switches = network.switches();
  for (const auto &[element, state] : states) {
    const auto found = std::find_if(switches.begin(), switches.end(),
                                    [&](const auto &s) { return s.element == element; });
    if (found == switches.end()) {
      std::vector<string> elements;
      for (const auto &s : switches) elements.push_back(s.element);
      throw InputError(
          model.file, element,
          "expected an element that switches (" + listed(elements) + "), got " + element);
    }
    const auto &names = found->state_names;
    const auto at = std::find(names.begin(), names.end(), state);
    if (at == names.end())
      throw InputError(model.file, element,
                       "expected one of its states (" + listed(names) + "), got " + state);
    key = network.with_state(key, static_cast<int>(found - switches.begin()),
                             static_cast<int>(at - names.begin()));
  }
  return key;
}

// Returns a copy of the model in which a perfect drive of 1 N/V replaces the drive, so the force is
// equal to the command. The signals of the original drive are removed.
Model without_drive(Model model) {
  if (!model.drive) return model;
  model.drive->type = PerfectDrive{1.0, std::nullopt};
  const auto signals = model.signal_list();
  for (auto &adc : model.adc)
    if (adc && std::none_of(signals.begin(), signals.end(),
                            [&](const SignalInfo &s) { return s.name == adc->signal; }))
      adc.reset();
  return model;
}

// Returns a copy of the model with an additional constant force on a point, in the form of gravity.
// The force changes the column of the constant 1. This change is the response of the plant,
// including sticking frictions.
Model pushed(Model model, int point, double force_N) {
  if (point == kGround) return model;
  const double mass =
      model.is_body(point) ? model.bodies[static_cast<std::size_t>(point)].mass : 1.0;
  model.gravities.push_back({"applied force", point, {force_N / mass}, {}});
  return model;
}

std::vector<string> state_names(const Network &network) {
  std::vector<string> names = network.state_names();
  for (const Wiring::Coordinate &moved : network.coordinates()) {
    names[static_cast<std::size_t>(moved.position)] += ".position";
    names[static_cast<std::size_t>(moved.velocity)] += ".velocity";
  }
  return names;
}

// Returns the names of the points of a network: bodies, ports and the modes of structures.
std::vector<string> pushed_names(const Model &model) {
  std::vector<string> names = model.point_names();
  for (const Structure &structure : model.structures)
    for (std::size_t i = 1; i <= structure.modes.size(); ++i)
      names.push_back(structure.name + "." + std::to_string(i));
  return names;
}

using RowVector = Eigen::Matrix<Extended, 1, Eigen::Dynamic>;

// Returns the row that gives an output from the vector (x, 1, u). Returns nothing if no output has
// this name.
std::optional<RowVector> output_row(const Model &model, const Network &network,
                                    const ModeEquations &equations, const string &name) {
  const auto adc = [&](std::size_t channel) -> std::optional<RowVector> {
    if (!model.adc[channel]) return std::nullopt;
    return equations.wires.row(network.adc_wires()[channel]);
  };
  if (name == "reading") return adc(0);
  if (name == "adc0" || name == "adc1") {
    const std::size_t channel = name == "adc1";
    auto row = adc(channel);
    if (row)
      *row /= static_cast<Extended>(model.adc[channel]->per_count) *
              static_cast<Extended>(1 << (model.adc[channel]->bits - 8));
    return row;
  }
  if (name == "encoder") {
    if (!model.encoder) return std::nullopt;
    RowVector row = RowVector::Zero(network.columns());
    const auto add = [&](int point, Extended factor) {
      if (point == kGround) return;
      for (const Wiring::Share &share : network.points()[static_cast<std::size_t>(point)])
        row(network.coordinates()[static_cast<std::size_t>(share.coordinate)].position) +=
            factor * share.factor;
    };
    add(model.encoder->body, model.encoder->scale);
    add(model.encoder->reference, -static_cast<Extended>(model.encoder->scale));
    return row;
  }
  const auto signals = model.signal_list();
  const auto found = std::find_if(signals.begin(), signals.end(),
                                  [&](const SignalInfo &s) { return s.name == name; });
  if (found == signals.end()) return std::nullopt;
  return equations.wires.row(
      network.signal_wires()[static_cast<std::size_t>(found - signals.begin())]);
}

[[noreturn]] void refuse_output(const Model &model, const string &name) {
  std::vector<string> names;
  for (const SignalInfo &signal : model.signal_list()) names.push_back(signal.name);
  for (std::size_t i = 0; i < 2; ++i)
    if (model.adc[i]) names.push_back("adc" + std::to_string(i));
  if (model.adc[0]) names.emplace_back("reading");
  if (model.encoder) names.emplace_back("encoder");
  throw InputError(model.file, "output", "expected one of " + listed(names) + ", got " + name);
}

[[noreturn]] void refuse_input(const Model &model, const string &name) {
  std::vector<string> names;
  if (model.drive) names = {"drive.command", "drive.tach", "drive.force"};
  for (const string &point : model.point_names()) names.push_back(point + ".force");
  throw InputError(model.file, "input", "expected one of " + listed(names) + ", got " + name);
}

// Sets the matrices A and C. The deflection of a hysteresis spring is expressed by the positions.
// While the slider sticks, it is the deflection of the contact plus a constant. Otherwise it is a
// constant. So it does not belong to the response.
void set_matrices(Linear &linear, const Network &network, const ModeEquations &equations,
                  const ExtendedMatrix &rows) {
  const Eigen::Index n = network.states();
  ExtendedMatrix flow = equations.flow.leftCols(n);
  ExtendedMatrix seen = rows.leftCols(n);
  for (const Wiring::Memory &memory : network.memories()) {
    if ((flow.row(memory.state).array() == 0).all()) continue;
    const RowVector deflection = equations.wires.row(memory.deflection).leftCols(n);
    flow += ExtendedMatrix(flow.col(memory.state) * deflection);
    seen += ExtendedMatrix(seen.col(memory.state) * deflection);
  }
  linear.A = flow.cast<double>();
  linear.C = seen.cast<double>();
}

// Removes a state that does not belong to the response.
void remove_state(Linear &linear, Eigen::Index at) {
  const Eigen::Index behind = linear.A.rows() - at - 1;
  const auto cut_rows = [&](Eigen::MatrixXd &m) {
    m.middleRows(at, behind) = m.bottomRows(behind).eval();
    m.conservativeResize(m.rows() - 1, Eigen::NoChange);
  };
  const auto cut_columns = [&](Eigen::MatrixXd &m) {
    m.middleCols(at, behind) = m.rightCols(behind).eval();
    m.conservativeResize(Eigen::NoChange, m.cols() - 1);
  };
  cut_rows(linear.A);
  cut_columns(linear.A);
  cut_rows(linear.B);
  cut_columns(linear.C);
  linear.states.erase(linear.states.begin() + at);
}

// Removes the states that do not belong to the response: those of Network::apart() and the springs
// of hystereses.
void remove_apart(Linear &linear, const Network &network) {
  std::vector<Eigen::Index> apart(network.apart().begin(), network.apart().end());
  for (const Wiring::Memory &memory : network.memories()) apart.push_back(memory.state);
  std::sort(apart.rbegin(), apart.rend());
  for (const Eigen::Index state : apart) remove_state(linear, state);
}

}  // namespace

std::vector<SwitchStates> switches_of(const Model &model) {
  std::vector<SwitchStates> list;
  const Network network(model);
  for (const auto &s : network.switches()) list.push_back({s.element, s.state_names});
  return list;
}

Linear linearise(const Model &given, const LinearMode &mode, std::span<const string> inputs,
                 std::span<const string> outputs) {
  const Model model = mode.drive ? given : without_drive(given);
  const Network network(model);
  const ModeKey key = key_of(network, model, mode);
  const ModeEquations equations = network.equations(key);
  const Eigen::Index n = network.states();
  const auto width = static_cast<Eigen::Index>(outputs.size());

  // Returns the rows that give all outputs from the vector (x, 1, u).
  const auto outputs_of = [&](const Model &of, const Network &with, const ModeEquations &e) {
    ExtendedMatrix rows(width, with.columns());
    for (Eigen::Index i = 0; i < width; ++i) {
      const auto row = output_row(of, with, e, outputs[static_cast<std::size_t>(i)]);
      if (!row) refuse_output(of, outputs[static_cast<std::size_t>(i)]);
      rows.row(i) = *row;
    }
    return rows;
  };
  const ExtendedMatrix rows = outputs_of(model, network, equations);

  Linear linear;
  linear.states = state_names(network);
  set_matrices(linear, network, equations, rows);
  linear.B.resize(n, static_cast<Eigen::Index>(inputs.size()));
  linear.D.resize(width, static_cast<Eigen::Index>(inputs.size()));
  for (std::size_t j = 0; j < inputs.size(); ++j) {
    const string &input = inputs[j];
    const auto at = static_cast<Eigen::Index>(j);
    const auto force = [&](int body, int reaction) {
      const Model moved = pushed(pushed(model, body, 1.0), reaction, -1.0);
      const Network with(moved);
      const ModeEquations e = with.equations(key);
      linear.B.col(at) = (e.flow.col(n) - equations.flow.col(n)).cast<double>();
      linear.D.col(at) = (outputs_of(moved, with, e).col(n) - rows.col(n)).cast<double>();
    };
    if (input == "drive.command" && model.drive && mode.drive) {
      linear.B.col(at) = equations.flow.col(n + 1).cast<double>();
      linear.D.col(at) = rows.col(n + 1).cast<double>();
    } else if (input == "drive.tach" && model.drive && mode.drive &&
               std::holds_alternative<DcMotor>(model.drive->type)) {
      Model moved = model;
      std::get<DcMotor>(moved.drive->type).input = DcMotor::Input::tach;
      const Network with(moved);
      const ModeEquations e = with.equations(key);
      linear.B.col(at) = e.flow.col(n + 1).cast<double>();
      linear.D.col(at) = outputs_of(moved, with, e).col(n + 1).cast<double>();
    } else if (input == "drive.force" && model.drive) {
      force(model.drive->body, model.drive->reaction);
    } else {
      const auto names = pushed_names(model);
      const auto point = std::find_if(names.begin(), names.end(),
                                      [&](const string &name) { return name + ".force" == input; });
      if (point == names.end()) refuse_input(model, input);
      force(static_cast<int>(point - names.begin()), kGround);
    }
  }
  remove_apart(linear, network);
  return linear;
}

}  // namespace forceaxis::sim
