#include "firmware/storage/slots.h"

#include <stdbool.h>

#include "firmware/fx/bytes.h"

_Static_assert(sizeof(slot_trailer_t) == SLOT_TRAILER_BYTES, "read by other programs");

/* smallest length of an image in bytes: the initial stack pointer and the reset vector */
enum { LENGTH_MIN = 8 };

const slot_trailer_t *slots_trailer(const uint32_t *slot, uint32_t slot_bytes) {
  const void *trailer = (const uint8_t *)slot + slot_bytes - SLOT_TRAILER_BYTES;
  return (const slot_trailer_t *)trailer;
}

uint32_t slots_next_try(const slot_trailer_t *trailer) {
  uint32_t number = 0;
  while (number < SLOT_TRIES && trailer->tries[number] != SLOT_BLANK) {
    number++;
  }
  return number;
}

/* Returns true if the trailer of a firmware image permits a start of this image. The CRC of the
 * image is not checked here. */
static bool may_start(const slot_trailer_t *trailer, uint32_t slot_bytes) {
  const bool is_length = trailer->length >= LENGTH_MIN && (trailer->length & 3u) == 0 &&
                         trailer->length <= SLOT_IMAGE_BYTES_MAX &&
                         trailer->length <= slot_bytes - SLOT_TRAILER_BYTES;
  const bool is_permitted =
      trailer->confirmed == SLOT_PROGRAMMED || slots_next_try(trailer) < SLOT_TRIES;
  return trailer->magic == SLOT_MAGIC && is_length && is_permitted;
}

/* Returns the CRC-32 of the `count` bytes at `bytes`. */
static uint32_t crc_of(const uint8_t *bytes, uint32_t count) {
  uint32_t crc = UINT32_MAX;
  for (uint32_t i = 0; i < count; i++) {
    crc = fx_crc32(crc, bytes[i]);
  }
  return ~crc;
}

uint8_t slots_choose(const uint32_t *const slots[SLOTS], uint32_t slot_bytes, uint8_t without) {
  const slot_trailer_t *trailers[SLOTS];
  for (uint8_t i = 0; i < SLOTS; i++) {
    trailers[i] = slots_trailer(slots[i], slot_bytes);
  }
  const uint8_t newest = (trailers[1]->sequence > trailers[0]->sequence) ? 1 : 0;
  for (uint8_t i = 0; i < SLOTS; i++) {
    const uint8_t slot = newest ^ i;
    if ((without & fx_bit(slot)) == 0 && may_start(trailers[slot], slot_bytes)) {
      const void *image = slots[slot];
      if (crc_of((const uint8_t *)image, trailers[slot]->length) == trailers[slot]->crc) {
        return slot;
      }
    }
  }
  return SLOTS_NONE;
}
