#ifndef FIRMWARE_CORE_FORCE_CONTROL_H_
#define FIRMWARE_CORE_FORCE_CONTROL_H_

/* Force mode: applies the active force law to the state of the axis. The function has a file of its
 * own, so that the compiler allocates the registers of the other modes without it. */

#include <stdint.h>

#include "firmware/core/axis_state.h"

/* Returns the command of this tick in 1/65536 DAC code, from force_gain alone or from the selected
 * bank. The integral of a bank grows only in contact and never further beyond an active limit.
 * excitation_q16 is added after the limits of the law. The signals must be those of this tick, but
 * active_mode, limit_reason and command_code must be those of the previous tick. */
int32_t force_control_step(axis_t *axis);

#endif
