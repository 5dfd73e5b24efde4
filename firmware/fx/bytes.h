#ifndef FIRMWARE_FX_BYTES_H_
#define FIRMWARE_FX_BYTES_H_

/* Functions for bits, bytes and checksums: fields of a word, values in arrays of bytes, CRCs. If
 * the comment of a function states no domain, every argument is permitted. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/fx/assertion.h"

/* Returns a word in which only bit n (0..31) is 1. */
static inline uint32_t fx_bit(uint32_t n) {
  fx_assert(n <= 31);
  return (uint32_t)1 << n;
}

/* Returns the number of the lowest bit that is 1. `bits` must not be 0. */
static inline uint8_t fx_lowest_bit(uint32_t bits) {
  fx_assert(bits != 0);
  /* The factor is a De Bruijn sequence: for each of the 32 shifts of it, the upper five bits are
   * different. */
  static const uint8_t number[32] = {0,  1,  28, 2,  29, 14, 24, 3, 30, 22, 20, 15, 25, 17, 4,  8,
                                     31, 27, 13, 23, 21, 19, 16, 7, 26, 12, 18, 6,  11, 5,  10, 9};
  return number[((bits & ((uint32_t)0 - bits)) * UINT32_C(0x077CB531)) >> 27];
}

/* Returns a field of a word: `width` (1..31) bits from bit `first` (0..31) upwards. */
static inline uint32_t fx_field(uint32_t bits, uint32_t first, uint32_t width) {
  fx_assert(first <= 31 && width >= 1 && width <= 31);
  return (bits >> first) & (((uint32_t)1 << width) - 1);
}

/* Stores the low `bytes` (1, 2 or 4) bytes of a value, least significant byte first. If the
 * processor supports an unaligned store, the compiler joins the assignments of single bytes into
 * one store. */
static inline void fx_store_le(uint8_t *to, uint32_t value, uint8_t bytes) {
  fx_assert(bytes == 1 || bytes == 2 || bytes == 4);
  to[0] = (uint8_t)(value & 0xFFu);
  if (bytes > 1) {
    to[1] = (uint8_t)((value >> 8) & 0xFFu);
  }
  if (bytes > 2) {
    to[2] = (uint8_t)((value >> 16) & 0xFFu);
    to[3] = (uint8_t)(value >> 24);
  }
}

/* fx_copy_2() and fx_copy_4() copy 2 or 4 bytes without alignment. If the processor supports
 * unaligned access, the compiler joins the assignments of single bytes into one load and one
 * store. */
static inline void fx_copy_2(uint8_t *to, const uint8_t *from) {
  const uint8_t byte_0 = from[0];
  const uint8_t byte_1 = from[1];
  to[0] = byte_0;
  to[1] = byte_1;
}
static inline void fx_copy_4(uint8_t *to, const uint8_t *from) {
  const uint8_t byte_0 = from[0];
  const uint8_t byte_1 = from[1];
  const uint8_t byte_2 = from[2];
  const uint8_t byte_3 = from[3];
  to[0] = byte_0;
  to[1] = byte_1;
  to[2] = byte_2;
  to[3] = byte_3;
}

/* Sets `count` bytes to 0. This is the defined initial state of a structure. Do not call this
 * function in the interrupt of the tick. */
void fx_clear(void *to, uint32_t count);

/* Copies `count` bytes in ascending order; `count` is a multiple of 4. */
void fx_copy_words(void *to, const void *from, uint32_t count);

/* Returns the value that is stored in `bytes` (1, 2 or 4) bytes, least significant byte first. The
 * upper bits of the result are 0. */
uint32_t fx_load_le(const uint8_t *from, uint8_t bytes);

/* Returns the 32-bit value that is stored in 4 bytes, least significant byte first. The compiler
 * joins the loads of single bytes into one load if the processor supports an unaligned load. */
static inline uint32_t fx_load_le32(const uint8_t *from) {
  return (uint32_t)from[0] | ((uint32_t)from[1] << 8) | ((uint32_t)from[2] << 16) |
         ((uint32_t)from[3] << 24);
}

/* The low `bits` (1..32) bits of a value are a two's complement number. Converts this number to 32
 * bits. The other bits of the value must be 0. */
int32_t fx_sign_extend(uint32_t value, uint8_t bits);

/* Adds one byte to the CRC of Modbus RTU (CRC-16, reflected polynomial 8005h, initial value FFFFh).
 * The CRC of a frame together with its two CRC bytes, low byte first, is 0. */
uint16_t fx_crc16_modbus(uint16_t crc, uint8_t byte);

/* Adds one byte to the CRC-16 of CANopen block transfers, with the polynomial x^16 + x^12 + x^5 +
 * 1. The initial value of the CRC is 0. */
uint16_t fx_crc16_ccitt(uint16_t crc, uint8_t byte);

/* Adds one byte to a CRC-32 (reflected polynomial 04C11DB7h). The initial value is UINT32_MAX. The
 * standard CRC-32 is the complement of the last result. */
uint32_t fx_crc32(uint32_t crc, uint8_t byte);

/* Adds the 4 bytes of a word to a CRC-32, the lowest byte first. */
uint32_t fx_crc32_word(uint32_t crc, uint32_t word);

/* Stores a 16-bit value, most significant byte first. */
void fx_store_be16(uint8_t *to, uint16_t value);
uint16_t fx_load_be16(const uint8_t *from);

/* Returns bit n of an array of bytes. Bit 0 is the lowest bit of the first byte. */
bool fx_bit_get(const uint8_t *from, uint32_t n);

/* Writes bit n of an array of bytes. The bits must be written in ascending order, because the
 * higher bits of the same byte become 0. */
void fx_bit_append(uint8_t *to, uint32_t n, bool bit);

/* Returns the number of bytes that `bits` bits need. */
static inline uint32_t fx_octets(uint32_t bits) { return (bits + 7) >> 3; }

/* Returns `width` (1..32) bits of a payload from bit `first` upwards; first + width <= 64. The
 * upper bits of the result are 0. */
static inline uint32_t fx_payload_get(uint64_t payload, uint32_t first, uint32_t width) {
  fx_assert(width >= 1 && width <= 32 && first + width <= 64);
  const uint32_t mask = UINT32_MAX >> (32 - width);
  return (uint32_t)(payload >> first) & mask;
}

/* Returns the 32-bit value of 4 bytes in memory. The offset of each byte from `base` is in
 * `places`. The first byte is the least significant byte. */
static inline uint32_t fx_gather_le(const uint8_t *base, const uint16_t places[4]) {
  return (uint32_t)base[places[0]] | (uint32_t)base[places[1]] << 8 |
         (uint32_t)base[places[2]] << 16 | (uint32_t)base[places[3]] << 24;
}

/* Returns a payload of `bytes` (0..8) bytes as a 64-bit value, least significant byte first. The
 * upper bytes of the result are 0. */
uint64_t fx_load_payload(const uint8_t *from, uint8_t bytes);

#endif
