#ifndef FIRMWARE_DRIVE_STATE_H_
#define FIRMWARE_DRIVE_STATE_H_

/* The state machine of CiA 402: the transitions that controlwords command, and the statuswords that
 * report the states. The states are AXIS_DRIVE_STATE_ values. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/generated/axis_objects_drive.h"

/* Returns the state that a controlword commands in the state `state`, or `state` if the controlword
 * commands no transition. `rising` contains the bits that were 0 in the previous controlword,
 * because only the rising edge of its bit resets a fault. `may_resume` permits a transition from
 * quick stop active to operation enabled. The caller decides whether option codes delay a
 * transition, or whether a quick stop ends in switch on disabled. */
uint8_t cia402_next_state(uint8_t state, uint16_t controlword, uint16_t rising, bool may_resume);

/* Returns true if the power stage is on in this state. */
static inline bool cia402_is_powered(uint8_t state) {
  return state == AXIS_DRIVE_STATE_OPERATION_ENABLED ||
         state == AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE ||
         state == AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE;
}

/* Returns true if the controlword is the command "enable operation". */
bool cia402_enables(uint16_t controlword);

/* Returns true if a write of this value to an object requests a stop, which every source may do.
 * Such a write is a controlword of shutdown, switch on (disable operation), disable voltage, quick
 * stop or halt, or the native mode disabled. */
bool cia402_is_stop(uint16_t object, int32_t value);

/* Returns the next state for a controlword whose source may only stop the axis. The result is
 * `state` if the controlword would lead to a higher state. */
uint8_t cia402_state_below(uint8_t state, uint16_t controlword);

#endif
