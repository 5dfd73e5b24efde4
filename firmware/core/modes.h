#ifndef FIRMWARE_CORE_MODES_H_
#define FIRMWARE_CORE_MODES_H_

/* Modes and the changes between them: const tables driven by one pure function. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/generated/axis_objects.h"

/* Row: the mode of the last tick; column: the requested mode, both in the order disabled, open
 * loop, position, force. Every mode can follow every other one, because the change leaves no bump;
 * a mode that could not would show it here. */
static const uint8_t mode_table[AXIS_MODE_COUNT][AXIS_MODE_COUNT] = {
    {AXIS_MODE_DISABLED, AXIS_MODE_OPEN_LOOP, AXIS_MODE_POSITION, AXIS_MODE_FORCE},
    {AXIS_MODE_DISABLED, AXIS_MODE_OPEN_LOOP, AXIS_MODE_POSITION, AXIS_MODE_FORCE},
    {AXIS_MODE_DISABLED, AXIS_MODE_OPEN_LOOP, AXIS_MODE_POSITION, AXIS_MODE_FORCE},
    {AXIS_MODE_DISABLED, AXIS_MODE_OPEN_LOOP, AXIS_MODE_POSITION, AXIS_MODE_FORCE},
};

/* The mode of this tick, AXIS_MODE_..., from the mode of the last one, the requested one and
 * whether a fault is latched. Every argument must be a mode. */
static inline uint8_t mode_next(uint8_t active, uint8_t requested, bool faulted) {
  return faulted ? (uint8_t)AXIS_MODE_DISABLED : mode_table[active][requested];
}

/* True if the mode drives the amplifier. */
static inline bool mode_is_enabled(uint8_t mode) { return mode != AXIS_MODE_DISABLED; }

#endif
