#ifndef FIRMWARE_CANOPEN_SYNC_H_
#define FIRMWARE_CANOPEN_SYNC_H_

/* SYNC consumer of a CANopen node. The SYNC message contains a counter if object 1019h is not 0. A
 * SYNC message of wrong length is ignored. If several SYNC messages in a row are wrong, an
 * emergency message reports only the first of them. */

#include <stdint.h>

#include "firmware/canopen/state.h"

void sync_receive(canopen_t *canopen, dictionary_t *objects, const can_frame_t *frame);

/* sync_check_cob_id() checks a new value of the object 1005h, and sync_check_overflow() a new value
 * of 1019h. They return FW_OK or FW_ERROR_RANGE. This node does not produce SYNC, so it has no
 * object 1006h that could forbid a value. */
int sync_check_cob_id(uint32_t wanted);
int sync_check_overflow(uint32_t wanted);

#endif
