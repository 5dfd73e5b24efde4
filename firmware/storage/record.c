#include "firmware/storage/record.h"

#include "firmware/fx/bytes.h"

enum { PIECE_BYTES = 16 };

/* Returns true if `magic`, the first word of a record, marks cycle programs, counts of parts or a
 * copy, and not a parameter set. */
static bool is_part(uint32_t magic) {
  return magic == RECORD_PROGRAMS || magic == RECORD_COUNTS || magic == RECORD_COPY;
}

static bool is_set(uint32_t magic) {
  return magic == RECORD_SET || magic == RECORD_SET_0_1_0 || magic == RECORD_FORGOTTEN;
}

uint32_t record_entry_bytes(uint32_t magic) {
  if (is_part(magic)) {
    return 4;
  }
  return (magic == RECORD_SET) ? 12 : 8;
}

uint32_t record_word(const store_memory_t *memory, uint32_t at) {
  uint8_t bytes[4];
  memory->read(memory->context, at, bytes, 4);
  return fx_load_le32(bytes);
}

uint32_t record_crc(uint32_t crc, const uint8_t *bytes, uint32_t count) {
  for (uint32_t i = 0; i < count; i++) {
    crc = fx_crc32(crc, bytes[i]);
  }
  return crc;
}

uint32_t record_crc_of_memory(const store_memory_t *memory, uint32_t crc, uint32_t at,
                              uint32_t end) {
  uint8_t piece[PIECE_BYTES];
  while (at < end) {
    const uint32_t count = (end - at < PIECE_BYTES) ? end - at : PIECE_BYTES;
    memory->read(memory->context, at, piece, count);
    crc = record_crc(crc, piece, count);
    at += count;
  }
  return crc;
}

/* Returns true if the total size of the entries of a record is a multiple of the size of one
 * entry. */
static bool are_whole(const record_t *record) {
  const uint32_t size = record_entry_bytes(record->magic);
  uint32_t remaining = record->entries;
  while (remaining >= size) {
    remaining -= size;
  }
  return remaining == 0;
}

/* Reads the head of a record. Returns true if the values in the head are permitted. */
static bool read_head(const store_memory_t *memory, uint32_t at, uint32_t end, record_t *record) {
  if (end - at < record_bytes(0)) {
    return false;
  }
  record->begin = at;
  record->magic = record_word(memory, at);
  if (!is_set(record->magic) && !is_part(record->magic)) {
    return false;
  }
  record->hash = record_word(memory, at + 4);
  record->sequence = record_word(memory, at + 8);
  record->entries = record_word(memory, at + 12);
  return record->entries <= end - at - record_bytes(0) && are_whole(record);
}

static bool is_right(const store_memory_t *memory, const record_t *record) {
  const uint32_t crc_at = record->begin + RECORD_HEAD_BYTES + record->entries;
  return ~record_crc_of_memory(memory, UINT32_MAX, record->begin, crc_at) ==
         record_word(memory, crc_at);
}

bool record_read(const store_memory_t *memory, uint32_t at, uint32_t end, record_t *record) {
  return read_head(memory, at, end, record) && is_right(memory, record);
}

static void sort_in(record_t newest[2], const record_t *record) {
  if (newest[0].magic == RECORD_NONE || record->sequence > newest[0].sequence) {
    newest[1] = newest[0];
    newest[0] = *record;
  } else if (newest[1].magic == RECORD_NONE || record->sequence > newest[1].sequence) {
    newest[1] = *record;
  }
}

uint32_t record_tail(const store_memory_t *memory, uint32_t sector) {
  const uint32_t begin = sector * memory->sector_bytes;
  uint32_t tail = memory->sector_bytes;
  while (tail > 0 && record_word(memory, begin + tail - 4) == UINT32_MAX) {
    tail -= 4;
  }
  return tail;
}

/* Enters a complete record that was found in a sector into the structure that describes this
 * sector. */
