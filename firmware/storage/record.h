#ifndef FIRMWARE_STORAGE_RECORD_H_
#define FIRMWARE_STORAGE_RECORD_H_

/* Records in a flash-like memory of two sectors. These functions find records and check that they
 * are complete. The parameter store and the archive interpret the entries of a record.
 *
 * A record has a head (magic, hash of an object table, sequence number, size of the entries in
 * bytes), the entries, and the CRC-32 of head and entries. Words are little-endian. Only a record
 * with a correct CRC is used. The record with the highest sequence number is the newest.
 *
 * Parameter sets are searched word by word, because a parameter set whose writing was interrupted
 * has no valid end. Any other record occupies the space that its head announces, even if its
 * writing was interrupted. These bytes are not searched, because they come from a user and could
 * look like a parameter set.
 *
 * Records begin at multiples of 16. The first word of a parameter set is programmed after the three
 * words that follow it. So if a single word at a multiple of 16 is not blank, it is the begin of
 * another record whose writing was interrupted. It does not show that a parameter set is
 * missing. */

#include <stdbool.h>
#include <stdint.h>

/* A flash-like memory of a board. It has two sectors, one after the other, and erased bytes read as
 * 0xFF. The addresses and byte counts of program() are multiples of 4. program() is called only for
 * blank bytes, and returns when the bytes are programmed. A function returns false if the memory
 * reports a failure. The caller detects other failures, because it reads the bytes back. */
typedef struct {
  void *context;
  /* size of a sector in bytes: a multiple of 16, at least STORE_SECTOR_MIN */
  uint32_t sector_bytes;
  void (*read)(void *context, uint32_t address, uint8_t *bytes, uint32_t count);
  bool (*program)(void *context, uint32_t address, const uint8_t *bytes, uint32_t count);
  bool (*erase)(void *context, uint8_t sector);
} store_memory_t;

enum { RECORD_HEAD_BYTES = 16, RECORD_CRC_BYTES = 4 };

/* Magics of records. The magic is the first word of a record and states the kind of the record. */
#define RECORD_SET_0_1_0 UINT32_C(0x31534146) /* "FAS1" marks a parameter set of version 0.1.0 */
#define RECORD_SET UINT32_C(0x32534146)       /* "FAS2" marks a parameter set */
#define RECORD_FORGOTTEN UINT32_C(0x31464146) /* "FAF1" marks that all defaults are restored */
#define RECORD_INCIDENT UINT32_C(0x31494146)  /* "FAI1" marks an incident (archive.h) */
#define RECORD_PROGRAMS UINT32_C(0x31504146)  /* "FAP1" marks the library of cycle programs */
#define RECORD_COUNTS UINT32_C(0x314E4146)    /* "FAN1" marks the counts of pressed parts */
/* "FAC1" marks that one sector is written as a copy of the other sector. It is at the begin of the
 * sector that is written, and also, at RECORD_MARK, at the end of the sector that is copied */
#define RECORD_COPY UINT32_C(0x31434146)
#define RECORD_NONE UINT32_C(0)

typedef struct {
  uint32_t begin; /* address in the memory at which the record begins */
  uint32_t magic; /* kind of the record, RECORD_ */
  uint32_t hash;
  uint32_t sequence;
  /* total size in bytes of all entries of the record; a multiple of record_entry_bytes() */
  uint32_t entries;
} record_t;

/* Returns the size in bytes of one entry of a record. An entry has an address and a value. In a
 * RECORD_SET it also has a signature. */
uint32_t record_entry_bytes(uint32_t magic);

/* Returns the size of a record in bytes. `entries` is the size of its entries in bytes. */
static inline uint32_t record_bytes(uint32_t entries) {
  return RECORD_HEAD_BYTES + entries + RECORD_CRC_BYTES;
}

/* Returns the 32-bit word at an address of the memory. */
uint32_t record_word(const store_memory_t *memory, uint32_t at);

/* record_crc() continues a CRC-32 over `count` bytes. record_crc_of_memory() continues a CRC-32
 * over a range of the memory whose length is a multiple of 4. The first call begins with the CRC
 * UINT32_MAX. A record stores the bitwise complement of the last result. */
uint32_t record_crc(uint32_t crc, const uint8_t *bytes, uint32_t count);
uint32_t record_crc_of_memory(const store_memory_t *memory, uint32_t crc, uint32_t at,
                              uint32_t end);

/* Offsets in bytes from the end of a sector. RECORD_MARK: offset of the record RECORD_COPY that
 * marks the sector while it is being copied. RECORD_MARK_END: offset of a word that is blank as
 * long as this mark is valid. */
enum { RECORD_MARK = 32, RECORD_MARK_END = RECORD_MARK - RECORD_HEAD_BYTES - RECORD_CRC_BYTES };

/* Returns the number of bytes that a record occupies, filled to a multiple of 16. */
static inline uint32_t record_space(uint32_t entries) {
  return (record_bytes(entries) + 15) & ~UINT32_C(15);
}

/* Returns true if the end of the sector has a valid mark, which means that the sector was being
 * copied. */
bool record_is_copied(const store_memory_t *memory, uint32_t sector);

/* Reads the record at an address, in a sector that ends at `end`. Returns true if this record is
 * complete. */
bool record_read(const store_memory_t *memory, uint32_t at, uint32_t end, record_t *record);

/* Contents of a sector. If a record does not exist, its field `magic` is RECORD_NONE. */
typedef struct {
  /* newest complete record with cycle programs; `counts`: newest complete record with counts of
   * pressed parts */
  record_t programs;
  record_t counts;
  /* offset in bytes from the start of the sector. From this offset on, the sector has no records,
   * and all its bytes are blank */
  uint32_t tail;
  uint8_t has_set; /* 1 if the sector has a complete parameter set */
  /* 1 if the sector begins with the record RECORD_COPY; the writing of this record may have been
   * interrupted */
  uint8_t is_copy;
  /* 1 if the end of the sector has a valid mark that announces a copy of the sector */
  uint8_t is_copied;
  /* 1 if the writing of a parameter set was interrupted: bytes after the last complete set are not
   * blank and belong to no record */
  uint8_t has_remains;
} record_sector_t;

/* Reads both sectors once and describes their contents in `sectors`. `sets` receives the two newest
 * complete parameter sets of the memory; the newest set is first. Returns the highest sequence
 * number of all complete records. */
uint32_t record_survey(const store_memory_t *memory, record_sector_t sectors[2], record_t sets[2]);

/* Finds the last word of a sector that is not blank. Returns the offset of the end of this word, in
 * bytes from the start of the sector. */
uint32_t record_tail(const store_memory_t *memory, uint32_t sector);

#endif
