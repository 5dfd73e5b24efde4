#ifndef FIRMWARE_MODBUS_REQUEST_H_
#define FIRMWARE_MODBUS_REQUEST_H_

/* One Modbus request: how long it is, and what it does.
 *
 * Functions: 1, 2 read coils, discrete inputs; 3, 4 read holding, input registers; 5, 15 write
 * coils; 6, 16 write registers; 22 mask write; 23 write, then read; 8 diagnostics: 0 echo, 10 clear
 * counters, 11 to 18 counters; 17 server id; 43 with MEI type 14 device identification, objects 0
 * to 2, 4, 5 and 80h (hash of the object table). Any other function is exception 1. */

#include "firmware/modbus/server.h"

/* What modbus_request_bytes() cannot say: */
enum {
  MODBUS_BYTES_OPEN = 0,     /* an unknown function: the frame ends where its CRC closes */
  MODBUS_BYTES_MORE = 0xFFFF /* too little of it is there */
};

/* How long the request of which `length` bytes are there will be, with unit and CRC. */
uint16_t modbus_request_bytes(const uint8_t *frame, uint16_t length);

/* Carries out the request in modbus->frame, of `length` bytes without its CRC, at least two of them
 * unit and function, and puts the answer in its place. Returns its length, without CRC. */
uint16_t modbus_request_serve(modbus_t *modbus, dictionary_t *objects, uint16_t length);

#endif
