#pragma once
// Converts an experiment's [firmware] table to writes of raw values.
//
// A value is an enum's text, true or false, a number in the object's unit, the name of a model
// parameter, or a quantity (sim/model/units.hpp). A quantity in the object's own unit stands for
// the number. Any other is converted with the model's scales, rounded to the nearest raw value:
// * counts of force through the scale of ADC 0 and `force_sign`, so in the unit of that ADC's
// signal;
// * counts of position, of velocity and of acceleration through the encoder's scale, from where the
//   model has 0; an object that is never negative uses the magnitude of that scale;
// * codes through the DAC's scale, without its offset; gains and impedance through both scales;
// * forces in per mille through rated_force, as it is written beside them or before;
// * ticks, ms, us, mN, uN, Hz by themselves.
// Refused by name: an object that measures nothing of that kind (increments of the motor's
// encoder), and positions and velocities of the drive under a `polarity` or `home_offset`.
// A table bank_1 to bank_4 is a bank of the force law (bank_values.hpp), shaper_force or
// shaper_motion a command shaper (shaper_values.hpp).
#include <cstdint>
#include <vector>

#include "sim/model/section.hpp"

namespace forceaxis::host {

// One write of a firmware object.
struct ObjectWrite {
  std::uint16_t object;
  std::int32_t raw;  // an unsigned object's bits
};

// The writes of the table in the order in which they are given: parameters, commands, `mode`. A
// parameter that is named is marked as used. `before` holds the initial writes, empty when these
// are read. Throws sim::InputError.
std::vector<ObjectWrite> read_objects(sim::Section &section, const sim::Model &model,
                                      const std::vector<ObjectWrite> &before);

}  // namespace forceaxis::host
