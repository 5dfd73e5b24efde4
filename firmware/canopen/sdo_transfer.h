#ifndef FIRMWARE_CANOPEN_SDO_TRANSFER_H_
#define FIRMWARE_CANOPEN_SDO_TRANSFER_H_

/* Functions that both segmented transfers and block transfers of an SDO server use. They concern
 * the identifiers of a server, answers, aborts, the time-out, and the data of a transfer. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/state.h"
#include "firmware/objects/access.h"

/* Abort codes of SDO transfers. The comment of a code states when this server sends the code. */
#define SDO_ABORT_TOGGLE UINT32_C(0x05030000)
#define SDO_ABORT_TIMEOUT UINT32_C(0x05040000) /* the client sent no request for SDO_TIMEOUT_MS */
/* The request does not match the state of the transfer, or its command is unknown. */
#define SDO_ABORT_COMMAND UINT32_C(0x05040001)
/* the number of segments in an SDO block is not 1 to 127 */
#define SDO_ABORT_BLOCK_SIZE UINT32_C(0x05040002)
/* The number of a received or acknowledged segment is wrong. */
#define SDO_ABORT_SEQUENCE UINT32_C(0x05040003)
#define SDO_ABORT_CRC UINT32_C(0x05040004)
/* The axis has no room for the bytes of the download. */
#define SDO_ABORT_MEMORY UINT32_C(0x05040005)
/* The object is a command, which cannot be read. */
#define SDO_ABORT_WRITE_ONLY UINT32_C(0x06010001)
#define SDO_ABORT_READ_ONLY UINT32_C(0x06010002)
/* No object has this index, or the object of a mapping entry does not exist. */
#define SDO_ABORT_NO_OBJECT UINT32_C(0x06020000)
#define SDO_ABORT_MAPPING UINT32_C(0x06040041) /* the object cannot be mapped into this PDO */
/* The mapped objects together are longer than a PDO. */
#define SDO_ABORT_PDO_LENGTH UINT32_C(0x06040042)
/* Reason of a refusal: two heartbeat consumers would monitor the same node. */
#define SDO_ABORT_PARAMETER UINT32_C(0x06040043)
/* the axis has no memory for parameters or programs */
#define SDO_ABORT_HARDWARE UINT32_C(0x06060000)
/* The received length differs from the announced length. */
#define SDO_ABORT_LENGTH UINT32_C(0x06070010)
#define SDO_ABORT_TOO_LONG UINT32_C(0x06070012)
#define SDO_ABORT_TOO_SHORT UINT32_C(0x06070013)
#define SDO_ABORT_NO_SUB UINT32_C(0x06090011)
/* The value is within the range of the object, but is not one of its valid values. */
#define SDO_ABORT_VALUE UINT32_C(0x06090030)
#define SDO_ABORT_TOO_HIGH UINT32_C(0x06090031)
#define SDO_ABORT_TOO_LOW UINT32_C(0x06090032)
/* the written value is neither "save" nor "load" */
#define SDO_ABORT_SIGNATURE UINT32_C(0x08000020)
#define SDO_ABORT_LOCKED UINT32_C(0x08000021) /* another command source owns the axis */
/* The present state of the axis, the recorder, the PDO or the parameter store does not permit the
 * access. */
#define SDO_ABORT_STATE UINT32_C(0x08000022)
/* There is no complete recording and no curve, or the entry of the error history is empty. */
#define SDO_ABORT_NO_DATA UINT32_C(0x08000024)

/* Longest time in ms between two requests of an SDO client in the same transfer. */
enum { SDO_TIMEOUT_MS = 5000 };

enum { SDO_SEGMENT_BYTES = 7 };

/* One SDO request, and the server that processes the request. */
typedef struct {
  canopen_t *canopen;
  dictionary_t *objects;
  sdo_server_t *server;
  const uint8_t *data; /* the 8 bytes of the request */
  uint8_t number;      /* number of the SDO server */
} sdo_request_t;

/* Returns the number of the server whose requests have the identifier `id`, or CANOPEN_SDOS if no
 * server has this identifier. */
uint8_t sdo_server_at(const canopen_t *canopen, uint16_t id);

/* Returns true if the answers of any SDO server have the identifier `id`. */
bool sdo_transmits(const canopen_t *canopen, uint16_t id);

/* Returns true if a server uses the identifier `id` for its requests or its answers. The object
 * `object` is the COB-ID that a client wants to change, so its present value is ignored. */
bool sdo_uses(const canopen_t *canopen, uint16_t object, uint16_t id);

/* Checks whether a COB-ID of 1201h or 1202h may be set to `wanted`. Returns the same codes as
 * canopen_check_cob_id(), and FW_OK for every other object. */
int sdo_check(const canopen_t *canopen, uint16_t object, uint32_t wanted);

/* Acts on a write to an object. If the object is a COB-ID of 1201h or 1202h, the present transfer
 * of that SDO server is discarded. */
void sdo_written(canopen_t *canopen, uint16_t object);

/* Adds an answer with the command specifier `command`, the index and the sub-index to the output
 * queue. The caller writes the data of the answer. Returns NULL if the queue has no room. */
can_frame_t *sdo_answer(canopen_t *canopen, uint8_t server, uint8_t command, uint16_t index,
                        uint8_t sub);

/* Ends the transfer of an SDO server without sending a message. */
void sdo_end(canopen_t *canopen, uint8_t server);

/* sdo_abort_request() sends an abort message with the object of the request. sdo_abort_transfer()
 * sends an abort message with the object of the present transfer. */
void sdo_abort_request(const sdo_request_t *request, uint32_t code);
void sdo_abort_transfer(canopen_t *canopen, uint8_t server, uint32_t code);

/* Continues a transfer: starts the time-out for the next request of the client. */
void sdo_await(canopen_t *canopen, uint8_t server);

/* Returns the index in a request that begins a transfer. */
uint16_t sdo_index(const uint8_t *data);

/* Prepares the download that begins with this request. Returns 0 or an abort code. */
uint32_t sdo_open_download(const sdo_request_t *request, bool sized, uint32_t size);

/* Appends the next bytes of an SDO download. Returns 0 or an SDO abort code. */
uint32_t sdo_take(const sdo_request_t *request, const uint8_t *bytes, uint32_t count);

/* Checks the announced size of a download in bytes. Returns 0 or an abort code. */
uint32_t sdo_refuse_size(const sdo_server_t *server, uint32_t size);

/* Ends a download. Writes the value to the object, or lets the receiver of a stream check and
 * accept all its bytes. Returns 0 or an abort code. */
uint32_t sdo_close(const sdo_request_t *request);

/* Prepares the upload that begins with this request. Returns 0 or an abort code. */
uint32_t sdo_open_upload(const sdo_request_t *request);

/* Copies `count` bytes of the uploaded data into `bytes`, starting at the present offset of the
 * upload. */
void sdo_read(const canopen_t *canopen, const dictionary_t *objects, uint8_t server, uint8_t *bytes,
              uint32_t count);

#endif
