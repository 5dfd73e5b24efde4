#include "sim/hybrid/wiring.hpp"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <utility>

namespace forceaxis::sim {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

}  // namespace

int Wiring::add_state(std::string name, double start) {
  state_names.push_back(std::move(name));
  initial.push_back(start);
  derivatives.emplace_back();
  return static_cast<int>(initial.size()) - 1;
}

Wiring::Wire Wiring::add_select(int selector, std::vector<Terms> cases) {
  wires.push_back({selector, std::move(cases)});
  return static_cast<int>(wires.size()) - 1;
}

int Wiring::add_switch(std::string element, std::vector<std::string> names, bool of_drive,
                       int home) {
  int bits = 1;
  while ((std::size_t{1} << bits) < names.size()) ++bits;
  if (next_bit + bits > 64)
    throw InputError(
        file, element,
        "expected switching elements (contacts, stops, frictions, piecewise-linear "
        "curves) whose states need at most 63 bits together, got more; remove some of these "
        "elements");
  switches.push_back({std::move(element), std::move(names), next_bit, (ModeKey{1} << bits) - 1,
                      of_drive, home, -1});
  next_bit += bits;
  bounds.emplace_back(switches.back().state_names.size());
  return static_cast<int>(switches.size()) - 1;
}

int Wiring::add_segments(const std::string &element, Wire input, const Curve &curve,
                         bool of_drive) {
  if (curve.segments.size() == 1) return kAlways;
  std::vector<std::string> names;
  for (const Curve::Segment &segment : curve.segments) names.push_back(segment.name);
  const int index = add_switch(element, std::move(names), of_drive, curve.home);
  const int last = static_cast<int>(curve.breaks.size());
  for (int k = 0; k <= last; ++k) {
    const auto at = static_cast<std::size_t>(k);
    bounds.back()[at] = {{input, k > 0 ? curve.breaks[at - 1] : -kInfinity,
                          k < last ? curve.breaks[at] : kInfinity, k - 1, k + 1}};
  }
  return index;
}

Wiring::Wire Wiring::add_curve(int segments, Wire input, const Curve &curve) {
  std::vector<Terms> cases;
  for (const Curve::Segment &segment : curve.segments)
    cases.push_back({wire(input, segment.slope), constant(segment.offset)});
  return add_select(segments, std::move(cases));
}

Wiring::Wire Wiring::add_clamp(const std::string &element, Wire input, double limit,
                               bool of_drive) {
  const Curve curve = Curve::clamp(limit);
  return add_curve(add_segments(element, input, curve, of_drive), input, curve);
}

Wiring::Wire Wiring::deflection_of(Ends ends, double offset) {
  Terms sum = positions(ends.a, 1);
  for (const Term &term : positions(ends.b, -1)) sum.push_back(term);
  sum.push_back(constant(-Extended(offset)));
  return add_sum(std::move(sum));
}

Wiring::Wire Wiring::rate_of(Ends ends) {
  Terms sum = velocities(ends.a, 1);
  for (const Term &term : velocities(ends.b, -1)) sum.push_back(term);
  return add_sum(std::move(sum));
}

Wiring::Terms Wiring::positions(int index, Extended sign) const {
  Terms terms;
  if (index == kGround) return terms;
  for (const Share &share : point(index))
    terms.push_back(state(coordinate_of(share).position, sign * share.factor));
  return terms;
}

Wiring::Terms Wiring::velocities(int index, Extended sign) const {
  Terms terms;
  if (index == kGround) return terms;
  for (const Share &share : point(index))
    terms.push_back(state(coordinate_of(share).velocity, sign * share.factor));
  return terms;
}

void Wiring::push(Ends ends, Wire force) {
  const auto add = [&](int index, Extended sign) {
    if (index == kGround) return;
    for (const Share &share : point(index)) {
      const Coordinate &moved = coordinate_of(share);
      derivatives[static_cast<std::size_t>(moved.velocity)].push_back(
          wire(force, sign * share.factor / static_cast<Extended>(moved.mass)));
    }
  };
  add(ends.a, -1);
  add(ends.b, 1);
}

void Wiring::name_signal(const std::string &name, Wire wire_index) {
  named_wires.emplace_back(name, wire_index);
}

void Wiring::name_link(const std::string &name, const LinkWires &link) {
  name_signal(name + ".force", link.force);
  name_signal(name + ".spring_force", link.spring_force);
  name_signal(name + ".spring_force_rate", link.spring_force_rate);
  name_signal(name + ".deflection", link.deflection);
}

Wiring::Wire Wiring::named(const std::string &name) const {
  const auto found = std::find_if(named_wires.begin(), named_wires.end(),
                                  [&](const auto &entry) { return entry.first == name; });
  if (found == named_wires.end()) throw std::logic_error("no wire carries signal " + name);
  return found->second;
}

}  // namespace forceaxis::sim
