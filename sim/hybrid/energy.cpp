#include "sim/hybrid/energy.hpp"

namespace forceaxis::sim {
namespace {

// The reciprocals 1 / k of the integers k, each rounded once.
struct Reciprocals {
  double value[64];
  constexpr Reciprocals() : value{} {
    for (int k = 1; k < 64; ++k) value[k] = 1.0 / k;
  }
};
constexpr Reciprocals kReciprocal;

double stored_in(std::size_t storage, const Mode &mode, const double *z) {
  const std::size_t c = mode.columns;
  return 0.5 * kernel::dot(&mode.energy.store_first[storage * c], z, c) *
             kernel::dot(&mode.energy.store_second[storage * c], z, c) +
         mode.energy.store_constant[storage];
}

}  // namespace

std::vector<double> stored_energies(const Mode &mode, const double *z) {
  std::vector<double> energies;
  for (std::size_t i = 0; i < mode.energy.store_constant.size(); ++i)
    energies.push_back(stored_in(i, mode, z));
  return energies;
}

EnergyAccount::EnergyAccount(const Network &network)
    : supplied_(network.supplies().size()), dissipated_(network.dampers().size()) {}

void EnergyAccount::Sum::add(double term) {
  const double next = value + term;
  lost += kernel::magnitude(value) >= kernel::magnitude(term) ? (value - next) + term
                                                              : (term - next) + value;
  value = next;
}

void EnergyAccount::add_whole(const EnergyForms &forms, const double *z, std::size_t halvings) {
  const std::size_t c = mode_->columns;
  if (products_.size() < forms.stride * c) products_.resize(forms.stride * c);
  if (integrals_.size() < forms.stride) integrals_.resize(forms.stride);
  // The product of all quadratic forms with z is a matrix stored by columns. The product of this
  // matrix with z gives the integrals.
  multiply_(forms.over[halvings].data(), forms.stride * c, z, c, products_.data());
  multiply_(products_.data(), forms.stride, z, c, integrals_.data());
  const double *value = integrals_.data();
  for (Sum &sum : supplied_) sum.add(*value++);
  for (Sum &sum : dissipated_) sum.add(*value++);
}

// Adds the energies of s ticks from the start of the Taylor expansion. Each power is a product of
// two polynomials, which is integrated term by term.
void EnergyAccount::add_part(const double *z, const double *chain, double s, double rate_hz) {
  const Mode &m = *mode_;
  const std::size_t c = m.columns;
  const auto integral = [&](std::size_t product) {
    double a[64];
    double b[64];
    double power = 1.0;
    for (std::size_t k = 0; k <= m.order; ++k, power *= s) {
      const double *x = chain + k * m.flow_stride;
      a[k] = kernel::dot(&m.energy.first[product * c], k == 0 ? z : x, k == 0 ? c : m.states);
      b[k] = kernel::dot(&m.energy.second[product * c], k == 0 ? z : x, k == 0 ? c : m.states);
      a[k] *= power;
      b[k] *= power;
    }
    double sum = 0.0;
    for (std::size_t degree = 2 * m.order + 1; degree-- > 0;) {
      double coefficient = 0.0;
      const std::size_t from = degree > m.order ? degree - m.order : 0;
      const std::size_t to = degree < m.order ? degree : m.order;
      for (std::size_t i = from; i <= to; ++i) coefficient += a[i] * b[degree - i];
      sum += coefficient * kReciprocal.value[degree + 1];
    }
    return sum * s / rate_hz;
  };
  for (std::size_t i = 0; i < supplied_.size(); ++i) supplied_[i].add(integral(i));
  for (std::size_t i = 0; i < dissipated_.size(); ++i)
    dissipated_[i].add(integral(supplied_.size() + i));
}

double EnergyAccount::stored(const double *z) const {
  double sum = 0.0;
  for (std::size_t i = 0; i < mode_->energy.store_constant.size(); ++i)
    sum += stored_in(i, *mode_, z);
  return sum;
}

EnergyIntegrals EnergyAccount::integrals() const {
  EnergyIntegrals result;
  for (const Sum &sum : supplied_) result.supplied.push_back(sum.total());
  for (const Sum &sum : dissipated_) result.dissipated.push_back(sum.total());
  result.discarded = discarded_.total();
  result.impulse = impulse_.total();
  return result;
}

}  // namespace forceaxis::sim
