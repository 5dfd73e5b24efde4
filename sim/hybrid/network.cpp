#include "sim/hybrid/network.hpp"

#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "sim/hybrid/assembly.hpp"

namespace forceaxis::sim {

Network::Network(const Model &model) : wiring_(assemble(model)) {}

ModeKey Network::home_key(bool enable) const {
  ModeKey key = enable ? 1U : 0U;
  for (std::size_t i = 0; i < wiring_.switches.size(); ++i)
    if (enable || !wiring_.switches[i].of_drive)
      key = with_state(key, static_cast<int>(i), wiring_.switches[i].home);
  return key;
}

ModeKey Network::analysed_key() const {
  ModeKey key = home_key(true);
  for (std::size_t i = 0; i < wiring_.switches.size(); ++i)
    if (const int analysed = wiring_.switches[i].analysed; analysed >= 0)
      key = with_state(key, static_cast<int>(i), analysed);
  return key;
}

ModeKey Network::with_enable(ModeKey key, bool enable) const {
  key = (key & ~ModeKey{1}) | (enable ? 1U : 0U);
  for (std::size_t i = 0; i < wiring_.switches.size(); ++i)
    if (wiring_.switches[i].of_drive)
      key = with_state(key, static_cast<int>(i), enable ? wiring_.switches[i].home : 0);
  return key;
}

// Returns the state of a switch. For a switch of a disabled drive, returns the home state, because
// this switch has no effect.
int Network::effective_state(ModeKey key, int switch_index) const {
  const Wiring::Switch &s = wiring_.switches[static_cast<std::size_t>(switch_index)];
  return s.of_drive && !enabled(key) ? s.home : state_of(key, switch_index);
}

ModeEquations Network::equations(ModeKey key) const {
  const int n = states();
  // The force of a sticking friction is unknown. This force has a separate column, which
  // solve_holds() eliminates.
  std::vector<int> hold_column(wiring_.frictions.size(), -1);
  int wide = columns();
  for (std::size_t i = 0; i < wiring_.frictions.size(); ++i)
    if (holds(key, wiring_.frictions[i])) hold_column[i] = wide++;

  ModeEquations result;
  result.wires = ExtendedMatrix::Zero(wire_count(), wide);
  const auto add_terms = [&](const Wiring::Terms &terms, ExtendedMatrix &target, int row) {
    for (const Wiring::Term &term : terms) {
      switch (term.of) {
        case Wiring::Term::Of::state:
          target(row, term.index) += term.factor;
          break;
        case Wiring::Term::Of::constant:
          target(row, n) += term.factor;
          break;
        case Wiring::Term::Of::command:
          target(row, n + 1) += term.factor;
          break;
        case Wiring::Term::Of::wire:
          for (int j = 0; j < wide; ++j)
            target(row, j) += term.factor * result.wires(term.index, j);
          break;
        case Wiring::Term::Of::hold:
          if (const int column = hold_column[static_cast<std::size_t>(term.index)]; column >= 0)
            target(row, column) += term.factor;
          break;
      }
    }
  };
  for (int w = 0; w < wire_count(); ++w) {
    const Wiring::WireNode &node = wiring_.wires[static_cast<std::size_t>(w)];
    const int chosen = node.selector == Wiring::kAlways   ? 0
                       : node.selector == Wiring::kEnable ? static_cast<int>(enabled(key))
                                                          : effective_state(key, node.selector);
    add_terms(node.cases[static_cast<std::size_t>(chosen)], result.wires, w);
  }
  result.flow = ExtendedMatrix::Zero(n, wide);
  for (int i = 0; i < n; ++i)
    add_terms(wiring_.derivatives[static_cast<std::size_t>(i)], result.flow, i);
  if (wide > columns()) solve_holds(key, result);

  for (std::size_t i = 0; i < wiring_.switches.size(); ++i) {
    if (wiring_.switches[i].of_drive && !enabled(key)) continue;
    const int index = static_cast<int>(i);
    for (const Wiring::Bounds &b :
         wiring_.bounds[i][static_cast<std::size_t>(state_of(key, index))])
      result.channels.push_back({b.wire, index, b.low, b.high, b.state_below, b.state_above});
  }
  return result;
}

// Computes the forces h of all sticking frictions. Their relative velocities C z do not change, so
// (C A) z + (C G) h = 0, where the columns of G are the effects of the forces h. C G is regular,
// because frictions form no loop.
void Network::solve_holds(ModeKey key, ModeEquations &equations) const {
  const Eigen::Index n = states();
  const Eigen::Index c = columns();
  const Eigen::Index unknowns = equations.flow.cols() - c;
  ExtendedMatrix rate = ExtendedMatrix::Zero(unknowns, n);
  Eigen::Index row = 0;
  for (const Wiring::FrictionEnds &friction : wiring_.frictions) {
    if (!holds(key, friction)) continue;
    for (const Wiring::StateShare &a : friction.velocity_a) rate(row, a.state) += a.factor;
    for (const Wiring::StateShare &b : friction.velocity_b) rate(row, b.state) -= b.factor;
    ++row;
  }
  const ExtendedMatrix acting = equations.flow.rightCols(unknowns);
  const Eigen::PartialPivLU<ExtendedMatrix> solver(ExtendedMatrix(rate * acting));
  const ExtendedMatrix hold = -solver.solve(ExtendedMatrix(rate * equations.flow.leftCols(c)));
  equations.flow = ExtendedMatrix(equations.flow.leftCols(c) + acting * hold);
  equations.wires =
      ExtendedMatrix(equations.wires.leftCols(c) + equations.wires.rightCols(unknowns) * hold);
  // A body that sticks to ground, directly or through other bodies, has a velocity of exactly 0. A
  // port with several modes has only a sum of velocities that is 0.
  std::vector<bool> still(static_cast<std::size_t>(n), false);
  const auto is_still = [&still](const std::vector<Wiring::StateShare> &velocity) {
    return std::all_of(velocity.begin(), velocity.end(), [&still](const Wiring::StateShare &share) {
      return still[static_cast<std::size_t>(share.state)];
    });
  };
  for (bool grown = true; grown;) {
    grown = false;
    for (const Wiring::FrictionEnds &friction : wiring_.frictions) {
      if (!holds(key, friction)) continue;
      for (const auto &[end, other] : {std::pair(&friction.velocity_a, &friction.velocity_b),
                                       std::pair(&friction.velocity_b, &friction.velocity_a)}) {
        if (end->size() != 1 || is_still(*end) || !is_still(*other)) continue;
        equations.flow.row(end->front().state).setZero();
        still[static_cast<std::size_t>(end->front().state)] = grown = true;
      }
    }
  }
  keep_memories(rate, equations);
  // The forces of sticking frictions, applied as impulses, remove a relative velocity. The impulses
  // change only velocities.
  ExtendedMatrix impulse = ExtendedMatrix::Zero(n, unknowns);
  for (const Wiring::Coordinate &moved : wiring_.coordinates)
    impulse.row(moved.velocity) = acting.row(moved.velocity);
  equations.slip = impulse * solver.solve(rate);
}

// The slider of a contact whose ends stick to each other does not move. Its derivative, a
// difference of two velocities, becomes exactly 0, because a difference of rounding errors in its
// higher derivatives would let it slip. The rows of `sticking` are the relative velocities that are
// 0.
void Network::keep_memories(const ExtendedMatrix &sticking, ModeEquations &equations) const {
  if (wiring_.memories.empty()) return;
  constexpr Extended kSame = 1e-12L;
  const Eigen::ColPivHouseholderQR<ExtendedMatrix> span(ExtendedMatrix(sticking.transpose()));
  for (const Wiring::Memory &memory : wiring_.memories) {
    ExtendedMatrix speed = ExtendedMatrix::Zero(states(), 1);
    for (const Wiring::Coordinate &moved : wiring_.coordinates)
      speed(moved.velocity, 0) = equations.wires(memory.deflection, moved.position);
    const ExtendedMatrix rest = speed - sticking.transpose() * ExtendedMatrix(span.solve(speed));
    if (rest.cwiseAbs().maxCoeff() <= kSame * speed.cwiseAbs().maxCoeff())
      equations.flow.row(memory.state).setZero();
  }
}

// Finds the state of the fastest motion. The entry (i, i) of a high power of |A| is the sum of all
// loops from state i through the other states. This entry is largest for the state of the fastest
// motion.
Network::Fastest Network::fastest(const ModeEquations &equations) const {
  const Eigen::Index n = states();
  const ExtendedMatrix size = equations.flow.leftCols(n).cwiseAbs();
  ExtendedMatrix even = ExtendedMatrix(size * size);
  for (int k = 0; k < 8; ++k) {
    even /= even.maxCoeff();
    even = ExtendedMatrix(even * even);
  }
  const auto has_wire = [](const Wiring::Terms &terms) {
    return std::any_of(terms.begin(), terms.end(),
                       [](const auto &term) { return term.of == Wiring::Term::Of::wire; });
  };
  Eigen::Index at = -1;
  for (Eigen::Index i = 0; i < n; ++i)
    if (has_wire(wiring_.derivatives[static_cast<std::size_t>(i)]) &&
        (at < 0 || even(i, i) > even(at, at)))
      at = i;
  const ExtendedMatrix odd = size * even;
  const auto state = static_cast<std::size_t>(at);
  Fastest result{
      wiring_.state_names[state], wiring_.state_names[state],
      static_cast<double>(std::sqrt((size.row(at) * odd.col(at)).value() / even(at, at)))};
  Extended largest = 0;
  for (const Wiring::Term &term : wiring_.derivatives[state]) {
    if (term.of != Wiring::Term::Of::wire) continue;
    const auto row = equations.wires.row(term.index).leftCols(n).cwiseAbs();
    const Extended share = std::abs(term.factor) * (row * odd.col(at)).value();
    const auto name = std::find_if(wiring_.named_wires.begin(), wiring_.named_wires.end(),
                                   [&](const auto &entry) { return entry.second == term.index; });
    if (!(share > largest) || name == wiring_.named_wires.end()) continue;
    largest = share;
    result.element = name->first;
  }
  result.element.resize(std::min(result.element.find('.'), result.element.size()));
  return result;
}

}  // namespace forceaxis::sim
