#include "firmware/storage/store.h"

#include <stddef.h>

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"

_Static_assert((unsigned)STORE_SECTOR_MIN >= (unsigned)STORE_SET_BYTES, "a sector holds a set");

enum { READ_BACK_BYTES = 64 };

enum { STEP_IDLE, STEP_ERASE, STEP_BLANK, STEP_HEAD, STEP_ENTRIES, STEP_CRC, STEP_READ_BACK };

void store_init(store_t *store, const store_memory_t *memory) {
  const bool fits = memory != NULL && memory->sector_bytes >= STORE_SECTOR_MIN;
  store->memory = fits ? memory : NULL;
  store->home = STORE_NOWHERE;
  store->tail = 0;
  store->sequence = 0;
  store->set = STORE_NOWHERE;
  store->change_count = 0;
  store->dropped = 0;
  for (uint8_t i = 0; i < STORE_CHANGES; i++) {
    store->changes[i] = 0;
  }
  store->step = STEP_IDLE;
}

/* Returns true if the parameter set of a record can be loaded. If the set belongs to the present
 * object table, all its entries must match the table. The entries of another table are compared one
 * by one during the load. */
static bool is_usable(const store_t *store, const dictionary_t *objects, const record_t *record) {
  bool usable = record->magic == RECORD_SET || record->magic == RECORD_FORGOTTEN ||
                (record->magic == RECORD_SET_0_1_0 && record->hash == AXIS_OBJECTS_HASH32_0_1_0);
  if (record->magic == RECORD_SET && record->hash == AXIS_OBJECTS_HASH32) {
    entries_t entries = entries_of(record);
    entry_t entry;
    while (usable && entries_next(store->memory, objects, &entries, &entry)) {
      usable = entry.verdict != ENTRY_DROPPED;
    }
  }
  return usable;
}

/* Stores the address of a parameter that does not have its stored value, or that keeps the default
 * of an earlier object table. */
static void note_change(store_t *store, const entry_t *entry) {
  const bool dropped = entry->verdict != ENTRY_OLD_DEFAULT;
  if (store->change_count < STORE_CHANGES) {
    store->changes[store->change_count] =
        entry->address | (dropped ? STORE_CHANGE_DROPPED : STORE_CHANGE_OLD_DEFAULT);
  }
  store->change_count = (uint16_t)(store->change_count + 1);
  store->dropped = dropped ? 1 : store->dropped;
}

/* Restores the value of an entry to its object if the object belongs to `block`. AXIS_BLOCK_NONE
 * stands for every block. */
static void restore(dictionary_t *objects, const entry_t *entry, uint8_t block) {
  if (entry->verdict != ENTRY_DROPPED &&
      (block == AXIS_BLOCK_NONE || axis_objects[entry->object].block == block)) {
    dictionary_restore(objects, entry->object, entry->value);
  }
}

static uint32_t other_sector(uint32_t sector) { return (sector == 0) ? 1 : 0; }

static uint32_t sector_of(const store_t *store, uint32_t at) {
  return (at < store->memory->sector_bytes) ? 0 : 1;
}

/* Returns the offset in bytes, from the start of the sector, at which a record ends. */
static uint32_t end_of(const store_t *store, const record_t *record) {
  const uint32_t sector = sector_of(store, record->begin);
  return record->begin - sector * store->memory->sector_bytes + record_bytes(record->entries);
}

/* Sets store->home and store->tail, so that the next record is programmed after this record and
 * after all following bytes that are not blank. The CRC of this record may look like blank
 * bytes. */
static void settle(store_t *store, const record_t *record) {
  const uint32_t end = end_of(store, record);
  store->home = sector_of(store, record->begin);
  store->tail = record_tail(store->memory, store->home);
  store->tail = (store->tail < end) ? end : store->tail;
}

/* Returns true if the memory has bytes that only a newer parameter set can have left: bytes after
 * this set, or a used sector that does not begin with a complete record. */
static bool has_remains(const store_t *store, const record_t *record) {
  const uint32_t sector_bytes = store->memory->sector_bytes;
  if (store->tail > end_of(store, record)) {
    return true;
  }
  const uint32_t other = other_sector(store->home);
  record_t first;
  return record_tail(store->memory, other) != 0 &&
         !record_read(store->memory, other * sector_bytes, (other + 1) * sector_bytes, &first);
}

static uint8_t state_of_loaded(const store_t *store, bool older) {
  if (older) {
    return AXIS_STORE_STATE_LOADED_OLDER;
  }
  if (store->dropped != 0) {
    return AXIS_STORE_STATE_LOADED_PARTLY;
  }
  return (store->change_count != 0) ? AXIS_STORE_STATE_LOADED_OLD_DEFAULTS
                                    : AXIS_STORE_STATE_LOADED;
}

