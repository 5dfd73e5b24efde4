#ifndef FIRMWARE_APP_STORE_H_
#define FIRMWARE_APP_STORE_H_

/* The parameter store: what is kept over a power cut. Two sectors of a flash-like memory; a set of
 * parameters is one record with a sequence number and a CRC, appended to a sector; a full sector is
 * followed by the other, erased, one. A cut after any byte leaves the old set or the new one. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/proto/access.h"

/* Memory of the port: two sectors, one after the other, whose erased bytes read 0xFF. Calls return
 * false when the memory says so. */
typedef struct {
  void *context;
  uint32_t sector_bytes;
  void (*read)(void *context, uint32_t address, uint8_t *bytes, uint32_t count);
  bool (*program)(void *context, uint32_t address, const uint8_t *bytes, uint32_t count);
  bool (*erase)(void *context, uint8_t sector);
} store_memory_t;

typedef struct {
  const store_memory_t *memory; /* NULL: nothing is kept */
} store_t;

void store_init(store_t *store, const store_memory_t *memory);

/* Reads the newest whole set into the parameters of fw. Returns AXIS_STORE_STATE_LOADED,
 * _EMPTY or _OTHER_TABLE (a set of another object table, left alone). */
uint8_t store_load(store_t *store, fw_t *fw);

/* Gives one block (AXIS_BLOCK_) its stored values again. */
void store_load_block(const store_t *store, fw_t *fw, uint8_t block);

/* Starts to keep the present parameters, or to forget them: FW_OK, FW_ERROR_BUSY, or
 * FW_ERROR_STATE without a memory. */
int store_save(store_t *store, const fw_t *fw);
int store_forget(store_t *store);

/* Once a tick, at most one bounded step. Returns AXIS_STORE_STATE_SAVING, _SAVED, _RESTORED or
 * _FAILED, or AXIS_STORE_STATE_COUNT when there was nothing to do. */
uint8_t store_tick(store_t *store, const fw_t *fw);

#endif
