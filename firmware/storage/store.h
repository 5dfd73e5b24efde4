#ifndef FIRMWARE_STORAGE_STORE_H_
#define FIRMWARE_STORAGE_STORE_H_

/* The parameter store keeps parameters over a power cut, in two sectors of a flash-like memory.
 *
 * A parameter set is one record (record.h) with an entry for each stored parameter, including the
 * parameters at their defaults. An entry has three words: the CANopen index times 256 plus
 * sub-index, with bit 24 set for a parameter at its default; the value; and the signature of the
 * object, which is a CRC-32 of its type, unit, scale, range and names of values. A COB-ID that
 * follows the node id is stored without the node id and continues to follow the node id.
 *
 * So a later object table can read the set. An entry is loaded if its object still has the same
 * address and signature; other entries are dropped, and their objects have their defaults. A
 * parameter at its default keeps the value of this default if the later table has another default:
 * an upgrade alone changes no axis. store_change_count and store_change_1 to _8 report both cases:
 * every entry of a set is either loaded as stored or counted there. A parameter without an entry in
 * the set is new and has its default.
 *
 * The set has values and not a CRC of the defaults, because an axis can keep an earlier default
 * only if its value is stored. With 12 bytes for each stored parameter a set has 2 KiB, and a
 * sector of 16 KiB has room for eight sets; 10,000 erases of such a sector are enough for 160,000
 * saves.
 *
 * Sets of version 0.1.0 have entries without signature, and only for parameters that were not at
 * their defaults. The object table lists the later changes (axis_changes_0_1_0).
 *
 * A power cut after any byte leaves the old set or the new set. A record is programmed from its
 * beginning to its CRC and never over other data, and the sector with the newest set is never
 * erased. A sector is erased completely before it is programmed. Only in the sector with the newest
 * set may programming continue, after the last byte that is not blank.
 *
 * A record is read back before the save is reported as done, and its CRC is checked at each load.
 * If programming fails, the store makes a second attempt in the other sector; if the second attempt
 * fails too, the old set stays stored.
 *
 * Two other records are kept beside the set, here called extra records (STORE_PARTS): the programs
 * of cycles and the numbers of pressed parts. They are valid only in the sector with the newest
 * set. When the store continues in the other sector, it writes the extra records there first and a
 * set last, so one record makes the whole sector valid. If only extra records have changed, this
 * set is a copy, and a mark at the end of the present sector says so: a power cut then does not
 * look like an interrupted save of parameters. The store continues in the other sector before the
 * present one is full, so that the numbers of the next power-up have room. The caller may abandon
 * this work at any time, because an axis that is enabled must not wait for it. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/dictionary.h"
#include "firmware/objects/generated/axis_objects.h"
#include "firmware/storage/entries.h"
#include "firmware/storage/record.h"

enum {
  STORE_SET_BYTES = RECORD_HEAD_BYTES + RECORD_CRC_BYTES + (int)ENTRY_BYTES * AXIS_STORED_COUNT,
  /* smallest sector in bytes: room for a parameter set and more parameters */
  STORE_SECTOR_MIN = 8192,
  STORE_CHANGES = 8 /* number of objects store_change_1 to _8, each of which reports one change */
};

/* Kinds of a store_change. STORE_CHANGE_DROPPED: the stored value is not active, because the entry
 * was dropped or because the object is a mapping that is no longer permitted.
 * AXIS_STORE_CHANGE_OLD_DEFAULT: the parameter keeps the default of an earlier object table. */
#define STORE_CHANGE_DROPPED UINT32_C(0)

/* The extra records that are kept beside the parameter set. */
enum { STORE_PROGRAMS = 0, STORE_COUNTS = 1, STORE_PARTS = 2, STORE_COUNTS_BYTES = 28 };

/* State of the extra records: all are stored; a write runs or waits; the last write failed. */
enum { STORE_PARTS_STORED = 0, STORE_PARTS_WRITING = 1, STORE_PARTS_FAILED = 2 };

/* Content of an extra record. The size in bytes is a multiple of 4. */
typedef struct {
  const uint8_t *bytes;
  uint32_t count;
} store_part_t;

typedef struct {
  const store_memory_t *memory; /* memory of the store; NULL if no parameter is stored */
  uint32_t home;     /* sector of the newest parameter set; STORE_NOWHERE without a set */
  uint32_t tail;     /* offset in bytes in the sector `home`, after which all bytes are blank */
  uint32_t sequence; /* highest sequence number of all records */
  uint32_t set;      /* address of the loaded parameter set; STORE_NOWHERE without a set */
  /* changes that the load of the parameter set found: address of the parameter plus
   * STORE_CHANGE_ */
  uint32_t changes[STORE_CHANGES];
  uint16_t change_count; /* number of all changes that the load of the parameter set found */
  uint8_t dropped;       /* 1 if at least one change is a STORE_CHANGE_DROPPED */
  store_part_t parts[STORE_PARTS]; /* present content of the extra records */
  uint32_t found[STORE_PARTS];     /* addresses of the bytes of each extra record that the last load
                                    * found, and the numbers of these bytes */
  uint32_t found_bytes[STORE_PARTS];
  uint8_t changed;      /* bits of the extra records whose present content is not stored */
  uint8_t parts_failed; /* 1 if the last write of an extra record failed */
  /* 1 if the other sector may be erased without a command, because it has no data that a user
   * needs */
  uint8_t may_move;
  /* Work in progress. */
  uint8_t step;
  uint8_t sector;
  uint8_t job;     /* kind of the present job: a command of the user, or a write of extra records */
  uint8_t item;    /* record that is being written */
  uint8_t items;   /* set of the records that this job writes, as bits */
  uint8_t again;   /* 1 during the second attempt to write the record */
  uint16_t object; /* number of the object whose entry is programmed next */
  /* first object of a range of objects, `first` to `last`, whose present values are saved */
  uint16_t first;
  uint16_t last;
  /* stored record that gives the values of all objects outside `first` to `last`, or the set that
   * is copied */
  record_t basis;
  uint32_t begin; /* address of the record that is being written */
  uint32_t at;    /* address of the next bytes */
  uint32_t crc;   /* CRC of the bytes of the record that were programmed so far */
  uint32_t check; /* CRC of the bytes of the record that were read back so far */
} store_t;

