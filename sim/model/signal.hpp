#pragma once
#include <string>

#include "sim/model/units.hpp"

namespace forceaxis::sim {

/// A named true signal of a model, and the dimension of its value. LINK is an element with two
/// ends.
///   BODY.position m, BODY.velocity m/s
///   BODY.acceleration m/s^2: output of an accelerometer on the body
///   PORT.position m, PORT.velocity m/s, PORT.acceleration m/s^2, as those of a body
///   LINK.force N: a positive force accelerates end a backwards
///   LINK.spring_force N: force of the stiffness alone, as a strain gauge measures; 0 for a
///       damper, a friction and an open contact
///   LINK.spring_force_rate N/s: k d', the output of a velocity-sensing force sensor (6.2.1)
///   LINK.deflection m: overlap of a contact (a negative value is a gap), or x_a - x_b of a stop
///   GRAVITY.force N, EXTERNAL.force N
///   drive.force N, drive.command V: constant output of the DAC during a tick
///   for a dc_motor also drive.current A, drive.tach V (unfiltered), drive.tach_filtered V (vf),
///       drive.current_command V (c), drive.voltage V (vm; the back EMF while disabled)
///   for a torque or velocity drive also drive.current A, drive.target_current A (the limited c);
///       drive.mean_current A (h) with a rated current; drive.integral A (q) of a velocity drive
///       with an integral
///   for a stepper drive also drive.load_angle m (w)
struct SignalInfo {
  std::string name;
  Dimension dimension = Dimension::ratio;
};

}  // namespace forceaxis::sim
