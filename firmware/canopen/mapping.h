#ifndef FIRMWARE_CANOPEN_MAPPING_H_
#define FIRMWARE_CANOPEN_MAPPING_H_

/* Entries of a PDO mapping (1600h.., 1A00h..). Each entry contains the index, the sub-index and the
 * length in bits of one object. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/state.h"
#include "firmware/fx/bytes.h"
#include "firmware/objects/access.h"

static inline uint8_t mapping_bits(uint32_t entry) { return (uint8_t)fx_field(entry, 0, 8); }

/* Finds the object of a mapping entry; a dummy entry has no object (AXIS_OBJ_NONE). Returns FW_OK,
 * or FW_ERROR_NO_OBJECT or FW_ERROR_MAPPING if the entry cannot be mapped. */
int mapping_resolve(uint32_t entry, bool transmit, uint16_t *object);

/* Finds the objects of the first `count` mapping entries (0..PDO_ENTRIES); a dummy entry has no
 * object (AXIS_OBJ_NONE). Returns the sum of the lengths of these entries in bits, or
 * FW_ERROR_MAPPING if an entry cannot be mapped or the PDO would be longer than PDO_BITS. */
int mapping_objects(const uint32_t *entries, uint8_t count, bool transmit,
                    uint16_t mapped[PDO_ENTRIES]);

/* Returns true if `object` is a mapping entry (an AXIS_OBJ_ of 1600h.., 1A00h..) whose value
 * `value` can be mapped. Also returns true for every object that is no mapping entry. Returns false
 * if the entry was stored under another object table and cannot be mapped now. A PDO with such an
 * entry carries no data. */
bool mapping_is_in_force(uint16_t object, uint32_t value);

/* For each byte of a TPDO with the mapped objects `mapped`, finds the offset of the byte in the
 * dictionary. A byte without a mapped object gets the offset of a byte that is always 0. */
void mapping_places(const dictionary_t *objects, const uint16_t mapped[PDO_ENTRIES], uint8_t count,
                    uint16_t places[PDO_BYTES]);

#endif