uint8_t store_load(store_t *store, dictionary_t *objects) {
  store_init(store, store->memory);
  if (store->memory == NULL) {
    return AXIS_STORE_STATE_EMPTY;
  }
  record_t newest[2];
  record_newest(store->memory, newest);
  if (newest[0].magic == RECORD_NONE) {
    const bool blank = record_tail(store->memory, 0) == 0 && record_tail(store->memory, 1) == 0;
    return blank ? AXIS_STORE_STATE_EMPTY : AXIS_STORE_STATE_FAILED;
  }
  const record_t *record = &newest[0];
  settle(store, record);
  store->sequence = record->sequence;
  bool older = has_remains(store, record);
  if (!is_usable(store, objects, record)) {
    if (record->magic == RECORD_SET_0_1_0) {
      return AXIS_STORE_STATE_OTHER_TABLE;
    }
    record = &newest[1];
    if (!is_usable(store, objects, record)) {
      return AXIS_STORE_STATE_FAILED;
    }
    settle(store, record);
    older = true;
  }
  if (record->magic == RECORD_FORGOTTEN) {
    return older ? AXIS_STORE_STATE_LOADED_OLDER : AXIS_STORE_STATE_EMPTY;
  }
  store->set = record->begin;
  entries_t entries = entries_of(record);
  entry_t entry;
  while (entries_next(store->memory, objects, &entries, &entry)) {
    restore(objects, &entry, AXIS_BLOCK_NONE);
    if (entry.verdict != ENTRY_FITS) {
      note_change(store, &entry);
    }
  }
  return state_of_loaded(store, older);
}

bool store_load_block(const store_t *store, dictionary_t *objects, uint8_t block) {
  if (store->set == STORE_NOWHERE) {
    return true;
  }
  const uint32_t end = (sector_of(store, store->set) + 1) * store->memory->sector_bytes;
  record_t record;
  if (!record_read(store->memory, store->set, end, &record)) {
    return false;
  }
  entries_t entries = entries_of(&record);
  entry_t entry;
  while (entries_next(store->memory, objects, &entries, &entry)) {
    restore(objects, &entry, block);
  }
  return true;
}

static uint32_t bytes_of_entries(const store_t *store) {
  return (store->forget != 0) ? 0 : (uint32_t)ENTRY_BYTES * AXIS_STORED_COUNT;
}

/* Returns the address at which the entries of the record end and its CRC begins. */
static uint32_t entries_end(const store_t *store) {
  return store->begin + RECORD_HEAD_BYTES + bytes_of_entries(store);
}

/* Begins a record in a sector: after the newest parameter set, or at the start of the other sector,
 * which is erased first. */
static void begin_in(store_t *store, uint32_t sector) {
  const bool behind = sector == store->home;
  store->sector = (uint8_t)sector;
  store->begin = sector * store->memory->sector_bytes + (behind ? store->tail : 0);
  store->at = store->begin;
  store->object = AXIS_OBJ_NONE + 1;
  store->crc = UINT32_MAX;
  store->check = UINT32_MAX;
  store->sequence += 1;
  store->step = behind ? STEP_HEAD : STEP_ERASE;
}

static int begin(store_t *store, bool forget) {
  if (store->memory == NULL) {
    return FW_ERROR_NO_MEMORY;
  }
  if (store_is_busy(store)) {
    return FW_ERROR_BUSY;
  }
  store->forget = forget ? 1 : 0;
  store->again = 0;
  const bool fits = store->home != STORE_NOWHERE && store->memory->sector_bytes - store->tail >=
                                                        record_bytes(bytes_of_entries(store));
  begin_in(store, fits ? store->home : other_sector(store->home));
  return FW_OK;
}

static int begin_save(store_t *store, const record_t *basis, uint16_t first, uint16_t last) {
  const int refusal = begin(store, false);
  if (refusal == FW_OK) {
    store->basis = *basis;
    store->first = first;
    store->last = last;
  }
  return refusal;
}

int store_save(store_t *store) {
  const record_t none = {.magic = RECORD_NONE};
  return begin_save(store, &none, AXIS_OBJ_NONE, AXIS_OBJ_COUNT);
}

int store_save_only(store_t *store, uint16_t first, uint16_t last) {
  record_t basis = {.magic = RECORD_NONE};
  if (store->memory != NULL && store->set != STORE_NOWHERE) {
    const uint32_t end = (sector_of(store, store->set) + 1) * store->memory->sector_bytes;
    if (!record_read(store->memory, store->set, end, &basis)) {
      return FW_ERROR_NO_DATA;
    }
  }
  return begin_save(store, &basis, first, last);
}

int store_forget(store_t *store) { return begin(store, true); }

/* Ends the attempt to write the record in this sector. Begins a second attempt in the other sector,
 * if that sector does not contain the newest parameter set. */
static uint8_t give_up(store_t *store) {
  const uint32_t other = other_sector(store->sector);
  if (store->sector == store->home) {
    store->tail = store->memory->sector_bytes;
  }
  if (other != store->home && store->again == 0) {
    store->again = 1;
    begin_in(store, other);
    return AXIS_STORE_STATE_SAVING;
  }
  store->step = STEP_IDLE;
  return AXIS_STORE_STATE_FAILED;
}

