#include "firmware/storage/store.h"

#include <stddef.h>

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"

_Static_assert((unsigned)STORE_SECTOR_MIN >= (unsigned)STORE_SET_BYTES, "a sector holds a set");

enum { READ_BACK_BYTES = 64, PIECE_BYTES = 16 };

/* Offset of the word that contains the size of the entries, in bytes from the begin of a record. */
enum { ENTRIES_WORD = 12 };

/* A sector always has room for this number of records with counts of parts, even with the largest
 * library of cycle programs. */
enum { COUNTS_RESERVED = 8 };

enum {
  STEP_IDLE,
  STEP_UNMARK,
  STEP_ERASE,
  STEP_BLANK,
  STEP_HEAD,
  STEP_ENTRIES,
  STEP_CRC,
  STEP_READ_BACK
};

/* Kinds of jobs of the parameter store. JOB_SAVE: write the parameters. JOB_FORGET: write the
 * record that restores all defaults. JOB_PARTS: write the cycle programs and the counts of
 * parts. */
enum { JOB_SAVE, JOB_FORGET, JOB_PARTS };

/* The records that a job of the parameter store can write, in the order of writing. */
enum {
  ITEM_COPY,
  ITEM_PARTS, /* first of the extra records: cycle programs and counts of parts */
  ITEM_SET = ITEM_PARTS + STORE_PARTS,
  ITEM_END
};

static bool is_part(uint8_t item) { return item >= ITEM_PARTS && item < ITEM_SET; }

void store_init(store_t *store, const store_memory_t *memory) {
  const bool fits = memory != NULL && memory->sector_bytes >= STORE_SECTOR_MIN;
  fx_clear(store, sizeof(*store));
  store->memory = fits ? memory : NULL;
  store->home = STORE_NOWHERE;
  store->set = STORE_NOWHERE;
  store->step = STEP_IDLE;
  store->job = JOB_SAVE;
}

/* Returns true if the parameter set of a record can be loaded. If the set belongs to the present
 * object table, all its entries must match the table. The entries of a set of another table are
 * compared with the present table when they are loaded. */
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

/* Adds a parameter to the list of changes of the store. The parameter does not have its stored
 * value, or keeps the default of an earlier object table. */
static void note_change(store_t *store, const entry_t *entry) {
  const bool dropped = entry->verdict != ENTRY_OLD_DEFAULT;
  if (store->change_count < STORE_CHANGES) {
    store->changes[store->change_count] =
        entry->address | (dropped ? STORE_CHANGE_DROPPED : AXIS_STORE_CHANGE_OLD_DEFAULT);
  }
  store->change_count = (uint16_t)(store->change_count + 1);
  store->dropped = dropped ? 1 : store->dropped;
}

/* Sets the object of an entry to the stored value if the object belongs to the block `block`. If
 * `block` is AXIS_BLOCK_NONE, the object may belong to any block. */
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

/* Returns the offset in bytes, from the start of its sector, at which a record ends. */
static uint32_t end_of(const store_t *store, const record_t *record) {
  const uint32_t sector = sector_of(store, record->begin);
  return record->begin - sector * store->memory->sector_bytes + record_bytes(record->entries);
}

static uint32_t aligned(uint32_t bytes) { return (bytes + 15) & ~UINT32_C(15); }

static void find_part(store_t *store, uint8_t part, const record_t *record) {
  const bool exists = record->magic != RECORD_NONE;
  store->found[part] = exists ? record->begin + RECORD_HEAD_BYTES : 0;
  store->found_bytes[part] = exists ? record->entries : 0;
}

/* Makes the sector of the parameter set `record` the present sector of the store. The next record
 * is programmed after the last byte of this sector that is not blank, and not before the end of
 * this set, because the CRC of the set may look like blank bytes. */
static void settle(store_t *store, const record_sector_t sectors[2], const record_t *record) {
  store->home = sector_of(store, record->begin);
  const record_sector_t *home = &sectors[store->home];
  const uint32_t end = end_of(store, record);
  store->tail = aligned((home->tail < end) ? end : home->tail);
  find_part(store, STORE_PROGRAMS, &home->programs);
  find_part(store, STORE_COUNTS, &home->counts);
}

