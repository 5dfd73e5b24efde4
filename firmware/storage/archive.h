#ifndef FIRMWARE_STORAGE_ARCHIVE_H_
#define FIRMWARE_STORAGE_ARCHIVE_H_

/* The archive: incidents of the black box (core/blackbox.h) over a power cut, in a flash-like
 * memory of two sectors of its own.
 *
 * The first incident after power-up, and then one in 24 hours of operation, is written while the
 * axis is disabled, 16 bytes a call: some 1.2 s. A sector is erased at power-up alone, when the
 * other one has no room for another incident: an erase lasts too long for an axis in operation.
 * With 128 KiB sectors that is every fourth incident, and 10,000 erases of each last for 80,000.
 *
 * An incident is one record (record.h): four words about it and the samples, to a multiple of 16
 * bytes. Behind its CRC a word stays blank until the incident is cleared. A cut after any byte
 * leaves the incidents before it; the sector that it was written to is closed until it is erased.
 * Samples are those of one object table: an incident of another one is reported, not loaded. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/blackbox.h"
#include "firmware/storage/record.h"

enum {
  ARCHIVE_DAY_TICKS = 129600000,
  ARCHIVE_ABOUT_BYTES =
      16, /* tick, CRC-32 of the samples, error code and fault, count and trigger */
  ARCHIVE_CLEARED_BYTES = 4
};

/* Bytes that an incident takes, from those of its samples. */
static inline uint32_t archive_bytes(uint32_t samples) {
  return record_bytes(ARCHIVE_ABOUT_BYTES + ((samples + 15) & ~UINT32_C(15))) +
         ARCHIVE_CLEARED_BYTES;
}

typedef struct {
  const store_memory_t *memory; /* NULL: nothing is archived */
  record_t record;              /* the newest whole one; magic RECORD_NONE: none, or cleared */
  record_t before;              /* counts if `record` turns out to be damaged */
  uint32_t samples_crc;         /* of `record` */
  uint32_t sequence;            /* the highest one used */
  uint32_t bytes;               /* that the largest incident takes */
  uint32_t begin;               /* of the next record; ARCHIVE_NOWHERE: no room until power-up */
  uint32_t day_tick;            /* when the last one of this power-up was begun */
  uint32_t at;                  /* work in progress: the next address, */
  uint32_t crc;                 /* of what came before it, */
  uint8_t step;                 /* what is done, */
  uint8_t is_new;               /* 1: and the record that is checked was just written */
  uint8_t written;              /* 1: day_tick is set */
  uint8_t clear;                /* 1: `record` is to be marked as cleared */
} archive_t;

/* Addresses nothing. */
#define ARCHIVE_NOWHERE UINT32_MAX

/* At power-up; may erase a sector. `samples` is the largest number of bytes an incident has; a
 * memory whose sectors are smaller than that takes none. Cost: reads the heads of the records;
 * where a sector is full, the other one once. */
void archive_init(archive_t *archive, const store_memory_t *memory, uint32_t samples);

/* Between ticks, one bounded step: 64 bytes read, or 16 programmed. `complete`: blackbox->crc is
 * known. What is to be written waits until the axis is disabled. */
void archive_serve(archive_t *archive, blackbox_t *blackbox, bool complete, bool disabled,
                   uint32_t tick);

/* AXIS_INCIDENT_STORED_ */
uint8_t archive_state(const archive_t *archive);

bool archive_is_loading(const archive_t *archive);

/* Starts to load the archived incident into the black box, whose channels are set; that ends what
 * it recorded. The incident is there, as one kept over a restart, when archive_is_loading() is
 * over. False: there is none of this object table, or the memory is busy with one. */
bool archive_load(archive_t *archive, blackbox_t *blackbox);

/* The incident of the black box was cleared: so is the archived one, if it is the same. */
void archive_clear(archive_t *archive, uint32_t samples_crc);

#endif
