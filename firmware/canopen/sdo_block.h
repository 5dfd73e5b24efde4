#ifndef FIRMWARE_CANOPEN_SDO_BLOCK_H_
#define FIRMWARE_CANOPEN_SDO_BLOCK_H_

/* Block transfers of an SDO server, CiA 301 7.2.4.3: a client acknowledges up to 127 segments at
 * once. With a CRC-16 where the client wants one.
 *
 * Upload: segments go out in ticks, while fewer than SDO_BLOCK_FRAMES frames wait in the output, so
 * that a block neither delays what matters more nor costs a tick more than that many segments (some
 * 400 instructions each). From the first segment that the client did not acknowledge on they are
 * sent again. Download: no object has more than 4 bytes, so a block is one segment; one that is
 * repeated is acknowledged again. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/sdo_transfer.h"

enum { SDO_BLOCK_FRAMES = 4, SDO_BLOCK_MOST = 127 };

/* Whether the upload that was opened by this request is to come as sdo_answer() of segments: the
 * client's threshold. */
bool sdo_block_prefers_segments(const sdo_request_t *request);

/* Answers the request of an upload that was opened, or aborts it. */
void sdo_block_offer(const sdo_request_t *request);

/* Whether a request with the command specifier of a block upload begins one. */
bool sdo_block_begins_upload(uint8_t command);

/* The other requests of a block upload: start, acknowledgement, end. */
void sdo_block_upload(const sdo_request_t *request);

/* Begins or ends a block download. */
void sdo_block_download(const sdo_request_t *request);

/* Takes a frame that is a segment of a block download, or an abort in place of one; false: it is a
 * request. */
bool sdo_block_segment(const sdo_request_t *request);

/* Sends segments of all servers in turn; once a tick while canopen->sdos_sending is not 0. */
void sdo_block_tick(canopen_t *canopen, const dictionary_t *objects);

#endif
