#ifndef FIRMWARE_DRIVE_STATE_H_
#define FIRMWARE_DRIVE_STATE_H_

/* The state machine of CiA 402: which controlword commands which transition, and which statusword
 * reports which state. States are AXIS_DRIVE_STATE_. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/generated/axis_objects.h"

/* Bits of the controlword. The mode of operation defines bits 4 to 6. */
enum {
  CIA402_CW_MODE_4 = 0x0010, /* profile position, guarded move: new set-point; homing: start */
  CIA402_CW_MODE_5 = 0x0020, /* profile position: change to the set-point at once */
  CIA402_CW_MODE_6 = 0x0040, /* profile position: the set-point is relative */
  CIA402_CW_FAULT_RESET = 0x0080,
  CIA402_CW_HALT = 0x0100,
  /* profile position: the axis does not stop at a set-point if another set-point is buffered */
  CIA402_CW_CHANGE_ON_SETPOINT = 0x0200
};

/* Bits of the statusword. The mode of operation defines bits 12 and 13. */
enum {
  CIA402_SW_VOLTAGE = 0x0010,
  CIA402_SW_WARNING = 0x0080,
  CIA402_SW_REMOTE = 0x0200,
  CIA402_SW_REACHED = 0x0400,
  CIA402_SW_LIMIT = 0x0800,
  CIA402_SW_MODE_12 = 0x1000,
  CIA402_SW_MODE_13 = 0x2000,
  CIA402_SW_STOPPED = 0x4000 /* stopped_by names a source that stopped the axis */
};

/* Returns the state that a controlword commands in `state`, or `state` itself if it commands no
 * transition. `rising` has the bits that were 0 in the previous controlword: only the rising edge
 * resets a fault. `may_resume`: a transition from quick stop to operation enabled is permitted. The
 * caller decides whether option codes delay a transition, or make a quick stop end in switch on
 * disabled. */
uint8_t cia402_next_state(uint8_t state, uint16_t controlword, uint16_t rising, bool may_resume);

/* Whether the power stage is on in this state. */
static inline bool cia402_is_powered(uint8_t state) {
  return state == AXIS_DRIVE_STATE_OPERATION_ENABLED ||
         state == AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE ||
         state == AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE;
}

/* Whether the controlword is the command "enable operation". */
bool cia402_enables(uint16_t controlword);

/* Whether writing this value to an object requests a stop, which every source may do. The values
 * are a controlword of shutdown, switch on (disable operation), disable voltage, quick stop or
 * halt, and the native mode disabled. */
bool cia402_is_stop(uint16_t object, int32_t value);

/* Returns the state to which a controlword leads if its source may only stop the axis: `state`
 * itself if the controlword would lead to a higher state. */
uint8_t cia402_state_below(uint8_t state, uint16_t controlword);

/* Bits 0 to 3, 5 and 6 of the statusword in each state. */
extern const uint8_t cia402_state_bits[AXIS_DRIVE_STATE_COUNT];

#endif
