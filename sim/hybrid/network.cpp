#include "sim/hybrid/network.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace forceaxis::sim {
namespace {

enum ContactState { kApart = 0, kPressed = 1, kOverlap = 2 };

constexpr double kInfinity = std::numeric_limits<double>::infinity();

}  // namespace

Network::Curve Network::clamp(double limit) {
  Curve curve;
  curve.segments = {{"low limit", 0, -static_cast<Extended>(limit)},
                    {"linear", 1, 0},
                    {"high limit", 0, static_cast<Extended>(limit)}};
  curve.breaks = {-limit, limit};
  curve.home = 1;
  return curve;
}

Network::Curve Network::amplifier(double inner, double corner, double outer, double limit) {
  const Extended k = inner;
  const Extended ko = outer;
  const Extended step = (k - ko) * static_cast<Extended>(corner);  // outer line's value at 0
  Curve curve;
  curve.segments = {{"inner", k, 0}};
  const auto wrap = [&curve](const char *name, Extended slope, Extended offset, Extended at) {
    curve.segments.insert(curve.segments.begin(), {std::string("low ") + name, slope, -offset});
    curve.segments.push_back({std::string("high ") + name, slope, offset});
    curve.breaks.insert(curve.breaks.begin(), -static_cast<double>(at));
    curve.breaks.push_back(static_cast<double>(at));
    ++curve.home;
  };
  const bool corner_first =
      corner < kInfinity && k * static_cast<Extended>(corner) < static_cast<Extended>(limit);
  if (corner_first) wrap("outer", ko, step, corner);
  if (limit < kInfinity) {
    const Extended top = limit;
    if (!corner_first)
      wrap("limit", 0, top, top / k);
    else if (ko > 0)
      wrap("limit", 0, top, (top - step) / ko);
  }
  return curve;
}

int Network::add_state(double initial) {
  initial_.push_back(initial);
  derivatives_.emplace_back();
  return states() - 1;
}

Network::Wire Network::add_sum(std::vector<Term> terms) {
  wires_.push_back({WireNode::Kind::sum, std::move(terms), -1, -1, -1});
  return wire_count() - 1;
}

Network::Wire Network::add_gate(Wire on, Wire off) {
  wires_.push_back({WireNode::Kind::gate, {}, -1, on, off});
  return wire_count() - 1;
}

int Network::add_switch(std::string element, std::vector<std::string> names, bool of_drive,
                        int home) {
  int bits = 1;
  while ((std::size_t{1} << bits) < names.size()) ++bits;
  if (next_bit_ + bits > 64)
    throw std::length_error("the plant has more switching elements than a mode can name");
  switches_.push_back(
      {std::move(element), std::move(names), next_bit_, (ModeKey{1} << bits) - 1, of_drive, home});
  next_bit_ += bits;
  details_.emplace_back();
  return static_cast<int>(switches_.size()) - 1;
}

Network::Wire Network::add_curve(const std::string &element, Wire input, const Curve &curve) {
  if (curve.segments.size() == 1) return add_sum({wire(input, curve.segments[0].slope)});
  std::vector<std::string> names;
  for (const Curve::Segment &segment : curve.segments) names.push_back(segment.name);
  const int index = add_switch(element, std::move(names), true, curve.home);
  details_.back().curve = curve;
  details_.back().input = input;
  wires_.push_back({WireNode::Kind::curve, {wire(input)}, index, -1, -1});
  return wire_count() - 1;
}

Network::ContactWires Network::add_contact(const Contact &contact, Wire deflection, Wire rate) {
  const bool damped = contact.damping > 0.0;
  std::vector<std::string> names = {"apart", "pressed"};
  if (damped) names.emplace_back("overlap");
  const int index = add_switch(contact.name, std::move(names), false, kApart);
  SwitchDetail &detail = details_.back();
  detail.contact = true;
  detail.damped = damped;
  detail.input = deflection;
  detail.force = add_sum({wire(deflection, contact.stiffness), wire(rate, contact.damping)});
  wires_.push_back(
      {WireNode::Kind::contact_spring, {wire(deflection, contact.stiffness)}, index, -1, -1});
  const Wire spring_force = wire_count() - 1;
  wires_.push_back({WireNode::Kind::contact_damper, {wire(rate, contact.damping)}, index, -1, -1});
  const Wire damper_force = wire_count() - 1;
  return {add_sum({wire(spring_force), wire(damper_force)}), spring_force, damper_force};
}

