#ifndef FIRMWARE_CORE_MODES_H_
#define FIRMWARE_CORE_MODES_H_

/* Modes and the changes between them: one pure function. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/generated/axis_objects.h"

/* The mode of this tick, AXIS_MODE_..., from the requested one and whether a fault is latched.
 * Every mode can follow every other one, because the change leaves no bump. */
static inline uint8_t mode_next(uint8_t requested, bool faulted) {
  return faulted ? (uint8_t)AXIS_MODE_DISABLED : requested;
}

/* True if the mode drives the amplifier. */
static inline bool mode_is_enabled(uint8_t mode) { return mode != AXIS_MODE_DISABLED; }

#endif
