#ifndef FIRMWARE_STORAGE_STORE_H_
#define FIRMWARE_STORAGE_STORE_H_

/* The parameter store. It keeps parameters over a power cut in two sectors of a flash-like memory.
 *
 * A parameter set is one record (record.h) with an entry for each stored parameter. Parameters at
 * their defaults also have an entry. An entry has three words. The first word is the CANopen index
 * times 256 plus the sub-index; its bit 24 is 1 if the parameter is at its default. The second word
 * is the value. The third word is the signature of the object, which is a CRC-32 of the type, unit,
 * scale, range and names of values of the object. A COB-ID that contains the node id is stored
 * without the node id, so it also follows a later change of the node id.
 *
 * So a firmware with a later object table can read the set. An entry is loaded if its object still
 * has the same address and signature. All other entries are dropped, and their objects have their
 * defaults. If a parameter was stored at its default and the later table has another default, the
 * parameter keeps the earlier default. So an upgrade alone does not change the behaviour of an
 * axis. store_change_count and store_change_1 to _8 report both cases: every entry of a set is
 * either loaded as stored or counted there. A parameter without an entry in the set is new and has
 * its default.
 *
 * The set also contains the values of parameters at their defaults, because an axis can keep an
 * earlier default only if its value is stored. Each stored parameter needs 12 bytes. A set has 2
 * KiB, and a sector of 16 KiB has room for eight sets. Then 10,000 erases of each sector are enough
 * for 160,000 saves.
 *
 * Parameter sets of version 0.1.0 have entries without a signature, and only for parameters that
 * were not at their defaults. The object table lists the later changes (axis_changes_0_1_0).
 *
 * After a power cut at any byte, either the old set or the new set is complete. A record is
 * programmed from its begin to its CRC, and never over other data. The sector with the newest set
 * is never erased. Every other sector is erased completely before it is programmed. In the sector
 * with the newest set, programming continues after the last byte that is not blank.
 *
 * A record is read back before the save is reported as done, and its CRC is checked at each load.
 * If programming fails, the store makes a second attempt in the other sector; if the second attempt
 * fails too, the old set stays stored.
 *
 * The store also keeps two extra records (STORE_PARTS): the cycle programs and the counts of
 * pressed parts. They are valid only in the sector with the newest set. When the store continues in
 * the other sector, it writes the extra records there first and a parameter set last. So this last
 * record makes the whole sector valid. If only extra records have changed, the set in the other
 * sector is a copy. Before the copy, a mark is written at the end of the present sector, so that a
 * power cut does not look like an interrupted save of parameters. The store continues in the other
 * sector before the present sector is full, so that there is room for the counts of the next
 * power-up. The caller may abandon the writing of extra records at any time, because an enabled
 * axis must not wait for it. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/dictionary.h"
#include "firmware/objects/generated/axis_objects.h"
#include "firmware/storage/entries.h"
#include "firmware/storage/record.h"

enum {
  STORE_SET_BYTES = RECORD_HEAD_BYTES + RECORD_CRC_BYTES + (int)ENTRY_BYTES * AXIS_STORED_COUNT,
  /* smallest size of a sector in bytes, with room for a parameter set that also contains parameters
   * of later versions */
  STORE_SECTOR_MIN = 8192,
  /* number of objects store_change_1 to _8; each of these objects reports one change */
  STORE_CHANGES = 8
};

/* Kinds of changes that an object store_change_ reports. STORE_CHANGE_DROPPED: the stored value is
 * not active, because the entry was dropped, or because the object is a PDO mapping that is no
 * longer permitted. AXIS_STORE_CHANGE_OLD_DEFAULT: the parameter keeps the default of an earlier
 * object table. */
#define STORE_CHANGE_DROPPED UINT32_C(0)

/* The extra records that the store keeps in addition to the parameter set. STORE_PROGRAMS,
 * STORE_COUNTS: numbers of these records. STORE_PARTS: number of extra records. STORE_COUNTS_BYTES:
 * size of the counts in bytes. */
