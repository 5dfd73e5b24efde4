#include "firmware/storage/entries.h"

#include <stddef.h>

#include "firmware/canopen/mapping.h"
#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/generated/axis_objects.h"

/* Bit 24 of the first word of an entry. It is 1 if the parameter had its default when it was
 * stored. */
#define ENTRY_AT_DEFAULT UINT32_C(0x01000000)

/* Returns the change of the object at this address since version 0.1.0 of the object table, or NULL
 * if the object has not changed. */
static const axis_change_t *change_at(uint32_t address) {
  const axis_change_t *change = axis_changes_0_1_0;
  while (change->address != 0 && change->address != address) {
    change++;
  }
  return (change->address != 0) ? change : NULL;
}

/* Returns the node id if the default of the object contains the node id. Otherwise returns 0. */
static uint32_t entry_node_id(const dictionary_t *objects, uint16_t object) {
  int32_t node_id = 0;
  if (axis_objects[object].node_id != 0) {
    (void)dictionary_read(objects, AXIS_OBJ_NODE_ID, &node_id);
  }
  return (uint32_t)node_id;
}

/* Handles an entry whose parameter had its default when it was stored. If the default differs in
 * the present object table, the verdict on the entry becomes ENTRY_OLD_DEFAULT. */
static void check_default(const dictionary_t *objects, entry_t *entry) {
  if (entry->value != axis_objects[entry->object].initial) {
    entry->verdict = ENTRY_OLD_DEFAULT;
  }
  entry->value = fx_s32_from_u32((uint32_t)entry->value + entry_node_id(objects, entry->object));
}

static entry_t read_entry(const store_memory_t *memory, const dictionary_t *objects, uint32_t magic,
                          uint32_t at) {
  uint8_t words[ENTRY_BYTES];
  memory->read(memory->context, at, words, record_entry_bytes(magic));
  const uint32_t first = fx_load_le32(&words[0]);
  entry_t entry;
  entry.address = fx_field(first, 0, 24);
  entry.object = dictionary_object_at(entry.address);
  entry.value = fx_s32_from_u32(fx_load_le32(&words[4]));
  const uint32_t flags = first - entry.address;
  bool fits = dictionary_restorable(entry.object, entry.value);
  if (magic == RECORD_SET) {
    fits = fits && (flags == 0 || flags == ENTRY_AT_DEFAULT) &&
           fx_load_le32(&words[8]) == axis_objects[entry.object].signature;
  } else {
    const axis_change_t *change = change_at(entry.address);
    fits = fits && flags == 0 && (change == NULL || change->fits != 0);
  }
  entry.verdict = fits ? ENTRY_FITS : ENTRY_DROPPED;
  if (fits && flags == ENTRY_AT_DEFAULT) {
    check_default(objects, &entry);
  }
  if (fits && !mapping_is_in_force(entry.object, (uint32_t)entry.value)) {
    entry.verdict = ENTRY_INERT;
  }
  return entry;
}

entries_t entries_of(const record_t *record) {
  return (entries_t){.record = *record, .next = 0, .change = axis_changes_0_1_0};
}

static uint32_t entry_at(const record_t *record, uint32_t offset) {
  return record->begin + RECORD_HEAD_BYTES + offset;
}

static bool has_entry(const store_memory_t *memory, const record_t *record, uint32_t address) {
  const uint32_t size = record_entry_bytes(record->magic);
  bool found = false;
  for (uint32_t i = 0; !found && i < record->entries; i += size) {
    found = record_word(memory, entry_at(record, i)) == address;
  }
  return found;
}

/* A parameter set of version 0.1.0 does not contain parameters that had their default. Finds the
 * next such parameter that has changed in the object table since then. */
static bool next_omitted(const store_memory_t *memory, const dictionary_t *objects,
                         entries_t *entries, entry_t *entry) {
  const axis_change_t *change = entries->change;
  while (change->address != 0 && has_entry(memory, &entries->record, change->address)) {
    change++;
  }
  if (change->address == 0) {
    return false;
  }
  entries->change = change + 1;
  *entry = (entry_t){.address = change->address,
                     .object = dictionary_object_at(change->address),
                     .value = change->initial,
                     .verdict = (change->fits != 0) ? ENTRY_FITS : ENTRY_DROPPED};
  if (change->fits != 0) {
    check_default(objects, entry);
  }
  return true;
}

bool entries_next(const store_memory_t *memory, const dictionary_t *objects, entries_t *entries,
                  entry_t *entry) {
  const record_t *record = &entries->record;
  if (entries->next < record->entries) {
    *entry = read_entry(memory, objects, record->magic, entry_at(record, entries->next));
    entries->next += record_entry_bytes(record->magic);
    return true;
  }
  return record->magic == RECORD_SET_0_1_0 && next_omitted(memory, objects, entries, entry);
}

int32_t entries_value(const store_memory_t *memory, const dictionary_t *objects,
                      const record_t *record, uint16_t object) {
  entries_t entries = entries_of(record);
  entry_t entry;
  while (record->magic != RECORD_NONE && entries_next(memory, objects, &entries, &entry)) {
    if (entry.object == object && entry.verdict != ENTRY_DROPPED) {
      return entry.value;
    }
  }
  return fx_s32_from_u32((uint32_t)axis_objects[object].initial + entry_node_id(objects, object));
}

/* Returns the address of an object, which is its CANopen index times 256 plus its sub-index. */
static uint32_t address_of(uint16_t object) {
  uint32_t found = 0;
  for (uint16_t i = 0; i < AXIS_ADDRESSES_COUNT; i++) {
    if (axis_addresses[i].what == AXIS_ADDRESS_OBJECT && axis_addresses[i].value == object) {
      found = (uint32_t)axis_addresses[i].index * 256 + axis_addresses[i].sub;
    }
  }
  return found;
}

void entry_write(uint8_t entry[ENTRY_BYTES], const dictionary_t *objects, uint16_t object,
                 int32_t value) {
  const uint32_t initial = (uint32_t)axis_objects[object].initial;
  const bool is_default = (uint32_t)value == initial + entry_node_id(objects, object);
  fx_store_le(&entry[0], address_of(object) | (is_default ? ENTRY_AT_DEFAULT : 0), 4);
  fx_store_le(&entry[4], is_default ? initial : (uint32_t)value, 4);
  fx_store_le(&entry[8], axis_objects[object].signature, 4);
}
