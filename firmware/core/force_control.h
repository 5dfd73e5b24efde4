#ifndef FIRMWARE_CORE_FORCE_CONTROL_H_
#define FIRMWARE_CORE_FORCE_CONTROL_H_

/* Force mode: the law that is in force around the state of the axis. A file of its own, so that the
 * other modes keep their registers. */

#include <stdint.h>

#include "firmware/core/axis_state.h"

/* Command of this tick in 1/65536 code: of force_gain alone, or of the selected bank, whose
 * integral grows only in contact and not against an active limit; with excitation_q16 added behind
 * the limits of the law. The signals are those of this tick, active_mode, limit_reason and
 * command_code those of the one before. */
int32_t force_control_step(axis_t *axis);

#endif
