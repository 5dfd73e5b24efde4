#ifndef FIRMWARE_STORAGE_ARCHIVE_H_
#define FIRMWARE_STORAGE_ARCHIVE_H_

/* The archive keeps incidents of the black box (core/blackbox.h) over a power cut, in two
 * flash-like sectors of its own.
 *
 * The archive writes the first incident after power-up, and then at most one in 24 hours of
 * operation. It writes while the axis is disabled, 16 bytes in each call, which takes about 1.2 s.
 * It erases a sector only at power-up, when the other sector has no room for another incident,
 * because an erase is too long for an axis in operation. With sectors of 128 KiB this is every
 * fourth incident, and 10,000 erases of each sector are enough for 80,000 incidents.
 *
 * An incident is one record (record.h): four words about the incident and its samples, filled to a
 * multiple of 16 bytes. The word after its CRC is blank until the incident is cleared. A power cut
 * after any byte leaves the earlier incidents; the sector with the interrupted write is not used
 * again until it is erased. Samples belong to one object table: an incident of another table is
 * reported, but not loaded. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/blackbox.h"
#include "firmware/storage/record.h"

enum {
  ARCHIVE_DAY_TICKS = 129600000,
  ARCHIVE_ABOUT_BYTES = 16, /* tick, CRC, error, fault, count and trigger */
  ARCHIVE_CLEARED_BYTES = 4
};

/* Returns the bytes of an incident in the archive, from the number of bytes of its samples. */
static inline uint32_t archive_bytes(uint32_t samples) {
  return record_bytes(ARCHIVE_ABOUT_BYTES + ((samples + 15) & ~UINT32_C(15))) +
         ARCHIVE_CLEARED_BYTES;
}

typedef struct {
  const store_memory_t *memory; /* NULL: no incident is archived */
  /* newest complete incident; magic RECORD_NONE: there is none, or it was cleared */
  record_t record;
  record_t before;      /* incident that is used if `record` is damaged */
  uint32_t samples_crc; /* CRC-32 of the samples of `record` */
  uint32_t sequence;    /* highest sequence number in use */
  uint32_t bytes;       /* size in bytes of the largest incident */
  /* address of the next record; ARCHIVE_NOWHERE: no room until the next power-up */
  uint32_t begin;
  uint32_t day_tick; /* tick at which the last incident since power-up was begun */
  uint32_t at;       /* work in progress: address of the next bytes */
  uint32_t crc;      /* work in progress: CRC of the bytes before that address */
  uint8_t step;      /* work in progress: the step that runs */
  uint8_t is_new;    /* 1: the record that is checked was just written */
  uint8_t written;   /* 1: day_tick is valid */
  uint8_t clear;     /* 1: `record` is to be marked as cleared */
} archive_t;

/* Address that stands for no record. */
#define ARCHIVE_NOWHERE UINT32_MAX

/* Initialises the archive at power-up; it may erase a sector. `samples` is the largest number of
 * bytes of the samples of an incident; a memory with sectors too small for them is not used. Cost:
 * it reads the heads of the records and, if a sector is full, reads the other sector once. */
void archive_init(archive_t *archive, const store_memory_t *memory, uint32_t samples);

/* Call it between ticks. It does one bounded step: it reads 64 bytes or programs 16. `complete`:
 * blackbox->crc is complete. A write waits until the axis is disabled. */
void archive_serve(archive_t *archive, blackbox_t *blackbox, bool complete, bool disabled,
                   uint32_t tick);

/* Returns the state of the archive, AXIS_INCIDENT_STORED_. */
uint8_t archive_state(const archive_t *archive);

bool archive_is_loading(const archive_t *archive);

/* Starts to load the archived incident into the black box, whose channels are already set; this
 * ends a recording of the black box. When archive_is_loading() becomes false, the incident is in
 * the black box, like one kept over a restart. Returns false if there is no incident of this object
 * table, or if the memory is busy. */
bool archive_load(archive_t *archive, blackbox_t *blackbox);

/* The incident in the black box was cleared: also clears the archived incident if it is the same
 * incident. */
void archive_clear(archive_t *archive, uint32_t samples_crc);

#endif
