#include "sim/hybrid/network.hpp"

#include <Eigen/LU>
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

Network::Curve Network::through_origin(const Slopes &given) {
  Curve curve;
  curve.breaks = given.breaks;
  curve.home = static_cast<int>(
      std::count_if(given.breaks.begin(), given.breaks.end(), [](double at) { return at < 0.0; }));
  for (std::size_t k = 0; k < given.slopes.size(); ++k)
    curve.segments.push_back({"segment " + std::to_string(k), given.slopes[k], 0});
  // Neighbours meet at their break; the segment at 0 has no offset.
  const auto home = static_cast<std::size_t>(curve.home);
  const auto meet = [&curve](std::size_t next, std::size_t known, double at) {
    Curve::Segment &segment = curve.segments[next];
    const Curve::Segment &neighbour = curve.segments[known];
    segment.offset =
        neighbour.offset + (neighbour.slope - segment.slope) * static_cast<Extended>(at);
  };
  for (std::size_t k = home; k < given.breaks.size(); ++k) meet(k + 1, k, given.breaks[k]);
  for (std::size_t k = home; k-- > 0;) meet(k, k + 1, given.breaks[k]);
  return curve;
}

Network::Curve Network::interpolated(const std::vector<double> &x, const std::vector<double> &y) {
  Curve curve;
  curve.breaks = x;
  curve.segments.push_back({"segment 0", 0, y.front()});
  for (std::size_t k = 1; k < x.size(); ++k) {
    const Extended slope = (static_cast<Extended>(y[k]) - static_cast<Extended>(y[k - 1])) /
                           (static_cast<Extended>(x[k]) - static_cast<Extended>(x[k - 1]));
    const Extended offset = static_cast<Extended>(y[k]) - slope * static_cast<Extended>(x[k]);
    curve.segments.push_back({"segment " + std::to_string(k), slope, offset});
  }
  curve.segments.push_back({"segment " + std::to_string(x.size()), 0, y.back()});
  return curve;
}

int Network::add_state(double initial) {
  initial_.push_back(initial);
  derivatives_.emplace_back();
  return states() - 1;
}

Network::Wire Network::add_select(int selector, std::vector<Terms> cases) {
  wires_.push_back({selector, std::move(cases)});
  return wire_count() - 1;
}

int Network::add_switch(std::string element, std::vector<std::string> names, bool of_drive,
                        int home) {
  int bits = 1;
  while ((std::size_t{1} << bits) < names.size()) ++bits;
  if (next_bit_ + bits > 64)
    throw InputError(file_, element,
                     "expected switching elements (contacts, stops, frictions, piecewise-linear "
                     "curves) of no more than 63 bits together, got more; remove some");
  switches_.push_back({std::move(element), std::move(names), next_bit_, (ModeKey{1} << bits) - 1,
                       of_drive, home, -1});
  next_bit_ += bits;
  bounds_.emplace_back(switches_.back().state_names.size());
  return static_cast<int>(switches_.size()) - 1;
}

int Network::add_segments(const std::string &element, Wire input, const Curve &curve,
                          bool of_drive) {
  if (curve.segments.size() == 1) return kAlways;
  std::vector<std::string> names;
  for (const Curve::Segment &segment : curve.segments) names.push_back(segment.name);
  const int index = add_switch(element, std::move(names), of_drive, curve.home);
  const int last = static_cast<int>(curve.breaks.size());
  for (int k = 0; k <= last; ++k) {
    const auto at = static_cast<std::size_t>(k);
    bounds_.back()[at] = {{input, k > 0 ? curve.breaks[at - 1] : -kInfinity,
                           k < last ? curve.breaks[at] : kInfinity, k - 1, k + 1}};
  }
  return index;
}

Network::Wire Network::add_curve(int segments, Wire input, const Curve &curve) {
  std::vector<Terms> cases;
  for (const Curve::Segment &segment : curve.segments)
    cases.push_back({wire(input, segment.slope), constant(segment.offset)});
  return add_select(segments, std::move(cases));
}