/* Returns true if the memory has bytes of a newer parameter set that is incomplete. Such bytes are
 * after the last set of a sector. They are also in a used sector without a complete set, unless
 * this sector was being written as a copy. */
static bool has_remains(const store_t *store, const record_sector_t sectors[2]) {
  const record_sector_t *home = &sectors[store->home];
  const record_sector_t *other = &sectors[other_sector(store->home)];
  return home->has_remains != 0 ||
         (home->is_copied == 0 && other->tail != 0 && other->has_set == 0);
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

/* Loads the entries of a parameter set, and reports the parameters that have changed. */
static void load_entries(store_t *store, dictionary_t *objects, const record_t *record) {
  store->set = record->begin;
  entries_t entries = entries_of(record);
  entry_t entry;
  while (entries_next(store->memory, objects, &entries, &entry)) {
    restore(objects, &entry, AXIS_BLOCK_NONE);
    if (entry.verdict != ENTRY_FITS) {
      note_change(store, &entry);
    }
  }
}

/* Returns the state of the store (AXIS_STORE_STATE_) if the memory has no complete parameter
 * set. */
static uint8_t state_without_set(store_t *store, const record_sector_t sectors[2]) {
  const bool is_empty = (sectors[0].tail == 0 || sectors[0].is_copy != 0) &&
                        (sectors[1].tail == 0 || sectors[1].is_copy != 0);
  store->may_move = is_empty ? 1 : 0;
  return is_empty ? AXIS_STORE_STATE_EMPTY : AXIS_STORE_STATE_FAILED;
}

uint8_t store_load(store_t *store, dictionary_t *objects) {
  store_init(store, store->memory);
  if (store->memory == NULL) {
    return AXIS_STORE_STATE_EMPTY;
  }
  record_sector_t sectors[2];
  record_t sets[2];
  store->sequence = record_survey(store->memory, sectors, sets);
  const record_t *record = &sets[0];
  if (record->magic == RECORD_NONE) {
    return state_without_set(store, sectors);
  }
  settle(store, sectors, record);
  bool older = has_remains(store, sectors);
  if (!is_usable(store, objects, record)) {
    if (record->magic == RECORD_SET_0_1_0) {
      return AXIS_STORE_STATE_OTHER_TABLE;
    }
    record = &sets[1];
    if (!is_usable(store, objects, record)) {
      return AXIS_STORE_STATE_FAILED;
    }
    settle(store, sectors, record);
    older = true;
  }
  store->may_move = older ? 0 : 1;
  if (record->magic == RECORD_FORGOTTEN) {
    return older ? AXIS_STORE_STATE_LOADED_OLDER : AXIS_STORE_STATE_EMPTY;
  }
  load_entries(store, objects, record);
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

/* Returns the total size, in bytes, of the entries in the record with the number `item` of the
 * present job. */
static uint32_t bytes_of_item(const store_t *store, uint8_t item) {
  if (is_part(item)) {
    return store->parts[item - ITEM_PARTS].count;
  }
  if (item == ITEM_COPY || store->job == JOB_FORGET) {
    return 0;
  }
  return (store->job == JOB_SAVE) ? (uint32_t)ENTRY_BYTES * AXIS_STORED_COUNT
                                  : store->basis.entries;
}

/* Returns the address at which the entries of the present record end. The CRC of the record begins
 * at this address. */
static uint32_t entries_end(const store_t *store) {
  return store->begin + RECORD_HEAD_BYTES + bytes_of_item(store, store->item);
}

/* Begins the next record of the job at the address `at`. `item` is the smallest number that this
 * record may have. If there is no more record, the job ends. */
static void begin_item(store_t *store, uint32_t at, uint8_t item) {
  while (item < ITEM_END && (store->items & fx_bit(item)) == 0) {
    item = (uint8_t)(item + 1);
  }
  store->item = item;
  store->begin = at;
  store->at = at;
  store->object = AXIS_OBJ_NONE + 1;
  store->crc = UINT32_MAX;
  store->check = UINT32_MAX;
  store->sequence += 1;
  store->step = (item < ITEM_END) ? STEP_HEAD : STEP_IDLE;
}

/* Returns the set of records that the parameter store writes to the other sector when the present
 * sector has no room. If they are a copy of the present sector, the first one marks the other
 * sector as a copy. */
static uint8_t items_of_sector(const store_t *store) {
  uint32_t items = fx_bit(ITEM_SET) | ((store->job == JOB_PARTS) ? fx_bit(ITEM_COPY) : 0);
  for (uint32_t i = 0; i < STORE_PARTS; i++) {
    items |= (store->parts[i].count != 0) ? fx_bit((uint8_t)(ITEM_PARTS + i)) : 0;
  }
  return (uint8_t)items;
}

/* Begins the present job in the other sector, which is erased first. If the present sector still
 * has the mark of an earlier copy that was abandoned, a save of parameters makes this mark invalid
 * first. */
static void begin_in_other(store_t *store, uint32_t sector) {
  const bool is_marked = store->home != STORE_NOWHERE && store->job != JOB_PARTS &&
                         record_is_copied(store->memory, store->home);
  store->sector = (uint8_t)sector;
  store->items = items_of_sector(store);
  begin_item(store, sector * store->memory->sector_bytes, 0);
  store->step = is_marked ? STEP_UNMARK : STEP_ERASE;
}

/* Returns the address of the mark at the end of the present sector. The mark shows that this sector
 * is being copied. */
static uint32_t mark_of(const store_t *store) {
  return (store->home + 1) * store->memory->sector_bytes - RECORD_MARK;
}

/* Begins to copy the contents of the present sector to the other sector. First a mark is written at
 * the end of the present sector. */
static void begin_copy(store_t *store) {
  if (store->home == STORE_NOWHERE || record_word(store->memory, mark_of(store)) != UINT32_MAX) {
    begin_in_other(store, other_sector(store->home));
    return;
  }
  store->sector = (uint8_t)store->home;
  store->items = (uint8_t)fx_bit(ITEM_COPY);
  begin_item(store, mark_of(store), 0);
}

/* Returns the total size in bytes of all records that the present job of the store writes. */
static uint32_t bytes_of_job(const store_t *store) {
  uint32_t bytes = 0;
  for (uint8_t i = 0; i < ITEM_END; i++) {
    bytes += ((store->items & fx_bit(i)) != 0) ? record_space(bytes_of_item(store, i)) : 0;
  }
  return bytes;
}

/* Returns the number of free bytes in the present sector of the store, which is the sector with the
 * newest parameter set. */
static uint32_t room_of(const store_t *store) {
  const uint32_t used = store->tail + RECORD_MARK;
  const uint32_t bytes = store->memory->sector_bytes;
  return (store->home == STORE_NOWHERE || used > bytes) ? 0 : bytes - used;
}

/* Begins a job of the kind `job`. If the present sector has room, the job writes the records
 * `items` to this sector. Otherwise the job writes all records to the other sector. */
static void begin_job(store_t *store, uint8_t job, uint8_t items) {
  store->job = job;
  store->again = 0;
  store->items = items;
  if (items != 0 && room_of(store) >= bytes_of_job(store)) {
    store->sector = (uint8_t)store->home;
    begin_item(store, store->home * store->memory->sector_bytes + store->tail, 0);
  } else if (job == JOB_PARTS) {
    begin_copy(store);
  } else {
    begin_in_other(store, other_sector(store->home));
  }
}

static int begin(store_t *store, uint8_t job) {
  if (store->memory == NULL) {
    return FW_ERROR_NO_MEMORY;
  }
  if (store_is_busy(store)) {
    return FW_ERROR_BUSY;
  }
  store_abandon(store);
  begin_job(store, job, (uint8_t)fx_bit(ITEM_SET));
  return FW_OK;
}

bool store_is_busy(const store_t *store) {
  return store->step != STEP_IDLE && store->job != JOB_PARTS;
}

static int begin_save(store_t *store, const record_t *basis, uint16_t first, uint16_t last) {
  const int refusal = begin(store, JOB_SAVE);
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

/* Reads the head of the loaded parameter set into *record. If no set is loaded, the field `magic`
 * of *record becomes RECORD_NONE. Returns false if the set is damaged. */
static bool read_set(const store_t *store, record_t *record) {
  record->magic = RECORD_NONE;
  if (store->memory == NULL || store->set == STORE_NOWHERE) {
    return true;
  }
  const uint32_t end = (sector_of(store, store->set) + 1) * store->memory->sector_bytes;
  return record_read(store->memory, store->set, end, record);
}

int store_save_only(store_t *store, uint16_t first, uint16_t last) {
  record_t basis;
  if (!read_set(store, &basis)) {
    return FW_ERROR_NO_DATA;
  }
  return begin_save(store, &basis, first, last);
}

int store_forget(store_t *store) { return begin(store, JOB_FORGET); }

/* Gives up the attempt to write the record in this sector. If the other sector does not contain the
 * newest parameter set, begins a second attempt in the other sector. */
static uint8_t give_up(store_t *store) {
  const uint32_t other = other_sector(store->sector);
  if (store->sector == store->home) {
    store->tail = store->memory->sector_bytes;
  }
  if (other != store->home && store->again == 0 &&
      (store->job != JOB_PARTS || store->may_move != 0)) {
    store->again = 1;
    begin_in_other(store, other);
    return AXIS_STORE_STATE_SAVING;
  }
  store->step = STEP_IDLE;
  return AXIS_STORE_STATE_FAILED;
}

/* Begins to write those extra records (cycle programs, counts of parts) that have changed. */
static uint8_t begin_parts(store_t *store) {
  if (!read_set(store, &store->basis)) {
    return AXIS_STORE_STATE_FAILED;
  }
  if (store->basis.magic == RECORD_NONE) {
    store->basis.entries = 0;
  }
  store->job = JOB_PARTS;
  store->items = items_of_sector(store);
  const bool may_move =
      store->may_move != 0 && bytes_of_job(store) <= store->memory->sector_bytes - RECORD_MARK;
  store->items = store->changed;
  if (!may_move && bytes_of_job(store) > room_of(store)) {
    return AXIS_STORE_STATE_FAILED;
  }
  begin_job(store, JOB_PARTS, store->items);
  return AXIS_STORE_STATE_SAVING;
}

/* Programs `count` bytes at the address `at`. Returns false if the memory reports a failure. */
static bool program_at(const store_t *store, uint32_t at, const uint8_t *bytes, uint32_t count) {
  fx_assert(count <= 16 && at + count <= 2 * store->memory->sector_bytes);
  return store->memory->program(store->memory->context, at, bytes, count);
}

static bool program(store_t *store, const uint8_t *bytes, uint32_t count) {
  const bool done = program_at(store, store->at, bytes, count);
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

/* Returns the next step for the present record: programming its entries, or its CRC after the last
 * entry. */
static uint8_t step_behind(const store_t *store) {
  return (store->at < entries_end(store)) ? STEP_ENTRIES : STEP_CRC;
}

static uint32_t magic_of(const store_t *store) {
  static const uint32_t magics[ITEM_SET] = {RECORD_COPY, RECORD_PROGRAMS, RECORD_COUNTS};
  if (store->item < ITEM_SET) {
    return magics[store->item];
  }
  if (store->job == JOB_SAVE) {
    return RECORD_SET;
  }
  return (store->job == JOB_FORGET || store->basis.magic == RECORD_NONE) ? RECORD_FORGOTTEN
                                                                         : store->basis.magic;
}

static bool is_copied_set(const store_t *store) {
  return store->item == ITEM_SET && store->job == JOB_PARTS && store->basis.magic != RECORD_NONE;
}

static bool step_head(store_t *store) {
  uint8_t head[RECORD_HEAD_BYTES];
  fx_store_le(&head[0], magic_of(store), 4);
  fx_store_le(&head[4], is_copied_set(store) ? store->basis.hash : AXIS_OBJECTS_HASH32, 4);
  fx_store_le(&head[8], store->sequence, 4);
  fx_store_le(&head[12], bytes_of_item(store, store->item), 4);
  store->crc = record_crc(store->crc, head, sizeof(head));
  bool done = true;
  if (store->item == ITEM_SET) {
    /* The first word of a parameter set is programmed last (record.h). */
    done = program_at(store, store->begin + 4, &head[4], sizeof(head) - 4) &&
           program_at(store, store->begin, head, 4);
  } else {
    done = program_at(store, store->begin, head, sizeof(head));
  }
  store->at += sizeof(head);
  store->step = step_behind(store);
  return done;
}

/* Returns the value that the present save stores for the next object. */
static int32_t value_to_save(const store_t *store, const dictionary_t *objects) {
  int32_t value = 0;
  if (store->object < store->first || store->object > store->last) {
    /* If no parameter set is stored, the first motion test is on at power-up. It must stay on after
     * this save. */
    const bool has_none = store->basis.magic == RECORD_NONE;
    return (has_none && store->object == AXIS_OBJ_FIRST_MOTION_TEST)
               ? AXIS_FIRST_MOTION_TEST_ON
               : entries_value(store->memory, objects, &store->basis, store->object);
  }
  (void)dictionary_read(objects, store->object, &value);
  return value;
}

/* Programs the next bytes of a record that is copied from memory: the cycle programs, the counts of
 * parts, or the parameter set of the present sector. */
static bool step_bytes(store_t *store) {
  const uint32_t end = entries_end(store);
  const uint32_t offset = store->at - store->begin - RECORD_HEAD_BYTES;
  const uint32_t count = (end - store->at < PIECE_BYTES) ? end - store->at : PIECE_BYTES;
  uint8_t piece[PIECE_BYTES];
  const uint8_t *bytes = piece;
  if (is_part(store->item)) {
    bytes = &store->parts[store->item - ITEM_PARTS].bytes[offset];
  } else {
    store->memory->read(store->memory->context, store->basis.begin + RECORD_HEAD_BYTES + offset,
                        piece, count);
  }
  const bool done = program_checked(store, bytes, count);
  store->step = step_behind(store);
  return done;
}

static bool step_entry(store_t *store, const dictionary_t *objects) {
  if (is_part(store->item) || is_copied_set(store)) {
    return step_bytes(store);
  }
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

/* Ends a record that was read back, and begins the next record. After a complete parameter set, the
 * store continues in the sector of this set. After the mark at the end of the present sector, the
 * copy of this sector begins. */
static void end_item(store_t *store, uint32_t end) {
  const uint32_t tail = end - store->sector * store->memory->sector_bytes;
  const bool is_home = store->sector == store->home;
  if (is_home && store->item == ITEM_COPY) {
    store->tail = store->memory->sector_bytes;
    begin_in_other(store, other_sector(store->home));
    return;
  }
  if (is_part(store->item) && is_home) {
    store->changed = (uint8_t)(store->changed & ~fx_bit(store->item));
  }
  if (store->item == ITEM_SET) {
    store->changed = is_home ? store->changed : 0;
    store->home = store->sector;
    store->set = (magic_of(store) == RECORD_FORGOTTEN) ? STORE_NOWHERE : store->begin;
    store->may_move = 1;
  }
  if (store->sector == store->home) {
    store->tail = tail;
  }
  begin_item(store, end, (uint8_t)(store->item + 1));
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
  end_item(store, aligned(end + RECORD_CRC_BYTES));
  return true;
}

/* Makes the mark at the end of the present sector invalid, so that this sector no longer counts as
 * being copied. */
static bool unmark(store_t *store) {
  static const uint8_t zeros[4] = {0, 0, 0, 0};
  return program_at(store, mark_of(store) + RECORD_MARK - RECORD_MARK_END, zeros, sizeof(zeros));
}

static bool take_step(store_t *store, const dictionary_t *objects) {
  switch (store->step) {
    case STEP_UNMARK:
      store->step = STEP_ERASE;
      return unmark(store);
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

static uint8_t work(store_t *store, const dictionary_t *objects) {
  fx_assert(store->sector < 2 && (store->home < 2 || store->home == STORE_NOWHERE));
  fx_assert(store->tail <= store->memory->sector_bytes && store->item <= ITEM_END);
  if (!take_step(store, objects)) {
    return give_up(store);
  }
  if (store->step != STEP_IDLE) {
    return AXIS_STORE_STATE_SAVING;
  }
  return (store->job == JOB_FORGET) ? AXIS_STORE_STATE_RESTORED : AXIS_STORE_STATE_SAVED;
}

uint8_t store_tick(store_t *store, const dictionary_t *objects) {
  return store_is_busy(store) ? work(store, objects) : AXIS_STORE_STATE_COUNT;
}

void store_part_read(const store_t *store, uint8_t part, uint8_t *bytes) {
  store->memory->read(store->memory->context, store->found[part], bytes, store->found_bytes[part]);
}

uint32_t store_programs_max(const store_t *store) {
  const uint32_t others = ((STORE_SET_BYTES + UINT32_C(15)) & ~UINT32_C(15)) +
                          COUNTS_RESERVED * record_space(STORE_COUNTS_BYTES) + 2 * record_space(0) +
                          RECORD_MARK;
  return (store->memory == NULL) ? 0 : store->memory->sector_bytes - others;
}

void store_part_set(store_t *store, uint8_t part, store_part_t bytes, bool changed) {
  store_abandon(store);
  store->parts[part] = bytes;
  if (changed) {
    store->changed = (uint8_t)(store->changed | fx_bit((uint8_t)(ITEM_PARTS + part)));
    store->parts_failed = 0;
  }
}

/* Returns true if the present sector has no room for the next counts of parts, but the other sector
 * would have room. The store then continues in the other sector, because otherwise the next
 * power-up would have to wait for an erase. */
static bool lacks_room(const store_t *store) {
  const uint32_t counts = record_space(STORE_COUNTS_BYTES);
  if (store->home == STORE_NOWHERE || store->may_move == 0 ||
      store->parts[STORE_COUNTS].count == 0 || room_of(store) >= counts) {
    return false;
  }
  uint32_t bytes = record_space(0) + counts + RECORD_MARK;
  for (uint8_t i = 0; i < STORE_PARTS; i++) {
    bytes += record_space(store->parts[i].count);
  }
  bytes += record_space(
      (store->set == STORE_NOWHERE) ? 0 : record_word(store->memory, store->set + ENTRIES_WORD));
  return bytes <= store->memory->sector_bytes;
}

bool store_part_is_stored(const store_t *store, uint8_t part) {
  return (store->changed & fx_bit((uint8_t)(ITEM_PARTS + part))) == 0;
}

uint8_t store_parts_state(const store_t *store) {
  if (store->parts_failed != 0) {
    return STORE_PARTS_FAILED;
  }
  const bool works = store->changed != 0 || (store->step != STEP_IDLE && store->job == JOB_PARTS);
  return (works || lacks_room(store)) ? STORE_PARTS_WRITING : STORE_PARTS_STORED;
}

void store_parts_tick(store_t *store, const dictionary_t *objects) {
  if (store_is_busy(store) || store_parts_state(store) != STORE_PARTS_WRITING ||
      store->memory == NULL) {
    return;
  }
  uint8_t state = AXIS_STORE_STATE_SAVING;
  if (store->step == STEP_IDLE) {
    state = begin_parts(store);
  } else {
    state = work(store, objects);
  }
  store->parts_failed = (state == AXIS_STORE_STATE_FAILED) ? 1 : 0;
}

/* Abandons a write of extra records (cycle programs, counts of parts). The store does not use the
 * bytes that were programmed so far, nor the rest of the space that the head of the record
 * announces. */
void store_abandon(store_t *store) {
  if (store->step == STEP_IDLE || store->job != JOB_PARTS) {
    return;
  }
  if (store->sector == store->home && store->item < ITEM_END) {
    store->tail = aligned(entries_end(store) + RECORD_CRC_BYTES) -
                  store->sector * store->memory->sector_bytes;
  }
  store->step = STEP_IDLE;
}
