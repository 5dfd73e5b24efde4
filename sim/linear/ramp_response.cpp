#include "sim/linear/ramp_response.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

namespace forceaxis::sim {
namespace {

using Complex = std::complex<double>;
using Extended = long double;
using Pair = RampResponse::Pair;
using ComplexPair = RampResponse::ComplexPair;

constexpr double kPeriodRamps = 30.0;       // ratio of the period of the set-point to the ramp time
constexpr std::size_t kHarmonics = 256;     // largest number of odd harmonics of the set-point that
                                            // are summed
constexpr std::size_t kPeriod = 2048;       // number of instants in a period of the response
constexpr std::size_t kPart = kPeriod / 8;  // number of points of one Fourier transform
constexpr double kHighestShare = 0.49;      // ratio of the highest harmonic's frequency to the tick
                                            // rate

// Largest permitted overshoot, as a fraction of the set-point.
constexpr double kOvershootMax = 0.055;
// Pairs of an instant in ramp times and the largest permitted undershoot from this instant to the
// instant of the next pair. The undershoot is a fraction of the set-point.
constexpr std::array<std::pair<double, double>, 2> kShortMax{{{1.25, 0.02}, {1.6, 0.025}}};

// Multiplies complex numbers. Unlike the operator of the standard library, this function does not
// test for infinities.
Complex times(Complex a, Complex b) {
  return {a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real()};
}

ComplexPair times(ComplexPair a, Complex b) {
  return {a.re * b.real() - a.im * b.imag(), a.re * b.imag() + a.im * b.real()};
}

// Returns e^(2 pi j share), computed with long double, because the functions for double of the C
// library depend on the processor.
Complex turned(Extended share) {
  const Extended angle = 2 * std::numbers::pi_v<Extended> * share;
  return {static_cast<double>(std::cos(angle)), static_cast<double>(std::sin(angle))};
}

// Returns the powers 0 .. kPeriod - 1 of e^(2 pi j / kPeriod).
const std::vector<Complex> &roots_of_one() {
  static const std::vector<Complex> roots = [] {
    std::vector<Complex> found;
    for (std::size_t i = 0; i < kPeriod; ++i) found.push_back(turned(Extended(i) / kPeriod));
    return found;
  }();
  return roots;
}

// Replaces `values` by their Fourier sums with e^(2 pi j m a / kPart) for a = 0 .. kPart - 1.
void transform(std::array<ComplexPair, kPart> &values) {
  const auto &roots = roots_of_one();
  for (std::size_t i = 1, j = 0; i < kPart; ++i) {
    std::size_t bit = kPart / 2;
    for (; (j & bit) != 0; bit /= 2) j ^= bit;
    j ^= bit;
    if (i < j) std::swap(values[i], values[j]);
  }
  for (std::size_t length = 2; length <= kPart; length *= 2)
    for (std::size_t k = 0; k < length / 2; ++k) {
      const Complex root = roots[k * (kPeriod / length)];
      for (std::size_t begin = k; begin < kPart; begin += length) {
        const ComplexPair even = values[begin];
        const ComplexPair odd = times(values[begin + length / 2], root);
        values[begin] = {even.re + odd.re, even.im + odd.im};
        values[begin + length / 2] = {even.re - odd.re, even.im - odd.im};
      }
    }
}

// Returns the set-point, from -1/2 to 1/2, at an instant in ramp times.
Extended setpoint_at(Extended ramps) {
  const Extended half = kPeriodRamps / 2;
  return std::clamp(ramps, 0.0L, 1.0L) - std::clamp(ramps - half, 0.0L, 1.0L) - 0.5L;
}

// Returns the spectrum of the set-point at its harmonic 2 m + 1.
std::complex<Extended> harmonic_of_setpoint(std::size_t m) {
  std::complex<Extended> sum = 0;
  for (std::size_t i = 0; i < kPeriod; ++i) {
    const Complex root = std::conj(roots_of_one()[(2 * m + 1) * i % kPeriod]);
    sum += setpoint_at(Extended(i) / kPeriod * kPeriodRamps) *
           std::complex<Extended>(root.real(), root.imag());
  }
  // The factor 2 adds the conjugate of each harmonic.
  return sum * (Extended{2} / kPeriod);
}

// Returns the largest excess of two forces over the permitted band, as a fraction of the set-point.
// `harmonics` has the odd harmonics of both forces. The sum over the harmonics 2 m + 1 at the
// instant 4 a + b of the first half of the period is element a of a Fourier transform over m,
// turned by the angle of the instant. The search ends at an excess above `most`.
double excess_of(std::span<const ComplexPair> harmonics, double most) {
  const auto &roots = roots_of_one();
  Pair high{};
  Pair low{};
  const auto raise = [](Pair &top, Pair value) { top = value > top ? value : top; };
  double worst = 0.0;
  std::array<ComplexPair, kPart> part;
  for (std::size_t b = 0; b < 4 && !(worst > most); ++b) {
    part.fill(ComplexPair{});
    for (std::size_t m = 0; m < harmonics.size(); ++m)
      part[m] = times(harmonics[m], roots[2 * m * b % kPeriod]);
    transform(part);
    for (std::size_t a = 0; a < kPart; ++a) {
      const Complex root = roots[4 * a + b];
      const Pair force = part[a].re * root.real() - part[a].im * root.imag() - 0.5;
      raise(high, force - kOvershootMax);
      const double ramps = static_cast<double>(4 * a + b) / kPeriod * kPeriodRamps;
      if (ramps > kShortMax[0].first)
        raise(low, -force - kShortMax[ramps < kShortMax[1].first ? 0 : 1].second);
    }
    worst = std::max({high[0], high[1], low[0], low[1]});
  }
  return worst;
}

}  // namespace

RampResponse::RampResponse(std::span<const ForcePlant *const> plants,
                           std::span<const int> delays_ticks, double ramp_s)
    : tick_s_(plants.front()->tick_s()) {
  const double period_s = kPeriodRamps * ramp_s;
  std::vector<double> hz;
  for (std::size_t m = 0; m < kHarmonics; ++m) {
    const double next = static_cast<double>(2 * m + 1) / period_s;
    if (next < kHighestShare / (tick_s_ * plants.front()->bus().ticks)) hz.push_back(next);
  }
  harmonics_ = hz.size();
  const int cycle = plants.front()->bus().ticks;
  std::vector<double> every_hz;
  for (int k = 0; k < cycle; ++k)
    for (const double own : hz) every_hz.push_back(alias_of(own, k, tick_s_, cycle));
  for (const double own : every_hz) w_.push_back(tangent_of(own, tick_s_));
  for (std::size_t m = 0; m < hz.size(); ++m) {
    const auto sum = harmonic_of_setpoint(m);
    setpoint_.emplace_back(static_cast<double>(sum.real()), static_cast<double>(sum.imag()));
  }
  std::vector<std::vector<Complex>> loops;
  for (const ForcePlant *plant : plants) {
    std::vector<Complex> values(w_.size());
    plant->held_response(w_, values);
    for (const int delay : delays_ticks) {
      auto &loop = loops.emplace_back();
      for (std::size_t i = 0; i < w_.size(); ++i)
        loop.push_back(times(values[i], turned(-Extended(every_hz[i]) * tick_s_ * delay)));
    }
  }
  for (std::size_t i = 0; i < loops.size(); i += 2) {
    const auto &first = loops[i];
    const auto &second = loops[std::min(i + 1, loops.size() - 1)];
    for (std::size_t m = 0; m < w_.size(); ++m)
      plants_.push_back(ComplexPair{Pair{first[m].real(), second[m].real()},
                                    Pair{first[m].imag(), second[m].imag()}});
  }
}

double RampResponse::excess(const LawShape &law, double gain, double most) const {
  const std::size_t count = w_.size();
  thread_local std::vector<Complex> response;
  response.resize(count);
  const double rate = law.integral_rad_per_s * tick_s_ / 2;
  for (std::size_t m = 0; m < count; ++m) {
    const double w = w_[m];
    Complex value(gain * (1 + rate), -gain * rate / w);
    for (const LawSection &s : law.sections) {
      const Complex upper(s.n0 - s.n2 * w * w, s.n1 * w);
      const Complex lower(s.d0 - s.d2 * w * w, -s.d1 * w);
      const double size = lower.real() * lower.real() + lower.imag() * lower.imag();
      value = times(value, times(upper, lower)) / size;
    }
    response[m] = value;
  }
  double worst = 0.0;
  std::array<ComplexPair, kHarmonics> closed;
  for (std::size_t begin = 0; begin < plants_.size() && !(worst > most); begin += count) {
    for (std::size_t m = 0; m < harmonics_; ++m) {
      // The set-point acts in each tick, so it has no alias frequencies.
      const auto [re, im] = times(plants_[begin + m], response[m]);
      ComplexPair loop{re, im};
      for (std::size_t k = m + harmonics_; k < count; k += harmonics_) {
        const auto [more_re, more_im] = times(plants_[begin + k], response[k]);
        loop.re += more_re;
        loop.im += more_im;
      }
      const Pair beyond = 1 + loop.re;
      const Pair size = beyond * beyond + loop.im * loop.im;
      closed[m] = times({(re * beyond + im * loop.im) / size, (im * beyond - re * loop.im) / size},
                        setpoint_[m]);
    }
    worst = std::max(worst, excess_of(std::span(closed).first(harmonics_), most));
  }
  return worst;
}

}  // namespace forceaxis::sim
