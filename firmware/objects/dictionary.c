#include "firmware/objects/dictionary.h"

#include <stddef.h>

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/generated/axis_objects.h"
#include "firmware/objects/value.h"

void dictionary_init(dictionary_t *objects, const dictionary_owner_t *owner) {
  objects->owner = owner;
  objects->writers = 0;
  objects->zero = 0;
}

static bool exists(uint16_t object) { return object != AXIS_OBJ_NONE && object < AXIS_OBJ_COUNT; }

bool dictionary_has_value(uint16_t object) {
  return exists(object) && axis_objects[object].block != AXIS_BLOCK_NONE;
}

static bool in_range(const axis_object_t *entry, int32_t value) {
  if (entry->type == AXIS_TYPE_U32) {
    return (uint32_t)value >= (uint32_t)entry->min && (uint32_t)value <= (uint32_t)entry->max;
  }
  return value >= entry->min && value <= entry->max;
}

static bool is_forbidden_zero(const axis_object_t *entry, int32_t value) {
  return value == 0 && entry->not_zero != 0;
}

static uint16_t place_of(const dictionary_t *objects, const axis_object_t *entry) {
  return (uint16_t)(objects->owner->blocks[entry->block].offset + entry->offset);
}

uint16_t dictionary_place(const dictionary_t *objects, uint16_t object) {
  fx_assert(object == AXIS_OBJ_NONE || dictionary_has_value(object));
  return (object == AXIS_OBJ_NONE) ? (uint16_t)offsetof(dictionary_t, zero)
                                   : place_of(objects, &axis_objects[object]);
}

int dictionary_read(const dictionary_t *objects, uint16_t object, int32_t *value) {
  if (!exists(object)) {
    return FW_ERROR_NO_OBJECT;
  }
  const axis_object_t *entry = &axis_objects[object];
  if (entry->access == AXIS_ACCESS_WO) {
    return FW_ERROR_WRITE_ONLY;
  }
  /* A command has no value. A read of a command therefore returns its initial value in the object
   * table. */
  *value = (entry->block == AXIS_BLOCK_NONE)
               ? entry->initial
               : value_load(objects, place_of(objects, entry), entry->type);
  return FW_OK;
}

/* Returns FW_OK if the write is permitted. Otherwise returns the error code of the refusal. The
 * result depends on the object table, on the owner of the axis and on the state of the axis. */
static int refusal_of(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value) {
  if (!exists(object)) {
    return FW_ERROR_NO_OBJECT;
  }
  const axis_object_t *entry = &axis_objects[object];
  if (entry->access == AXIS_ACCESS_RO) {
    return FW_ERROR_READ_ONLY;
  }
  if (!in_range(entry, value)) {
    return FW_ERROR_RANGE;
  }
  const int refusal = objects->owner->permit(objects, source, object, value);
  if (refusal != FW_OK || entry->block == AXIS_BLOCK_NONE) {
    return refusal;
  }
  if (is_forbidden_zero(entry, value)) {
    return FW_ERROR_RANGE;
  }
  const dictionary_block_t *block = &objects->owner->blocks[entry->block];
  return (block->check == NULL) ? FW_OK : block->check(objects, source, object, value);
}

int dictionary_check(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value) {
  return refusal_of(objects, source, object, value);
}

static void store_value(dictionary_t *objects, uint8_t source, uint16_t object, int32_t value) {
  const axis_object_t *entry = &axis_objects[object];
  const dictionary_block_t *block = &objects->owner->blocks[entry->block];
  const uint32_t place = (uint32_t)block->offset + entry->offset;
  const int32_t previous = value_load(objects, place, entry->type);
  value_store(objects, place, entry->type, value);
  if (block->written != NULL) {
    block->written(objects, source, object, previous, value);
  }
  const bool is_followed = entry->stored != 0 || entry->in_cycle == AXIS_IN_CYCLE_ENDS;
  if (is_followed && value != previous) {
    objects->owner->changed(objects, object);
  }
}

