#ifndef FIRMWARE_CORE_FORCE_CONTROL_H_
#define FIRMWARE_CORE_FORCE_CONTROL_H_

/* Force mode: computes the active force law from the state of the axis. force_control_step() has
 * its own source file, so that the registers that it needs do not influence the code of the other
 * modes. */

#include <stdint.h>

#include "firmware/core/axis_state.h"

/* Returns the command of force mode in this tick, in 1/65536 DAC code. The command comes from the
 * selected filter bank, or from force_gain alone if no bank is selected. The integral of a bank
 * changes only in contact. While a limit of the DAC code is active, the integral does not move
 * further beyond this limit. excitation_q16 is added after the force law was limited. All signals
 * must be those of this tick, except active_mode, limit_reason and command_code, which must be
 * those of the previous tick. */
int32_t force_control_step(axis_t *axis);

#endif
