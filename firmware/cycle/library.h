#ifndef FIRMWARE_CYCLE_LIBRARY_H_
#define FIRMWARE_CYCLE_LIBRARY_H_

/* The programs of an axis: records (program.h), one after the other in a memory of the caller, and
 * a staging area, in which one record is assembled. A record is added to the library only after it
 * was checked completely, so an incomplete transfer changes nothing.
 *
 *   cycle_library_begin()    begins a record in the staging area
 *   cycle_library_append()   bytes of the record, in any number of pieces
 *   cycle_library_accept()   checks the record and puts it into the library
 *
 * cycle_library_accept() and cycle_library_remove() move records, so pointers to records must be
 * found anew. On a Cortex-M4 a record of 4 KiB is accepted in some 55,000 instructions, with 16 of
 * the longest envelopes in 165,000; the caller accepts records only while no cycle runs and the
 * axis is disabled. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/cycle/program.h"

typedef struct {
  uint8_t *staging; /* CYCLE_PROGRAM_BYTES_MAX bytes; NULL: there is no memory for programs */
  uint8_t *records;
  uint32_t bytes;  /* size of the library */
  uint32_t used;   /* bytes of all records */
  uint32_t staged; /* number of bytes that were written to the staging area, from its begin and
                    * without a gap */
  uint8_t count;   /* number of programs in the library, at most 255 */
} cycle_library_t;

/* Sets an empty library. `memory` begins at a multiple of 4; its first CYCLE_PROGRAM_BYTES_MAX
 * bytes become the staging area. With NULL, or too few bytes, there is no library. */
void cycle_library_init(cycle_library_t *library, void *memory, uint32_t bytes);

/* Checks the records that the caller has copied to the begin of the library, `bytes` bytes in
 * total. Refused records, and all records after one with a wrong size, are left out. Returns the
 * number of bytes that were left out. */
uint32_t cycle_library_restore(cycle_library_t *library, uint32_t bytes);

/* Begins a record: the bytes that were staged before are discarded. */
void cycle_library_begin(cycle_library_t *library);

/* Copies `count` bytes to an offset of the record in the staging area. Returns false, without a
 * change, if the bytes would leave a gap or exceed the staging area. */
bool cycle_library_append(cycle_library_t *library, uint32_t offset, const uint8_t *bytes,
                          uint32_t count);

/* Checks the first `size` staged bytes as a record and adds the record to the library, in place of
 * a program with the same number. If the record is refused, the library does not change. */
cycle_check_t cycle_library_accept(cycle_library_t *library, uint32_t size);

/* Returns the program with a number, or NULL. */
const cycle_header_t *cycle_library_find(const cycle_library_t *library, uint32_t number);

/* Returns the program with the index `place`, 0 .. count - 1 in the order of the library. */
const cycle_header_t *cycle_library_at(const cycle_library_t *library, uint8_t place);

/* Removes the program with a number. Returns false if there is none. */
bool cycle_library_remove(cycle_library_t *library, uint32_t number);

#endif
