#include "firmware/app/store.h"

#include <stddef.h>

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"

_Static_assert((unsigned)STORE_SECTOR_MIN >= (unsigned)STORE_SET_BYTES, "a sector holds a set");

enum { READ_BACK_BYTES = 64 };

enum { STEP_IDLE, STEP_ERASE, STEP_BLANK, STEP_HEAD, STEP_ENTRIES, STEP_CRC, STEP_READ_BACK };

/* Bit 24 of an entry's first word: the parameter was at its default. */
#define AT_DEFAULT UINT32_C(0x01000000)

typedef enum { ENTRY_FITS, ENTRY_OLD_DEFAULT, ENTRY_DROPPED } verdict_t;

/* An entry as it applies to the present table. */
typedef struct {
  uint32_t address; /* index times 256 plus sub-index */
  uint16_t object;
  int32_t value;
  verdict_t verdict;
} entry_t;

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

/* The object at an address, or AXIS_OBJ_NONE. */
static uint16_t object_at(uint32_t address) {
  const axis_address_t *found =
      dictionary_address((uint16_t)fx_field(address, 8, 16), (uint8_t)fx_field(address, 0, 8));
  return (found != NULL && found->what == AXIS_ADDRESS_OBJECT) ? found->value : AXIS_OBJ_NONE;
}

/* What the table of 0.1.0 had otherwise at an address, or NULL. */
static const axis_change_t *change_at(uint32_t address) {
  const axis_change_t *change = axis_changes_0_1_0;
  while (change->address != 0 && change->address != address) {
    change++;
  }
  return (change->address != 0) ? change : NULL;
}

/* The node id where an object's default follows it, else 0. */
static uint32_t node_id_of(const dictionary_t *objects, uint16_t object) {
  int32_t node_id = 0;
  if (axis_objects[object].node_id != 0) {
    (void)dictionary_read(objects, AXIS_OBJ_NODE_ID, &node_id);
  }
  return (uint32_t)node_id;
}

/* A default of the set's table, which need not be today's. */
static void judge_default(const dictionary_t *objects, entry_t *entry) {
  if (entry->value != axis_objects[entry->object].initial) {
    entry->verdict = ENTRY_OLD_DEFAULT;
  }
  entry->value = fx_s32_from_u32((uint32_t)entry->value + node_id_of(objects, entry->object));
}

static entry_t read_entry(const store_t *store, const dictionary_t *objects, uint32_t magic,
                          uint32_t at) {
  uint8_t words[STORE_ENTRY_BYTES];
  store->memory->read(store->memory->context, at, words, record_entry_bytes(magic));
  const uint32_t first = fx_load_le32(&words[0]);
  entry_t entry;
  entry.address = fx_field(first, 0, 24);
  entry.object = object_at(entry.address);
  entry.value = fx_s32_from_u32(fx_load_le32(&words[4]));
  const uint32_t flags = first - entry.address;
  bool fits = dictionary_restorable(entry.object, entry.value);
  if (magic == RECORD_SET) {
    fits = fits && (flags == 0 || flags == AT_DEFAULT) &&
           fx_load_le32(&words[8]) == axis_objects[entry.object].signature;
  } else {
    const axis_change_t *change = change_at(entry.address);
    fits = fits && flags == 0 && (change == NULL || change->fits != 0);
  }
  entry.verdict = fits ? ENTRY_FITS : ENTRY_DROPPED;
  if (fits && flags == AT_DEFAULT) {
    judge_default(objects, &entry);
  }
  return entry;
}

/* The entries of a record, one after the other. */
typedef struct {
  record_t record;
  uint32_t next;               /* offset of the next entry */
  const axis_change_t *change; /* the next one of a set of version 0.1.0 */
} cursor_t;

static cursor_t cursor_of(const record_t *record) {
  return (cursor_t){.record = *record, .next = 0, .change = axis_changes_0_1_0};
}

static uint32_t entry_at(const record_t *record, uint32_t offset) {
  return record->begin + RECORD_HEAD_BYTES + offset;
}

static bool has_entry(const store_t *store, const record_t *record, uint32_t address) {
  const uint32_t size = record_entry_bytes(record->magic);
  bool found = false;
  for (uint32_t i = 0; !found && i < record->entries; i += size) {
    found = record_word(store->memory, entry_at(record, i)) == address;
  }
  return found;
}

/* A parameter that a set of version 0.1.0 omits, since it was at its default. */
static bool next_omitted(const store_t *store, const dictionary_t *objects, cursor_t *cursor,
                         entry_t *entry) {
  const axis_change_t *change = cursor->change;
  while (change->address != 0 && has_entry(store, &cursor->record, change->address)) {
    change++;
  }
  if (change->address == 0) {
    return false;
  }
  cursor->change = change + 1;
  *entry = (entry_t){.address = change->address,
                     .object = object_at(change->address),
                     .value = change->initial,
                     .verdict = (change->fits != 0) ? ENTRY_FITS : ENTRY_DROPPED};
  if (change->fits != 0) {
    judge_default(objects, entry);
  }
  return true;
}

