#ifndef FIRMWARE_MODBUS_REGISTERS_H_
#define FIRMWARE_MODBUS_REGISTERS_H_

/* Registers over the objects: axis_holding and axis_input of the object table. 8 and 16 bits occupy
 * one register, 32 bits two, in the order of modbus_word_order; negative values are two's
 * complement, sign-extended to the register. A hole in the map is exception 2.
 * Half of a 32-bit object can be read; it cannot be written, exception 3.
 *
 * The calls below start the work of a request; modbus_registers_resume() continues it to its end.
 */

#include "firmware/modbus/step.h"

typedef enum { MODBUS_HOLDING, MODBUS_INPUT } modbus_table_t;

/* Whether there are registers first .. first + count - 1, without a hole; count > 0. */
bool modbus_registers_exist(modbus_table_t table, uint16_t first, uint16_t count);

/* Answers with `count` registers from `first` on. */
void modbus_read_registers(modbus_request_t *r, modbus_table_t table, uint16_t first,
                           uint16_t count);

/* Writes `count` registers from `first` on, all of them or none, then reads r->read_count
 * registers from r->read_first on. `words`, high byte first, are overwritten.
 *
 * Each value must be acceptable by itself, beside the values from before the request; then they are
 * written in the order of the registers, but irreversible writes (the controlword, a native mode, a
 * command) last, so that a controlword acts on the targets written with it. If one is refused
 * nevertheless, those before it are restored, except the ownership of an axis acquired from LCM,
 * which only LCM can acquire again. */
void modbus_write_registers(modbus_request_t *r, uint16_t first, uint16_t count, uint8_t *words);

/* Writes one 16-bit object: (value and r->and_mask) or (r->or_mask and not r->and_mask). */
void modbus_mask_register(modbus_request_t *r, uint16_t first);

void modbus_registers_resume(modbus_request_t *r);

#endif
