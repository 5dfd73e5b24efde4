#include "sim/hybrid/assembly.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>
#include <variant>

#include "sim/model/elements/all.hpp"

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
      points.push_back({{static_cast<int>(coordinates.size()), 1.0}});
      coordinates.push_back({position_state, velocity_state, body.mass});
      derivatives[static_cast<std::size_t>(position_state)] = {state(velocity_state)};
      name_signal(body.name + ".position", add_sum({state(position_state)}));
      name_signal(body.name + ".velocity", add_sum({state(velocity_state)}));
    }
    bodies_ = coordinates.size();
    add_structures(model);
    add_all(model.springs);
    add_all(model.dampers);
    add_all(model.contacts);
    add_all(model.backlashes);
    add_all(model.stops);
    add_all(model.gravities);
    add_all(model.coggings);
    add_all(model.externals);
    if (model.drive) add(*model.drive);
    // Frictions are added after all other forces, because the sum of these forces determines
    // whether a friction sticks.
    add_all(model.frictions);
    for (const Brake &brake : model.brakes) add(brake, model.frictions);
    add_accelerations(model.point_names());
    for (std::size_t channel = 0; channel < 2; ++channel)
      if (model.adc[channel]) add_adc(channel, *model.adc[channel]);
    for (const SignalInfo &signal : model.signal_list()) signal_wires.push_back(named(signal.name));
  }

 private:
  // Number of bodies; the first coordinates of the plant are their positions.
  std::size_t bodies_ = 0;

  template <class Element>
  void add_all(const std::vector<Element> &elements) {
    for (const Element &element : elements) add(element);
  }

  // Adds the ports and the modes of all structures. The states of these modes follow the states of
  // the bodies.
  void add_structures(const Model &model) {
    const std::size_t first = coordinates.size();
    for (const Structure &structure : model.structures) add(structure);
    for (std::size_t mode = first; mode < coordinates.size(); ++mode)
      points.push_back({{static_cast<int>(mode), 1.0}});
  }

  void add(const Structure &structure) {
    const auto first = static_cast<int>(coordinates.size());
    for (std::size_t i = 0; i < structure.modes.size(); ++i)
      add_mode(structure.name, i + 1, structure.modes[i]);
    for (std::size_t port = 0; port < structure.ports.size(); ++port) {
      Point shares;
      for (std::size_t i = 0; i < structure.modes.size(); ++i)
        if (const double factor = structure.modes[i].shape[port]; factor != 0.0)
          shares.push_back({first + static_cast<int>(i), factor});
      const auto index = static_cast<int>(points.size());
      points.push_back(std::move(shares));
      name_signal(structure.ports[port] + ".position", position_of(index));
      name_signal(structure.ports[port] + ".velocity", velocity_of(index));
    }
  }

  // A structural mode is modelled as a body that has the modal mass. A spring and a damper connect
  // this body to ground.
  void add_mode(const std::string &structure, std::size_t number, const Structure::Mode &mode) {
    const std::string name = structure + "." + std::to_string(number);
    const int position_state = add_state(name, 0.0);
    const int velocity_state = add_state(name, 0.0);
    coordinates.push_back({position_state, velocity_state, mode.mass});
    derivatives[static_cast<std::size_t>(position_state)] = {state(velocity_state)};
    if (mode.frequency_hz == 0.0) return;
    const Extended w = 2 * std::numbers::pi_v<Extended> * static_cast<Extended>(mode.frequency_hz);
    const Extended mass = mode.mass;
    Terms &rates = derivatives[static_cast<std::size_t>(velocity_state)];
    const Wire place = add_sum({state(position_state)});
    const Wire elastic = add_sum({wire(place, w * w * mass)});
    rates.push_back(wire(elastic, -1 / mass));
    storages.push_back({structure, elastic, place});
    if (mode.damping_ratio == 0.0) return;
    const Wire speed = add_sum({state(velocity_state)});
    const Wire drag = add_sum({wire(speed, 2 * Extended(mode.damping_ratio) * w * mass)});
    rates.push_back(wire(drag, -1 / mass));
    dampers.push_back({structure, drag, speed});
  }

  void add_accelerations(const std::vector<std::string> &names) {
    std::vector<Wire> accelerations;
    for (const Coordinate &coordinate : coordinates)
      accelerations.push_back(add_sum(derivatives[static_cast<std::size_t>(coordinate.velocity)]));
    for (std::size_t i = 0; i < names.size(); ++i) {
      Terms sum;
      for (const Share &share : points[i])
        sum.push_back(
            wire(accelerations[static_cast<std::size_t>(share.coordinate)], share.factor));
      name_signal(names[i] + ".acceleration", add_sum(std::move(sum)));
    }
  }

  LinkWires add_contact(const std::string &element, Wire deflection, Wire rate,
                        const Slopes &stiffness, double damping) {
    const Curve curve = Curve::through_origin(stiffness);
    const int segments = add_segments(element + ".stiffness", deflection, curve, false);
    const bool straight = segments == kAlways;
    const Extended only = stiffness.slopes.front();
    const Wire elastic = straight ? -1 : add_curve(segments, deflection, curve);
    const Term elastic_term = straight ? wire(deflection, only) : wire(elastic);
    const Wire force = add_sum({elastic_term, wire(rate, damping)});
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
    link.spring_force = while_pressed(elastic_term);
    std::vector<Terms> rates;
    for (const Curve::Segment &segment : curve.segments)
      rates.push_back({wire(rate, segment.slope)});
    link.spring_force_rate =
        while_pressed(straight ? wire(rate, only) : wire(add_select(segments, std::move(rates))));
    const Wire damper_force = while_pressed(wire(rate, damping));
    link.force = add_sum({wire(link.spring_force), wire(damper_force)});
    if (straight) {
      storages.push_back({element, link.spring_force, deflection});
    } else {
      const Product energy = stored(element, segments, curve, {elastic, deflection, 0});
      storages.push_back({element, while_pressed(wire(energy.first)), energy.second,
                          while_pressed(wire(energy.constant))});
    }
    if (damped) dampers.push_back({element, damper_force, rate});
    return link;
  }

  // Wires for the force and the input of a force curve. `zero` is the input in the curve's home
  // segment at which the stored energy is 0.
  struct Stored {
    Wire force;
    Wire deflection;
    Extended zero;
  };

  // Returns the stored energy of an element whose force is a piecewise-linear curve of its
  // deflection.
  Product stored(const std::string &name, int segments, const Curve &curve, Stored of) {
    // In a segment of the curve, the energy is E = 1/2 (f + f_b) (d - d_b) + E_b with the force f
    // and the deflection d. Index b marks the end of the segment that is nearer to the deflection
    // with energy 0.
    std::vector<Terms> first(curve.segments.size());
    std::vector<Terms> second = first;
    std::vector<Terms> base = first;
    const auto fill = [&](std::size_t k, Extended at, Extended energy) {
      const Extended there = curve.segments[k].slope * at + curve.segments[k].offset;
      first[k] = {wire(of.force), constant(there)};
      second[k] = {wire(of.deflection), constant(-at)};
      base[k] = {constant(energy)};
    };
    const auto energy_between = [&](std::size_t k, Extended a, Extended b) {
      const Curve::Segment &line = curve.segments[k];
      return (line.slope * (a + b) / 2 + line.offset) * (b - a);
    };
    const auto home = static_cast<std::size_t>(curve.home);
    fill(home, of.zero, 0);
    Extended at = of.zero;
    Extended energy = 0;
    for (std::size_t k = home; k < curve.breaks.size(); ++k) {
      energy += energy_between(k, at, curve.breaks[k]);
      at = curve.breaks[k];
      fill(k + 1, at, energy);
    }
    at = of.zero;
    energy = 0;
    for (std::size_t k = home; k-- > 0;) {
      energy += energy_between(k + 1, at, curve.breaks[k]);
      at = curve.breaks[k];
      fill(k, at, energy);
    }
    return {name, add_select(segments, std::move(first)), add_select(segments, std::move(second)),
            add_select(segments, std::move(base))};
  }

  // Wires of the arm of a standard linear solid, which is a spring and a dashpot in series.
  struct Arm {
    Wire force;  ///< force of the spring in N
    Wire rate;   ///< velocity of the dashpot in m/s
    Wire own;    ///< deflection of the spring in m
  };

  // Adds the extension of the dashpot as a state of the plant.
  int add_dashpot(const std::string &name) { return add_state(name + ".dashpot", 0.0); }

  Arm add_arm(const std::string &name, const Maxwell &maxwell, int dashpot, Wire deflection) {
    const Extended k = maxwell.stiffness;
    const Extended time = maxwell.time;
    Arm arm{};
    arm.own = add_sum({wire(deflection), state(dashpot, -1)});
    arm.force = add_sum({wire(arm.own, k)});
    arm.rate = add_sum({wire(arm.own, 1 / time)});
    derivatives[static_cast<std::size_t>(dashpot)] = {wire(arm.rate)};
    storages.push_back({name, arm.force, arm.own});
    dampers.push_back({name, arm.force, arm.rate});
    return arm;
  }

  void add(const Spring &spring) {
    const Wire deflection = deflection_of(spring.ends);
    const Wire rate = rate_of(spring.ends);
    const Curve curve = Curve::through_origin(spring.stiffness);
    const int segments = add_segments(spring.name, deflection, curve, false);
    const Wire spring_force = add_curve(segments, deflection, curve);
    const Wire damper_force = add_sum({wire(rate, spring.damping)});
    Terms elastic = {wire(spring_force)};
    Terms elastic_rate;
    if (spring.maxwell) {
      const Arm arm = add_arm(spring.name, *spring.maxwell, add_dashpot(spring.name), deflection);
      elastic.push_back(wire(arm.force));
      elastic_rate = {wire(rate, spring.maxwell->stiffness),
                      wire(arm.rate, -Extended(spring.maxwell->stiffness))};
    }
    Terms total = elastic;
    total.push_back(wire(damper_force));
    const Wire force = add_sum(std::move(total));
    std::vector<Terms> rates;
    for (const Curve::Segment &segment : curve.segments) {
      rates.push_back({wire(rate, segment.slope)});
      rates.back().insert(rates.back().end(), elastic_rate.begin(), elastic_rate.end());
    }
    push(spring.ends, force);
    if (segments != kAlways) {
      storages.push_back(stored(spring.name, segments, curve, {spring_force, deflection, 0}));
    } else if (spring.stiffness.slopes.front() > 0.0) {
      storages.push_back({spring.name, spring_force, deflection});
    }
    if (spring.damping > 0.0) dampers.push_back({spring.name, damper_force, rate});
    name_link(spring.name, {force, spring.maxwell ? add_sum(std::move(elastic)) : spring_force,
                            add_select(segments, std::move(rates)), deflection});
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

  // Adds a contact with the standard linear solid as material. While the contact is pressed, its
  // force is (k + m) d - m w, where d is the deflection and w is the extension of the dashpot.
  // While the contact is apart, its surface is at the deflection at which this force would be 0.
  LinkWires add_solid(const Contact &contact, Wire deflection, Wire rate) {
    const Extended k = contact.stiffness.slopes.front();
    const Extended m = contact.maxwell->stiffness;
    const int dashpot = add_dashpot(contact.name);
    const Wire meeting = add_sum({wire(deflection, k + m), state(dashpot, -m)});
    const int index = add_switch(contact.name, {"apart", "pressed"}, false, kApart);
    bounds.back()[kApart] = {{meeting, -kInfinity, 0.0, kApart, kPressed}};
    bounds.back()[kPressed] = {{meeting, 0.0, kInfinity, kApart, kPressed}};
    const Wire surface = add_select(index, {{state(dashpot, m / (k + m))}, {wire(deflection)}});
    const Arm arm = add_arm(contact.name, *contact.maxwell, dashpot, surface);
    const Wire spring = add_sum({wire(surface, k)});
    storages.push_back({contact.name, spring, surface});
    LinkWires link{};
    link.deflection = deflection;
    link.force = add_select(index, {{}, {wire(meeting)}});
    link.spring_force = link.force;
    link.spring_force_rate = add_select(index, {{}, {wire(rate, k + m), wire(arm.rate, -m)}});
    return link;
  }

  // Adds a contact with hysteresis. The slider moves only while the contact is pressed. When the
  // contact opens, the slider stops, because a surface without force stays at its place.
  LinkWires add_hysteresis(const Contact &contact, Wire deflection, Wire rate) {
    const Extended k = contact.stiffness.slopes.front();
    const Extended h = contact.hysteresis->stiffness;
    const double slip_force = contact.hysteresis->force;
    const std::string name = contact.name + ".hysteresis";
    const int stretch = add_state(name, 0.0);
    memories.push_back({stretch, deflection});
    const Wire own = add_sum({state(stretch)});
    const Wire own_force = add_sum({wire(own, h)});
    const Wire meeting = add_sum({wire(deflection, k), wire(own_force)});
    const int index = add_switch(contact.name, {"apart", "pressed"}, false, kApart);
    bounds.back()[kApart] = {{meeting, -kInfinity, 0.0, kApart, kPressed}};
    bounds.back()[kPressed] = {{meeting, 0.0, kInfinity, kApart, kPressed}};
    const Wire surface = add_select(index, {{wire(own, -h / k)}, {wire(deflection)}});
    const Wire surface_rate = add_select(index, {{}, {wire(rate)}});
    // Rates at which the slip of the slider ends, one for each direction. While the contact is
    // apart, both rates are outside their bounds, so the slip has ended. The force of the slider
    // cannot change then and is not watched.
    const Wire watched = add_select(index, {{}, {wire(own_force)}});
    const Wire onward = add_select(index, {{constant(-1)}, {wire(rate)}});
    const Wire backward = add_select(index, {{constant(1)}, {wire(rate)}});
    const int slider = add_switch(name, {"backward", "stuck", "forward"}, false, kStuck);
    auto &phases = bounds.back();
    phases[kBackward] = {{backward, -kInfinity, 0.0, kBackward, kStuck}};
    phases[kStuck] = {{watched, -slip_force, slip_force, kBackward, kForward}};
    phases[kForward] = {{onward, 0.0, kInfinity, kStuck, kForward}};
    const Wire own_rate = add_select(slider, {{}, {wire(surface_rate)}, {}});
    const Wire slip = add_select(slider, {{wire(surface_rate)}, {}, {wire(surface_rate)}});
    derivatives[static_cast<std::size_t>(stretch)] = {wire(own_rate)};
    storages.push_back({contact.name, add_sum({wire(surface, k)}), surface});
    storages.push_back({contact.name, own_force, own});
    dampers.push_back({contact.name, own_force, slip});
    LinkWires link{};
    link.deflection = deflection;
    link.force = add_select(index, {{}, {wire(meeting)}});
    link.spring_force = link.force;
    link.spring_force_rate = add_select(index, {{}, {wire(rate, k), wire(own_rate, h)}});
    return link;
  }

  void add(const Contact &contact) {
    const Wire deflection = deflection_of(contact.ends, contact.gap);
    const Wire rate = rate_of(contact.ends);
    const LinkWires link = contact.maxwell      ? add_solid(contact, deflection, rate)
                           : contact.hysteresis ? add_hysteresis(contact, deflection, rate)
                                                : add_contact(contact.name, deflection, rate,
                                                              contact.stiffness, contact.damping);
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
      const LinkWires flank = add_contact(stop.name + side, overlap, overlap_rate,
                                          {{stop.stiffness}, {}}, stop.damping);
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
    // In a model file, gravity acts only on bodies. linearise() uses this function to apply a force
    // to any point. A point that is not a body then has the mass 1 kg.
    const auto place_of_body = static_cast<std::size_t>(gravity.body);
    const double mass = place_of_body < bodies_ ? coordinates[place_of_body].mass : 1.0;
    std::vector<double> forces;
    for (const double acceleration : gravity.accelerations) forces.push_back(mass * acceleration);
    Wire force = -1;
    if (gravity.positions.empty()) {
      force = add_sum({constant(forces.front())});
    } else {
      const Wire place = position_of(gravity.body);
      const Curve curve = Curve::interpolated(gravity.positions, forces);
      force = add_curve(add_segments(gravity.name, place, curve, false), place, curve);
    }
    push({kGround, gravity.body}, force);
    supplies.push_back({gravity.name, force, velocity_of(gravity.body)});
    name_signal(gravity.name + ".force", force);
  }

  void add(const Cogging &cogging) {
    const Wire deflection = deflection_of(cogging.ends);
    const Wire rate = rate_of(cogging.ends);
    Curve curve = Curve::interpolated(cogging.places, cogging.forces);
    const double start = start_of(cogging.ends.a) - start_of(cogging.ends.b);
    curve.home = static_cast<int>(
        std::upper_bound(curve.breaks.begin(), curve.breaks.end(), start) - curve.breaks.begin());
    const int segments = add_segments(cogging.name, deflection, curve, false);
    const Wire force = add_curve(segments, deflection, curve);
    std::vector<Terms> rates;
    for (const Curve::Segment &segment : curve.segments)
      rates.push_back({wire(rate, segment.slope)});
    push(cogging.ends, force);
    storages.push_back(stored(cogging.name, segments, curve, {force, deflection, start}));
    name_link(cogging.name, {force, force, add_select(segments, std::move(rates)), deflection});
  }

  double start_of(int index) const {
    double place = 0.0;
    if (index == kGround) return place;
    for (const Share &share : point(index))
      place += share.factor * initial[static_cast<std::size_t>(coordinate_of(share).position)];
    return place;
  }

  // The time is a state of the plant that counts ticks, so its value at a tick is exact.
  void add(const External &external) {
    constexpr double kTicksPerS = 1500.0;
    if (clock < 0) {
      clock = add_apart("clock", 0.0);
      derivatives[static_cast<std::size_t>(clock)] = {constant(kTicksPerS)};
    }
    const Wire now = add_sum({state(clock)});
    std::vector<double> ticks;
    for (const double time : external.times) ticks.push_back(time * kTicksPerS);
    Curve curve = Curve::interpolated(ticks, external.forces);
    curve.segments.front().offset = 0;
    curve.segments.back().offset = 0;
    const int segments = add_segments(external.name, now, curve, false);
    const Wire force = add_curve(segments, now, curve);
    push({kGround, external.body}, force);
    supplies.push_back({external.name, force, velocity_of(external.body)});
    name_signal(external.name + ".force", force);
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
    const auto shares = [this](int end) {
      std::vector<StateShare> list;
      for (const Term &term : velocities(end, 1)) list.push_back({term.index, term.factor});
      return list;
    };
    frictions.push_back({index, shares(ends.a), shares(ends.b)});
    dampers.push_back({name, force, rate});
    const Wire none = add_sum({});
    name_link(name, {force, none, none, deflection});
  }

  int add_apart(std::string name, double start) {
    apart.push_back(add_state(std::move(name), start));
    return apart.back();
  }

  void add_adc(std::size_t channel, const Adc &adc) {
    const std::string name = "adc" + std::to_string(channel);
    Wire signal = add_slow_errors(name, adc, named(adc.signal));
    // With a filter, the saturation of the sensor changes the input of the filter and is part of
    // the network. Without a filter, the saturation acts only at the conversion.
    if ((adc.filter || adc.sinc_order > 0) && adc.sensor_limit)
      signal = add_clamp(name + ".sensor", signal, *adc.sensor_limit, false);
    if (adc.filter) {
      const int filtered = add_state(name + ".filtered", 0.0);
      const Extended a = *adc.filter;
      derivatives[static_cast<std::size_t>(filtered)] = {wire(signal, a), state(filtered, -a)};
      signal = add_sum({state(filtered)});
    }
    if (adc.sinc_order > 0) {
      if (adc.conditioning_limit)
        signal = add_clamp(name + ".conditioning", signal, *adc.conditioning_limit, false);
      add_integrals(channel, name, signal, adc.sinc_order);
    }
    adc_wires[channel] = signal;
  }

  // Returns the signal of a sensor with its creep and drift.
  Wire add_slow_errors(const std::string &name, const Adc &adc, Wire signal) {
    Terms sum = {wire(signal)};
    if (adc.creep) {
      const int crept = add_state(name + ".creep", 0.0);
      const Extended rate = 1 / static_cast<Extended>(adc.creep->time);
      derivatives[static_cast<std::size_t>(crept)] = {wire(signal, rate), state(crept, -rate)};
      sum.push_back(state(crept, adc.creep->share));
    }
    if (adc.drift) {
      const int drifted = add_apart(name + ".drift", 0.0);
      const Extended rate = 1 / static_cast<Extended>(adc.drift->time);
      derivatives[static_cast<std::size_t>(drifted)] = {constant(rate * adc.drift->final),
                                                        state(drifted, -rate)};
      sum.push_back(state(drifted));
    }
    return sum.size() > 1 ? add_sum(std::move(sum)) : signal;
  }

  // Adds the integrals of a signal that a filter of the converter needs (SincFilter). Their unit of
  // time is the tick.
  void add_integrals(std::size_t channel, const std::string &name, Wire signal, int count) {
    constexpr double kTicksPerS = 1500.0;
    Term integrand = wire(signal, kTicksPerS);
    for (int k = 1; k <= count; ++k) {
      const int integral = add_apart(name + ".integral" + std::to_string(k), 0.0);
      if (k == 1) filter_states[channel] = integral;
      derivatives[static_cast<std::size_t>(integral)] = {integrand};
      integrand = state(integral, kTicksPerS);
    }
  }

  void add_motor(const DcMotor &motor, Wire speed, Wire *force) {
    const int current = add_state("drive.current", 0.0);
    const int filtered = add_state("drive.tach_filtered", 0.0);
    drive_states.push_back(current);
    // Transmission ratio of the motor in rad/m.
    const Extended ratio = 1 / static_cast<Extended>(motor.r_trans);
    const Wire tach = add_sum({wire(speed, static_cast<Extended>(motor.k_tach) * ratio)});
    const Extended a = motor.a_preamp_fdbk;
    const Extended gain = a * static_cast<Extended>(motor.k_preamp_fdbk);
    Terms &filter = derivatives[static_cast<std::size_t>(filtered)];
    filter = {wire(tach, gain), state(filtered, -a)};
    Terms sum = {state(filtered, -1)};
    if (motor.input == DcMotor::Input::tach)
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

  // Adds the motor of a drive, with its current and its force. Returns the target of the current,
  // which is limited to the limits of the motor.
  Wire add_drive_motor(const DriveMotor &motor, Wire wanted, Wire speed, Wire *force) {
    const int current = add_state("drive.current", 0.0);
    drive_states.push_back(current);
    const Extended rate = motor.rate;
    Wire target = wanted;
    if (motor.peak_current) target = add_clamp("drive.peak", wanted, *motor.peak_current, true);
    if (motor.rated_current) target = add_rated(motor, current, wanted, target);
    const Wire slope = add_sum({wire(target, rate), state(current, -rate)});
    derivatives[static_cast<std::size_t>(current)] = {
        wire(add_select(kEnable, {{}, {wire(slope)}}))};
    *force = add_sum({state(current, motor.force_per_amp)});
    supplies.push_back({"drive", *force, speed});
    name_signal("drive.current", add_sum({state(current)}));
    name_signal("drive.target_current", add_select(kEnable, {{}, {wire(target)}}));
    return target;
  }

  // Returns the target of the motor current. While the mean current is too large, the target is
  // limited to a smaller value.
  Wire add_rated(const DriveMotor &motor, int current, Wire wanted, Wire at_peak) {
    const double rated = *motor.rated_current;
    const double rest = 0.5 * rated;
    const double time =
        motor.peak_time / std::log((*motor.peak_current - rest) / (*motor.peak_current - rated));
    const int mean = add_state("drive.mean_current", rest);
    const Wire flowing = add_sum({state(current)});
    const Curve size = Curve::dead_size(rest);
    const Wire load = add_curve(add_segments("drive.load", flowing, size, false), flowing, size);
    const Extended rate = 1 / static_cast<Extended>(time);
    derivatives[static_cast<std::size_t>(mean)] = {wire(load, rate), state(mean, -rate)};
    const Wire heat = add_sum({state(mean)});
    const Wire at_rated = add_clamp("drive.rated", wanted, rated, true);
    const int limit = add_switch("drive.foldback", {"peak", "rated"}, false, 0);
    bounds.back()[0] = {{heat, -kInfinity, rated, 0, 1}};
    bounds.back()[1] = {{heat, 0.75 * rated, kInfinity, 0, 1}};
    name_signal("drive.mean_current", heat);
    return add_select(limit, {{wire(at_peak)}, {wire(at_rated)}});
  }

  void add_torque(const TorqueDrive &torque, Wire speed, Wire *force) {
    const Extended damping = torque.damping;
    const Wire wanted = add_sum(
        {command(torque.current_per_volt), wire(speed, -damping / torque.motor.force_per_amp)});
    add_drive_motor(torque.motor, wanted, speed, force);
  }

  void add_velocity(const VelocityDrive &drive, Wire speed, Wire *force) {
    const Extended gain = static_cast<Extended>(drive.k_velocity) / drive.motor.force_per_amp;
    Terms sum = {command(gain * drive.velocity_per_volt), wire(speed, -gain)};
    int integral = -1;
    if (drive.integral_time) {
      integral = add_state("drive.integral", 0.0);
      drive_states.push_back(integral);
      sum.push_back(state(integral));
    }
    const Wire target = add_drive_motor(drive.motor, add_sum(std::move(sum)), speed, force);
    if (!drive.integral_time) return;
    const Extended rate = 1 / static_cast<Extended>(*drive.integral_time);
    const Wire slope = add_sum({wire(target, rate), state(integral, -rate)});
    derivatives[static_cast<std::size_t>(integral)] = {
        wire(add_select(kEnable, {{}, {wire(slope)}}))};
    name_signal("drive.integral", add_sum({state(integral)}));
  }

  // The load angle is a state, so that it can be reset when the drive is disabled. The reset
  // changes no other state.
  void add_stepper(const StepperDrive &stepper, Wire speed, Wire *force) {
    const int angle = add_state("drive.load_angle", 0.0);
    drive_states.push_back(angle);
    const Wire field = add_sum({command(stepper.velocity_per_volt)});
    const Wire slip = add_sum({wire(field), wire(speed, -1)});
    derivatives[static_cast<std::size_t>(angle)] = {wire(add_select(kEnable, {{}, {wire(slip)}}))};
    const Wire lead = add_sum({state(angle)});
    const Curve curve = Curve::sine(stepper.holding_force, 4.0 * stepper.full_step,
                                    stepper.segments, StepperDrive::kPeriods);
    const int segments = add_segments("drive.load_angle", lead, curve, true);
    const Wire pull = add_curve(segments, lead, curve);
    // In the first and the last segment of the curve, the motor has stalled.
    std::vector<Terms> drags(curve.segments.size(), Terms{wire(slip, stepper.damping)});
    drags.front() = drags.back() = {};
    const Wire turning = add_select(segments, std::move(drags));
    const Wire drag = add_select(kEnable, {{}, {wire(turning)}});
    *force = add_sum({wire(add_select(kEnable, {{}, {wire(pull)}})), wire(drag)});
    supplies.push_back({"drive", *force, field});
    storages.push_back(stored("drive", segments, curve, {pull, lead, 0}));
    if (stepper.damping > 0.0) dampers.push_back({"drive", drag, slip});
    name_signal("drive.load_angle", lead);
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
    } else if (const auto *torque = std::get_if<TorqueDrive>(&drive.type)) {
      add_torque(*torque, speed, &force);
    } else if (const auto *velocity = std::get_if<VelocityDrive>(&drive.type)) {
      add_velocity(*velocity, speed, &force);
    } else if (const auto *stepper = std::get_if<StepperDrive>(&drive.type)) {
      add_stepper(*stepper, speed, &force);
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
