#ifndef FIRMWARE_STORAGE_ARCHIVE_H_
#define FIRMWARE_STORAGE_ARCHIVE_H_

/* The archive keeps incidents of the black box (core/blackbox.h) over a power cut. It uses a
 * flash-like memory of two sectors that contains only the archive.
 *
 * The archive writes the first incident after power-up, and then at most one incident in 24 hours
 * of operation. It writes only while the axis is disabled, 16 bytes in each call. The writing of an
 * incident takes about 1.2 s. An erase takes too long for an axis in operation. So the archive
 * erases a sector only at power-up, and only if the other sector has no room for another incident.
 * If a sector has 128 KiB, a sector is erased after every fourth incident. Then 10,000 erases of
 * each sector are enough for 80,000 incidents.
 *
 * An incident is stored as one record (record.h). The record contains four words that describe the
 * incident, and the samples, filled to a multiple of 16 bytes. The word after the CRC of the record
 * is blank until the incident is cleared. A power cut after any byte does not change the earlier
 * incidents. The sector with the interrupted write is not used again until it is erased. The
 * samples can be read only with the object table with which they were recorded. So an incident of
 * another table is reported, but not loaded. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/blackbox.h"
#include "firmware/storage/record.h"

enum {
  ARCHIVE_DAY_TICKS = 129600000,
  /* size in bytes of the four words that describe an incident: tick; CRC of the samples; error code
   * and fault; number of samples and trigger index */
  ARCHIVE_ABOUT_BYTES = 16,
  ARCHIVE_CLEARED_BYTES = 4
};

/* Returns the number of bytes that an incident occupies in the archive. `samples` is the number of
 * bytes of its samples. */
static inline uint32_t archive_bytes(uint32_t samples) {
  return record_bytes(ARCHIVE_ABOUT_BYTES + ((samples + 15) & ~UINT32_C(15))) +
         ARCHIVE_CLEARED_BYTES;
}

typedef struct {
  const store_memory_t *memory; /* memory of the archive; NULL if no incident is archived */
  /* record of the newest complete incident. Its field `magic` is RECORD_NONE if there is no
   * incident, or if this incident was cleared */
  record_t record;
  record_t before; /* archived record of an earlier incident; it is used if `record` is damaged */
  uint32_t samples_crc; /* CRC-32 of the samples of the incident in `record` */
  uint32_t sequence;    /* highest sequence number of all records */
  uint32_t bytes;       /* size in bytes of the largest incident that can occur */
  /* address at which the next incident is written; ARCHIVE_NOWHERE if there is no room for it until
   * the next power-up */
  uint32_t begin;
  /* tick in which the archive last began to write an incident; valid only if `written` is 1 */
  uint32_t day_tick;
  uint32_t at;     /* address of the next bytes that are read or programmed */
  uint32_t crc;    /* CRC of the bytes of the record before the address `at` */
  uint8_t step;    /* next step of the work that archive_serve() does in small steps */
  uint8_t is_new;  /* 1 if the archive is checking the record that it has just written */
  uint8_t written; /* 1 if the field day_tick is valid */
  uint8_t clear;   /* 1 if the archive must still mark the incident in `record` as cleared */
} archive_t;

/* Value of the field `begin` if the memory has no room for another record. */
#define ARCHIVE_NOWHERE UINT32_MAX

/* Initialises the archive at power-up; this may erase a sector. `samples` is the largest size in
 * bytes of the samples of an incident. If the sectors of the memory are too small for these
 * samples, the memory is not used. Cost: the function reads the heads of all records. If a sector
 * is full, it also reads the other sector once. */
void archive_init(archive_t *archive, const store_memory_t *memory, uint32_t samples);

/* Does one bounded step of the archive: reads 64 bytes or programs 16 bytes. Call archive_serve()
 * between ticks. `complete` is true if blackbox->crc is complete. An incident is written only while
 * the axis is disabled. */
void archive_serve(archive_t *archive, blackbox_t *blackbox, bool complete, bool disabled,
                   uint32_t tick);

/* Returns the state of the archive (AXIS_INCIDENT_STORED_). */
uint8_t archive_state(const archive_t *archive);

bool archive_is_loading(const archive_t *archive);

/* Starts to load the archived incident into the black box. The channels of the black box must be
 * set before. A recording of the black box ends. When archive_is_loading() becomes false, the black
 * box contains the incident. Returns false if there is no incident of this object table, or if the
 * archive is working. */
bool archive_load(archive_t *archive, blackbox_t *blackbox);

/* Call archive_clear() when the incident in the black box was cleared. If the archive contains the
 * same incident, the archived incident is cleared too. */
void archive_clear(archive_t *archive, uint32_t samples_crc);

#endif
