#ifndef FIRMWARE_PORT_HOST_STORE_FILE_H_
#define FIRMWARE_PORT_HOST_STORE_FILE_H_

/* The memory of the parameter store, or of the archive, as a file of two sectors, each byte as a
 * flash would have it.
 * After a process is killed the file holds what it had programmed, as after a power cut; after a
 * power cut of the host it may hold less. The file belongs to one process at a time. */

#ifdef __cplusplus
extern "C" {
#endif

#include "firmware/storage/store.h"

enum {
  STORE_FILE_SECTOR_BYTES = 16384,  /* as the small sectors of an STM32F4 */
  ARCHIVE_FILE_SECTOR_BYTES = 32768 /* one incident of a recorder buffer of FW_RECORDER_BYTES */
};

typedef struct {
  store_memory_t memory; /* for fw_config_t; must not move while the firmware runs */
  int file;
} store_file_t;

/* Opens the file, a new one blank. Returns NULL, or the error: a file of another size, one locked
 * by another process, or the system's message. */
const char *store_file_open(store_file_t *store_file, const char *path);

/* The same for the archive of incidents (fw_config_t.archive). */
const char *archive_file_open(store_file_t *store_file, const char *path);

void store_file_close(store_file_t *store_file);

#ifdef __cplusplus
}
#endif

#endif
