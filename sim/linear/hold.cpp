#include "sim/linear/hold.hpp"

#include <cmath>

namespace forceaxis::sim {

std::complex<double> Hold::at(double w) const {
  const std::complex<double> back =
      std::complex<double>(1, -w) / std::complex<double>(1, w);  // value of 1/z
  std::complex<double> turned = 1;
  for (int tick = 0; tick < bus_delay_ticks; ++tick) turned *= back;
  std::complex<double> sum = 0;
  for (int tick = 0; tick < bus_ticks; ++tick) {
    sum += turned;
    turned *= back;
  }
  sum /= static_cast<double>(bus_ticks);
  if (readings == 0) return sum;
  using Turn = std::complex<Extended>;
  const Extended angle = 2 * std::atan(Extended{w});  // phase angle of one tick in rad
  // The ages have equal distances, so their mean has the phase of the age in the middle.
  const Extended middle = least_age + (readings - 1) * between_ages / 2;
  const Extended half = angle * between_ages / 2;
  const Extended size =
      half == 0 ? Extended{1} : std::sin(readings * half) / (readings * std::sin(half));
  const Turn ages = size * std::polar(Extended{1}, -angle * middle);
  return sum * std::complex<double>(ages * filtered(angle));
}

// Returns the response of the converter's filter. `angle` is the phase angle of one tick in rad.
std::complex<Extended> Hold::filtered(Extended angle) const {
  const Extended half = angle * sample_ticks / 2;
  if (sinc_order == 0 || half == 0) return 1;
  return std::pow(std::sin(half) / half, sinc_order) * std::polar(Extended{1}, -half * sinc_order);
}

}  // namespace forceaxis::sim
