#ifndef FIRMWARE_CANOPEN_SYNC_H_
#define FIRMWARE_CANOPEN_SYNC_H_

/* SYNC consumer of a CANopen node. The SYNC message has a counter if 1019h is not 0. A message of
 * another length does not count as SYNC; an emergency message reports the first of consecutive
 * wrong messages. */

#include <stdint.h>

#include "firmware/canopen/state.h"

void sync_receive(canopen_t *canopen, dictionary_t *objects, const can_frame_t *frame);

/* Whether 1005h and 1019h may have a value: FW_OK or FW_ERROR_RANGE. This node does not produce
 * SYNC, so it has no object 1006h that could forbid a value. */
int sync_check_cob_id(uint32_t wanted);
int sync_check_overflow(uint32_t wanted);

#endif
