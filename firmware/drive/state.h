#ifndef FIRMWARE_DRIVE_STATE_H_
#define FIRMWARE_DRIVE_STATE_H_

/* The state machine of CiA 402: which controlword commands which transition, and which statusword
 * shows which state. States are AXIS_DRIVE_STATE_. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/generated/axis_objects.h"

/* Bits of the controlword. Bits 4 to 6 belong to the mode. */
enum {
  CIA402_CW_MODE_4 = 0x0010, /* pp, guarded move: new set-point; hm: start */
  CIA402_CW_MODE_5 = 0x0020, /* pp: change at once */
  CIA402_CW_MODE_6 = 0x0040, /* pp: relative */
  CIA402_CW_FAULT_RESET = 0x0080,
  CIA402_CW_HALT = 0x0100,
  CIA402_CW_CHANGE_ON_SETPOINT = 0x0200 /* pp: no stop at the set-point before a buffered one */
};

/* Bits of the statusword. Bits 12 and 13 belong to the mode. */
enum {
  CIA402_SW_VOLTAGE = 0x0010,
  CIA402_SW_WARNING = 0x0080,
  CIA402_SW_REMOTE = 0x0200,
  CIA402_SW_REACHED = 0x0400,
  CIA402_SW_LIMIT = 0x0800,
  CIA402_SW_MODE_12 = 0x1000,
  CIA402_SW_MODE_13 = 0x2000,
  CIA402_SW_STOPPED = 0x4000 /* stopped_by is somebody */
};

/* The state that a controlword commands in `state`; `state` itself without a command.
 * `rising` are its bits that the controlword before it did not have: a fault is reset by the
 * rising edge only. Whether option codes hold it up, or make a quick stop end in switch on
 * disabled, is not decided here; `may_resume`: quick stop may go back to operation enabled. */
uint8_t cia402_next_state(uint8_t state, uint16_t controlword, uint16_t rising, bool may_resume);

/* The power stage is on. */
static inline bool cia402_is_powered(uint8_t state) {
  return state == AXIS_DRIVE_STATE_OPERATION_ENABLED ||
         state == AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE ||
         state == AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE;
}

/* True for the command "enable operation". */
bool cia402_enables(uint16_t controlword);

/* Whether writing this value to an object asks for a stop, which nobody is refused: a controlword
 * of shutdown, switch on (disable operation), disable voltage, quick stop or halt; native mode
 * disabled. */
bool cia402_is_stop(uint16_t object, int32_t value);

/* Where a controlword leads to that may only stop: `state` itself where it would lead further. */
uint8_t cia402_state_below(uint8_t state, uint16_t controlword);

/* Bits 0 to 3, 5 and 6 of the statusword, by state. */
extern const uint8_t cia402_state_bits[AXIS_DRIVE_STATE_COUNT];

#endif
