#ifndef FIRMWARE_STORAGE_STORE_H_
#define FIRMWARE_STORAGE_STORE_H_

/* The parameter store: parameters kept over a power cut, in two sectors of a flash-like memory.
 *
 * A set is one record (record.h) with an entry for each stored parameter, also for those at their
 * defaults. An entry is three words: the CANopen index times 256 plus sub-index, with bit 24 set
 * for a parameter at its default; the value; and the signature of the object, a CRC-32 of its type,
 * unit, scale, range and names of values. A COB-ID that follows the node id is stored without it
 * and continues to follow it.
 *
 * So a set can be read under a later object table. Each entry whose object has the same address and
 * the same signature is taken over; the others are dropped, and those objects have their defaults.
 * A parameter at its default keeps the value of that default when the later table has another one:
 * an upgrade alone alters no axis. Both are reported in store_change_count and store_change_1
 * to _8: every entry of a set is either in force as stored or counted there. A parameter that the
 * set does not have is new, and at its default.
 *
 * Values are stored, not a CRC of the defaults: an axis can continue with an earlier default only
 * if it has that value. 12 bytes for each stored parameter are 2 KiB a set, eight sets to a sector
 * of 16 KiB; 10,000 erases of such a sector last for 160,000 saves.
 *
 * Sets of version 0.1.0 have entries without signature, and only for what differed from the
 * defaults. The table knows what has changed since (axis_changes_0_1_0).
 *
 * A cut after any byte leaves the old set or the new one, because a record is programmed from its
 * beginning to its CRC, never over anything, and the sector with the newest set is never erased. A
 * sector is erased completely before anything is put into it, except behind the newest set, and
 * there only behind the last byte that is not blank.
 *
 * A record is read back before it counts as saved, and its CRC is checked each time that it is
 * loaded. What cannot be programmed is tried once more in the other sector; that one failing as
 * well leaves the old set. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/dictionary.h"
#include "firmware/storage/entries.h"
#include "firmware/storage/record.h"

enum {
  STORE_SET_BYTES = RECORD_HEAD_BYTES + RECORD_CRC_BYTES + (int)ENTRY_BYTES * AXIS_STORED_COUNT,
  STORE_SECTOR_MIN = 8192, /* holds a set, with room for more parameters */
  STORE_CHANGES = 8        /* that are reported by address */
};

/* A store_change: the stored value is not in force (dropped; or a mapping that is no longer
 * permitted, whose PDO carries nothing), or an earlier default was kept. */
#define STORE_CHANGE_DROPPED UINT32_C(0)
#define STORE_CHANGE_OLD_DEFAULT UINT32_C(0x01000000)

typedef struct {
  const store_memory_t *memory;    /* NULL: nothing is stored */
  uint32_t home;                   /* sector of the newest set, STORE_NOWHERE without one */
  uint32_t tail;                   /* there: behind it everything is blank */
  uint32_t sequence;               /* the highest one used */
  uint32_t set;                    /* address of the set that is in force, or STORE_NOWHERE */
  uint32_t changes[STORE_CHANGES]; /* of the set when it was loaded: address and STORE_CHANGE_ */
  uint16_t change_count;           /* all of them */
  uint8_t dropped;                 /* 1: one of them is STORE_CHANGE_DROPPED */
  /* Work in progress. */
  uint8_t step;
  uint8_t sector;
  uint8_t forget;  /* the record is without entries */
  uint8_t again;   /* this is the second attempt */
  uint16_t object; /* the next one to be programmed */
  uint16_t first;  /* of the objects whose present values are saved */
  uint16_t last;
  record_t basis; /* the others have their values from it */
  uint32_t begin; /* address of the record */
  uint32_t at;    /* address of the next piece */
  uint32_t crc;   /* of what was programmed */
  uint32_t check; /* of what is read back */
} store_t;

#define STORE_NOWHERE UINT32_MAX

void store_init(store_t *store, const store_memory_t *memory);

/* Reads the newest whole set into the parameters of objects, which are at their defaults; work in
 * progress is abandoned, as by a cut. A set of this very table that has an entry which does not fit
 * is damaged: the set before it counts, whole. Returns AXIS_STORE_STATE_
 *   LOADED               every value as stored;
 *   EMPTY                nothing there, or restore_defaults;
 *   LOADED_PARTLY        a set of another table, of which something is not in force;
 *   LOADED_OLD_DEFAULTS  every value as stored, but not every default is today's;
 *   LOADED_OLDER         as one of these, but there are remains of a newer set (a save that was
 *                        cut off, a damaged sector);
 *   OTHER_TABLE          the newest set does not describe itself and is not of version 0.1.0; it is
 *                        ignored;
 *   FAILED               something is there, but no set that fits.
 * Cost: reads both sectors once, and what is blank of them twice; of the set in force each entry
 * twice, and finds its object by bisection. On a Cortex-M4 with two sectors of 16 KiB that are full
 * of sets some 300,000 instructions more than with blank ones, 1.2 million for the whole power-up.
 */
uint8_t store_load(store_t *store, dictionary_t *objects);

/* Restores the stored values of one block (AXIS_BLOCK_) from the set that was loaded or saved last.
 * False: that set is damaged by now, and the block is unchanged. */
bool store_load_block(const store_t *store, dictionary_t *objects, uint8_t block);

/* Starts to save the present parameters, or to erase the saved ones: FW_OK, FW_ERROR_BUSY, or
 * FW_ERROR_NO_MEMORY. Until the end the parameters must not change. */
int store_save(store_t *store);

/* The same for the objects `first` to `last` alone (AXIS_OBJ_); the others keep the values that
 * they have in the set in force, without one their defaults. FW_ERROR_NO_DATA: that set is damaged
 * by now. */
int store_save_only(store_t *store, uint16_t first, uint16_t last);
int store_forget(store_t *store);

/* Whether work is in progress. */
static inline bool store_is_busy(const store_t *store) { return store->step != 0; }

/* Once a tick, one bounded step: an erase, at most 16 bytes programmed or 64 bytes read back; a
 * save takes one tick for each stored parameter and some 40 others, and 1 for each 64 bytes of a
 * sector that has to be erased. Returns AXIS_STORE_STATE_SAVING, _SAVED, _RESTORED or _FAILED, or
 * AXIS_STORE_STATE_COUNT when there was nothing to do. */
uint8_t store_tick(store_t *store, const dictionary_t *objects);

#endif