Network::Term Network::position(int body, Extended factor) const {
  if (body == kGround) return constant(0);
  return state(bodies_[static_cast<std::size_t>(body)].position, factor);
}

Network::Term Network::velocity(int body, Extended factor) const {
  if (body == kGround) return constant(0);
  return state(bodies_[static_cast<std::size_t>(body)].velocity, factor);
}

// A positive force pushes end a back and end b forward.
void Network::push(Ends ends, Wire force) {
  const auto add = [&](int body, Extended sign) {
    if (body == kGround) return;
    const BodyState &moved = bodies_[static_cast<std::size_t>(body)];
    derivatives_[static_cast<std::size_t>(moved.velocity)].push_back(
        wire(force, sign / static_cast<Extended>(moved.mass)));
  };
  add(ends.a, -1);
  add(ends.b, 1);
}

void Network::name_signal(const std::string &name, Wire wire_index) {
  named_.emplace_back(name, wire_index);
}

void Network::add_motor(const DcMotor &motor, Wire speed, Wire *force) {
  const int current = add_state(0.0);
  const int filtered = add_state(0.0);
  drive_states_.push_back(current);
  const Extended ratio = 1 / static_cast<Extended>(motor.r_trans);  // rad/m
  const Wire tach = add_sum({wire(speed, static_cast<Extended>(motor.k_tach) * ratio)});
  const Extended a = motor.a_preamp_fdbk;
  derivatives_[static_cast<std::size_t>(filtered)] = {
      wire(tach, a * static_cast<Extended>(motor.k_preamp_fdbk)), state(filtered, -a)};

  const Wire raw = add_sum({command(motor.k_preamp_cmd), state(filtered, -1)});
  const Wire wanted =
      motor.preamp_limit ? add_curve("drive.preamp", raw, clamp(*motor.preamp_limit)) : raw;
  const Wire sensed = add_sum({state(current, motor.k_current)});
  const Wire feedback =
      motor.current_feedback_limit
          ? add_curve("drive.current_feedback", sensed, clamp(*motor.current_feedback_limit))
          : sensed;
  const Wire error = add_sum({wire(wanted), wire(feedback, -1)});
  const Wire output =
      add_curve("drive.amplifier", error,
                amplifier(motor.k_amp, motor.amp_break.value_or(kInfinity), motor.k_amp_outer,
                          motor.supply_limit.value_or(kInfinity)));
  const Wire back_emf = add_sum({wire(speed, static_cast<Extended>(motor.k_back_emf) * ratio)});
  const Extended l = motor.inductance;
  const Wire slope = add_sum({wire(output, 1 / l), wire(back_emf, -1 / l),
                              state(current, -static_cast<Extended>(motor.resistance) / l)});
  // Disabled, the bridge is open: no current, and the terminals show the back EMF.
  derivatives_[static_cast<std::size_t>(current)] = {wire(add_gate(slope, -1))};
  const Wire pull = add_sum({state(current, static_cast<Extended>(motor.k_torque) * ratio)});
  const Wire drag = add_sum({wire(speed, static_cast<Extended>(motor.b_m) * ratio * ratio)});
  *force = add_sum({wire(pull), wire(drag, -1)});
  supplies_.push_back({"drive", pull, speed});
  if (motor.b_m > 0.0) dampers_.push_back({"drive", drag, speed});
  name_signal("drive.current", add_sum({state(current)}));
  name_signal("drive.tach", tach);
  name_signal("drive.tach_filtered", add_sum({state(filtered)}));
  name_signal("drive.current_command", wanted);
  name_signal("drive.voltage", add_gate(output, back_emf));
}

