#ifndef FIRMWARE_STORAGE_ENTRIES_H_
#define FIRMWARE_STORAGE_ENTRIES_H_

/* The entries of a stored set (record.h), as they apply to the present object table; store.h says
 * what they consist of. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/dictionary.h"
#include "firmware/storage/record.h"

enum { ENTRY_BYTES = 12 };

/* INERT keeps a stored mapping whose object cannot be mapped any more. Its PDO carries nothing: the
 * default in its place would shift what follows it in the frame. */
typedef enum { ENTRY_FITS, ENTRY_OLD_DEFAULT, ENTRY_INERT, ENTRY_DROPPED } verdict_t;

typedef struct {
  uint32_t address; /* index times 256 plus sub-index */
  uint16_t object;
  int32_t value;
  verdict_t verdict;
} entry_t;

/* The entries of a record, one after the other. */
typedef struct {
  record_t record;
  uint32_t next;               /* offset of the next entry */
  const axis_change_t *change; /* the next one of a set of version 0.1.0 */
} entries_t;

entries_t entries_of(const record_t *record);

/* The next entry; false: there is none. */
bool entries_next(const store_memory_t *memory, const dictionary_t *objects, entries_t *entries,
                  entry_t *entry);

/* The value of an object in a record, whose magic may be RECORD_NONE; its default where the record
 * has none that fits. Cost: as entries_next() for all entries before it. */
int32_t entries_value(const store_memory_t *memory, const dictionary_t *objects,
                      const record_t *record, uint16_t object);

/* An entry with this value. */
void entry_write(uint8_t entry[ENTRY_BYTES], const dictionary_t *objects, uint16_t object,
                 int32_t value);

#endif
