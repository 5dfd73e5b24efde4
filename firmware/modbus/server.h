#ifndef FIRMWARE_MODBUS_SERVER_H_
#define FIRMWARE_MODBUS_SERVER_H_

/* A Modbus RTU server. The server is passive: modbus_receive() accepts received bytes, and
 * modbus_transmit() returns the bytes of answers.
 *
 * A request is served as soon as its last byte is received, because the function of the request
 * determines its length. A frame with an unknown function, or without a valid CRC at that length,
 * ends with a silent interval on the line. So frames of other units and damaged frames are skipped
 * without an additional timeout. These frames are counted and not answered. All values that a
 * request reads belong to the same tick, because a request is served between two ticks.
 *
 * Bytes that are received while an answer waits to be sent are lost and counted.*/

#include <stdbool.h>
#include <stdint.h>

#include "firmware/modbus/step.h"
#include "firmware/objects/access.h"

enum { MODBUS_FRAME_BYTES = 256, MODBUS_BAUD_DEFAULT = 115200, MODBUS_UNIT_MAX = 247 };

typedef struct {
  uint32_t silence_ticks; /* length in ticks of the silent interval that ends a frame */
  uint32_t silence;       /* number of ticks since the last received byte */
  /* number of bytes of the frame that were received so far; bytes that exceed the buffer are
   * discarded */
  uint16_t length;
  uint16_t crc; /* CRC of the received bytes of the Modbus frame */
  /* length in bytes of the Modbus answer that waits to be sent; 0: no answer waits */
  uint16_t answer_length;
  uint16_t answer_sent;
  uint16_t counters[MODBUS_COUNTERS];
  uint8_t heard; /* 1 if bytes were received since the last tick */
  uint8_t unit;
  uint8_t frame[MODBUS_FRAME_BYTES]; /* bytes of the Modbus request, and later of the answer */
} modbus_t;

/* Initialises the server. If `unit` is 1 to 247, requests to other units are ignored, and
 * broadcasts (unit 0) are executed but not answered. If `unit` is larger, every request is ignored.
 * `baud` is the bit rate in bit/s for characters of 11 bits; 0 selects MODBUS_BAUD_DEFAULT. */
void modbus_init(modbus_t *modbus, uint8_t unit, uint32_t baud);

/* Accepts received bytes in the order of receipt, before the next tick. One call processes all
 * these bytes. It executes all broadcasts that these bytes complete, and at most one other
 * request. */
void modbus_receive(modbus_t *modbus, dictionary_t *objects, const uint8_t *bytes, uint16_t count);

/* Call modbus_tick() once in each tick. A frame ends after a silent interval of 3.5 characters, or
 * of 1.75 ms if the bit rate is above 19200 bit/s. Both times are rounded up to ticks. */
void modbus_tick(modbus_t *modbus, dictionary_t *objects);

/* Writes at most `room` bytes of the answer into `bytes`. Returns the number of these bytes, or 0
 * if no answer waits to be sent. */
uint16_t modbus_transmit(modbus_t *modbus, uint8_t *bytes, uint16_t room);

#endif