void Network::add_drive(const Model &model) {
  const Drive &drive = *model.drive;
  const Wire speed = add_sum({velocity(drive.body, 1), velocity(drive.reaction, -1)});
  Wire force = -1;
  if (const auto *motor = std::get_if<DcMotor>(&drive.type)) {
    add_motor(*motor, speed, &force);
  } else if (const auto *simple = std::get_if<FirstOrderDrive>(&drive.type)) {
    const int actuator = add_state(0.0);
    drive_states_.push_back(actuator);
    const Extended a = simple->a_act;
    const Extended k = simple->k_act;
    const Wire slope = add_sum({command(a * k * static_cast<Extended>(simple->velocity_per_volt)),
                                wire(speed, -a * k), state(actuator, -a)});
    derivatives_[static_cast<std::size_t>(actuator)] = {wire(add_gate(slope, -1))};
    force = add_sum({state(actuator)});
    supplies_.push_back({"drive", force, speed});
  } else {
    const auto &perfect = std::get<PerfectDrive>(drive.type);
    force = add_gate(add_sum({command(perfect.force_per_volt)}), -1);
    supplies_.push_back({"drive", force, speed});
  }
  // The drive pushes its body forward, so the ends change places.
  push({drive.reaction, drive.body}, force);
  name_signal("drive.force", force);
  name_signal("drive.command", add_sum({command()}));
}

Network::Network(const Model &model) {
  for (const Body &body : model.bodies) {
    const int position_state = add_state(body.position);
    const int velocity_state = add_state(body.velocity);
    bodies_.push_back({position_state, velocity_state, body.mass});
    derivatives_[static_cast<std::size_t>(position_state)] = {state(velocity_state)};
    name_signal(body.name + ".position", add_sum({state(position_state)}));
    name_signal(body.name + ".velocity", add_sum({state(velocity_state)}));
  }
  const auto add_link = [&](const std::string &name, Ends ends, Extended stiffness,
                            Extended damping) {
    const Wire deflection = add_sum({position(ends.a, 1), position(ends.b, -1)});
    const Wire rate = add_sum({velocity(ends.a, 1), velocity(ends.b, -1)});
    const Wire spring_force = add_sum({wire(deflection, stiffness)});
    const Wire damper_force = add_sum({wire(rate, damping)});
    const Wire force = add_sum({wire(spring_force), wire(damper_force)});
    push(ends, force);
    if (stiffness > 0) storages_.push_back({name, spring_force, deflection});
    if (damping > 0) dampers_.push_back({name, damper_force, rate});
    name_signal(name + ".force", force);
    name_signal(name + ".spring_force", spring_force);
    name_signal(name + ".deflection", deflection);
  };
  for (const Spring &spring : model.springs)
    add_link(spring.name, spring.ends, spring.stiffness, spring.damping);
  for (const Damper &damper : model.dampers) add_link(damper.name, damper.ends, 0, damper.damping);
  for (const Contact &contact : model.contacts) {
    const Ends ends = contact.ends;
    const Wire deflection =
        add_sum({position(ends.a, 1), position(ends.b, -1), constant(-Extended(contact.gap))});
    const Wire rate = add_sum({velocity(ends.a, 1), velocity(ends.b, -1)});
    const ContactWires wires = add_contact(contact, deflection, rate);
    push(ends, wires.force);
    storages_.push_back({contact.name, wires.spring_force, deflection});
    if (contact.damping > 0.0) dampers_.push_back({contact.name, wires.damper_force, rate});
    name_signal(contact.name + ".force", wires.force);
    name_signal(contact.name + ".spring_force", wires.spring_force);
    name_signal(contact.name + ".deflection", deflection);
  }
  if (model.drive) add_drive(model);

  for (const SignalInfo &signal : model.signal_list()) {
    const auto found = std::find_if(named_.begin(), named_.end(),
                                    [&](const auto &entry) { return entry.first == signal.name; });
    if (found == named_.end()) throw std::logic_error("no wire carries signal " + signal.name);
    signal_wires_.push_back(found->second);
  }
}

ModeKey Network::home_key(bool enable) const {
  ModeKey key = enable ? 1U : 0U;
  for (std::size_t i = 0; i < switches_.size(); ++i)
    if (enable || !switches_[i].of_drive)
      key = with_state(key, static_cast<int>(i), switches_[i].home);
  return key;
}

