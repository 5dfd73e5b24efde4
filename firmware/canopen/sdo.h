#ifndef FIRMWARE_CANOPEN_SDO_H_
#define FIRMWARE_CANOPEN_SDO_H_

/* SDO servers of a CANopen node: expedited and segmented transfers in both directions, and blocks
 * (sdo_block.h). Server 0 is the default one: CANOPEN; 1: MODBUS, 2: LCM. Those two are off until a
 * gateway gives both of their COB-IDs (1201h, 1202h) identifiers; they are off again after a reset.
 * Each server writes on behalf of one source: the source lock distinguishes them. Requests that
 * do not have 8 bytes get no answer, as CiA 301 asks for. */

#include "firmware/canopen/sdo_transfer.h"

void sdo_receive(canopen_t *canopen, dictionary_t *objects, uint8_t server,
                 const can_frame_t *frame);

/* A transfer has timed out. */
void sdo_timeout(canopen_t *canopen, uint8_t server);

/* Discards transfers, without an abort. */
void sdo_drop(canopen_t *canopen);

/* The recording was stopped or armed anew: an upload of it ends with an abort. */
void sdo_recording_replaced(canopen_t *canopen);

#endif
