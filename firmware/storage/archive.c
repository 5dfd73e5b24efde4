#include "firmware/storage/archive.h"

#include <stddef.h>

#include "firmware/fx/bytes.h"
#include "firmware/objects/generated/axis_objects.h"

enum { IDLE, CHECKING, WRITING, LOADING };
enum { PIECE_BYTES = 16, READ_BYTES = 64 };

/* Offsets in bytes of the words that describe an incident, from the begin of its record. */
enum {
  ABOUT_TICK = RECORD_HEAD_BYTES,
  ABOUT_CRC = ABOUT_TICK + 4,
  ABOUT_ERROR = ABOUT_CRC + 4,
  ABOUT_COUNT = ABOUT_ERROR + 4,
  SAMPLES = RECORD_HEAD_BYTES + ARCHIVE_ABOUT_BYTES
};

static const record_t none = {.magic = RECORD_NONE};

static uint32_t end_of(const record_t *record) {
  return record->begin + record_bytes(record->entries) + ARCHIVE_CLEARED_BYTES;
}

static uint32_t mark_of(const record_t *record) { return end_of(record) - ARCHIVE_CLEARED_BYTES; }

/* Reads the head of a record. Returns true if the values in the head are permitted. The CRC of the
 * record is checked later. */
static bool read_head(const store_memory_t *memory, uint32_t at, uint32_t end, record_t *record) {
  if (end - at < archive_bytes(0)) {
    return false;
  }
  record->begin = at;
  record->magic = record_word(memory, at);
  record->hash = record_word(memory, at + 4);
  record->sequence = record_word(memory, at + 8);
  record->entries = record_word(memory, at + 12);
  return record->magic == RECORD_INCIDENT && (record->entries & 15u) == 0 &&
         record->entries >= ARCHIVE_ABOUT_BYTES && record->entries <= end - at - archive_bytes(0);
}

typedef struct {
  record_t last;
  record_t before;
  uint32_t next; /* address of the end of the last record in the sector */
  uint32_t end;
} sector_t;

static sector_t read_sector(const store_memory_t *memory, uint32_t number) {
  const uint32_t begin = number * memory->sector_bytes;
  sector_t sector = {none, none, begin, begin + memory->sector_bytes};
  record_t record;
  while (read_head(memory, sector.next, sector.end, &record)) {
    sector.before = sector.last;
    sector.last = record;
    sector.next = end_of(&record);
  }
  return sector;
}

/* Returns true if this range of the memory is blank. A power cut during a write can leave bytes
 * that are not blank. */
static bool is_blank(const store_memory_t *memory, uint32_t at, uint32_t end) {
  uint8_t piece[READ_BYTES];
  uint32_t bits = UINT32_MAX;
  while (at < end && bits == UINT32_MAX) {
    const uint32_t count = (end - at < READ_BYTES) ? end - at : READ_BYTES;
    memory->read(memory->context, at, piece, count);
    for (uint32_t i = 0; i < count; i += 4) {
      bits &= fx_load_le32(piece + i);
    }
    at += count;
  }
  return bits == UINT32_MAX;
}

/* Finds the address at which the archive writes the next incident: after the newest record, or at
 * the start of the other sector, which is then erased. */
static uint32_t find_room(const store_memory_t *memory, const sector_t *home, const sector_t *other,
                          uint8_t other_number, uint32_t bytes) {
  /* If a power cut has interrupted the writing of a record, its first bytes are not blank. So only
   * the first bytes are checked. A check of the whole sector would take too long. */
  if (home->end - home->next >= bytes && is_blank(memory, home->next, home->next + PIECE_BYTES)) {
    return home->next;
  }
  const uint32_t begin = other->end - memory->sector_bytes;
  const bool was_blank = is_blank(memory, begin, other->end);
  if (bytes > memory->sector_bytes ||
      (!was_blank && !memory->erase(memory->context, other_number))) {
    return ARCHIVE_NOWHERE;
  }
  return (was_blank || is_blank(memory, begin, other->end)) ? begin : ARCHIVE_NOWHERE;
}

static void check(archive_t *archive, bool is_new) {
  archive->step = CHECKING;
  archive->is_new = is_new ? 1 : 0;
  archive->at = archive->record.begin;
  archive->crc = UINT32_MAX;
}

void archive_init(archive_t *archive, const store_memory_t *memory, uint32_t samples) {
  archive->memory = memory;
  archive->record = none;
  archive->before = none;
  archive->samples_crc = 0;
  archive->sequence = 0;
  archive->bytes = archive_bytes(samples);
  archive->begin = ARCHIVE_NOWHERE;
  archive->step = IDLE;
  archive->is_new = 0;
  archive->written = 0;
  archive->clear = 0;
  if (memory == NULL) {
    return;
  }
  const sector_t sectors[2] = {read_sector(memory, 0), read_sector(memory, 1)};
  const bool is_second = sectors[1].last.magic == RECORD_INCIDENT &&
                         (sectors[0].last.magic != RECORD_INCIDENT ||
                          sectors[1].last.sequence > sectors[0].last.sequence);
  const sector_t *home = &sectors[is_second ? 1 : 0];
  const sector_t *other = &sectors[is_second ? 0 : 1];
  archive->begin = find_room(memory, home, other, is_second ? 0 : 1, archive->bytes);
  const bool is_erased = archive->begin != ARCHIVE_NOWHERE && archive->begin != home->next;
  archive->record = home->last;
  archive->before = home->before;
  if (home->before.magic != RECORD_INCIDENT && !is_erased) {
    archive->before = other->last;
  }
  if (archive->record.magic == RECORD_INCIDENT) {
    archive->sequence = archive->record.sequence;
    check(archive, false);
  }
}

