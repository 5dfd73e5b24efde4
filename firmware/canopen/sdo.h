#ifndef FIRMWARE_CANOPEN_SDO_H_
#define FIRMWARE_CANOPEN_SDO_H_

/* SDO servers of a CANopen node: expedited and segmented transfers in both directions, and block
 * transfers (sdo_block.h). Server 0 is the default server and acts for the command source CANOPEN,
 * server 1 for MODBUS, server 2 for LCM; the source lock distinguishes these three sources. Servers
 * 1 and 2 are off until a gateway sets identifiers in both COB-IDs of the server (1201h, 1202h). A
 * reset switches servers 1 and 2 off again. As CiA 301 requires, requests without exactly 8 bytes
 * are not answered. */

#include "firmware/canopen/sdo_transfer.h"

void sdo_receive(canopen_t *canopen, dictionary_t *objects, uint8_t server,
                 const can_frame_t *frame);

/* Aborts the transfer of a server because the client has sent no request for SDO_TIMEOUT_MS. */
void sdo_timeout(canopen_t *canopen, uint8_t server);

/* Returns true while a client downloads a stream of bytes through the SDO server `server`, to an
 * address of the kind AXIS_ADDRESS_DOWNLOAD. */
bool sdo_downloads_bytes(const canopen_t *canopen, uint8_t server);

/* Ends the transfers of all SDO servers without sending an abort message. */
void sdo_drop(canopen_t *canopen);

/* Aborts the upload of a domain whose bytes are lost. A recording is lost when the recorder is
 * stopped or armed. A curve is lost when the next cycle starts. */
void sdo_domain_replaced(canopen_t *canopen, uint16_t index);

#endif
