#include "firmware/canopen/mapping.h"

#include <stddef.h>

#include "firmware/fx/bytes.h"
#include "firmware/objects/value.h"

/* Number of bits of the data types 1 to 7 of CiA 301: boolean, i8, i16, i32, u8, u16, u32. */
static const uint8_t bits_of_dummy[] = {0, 1, 8, 16, 32, 8, 16, 32};

/* entry_index() returns the index of the object in a mapping entry, and entry_sub() returns its
 * sub-index. */
static uint16_t entry_index(uint32_t entry) { return (uint16_t)fx_field(entry, 16, 16); }
static uint8_t entry_sub(uint32_t entry) { return (uint8_t)fx_field(entry, 8, 8); }

static bool is_mappable(const axis_object_t *object, bool transmit) {
  const uint8_t refusing = transmit ? AXIS_ACCESS_WO : AXIS_ACCESS_RO;
  const bool permitted = object->mappable == AXIS_MAPPABLE_BOTH ||
                         (transmit && object->mappable == AXIS_MAPPABLE_SENT);
  return permitted && object->access != refusing;
}

int mapping_resolve(uint32_t entry, bool transmit, uint16_t *object) {
  const uint16_t index = entry_index(entry);
  *object = AXIS_OBJ_NONE;
  if (!transmit && index != 0 && index < sizeof(bits_of_dummy)) {
    const bool fits = entry_sub(entry) == 0 && mapping_bits(entry) == bits_of_dummy[index];
    return fits ? FW_OK : FW_ERROR_MAPPING;
  }
  const axis_address_t *address = dictionary_address(index, entry_sub(entry));
  if (address == NULL) {
    return FW_ERROR_NO_OBJECT;
  }
  if (address->what != AXIS_ADDRESS_OBJECT ||
      !is_mappable(&axis_objects[address->value], transmit) ||
      mapping_bits(entry) != value_bytes(axis_objects[address->value].type) * 8) {
    return FW_ERROR_MAPPING;
  }
  *object = address->value;
  return FW_OK;
}

bool mapping_is_in_force(uint16_t object, uint32_t value) {
  const bool receives =
      canopen_element(object, AXIS_OBJ_RPDO_MAPPING_1, CANOPEN_PDOS * PDO_ENTRIES) >= 0;
  const bool transmits =
      canopen_element(object, AXIS_OBJ_TPDO_MAPPING_1, CANOPEN_PDOS * PDO_ENTRIES) >= 0;
  uint16_t mapped = AXIS_OBJ_NONE;
  return (!receives && !transmits) || value == 0 ||
         mapping_resolve(value, transmits, &mapped) == FW_OK;
}

int mapping_objects(const uint32_t *entries, uint8_t count, bool transmit,
                    uint16_t mapped[PDO_ENTRIES]) {
  int bits = 0;
  for (uint8_t i = 0; i < count; i++) {
    const int refusal = mapping_resolve(entries[i], transmit, &mapped[i]);
    bits += mapping_bits(entries[i]);
    if (refusal != FW_OK || bits > PDO_BITS) {
      return FW_ERROR_MAPPING;
    }
  }
  return bits;
}

void mapping_places(const dictionary_t *objects, const uint16_t mapped[PDO_ENTRIES], uint8_t count,
                    uint16_t places[PDO_BYTES]) {
  uint8_t at = 0;
  for (uint8_t i = 0; i < count; i++) {
    const uint16_t first = dictionary_place(objects, mapped[i]);
    const uint8_t bytes = value_bytes(axis_objects[mapped[i]].type);
    for (uint8_t byte = 0; byte < bytes; byte++, at++) {
      places[at] = (uint16_t)(first + byte);
    }
  }
  for (; at < PDO_BYTES; at++) {
    places[at] = dictionary_place(objects, AXIS_OBJ_NONE);
  }
}