/* Ends the check of a record. The record becomes the archived incident if its CRC is correct and
 * its incident was not cleared. */
static void end_check(archive_t *archive, bool is_right) {
  const store_memory_t *memory = archive->memory;
  archive->step = IDLE;
  if (!is_right) {
    archive->record = archive->before;
    archive->before = none;
    if (archive->is_new != 0) {
      archive->begin = ARCHIVE_NOWHERE;
    }
    if (archive->record.magic == RECORD_INCIDENT) {
      check(archive, false);
    }
    return;
  }
  archive->samples_crc = record_word(memory, archive->record.begin + ABOUT_CRC);
  if (record_word(memory, mark_of(&archive->record)) != UINT32_MAX) {
    archive->record.magic = RECORD_NONE;
  }
}

static void step_check(archive_t *archive) {
  const uint32_t end = archive->record.begin + RECORD_HEAD_BYTES + archive->record.entries;
  const uint32_t until = (end - archive->at < READ_BYTES) ? end : archive->at + READ_BYTES;
  archive->crc = record_crc_of_memory(archive->memory, archive->crc, archive->at, until);
  archive->at = until;
  if (until == end) {
    end_check(archive, ~archive->crc == record_word(archive->memory, end));
  }
}

static void begin_write(archive_t *archive, const blackbox_t *blackbox, uint32_t tick) {
  const recorder_t *ring = &blackbox->ring;
  const uint32_t samples = ring->signals.recorder_count * ring->sample_bytes;
  archive->before = archive->record;
  archive->sequence += 1;
  archive->record = (record_t){
      .begin = archive->begin,
      .magic = RECORD_INCIDENT,
      .hash = AXIS_OBJECTS_HASH32,
      .sequence = archive->sequence,
      .entries = archive_bytes(samples) - archive_bytes(0) + ARCHIVE_ABOUT_BYTES,
  };
  archive->samples_crc = blackbox->crc;
  archive->day_tick = tick;
  archive->written = 1;
  archive->step = WRITING;
  archive->at = archive->begin;
  archive->crc = UINT32_MAX;
}

static void pack(uint8_t piece[PIECE_BYTES], uint32_t a, uint32_t b, uint32_t c, uint32_t d) {
  fx_store_le(piece, a, 4);
  fx_store_le(piece + 4, b, 4);
  fx_store_le(piece + 8, c, 4);
  fx_store_le(piece + 12, d, 4);
}

/* Copies to `piece` 16 bytes of the record that the archive is writing. `offset` is the offset of
 * the first of these bytes in the record. */
static void piece_of(const archive_t *archive, const blackbox_t *blackbox, uint32_t offset,
                     uint8_t piece[PIECE_BYTES]) {
  const record_t *record = &archive->record;
  const recorder_signals_t *signals = &blackbox->ring.signals;
  if (offset == 0) {
    pack(piece, record->magic, record->hash, record->sequence, record->entries);
  } else if (offset == RECORD_HEAD_BYTES) {
    pack(piece, blackbox->tick, blackbox->crc, blackbox->error_code, signals->recorder_count);
    fx_store_le(piece + 10, blackbox->fault, 2);
    fx_store_le(piece + 14, signals->recorder_trigger_index, 2);
  } else {
    const uint32_t count = recorder_bytes(&blackbox->ring, offset - SAMPLES, piece, PIECE_BYTES);
    for (uint32_t i = count; i < PIECE_BYTES; i++) {
      piece[i] = 0;
    }
  }
}

/* Gives up a record that cannot be written completely. The sector with this record is not used
 * until the next power-up. */
static void give_up(archive_t *archive) {
  archive->record = archive->before;
  archive->before = none;
  archive->begin = ARCHIVE_NOWHERE;
  archive->step = IDLE;
  if (archive->record.magic == RECORD_INCIDENT) {
    check(archive, false);
  }
}

