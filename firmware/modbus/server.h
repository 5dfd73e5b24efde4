#ifndef FIRMWARE_MODBUS_SERVER_H_
#define FIRMWARE_MODBUS_SERVER_H_

/* A Modbus RTU server. It is passive: modbus_receive() accepts bytes, modbus_transmit() returns the
 * bytes of answers.
 *
 * A request is served as soon as its last byte is received, because its function determines its
 * length. The silence on the line ends a frame with an unknown function, or without a valid CRC at
 * that length. Frames of other units and damaged frames are thus skipped without an additional
 * timeout; they are counted and not answered. All values that a request reads belong to the same
 * tick, because it is served between two ticks.
 *
 * Bytes that are received while an answer waits to be sent are lost and counted. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/modbus/step.h"
#include "firmware/objects/access.h"

enum { MODBUS_FRAME_BYTES = 256, MODBUS_BAUD_DEFAULT = 115200, MODBUS_UNIT_MAX = 247 };

typedef struct {
  uint32_t silence_ticks; /* ticks of silence that end a frame */
  uint32_t silence;       /* ticks since the last received byte */
  uint16_t length;        /* bytes of the frame so far; bytes beyond the buffer are discarded */
  uint16_t crc;           /* CRC of the bytes of the frame */
  uint16_t answer_length; /* bytes of the answer that waits to be sent; 0: no answer */
  uint16_t answer_sent;
  uint16_t counters[MODBUS_COUNTERS];
  uint8_t heard; /* 1: bytes were received since the last tick */
  uint8_t unit;
  uint8_t frame[MODBUS_FRAME_BYTES]; /* bytes of the request, then of its answer */
} modbus_t;

/* Initialises the server. unit 1..247: requests to other units are ignored; broadcasts (unit 0) are
 * carried out and not answered. A larger unit is no address: every request is ignored. baud is the
 * bit rate for characters of 11 bits; 0 means MODBUS_BAUD_DEFAULT. */
void modbus_init(modbus_t *modbus, uint8_t unit, uint32_t baud);

/* Accepts bytes in the order of receipt, before the next tick. Cost: the bytes, at most one
 * request, and all broadcasts that these bytes complete. */
void modbus_receive(modbus_t *modbus, dictionary_t *objects, const uint8_t *bytes, uint16_t count);

/* Call it once in each tick. A silence of 3.5 characters, or of 1.75 ms above 19200 baud, ends a
 * frame; both are rounded up to ticks. */
void modbus_tick(modbus_t *modbus, dictionary_t *objects);

/* Returns up to `room` bytes of the answer; 0: no bytes to send. */
uint16_t modbus_transmit(modbus_t *modbus, uint8_t *bytes, uint16_t room);

#endif
