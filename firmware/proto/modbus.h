#ifndef FIRMWARE_PROTO_MODBUS_H_
#define FIRMWARE_PROTO_MODBUS_H_

/* A Modbus RTU server. Passive: bytes go in by modbus_receive(), answers come out by
 * modbus_transmit(). */

#include <stdint.h>

#include "firmware/proto/access.h"

enum { MODBUS_FRAME_BYTES = 256 };

typedef struct {
  uint8_t unit;
} modbus_t;

/* unit 1..247: other units get no answer; 0, broadcast, is carried out without one. */
void modbus_init(modbus_t *modbus, uint8_t unit);

/* Bytes as they came, before the tick they came in. */
void modbus_receive(modbus_t *modbus, fw_t *fw, const uint8_t *bytes, uint16_t count);

/* Once a tick: a silence of 3.5 characters, rounded up to ticks, ends a request. */
void modbus_tick(modbus_t *modbus, fw_t *fw);

/* Up to `room` bytes of the answer; 0: none. */
uint16_t modbus_transmit(modbus_t *modbus, uint8_t *bytes, uint16_t room);

#endif