static void step_write(archive_t *archive, const blackbox_t *blackbox) {
  const store_memory_t *memory = archive->memory;
  const uint32_t offset = archive->at - archive->record.begin;
  if (!blackbox_has_incident(blackbox) || blackbox->crc != archive->samples_crc) {
    give_up(archive);
    return;
  }
  uint8_t piece[PIECE_BYTES];
  uint32_t count = PIECE_BYTES;
  const bool is_last = offset == RECORD_HEAD_BYTES + archive->record.entries;
  if (is_last) {
    count = RECORD_CRC_BYTES;
    fx_store_le(piece, ~archive->crc, 4);
  } else {
    piece_of(archive, blackbox, offset, piece);
    archive->crc = record_crc(archive->crc, piece, count);
  }
  if (!memory->program(memory->context, archive->at, piece, count)) {
    give_up(archive);
    return;
  }
  archive->at += count;
  if (is_last) {
    const uint32_t next = end_of(&archive->record);
    const uint32_t first_end = memory->sector_bytes;
    const uint32_t end = (archive->begin < first_end) ? first_end : 2 * first_end;
    archive->begin = (end - next >= archive->bytes) ? next : ARCHIVE_NOWHERE;
    check(archive, true);
  }
}

static uint32_t loaded_bytes(const archive_t *archive, const blackbox_t *blackbox) {
  const uint32_t count = record_word(archive->memory, archive->record.begin + ABOUT_COUNT);
  return fx_field(count, 0, 16) * blackbox->ring.sample_bytes;
}

static void step_load(archive_t *archive, blackbox_t *blackbox) {
  const record_t *record = &archive->record;
  const store_memory_t *memory = archive->memory;
  const uint32_t begin = record->begin;
  const uint32_t count_word = record_word(memory, begin + ABOUT_COUNT);
  const uint32_t bytes = loaded_bytes(archive, blackbox);
  const uint32_t offset = archive->at - begin - SAMPLES;
  if (offset < bytes) {
    const uint32_t count = (bytes - offset < READ_BYTES) ? bytes - offset : READ_BYTES;
    memory->read(memory->context, archive->at, blackbox->ring.buffer + offset, count);
    archive->at += count;
    return;
  }
  const uint32_t error = record_word(memory, begin + ABOUT_ERROR);
  archive->step = IDLE;
  blackbox_restore(blackbox, record_word(memory, begin + ABOUT_TICK),
                   (uint16_t)fx_field(error, 0, 16), (uint8_t)fx_field(error, 16, 8),
                   (uint16_t)fx_field(count_word, 0, 16), (uint16_t)fx_field(count_word, 16, 16));
}

/* Returns true if the incident of the black box must be archived: the archive does not contain this
 * incident, and no incident was archived in the last 24 hours. */
static bool is_due(const archive_t *archive, const blackbox_t *blackbox, uint32_t tick) {
  const bool is_known = archive->sequence != 0 && archive->samples_crc == blackbox->crc;
  return archive->begin != ARCHIVE_NOWHERE && !is_known &&
         (archive->written == 0 || tick - archive->day_tick >= ARCHIVE_DAY_TICKS);
}

static void mark_cleared(archive_t *archive) {
  static const uint8_t mark[ARCHIVE_CLEARED_BYTES] = {0};
  const store_memory_t *memory = archive->memory;
  archive->clear = 0;
  (void)memory->program(memory->context, mark_of(&archive->record), mark, sizeof(mark));
  archive->record.magic = RECORD_NONE;
}

void archive_serve(archive_t *archive, blackbox_t *blackbox, bool complete, bool disabled,
                   uint32_t tick) {
  if (archive->memory == NULL) {
    return;
  }
  switch (archive->step) {
    case CHECKING:
      step_check(archive);
      break;
    case WRITING:
      if (disabled) {
        step_write(archive, blackbox);
      }
      break;
    case LOADING:
      step_load(archive, blackbox);
      break;
    default:
      if (disabled && archive->clear != 0) {
        mark_cleared(archive);
      } else if (disabled && complete && is_due(archive, blackbox, tick)) {
        begin_write(archive, blackbox, tick);
      }
      break;
  }
}

uint8_t archive_state(const archive_t *archive) {
  if (archive->step == WRITING) {
    return AXIS_INCIDENT_STORED_WRITING;
  }
  if (archive->step == CHECKING) {
    return AXIS_INCIDENT_STORED_CHECKING;
  }
  if (archive->record.magic != RECORD_INCIDENT || archive->clear != 0) {
    return AXIS_INCIDENT_STORED_NONE;
  }
  return (archive->record.hash == AXIS_OBJECTS_HASH32) ? AXIS_INCIDENT_STORED_STORED
                                                       : AXIS_INCIDENT_STORED_OTHER_TABLE;
}

bool archive_is_loading(const archive_t *archive) { return archive->step == LOADING; }

bool archive_load(archive_t *archive, blackbox_t *blackbox) {
  if (archive->memory == NULL || archive->step != IDLE ||
      archive_state(archive) != AXIS_INCIDENT_STORED_STORED ||
      loaded_bytes(archive, blackbox) > blackbox->ring.buffer_bytes) {
    return false;
  }
  blackbox_stop(blackbox);
  archive->step = LOADING;
  archive->at = archive->record.begin + SAMPLES;
  return true;
}

void archive_clear(archive_t *archive, uint32_t samples_crc) {
  if (archive->record.magic == RECORD_INCIDENT && archive->samples_crc == samples_crc &&
      archive->step == IDLE) {
    archive->clear = 1;
  }
}
