#ifndef FIRMWARE_STORAGE_ENTRIES_H_
#define FIRMWARE_STORAGE_ENTRIES_H_

/* Functions that interpret the entries of a stored parameter set (record.h) with the present object
 * table. store.h describes the contents of an entry. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/dictionary.h"
#include "firmware/storage/record.h"

enum { ENTRY_BYTES = 12 };

/* Result of the comparison of a stored entry with the present object table. ENTRY_INERT: the entry
 * is a PDO mapping whose object can no longer be mapped. Then the PDO has no mapped objects,
 * because with the default mapping the objects after the missing one would be at wrong places in
 * the frame. */
typedef enum { ENTRY_FITS, ENTRY_OLD_DEFAULT, ENTRY_INERT, ENTRY_DROPPED } verdict_t;

typedef struct {
  uint32_t address; /* address of the object: CANopen index times 256 plus sub-index */
  uint16_t object;
  int32_t value;
  verdict_t verdict;
} entry_t;

/* An iterator over the entries of one record of the parameter store. */
typedef struct {
  record_t record;
  uint32_t next; /* offset in bytes of the next entry of the record */
  /* next entry in the list of changes of the object table since version 0.1.0; used only for a
   * parameter set of version 0.1.0 */
  const axis_change_t *change;
} entries_t;

entries_t entries_of(const record_t *record);

/* Reads the next entry of a record of the parameter store. Returns false after the last entry. */
bool entries_next(const store_memory_t *memory, const dictionary_t *objects, entries_t *entries,
                  entry_t *entry);

/* Returns the value of an object that is stored in a record. If no entry of the record matches,
 * returns the default of the object. The magic of the record may be RECORD_NONE. Cost: one call of
 * entries_next() for each entry before the entry of the object. */
int32_t entries_value(const store_memory_t *memory, const dictionary_t *objects,
                      const record_t *record, uint16_t object);

/* Computes the bytes of an entry that stores the value `value` of an object. */
void entry_write(uint8_t entry[ENTRY_BYTES], const dictionary_t *objects, uint16_t object,
                 int32_t value);

#endif