static bool next_entry(const store_t *store, const dictionary_t *objects, cursor_t *cursor,
                       entry_t *entry) {
  const record_t *record = &cursor->record;
  if (cursor->next < record->entries) {
    *entry = read_entry(store, objects, record->magic, entry_at(record, cursor->next));
    cursor->next += record_entry_bytes(record->magic);
    return true;
  }
  return record->magic == RECORD_SET_0_1_0 && next_omitted(store, objects, cursor, entry);
}

/* Whether a record can be loaded: every entry of this table must fit, those of another one are
 * judged one by one. */
static bool is_usable(const store_t *store, const dictionary_t *objects, const record_t *record) {
  bool usable = record->magic == RECORD_SET || record->magic == RECORD_FORGOTTEN ||
                (record->magic == RECORD_SET_0_1_0 && record->hash == AXIS_OBJECTS_HASH32_0_1_0);
  if (record->magic == RECORD_SET && record->hash == AXIS_OBJECTS_HASH32) {
    cursor_t cursor = cursor_of(record);
    entry_t entry;
    while (usable && next_entry(store, objects, &cursor, &entry)) {
      usable = entry.verdict != ENTRY_DROPPED;
    }
  }
  return usable;
}

/* Notes a parameter that is not as stored, or keeps an old default. */
static void note_change(store_t *store, const entry_t *entry) {
  const bool dropped = entry->verdict == ENTRY_DROPPED;
  if (store->change_count < STORE_CHANGES) {
    store->changes[store->change_count] =
        entry->address | (dropped ? STORE_CHANGE_DROPPED : STORE_CHANGE_OLD_DEFAULT);
  }
  store->change_count = (uint16_t)(store->change_count + 1);
  store->dropped = dropped ? 1 : store->dropped;
}

/* Puts a value of the set into its object, if that is of the block; AXIS_BLOCK_NONE: of any. */
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

/* Where a record ends, as the offset in its sector. */
static uint32_t end_of(const store_t *store, const record_t *record) {
  const uint32_t sector = sector_of(store, record->begin);
  return record->begin - sector * store->memory->sector_bytes + record_bytes(record->entries);
}

/* Goes on behind this record, whose CRC may look blank, and behind whatever follows it. */
static void settle(store_t *store, const record_t *record) {
  const uint32_t end = end_of(store, record);
  store->home = sector_of(store, record->begin);
  store->tail = record_tail(store->memory, store->home);
  store->tail = (store->tail < end) ? end : store->tail;
}

/* Whether something lies where nothing but a newer set can have been: behind this one, which store
 * has settled on, or in a sector that does not begin with a whole record. */
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
  cursor_t cursor = cursor_of(record);
  entry_t entry;
  while (next_entry(store, objects, &cursor, &entry)) {
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
  cursor_t cursor = cursor_of(&record);
  entry_t entry;
  while (next_entry(store, objects, &cursor, &entry)) {
    restore(objects, &entry, block);
  }
  return true;
}

/* CANopen index times 256 plus sub-index. */
static uint32_t address_of(uint16_t object) {
  uint32_t found = 0;
  for (uint16_t i = 0; i < AXIS_ADDRESSES_COUNT; i++) {
    if (axis_addresses[i].what == AXIS_ADDRESS_OBJECT && axis_addresses[i].value == object) {
      found = (uint32_t)axis_addresses[i].index * 256 + axis_addresses[i].sub;
    }
  }
  return found;
}

static uint32_t bytes_of_entries(const store_t *store) {
  return (store->forget != 0) ? 0 : (uint32_t)STORE_ENTRY_BYTES * AXIS_STORED_COUNT;
}

/* Where the entries end and the CRC lies. */
static uint32_t entries_end(const store_t *store) {
  return store->begin + RECORD_HEAD_BYTES + bytes_of_entries(store);
}

/* Begins a record behind the newest set, or in the other sector once that is erased. */
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

int store_save(store_t *store) { return begin(store, false); }

int store_forget(store_t *store) { return begin(store, true); }

/* What was begun cannot be finished where it is. */
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

/* Programs the next piece; false: the memory refused it. */
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

/* The step behind a piece that was programmed. */
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

static bool step_entry(store_t *store, const dictionary_t *objects) {
  while (axis_objects[store->object].stored == 0) {
    store->object = (uint16_t)(store->object + 1);
  }
  const axis_object_t *object = &axis_objects[store->object];
  int32_t value = 0;
  (void)dictionary_read(objects, store->object, &value);
  const bool is_default =
      (uint32_t)value == (uint32_t)object->initial + node_id_of(objects, store->object);
  uint8_t entry[STORE_ENTRY_BYTES];
  fx_store_le(&entry[0], address_of(store->object) | (is_default ? AT_DEFAULT : 0), 4);
  fx_store_le(&entry[4], (uint32_t)(is_default ? object->initial : value), 4);
  fx_store_le(&entry[8], object->signature, 4);
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
