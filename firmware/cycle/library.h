#ifndef FIRMWARE_CYCLE_LIBRARY_H_
#define FIRMWARE_CYCLE_LIBRARY_H_

/* The library of the cycle programs of an axis. Its memory belongs to the caller and has two areas:
 * the programs, which are records (program.h) one after the other, and a staging area, in which one
 * new record is assembled. A record is added to the library only after it was checked completely,
 * so an incomplete transfer changes nothing.
 *
 *   cycle_library_begin()    begins a record in the staging area
 *   cycle_library_append()   adds bytes of the record, in any number of pieces
 *   cycle_library_accept()   checks the record and puts it into the library
 *
 * cycle_library_accept() and cycle_library_remove() move records, so earlier pointers to records
 * are no longer valid. On a Cortex-M4 cycle_library_accept() needs some 55,000 instructions for a
 * record of 4 KiB, or 165,000 if the record has 16 of the longest envelopes. The caller accepts
 * records only while no cycle runs and the axis is disabled. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/cycle/program.h"

typedef struct {
  /* staging area of CYCLE_PROGRAM_BYTES_MAX bytes; NULL: there is no memory for programs */
  uint8_t *staging;
  uint8_t *records;
  uint32_t bytes; /* size in bytes of the memory for the records of programs */
  uint32_t used;  /* number of bytes of all records in the library */
  /* number of consecutive bytes, from the begin of the staging area on, that were written */
  uint32_t staged;
  uint8_t count; /* number of programs in the library, at most 255 */
} cycle_library_t;

/* Sets an empty library. `memory` begins at a multiple of 4; its first CYCLE_PROGRAM_BYTES_MAX
 * bytes become the staging area. If `memory` is NULL or too small, there is no library. */
void cycle_library_init(cycle_library_t *library, void *memory, uint32_t bytes);

/* Checks the records that the caller has copied to the begin of the library, `bytes` bytes in
 * total. Records that are refused are removed. After a record with a wrong size all following
 * records are removed too. Returns the number of removed bytes. */
uint32_t cycle_library_restore(cycle_library_t *library, uint32_t bytes);

/* Begins the record of a new cycle program in the staging area. The previous contents of the
 * staging area are discarded. */
void cycle_library_begin(cycle_library_t *library);

/* Copies `count` bytes to an offset of the record in the staging area. If bytes before this offset
 * are missing, or if the bytes exceed the staging area, changes nothing and returns false. */
bool cycle_library_append(cycle_library_t *library, uint32_t offset, const uint8_t *bytes,
                          uint32_t count);

/* Checks the first `size` bytes of the staging area as a record, and adds the record to the
 * library. The record replaces a program with the same number. If the record is refused, the
 * library does not change. */
cycle_check_t cycle_library_accept(cycle_library_t *library, uint32_t size);

/* Returns the cycle program with the number `number`, or NULL if the library has no such program.
 */
const cycle_header_t *cycle_library_find(const cycle_library_t *library, uint32_t number);

/* Returns the cycle program with the index `place`, 0 .. count - 1, in the library. */
const cycle_header_t *cycle_library_at(const cycle_library_t *library, uint8_t place);

/* Removes the cycle program with the number `number`. Returns false if the library has no such
 * program. */
bool cycle_library_remove(cycle_library_t *library, uint32_t number);

#endif
