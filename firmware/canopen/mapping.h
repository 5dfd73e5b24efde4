#ifndef FIRMWARE_CANOPEN_MAPPING_H_
#define FIRMWARE_CANOPEN_MAPPING_H_

/* Entries of a PDO mapping (1600h.., 1A00h..): each has index, sub-index and length in bits of one
 * object. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/state.h"
#include "firmware/fx/bytes.h"
#include "firmware/objects/access.h"

static inline uint8_t mapping_bits(uint32_t entry) { return (uint8_t)fx_field(entry, 0, 8); }

/* Returns FW_OK and the object of a mapping entry (none for a dummy), or the reason why it cannot
 * be mapped: FW_ERROR_NO_OBJECT or FW_ERROR_MAPPING. */
int mapping_resolve(uint32_t entry, bool transmit, uint16_t *object);

/* Finds the objects of the first `count` entries (0..PDO_ENTRIES), none for a dummy. Returns the
 * sum of their bits, or FW_ERROR_MAPPING if an object cannot be mapped or the sum exceeds the
 * PDO. */
int mapping_objects(const uint32_t *entries, uint8_t count, bool transmit,
                    uint16_t mapped[PDO_ENTRIES]);

/* Whether a mapping entry (an AXIS_OBJ_ of 1600h.., 1A00h..) can be mapped. It returns false for an
 * entry that was stored under another object table; a PDO with such an entry carries nothing. It
 * returns true for any other object. */
bool mapping_is_in_force(uint16_t object, uint32_t value);

/* Finds the offset in the dictionary of each byte of a TPDO with these objects. A byte without a
 * mapped object gets the offset of a byte that is always 0. */
void mapping_places(const dictionary_t *objects, const uint16_t mapped[PDO_ENTRIES], uint8_t count,
                    uint16_t places[PDO_BYTES]);

#endif
