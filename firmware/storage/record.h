#ifndef FIRMWARE_STORAGE_RECORD_H_
#define FIRMWARE_STORAGE_RECORD_H_

/* Records in a flash-like memory of two sectors: their places and integrity. The store interprets
 * their entries.
 *
 * A record is a head (magic, hash of an object table, sequence number, bytes of entries), the
 * entries, and the CRC-32 of both; words are little-endian. Only a record whose CRC is right
 * counts, and the highest sequence number is the newest. */

#include <stdbool.h>
#include <stdint.h>

/* Memory of the port: two sectors, one after the other, whose erased bytes read 0xFF. Addresses and
 * counts of program() are multiples of 4, and only blank bytes are programmed; it returns when they
 * are in. Calls return false when the memory reports a failure; a failure that it does not report
 * is found by reading back. */
typedef struct {
  void *context;
  uint32_t sector_bytes; /* a multiple of 16, at least STORE_SECTOR_MIN */
  void (*read)(void *context, uint32_t address, uint8_t *bytes, uint32_t count);
  bool (*program)(void *context, uint32_t address, const uint8_t *bytes, uint32_t count);
  bool (*erase)(void *context, uint8_t sector);
} store_memory_t;

enum { RECORD_HEAD_BYTES = 16, RECORD_CRC_BYTES = 4 };

/* First word of a record. */
#define RECORD_SET_0_1_0 UINT32_C(0x31534146) /* "FAS1": a set as version 0.1.0 wrote it */
#define RECORD_SET UINT32_C(0x32534146)       /* "FAS2": a set */
#define RECORD_FORGOTTEN UINT32_C(0x31464146) /* "FAF1": all defaults, no entries */
#define RECORD_INCIDENT UINT32_C(0x31494146)  /* "FAI1": see archive.h */
#define RECORD_NONE UINT32_C(0)

typedef struct {
  uint32_t begin; /* address of the head */
  uint32_t magic; /* RECORD_ */
  uint32_t hash;
  uint32_t sequence;
  uint32_t entries; /* bytes, a multiple of record_entry_bytes() */
} record_t;

/* Bytes of one entry of a record: address and value, and in RECORD_SET the signature. */
uint32_t record_entry_bytes(uint32_t magic);

/* Bytes of a record with that many bytes of entries. */
static inline uint32_t record_bytes(uint32_t entries) {
  return RECORD_HEAD_BYTES + entries + RECORD_CRC_BYTES;
}

/* The word at an address. */
uint32_t record_word(const store_memory_t *memory, uint32_t at);

/* CRC-32 carried on over bytes, or over a stretch of the memory whose length is a multiple of 4;
 * begins with UINT32_MAX, and the complement is what a record has. */
uint32_t record_crc(uint32_t crc, const uint8_t *bytes, uint32_t count);
uint32_t record_crc_of_memory(const store_memory_t *memory, uint32_t crc, uint32_t at,
                              uint32_t end);

/* Whether a whole record begins at an address of a sector that ends at `end`. */
bool record_read(const store_memory_t *memory, uint32_t at, uint32_t end, record_t *record);

/* The two newest whole records, the newest first; magic RECORD_NONE where there is none. Reads both
 * sectors once. */
void record_newest(const store_memory_t *memory, record_t newest[2]);

/* Offset behind the last word of a sector that is not blank. */
uint32_t record_tail(const store_memory_t *memory, uint32_t sector);

#endif
