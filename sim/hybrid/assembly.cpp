#include "sim/hybrid/assembly.hpp"

#include <limits>
#include <optional>
#include <utility>
#include <variant>

namespace forceaxis::sim {
namespace {

enum ContactState { kApart = 0, kPressed = 1, kOverlap = 2 };

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Builds a Wiring by adding one element of the model after the other.
class Assembly : public Wiring {
 public:
  explicit Assembly(const Model &model) {
    file = model.file;
    for (const Body &body : model.bodies) {
      const int position_state = add_state(body.name, body.position);
      const int velocity_state = add_state(body.name, body.velocity);
      bodies.push_back({position_state, velocity_state, body.mass});
      derivatives[static_cast<std::size_t>(position_state)] = {state(velocity_state)};
      name_signal(body.name + ".position", add_sum({state(position_state)}));
      name_signal(body.name + ".velocity", add_sum({state(velocity_state)}));
    }
    for (const Spring &spring : model.springs) add(spring);
    for (const Damper &damper : model.dampers) add(damper);
    for (const Contact &contact : model.contacts) add(contact);
    for (const Stop &stop : model.stops) add(stop);
    for (const Gravity &gravity : model.gravities) add(gravity);
    if (model.drive) add(*model.drive);
    // Frictions are added after all other forces, because the sum of these forces determines
    // whether a friction sticks.
    for (const Friction &friction : model.frictions) add(friction);
    for (const Brake &brake : model.brakes) add(brake, model.frictions);
    for (std::size_t i = 0; i < model.bodies.size(); ++i)
      name_signal(model.bodies[i].name + ".acceleration",
                  add_sum(derivatives[static_cast<std::size_t>(bodies[i].velocity)]));
    for (std::size_t channel = 0; channel < 2; ++channel)
      if (model.adc[channel]) add_adc(channel, *model.adc[channel]);
    for (const SignalInfo &signal : model.signal_list()) signal_wires.push_back(named(signal.name));
  }

