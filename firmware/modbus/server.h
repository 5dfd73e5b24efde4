#ifndef FIRMWARE_MODBUS_SERVER_H_
#define FIRMWARE_MODBUS_SERVER_H_

/* A Modbus RTU server. Passive: bytes go in by modbus_receive(), answers come out by
 * modbus_transmit().
 *
 * A request is served as soon as its last byte is received: its function determines its length. A
 * frame of an unknown function, or without a valid CRC there, ends with the silence. So frames of
 * other units and broken ones are skipped without a timeout of their own; they are not answered,
 * but counted. A request reads one snapshot, because it is served between two ticks.
 *
 * Bytes received while an answer is pending are lost, and counted. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/modbus/step.h"
#include "firmware/objects/access.h"

enum { MODBUS_FRAME_BYTES = 256, MODBUS_BAUD_DEFAULT = 115200, MODBUS_UNIT_MAX = 247 };

typedef struct {
  uint32_t silence_ticks; /* end a frame */
  uint32_t silence;       /* ticks without a byte */
  uint16_t length;        /* bytes of the frame so far; those beyond the buffer are dropped */
  uint16_t crc;           /* over them */
  uint16_t answer_length; /* bytes that are pending; 0: none */
  uint16_t answer_sent;
  uint16_t counters[MODBUS_COUNTERS];
  uint8_t heard; /* bytes were received since the last tick */
  uint8_t unit;
  uint8_t frame[MODBUS_FRAME_BYTES]; /* the request, then its answer */
} modbus_t;

/* unit 1..247: requests of other units are ignored; 0, broadcast, is carried out and not answered.
 * A unit above that has no address: every request is ignored.
 * baud: of characters with 11 bits; 0 counts as MODBUS_BAUD_DEFAULT. */
void modbus_init(modbus_t *modbus, uint8_t unit, uint32_t baud);

/* Bytes in the order of receipt, before the next tick. Cost: those bytes, at most one request, and
 * any number of broadcasts completed by them. */
void modbus_receive(modbus_t *modbus, dictionary_t *objects, const uint8_t *bytes, uint16_t count);

/* Once a tick: 3.5 characters of silence, above 19200 baud 1.75 ms, end a frame; rounded up
 * to ticks. */
void modbus_tick(modbus_t *modbus, dictionary_t *objects);

/* Up to `room` bytes of the answer; 0: none. */
uint16_t modbus_transmit(modbus_t *modbus, uint8_t *bytes, uint16_t room);

#endif
