#include "firmware/app/store.h"

#include <stddef.h>

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"

_Static_assert((unsigned)STORE_SECTOR_MIN >= (unsigned)STORE_HEAD_BYTES + STORE_CRC_BYTES +
                                                 (unsigned)STORE_ENTRY_BYTES * AXIS_OBJ_COUNT,
               "a sector holds every stored parameter");

/* First word of a record: a set of parameters, or the wish for none. */
#define MAGIC_SET UINT32_C(0x31534146)       /* "FAS1" */
#define MAGIC_FORGOTTEN UINT32_C(0x31464146) /* "FAF1" */

enum { PIECE_BYTES = 16, READ_BACK_BYTES = 64 };

enum { STEP_IDLE, STEP_ERASE, STEP_BLANK, STEP_HEAD, STEP_ENTRIES, STEP_CRC, STEP_READ_BACK };

/* The head of a record, and where it is. */
typedef struct {
  uint32_t begin;
  uint32_t magic;
  uint32_t hash;
  uint32_t sequence;
  uint32_t entries; /* bytes */
} record_t;

void store_init(store_t *store, const store_memory_t *memory) {
  const bool fits = memory != NULL && memory->sector_bytes >= STORE_SECTOR_MIN;
  store->memory = fits ? memory : NULL;
  store->home = STORE_NOWHERE;
  store->tail = 0;
  store->sequence = 0;
  store->set = STORE_NOWHERE;
  store->step = STEP_IDLE;
}

/* --- reading -----------------------------------------------------------------------------------
 */

static void read(const store_t *store, uint32_t at, uint8_t *bytes, uint32_t count) {
  store->memory->read(store->memory->context, at, bytes, count);
}

static uint32_t crc_of(uint32_t crc, const uint8_t *bytes, uint32_t count) {
  for (uint32_t i = 0; i < count; i++) {
    crc = fx_crc32(crc, bytes[i]);
  }
  return crc;
}

/* Of a stretch of the memory; its length is a multiple of 4. */
static uint32_t crc_of_memory(const store_t *store, uint32_t crc, uint32_t at, uint32_t end) {
  uint8_t piece[PIECE_BYTES];
  while (at < end) {
    const uint32_t count = (end - at < PIECE_BYTES) ? end - at : PIECE_BYTES;
    read(store, at, piece, count);
    crc = crc_of(crc, piece, count);
    at += count;
  }
  return crc;
}

static uint32_t word_at(const store_t *store, uint32_t at) {
  uint8_t bytes[4];
  read(store, at, bytes, 4);
  return fx_load_le32(bytes);
}

static uint32_t record_bytes(uint32_t entries) {
  return STORE_HEAD_BYTES + entries + STORE_CRC_BYTES;
}

/* Whether a whole record begins here, in a sector that ends there. */
static bool read_record(const store_t *store, uint32_t at, uint32_t end, record_t *record) {
  if (end - at < record_bytes(0)) {
    return false;
  }
  record->magic = word_at(store, at);
  if (record->magic != MAGIC_SET && record->magic != MAGIC_FORGOTTEN) {
    return false;
  }
  record->begin = at;
  record->hash = word_at(store, at + 4);
  record->sequence = word_at(store, at + 8);
  record->entries = word_at(store, at + 12);
  if (record->entries > end - at - record_bytes(0) ||
      fx_field(record->entries, 0, 3) != 0) { /* multiples of STORE_ENTRY_BYTES */
    return false;
  }
  const uint32_t crc_at = at + STORE_HEAD_BYTES + record->entries;
  return ~crc_of_memory(store, UINT32_MAX, at, crc_at) == word_at(store, crc_at);
}

/* Where in a sector the last byte lies that is not blank, as the offset of the word after it. */
static uint32_t tail_of(const store_t *store, uint32_t sector) {
  uint32_t tail = store->memory->sector_bytes;
  while (tail > 0 &&
         word_at(store, sector * store->memory->sector_bytes + tail - 4) == UINT32_MAX) {
    tail -= 4;
  }
  return tail;
}

/* The object of an entry and its value; AXIS_OBJ_NONE if it cannot be put back. */
static uint16_t read_entry(const store_t *store, uint32_t at, int32_t *value) {
  const uint32_t address = word_at(store, at);
  *value = fx_s32_from_u32(word_at(store, at + 4));
  const axis_address_t *found =
      dictionary_address((uint16_t)fx_field(address, 8, 16), (uint8_t)fx_field(address, 0, 8));
  const bool fits = fx_field(address, 24, 8) == 0 && found != NULL &&
                    found->what == AXIS_ADDRESS_OBJECT &&
                    dictionary_restorable(found->value, *value);
  return fits ? found->value : AXIS_OBJ_NONE;
}

