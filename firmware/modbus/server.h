#ifndef FIRMWARE_MODBUS_SERVER_H_
#define FIRMWARE_MODBUS_SERVER_H_

/* A Modbus RTU server. Passive: bytes go in by modbus_receive(), answers come out by
 * modbus_transmit().
 *
 * A request is served as soon as its last byte is in: where it ends follows from its function, and
 * a frame whose CRC does not close there ends with the silence. So frames of other units and broken
 * ones are passed over without a timeout of their own; they get no answer and are counted. What a
 * request reads is one snapshot, because it is served between two ticks.
 *
 * Bytes that come while an answer still waits to be fetched are lost, and counted. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/modbus/step.h"
#include "firmware/objects/access.h"

enum { MODBUS_FRAME_BYTES = 256, MODBUS_BAUD_DEFAULT = 115200 };

typedef struct {
  uint32_t silence_ticks; /* end a frame */
  uint32_t silence;       /* ticks without a byte */
  uint16_t length;        /* bytes of the frame so far; those beyond the buffer are not kept */
  uint16_t crc;           /* over them */
  uint16_t answer_length; /* bytes that wait to be fetched; 0: none */
  uint16_t answer_sent;
  uint16_t counters[MODBUS_COUNTERS];
  uint8_t heard; /* bytes came since the last tick */
  uint8_t unit;
  uint8_t frame[MODBUS_FRAME_BYTES]; /* the request, then its answer */
} modbus_t;

/* unit 1..247: other units get no answer; 0, broadcast, is carried out without one. baud: of
 * characters with 11 bits; 0 counts as MODBUS_BAUD_DEFAULT. */
void modbus_init(modbus_t *modbus, uint8_t unit, uint32_t baud);

/* Bytes as they came, before the tick they came in. Cost: those bytes, and at most one request and
 * any number of broadcasts that are whole with them. */
void modbus_receive(modbus_t *modbus, dictionary_t *objects, const uint8_t *bytes, uint16_t count);

/* Once a tick: 3.5 characters of silence, above 19200 baud 1.75 ms, end a frame; rounded up
 * to ticks. */
void modbus_tick(modbus_t *modbus, dictionary_t *objects);

/* Up to `room` bytes of the answer; 0: none. */
uint16_t modbus_transmit(modbus_t *modbus, uint8_t *bytes, uint16_t room);

#endif
