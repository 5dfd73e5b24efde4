#include "firmware/cycle/library.h"

#include <stddef.h>

#include "firmware/fx/bytes.h"

enum { PROGRAMS_MAX = 255 };

void cycle_library_init(cycle_library_t *library, void *memory, uint32_t bytes) {
  const bool fits = memory != NULL && bytes > CYCLE_PROGRAM_BYTES_MAX;
  library->staging = fits ? (uint8_t *)memory : NULL;
  library->records = fits ? library->staging + CYCLE_PROGRAM_BYTES_MAX : NULL;
  library->bytes = fits ? bytes - CYCLE_PROGRAM_BYTES_MAX : 0;
  library->used = 0;
  library->staged = 0;
  library->count = 0;
}

void cycle_library_begin(cycle_library_t *library) { library->staged = 0; }

bool cycle_library_append(cycle_library_t *library, uint32_t offset, const uint8_t *bytes,
                          uint32_t count) {
  if (library->staging == NULL || offset > library->staged ||
      count > CYCLE_PROGRAM_BYTES_MAX - offset) {
    return false;
  }
  for (uint32_t i = 0; i < count; i++) {
    library->staging[offset + i] = bytes[i];
  }
  if (offset + count > library->staged) {
    library->staged = offset + count;
  }
  return true;
}

static const cycle_header_t *record_at(const cycle_library_t *library, uint32_t offset) {
  const void *record = &library->records[offset];
  return (const cycle_header_t *)record;
}

/* Returns the offset of the cycle program with the number `number`. If there is no such program,
 * returns the offset after the last record. */
static uint32_t place_of(const cycle_library_t *library, uint32_t number) {
  uint32_t offset = 0;
  while (offset < library->used && record_at(library, offset)->number != number) {
    offset += record_at(library, offset)->size;
  }
  return offset;
}

const cycle_header_t *cycle_library_find(const cycle_library_t *library, uint32_t number) {
  const uint32_t offset = place_of(library, number);
  return (offset < library->used) ? record_at(library, offset) : NULL;
}

const cycle_header_t *cycle_library_at(const cycle_library_t *library, uint8_t place) {
  uint32_t offset = 0;
  for (uint8_t i = 0; i < place; i++) {
    offset += record_at(library, offset)->size;
  }
  return record_at(library, offset);
}

bool cycle_library_remove(cycle_library_t *library, uint32_t number) {
  const uint32_t offset = place_of(library, number);
  if (offset == library->used) {
    return false;
  }
  const uint32_t size = record_at(library, offset)->size;
  fx_copy_words(&library->records[offset], &library->records[offset + size],
                library->used - offset - size);
  library->used -= size;
  library->count = (uint8_t)(library->count - 1);
  return true;
}

/* Returns true if the library has room for a record of `size` bytes after the record `old` is
 * removed. If `old` is NULL, no record is removed. */
static bool has_room(const cycle_library_t *library, const cycle_header_t *old, uint32_t size) {
  const uint32_t freed = (old == NULL) ? 0 : old->size;
  return size <= library->bytes - library->used + freed &&
         (old != NULL || library->count < PROGRAMS_MAX);
}

cycle_check_t cycle_library_accept(cycle_library_t *library, uint32_t size) {
  if (library->staged < size) {
    return (cycle_check_t){CYCLE_WRONG_SIZE, 0};
  }
  const void *record = library->staging;
  const cycle_header_t *program = (const cycle_header_t *)record;
  const cycle_check_t check = cycle_program_check(record, size);
  if (check.reason != CYCLE_ACCEPTED) {
    return check;
  }
  if (program->number == 0) {
    return (cycle_check_t){CYCLE_NO_NUMBER, 0};
  }
  if (!has_room(library, cycle_library_find(library, program->number), size)) {
    return (cycle_check_t){CYCLE_NO_ROOM, 0};
  }
  (void)cycle_library_remove(library, program->number);
  fx_copy_words(&library->records[library->used], library->staging, size);
  library->used += size;
  library->count = (uint8_t)(library->count + 1);
  return check;
}

uint32_t cycle_library_restore(cycle_library_t *library, uint32_t bytes) {
  uint32_t offset = 0;
  while (bytes - offset >= sizeof(cycle_header_t)) {
    const cycle_header_t *program = record_at(library, offset);
    const uint32_t size = program->size;
    if (size < sizeof(cycle_header_t) || (size & 3u) != 0 || size > bytes - offset) {
      break;
    }
    const bool is_right = cycle_program_check(program, size).reason == CYCLE_ACCEPTED &&
                          program->number != 0 &&
                          cycle_library_find(library, program->number) == NULL;
    if (is_right) {
      fx_copy_words(&library->records[library->used], &library->records[offset], size);
      library->used += size;
      library->count = (uint8_t)(library->count + 1);
    }
    offset += size;
  }
  return bytes - library->used;
}
