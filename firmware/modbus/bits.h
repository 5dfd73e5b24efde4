#ifndef FIRMWARE_MODBUS_BITS_H_
#define FIRMWARE_MODBUS_BITS_H_

/* Coils (AXIS_COIL_). enable: 1 is controlword shutdown, then enable operation (exception 4 in a
 * fault), 0 shutdown; reads 1 while operation is enabled. fault_reset: 1 resets a fault, reads 0.
 * halt: bit 8 of the controlword. store: 1 is store_parameters, reads 1 while that lasts.
 * recorder_trigger: recorder_arm, reads 1 while it is armed or recording.
 * Discrete inputs (AXIS_DISCRETE_): the bits of the statusword, then three signals.
 *
 * The calls below start the work of a request; modbus_bits_resume() continues it to its end. */

#include "firmware/modbus/step.h"

/* Answer with bits from the lowest of the first byte up, the last byte filled with 0. */
void modbus_read_coils(modbus_request_t *r, uint16_t first, uint16_t count);
void modbus_read_discretes(modbus_request_t *r, uint16_t first, uint16_t count);

/* All or none; store cannot be 1 together with recorder_trigger or enable, exception 3. Order:
 * those two, fault reset, halt, enable. */
void modbus_write_coils(modbus_request_t *r, uint16_t first, uint16_t count, const uint8_t *bits);

void modbus_bits_resume(modbus_request_t *r);

#endif