static bool is_usable(const store_t *store, const record_t *record) {
  bool usable = record->hash == AXIS_OBJECTS_HASH32;
  for (uint32_t i = 0; usable && i < record->entries; i += STORE_ENTRY_BYTES) {
    int32_t value;
    const uint16_t object = read_entry(store, record->begin + STORE_HEAD_BYTES + i, &value);
    usable = object != AXIS_OBJ_NONE;
  }
  return usable;
}

/* The newest records, at most two, the newest first; returns how many. A record that was cut off
 * does not say where it ends, so the next one is looked for word by word. */
static uint8_t newest_records(const store_t *store, record_t newest[2]) {
  const uint32_t sector_bytes = store->memory->sector_bytes;
  uint8_t found = 0;
  for (uint32_t sector = 0; sector < 2; sector++) {
    uint32_t at = sector * sector_bytes;
    const uint32_t end = at + sector_bytes;
    while (at < end) {
      record_t record;
      if (!read_record(store, at, end, &record)) {
        at += 4;
        continue;
      }
      if (found == 0) {
        newest[0] = record;
        found = 1;
      } else if (record.sequence > newest[0].sequence) {
        newest[1] = newest[0];
        newest[0] = record;
        found = 2;
      } else if (found == 1 || record.sequence > newest[1].sequence) {
        newest[1] = record;
        found = 2;
      }
      at += record_bytes(record.entries);
    }
  }
  return found;
}

/* Puts the values of the set in force into one block, AXIS_BLOCK_NONE: into all. */
static void restore(const store_t *store, dictionary_t *objects, uint8_t block) {
  const uint32_t entries = word_at(store, store->set + 12);
  for (uint32_t i = 0; i < entries; i += STORE_ENTRY_BYTES) {
    int32_t value;
    const uint16_t object = read_entry(store, store->set + STORE_HEAD_BYTES + i, &value);
    if (object != AXIS_OBJ_NONE &&
        (block == AXIS_BLOCK_NONE || axis_objects[object].block == block)) {
      dictionary_restore(objects, object, value);
    }
  }
}

static uint32_t other_sector(uint32_t sector) { return (sector == 0) ? 1 : 0; }

/* Where a record ends, as the offset in its sector. */
static uint32_t end_of(const store_t *store, const record_t *record) {
  const uint32_t sector_bytes = store->memory->sector_bytes;
  const uint32_t begin =
      (record->begin < sector_bytes) ? record->begin : record->begin - sector_bytes;
  return begin + record_bytes(record->entries);
}

/* Goes on behind this record, whose CRC may look blank, and behind whatever follows it. */
static void settle(store_t *store, const record_t *record) {
  const uint32_t end = end_of(store, record);
  store->home = (record->begin < store->memory->sector_bytes) ? 0 : 1;
  store->tail = tail_of(store, store->home);
  store->tail = (store->tail < end) ? end : store->tail;
}

/* Whether something lies where nothing but a newer set can have been: behind this one, which store
 * has settled on, or in a sector that does not begin with a whole set. */
static bool has_remains(const store_t *store, const record_t *record) {
  const uint32_t sector_bytes = store->memory->sector_bytes;
  if (store->tail > end_of(store, record)) {
    return true;
  }
  const uint32_t other = other_sector(store->home);
  record_t first;
  return tail_of(store, other) != 0 &&
         !read_record(store, other * sector_bytes, (other + 1) * sector_bytes, &first);
}

uint8_t store_load(store_t *store, dictionary_t *objects) {
  store_init(store, store->memory);
  if (store->memory == NULL) {
    return AXIS_STORE_STATE_EMPTY;
  }
  record_t newest[2];
  const uint8_t found = newest_records(store, newest);
  if (found == 0) {
    const bool blank = tail_of(store, 0) == 0 && tail_of(store, 1) == 0;
    return blank ? AXIS_STORE_STATE_EMPTY : AXIS_STORE_STATE_FAILED;
  }
  const record_t *record = &newest[0];
  settle(store, record);
  store->sequence = record->sequence;
  if (record->hash != AXIS_OBJECTS_HASH32) {
    return AXIS_STORE_STATE_OTHER_TABLE;
  }
  bool older = has_remains(store, record);
  if (!is_usable(store, record)) {
    record = &newest[1];
    if (found == 1 || !is_usable(store, record)) {
      return AXIS_STORE_STATE_FAILED;
    }
    settle(store, record);
    older = true;
  }
  if (record->magic == MAGIC_FORGOTTEN) {
    return older ? AXIS_STORE_STATE_LOADED_OLDER : AXIS_STORE_STATE_EMPTY;
  }
  store->set = record->begin;
  restore(store, objects, AXIS_BLOCK_NONE);
  return older ? AXIS_STORE_STATE_LOADED_OLDER : AXIS_STORE_STATE_LOADED;
}

void store_load_block(const store_t *store, dictionary_t *objects, uint8_t block) {
  if (store->set != STORE_NOWHERE) {
    restore(store, objects, block);
  }
}

