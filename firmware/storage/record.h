#ifndef FIRMWARE_STORAGE_RECORD_H_
#define FIRMWARE_STORAGE_RECORD_H_

/* Records in a flash-like memory of two sectors: their addresses and their integrity. The store
 * interprets their entries.
 *
 * A record is a head (magic, hash of an object table, sequence number, bytes of entries), the
 * entries, and the CRC-32 of both; words are little-endian. Only a record with a correct CRC is
 * used, and the highest sequence number is the newest. */

#include <stdbool.h>
#include <stdint.h>

/* Memory of the port: two sectors, one after the other, whose erased bytes read 0xFF. Addresses and
 * byte counts of program() are multiples of 4, and only blank bytes are programmed; program()
 * returns when the bytes are programmed. A function returns false if the memory reports a failure;
 * the caller finds other failures by reading the bytes back. */
typedef struct {
  void *context;
  uint32_t sector_bytes; /* a multiple of 16, at least STORE_SECTOR_MIN */
  void (*read)(void *context, uint32_t address, uint8_t *bytes, uint32_t count);
  bool (*program)(void *context, uint32_t address, const uint8_t *bytes, uint32_t count);
  bool (*erase)(void *context, uint8_t sector);
} store_memory_t;

enum { RECORD_HEAD_BYTES = 16, RECORD_CRC_BYTES = 4 };

/* First word of a record. */
#define RECORD_SET_0_1_0 UINT32_C(0x31534146) /* "FAS1": a set written by version 0.1.0 */
#define RECORD_SET UINT32_C(0x32534146)       /* "FAS2": a set */
#define RECORD_FORGOTTEN UINT32_C(0x31464146) /* "FAF1": all defaults, no entries */
#define RECORD_INCIDENT UINT32_C(0x31494146)  /* "FAI1": an incident, see archive.h */
#define RECORD_NONE UINT32_C(0)

typedef struct {
  uint32_t begin; /* address of the head */
  uint32_t magic; /* RECORD_ */
  uint32_t hash;
  uint32_t sequence;
  uint32_t entries; /* bytes of all entries, a multiple of record_entry_bytes() */
} record_t;

/* Returns the number of bytes of one entry of a record: address, value and, in a RECORD_SET,
 * signature. */
uint32_t record_entry_bytes(uint32_t magic);

/* Returns the number of bytes of a record from the bytes of its entries. */
static inline uint32_t record_bytes(uint32_t entries) {
  return RECORD_HEAD_BYTES + entries + RECORD_CRC_BYTES;
}

/* Returns the 32-bit word at an address. */
uint32_t record_word(const store_memory_t *memory, uint32_t at);

/* Continue a CRC-32 over bytes, or over a part of the memory whose length is a multiple of 4. Begin
 * with UINT32_MAX; a record stores the complement of the result. */
uint32_t record_crc(uint32_t crc, const uint8_t *bytes, uint32_t count);
uint32_t record_crc_of_memory(const store_memory_t *memory, uint32_t crc, uint32_t at,
                              uint32_t end);

/* Whether a complete record begins at an address, in a sector that ends at `end`. */
bool record_read(const store_memory_t *memory, uint32_t at, uint32_t end, record_t *record);

/* Finds the two newest complete records, newest first; a missing record has the magic RECORD_NONE.
 * Reads both sectors once. */
void record_newest(const store_memory_t *memory, record_t newest[2]);

/* Returns the offset after the last word of a sector that is not blank. */
uint32_t record_tail(const store_memory_t *memory, uint32_t sector);

#endif
