#ifndef FIRMWARE_CORE_FORCE_CONTROL_H_
#define FIRMWARE_CORE_FORCE_CONTROL_H_

/* Force mode: applies the active force law to the state of the axis. force_control_step() has its
 * own source file, so that the compiler allocates registers for the other modes without regard to
 * this function. */

#include <stdint.h>

#include "firmware/core/axis_state.h"

/* Returns the command of force mode in this tick in 1/65536 DAC code, from force_gain alone or from
 * the selected bank. The integral of a bank changes only in contact, and never further beyond an
 * active limit of the DAC code. excitation_q16 is added after the limitation of the force law. The
 * signals must be those of this tick; only active_mode, limit_reason and command_code must be those
 * of the previous tick. */
int32_t force_control_step(axis_t *axis);

#endif
