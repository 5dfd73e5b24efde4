#ifndef FIRMWARE_DRIVE_STATE_H_
#define FIRMWARE_DRIVE_STATE_H_

/* The state machine of CiA 402: the transitions that controlwords command, and the statuswords that
 * report the states. The states are AXIS_DRIVE_STATE_ values. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/generated/axis_objects_drive.h"

/* Returns the state that a controlword commands in the state `state`, or `state` if the controlword
 * commands no transition. `rising` contains the bits that were 0 in the previous controlword and
 * are 1 now: a fault is reset only by the rising edge of the fault reset bit. `may_resume` permits
 * a transition from `quick stop active` to `operation enabled`. The caller decides by the option
 * codes whether a transition is delayed, and whether a quick stop ends in `switch on disabled`. */
uint8_t cia402_next_state(uint8_t state, uint16_t controlword, uint16_t rising, bool may_resume);

/* Returns true if the power stage is on in this state. */
static inline bool cia402_is_powered(uint8_t state) {
  return state == AXIS_DRIVE_STATE_OPERATION_ENABLED ||
         state == AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE ||
         state == AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE;
}

/* Returns true if the controlword is the command `enable operation`. */
bool cia402_enables(uint16_t controlword);

/* Returns true if a write of `value` to `object` requests a stop. Every command source may request
 * a stop. Such a write is the native mode `disabled`, or a controlword with the command `shutdown`,
 * `switch on` (`disable operation`), `disable voltage` or `quick stop`, or with the halt bit. */
bool cia402_is_stop(uint16_t object, int32_t value);

/* Returns the next state for a controlword whose command source may only stop the axis. The result
 * is `state` if the controlword would lead to a higher state. */
uint8_t cia402_state_below(uint8_t state, uint16_t controlword);

#endif
