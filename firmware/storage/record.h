#ifndef FIRMWARE_STORAGE_RECORD_H_
#define FIRMWARE_STORAGE_RECORD_H_

/* Records in a flash-like memory of two sectors: the addresses and the integrity of the records.
 * The parameter store and the archive interpret the entries of a record.
 *
 * A record has a head (magic, hash of an object table, sequence number, size of the entries in
 * bytes), the entries, and the CRC-32 of head and entries. Words are little-endian. Only a record
 * with a correct CRC is used. The record with the highest sequence number is the newest.
 *
 * Parameter sets are searched word by word, because a set whose writing was interrupted has no
 * valid end. Any other record occupies the space that its head announces, also if its writing was
 * interrupted, because its bytes come from a user and could look like a parameter set.
 *
 * Records begin at multiples of 16. The first word of a parameter set is programmed after the three
 * words behind it. So a single word that is not blank, at a multiple of 16, is the begin of another
 * record whose writing was interrupted, and no sign of a missing parameter set. */

#include <stdbool.h>
#include <stdint.h>

/* Memory of a board: two sectors, one after the other, whose erased bytes read 0xFF. Addresses and
 * byte counts of program() are multiples of 4, and program() is called only for blank bytes;
 * program() returns when the bytes are programmed. A function returns false if the memory reports a
 * failure. The caller finds other failures by reading the bytes back. */
typedef struct {
  void *context;
  /* size of a sector in bytes: a multiple of 16, at least STORE_SECTOR_MIN */
  uint32_t sector_bytes;
  void (*read)(void *context, uint32_t address, uint8_t *bytes, uint32_t count);
  bool (*program)(void *context, uint32_t address, const uint8_t *bytes, uint32_t count);
  bool (*erase)(void *context, uint8_t sector);
} store_memory_t;

enum { RECORD_HEAD_BYTES = 16, RECORD_CRC_BYTES = 4 };

/* First word of a record, which states the kind of the record. */
#define RECORD_SET_0_1_0 UINT32_C(0x31534146) /* "FAS1" marks a parameter set of version 0.1.0 */
#define RECORD_SET UINT32_C(0x32534146)       /* "FAS2" marks a parameter set */
#define RECORD_FORGOTTEN UINT32_C(0x31464146) /* "FAF1" marks that all defaults are restored */
#define RECORD_INCIDENT UINT32_C(0x31494146)  /* "FAI1" marks an incident (archive.h) */
#define RECORD_PROGRAMS UINT32_C(0x31504146)  /* "FAP1" marks the programs of cycles */
#define RECORD_COUNTS UINT32_C(0x314E4146)    /* "FAN1" marks the counts of parts */
/* "FAC1" marks that a sector is written as a copy of the other one: at the begin of the first one
 * that is written, and as RECORD_MARK at the end of the sector that is copied */
#define RECORD_COPY UINT32_C(0x31434146)
#define RECORD_NONE UINT32_C(0)

typedef struct {
  uint32_t begin; /* address of the head */
  uint32_t magic; /* RECORD_ */
  uint32_t hash;
  uint32_t sequence;
  uint32_t entries; /* total size of all entries in bytes; a multiple of record_entry_bytes() */
} record_t;

/* Returns the size in bytes of one entry of a record. An entry has an address, a value and, in a
 * RECORD_SET, a signature. */
uint32_t record_entry_bytes(uint32_t magic);

/* Returns the size of a record in bytes from the size of its entries in bytes. */
static inline uint32_t record_bytes(uint32_t entries) {
  return RECORD_HEAD_BYTES + entries + RECORD_CRC_BYTES;
}

/* Returns the 32-bit word at an address of the memory. */
uint32_t record_word(const store_memory_t *memory, uint32_t at);

/* Continue a CRC-32 over `count` bytes, or over a range of the memory whose length is a multiple of
 * 4. The first call begins with the CRC UINT32_MAX. A record stores the bitwise complement of the
 * last result. */
uint32_t record_crc(uint32_t crc, const uint8_t *bytes, uint32_t count);
uint32_t record_crc_of_memory(const store_memory_t *memory, uint32_t crc, uint32_t at,
                              uint32_t end);

/* Offset in bytes, from the end of a sector, of the mark that the sector is being copied: a
 * RECORD_COPY and a word that is blank as long as the mark is valid. */
enum { RECORD_MARK = 32, RECORD_MARK_END = RECORD_MARK - RECORD_HEAD_BYTES - RECORD_CRC_BYTES };

/* Returns the space in bytes that a record occupies. */
static inline uint32_t record_space(uint32_t entries) {
  return (record_bytes(entries) + 15) & ~UINT32_C(15);
}

/* Returns true if the mark at the end of a sector is valid. */
bool record_is_copied(const store_memory_t *memory, uint32_t sector);

/* Reads the record at an address, in a sector that ends at `end`. Returns true if this record is
 * complete. */
bool record_read(const store_memory_t *memory, uint32_t at, uint32_t end, record_t *record);

/* Contents of a sector. A record that does not exist has the magic RECORD_NONE. */
typedef struct {
  record_t programs; /* newest complete record of each kind */
  record_t counts;
  /* offset in bytes, from the start of the sector, after all records and all bytes that are not
   * blank */
  uint32_t tail;
  uint8_t has_set;   /* 1 if there is a complete parameter set */
  uint8_t is_copy;   /* 1 if the sector begins with a RECORD_COPY, which may be interrupted */
  uint8_t is_copied; /* 1 if the mark at the end of the sector, which announces a copy, is valid */
  /* 1 if bytes that are not blank, after the last complete parameter set, belong to no record: the
   * writing of a set was interrupted */
  uint8_t has_remains;
} record_sector_t;

/* Reads both sectors once. `sets` receives the two newest complete parameter sets of both sectors,
 * the newest first. Returns the highest sequence number of all complete records. */
uint32_t record_survey(const store_memory_t *memory, record_sector_t sectors[2], record_t sets[2]);

/* Returns the offset in bytes, from the start of the sector, after the last word that is not
 * blank. */
uint32_t record_tail(const store_memory_t *memory, uint32_t sector);

#endif