 private:
  LinkWires add_contact(const std::string &element, Wire deflection, Wire rate, double stiffness,
                        double damping) {
    const Wire force = add_sum({wire(deflection, stiffness), wire(rate, damping)});
    const bool damped = damping > 0.0;
    std::vector<std::string> names = {"apart", "pressed"};
    if (damped) names.emplace_back("overlap");
    const int index = add_switch(element, std::move(names), false, kApart);
    auto &phases = bounds.back();
    phases[kApart] = {{deflection, -kInfinity, 0.0, kApart, kPressed}};
    // When a damped contact opens, its force becomes 0 before its overlap becomes 0. Without
    // damping, force and overlap become 0 at the same instant.
    if (damped) {
      phases[kPressed] = {{force, 0.0, kInfinity, kOverlap, kPressed}};
      phases[kOverlap] = {{deflection, 0.0, kInfinity, kApart, kOverlap},
                          {force, -kInfinity, 0.0, kOverlap, kPressed}};
    } else {
      phases[kPressed] = {{deflection, 0.0, kInfinity, kApart, kPressed}};
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
    storages.push_back({element, link.spring_force, deflection});
    if (damped) dampers.push_back({element, damper_force, rate});
    return link;
  }

  void add(const Spring &spring) {
    const Wire deflection = deflection_of(spring.ends);
    const Wire rate = rate_of(spring.ends);
    const Curve curve = Curve::through_origin(spring.stiffness);
    const int segments = add_segments(spring.name, deflection, curve, false);
    const Wire spring_force = add_curve(segments, deflection, curve);
    const Wire damper_force = add_sum({wire(rate, spring.damping)});
    const Wire force = add_sum({wire(spring_force), wire(damper_force)});
    std::vector<Terms> rates;
    for (const Curve::Segment &segment : curve.segments)
      rates.push_back({wire(rate, segment.slope)});
    push(spring.ends, force);
    if (segments != kAlways) {
      // The energy in a segment is E = 1/2 (f + f_b) (d - d_b) + E_b. Index b is the end of the
      // segment that is nearer to the origin.
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
      storages.push_back({spring.name, add_select(segments, std::move(first)),
                          add_select(segments, std::move(second)),
                          add_select(segments, std::move(base))});
    } else if (spring.stiffness.slopes.front() > 0.0) {
      storages.push_back({spring.name, spring_force, deflection});
    }
    if (spring.damping > 0.0) dampers.push_back({spring.name, damper_force, rate});
    name_link(spring.name,
              {force, spring_force, add_select(segments, std::move(rates)), deflection});
  }

  void add(const Damper &damper) {
    const Wire deflection = deflection_of(damper.ends);
    const Wire rate = rate_of(damper.ends);
    const Curve curve = Curve::through_origin(damper.damping);
    const Wire force = add_curve(add_segments(damper.name, rate, curve, false), rate, curve);
    push(damper.ends, force);
    dampers.push_back({damper.name, force, rate});
    const Wire none = add_sum({});
    name_link(damper.name, {force, none, none, deflection});
  }

  void add(const Contact &contact) {
    const LinkWires link = add_contact(contact.name, deflection_of(contact.ends, contact.gap),
                                       rate_of(contact.ends), contact.stiffness, contact.damping);
    push(contact.ends, link.force);
    name_link(contact.name, link);
  }

  // A stop consists of two contacts, one at each end of its range. The contact at the lower end has
  // all signs reversed.
  void add(const Stop &stop) {
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

  void add(const Gravity &gravity) {
    const BodyState &body = bodies[static_cast<std::size_t>(gravity.body)];
    std::vector<double> forces;
    for (const double acceleration : gravity.accelerations)
      forces.push_back(body.mass * acceleration);
    Wire force = -1;
    if (gravity.positions.empty()) {
      force = add_sum({constant(forces.front())});
    } else {
      const Wire place = add_sum({state(body.position)});
      const Curve curve = Curve::interpolated(gravity.positions, forces);
      force = add_curve(add_segments(gravity.name, place, curve, false), place, curve);
    }
    push({kGround, gravity.body}, force);
    supplies.push_back({gravity.name, force, add_sum({state(body.velocity)})});
    name_signal(gravity.name + ".force", force);
  }

  void add(const Friction &friction) {
    add_friction(friction.name, friction.ends, friction.coulomb, friction.stiction, false);
  }

  void add(const Brake &brake, const std::vector<Friction> &frictions_before) {
    const auto place = frictions.size();
    double beside_N = 0.0;
    for (std::size_t i = 0; i < frictions_before.size(); ++i) {
      const Ends other = frictions_before[i].ends;
      const bool same = (other.a == brake.ends.a && other.b == brake.ends.b) ||
                        (other.a == brake.ends.b && other.b == brake.ends.a);
      if (!same) continue;
      frictions[i].beside = static_cast<int>(place);
      beside_N = frictions_before[i].stiction;
    }
    // While a brake and a parallel friction stick, the brake also transmits the force of the
    // friction.
    add_friction(brake.name, brake.ends, brake.holding, brake.holding + beside_N, true);
    brakes.push_back({static_cast<int>(place), brake.release_s, brake.engage_s});
  }

  void add_friction(const std::string &name, Ends ends, double coulomb, double stiction,
                    bool is_brake) {
    const Wire deflection = deflection_of(ends);
    const Wire rate = rate_of(ends);
    std::vector<std::string> names = {"backward", "stuck", "forward"};
    const Extended sliding = coulomb;
    std::vector<Terms> forces = {
        {constant(-sliding)}, {hold(static_cast<int>(frictions.size()))}, {constant(sliding)}};
    if (is_brake) {
      names.emplace_back("released");
      forces.emplace_back();
    }
    const int index = add_switch(name, std::move(names), false, kStuck);
    switches.back().stuck = kStuck;
    if (is_brake) switches.back().analysed = kReleased;
    const Wire force = add_select(index, std::move(forces));
    auto &phases = bounds.back();
    phases[kBackward] = {{rate, -kInfinity, 0.0, kBackward, kStuck}};
    phases[kStuck] = {{force, -stiction, stiction, kBackward, kForward}};
    phases[kForward] = {{rate, 0.0, kInfinity, kStuck, kForward}};
    push(ends, force);
    const auto velocity_state = [this](int body) {
      return body == kGround ? -1 : bodies[static_cast<std::size_t>(body)].velocity;
    };
    frictions.push_back({index, velocity_state(ends.a), velocity_state(ends.b)});
    dampers.push_back({name, force, rate});
    const Wire none = add_sum({});
    name_link(name, {force, none, none, deflection});
  }

  void add_adc(std::size_t channel, const Adc &adc) {
    Wire signal = named(adc.signal);
    if (adc.filter) {
      // With a filter, the saturation of the sensor changes the input of the filter and is part of
      // the network. Without a filter, the saturation acts only at the conversion.
      if (adc.sensor_limit)
        signal = add_clamp("adc" + std::to_string(channel) + ".sensor", signal, *adc.sensor_limit,
                           false);
      const int filtered = add_state("adc" + std::to_string(channel) + ".filter", 0.0);
      const Extended a = *adc.filter;
      derivatives[static_cast<std::size_t>(filtered)] = {wire(signal, a), state(filtered, -a)};
      signal = add_sum({state(filtered)});
    }
    adc_wires[channel] = signal;
  }

  void add_motor(const DcMotor &motor, Wire speed, Wire *force) {
    const int current = add_state("drive.current", 0.0);
    const int filtered = add_state("drive.tach_filtered", 0.0);
    drive_states.push_back(current);
    // transmission ratio of the motor in rad/m
    const Extended ratio = 1 / static_cast<Extended>(motor.r_trans);
    const Wire tach = add_sum({wire(speed, static_cast<Extended>(motor.k_tach) * ratio)});
    const Extended a = motor.a_preamp_fdbk;
    const Extended gain = a * static_cast<Extended>(motor.k_preamp_fdbk);
    Terms &filter = derivatives[static_cast<std::size_t>(filtered)];
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
    const Curve amp = Curve::amplifier(motor.k_amp, motor.amp_break.value_or(kInfinity),
                                       motor.k_amp_outer, motor.supply_limit.value_or(kInfinity));
    const Wire output = add_curve(add_segments("drive.amplifier", error, amp, true), error, amp);
    const Wire back_emf = add_sum({wire(speed, static_cast<Extended>(motor.k_back_emf) * ratio)});
    const Extended l = motor.inductance;
    const Wire slope = add_sum({wire(output, 1 / l), wire(back_emf, -1 / l),
                                state(current, -static_cast<Extended>(motor.resistance) / l)});
    // While the drive is disabled, the bridge is open: the current is 0 and the voltage at the
    // terminals is the back EMF.
    derivatives[static_cast<std::size_t>(current)] = {
        wire(add_select(kEnable, {{}, {wire(slope)}}))};
    const Wire pull = add_sum({state(current, static_cast<Extended>(motor.k_torque) * ratio)});
    const Wire drag = add_sum({wire(speed, static_cast<Extended>(motor.b_m) * ratio * ratio)});
    *force = add_sum({wire(pull), wire(drag, -1)});
    supplies.push_back({"drive", pull, speed});
    if (motor.b_m > 0.0) dampers.push_back({"drive", drag, speed});
    name_signal("drive.current", add_sum({state(current)}));
    name_signal("drive.tach", tach);
    name_signal("drive.tach_filtered", add_sum({state(filtered)}));
    name_signal("drive.current_command", wanted);
    name_signal("drive.voltage", add_select(kEnable, {{wire(back_emf)}, {wire(output)}}));
  }

  void add(const Drive &drive) {
    const Wire speed = rate_of({drive.body, drive.reaction});
    const auto limited = [this](Wire force, std::optional<double> limit) {
      return limit ? add_clamp("drive.force", force, *limit, true) : force;
    };
    Wire force = -1;
    if (const auto *motor = std::get_if<DcMotor>(&drive.type)) {
      add_motor(*motor, speed, &force);
    } else if (const auto *simple = std::get_if<FirstOrderDrive>(&drive.type)) {
      const int actuator = add_state("drive.force", 0.0);
      drive_states.push_back(actuator);
      const Extended a = simple->a_act;
      const Extended k = simple->k_act;
      const Wire slope = add_sum({command(a * k * static_cast<Extended>(simple->velocity_per_volt)),
                                  wire(speed, -a * k), state(actuator, -a)});
      derivatives[static_cast<std::size_t>(actuator)] = {
          wire(add_select(kEnable, {{}, {wire(slope)}}))};
      force = limited(add_sum({state(actuator)}), simple->force_limit);
      supplies.push_back({"drive", force, speed});
    } else {
      const auto &perfect = std::get<PerfectDrive>(drive.type);
      const Wire wanted = add_sum({command(perfect.force_per_volt)});
      force = add_select(kEnable, {{}, {wire(limited(wanted, perfect.force_limit))}});
      supplies.push_back({"drive", force, speed});
    }
    // The drive accelerates its body forwards and the reaction body backwards, so the reaction body
    // is end a.
    push({drive.reaction, drive.body}, force);
    name_signal("drive.force", force);
    name_signal("drive.command", add_sum({command()}));
  }
};

}  // namespace

Wiring assemble(const Model &model) { return Assembly(model); }

}  // namespace forceaxis::sim