/* Programs the next bytes of the record. Returns false if the memory reports a failure. */
static bool program(store_t *store, const uint8_t *bytes, uint32_t count) {
  const bool done = store->memory->program(store->memory->context, store->at, bytes, count);
  store->at += count;
  return done;
}

static bool program_checked(store_t *store, const uint8_t *bytes, uint32_t count) {
  store->crc = record_crc(store->crc, bytes, count);
  return program(store, bytes, count);
}

static bool step_blank(store_t *store) {
  const uint32_t end = (store->sector + UINT32_C(1)) * store->memory->sector_bytes;
  bool blank = true;
  for (uint32_t i = 0; i < READ_BACK_BYTES && store->at < end; i += 4) {
    blank = blank && record_word(store->memory, store->at) == UINT32_MAX;
    store->at += 4;
  }
  if (store->at == end) {
    store->at = store->begin;
    store->step = STEP_HEAD;
  }
  return blank;
}

/* Returns the next step of a save, after the bytes programmed so far. */
static uint8_t step_behind(const store_t *store) {
  return (store->at < entries_end(store)) ? STEP_ENTRIES : STEP_CRC;
}

static bool step_head(store_t *store) {
  uint8_t head[RECORD_HEAD_BYTES];
  fx_store_le(&head[0], (store->forget != 0) ? RECORD_FORGOTTEN : RECORD_SET, 4);
  fx_store_le(&head[4], AXIS_OBJECTS_HASH32, 4);
  fx_store_le(&head[8], store->sequence, 4);
  fx_store_le(&head[12], bytes_of_entries(store), 4);
  const bool done = program_checked(store, head, sizeof(head));
  store->step = step_behind(store);
  return done;
}

/* Returns the value that the save stores for the next object. */
static int32_t value_to_save(const store_t *store, const dictionary_t *objects) {
  int32_t value = 0;
  if (store->object < store->first || store->object > store->last) {
    /* Without a stored parameter set the first motion test is on at power-up. The first motion test
     * must stay on after this save. */
    const bool has_none = store->basis.magic == RECORD_NONE;
    return (has_none && store->object == AXIS_OBJ_FIRST_MOTION_TEST)
               ? AXIS_FIRST_MOTION_TEST_ON
               : entries_value(store->memory, objects, &store->basis, store->object);
  }
  (void)dictionary_read(objects, store->object, &value);
  return value;
}

static bool step_entry(store_t *store, const dictionary_t *objects) {
  while (axis_objects[store->object].stored == 0) {
    store->object = (uint16_t)(store->object + 1);
  }
  uint8_t entry[ENTRY_BYTES];
  entry_write(entry, objects, store->object, value_to_save(store, objects));
  store->object = (uint16_t)(store->object + 1);
  const bool done = program_checked(store, entry, sizeof(entry));
  store->step = step_behind(store);
  return done;
}

static bool step_crc(store_t *store) {
  uint8_t bytes[RECORD_CRC_BYTES];
  fx_store_le(bytes, ~store->crc, 4);
  const bool done = program(store, bytes, sizeof(bytes));
  store->at = store->begin;
  store->step = STEP_READ_BACK;
  return done;
}

static bool step_read_back(store_t *store) {
  const uint32_t end = entries_end(store);
  const uint32_t stop = (end - store->at < READ_BACK_BYTES) ? end : store->at + READ_BACK_BYTES;
  store->check = record_crc_of_memory(store->memory, store->check, store->at, stop);
  store->at = stop;
  if (stop < end) {
    return true;
  }
  if (store->check != store->crc || record_word(store->memory, end) != ~store->crc) {
    return false;
  }
  store->home = store->sector;
  store->tail = end + RECORD_CRC_BYTES - store->sector * store->memory->sector_bytes;
  store->set = (store->forget != 0) ? STORE_NOWHERE : store->begin;
  store->step = STEP_IDLE;
  return true;
}

static bool take_step(store_t *store, const dictionary_t *objects) {
  switch (store->step) {
    case STEP_ERASE:
      store->step = STEP_BLANK;
      return store->memory->erase(store->memory->context, store->sector);
    case STEP_BLANK:
      return step_blank(store);
    case STEP_HEAD:
      return step_head(store);
    case STEP_ENTRIES:
      return step_entry(store, objects);
    case STEP_CRC:
      return step_crc(store);
    default:
      return step_read_back(store);
  }
}

uint8_t store_tick(store_t *store, const dictionary_t *objects) {
  if (store->step == STEP_IDLE) {
    return AXIS_STORE_STATE_COUNT;
  }
  if (!take_step(store, objects)) {
    return give_up(store);
  }
  if (store->step != STEP_IDLE) {
    return AXIS_STORE_STATE_SAVING;
  }
  return (store->forget != 0) ? AXIS_STORE_STATE_RESTORED : AXIS_STORE_STATE_SAVED;
}
