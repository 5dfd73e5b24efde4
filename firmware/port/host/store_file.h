#ifndef FIRMWARE_PORT_HOST_STORE_FILE_H_
#define FIRMWARE_PORT_HOST_STORE_FILE_H_

/* A file that is the memory of the parameter store or of the archive. It contains two sectors like
 * those of a flash memory. If the process is killed, the file keeps all programmed bytes, as a
 * flash memory does after a power cut. If the host loses its power, the file keeps all bytes that
 * were read back. So a parameter set or an incident that is reported as stored is on the disk. A
 * save needs some five to ten calls of fdatasync(), and the time of each call depends on the disk.
 * Ticks are late by this time, so an axis saves only while it is disabled. Only one process at a
 * time may use the file. */

#ifdef __cplusplus
extern "C" {
#endif

#include "firmware/storage/store.h"

enum {
  STORE_FILE_SECTOR_BYTES = 16384, /* size in bytes of a small sector of an STM32F4 */
  /* size of a sector in bytes: room for one incident from a recorder buffer of FW_RECORDER_BYTES */
  ARCHIVE_FILE_SECTOR_BYTES = 32768
};

typedef struct {
  /* memory for fw_config_t; its address must not change while the firmware runs */
  store_memory_t memory;
  int file;
  /* address after the last programmed byte; 0 if no byte was programmed since the file was last
   * synchronised with the disk */
  uint32_t run_end;
  /* address of the first programmed byte that may not be on the disk yet; the last one is before
   * run_end */
  uint32_t synced_end;
} store_file_t;

/* Opens the file of a parameter store; a new file is blank. Returns NULL if the file is open.
 * Otherwise returns a text with the error: the file has a wrong size, another process has locked
 * the file, or another error of the system. */
const char *store_file_open(store_file_t *store_file, const char *path);

/* Opens the file of an archive of incidents (fw_config_t.archive). Returns the same texts as
 * store_file_open(). */
const char *archive_file_open(store_file_t *store_file, const char *path);

void store_file_close(store_file_t *store_file);

#ifdef __cplusplus
}
#endif

#endif
