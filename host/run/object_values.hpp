#pragma once
// Converts the table [firmware] of an experiment to writes of raw values.
//
// A value is a text of an enumeration, true or false, a number in the unit of the object, the name
// of a model parameter, or a quantity (sim/model/units.hpp). A quantity in the unit of the object
// has the same effect as the number. Any other quantity is converted with the scales of the model
// and rounded to the nearest raw value:
// * A force in counts uses the scale of ADC 0 and `force_sign`. The quantity has the unit of the
//   signal of this ADC.
// * Positions, velocities and accelerations in counts use the scale of the encoder. Positions also
//   use the origin of the model. Objects that cannot be negative use the magnitude of the scale.
// * DAC codes use the scale of the DAC without its offset. Gains and impedances use both scales.
// * A force in per mille uses the object rated_force, from this table or from an earlier write.
// * Objects in ticks, ms, us, mN, uN or Hz need no scale of the model.
// A quantity is refused for an object whose unit has no scale in the model, such as increments of
// the motor's encoder. Quantities are also refused for positions and velocities of the drive if
// `polarity` or `home_offset` is not 0. A table bank_1 to bank_4 is a bank of the force law
// (bank_values.hpp). A table shaper_force or shaper_motion is an input shaper (shaper_values.hpp).
#include <cstdint>
#include <vector>

#include "sim/model/section.hpp"

namespace forceaxis::host {

// One write to an object of the firmware.
struct ObjectWrite {
  std::uint16_t object;
  std::int32_t raw;  // raw value of the object; the bits of an unsigned 32-bit value are kept
};

// Returns the writes of the table in the order that the firmware requires: parameters, commands,
// then `mode`. Marks every model parameter as used whose name is a value in the table. `before` has
// the initial writes, or is empty for the table of the initial writes. Throws sim::InputError.
std::vector<ObjectWrite> read_objects(sim::Section &section, const sim::Model &model,
                                      const std::vector<ObjectWrite> &before);

}  // namespace forceaxis::host
