#include "sim/hybrid/audit.hpp"

#include <algorithm>
#include <bit>

#include "sim/hybrid/series.hpp"

namespace forceaxis::sim {
namespace {

// Computes the integral of Phi(t)' q Phi(t) dt over 1, 1/2, ..., 2^-halvings ticks. Phi is the flow
// matrix of the mode, and q is a symmetric matrix. The Taylor series gives the integral over a
// short part of the tick. The length of the part is then doubled until the part is a tick.
class Gram {
 public:
  Gram(const ExtendedMatrix &a, Extended tick, std::size_t halvings) : tick_(tick) {
    const Influence scale = influence(a);
    BoundMatrix growth;
    parts_ <<= halvings;
    while ((order_ = absolute_series(a, parts_, scale, 0x1p-66, 28, &growth)) == 0) parts_ *= 2;
    b_ = a / static_cast<Extended>(parts_);
    if (halvings > 0) {
      const auto steps = static_cast<std::size_t>(std::countr_zero(parts_));
      for (const ExtendedMatrix &change : changes(a, steps, order_ + 4))
        flows_.push_back(ExtendedMatrix::Identity(a.rows(), a.cols()) + change);
      std::reverse(flows_.begin(), flows_.end());
      flows_.pop_back();
    } else if (parts_ > 1) {
      flows_.push_back(series(b_, order_ + 4));
      for (std::size_t k = parts_; k > 2; k /= 2)
        flows_.push_back(product(flows_.back(), flows_.back()));
    }
  }

  // The result with index k is the integral over 2^-k ticks. q must be symmetric.
  std::vector<ExtendedMatrix> operator()(const ExtendedMatrix &q) const {
    ExtendedMatrix term = q;
    ExtendedMatrix sum = q;
    for (int k = 1; k <= 2 * order_ + 8; ++k) {
      const ExtendedMatrix half = product(term, b_);  // Most entries of b_ are 0.
      const ExtendedMatrix mirrored = half.transpose();
      term = (half + mirrored) / static_cast<Extended>(k);
      sum += term / static_cast<Extended>(k + 1);
    }
    sum *= tick_ / static_cast<Extended>(parts_);
    std::vector<ExtendedMatrix> sums = {sum};
    for (const ExtendedMatrix &flow : flows_) {
      const ExtendedMatrix transposed = flow.transpose();
      sums.push_back(sums.back() + product(product(transposed, sums.back()), flow));
    }
    std::reverse(sums.begin(), sums.end());
    return sums;
  }

 private:
  Extended tick_;  // length of a tick in s
  std::size_t parts_ = 1;
  int order_ = 0;
  ExtendedMatrix b_;
  std::vector<ExtendedMatrix> flows_;  // matrices that advance the state by 1, 2, 4, ... intervals
                                       // of the time grid, up to half a tick
};

}  // namespace

EnergyRows energy_rows(const Network &network, const ModeEquations &equations) {
  EnergyRows rows;
  const auto add = [&](const Wiring::Product &pair, std::vector<double> *first,
                       std::vector<double> *second) {
    put_rows(equations.wires.row(pair.first), first);
    put_rows(equations.wires.row(pair.second), second);
  };
  for (const auto &pair : network.supplies()) add(pair, &rows.first, &rows.second);
  for (const auto &pair : network.dampers()) add(pair, &rows.first, &rows.second);
  for (const auto &pair : network.storages()) {
    add(pair, &rows.store_first, &rows.store_second);
    rows.store_constant.push_back(pair.constant < 0 ? 0.0
                                                    : static_cast<double>(equations.wires(
                                                          pair.constant, equations.flow.rows())));
  }
  return rows;
}

std::unique_ptr<const EnergyForms> build_energy_forms(const Network &network,
                                                      const ModeEquations &equations,
                                                      const ExtendedMatrix &a, Extended tick_s,
                                                      std::size_t halvings) {
  auto result = std::make_unique<EnergyForms>();
  EnergyForms &forms = *result;
  const Gram gram(a, tick_s, halvings);
  const auto c = static_cast<std::size_t>(a.cols());
  forms.stride = kernel::padded(network.supplies().size() + network.dampers().size());
  forms.over.assign(halvings + 1, kernel::Vector(forms.stride * c * c, 0.0));
  std::size_t place = 0;
  const auto add = [&](const Wiring::Product &pair) {
    const ExtendedMatrix first = equations.wires.row(pair.first);
    const ExtendedMatrix second = equations.wires.row(pair.second);
    const ExtendedMatrix outer = product(first.transpose(), second);
    const ExtendedMatrix mirrored = outer.transpose();
    const std::vector<ExtendedMatrix> integrals = gram((outer + mirrored) / 2);
    for (std::size_t k = 0; k <= halvings; ++k)
      for (std::size_t j = 0; j < c; ++j)
        for (std::size_t i = 0; i < c; ++i)
          forms.over[k][(j * c + i) * forms.stride + place] = static_cast<double>(
              integrals[k](static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)));
    ++place;
  };
  for (const auto &pair : network.supplies()) add(pair);
  for (const auto &pair : network.dampers()) add(pair);
  return result;
}

}  // namespace forceaxis::sim
