#pragma once
// What a bus and the samples of a sensor do to the response of a plant.
#include <complex>

#include "sim/matrix/extended.hpp"

namespace forceaxis::sim {

/// The effect of the bus and of the sensor's samples on the response of a plant: the delay of the
/// command, the mean over the ticks for which the drive holds the command, and the ages of the
/// readings. Without a bus, the effect has the mean over all ages; this neglects that different
/// ages mix frequencies. Over a bus, the effect has the largest age. Without a known phase, the
/// ages are the largest possible ones.
struct Hold {
  int bus_ticks = 1, bus_delay_ticks = 0;  ///< cycle time of the bus, and delay of the command on
                                           ///< the bus, in ticks
  /// Number of different ages that a reading of the sensor can have; 0: the sensor samples at each
  /// tick.
  int readings = 0;
  /// Smallest age, and difference between two successive ages, in ticks.
  Extended least_age = 0, between_ages = 0;
  int sinc_order = 0;         ///< order of the converter's filter, 0 for none
  Extended sample_ticks = 0;  ///< period of the samples of the filter in ticks

  /// Returns the factor of the response at w = tan(pi f tick_s).
  std::complex<double> at(double w) const;
  bool operator==(const Hold &) const = default;

 private:
  std::complex<Extended> filtered(Extended angle) const;
};

}  // namespace forceaxis::sim
