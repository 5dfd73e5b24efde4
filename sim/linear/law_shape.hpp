#pragma once
// A force law of the firmware with the gain 1 (firmware/core/force_law.h), for frequency responses.
//
// At z = (1 + j w) / (1 - j w) with w = tan(pi f T), a second-order section is a quotient of two
// polynomials in j w with real coefficients, and the integral part is 1 + r T / 2 - j r T / (2 w).
// No complex division by z is needed, and no digits are lost at low frequencies.
#include <array>
#include <complex>
#include <optional>
#include <span>
#include <vector>

namespace forceaxis::sim {

/// A second-order section with the response ((n0 - n2 w^2) + j n1 w) / ((d0 - d2 w^2) + j d1 w).
struct LawSection {
  double n0, n1, n2, d0, d1, d2;

  /// Returns the section with the coefficients (b0, b1, b2, a1, a2) of the firmware.
  static LawSection of(const std::array<double, 5> &coefficients);
  /// Returns the section with the given zeros and poles, frequencies in Hz, for the sampling period
  /// `tick_s` in s. The section has the gain 1 at frequency 0.
  static LawSection of(double zero_hz, double zero_damping, double pole_hz, double pole_damping,
                       double tick_s);
  /// Returns the coefficients (b0, b1, b2, a1, a2) of the firmware.
  std::array<double, 5> coefficients() const;
};

struct LawShape {
  double integral_rad_per_s = 0.0;
  std::vector<LawSection> sections;

  /// Returns the law whose parameters have the natural logarithms `numbers`: integral rate in
  /// rad/s, then for each section zero frequency in Hz, zero damping, pole frequency in Hz, pole
  /// damping. Without numbers the law is 1. Returns nothing if a value is not finite, or if the
  /// magnitude of a coefficient of the firmware exceeds `coefficient_max`.
  static std::optional<LawShape> of_logarithms(std::span<const double> numbers, double tick_s,
                                               double coefficient_max);
  /// Returns the response at w = tan(pi f tick_s).
  std::complex<double> at(double w, double tick_s) const;
  /// Returns the gain at high frequency as the firmware computes it (law_bank_state()): the larger
  /// one of the direct path and of the gain at half the tick rate, without the integral.
  double hf_gain() const;
};

}  // namespace forceaxis::sim
