#include "firmware/storage/record.h"

#include "firmware/fx/bytes.h"

enum { PIECE_BYTES = 16 };

uint32_t record_entry_bytes(uint32_t magic) { return (magic == RECORD_SET) ? 12 : 8; }

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

/* Returns true if the size of the entries is a multiple of the size of one entry. */
static bool are_whole(const record_t *record) {
  const uint32_t size = record_entry_bytes(record->magic);
  uint32_t remaining = record->entries;
  while (remaining >= size) {
    remaining -= size;
  }
  return remaining == 0;
}

bool record_read(const store_memory_t *memory, uint32_t at, uint32_t end, record_t *record) {
  if (end - at < record_bytes(0)) {
    return false;
  }
  record->magic = record_word(memory, at);
  if (record->magic != RECORD_SET && record->magic != RECORD_SET_0_1_0 &&
      record->magic != RECORD_FORGOTTEN) {
    return false;
  }
  record->begin = at;
  record->hash = record_word(memory, at + 4);
  record->sequence = record_word(memory, at + 8);
  record->entries = record_word(memory, at + 12);
  if (record->entries > end - at - record_bytes(0) || !are_whole(record)) {
    return false;
  }
  const uint32_t crc_at = at + RECORD_HEAD_BYTES + record->entries;
  return ~record_crc_of_memory(memory, UINT32_MAX, at, crc_at) == record_word(memory, crc_at);
}

static void sort_in(record_t newest[2], const record_t *record) {
  if (newest[0].magic == RECORD_NONE || record->sequence > newest[0].sequence) {
    newest[1] = newest[0];
    newest[0] = *record;
  } else if (newest[1].magic == RECORD_NONE || record->sequence > newest[1].sequence) {
    newest[1] = *record;
  }
}

/* A record whose writing was interrupted has no valid end, so the next record is searched word by
 * word. */
void record_newest(const store_memory_t *memory, record_t newest[2]) {
  newest[0].magic = RECORD_NONE;
  newest[1].magic = RECORD_NONE;
  for (uint32_t sector = 0; sector < 2; sector++) {
    uint32_t at = sector * memory->sector_bytes;
    const uint32_t end = at + memory->sector_bytes;
    while (at < end) {
      record_t record;
      if (record_read(memory, at, end, &record)) {
        sort_in(newest, &record);
        at += record_bytes(record.entries);
      } else {
        at += 4;
      }
    }
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
