#ifndef FIRMWARE_MODBUS_REGISTERS_H_
#define FIRMWARE_MODBUS_REGISTERS_H_

/* Modbus registers of the objects. The tables axis_holding and axis_input of the object table have
 * the holding registers and the input registers. An object of 8 or 16 bits has one register; an
 * object of 32 bits has two, in the order of modbus_word_order. Negative values are two's
 * complement, sign-extended to the register. Access to an address without a register gives
 * exception 2. Half of a 32-bit object can be read; a write to half of a 32-bit object gives
 * exception 3.
 *
 * The functions below start the work of a request; modbus_registers_resume() continues the request
 * to its end.*/

#include "firmware/modbus/step.h"

typedef enum { MODBUS_HOLDING, MODBUS_INPUT } modbus_table_t;

/* Returns true if all registers from `first` to `first` + `count` - 1 exist; `count` must be above
 * 0. */
bool modbus_registers_exist(modbus_table_t table, uint16_t first, uint16_t count);

/* Answers with the values of `count` registers; the first register is `first`. */
void modbus_read_registers(modbus_request_t *r, modbus_table_t table, uint16_t first,
                           uint16_t count);

/* Writes `count` registers from `first` on: all of them, or none after an exception. Then reads
 * r->read_count registers from r->read_first on. In `words` the high byte of each word is first.
 * The function overwrites `words`.
 *
 * First each value is checked separately, while all other objects have their values from before the
 * request. Then the values are written in the order of the registers. Irreversible writes (the
 * controlword, a native mode, a command) come last, so that a controlword acts on the targets in
 * the same request. If a write is still refused, the earlier writes are undone. An axis that was
 * acquired from LCM is not returned to LCM, because only LCM can acquire the axis again. */
void modbus_write_registers(modbus_request_t *r, uint16_t first, uint16_t count, uint8_t *words);

/* Modbus function 22: writes (old value AND r->and_mask) OR (r->or_mask AND NOT r->and_mask) to an
 * object of 16 bits. */
void modbus_mask_register(modbus_request_t *r, uint16_t first);

void modbus_registers_resume(modbus_request_t *r);

#endif
