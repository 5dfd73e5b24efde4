#ifndef FIRMWARE_CANOPEN_SDO_BLOCK_H_
#define FIRMWARE_CANOPEN_SDO_BLOCK_H_

/* Block transfers of an SDO server (CiA 301, 7.2.4.3): a client acknowledges up to 127 segments at
 * once, with a CRC-16 if the client requests one.
 *
 * Upload: segments are sent in ticks while fewer than SDO_BLOCK_FRAMES frames wait in the output
 * queue. So a block does not delay more important frames, and a tick sends at most this number of
 * segments (some 400 instructions each). Segments that the client did not acknowledge are sent
 * again. Download: no object has more than 4 bytes, so a block is one segment; a repeated segment
 * is acknowledged again. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/sdo_transfer.h"

enum { SDO_BLOCK_FRAMES = 4, SDO_BLOCK_MOST = 127 };

/* Whether a requested upload must use segments instead of a block, because it is not above the
 * threshold of the client. */
bool sdo_block_prefers_segments(const sdo_request_t *request);

/* Answers a request for a block upload, or aborts it. */
void sdo_block_offer(const sdo_request_t *request);

/* Whether a request with the command specifier of a block upload begins an upload. */
bool sdo_block_begins_upload(uint8_t command);

/* Processes the other requests of a block upload: start, acknowledgement, end. */
void sdo_block_upload(const sdo_request_t *request);

/* Begins or ends a block download. */
void sdo_block_download(const sdo_request_t *request);

/* Processes a frame that is a segment of a block download, or an abort in its place. Returns false
 * if the frame is a request. */
bool sdo_block_segment(const sdo_request_t *request);

/* Sends segments of all servers in turn; call it once in each tick while canopen->sdos_sending is
 * not 0. */
void sdo_block_tick(canopen_t *canopen, const dictionary_t *objects);

#endif
