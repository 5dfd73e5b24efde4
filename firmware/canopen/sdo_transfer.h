#ifndef FIRMWARE_CANOPEN_SDO_TRANSFER_H_
#define FIRMWARE_CANOPEN_SDO_TRANSFER_H_

/* Functions that segmented and block transfers share: identifiers of a server, answers, aborts, the
 * time-out, and the bytes that are read or written. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/state.h"
#include "firmware/objects/access.h"

/* Abort codes of SDO transfers, with the conditions under which this server sends them. */
#define SDO_ABORT_TOGGLE UINT32_C(0x05030000)
#define SDO_ABORT_TIMEOUT UINT32_C(0x05040000) /* no segment for SDO_TIMEOUT_MS */
/* wrong state of the transfer, or unknown command */
#define SDO_ABORT_COMMAND UINT32_C(0x05040001)
#define SDO_ABORT_BLOCK_SIZE UINT32_C(0x05040002) /* not 1 to 127 */
#define SDO_ABORT_SEQUENCE UINT32_C(0x05040003)   /* a segment that was not announced or not sent */
#define SDO_ABORT_CRC UINT32_C(0x05040004)
#define SDO_ABORT_WRITE_ONLY UINT32_C(0x06010001) /* a command cannot be read */
#define SDO_ABORT_READ_ONLY UINT32_C(0x06010002)
/* no such index, or no object that can be mapped */
#define SDO_ABORT_NO_OBJECT UINT32_C(0x06020000)
#define SDO_ABORT_MAPPING UINT32_C(0x06040041) /* cannot be mapped into this PDO */
/* the mapped objects exceed the length of the PDO */
#define SDO_ABORT_PDO_LENGTH UINT32_C(0x06040042)
#define SDO_ABORT_PARAMETER UINT32_C(0x06040043) /* two heartbeat consumers for one node */
#define SDO_ABORT_HARDWARE UINT32_C(0x06060000)  /* no memory for parameters */
#define SDO_ABORT_LENGTH UINT32_C(0x06070010)    /* the length differs from the announced length */
#define SDO_ABORT_TOO_LONG UINT32_C(0x06070012)
#define SDO_ABORT_TOO_SHORT UINT32_C(0x06070013)
#define SDO_ABORT_NO_SUB UINT32_C(0x06090011)
#define SDO_ABORT_VALUE UINT32_C(0x06090030) /* in the range, but not one of the valid values */
#define SDO_ABORT_TOO_HIGH UINT32_C(0x06090031)
#define SDO_ABORT_TOO_LOW UINT32_C(0x06090032)
#define SDO_ABORT_SIGNATURE UINT32_C(0x08000020) /* neither "save" nor "load" */
#define SDO_ABORT_LOCKED UINT32_C(0x08000021)    /* another source owns the axis */
/* axis, recorder, PDO or store does not permit it now */
#define SDO_ABORT_STATE UINT32_C(0x08000022)
#define SDO_ABORT_NO_DATA UINT32_C(0x08000024) /* no complete recording; no such error */

/* Longest time to the next request of a transfer, in ms. */
enum { SDO_TIMEOUT_MS = 5000 };

enum { SDO_SEGMENT_BYTES = 7 };

/* One SDO request and the server that processes it. */
typedef struct {
  canopen_t *canopen;
  dictionary_t *objects;
  sdo_server_t *server;
  const uint8_t *data; /* 8 bytes */
  uint8_t number;      /* number of the server */
} sdo_request_t;

/* Returns the server whose requests have this identifier; CANOPEN_SDOS: no server. */
uint8_t sdo_server_at(const canopen_t *canopen, uint16_t id);

/* Whether a server answers with this identifier. */
bool sdo_transmits(const canopen_t *canopen, uint16_t id);

/* Whether an object other than this one gives a server this identifier, in either direction. */
bool sdo_uses(const canopen_t *canopen, uint16_t object, uint16_t id);

/* Whether a COB-ID of 1201h or 1202h may have this value; results as canopen_check_cob_id().
 * Returns FW_OK for every other object. */
int sdo_check(const canopen_t *canopen, uint16_t object, uint32_t wanted);

/* A COB-ID of 1201h or 1202h has changed: discards a transfer of its server. */
void sdo_written(canopen_t *canopen, uint16_t object);

/* Adds an answer with command specifier, index and sub-index to the output queue; the caller fills
 * in its data. NULL: no room in the queue. */
can_frame_t *sdo_answer(canopen_t *canopen, uint8_t server, uint8_t command, uint16_t index,
                        uint8_t sub);

/* Ends the transfer of a server. */
void sdo_end(canopen_t *canopen, uint8_t server);

/* Send an abort: for the object of the request, and for the object of the present transfer. */
void sdo_abort_request(const sdo_request_t *request, uint32_t code);
void sdo_abort_transfer(canopen_t *canopen, uint8_t server, uint32_t code);

/* The transfer continues: starts the time-out for the next request. */
void sdo_await(canopen_t *canopen, uint8_t server);

/* Returns the index of a request that begins a transfer. */
uint16_t sdo_index(const uint8_t *data);

/* Prepares the download that the request begins. Returns 0 or an abort code. */
uint32_t sdo_open_download(const sdo_request_t *request, bool sized, uint32_t size);

/* Writes the bytes of a complete download. Returns 0 or an abort code. */
uint32_t sdo_write(const sdo_request_t *request, const uint8_t *bytes);

/* Prepares the upload that the request begins. Returns 0 or an abort code. */
uint32_t sdo_open_upload(const sdo_request_t *request);

/* Copies `count` bytes of the upload, starting at its present offset. */
void sdo_read(const canopen_t *canopen, const dictionary_t *objects, uint8_t server, uint8_t *bytes,
              uint32_t count);

#endif