Network::Wire Network::add_clamp(const std::string &element, Wire input, double limit,
                                 bool of_drive) {
  const Curve curve = clamp(limit);
  return add_curve(add_segments(element, input, curve, of_drive), input, curve);
}

Network::LinkWires Network::add_contact(const std::string &element, Wire deflection, Wire rate,
                                        double stiffness, double damping) {
  const Wire force = add_sum({wire(deflection, stiffness), wire(rate, damping)});
  const bool damped = damping > 0.0;
  std::vector<std::string> names = {"apart", "pressed"};
  if (damped) names.emplace_back("overlap");
  const int index = add_switch(element, std::move(names), false, kApart);
  auto &bounds = bounds_.back();
  bounds[kApart] = {{deflection, -kInfinity, 0.0, kApart, kPressed}};
  // The force reaches 0 before the overlap does; without damping both do at once.
  if (damped) {
    bounds[kPressed] = {{force, 0.0, kInfinity, kOverlap, kPressed}};
    bounds[kOverlap] = {{deflection, 0.0, kInfinity, kApart, kOverlap},
                        {force, -kInfinity, 0.0, kOverlap, kPressed}};
  } else {
    bounds[kPressed] = {{deflection, 0.0, kInfinity, kApart, kPressed}};
  }
  const auto while_pressed = [&](Term term) {
    std::vector<Terms> cases(damped ? 3 : 2);
    cases[kPressed] = {term};
    return add_select(index, std::move(cases));
  };
  LinkWires link{};
  link.deflection = deflection;
  link.spring_force = while_pressed(wire(deflection, stiffness));
  link.spring_force_rate = while_pressed(wire(rate, stiffness));
  const Wire damper_force = while_pressed(wire(rate, damping));
  link.force = add_sum({wire(link.spring_force), wire(damper_force)});
  storages_.push_back({element, link.spring_force, deflection});
  if (damped) dampers_.push_back({element, damper_force, rate});
  return link;
}

Network::Wire Network::deflection_of(Ends ends, double offset) {
  return add_sum({position(ends.a, 1), position(ends.b, -1), constant(-Extended(offset))});
}