/* --- writing -----------------------------------------------------------------------------------
 */

/* Whether an object belongs into a set, and its value. */
static bool is_kept(const dictionary_t *objects, uint16_t object, int32_t *value) {
  const axis_object_t *entry = &axis_objects[object];
  if (entry->stored == 0 || dictionary_read(objects, object, value) != FW_OK) {
    return false;
  }
  int32_t node_id = 0;
  if (entry->node_id != 0) {
    (void)dictionary_read(objects, AXIS_OBJ_NODE_ID, &node_id);
  }
  return (uint32_t)*value != (uint32_t)entry->initial + (uint32_t)node_id;
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

static int begin(store_t *store, uint32_t entries, bool forget) {
  store->entries = entries;
  store->forget = forget ? 1 : 0;
  store->again = 0;
  const bool fits = store->home != STORE_NOWHERE &&
                    store->memory->sector_bytes - store->tail >= record_bytes(entries);
  begin_in(store, fits ? store->home : other_sector(store->home));
  return FW_OK;
}

int store_save(store_t *store, const dictionary_t *objects) {
  if (store->memory == NULL) {
    return FW_ERROR_STATE;
  }
  if (store_is_busy(store)) {
    return FW_ERROR_BUSY;
  }
  uint32_t entries = 0;
  int32_t value;
  for (uint16_t object = AXIS_OBJ_NONE + 1; object < AXIS_OBJ_COUNT; object++) {
    entries += is_kept(objects, object, &value) ? STORE_ENTRY_BYTES : 0;
  }
  return begin(store, entries, false);
}

int store_forget(store_t *store) {
  if (store->memory == NULL) {
    return FW_ERROR_STATE;
  }
  return store_is_busy(store) ? FW_ERROR_BUSY : begin(store, 0, true);
}

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
  store->crc = crc_of(store->crc, bytes, count);
  return program(store, bytes, count);
}

static bool step_blank(store_t *store) {
  const uint32_t end = (store->sector + UINT32_C(1)) * store->memory->sector_bytes;
  bool blank = true;
  for (uint32_t i = 0; i < READ_BACK_BYTES && store->at < end; i += 4) {
    blank = blank && word_at(store, store->at) == UINT32_MAX;
    store->at += 4;
  }
  if (store->at == end) {
    store->at = store->begin;
    store->step = STEP_HEAD;
  }
  return blank;
}

static bool step_head(store_t *store) {
  uint8_t head[STORE_HEAD_BYTES];
  fx_store_le(&head[0], (store->forget != 0) ? MAGIC_FORGOTTEN : MAGIC_SET, 4);
  fx_store_le(&head[4], AXIS_OBJECTS_HASH32, 4);
  fx_store_le(&head[8], store->sequence, 4);
  fx_store_le(&head[12], store->entries, 4);
  store->step = STEP_ENTRIES;
  return program_checked(store, head, sizeof(head));
}

/* Where the entries end and the CRC lies. */
static uint32_t entries_end(const store_t *store) {
  return store->begin + STORE_HEAD_BYTES + store->entries;
}

static bool step_entries(store_t *store, const dictionary_t *objects) {
  uint8_t piece[PIECE_BYTES];
  uint32_t count = 0;
  const uint32_t left = entries_end(store) - store->at;
  const uint32_t room = (left < PIECE_BYTES) ? left : PIECE_BYTES;
  while (count < room && store->object < AXIS_OBJ_COUNT) {
    int32_t value;
    if (is_kept(objects, store->object, &value)) {
      fx_store_le(&piece[count], address_of(store->object), 4);
      fx_store_le(&piece[count + 4], (uint32_t)value, 4);
      count += STORE_ENTRY_BYTES;
    }
    store->object = (uint16_t)(store->object + 1);
  }
  if (room == left) {
    store->step = STEP_CRC;
  }
  /* Fewer than were counted: a parameter went back to its default meanwhile. */
  return count == room && (count == 0 || program_checked(store, piece, count));
}

static bool step_crc(store_t *store) {
  uint8_t bytes[STORE_CRC_BYTES];
  fx_store_le(bytes, ~store->crc, 4);
  const bool done = program(store, bytes, sizeof(bytes));
  store->at = store->begin;
  store->step = STEP_READ_BACK;
  return done;
}

static bool step_read_back(store_t *store) {
  const uint32_t end = entries_end(store);
  const uint32_t stop = (end - store->at < READ_BACK_BYTES) ? end : store->at + READ_BACK_BYTES;
  store->check = crc_of_memory(store, store->check, store->at, stop);
  store->at = stop;
  if (stop < end) {
    return true;
  }
  if (store->check != store->crc || word_at(store, end) != ~store->crc) {
    return false;
  }
  store->home = store->sector;
  store->tail = end + STORE_CRC_BYTES - store->sector * store->memory->sector_bytes;
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
      return step_entries(store, objects);
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
