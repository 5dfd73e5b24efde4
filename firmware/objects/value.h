#ifndef FIRMWARE_OBJECTS_VALUE_H_
#define FIRMWARE_OBJECTS_VALUE_H_

/* Functions for values in a structure that have a type of the object table (AXIS_TYPE_). All values
 * are passed as int32; an unsigned 32-bit value keeps its bits. `offset` is the number of bytes
 * from `base` and must be aligned for the type. */

#include <stdint.h>

#include "firmware/fx/assertion.h"
#include "firmware/objects/generated/axis_table.h"

/* Size in bytes of a value of each type (AXIS_TYPE_): 1, 2 or 4. */
extern const uint8_t value_bytes_of_type[AXIS_TYPE_I32 + 1];
static inline uint8_t value_bytes(uint8_t type) {
  fx_assert(type <= AXIS_TYPE_I32);
  return value_bytes_of_type[type];
}

int32_t value_load(const void *base, uint32_t offset, uint8_t type);

/* Stores a value in a structure. The value must be in the range of the type. */
void value_store(void *base, uint32_t offset, uint8_t type, int32_t value);

/* Sets every object of one block (AXIS_BLOCK_) to its value at power-up. `structure` contains the
 * values of this block. */
void value_store_defaults(void *structure, uint8_t block);

/* Returns the value that the recorder has stored in the bits `bits`, as a signed number. `type` is
 * the type of the value. */
int32_t value_from_bits(uint32_t bits, uint8_t type);

#endif