#define STORE_NOWHERE UINT32_MAX

void store_init(store_t *store, const store_memory_t *memory);

/* Reads the newest complete parameter set into the parameters of `objects`, which must have their
 * defaults. Work of the store in progress is abandoned as by a power cut. A set of this object
 * table is damaged if one of its entries does not match the table: the previous set is then used
 * instead. Returns AXIS_STORE_STATE_
 *   LOADED               every value is as stored;
 *   EMPTY                there is no set, or restore_defaults was commanded;
 *   LOADED_PARTLY        a set of another table, of which some entries are not active;
 *   LOADED_OLD_DEFAULTS  every value is as stored, but some are defaults of an earlier table;
 *   LOADED_OLDER         as one of these, but the memory also has bytes of a newer set (a save that
 *                        was interrupted, a damaged sector);
 *   OTHER_TABLE          the newest set has no signatures and is not of version 0.1.0: it is
 *                        ignored;
 *   FAILED               the memory is not blank, but has no valid set.
 * Cost: the function reads both sectors once and their blank parts twice; it reads each entry of
 * the set twice and finds the object by bisection. On a Cortex-M4, two full sectors of 16 KiB need
 * some 300,000 instructions more than blank sectors, and the complete power-up needs 1.2 million
 * instructions. */
uint8_t store_load(store_t *store, dictionary_t *objects);

/* Restores the stored values of one block of objects (AXIS_BLOCK_) from the parameter set that was
 * last loaded or saved. Returns false, without a change of the block, if this parameter set is
 * damaged. */
bool store_load_block(const store_t *store, dictionary_t *objects, uint8_t block);

/* store_save() starts to save the present parameters; store_forget() starts to erase the saved
 * parameters. Both return FW_OK, FW_ERROR_BUSY or FW_ERROR_NO_MEMORY. The parameters must not
 * change until the work of the store ends. */
int store_save(store_t *store);

/* Starts to save only the present values of the objects `first` to `last` (AXIS_OBJ_). All other
 * objects keep the values of the loaded parameter set, or their defaults if no set is loaded.
 * Returns FW_OK, FW_ERROR_BUSY, FW_ERROR_NO_MEMORY, or FW_ERROR_NO_DATA if the loaded set is
 * damaged. */
int store_save_only(store_t *store, uint16_t first, uint16_t last);
int store_forget(store_t *store);

/* Returns true while the parameter store executes a command: parameters must not change. */
bool store_is_busy(const store_t *store);

/* store_part_bytes() returns the size in bytes of the extra record `part` that the last
 * store_load() found, and store_part_read() copies these bytes. */
static inline uint32_t store_part_bytes(const store_t *store, uint8_t part) {
  return store->found_bytes[part];
}
void store_part_read(const store_t *store, uint8_t part, uint8_t *bytes);

/* Returns the largest number of bytes of the programs. */
uint32_t store_programs_max(const store_t *store);

/* Sets the present content of an extra record. Call this function only while the store is not busy;
 * a write of extra records in progress begins again. The bytes must not change until the next call
 * or store_abandon(). If `changed` is true, the store will write them. */
void store_part_set(store_t *store, uint8_t part, store_part_t bytes, bool changed);

/* Returns true if the present content of an extra record is stored. */
bool store_part_is_stored(const store_t *store, uint8_t part);

/* Returns whether the extra records are stored, STORE_PARTS_. */
uint8_t store_parts_state(const store_t *store);

/* Does the next step of a write of extra records, as store_tick() does for a command. Call this
 * function only while the store is not busy and the axis is disabled. */
void store_parts_tick(store_t *store, const dictionary_t *objects);

/* Abandons a write of extra records in progress. The next store_parts_tick() begins it again. */
void store_abandon(store_t *store);

/* Does one bounded step of the store: one erase, at most 16 bytes programmed, or 64 bytes read
 * back. Call store_tick() once in each tick. A save takes one tick for each stored parameter, some
 * 40 ticks more, and one tick for each 64 bytes of a sector that has to be erased; then also one
 * tick for each 16 bytes of programs. Returns
 * AXIS_STORE_STATE_SAVING, _SAVED, _RESTORED or _FAILED, or AXIS_STORE_STATE_COUNT without work. */
uint8_t store_tick(store_t *store, const dictionary_t *objects);

#endif
