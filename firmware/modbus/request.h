#ifndef FIRMWARE_MODBUS_REQUEST_H_
#define FIRMWARE_MODBUS_REQUEST_H_

/* One Modbus request, from its bytes to the bytes of its answer, for every server of the registers:
 * RTU in the firmware and TCP in the gateway. The code is passive: it requests one access to an
 * object at a time, and the caller executes this access, immediately or over a bus.
 *
 *   modbus_request_begin(&request, unit, pdu, length, counters);
 *   while (!modbus_request_ended(&request)) {
 *     ... execute request.access, fill in its result ...
 *     modbus_request_resume(&request);
 *   }
 *   ... pdu holds the answer, request.length bytes ...
 *
 * Functions: 1, 2 read coils, discrete inputs; 3, 4 read holding, input registers; 5, 15 write
 * coils; 6, 16 write registers; 22 mask write; 23 write, then read; 8 diagnostics: 0 echo, 10 clear
 * counters, 11 to 18 counters; 17 server id; 43 with MEI type 14 device identification, objects 0
 * to 2, 4, 5 and 80h (hash of the object table). Any other function is exception 1. */

#include "firmware/modbus/step.h"

/* Largest length in bytes of a PDU: function code and data of a request or of an answer. */
enum { MODBUS_PDU_BYTES = 253 };

/* Results of modbus_request_bytes() if the length of the request is not known. */
enum {
  MODBUS_BYTES_OPEN = 0,     /* unknown function, any length */
  MODBUS_BYTES_MORE = 0xFFFF /* more bytes are needed */
};

/* Returns the length in bytes of a request PDU whose first `length` bytes are known. Returns
 * MODBUS_BYTES_OPEN or MODBUS_BYTES_MORE if these bytes do not determine the length. */
uint16_t modbus_request_bytes(const uint8_t *pdu, uint16_t length);

/* Begins a request. The PDU in `pdu` has `length` bytes, at least one, in a buffer of
 * MODBUS_PDU_BYTES; the buffer must stay valid until the request has ended. `counters` has
 * MODBUS_COUNTERS elements. The caller need not initialise `request`. */
void modbus_request_begin(modbus_request_t *request, uint8_t unit, uint8_t *pdu, uint16_t length,
                          uint16_t *counters);

static inline bool modbus_request_ended(const modbus_request_t *request) {
  return request->part == MODBUS_ENDED;
}

/* Continues the request with the result of the access that request->access requested. */
void modbus_request_resume(modbus_request_t *request);

#endif
