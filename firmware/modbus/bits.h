#ifndef FIRMWARE_MODBUS_BITS_H_
#define FIRMWARE_MODBUS_BITS_H_

/* Modbus coils (AXIS_COIL_) and discrete inputs. Coil enable: a write of 1 sends the controlword
 * `shutdown` and then `enable operation`, or gives exception 4 in a fault. A write of 0 sends
 * `shutdown`. The coil reads 1 while operation is enabled. Coil fault_reset: a write of 1 resets a
 * fault; the coil reads 0. Coil halt: bit 8 of the controlword. Coil store: a write of 1 is the
 * command store_parameters; the coil reads 1 while the parameter store is working. Coil
 * recorder_trigger: a write is a write to recorder_arm; the coil reads 1 while the recorder is
 * armed or recording. The discrete inputs (AXIS_DISCRETE_) are the bits of the statusword and then
 * three signals.
 *
 * The functions below start the work of a request; modbus_bits_resume() continues the request to
 * its end.*/

#include "firmware/modbus/step.h"

/* Answer a request with the states of coils or of discrete inputs, as one bit each. The first state
 * is the lowest bit of the first byte. Unused bits of the last byte are 0. */
void modbus_read_coils(modbus_request_t *r, uint16_t first, uint16_t count);
void modbus_read_discretes(modbus_request_t *r, uint16_t first, uint16_t count);

/* Writes all coils of the request. After an exception no coil is written. The exception is 3 if the
 * coil store is 1 together with recorder_trigger or enable. The coils are written in this order:
 * store or recorder_trigger, fault_reset, halt, enable. */
void modbus_write_coils(modbus_request_t *r, uint16_t first, uint16_t count, const uint8_t *bits);

void modbus_bits_resume(modbus_request_t *r);

#endif
