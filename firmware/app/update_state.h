#ifndef FIRMWARE_APP_UPDATE_STATE_H_
#define FIRMWARE_APP_UPDATE_STATE_H_

/* The state of an update of the firmware in operation (update.h). */

#include <stdbool.h>
#include <stdint.h>

/* The head of an update. It is in front of the image, and its numbers are little-endian. */
typedef struct {
  uint32_t magic;          /* first word of the head of an update of the firmware, UPDATE_MAGIC */
  uint32_t address;        /* address for which the image is linked */
  uint32_t length;         /* length of the image in bytes; a multiple of 4 */
  uint32_t crc;            /* CRC-32 of the image */
  uint32_t table;          /* AXIS_OBJECTS_HASH32 (hash of the object table) of the image */
  uint32_t replaced_table; /* AXIS_OBJECTS_HASH32 of the axes that may receive this update */
  char board[16];          /* name of the board for which the image was built (identity.h) */
  char version[16];
  uint32_t unused;
  uint32_t head_crc; /* CRC-32 of all bytes of the head before this field */
} update_head_t;

enum { UPDATE_HEAD_BYTES = sizeof(update_head_t) };

typedef struct {
  update_head_t head;
  /* size in bytes of the firmware update that the client has announced; 0: not announced */
  uint32_t size;
  uint32_t received;     /* number of received bytes of the update */
  uint32_t crc;          /* CRC-32 of the bytes of the image that were programmed so far */
  uint32_t tick;         /* tick in which the last bytes of the update were received */
  uint32_t sequence;     /* sequence number of the firmware image that runs */
  uint32_t overrun_tick; /* tick of the last overrun */
  /* received bytes of the last 32-bit word of the update, which is not complete yet */
  uint8_t word[4];
  uint8_t is_receiving;
  uint8_t restart_ticks; /* number of ticks until the chip restarts; 0: no restart is due */
} update_t;

/* Number of ticks without received bytes after which an update ends: 5 s, the same time as in an
 * SDO transfer. */
enum { UPDATE_SILENCE_TICKS = 7500 };

/* Returns true if more bytes of an update are expected at the tick `tick`. */
static inline bool update_is_receiving(const update_t *update, uint32_t tick) {
  return update->is_receiving != 0 && tick - update->tick < UPDATE_SILENCE_TICKS;
}

/* Returns true while the axis must not be enabled, because an update or a restart is in progress.
 */
static inline bool update_is_busy(const update_t *update, uint32_t tick) {
  return update->restart_ticks != 0 || update_is_receiving(update, tick);
}

#endif
