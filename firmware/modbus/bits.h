#ifndef FIRMWARE_MODBUS_BITS_H_
#define FIRMWARE_MODBUS_BITS_H_

/* Coils (AXIS_COIL_). enable: writing 1 sends the controlword shutdown and then enable operation
 * (exception 4 in a fault), writing 0 sends shutdown; the coil reads 1 while operation is enabled.
 * fault_reset: writing 1 resets a fault; the coil reads 0. halt: bit 8 of the controlword. store:
 * writing 1 is the command store_parameters; the coil reads 1 while the store is working.
 * recorder_trigger: recorder_arm; the coil reads 1 while the recorder is armed or recording.
 * Discrete inputs (AXIS_DISCRETE_): the bits of the statusword, then three signals.
 *
 * The functions below start the work of a request; modbus_bits_resume() continues the request to
 * its end. */

#include "firmware/modbus/step.h"

/* Answer with the requested coils or discrete inputs, one bit each. The first bit is the lowest bit
 * of the first byte; unused bits of the last byte are 0. */
void modbus_read_coils(modbus_request_t *r, uint16_t first, uint16_t count);
void modbus_read_discretes(modbus_request_t *r, uint16_t first, uint16_t count);

/* Writes all coils of the request or, after an exception, no coil. Exception 3 if store is 1
 * together with recorder_trigger or enable. Order of the writes: store or recorder_trigger,
 * fault_reset, halt, enable. */
void modbus_write_coils(modbus_request_t *r, uint16_t first, uint16_t count, const uint8_t *bits);

void modbus_bits_resume(modbus_request_t *r);

#endif
