#ifndef FIRMWARE_DRIVE_STATE_H_
#define FIRMWARE_DRIVE_STATE_H_

/* The state machine of CiA 402: the transitions that controlwords command, and the statuswords that
 * report the states. The states are AXIS_DRIVE_STATE_ values. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/generated/axis_objects.h"

/* Bits of the controlword. The mode of operation defines bits 4 to 6. */
enum {
  /* start bit: new set-point in profile position mode and guarded moves, start in homing */
  CIA402_CW_MODE_4 = 0x0010,
  /* in profile position mode, change to the new set-point immediately */
  CIA402_CW_MODE_5 = 0x0020,
  CIA402_CW_MODE_6 = 0x0040, /* in profile position mode, the new set-point is relative */
  CIA402_CW_FAULT_RESET = 0x0080,
  CIA402_CW_HALT = 0x0100,
  /* in profile position mode, the axis does not stop at a set-point if another set-point is
   * buffered */
  CIA402_CW_CHANGE_ON_SETPOINT = 0x0200
};

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

/* Bits 0 to 3, 5 and 6 of the statusword in each drive state. */
extern const uint8_t cia402_state_bits[AXIS_DRIVE_STATE_COUNT];

#endif
