#ifndef FIRMWARE_PORT_HOST_STORE_FILE_H_
#define FIRMWARE_PORT_HOST_STORE_FILE_H_

/* The memory of the parameter store as a file of two sectors, each byte as a flash would have it.
 * A process that is killed leaves what it had programmed, as a power cut would; a host that loses
 * power may leave less. The file belongs to one process at a time. */

#ifdef __cplusplus
extern "C" {
#endif

#include "firmware/app/store.h"

enum { STORE_FILE_SECTOR_BYTES = 16384 }; /* as the small sectors of an STM32F4 */

typedef struct {
  store_memory_t memory; /* for fw_config_t; must not move while the firmware runs */
  int file;
} store_file_t;

/* Opens the file, a new one blank. Returns NULL, or what is wrong: a file of another size, one that
 * another process has, or what the system says. */
const char *store_file_open(store_file_t *store_file, const char *path);

void store_file_close(store_file_t *store_file);

#ifdef __cplusplus
}
#endif

#endif