static void note(record_sector_t *sector, record_t sets[2], const record_t *record) {
  if (is_set(record->magic)) {
    sort_in(sets, record);
    sector->has_set = 1;
    sector->has_remains = 0;
  } else if (record->magic == RECORD_PROGRAMS) {
    sector->programs = *record;
  } else if (record->magic == RECORD_COUNTS) {
    sector->counts = *record;
  }
}

/* Returns true if the writing of a record was interrupted after its first word. Then a record may
 * begin at the address `at`, the word at this address is not blank, and the next word is blank. */
static bool is_single(const store_memory_t *memory, uint32_t at, uint32_t end) {
  return (at & 15u) == 0 && end - at > 4 && record_word(memory, at) != UINT32_MAX &&
         record_word(memory, at + 4) == UINT32_MAX;
}

bool record_is_copied(const store_memory_t *memory, uint32_t sector) {
  const uint32_t end = (sector + 1) * memory->sector_bytes;
  record_t mark;
  return record_read(memory, end - RECORD_MARK, end, &mark) && mark.magic == RECORD_COPY &&
         record_word(memory, end - RECORD_MARK_END) == UINT32_MAX;
}

/* Call this function if no complete record begins at the address `at`. Returns the number of bytes
 * to skip at this address: the space of an interrupted record, or one word. */
static uint32_t skip(const store_memory_t *memory, uint32_t at, uint32_t end, bool has_head,
                     const record_t *record, record_sector_t *sector) {
  const uint32_t word = record_word(memory, at);
  const bool is_begun = is_part(word) || is_single(memory, at, end);
  if (is_begun && end - at >= RECORD_HEAD_BYTES) {
    return has_head ? record_bytes(record->entries) : (uint32_t)RECORD_HEAD_BYTES;
  }
  if (word != UINT32_MAX) {
    sector->has_remains = 1;
  }
  return 4;
}

/* Reads one sector and describes its contents in *sector. Returns the highest sequence number of
 * its complete records. */
static uint32_t survey(const store_memory_t *memory, uint32_t begin, record_sector_t *sector,
                       record_t sets[2]) {
  const uint32_t end = begin + memory->sector_bytes;
  const uint32_t last = begin + sector->tail;
  uint32_t sequence = 0;
  uint32_t at = begin;
  while (at < last) {
    record_t record;
    const bool has_head = read_head(memory, at, end, &record);
    uint32_t bytes = 4;
    if (has_head && is_right(memory, &record)) {
      note(sector, sets, &record);
      sequence = (record.sequence > sequence) ? record.sequence : sequence;
      bytes = record_bytes(record.entries);
    } else {
      bytes = skip(memory, at, end, has_head, &record, sector);
    }
    at += bytes;
    if (bytes > 4 && at - begin > sector->tail) {
      sector->tail = at - begin;
    }
  }
  return sequence;
}

uint32_t record_survey(const store_memory_t *memory, record_sector_t sectors[2], record_t sets[2]) {
  uint32_t highest = 0;
  sets[0].magic = RECORD_NONE;
  sets[1].magic = RECORD_NONE;
  for (uint32_t i = 0; i < 2; i++) {
    const uint32_t begin = i * memory->sector_bytes;
    const bool is_copy = record_word(memory, begin) == RECORD_COPY ||
                         is_single(memory, begin, begin + memory->sector_bytes);
    record_sector_t *sector = &sectors[i];
    sector->programs.magic = RECORD_NONE;
    sector->counts.magic = RECORD_NONE;
    sector->tail = record_tail(memory, i);
    sector->has_set = 0;
    sector->is_copy = is_copy ? 1 : 0;
    sector->is_copied = record_is_copied(memory, i) ? 1 : 0;
    sector->has_remains = 0;
    const uint32_t sequence = survey(memory, begin, sector, sets);
    highest = (sequence > highest) ? sequence : highest;
  }
  return highest;
}