ModeKey Network::with_enable(ModeKey key, bool enable) const {
  key = (key & ~ModeKey{1}) | (enable ? 1U : 0U);
  for (std::size_t i = 0; i < switches_.size(); ++i)
    if (switches_[i].of_drive)
      key = with_state(key, static_cast<int>(i), enable ? switches_[i].home : 0);
  return key;
}

ModeEquations Network::equations(ModeKey key) const {
  const int n = states();
  ModeEquations result;
  result.wires = ExtendedMatrix::Zero(wire_count(), columns());
  const auto add_terms = [&](const std::vector<Term> &terms, Extended scale, ExtendedMatrix &target,
                             int row) {
    for (const Term &term : terms) {
      const Extended factor = scale * term.factor;
      switch (term.of) {
        case Term::Of::state:
          target(row, term.index) += factor;
          break;
        case Term::Of::constant:
          target(row, n) += factor;
          break;
        case Term::Of::command:
          target(row, n + 1) += factor;
          break;
        case Term::Of::wire:
          for (int j = 0; j < columns(); ++j)
            target(row, j) += factor * result.wires(term.index, j);
          break;
      }
    }
  };
  const bool on = enabled(key);
  for (int w = 0; w < wire_count(); ++w) {
    const WireNode &node = wires_[static_cast<std::size_t>(w)];
    switch (node.kind) {
      case WireNode::Kind::sum:
        add_terms(node.terms, 1, result.wires, w);
        break;
      case WireNode::Kind::gate: {
        const int source = on ? node.on : node.off;
        if (source >= 0) result.wires.row(w) = result.wires.row(source);
        break;
      }
      case WireNode::Kind::curve: {
        const Curve &curve = details_[static_cast<std::size_t>(node.switch_index)].curve;
        // While the drive is disabled its switches mean nothing; the home segment stands in.
        const int segment = on ? state_of(key, node.switch_index) : curve.home;
        const Curve::Segment &line = curve.segments[static_cast<std::size_t>(segment)];
        add_terms(node.terms, line.slope, result.wires, w);
        result.wires(w, n) += line.offset;
        break;
      }
      case WireNode::Kind::contact_spring:
      case WireNode::Kind::contact_damper:
        if (state_of(key, node.switch_index) == kPressed) add_terms(node.terms, 1, result.wires, w);
        break;
    }
  }
  result.flow = ExtendedMatrix::Zero(n, columns());
  for (int i = 0; i < n; ++i)
    add_terms(derivatives_[static_cast<std::size_t>(i)], 1, result.flow, i);

  for (std::size_t i = 0; i < switches_.size(); ++i) {
    if (switches_[i].of_drive && !on) continue;
    const int index = static_cast<int>(i);
    const SwitchDetail &detail = details_[i];
    const int now = state_of(key, index);
    if (!detail.contact) {
      Channel channel{detail.input, index, -kInfinity, kInfinity, now, now};
      const auto segment = static_cast<std::size_t>(now);
      if (segment > 0)
        channel.low = detail.curve.breaks[segment - 1], channel.state_below = now - 1;
      if (segment < detail.curve.breaks.size())
        channel.high = detail.curve.breaks[segment], channel.state_above = now + 1;
      result.channels.push_back(channel);
    } else if (now == kApart) {
      result.channels.push_back({detail.input, index, -kInfinity, 0.0, now, kPressed});
    } else if (now == kPressed) {
      // The force reaches 0 before the overlap does; without damping both do at once.
      if (detail.damped)
        result.channels.push_back({detail.force, index, 0.0, kInfinity, kOverlap, now});
      else
        result.channels.push_back({detail.input, index, 0.0, kInfinity, kApart, now});
    } else {
      result.channels.push_back({detail.input, index, 0.0, kInfinity, kApart, now});
      result.channels.push_back({detail.force, index, -kInfinity, 0.0, now, kPressed});
    }
  }
  return result;
}

}  // namespace forceaxis::sim
