#ifndef FIRMWARE_STORAGE_ENTRIES_H_
#define FIRMWARE_STORAGE_ENTRIES_H_

/* The entries of a stored parameter set (record.h), interpreted with the present object table.
 * store.h describes what an entry contains. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/dictionary.h"
#include "firmware/storage/record.h"

enum { ENTRY_BYTES = 12 };

/* Result of the comparison of a stored entry with the present object table. ENTRY_INERT is the
 * result for a stored PDO mapping whose object can no longer be mapped. The PDO then has no mapped
 * object, because the default mapping would shift the following objects in the frame. */
typedef enum { ENTRY_FITS, ENTRY_OLD_DEFAULT, ENTRY_INERT, ENTRY_DROPPED } verdict_t;

typedef struct {
  uint32_t address; /* address of the object: CANopen index times 256 plus sub-index */
  uint16_t object;
  int32_t value;
  verdict_t verdict;
} entry_t;

/* Iterator over the entries of one record. */
typedef struct {
  record_t record;
  uint32_t next; /* offset in bytes of the next entry */
  /* next change of the object table since version 0.1.0; used only for a parameter set of version
   * 0.1.0 */
  const axis_change_t *change;
} entries_t;

entries_t entries_of(const record_t *record);

/* Reads the next entry of the record. Returns false after the last entry. */
bool entries_next(const store_memory_t *memory, const dictionary_t *objects, entries_t *entries,
                  entry_t *entry);

/* Returns the stored value of an object in a record, or the default of the object if no entry of
 * the record matches. The magic of the record may be RECORD_NONE. The cost is that of
 * entries_next() for all earlier entries. */
int32_t entries_value(const store_memory_t *memory, const dictionary_t *objects,
                      const record_t *record, uint16_t object);

/* Writes the bytes of an entry that stores this value for an object. */
void entry_write(uint8_t entry[ENTRY_BYTES], const dictionary_t *objects, uint16_t object,
                 int32_t value);

#endif
