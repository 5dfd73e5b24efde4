#ifndef FIRMWARE_CANOPEN_EMCY_H_
#define FIRMWARE_CANOPEN_EMCY_H_

/* Emergencies of a CANopen node: frames, their history (1003h) and the error register (1001h).
 *
 * A frame is the code, the error register, and in its first manufacturer byte the subject: the
 * fault (AXIS_FAULT_) of a code of the drive, the node of a lost heartbeat, 1..4 of an RPDO that
 * was short (not processed), long (its first bytes were used), late or refused by an object, the
 * lost owner, store_state of a store that failed, else 0. The other four are 0, but at power-up
 * those of store_failed: index (two bytes, the lower first) and sub-index of the first parameter
 * that is not as stored, and the number of such parameters, at most 255. Codes are
 * AXIS_ERROR_CODE_. Code 0 reports the end of a condition; the register in the frame shows whether
 * another one lasts. */

#include <stdint.h>

#include "firmware/canopen/state.h"

/* Notes an emergency; it is sent at the end of a tick. If too many are pending, the
 * oldest is dropped: the history keeps it, and the latest shows the present state. */
void emcy_raise_detailed(canopen_t *canopen, uint16_t code, uint8_t info, uint32_t detail);
static inline void emcy_raise(canopen_t *canopen, uint16_t code, uint8_t info) {
  emcy_raise_detailed(canopen, code, info, 0);
}

/* Sets 1001h when a lasting condition begins or ends. */
void emcy_update(canopen_t *canopen);

/* Reports that the drive's error code has changed. */
void emcy_drive(canopen_t *canopen, uint16_t code, uint8_t fault);

/* Sends what may be sent. */
void emcy_tick(canopen_t *canopen);

/* 1003h was written 0. */
void emcy_clear_history(canopen_t *canopen);

#endif
