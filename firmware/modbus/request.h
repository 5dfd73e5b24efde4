#ifndef FIRMWARE_MODBUS_REQUEST_H_
#define FIRMWARE_MODBUS_REQUEST_H_

/* One Modbus request, from its bytes to the bytes of its answer. It is used by both servers of the
 * Modbus registers: the RTU server in the firmware and the TCP server in the gateway. A request is
 * passive: it asks for one access to an object at a time, and the caller executes this access,
 * immediately or over a bus.
 *
 *   modbus_request_begin(&request, unit, pdu, length, counters);
 *   while (!modbus_request_ended(&request)) {
 *     ... execute request.access, fill in its result ...
 *     modbus_request_resume(&request);
 *   }
 *   ... pdu holds the answer, request.length bytes ...
 *
 * Modbus functions: 1 reads coils; 2 reads discrete inputs; 3 reads holding registers; 4 reads
 * input registers; 5 and 15 write coils; 6 and 16 write registers; 22 writes a register with a
 * mask; 23 writes registers and then reads registers. Function 8 is diagnostics, with the
 * subfunctions 0 (echo), 10 (clear the counters) and 11 to 18 (read a counter). Function 17 reads
 * the server id. Function 43 with MEI type 14 reads the objects 0 to 2, 4, 5 and 80h (hash of the
 * object table) of the device identification. Any other function gives exception 1.*/

#include "firmware/modbus/step.h"

/* Largest length in bytes of a PDU. A PDU is the function code and the data of a request or of an
 * answer. */
enum { MODBUS_PDU_BYTES = 253 };

/* Results of modbus_request_bytes() if the length of the request is not known yet. */
enum {
  MODBUS_BYTES_OPEN = 0, /* the Modbus function is unknown, so the request may have any length */
  MODBUS_BYTES_MORE = 0xFFFF /* more bytes of the request are needed to determine its length */
};

/* Returns the length in bytes of a request PDU whose first `length` bytes are known. Returns
 * MODBUS_BYTES_OPEN or MODBUS_BYTES_MORE if these bytes do not determine the length. */
uint16_t modbus_request_bytes(const uint8_t *pdu, uint16_t length);

/* Begins a request. Its PDU has `length` bytes, at least one. `pdu` is a buffer of MODBUS_PDU_BYTES
 * bytes and must stay valid until the request has ended. `counters` has MODBUS_COUNTERS elements.
 * The caller need not initialise `request`. */
void modbus_request_begin(modbus_request_t *request, uint8_t unit, uint8_t *pdu, uint16_t length,
                          uint16_t *counters);

static inline bool modbus_request_ended(const modbus_request_t *request) {
  return request->part == MODBUS_ENDED;
}

/* Continues the request with the result of the access that request->access requested. */
void modbus_request_resume(modbus_request_t *request);

#endif
