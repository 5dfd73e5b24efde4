#ifndef FIRMWARE_STORAGE_ENTRIES_H_
#define FIRMWARE_STORAGE_ENTRIES_H_

/* The entries of a stored parameter set (record.h), as they apply to the present object table;
 * store.h describes their content. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/dictionary.h"
#include "firmware/storage/record.h"

enum { ENTRY_BYTES = 12 };

/* Result of the comparison of an entry with the object table. INERT keeps a stored PDO mapping
 * whose object can no longer be mapped. The PDO then carries nothing, because the default mapping
 * would shift the following objects in the frame. */
typedef enum { ENTRY_FITS, ENTRY_OLD_DEFAULT, ENTRY_INERT, ENTRY_DROPPED } verdict_t;

typedef struct {
  uint32_t address; /* CANopen index times 256 plus sub-index */
  uint16_t object;
  int32_t value;
  verdict_t verdict;
} entry_t;

/* Iterator over the entries of a record. */
typedef struct {
  record_t record;
  uint32_t next; /* offset of the next entry */
  /* next change of the object table since version 0.1.0, for a set of that version */
  const axis_change_t *change;
} entries_t;

entries_t entries_of(const record_t *record);

/* Reads the next entry; returns false after the last entry. */
bool entries_next(const store_memory_t *memory, const dictionary_t *objects, entries_t *entries,
                  entry_t *entry);

/* Returns the value of an object in a record, or the default of the object if the record has no
 * entry that matches. The magic of the record may be RECORD_NONE. Cost: as entries_next() for all
 * entries before it. */
int32_t entries_value(const store_memory_t *memory, const dictionary_t *objects,
                      const record_t *record, uint16_t object);

/* Writes an entry for an object with this value. */
void entry_write(uint8_t entry[ENTRY_BYTES], const dictionary_t *objects, uint16_t object,
                 int32_t value);

#endif
