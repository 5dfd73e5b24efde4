#ifndef FIRMWARE_CANOPEN_MAPPING_H_
#define FIRMWARE_CANOPEN_MAPPING_H_

/* Entries of a PDO's mapping (1600h.., 1A00h..): index, sub-index and bits of one object each. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/state.h"
#include "firmware/fx/bytes.h"
#include "firmware/objects/access.h"

static inline uint8_t mapping_bits(uint32_t entry) { return (uint8_t)fx_field(entry, 0, 8); }

/* FW_OK and the object (none: a dummy), or why the entry cannot be mapped: FW_ERROR_NO_OBJECT,
 * FW_ERROR_MAPPING. */
int mapping_resolve(uint32_t entry, bool transmit, uint16_t *object);

/* The objects of the first `count` entries (0..PDO_ENTRIES), none for a dummy. Returns their bits
 * together, or FW_ERROR_MAPPING if one of them cannot be mapped or they do not fit. */
int mapping_objects(const uint32_t *entries, uint8_t count, bool transmit,
                    uint16_t mapped[PDO_ENTRIES]);

/* False for an entry of a mapping (an AXIS_OBJ_ of 1600h.., 1A00h..) that cannot be mapped: stored
 * under another table. A PDO with it carries nothing. True for any other object. */
bool mapping_is_in_force(uint16_t object, uint32_t value);

/* Where in the dictionary each byte of a TPDO with these objects lies; bytes that nothing is mapped
 * to lie where a 0 is. */
void mapping_places(const dictionary_t *objects, const uint16_t mapped[PDO_ENTRIES], uint8_t count,
                    uint16_t places[PDO_BYTES]);

#endif