enum { STORE_PROGRAMS = 0, STORE_COUNTS = 1, STORE_PARTS = 2, STORE_COUNTS_BYTES = 28 };

/* State of the extra records (cycle programs, counts of parts). STORED: all extra records are
 * stored. WRITING: an extra record is being written or must be written. FAILED: the last write of
 * an extra record has failed. */
enum { STORE_PARTS_STORED = 0, STORE_PARTS_WRITING = 1, STORE_PARTS_FAILED = 2 };

/* Contents of an extra record: the cycle programs or the counts of parts. The size in bytes is a
 * multiple of 4. */
typedef struct {
  const uint8_t *bytes;
  uint32_t count;
} store_part_t;

typedef struct {
  const store_memory_t *memory; /* memory of the store; NULL if no parameter is stored */
  /* number of the present sector, which contains the newest parameter set; STORE_NOWHERE: there is
   * no set */
  uint32_t home;
  /* offset in bytes in the present sector; from this offset on all bytes are blank */
  uint32_t tail;
  uint32_t sequence; /* highest sequence number of all records */
  uint32_t set;      /* address of the loaded parameter set; STORE_NOWHERE: no set is loaded */
  /* first changes that were found when the parameter set was loaded. Each value is the address of
   * the parameter plus the kind of the change */
  uint32_t changes[STORE_CHANGES];
  /* number of all changes that were found when the parameter set was loaded */
  uint16_t change_count;
  uint8_t dropped; /* 1 if at least one stored value was dropped (STORE_CHANGE_DROPPED) */
  /* present contents of the extra records (cycle programs, counts of parts) */
  store_part_t parts[STORE_PARTS];
  /* for each extra record, address at which the last load has found its bytes; `found_bytes`:
   * number of these bytes */
  uint32_t found[STORE_PARTS];
  uint32_t found_bytes[STORE_PARTS];
  /* set, as bits, of the extra records (cycle programs, counts of parts) to be written */
  uint8_t changed;
  uint8_t parts_failed; /* 1 if the last write of cycle programs or of counts of parts failed */
  /* 1 if the store may erase its other sector without a command, because this sector contains no
   * data that a user needs */
  uint8_t may_move;
  /* The following fields describe the work of the parameter store in progress. `step`: next step of
   * this work. */
  uint8_t step;
  uint8_t sector;
  /* kind of the present job of the parameter store: a command of the user, or a write of extra
   * records */
  uint8_t job;
  uint8_t item; /* number of the record that the present job is writing */
  /* set, as bits, of the records that the present job of the parameter store writes */
  uint8_t items;
  uint8_t again;   /* 1 during the second attempt to write the same record, in the other sector */
  uint16_t object; /* number of the object whose entry is programmed next */
  /* first object whose present value is saved; `last`: last object whose present value is saved */
  uint16_t first;
  uint16_t last;
  /* record with the stored values of the objects outside the range `first` to `last`. In a copy it
   * is the parameter set that is copied */
  record_t basis;
  uint32_t begin; /* address of the record that is being written */
  uint32_t at;    /* address of the next bytes that are programmed or read back */
  uint32_t crc;   /* CRC of the bytes of the record that were programmed so far */
  uint32_t check; /* CRC of the bytes of the record that were read back so far */
} store_t;

#define STORE_NOWHERE UINT32_MAX

void store_init(store_t *store, const store_memory_t *memory);

