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

#include "firmware/objects/access.h"

enum { MODBUS_FRAME_BYTES = 256, MODBUS_BAUD_DEFAULT = 115200 };

/* Counters of function 8, by their sub-function minus MODBUS_COUNTER_FIRST. They wrap. */
enum {
  MODBUS_COUNTER_FIRST = 11,
  MODBUS_COUNT_MESSAGES = 0,   /* whole frames on the bus, of whichever unit */
  MODBUS_COUNT_ERRORS = 1,     /* frames that were broken, cut off or too long */
  MODBUS_COUNT_EXCEPTIONS = 2, /* answered with one, or a broadcast that was refused */
  MODBUS_COUNT_SERVED = 3,     /* requests of this unit, and broadcasts */
  MODBUS_COUNT_UNANSWERED = 4, /* broadcasts */
  MODBUS_COUNT_NAK = 5,        /* always 0 */
  MODBUS_COUNT_BUSY = 6,       /* exception 6 */
  MODBUS_COUNT_OVERRUNS = 7,   /* bytes came before the last answer was fetched */
  MODBUS_COUNTERS = 8
};

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

/* Function 8, sub-function 10. */
static inline void modbus_clear_counters(modbus_t *modbus) {
  for (uint8_t i = 0; i < MODBUS_COUNTERS; i++) {
    modbus->counters[i] = 0;
  }
}

/* Bytes as they came, before the tick they came in. Cost: those bytes, and at most one request and
 * any number of broadcasts that are whole with them. */
void modbus_receive(modbus_t *modbus, dictionary_t *objects, const uint8_t *bytes, uint16_t count);

/* Once a tick: 3.5 characters of silence, above 19200 baud 1.75 ms, end a frame; rounded up
 * to ticks. */
void modbus_tick(modbus_t *modbus, dictionary_t *objects);

/* Up to `room` bytes of the answer; 0: none. */
uint16_t modbus_transmit(modbus_t *modbus, uint8_t *bytes, uint16_t room);

#endif