Network::Wire Network::rate_of(Ends ends) {
  return add_sum({velocity(ends.a, 1), velocity(ends.b, -1)});
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

void Network::name_link(const std::string &name, const LinkWires &link) {
  name_signal(name + ".force", link.force);
  name_signal(name + ".spring_force", link.spring_force);
  name_signal(name + ".spring_force_rate", link.spring_force_rate);
  name_signal(name + ".deflection", link.deflection);
}

Network::Wire Network::named(const std::string &name) const {
  const auto found = std::find_if(named_.begin(), named_.end(),
                                  [&](const auto &entry) { return entry.first == name; });
  if (found == named_.end()) throw std::logic_error("no wire carries signal " + name);
  return found->second;
}

void Network::add_spring(const Spring &spring) {
  const Wire deflection = deflection_of(spring.ends);
  const Wire rate = rate_of(spring.ends);
  const Curve curve = through_origin(spring.stiffness);
  const int segments = add_segments(spring.name, deflection, curve, false);
  const Wire spring_force = add_curve(segments, deflection, curve);
  const Wire damper_force = add_sum({wire(rate, spring.damping)});
  const Wire force = add_sum({wire(spring_force), wire(damper_force)});
  std::vector<Terms> rates;
  for (const Curve::Segment &segment : curve.segments) rates.push_back({wire(rate, segment.slope)});
  push(spring.ends, force);
  if (segments != kAlways) {
    // From the break nearer to 0 on: E = 1/2 (f + f_b) (d - d_b) + E_b.
    std::vector<Terms> first(curve.segments.size());
    std::vector<Terms> second = first;
    std::vector<Terms> base = first;
    const auto fill = [&](std::size_t k, Extended at, Extended energy) {
      const Extended there = curve.segments[k].slope * at + curve.segments[k].offset;
      first[k] = {wire(spring_force), constant(there)};
      second[k] = {wire(deflection), constant(-at)};
      base[k] = {constant(energy)};
    };
    const auto energy_between = [&](std::size_t k, Extended a, Extended b) {
      const Curve::Segment &line = curve.segments[k];
      return (line.slope * (a + b) / 2 + line.offset) * (b - a);
    };
    const auto home = static_cast<std::size_t>(curve.home);
    fill(home, 0, 0);
    Extended at = 0;
    Extended energy = 0;
    for (std::size_t k = home; k < curve.breaks.size(); ++k) {
      energy += energy_between(k, at, curve.breaks[k]);
      at = curve.breaks[k];
      fill(k + 1, at, energy);
    }
    at = energy = 0;
    for (std::size_t k = home; k-- > 0;) {
      energy += energy_between(k + 1, at, curve.breaks[k]);
      at = curve.breaks[k];
      fill(k, at, energy);
    }
    storages_.push_back({spring.name, add_select(segments, std::move(first)),
                         add_select(segments, std::move(second)),
                         add_select(segments, std::move(base))});
  } else if (spring.stiffness.slopes.front() > 0.0) {
    storages_.push_back({spring.name, spring_force, deflection});
  }
  if (spring.damping > 0.0) dampers_.push_back({spring.name, damper_force, rate});
  name_link(spring.name, {force, spring_force, add_select(segments, std::move(rates)), deflection});
}

void Network::add_damper(const Damper &damper) {
  const Wire deflection = deflection_of(damper.ends);
  const Wire rate = rate_of(damper.ends);
  const Curve curve = through_origin(damper.damping);
  const Wire force = add_curve(add_segments(damper.name, rate, curve, false), rate, curve);
  push(damper.ends, force);
  dampers_.push_back({damper.name, force, rate});
  const Wire none = add_sum({});
  name_link(damper.name, {force, none, none, deflection});
}

// A contact on either side; the lower one sees everything the other way round.
void Network::add_stop(const Stop &stop) {
  const Wire deflection = deflection_of(stop.ends);
  const Wire rate = rate_of(stop.ends);
  LinkWires total{};
  Terms force;
  Terms spring_force;
  Terms spring_force_rate;
  const auto add_flank = [&](const char *side, double bound, Extended sign) {
    const Wire overlap =
        add_sum({wire(deflection, sign), constant(-sign * static_cast<Extended>(bound))});
    const Wire overlap_rate = add_sum({wire(rate, sign)});
    const LinkWires flank =
        add_contact(stop.name + side, overlap, overlap_rate, stop.stiffness, stop.damping);
    force.push_back(wire(flank.force, sign));
    spring_force.push_back(wire(flank.spring_force, sign));
    spring_force_rate.push_back(wire(flank.spring_force_rate, sign));
  };
  if (stop.low) add_flank(".low", *stop.low, -1);
  if (stop.high) add_flank(".high", *stop.high, 1);
  total = {add_sum(force), add_sum(spring_force), add_sum(spring_force_rate), deflection};
  push(stop.ends, total.force);
  name_link(stop.name, total);
}

void Network::add_gravity(const Gravity &gravity) {
  const BodyState &body = bodies_[static_cast<std::size_t>(gravity.body)];
  std::vector<double> forces;
  for (const double acceleration : gravity.accelerations)
    forces.push_back(body.mass * acceleration);
  Wire force = -1;
  if (gravity.positions.empty()) {
    force = add_sum({constant(forces.front())});
  } else {
    const Wire place = add_sum({state(body.position)});
    const Curve curve = interpolated(gravity.positions, forces);
    force = add_curve(add_segments(gravity.name, place, curve, false), place, curve);
  }
  push({kGround, gravity.body}, force);
  supplies_.push_back({gravity.name, force, add_sum({state(body.velocity)})});
  name_signal(gravity.name + ".force", force);
}

void Network::add_friction(const Friction &friction) {
  const Wire deflection = deflection_of(friction.ends);
  const Wire rate = rate_of(friction.ends);
  const int index = add_switch(friction.name, {"backward", "stuck", "forward"}, false, kStuck);
  switches_.back().stuck = kStuck;
  const Extended sliding = friction.coulomb;
  const Wire force = add_select(
      index,
      {{constant(-sliding)}, {hold(static_cast<int>(frictions_.size()))}, {constant(sliding)}});
  auto &bounds = bounds_.back();
  bounds[kBackward] = {{rate, -kInfinity, 0.0, kBackward, kStuck}};
  bounds[kStuck] = {{force, -friction.stiction, friction.stiction, kBackward, kForward}};
  bounds[kForward] = {{rate, 0.0, kInfinity, kStuck, kForward}};
  push(friction.ends, force);
  const auto velocity_state = [this](int body) {
    return body == kGround ? -1 : bodies_[static_cast<std::size_t>(body)].velocity;
  };
  frictions_.push_back({index, velocity_state(friction.ends.a), velocity_state(friction.ends.b)});
  dampers_.push_back({friction.name, force, rate});
  const Wire none = add_sum({});
  name_link(friction.name, {force, none, none, deflection});
}

void Network::add_adc(std::size_t channel, const Adc &adc) {
  Wire signal = named(adc.signal);
  if (adc.filter) {
    // Behind a filter a saturated sensor shows for a while; without one only at the conversion.
    if (adc.sensor_limit)
      signal =
          add_clamp("adc" + std::to_string(channel) + ".sensor", signal, *adc.sensor_limit, false);
    const int filtered = add_state(0.0);
    const Extended a = *adc.filter;
    derivatives_[static_cast<std::size_t>(filtered)] = {wire(signal, a), state(filtered, -a)};
    signal = add_sum({state(filtered)});
  }
  adc_wires_[channel] = signal;
}

void Network::add_motor(const DcMotor &motor, Wire speed, Wire *force) {
  const int current = add_state(0.0);
  const int filtered = add_state(0.0);
  drive_states_.push_back(current);
  const Extended ratio = 1 / static_cast<Extended>(motor.r_trans);  // rad/m
  const Wire tach = add_sum({wire(speed, static_cast<Extended>(motor.k_tach) * ratio)});
  const Extended a = motor.a_preamp_fdbk;
  const Extended gain = a * static_cast<Extended>(motor.k_preamp_fdbk);
  Terms &filter = derivatives_[static_cast<std::size_t>(filtered)];
  filter = {wire(tach, gain), state(filtered, -a)};
  Terms sum = {state(filtered, -1)};
  if (motor.input_tach)
    filter.push_back(command(gain));
  else
    sum.insert(sum.begin(), command(motor.k_preamp_cmd));
  const Wire raw = add_sum(std::move(sum));
  const Wire wanted =
      motor.preamp_limit ? add_clamp("drive.preamp", raw, *motor.preamp_limit, true) : raw;
  const Wire sensed = add_sum({state(current, motor.k_current)});
  const Wire feedback =
      motor.current_feedback_limit
          ? add_clamp("drive.current_feedback", sensed, *motor.current_feedback_limit, true)
          : sensed;
  const Wire error = add_sum({wire(wanted), wire(feedback, -1)});
  const Curve amp = amplifier(motor.k_amp, motor.amp_break.value_or(kInfinity), motor.k_amp_outer,
                              motor.supply_limit.value_or(kInfinity));
  const Wire output = add_curve(add_segments("drive.amplifier", error, amp, true), error, amp);
  const Wire back_emf = add_sum({wire(speed, static_cast<Extended>(motor.k_back_emf) * ratio)});
  const Extended l = motor.inductance;
  const Wire slope = add_sum({wire(output, 1 / l), wire(back_emf, -1 / l),
                              state(current, -static_cast<Extended>(motor.resistance) / l)});
  // Disabled, the bridge is open: no current, and the terminals show the back EMF.
  derivatives_[static_cast<std::size_t>(current)] = {
      wire(add_select(kEnable, {{}, {wire(slope)}}))};
  const Wire pull = add_sum({state(current, static_cast<Extended>(motor.k_torque) * ratio)});
  const Wire drag = add_sum({wire(speed, static_cast<Extended>(motor.b_m) * ratio * ratio)});
  *force = add_sum({wire(pull), wire(drag, -1)});
  supplies_.push_back({"drive", pull, speed});
  if (motor.b_m > 0.0) dampers_.push_back({"drive", drag, speed});
  name_signal("drive.current", add_sum({state(current)}));
  name_signal("drive.tach", tach);
  name_signal("drive.tach_filtered", add_sum({state(filtered)}));
  name_signal("drive.current_command", wanted);
  name_signal("drive.voltage", add_select(kEnable, {{wire(back_emf)}, {wire(output)}}));
}

void Network::add_drive(const Model &model) {
  const Drive &drive = *model.drive;
  const Wire speed = rate_of({drive.body, drive.reaction});
  const auto limited = [this](Wire force, std::optional<double> limit) {
    return limit ? add_clamp("drive.force", force, *limit, true) : force;
  };
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
    derivatives_[static_cast<std::size_t>(actuator)] = {
        wire(add_select(kEnable, {{}, {wire(slope)}}))};
    force = limited(add_sum({state(actuator)}), simple->force_limit);
    supplies_.push_back({"drive", force, speed});
  } else {
    const auto &perfect = std::get<PerfectDrive>(drive.type);
    const Wire wanted = add_sum({command(perfect.force_per_volt)});
    force = add_select(kEnable, {{}, {wire(limited(wanted, perfect.force_limit))}});
    supplies_.push_back({"drive", force, speed});
  }
  // The drive pushes its body forward, so the ends change places.
  push({drive.reaction, drive.body}, force);
  name_signal("drive.force", force);
  name_signal("drive.command", add_sum({command()}));
}