/* Loads the newest complete parameter set into the parameters of `objects`. The parameters must
 * have their defaults before. If the store is working, its work is abandoned, as by a power cut. If
 * a set belongs to the present object table but one of its entries does not match the table, the
 * set is damaged, and the previous set is used instead. Returns AXIS_STORE_STATE_
 *   LOADED               every value is as stored
 *   EMPTY                there is no set, or restore_defaults was commanded
 *   LOADED_PARTLY        the set belongs to another object table, and some of its entries are not
 *                        active
 *   LOADED_OLD_DEFAULTS  every value is as stored, but some values are defaults of an earlier
 *                        object table
 *   LOADED_OLDER         the loaded set is one of the above, but the memory also has bytes of a
 *                        newer set, for example after an interrupted save
 *   OTHER_TABLE          the newest set has no signatures and is not of version 0.1.0, so it is
 *                        ignored
 *   FAILED               the memory is not blank, but has no valid set
 * Cost: the function reads both sectors once, their blank parts twice, and each entry of the set
 * twice. It finds the object of an entry by bisection. On a Cortex-M4, two full sectors of 16 KiB
 * need some 300,000 instructions more than two blank sectors. The complete power-up then needs 1.2
 * million instructions. */
uint8_t store_load(store_t *store, dictionary_t *objects);

/* Restores the values of one block of objects (AXIS_BLOCK_) from the parameter set that was last
 * loaded or saved. If this set is damaged, changes no object and returns false. */
bool store_load_block(const store_t *store, dictionary_t *objects, uint8_t block);

/* store_save() starts to save the present parameters; store_forget() starts to erase the saved
 * parameters. Both return FW_OK, FW_ERROR_BUSY or FW_ERROR_NO_MEMORY. The parameters must not
 * change until the store has ended this work. */
int store_save(store_t *store);

/* Starts to save only the present values of the objects `first` to `last` (AXIS_OBJ_). All other
 * objects keep the values of the loaded parameter set, or their defaults if no set is loaded.
 * Returns FW_OK, FW_ERROR_BUSY, FW_ERROR_NO_MEMORY, or FW_ERROR_NO_DATA if the loaded set is
 * damaged. */
int store_save_only(store_t *store, uint16_t first, uint16_t last);
int store_forget(store_t *store);

/* Returns true while the parameter store executes a command. Parameters must not change during this
 * time. */
bool store_is_busy(const store_t *store);

/* store_part_bytes() returns the size in bytes of the extra record `part` that the last
 * store_load() found, and store_part_read() copies these bytes. */
static inline uint32_t store_part_bytes(const store_t *store, uint8_t part) {
  return store->found_bytes[part];
}
void store_part_read(const store_t *store, uint8_t part, uint8_t *bytes);

/* Returns the largest number of bytes that the extra record with the cycle programs may have. */
uint32_t store_programs_max(const store_t *store);

/* Sets the present contents of an extra record: the cycle programs or the counts of parts. Call
 * this function only while the store is not busy. If a write of extra records is in progress, it
 * begins again. The bytes must not change until the next call of this function or of
 * store_abandon(). If `changed` is true, the store will write the bytes. */
void store_part_set(store_t *store, uint8_t part, store_part_t bytes, bool changed);

/* Returns true if the flash memory has the present contents of the extra record `part`, which are
 * cycle programs or counts of parts. */
bool store_part_is_stored(const store_t *store, uint8_t part);

/* Returns the state of the extra records (cycle programs, counts of parts), STORE_PARTS_. */
uint8_t store_parts_state(const store_t *store);

/* Does the next step of a write of extra records (cycle programs, counts of parts), in the same way
 * as store_tick() does a step of a command. Call this function only while the store is not busy and
 * the axis is disabled. */
void store_parts_tick(store_t *store, const dictionary_t *objects);

/* Abandons a write of extra records (cycle programs, counts of parts) that is in progress. The next
 * store_parts_tick() begins this write again. */
void store_abandon(store_t *store);

/* Does one bounded step of the store: one erase, at most 16 bytes programmed, or 64 bytes read
 * back. Call store_tick() once in each tick. A save takes one tick for each stored parameter, and
 * some 40 ticks more. If a sector must be erased, it also takes one tick for each 64 bytes of the
 * sector and one tick for each 16 bytes of cycle programs. Returns AXIS_STORE_STATE_SAVING, _SAVED,
 * _RESTORED or _FAILED, or AXIS_STORE_STATE_COUNT if there is no work. */
uint8_t store_tick(store_t *store, const dictionary_t *objects);

#endif
