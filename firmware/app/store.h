#ifndef FIRMWARE_APP_STORE_H_
#define FIRMWARE_APP_STORE_H_

/* The parameter store: what is kept over a power cut, in two sectors of a flash-like memory.
 *
 * A set is one record: head, then address and value of each stored parameter that differs from its
 * default, then a CRC over both. So a set describes itself, and the COB-IDs that follow the node id
 * go on following it. Records are appended; one counts only if its CRC is right, and of those the
 * one with the highest sequence number.
 *
 * Why a cut after any byte leaves the old set or the new one: a record is programmed from its
 * beginning to its CRC, never over anything, and the sector with the newest set is never erased. A
 * sector is erased completely before anything is put into it, except behind the newest set, and
 * there only behind the last byte that is not blank.
 *
 * A record is read back before it counts as saved. What cannot be programmed is tried once more in
 * the other sector; that one failing as well leaves the old set. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/dictionary.h"

/* Memory of the port: two sectors, one after the other, whose erased bytes read 0xFF. Addresses and
 * counts of program() are multiples of 4, and it is only asked to program blank bytes; it returns
 * when they are in. Calls return false when the memory says so. */
typedef struct {
  void *context;
  uint32_t sector_bytes; /* a multiple of 16, at least STORE_SECTOR_MIN */
  void (*read)(void *context, uint32_t address, uint8_t *bytes, uint32_t count);
  bool (*program)(void *context, uint32_t address, const uint8_t *bytes, uint32_t count);
  bool (*erase)(void *context, uint8_t sector);
} store_memory_t;

enum {
  STORE_HEAD_BYTES = 16,  /* magic, hash of the object table, sequence number, bytes of entries */
  STORE_ENTRY_BYTES = 8,  /* CANopen index times 256 plus sub-index, value */
  STORE_CRC_BYTES = 4,    /* CRC-32 of head and entries */
  STORE_SECTOR_MIN = 2560 /* holds a set in which every stored parameter differs */
};

typedef struct {
  const store_memory_t *memory; /* NULL: nothing is kept */
  uint32_t home;                /* sector of the newest set, STORE_NOWHERE without one */
  uint32_t tail;                /* there: behind it everything is blank */
  uint32_t sequence;            /* the highest one used */
  uint32_t set;                 /* address of the set that is in force, or STORE_NOWHERE */
  /* Work in progress. */
  uint32_t begin;   /* address of the record */
  uint32_t at;      /* address of the next piece */
  uint32_t entries; /* bytes of them */
  uint32_t crc;     /* of what was programmed */
  uint32_t check;   /* of what is read back */
  uint16_t object;  /* the next one to be looked at */
  uint8_t step;
  uint8_t sector;
  uint8_t forget; /* the record is without entries */
  uint8_t again;  /* this is the second attempt */
} store_t;

#define STORE_NOWHERE UINT32_MAX

void store_init(store_t *store, const store_memory_t *memory);

/* Reads the newest whole set into the parameters of objects, which are at their defaults; work in
 * progress is given up, as by a cut. If it has a value that is out of range the set before it
 * counts, whole. Returns AXIS_STORE_STATE_LOADED; _EMPTY (also after restore_defaults);
 * _LOADED_OLDER: as those two, but there is something that looks like what is left of a newer set
 * (a save that was cut off, a damaged sector); _OTHER_TABLE: the newest set is of another object
 * table and left alone; _FAILED: something is there, but no set that fits. Cost: reads both sectors
 * once, and what is blank of them twice. */
uint8_t store_load(store_t *store, dictionary_t *objects);

/* Gives one block (AXIS_BLOCK_) its stored values again, from the set that store_load() took or was
 * saved since. */
void store_load_block(const store_t *store, dictionary_t *objects, uint8_t block);

/* Starts to keep the present parameters, or to forget them: FW_OK, FW_ERROR_BUSY, or
 * FW_ERROR_STATE without a memory. Until the end the parameters must not change. */
int store_save(store_t *store, const dictionary_t *objects);
int store_forget(store_t *store);

/* Whether work is in progress. */
static inline bool store_is_busy(const store_t *store) { return store->step != 0; }

/* Once a tick, one bounded step: an erase, 16 bytes programmed or 64 bytes read back. Returns
 * AXIS_STORE_STATE_SAVING, _SAVED, _RESTORED or _FAILED, or AXIS_STORE_STATE_COUNT when there was
 * nothing to do. */
uint8_t store_tick(store_t *store, const dictionary_t *objects);

#endif
