#ifndef FIRMWARE_CANOPEN_SDO_H_
#define FIRMWARE_CANOPEN_SDO_H_

/* SDO servers of a CANopen node: expedited and segmented transfers in both directions, and block
 * transfers (sdo_block.h). Server 0 is the default server and acts for CANOPEN, server 1 for
 * MODBUS, server 2 for LCM; the source lock distinguishes these three sources. Servers 1 and 2 are
 * off until a gateway sets identifiers in both of their COB-IDs (1201h, 1202h), and are off again
 * after a reset. As CiA 301 requires, requests without exactly 8 bytes are not answered. */

#include "firmware/canopen/sdo_transfer.h"

void sdo_receive(canopen_t *canopen, dictionary_t *objects, uint8_t server,
                 const can_frame_t *frame);

/* The time of a transfer has expired. */
void sdo_timeout(canopen_t *canopen, uint8_t server);

/* Discards all transfers without an abort message. */
void sdo_drop(canopen_t *canopen);

/* The recorder was stopped or armed, so its earlier recording is lost: aborts an upload of that
 * recording. */
void sdo_recording_replaced(canopen_t *canopen);

#endif
