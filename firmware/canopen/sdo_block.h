#ifndef FIRMWARE_CANOPEN_SDO_BLOCK_H_
#define FIRMWARE_CANOPEN_SDO_BLOCK_H_

/* Block transfers of an SDO server (CiA 301, 7.2.4.3). A client acknowledges up to 127 segments
 * together. The transfer has a CRC-16 if the client requests one.
 *
 * Upload: the server sends segments in a tick while fewer than SDO_BLOCK_FRAMES frames wait in the
 * output queue. So a block does not delay more important frames, and a tick sends at most
 * SDO_BLOCK_FRAMES segments (some 400 instructions each). The server sends segments that the client
 * did not acknowledge again. Download: the block of a value is one segment, and a repeated segment
 * is acknowledged again. If the download is no value, a block has SDO_BLOCK_MOST segments. After a
 * missing segment the following segments of the block are dropped, and the end of the block
 * acknowledges the segments before the missing one. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/sdo_transfer.h"

enum { SDO_BLOCK_FRAMES = 4, SDO_BLOCK_MOST = 127 };

/* Returns true if a segmented upload must answer a block upload request. This is so if the data are
 * not longer than the threshold in the request. */
bool sdo_block_prefers_segments(const sdo_request_t *request);

/* Answers a request for an SDO block upload, or aborts the SDO transfer. */
void sdo_block_offer(const sdo_request_t *request);

/* Returns true if a request with the command specifier of a block upload begins a new upload. */
bool sdo_block_begins_upload(uint8_t command);

/* Processes a request within a block upload: the start, an acknowledgement or the end. */
void sdo_block_upload(const sdo_request_t *request);

/* Processes a request that begins or ends an SDO block download. */
void sdo_block_download(const sdo_request_t *request);

/* Processes a segment of a block download. Returns false if the frame is not a segment, but a
 * request or an abort. */
bool sdo_block_segment(const sdo_request_t *request);

/* Sends segments of block uploads, of all SDO servers in turn. Call this function once in each tick
 * while canopen->sdos_sending is not 0. */
void sdo_block_tick(canopen_t *canopen, const dictionary_t *objects);

#endif