int dictionary_write_value(dictionary_t *objects, uint8_t source, uint16_t object, int32_t value) {
  if (!dictionary_has_value(object)) {
    return FW_ERROR_NO_OBJECT;
  }
  const int refusal = refusal_of(objects, source, object, value);
  if (refusal == FW_OK) {
    store_value(objects, source, object, value);
    if (!dictionary_is_open(object)) {
      dictionary_written_by(objects, source);
    }
  }
  return refusal;
}

bool dictionary_is_open(uint16_t object) {
  return object == AXIS_OBJ_CYCLE_RESULT_NUMBER || object == AXIS_OBJ_CYCLE_RESULT_ELEMENT ||
         object == AXIS_OBJ_CYCLE_CURVE_FIRST || object == AXIS_OBJ_CYCLE_ACKNOWLEDGE;
}

void dictionary_written_by(dictionary_t *objects, uint8_t source) {
  objects->writers = (uint8_t)(objects->writers | fx_bit(source));
}

bool dictionary_restorable(uint16_t object, int32_t value) {
  return exists(object) && axis_objects[object].stored != 0 &&
         in_range(&axis_objects[object], value) && !is_forbidden_zero(&axis_objects[object], value);
}

void dictionary_restore(dictionary_t *objects, uint16_t object, int32_t value) {
  const axis_object_t *entry = &axis_objects[object];
  value_store(objects, place_of(objects, entry), entry->type, value);
}

const axis_address_t *dictionary_address(uint16_t index, uint8_t sub) {
  uint16_t low = 0;
  uint16_t high = AXIS_ADDRESSES_COUNT;
  while (low < high) {
    const uint16_t middle = fx_half(low + high);
    const axis_address_t *address = &axis_addresses[middle];
    if (address->index == index && address->sub == sub) {
      return address;
    }
    if (address->index < index || (address->index == index && address->sub < sub)) {
      low = (uint16_t)(middle + 1);
    } else {
      high = middle;
    }
  }
  return NULL;
}

uint16_t dictionary_object_at(uint32_t address) {
  const axis_address_t *found =
      dictionary_address((uint16_t)fx_field(address, 8, 16), (uint8_t)address);
  return (found != NULL && found->what == AXIS_ADDRESS_OBJECT) ? found->value : AXIS_OBJ_NONE;
}

const char *dictionary_text(const dictionary_t *objects, uint16_t index) {
  return objects->owner->text(objects, index);
}

int32_t dictionary_domain_size(const dictionary_t *objects, uint16_t index) {
  return objects->owner->domain_size(objects, index);
}

uint32_t dictionary_domain_read(const dictionary_t *objects, uint16_t index, uint32_t offset,
                                uint8_t *bytes, uint32_t count) {
  return objects->owner->domain_read(objects, index, offset, bytes, count);
}

uint32_t dictionary_download_most(const dictionary_t *objects, uint16_t index) {
  return objects->owner->download_most(objects, index);
}

/* Returns the result of a part of a download. If the bytes were accepted, they restart the watchdog
 * of the owner, as other accepted writes do. */
static int taken(dictionary_t *objects, uint8_t source, int result) {
  if (result == FW_OK) {
    dictionary_written_by(objects, source);
  }
  return result;
}

int dictionary_download_begin(dictionary_t *objects, uint8_t source, uint16_t index,
                              uint32_t size) {
  return taken(objects, source, objects->owner->download_begin(objects, source, index, size));
}

int dictionary_download_append(dictionary_t *objects, uint8_t source, uint32_t offset,
                               const uint8_t *bytes, uint32_t count) {
  return taken(objects, source, objects->owner->download_append(objects, offset, bytes, count));
}

int dictionary_download_end(dictionary_t *objects, uint8_t source, uint16_t index, uint32_t size) {
  return taken(objects, source, objects->owner->download_end(objects, source, index, size));
}
