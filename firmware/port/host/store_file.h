#ifndef FIRMWARE_PORT_HOST_STORE_FILE_H_
#define FIRMWARE_PORT_HOST_STORE_FILE_H_

/* The memory of the parameter store or of the archive, as a file of two sectors with the bytes of a
 * flash memory. If the process is killed, the file keeps what was programmed, as a flash does after
 * a power cut; if the host loses its power, it may keep less. Only one process at a time may use
 * the file. */

#ifdef __cplusplus
extern "C" {
#endif

#include "firmware/storage/store.h"

enum {
  STORE_FILE_SECTOR_BYTES = 16384, /* size of the small sectors of an STM32F4 */
  /* room for one incident of a recorder buffer of FW_RECORDER_BYTES */
  ARCHIVE_FILE_SECTOR_BYTES = 32768
};

typedef struct {
  store_memory_t memory; /* memory for fw_config_t; must not move while the firmware runs */
  int file;
} store_file_t;

/* Opens the file; a new file is blank. Returns NULL, or a text with the error: wrong size, locked
 * by another process, or the message of the system. */
const char *store_file_open(store_file_t *store_file, const char *path);

/* Opens a file for the archive of incidents (fw_config_t.archive); otherwise as
 * store_file_open(). */
const char *archive_file_open(store_file_t *store_file, const char *path);

void store_file_close(store_file_t *store_file);

#ifdef __cplusplus
}
#endif

#endif
