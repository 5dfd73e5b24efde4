#ifndef FIRMWARE_MODBUS_MAP_H_
#define FIRMWARE_MODBUS_MAP_H_

/* Registers, coils and discrete inputs over the objects. Each call answers with MODBUS_OK or an
 * exception, and one that is refused has changed nothing.
 *
 * Registers: axis_holding and axis_input of the object table. 8 and 16 bits take one register, 32
 * bits two, in the order that modbus_word_order says; negative values are two's complement, of
 * which the upper bits of a register are part. A hole in the map is exception 2. Half of a 32-bit
 * object can be read; it cannot be written, exception 3. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/access.h"

enum {
  MODBUS_OK = 0,
  MODBUS_EXCEPTION_FUNCTION = 1, /* unknown function, or sub-function */
  MODBUS_EXCEPTION_ADDRESS = 2,  /* a register, coil or input that there is none of */
  MODBUS_EXCEPTION_VALUE = 3,    /* out of range, half of a 32-bit object, or a malformed request */
  MODBUS_EXCEPTION_STATE = 4,    /* not in this state, or another source owns the axis */
  MODBUS_EXCEPTION_BUSY = 6      /* the parameter store is at work */
};

/* Coils (AXIS_COIL_). enable: 1 is controlword shutdown, then enable operation (exception 4 in a
 * fault), 0 shutdown; reads 1 while operation is enabled. fault_reset: 1 gives it, reads 0. halt:
 * bit 8 of the controlword. store: 1 is store_parameters, reads 1 while that lasts.
 * recorder_trigger: recorder_arm, reads 1 while it is armed or recording. */

typedef enum { MODBUS_HOLDING, MODBUS_INPUT } modbus_table_t;

/* Whether there are registers first .. first + count - 1, without a hole; count > 0. */
bool modbus_holds_registers(modbus_table_t table, uint16_t first, uint16_t count);

/* Registers first .. first + count - 1, high byte first. */
uint8_t modbus_read_registers(const dictionary_t *objects, modbus_table_t table, uint16_t first,
                              uint16_t count, uint8_t *to);

/* All of them or none: each value must be acceptable for itself, with what is there before the
 * request; then they are written in the order of the registers, but what cannot be taken back (the
 * controlword, a native mode, a command) last, so that a controlword finds the targets written with
 * it. Should one be refused nevertheless, those before it are written back, but for an
 * axis that was taken from LCM, which only LCM can take again. `words` is used up. */
uint8_t modbus_write_registers(dictionary_t *objects, uint16_t first, uint16_t count,
                               uint8_t *words);

/* One 16-bit object: (value and `and_mask`) or (`or_mask` and not `and_mask`). */
uint8_t modbus_mask_register(dictionary_t *objects, uint16_t first, uint16_t and_mask,
                             uint16_t or_mask);

/* Bits from the lowest of the first byte up, the last byte filled with 0. */
uint8_t modbus_read_coils(const dictionary_t *objects, uint16_t first, uint16_t count, uint8_t *to);
uint8_t modbus_read_discretes(const dictionary_t *objects, uint16_t first, uint16_t count,
                              uint8_t *to);

/* All or none; store cannot be 1 together with recorder_trigger or enable, exception 3. Order:
 * those two, fault reset, halt, enable. */
uint8_t modbus_write_coils(dictionary_t *objects, uint16_t first, uint16_t count,
                           const uint8_t *bits);

#endif
