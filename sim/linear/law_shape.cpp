#include "sim/linear/law_shape.hpp"

#include <algorithm>
#include <cmath>

#include "sim/linear/force_plant.hpp"

namespace forceaxis::sim {

LawSection LawSection::of(const std::array<double, 5> &coefficients) {
  const auto &[b0, b1, b2, a1, a2] = coefficients;
  return {b0 + b1 + b2, 2 * (b0 - b2), b0 - b1 + b2, 1 + a1 + a2, 2 * (1 - a2), 1 - a1 + a2};
}

LawSection LawSection::of(double zero_hz, double zero_damping, double pole_hz, double pole_damping,
                          double tick_s) {
  const double zero = tangent_of(zero_hz, tick_s);
  const double pole = tangent_of(pole_hz, tick_s);
  return {1, 2 * zero_damping / zero, 1 / (zero * zero),
          1, 2 * pole_damping / pole, 1 / (pole * pole)};
}

std::array<double, 5> LawSection::coefficients() const {
  const double scale = 1 / (d0 + d1 + d2);
  return {(n0 + n1 + n2) * scale, 2 * (n0 - n2) * scale, (n0 - n1 + n2) * scale,
          2 * (d0 - d2) * scale, (d0 - d1 + d2) * scale};
}

std::optional<LawShape> LawShape::of_logarithms(std::span<const double> numbers, double tick_s,
                                                double coefficient_max) {
  LawShape law;
  if (numbers.empty()) return law;
  // The exponential is computed with long double, because the C library's functions for double
  // depend on the processor.
  const auto exponential = [&](std::size_t i) {
    return static_cast<double>(std::exp(static_cast<long double>(numbers[i])));
  };
  law.integral_rad_per_s = exponential(0);
  if (!std::isfinite(law.integral_rad_per_s)) return std::nullopt;
  for (std::size_t i = 1; i + 3 < numbers.size(); i += 4) {
    const LawSection section = LawSection::of(exponential(i), exponential(i + 1),
                                              exponential(i + 2), exponential(i + 3), tick_s);
    for (const double c : section.coefficients())
      if (!(std::abs(c) <= coefficient_max)) return std::nullopt;
    law.sections.push_back(section);
  }
  return law;
}

std::complex<double> LawShape::at(double w, double tick_s) const {
  const double rate = integral_rad_per_s * tick_s / 2;
  std::complex<double> value(1 + rate, -rate / w);
  for (const LawSection &s : sections) {
    const std::complex<double> upper(s.n0 - s.n2 * w * w, s.n1 * w);
    const std::complex<double> lower(s.d0 - s.d2 * w * w, s.d1 * w);
    value *= upper / lower;
  }
  return value;
}

double LawShape::hf_gain() const {
  double direct = 1.0;
  double highest = 1.0;
  for (const LawSection &s : sections) {
    direct *= (s.n0 + s.n1 + s.n2) / (s.d0 + s.d1 + s.d2);
    highest *= s.n2 / s.d2;
  }
  return std::max(std::abs(direct), std::abs(highest));
}

}  // namespace forceaxis::sim
