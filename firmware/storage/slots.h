#ifndef FIRMWARE_STORAGE_SLOTS_H_
#define FIRMWARE_STORAGE_SLOTS_H_

/* Two slots of the flash for images of the firmware, and the choice of the image that is started.
 * The loader of a board makes this choice at each reset. The running firmware writes a new image to
 * the other slot (app/update.h).
 *
 * The last 64 bytes of a slot are its trailer. Each word of a trailer is programmed only once, from
 * all ones to its value. The value of `confirmed` and `tries` is 0. `magic` is programmed last, so
 * a trailer with SLOT_MAGIC belongs to an image that was written and checked completely. The loader
 * programs one word of `tries` before it starts an image that is not confirmed. When all words of
 * `tries` are programmed, the image is not started again, and the loader starts the other image. */

#include <stdint.h>

enum {
  SLOTS = 2,
  SLOTS_NONE = 2, /* result of slots_choose(): no slot has an image that may be started */
  SLOT_TRIES = 4,
  SLOT_TRAILER_BYTES = 64,
  SLOT_IMAGE_BYTES_MAX = 130048 /* largest length of an image: 127 KiB */
};

#define SLOT_MAGIC UINT32_C(0x31544146) /* "FAT1" */
#define SLOT_PROGRAMMED UINT32_C(0)
#define SLOT_BLANK UINT32_MAX

typedef struct {
  uint32_t magic;  /* SLOT_MAGIC: the image in this slot was written and checked completely */
  uint32_t length; /* length of the image in bytes; a multiple of 4 */
  uint32_t crc;    /* CRC-32 of the image */
  /* sequence number of the image; the image with the highest number is the newest */
  uint32_t sequence;
  uint32_t confirmed; /* SLOT_PROGRAMMED: the image in this slot is confirmed */
  /* one word for each permitted attempt to start the image; SLOT_BLANK: the attempt that belongs to
   * the word was not used yet */
  uint32_t tries[SLOT_TRIES];
  uint32_t unused[7];
} slot_trailer_t;

/* Returns the index in `tries` of the next permitted attempt to start the image, or SLOT_TRIES if
 * all attempts were used. */
uint32_t slots_next_try(const slot_trailer_t *trailer);

/* Returns the number of the slot whose image the loader starts. An image may be started if its CRC
 * is right, and if it is confirmed or has an attempt that was not used yet. Of two such images the
 * one with the higher sequence number is started. Returns SLOTS_NONE if there is no such image.
 * `slots` are the addresses of both slots; each slot has `slot_bytes` bytes. A slot is left out if
 * its bit in `without` is 1. Cost: the function reads one or both images. */
uint8_t slots_choose(const uint32_t *const slots[SLOTS], uint32_t slot_bytes, uint8_t without);

/* Returns the trailer of a slot that begins at `slot`. */
const slot_trailer_t *slots_trailer(const uint32_t *slot, uint32_t slot_bytes);

#endif
