#ifndef FIRMWARE_CANOPEN_EMCY_H_
#define FIRMWARE_CANOPEN_EMCY_H_

/* Emergency messages of a CANopen node: their frames, their history (1003h) and the error register
 * (1001h).
 *
 * A frame has the code, the error register, and five manufacturer bytes. The first manufacturer
 * byte is the fault (AXIS_FAULT_) for a code of the drive; the node id for a lost heartbeat; 1..4
 * for an RPDO that was too short (not processed), too long (its first bytes were used), late, or
 * refused by an object; the lost owner; store_state for a failed store; and 0 in all other cases.
 * The other four bytes are 0, except in store_failed at power-up: index (two bytes, low byte first)
 * and sub-index of the first parameter that is not as stored, and the number of such parameters, at
 * most 255. Codes are AXIS_ERROR_CODE_. Code 0 reports the end of an error; the register in the
 * frame shows whether another error remains. */

#include <stdint.h>

#include "firmware/canopen/state.h"

/* Notes an emergency message; it is sent at the end of a tick. If too many messages wait, the
 * oldest is discarded: the history keeps its error, and the latest message shows the present
 * state. */
void emcy_raise_detailed(canopen_t *canopen, uint16_t code, uint8_t info, uint32_t detail);
static inline void emcy_raise(canopen_t *canopen, uint16_t code, uint8_t info) {
  emcy_raise_detailed(canopen, code, info, 0);
}

/* Updates the error register (1001h) when an error begins or ends. */
void emcy_update(canopen_t *canopen);

/* Reports that the error code of the drive has changed. */
void emcy_drive(canopen_t *canopen, uint16_t code, uint8_t fault);

/* Sends the waiting emergency messages that the inhibit time permits. */
void emcy_tick(canopen_t *canopen);

/* Clears the error history after 0 was written to 1003h. */
void emcy_clear_history(canopen_t *canopen);

#endif
