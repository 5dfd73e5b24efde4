#ifndef FIRMWARE_STORAGE_SLOTS_H_
#define FIRMWARE_STORAGE_SLOTS_H_

/* Two slots of the flash for images of the firmware, and the choice of the image that runs. The
 * loader of a board makes this choice at each reset; the application writes the slot that does not
 * run (app/update.h).
 *
 * The last 64 bytes of a slot are its trailer. The words of a trailer are programmed once, from all
 * ones to a value; `confirmed` and `tries` are programmed from all ones to 0. `magic` is programmed
 * last, so a trailer with this word belongs to an image that was written and checked completely.
 * The loader programs one word of `tries` before it starts an image that is not confirmed. An image
 * without words for a further try is not started again, so the image before it returns. */

#include <stdint.h>

enum {
  SLOTS = 2,
  SLOTS_NONE = 2, /* result if no slot has an image that may be started */
  SLOT_TRIES = 4,
  SLOT_TRAILER_BYTES = 64,
  SLOT_IMAGE_BYTES_MAX = 130048 /* 127 KiB */
};

#define SLOT_MAGIC UINT32_C(0x31544146) /* "FAT1" */
#define SLOT_PROGRAMMED UINT32_C(0)
#define SLOT_BLANK UINT32_MAX

typedef struct {
  uint32_t magic;             /* SLOT_MAGIC */
  uint32_t length;            /* length of the image in bytes; a multiple of 4 */
  uint32_t crc;               /* CRC-32 of the image */
  uint32_t sequence;          /* the image with the highest number is the newest */
  uint32_t confirmed;         /* SLOT_PROGRAMMED: the image is confirmed */
  uint32_t tries[SLOT_TRIES]; /* SLOT_BLANK: this attempt to start the image was not used yet */
  uint32_t unused[7];
} slot_trailer_t;

/* Returns the number of the first attempt to start the image that was not used yet, or
 * SLOT_TRIES. */
uint32_t slots_next_try(const slot_trailer_t *trailer);

/* Returns the slot whose image the loader starts: the highest sequence of all images that have a
 * right CRC and are confirmed or have a try left; SLOTS_NONE without such an image. `slots` are the
 * begins of both slots in the memory, each of `slot_bytes` bytes. Slots whose bit is set in
 * `without` are left out. Cost: the function reads one or both images. */
uint8_t slots_choose(const uint32_t *const slots[SLOTS], uint32_t slot_bytes, uint8_t without);

/* Returns the trailer of a slot that begins at `slot`. */
const slot_trailer_t *slots_trailer(const uint32_t *slot, uint32_t slot_bytes);

#endif
