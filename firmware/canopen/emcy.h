#ifndef FIRMWARE_CANOPEN_EMCY_H_
#define FIRMWARE_CANOPEN_EMCY_H_

/* Emergency messages of a CANopen node: their frames, their history (1003h) and the error register
 * (1001h).
 *
 * A frame contains the error code (AXIS_ERROR_CODE_), the error register and five manufacturer
 * bytes. Code 0 reports the end of an error; the register in the frame shows whether another error
 * remains. The codes contact_lost to overrun (FF01h to FF04h) are warnings: they do not change the
 * error register, so the register is 0 if there is no error.
 *
 * The first manufacturer byte depends on the error code. For a code of the drive it is the fault
 * (AXIS_FAULT_), and for a lost heartbeat the node id. For an error of an RPDO it is the number
 * 1..4 of the RPDO. The RPDO was too short and not processed; or too long, and only its first bytes
 * were used; or late; or an object refused its value. In the messages of the firmware itself, the
 * firmware sets this byte: for example the number of the lost owner, or store_state after a failure
 * of the parameter store. In all other cases the byte is 0.
 *
 * Few messages use the other four manufacturer bytes. In store_failed at power-up they are the
 * index (two bytes, low byte first) and the sub-index of the first parameter that differs from the
 * stored value, and the number of such parameters, at most 255. */

#include <stdint.h>

#include "firmware/canopen/state.h"

/* Adds an emergency message to the waiting messages. They are sent at the end of a tick. If too
 * many messages wait, the oldest message is discarded. Its error remains in the error history, and
 * the latest message shows the present state. */
void emcy_raise_detailed(canopen_t *canopen, uint16_t code, uint8_t info, uint32_t detail);
static inline void emcy_raise(canopen_t *canopen, uint16_t code, uint8_t info) {
  emcy_raise_detailed(canopen, code, info, 0);
}

/* Updates the error register (1001h) when an error begins or ends. */
void emcy_update(canopen_t *canopen);

/* Reports by an emergency message that the error code of the drive has changed to `code`. */
void emcy_drive(canopen_t *canopen, uint16_t code, uint8_t fault);

/* Sends the waiting emergency messages that the inhibit time permits. */
void emcy_tick(canopen_t *canopen);

/* Clears the error history after 0 was written to 1003h. */
void emcy_clear_history(canopen_t *canopen);

#endif