Network::Network(const Model &model) : file_(model.file) {
  for (const Body &body : model.bodies) {
    const int position_state = add_state(body.position);
    const int velocity_state = add_state(body.velocity);
    bodies_.push_back({position_state, velocity_state, body.mass});
    derivatives_[static_cast<std::size_t>(position_state)] = {state(velocity_state)};
    name_signal(body.name + ".position", add_sum({state(position_state)}));
    name_signal(body.name + ".velocity", add_sum({state(velocity_state)}));
  }
  for (const Spring &spring : model.springs) add_spring(spring);
  for (const Damper &damper : model.dampers) add_damper(damper);
  for (const Contact &contact : model.contacts) {
    const LinkWires link = add_contact(contact.name, deflection_of(contact.ends, contact.gap),
                                       rate_of(contact.ends), contact.stiffness, contact.damping);
    push(contact.ends, link.force);
    name_link(contact.name, link);
  }
  for (const Stop &stop : model.stops) add_stop(stop);
  for (const Gravity &gravity : model.gravities) add_gravity(gravity);
  if (model.drive) add_drive(model);
  // After all other forces: whether a friction holds depends on every one of them.
  for (const Friction &friction : model.frictions) add_friction(friction);
  for (std::size_t i = 0; i < model.bodies.size(); ++i)
    name_signal(model.bodies[i].name + ".acceleration",
                add_sum(derivatives_[static_cast<std::size_t>(bodies_[i].velocity)]));
  for (std::size_t channel = 0; channel < 2; ++channel)
    if (model.adc[channel]) add_adc(channel, *model.adc[channel]);
  for (const SignalInfo &signal : model.signal_list()) signal_wires_.push_back(named(signal.name));
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

// While the drive is disabled its switches mean nothing; the home state stands in.
int Network::effective_state(ModeKey key, int switch_index) const {
  const Switch &s = switches_[static_cast<std::size_t>(switch_index)];
  return s.of_drive && !enabled(key) ? s.home : state_of(key, switch_index);
}

ModeEquations Network::equations(ModeKey key) const {
  const int n = states();
  // The forces of frictions that stick are unknown: a column each, until solve_holds().
  std::vector<int> hold_column(frictions_.size(), -1);
  int wide = columns();
  for (std::size_t i = 0; i < frictions_.size(); ++i)
    if (state_of(key, frictions_[i].switch_index) == kStuck) hold_column[i] = wide++;

  ModeEquations result;
  result.wires = ExtendedMatrix::Zero(wire_count(), wide);
  const auto add_terms = [&](const Terms &terms, ExtendedMatrix &target, int row) {
    for (const Term &term : terms) {
      switch (term.of) {
        case Term::Of::state:
          target(row, term.index) += term.factor;
          break;
        case Term::Of::constant:
          target(row, n) += term.factor;
          break;
        case Term::Of::command:
          target(row, n + 1) += term.factor;
          break;
        case Term::Of::wire:
          for (int j = 0; j < wide; ++j)
            target(row, j) += term.factor * result.wires(term.index, j);
          break;
        case Term::Of::hold:
          target(row, hold_column[static_cast<std::size_t>(term.index)]) += term.factor;
          break;
      }
    }
  };
  for (int w = 0; w < wire_count(); ++w) {
    const WireNode &node = wires_[static_cast<std::size_t>(w)];
    const int chosen = node.selector == kAlways   ? 0
                       : node.selector == kEnable ? static_cast<int>(enabled(key))
                                                  : effective_state(key, node.selector);
    add_terms(node.cases[static_cast<std::size_t>(chosen)], result.wires, w);
  }
  result.flow = ExtendedMatrix::Zero(n, wide);
  for (int i = 0; i < n; ++i) add_terms(derivatives_[static_cast<std::size_t>(i)], result.flow, i);
  if (wide > columns()) solve_holds(key, result);

  for (std::size_t i = 0; i < switches_.size(); ++i) {
    if (switches_[i].of_drive && !enabled(key)) continue;
    const int index = static_cast<int>(i);
    for (const Bounds &b : bounds_[i][static_cast<std::size_t>(state_of(key, index))])
      result.channels.push_back({b.wire, index, b.low, b.high, b.state_below, b.state_above});
  }
  return result;
}

// Ends that stick keep their rate: (C A) z + (C G) h = 0 for the rates C z and the columns G that
// the forces h act by. C G is regular because frictions form no loop.
void Network::solve_holds(ModeKey key, ModeEquations &equations) const {
  const Eigen::Index n = states();
  const Eigen::Index c = columns();
  const Eigen::Index unknowns = equations.flow.cols() - c;
  ExtendedMatrix rate = ExtendedMatrix::Zero(unknowns, n);
  Eigen::Index row = 0;
  for (const FrictionEnds &friction : frictions_) {
    if (state_of(key, friction.switch_index) != kStuck) continue;
    if (friction.velocity_a >= 0) rate(row, friction.velocity_a) += 1;
    if (friction.velocity_b >= 0) rate(row, friction.velocity_b) -= 1;
    ++row;
  }
  const ExtendedMatrix acting = equations.flow.rightCols(unknowns);
  const Eigen::PartialPivLU<ExtendedMatrix> solver(ExtendedMatrix(rate * acting));
  const ExtendedMatrix hold = -solver.solve(ExtendedMatrix(rate * equations.flow.leftCols(c)));
  equations.flow = ExtendedMatrix(equations.flow.leftCols(c) + acting * hold);
  equations.wires =
      ExtendedMatrix(equations.wires.leftCols(c) + equations.wires.rightCols(unknowns) * hold);
  // What sticks to ground, or to what does, stays where it is: exactly.
  std::vector<bool> still(static_cast<std::size_t>(n), false);
  const auto is_still = [&still](int velocity) {
    return velocity < 0 || still[static_cast<std::size_t>(velocity)];
  };
  for (bool grown = true; grown;) {
    grown = false;
    for (const FrictionEnds &friction : frictions_) {
      if (state_of(key, friction.switch_index) != kStuck) continue;
      for (const auto &[end, other] : {std::pair(friction.velocity_a, friction.velocity_b),
                                       std::pair(friction.velocity_b, friction.velocity_a)}) {
        if (is_still(end) || !is_still(other)) continue;
        equations.flow.row(end).setZero();
        still[static_cast<std::size_t>(end)] = grown = true;
      }
    }
  }
  // The same forces as impulses take a rate away; only velocities feel them.
  ExtendedMatrix impulse = ExtendedMatrix::Zero(n, unknowns);
  for (const BodyState &body : bodies_) impulse.row(body.velocity) = acting.row(body.velocity);
  equations.slip = impulse * solver.solve(rate);
}

}  // namespace forceaxis::sim
