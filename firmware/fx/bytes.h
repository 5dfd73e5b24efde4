#ifndef FIRMWARE_FX_BYTES_H_
#define FIRMWARE_FX_BYTES_H_

/* Bits, bytes and checksums: fields of a word, values in rows of bytes, CRCs. Where no domain is
 * stated, every argument is allowed. */

#include <stdbool.h>
#include <stdint.h>

/* Bit n (0..31) alone. */
static inline uint32_t fx_bit(uint32_t n) { return (uint32_t)1 << n; }

/* The number of the lowest bit that is set; bits must not be 0. */
static inline uint8_t fx_lowest_bit(uint32_t bits) {
  /* A de Bruijn sequence: its upper five bits differ for each of the 32 shifts. */
  static const uint8_t number[32] = {0,  1,  28, 2,  29, 14, 24, 3, 30, 22, 20, 15, 25, 17, 4,  8,
                                     31, 27, 13, 23, 21, 19, 16, 7, 26, 12, 18, 6,  11, 5,  10, 9};
  return number[((bits & ((uint32_t)0 - bits)) * UINT32_C(0x077CB531)) >> 27];
}

/* `width` (1..31) bits of a word from bit `first` (0..31) up. */
static inline uint32_t fx_field(uint32_t bits, uint32_t first, uint32_t width) {
  return (bits >> first) & (((uint32_t)1 << width) - 1);
}

/* The low `bytes` (1, 2 or 4) bytes of a value, least significant first. Written out, they are one
 * store on chips that can. */
static inline void fx_store_le(uint8_t *to, uint32_t value, uint8_t bytes) {
  to[0] = (uint8_t)(value & 0xFFu);
  if (bytes > 1) {
    to[1] = (uint8_t)((value >> 8) & 0xFFu);
  }
  if (bytes > 2) {
    to[2] = (uint8_t)((value >> 16) & 0xFFu);
    to[3] = (uint8_t)(value >> 24);
  }
}

/* Copies 2 or 4 bytes that need no alignment. Written out, they are one load and one store on chips
 * that can. */
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

/* The value behind `bytes` (1, 2 or 4) bytes, least significant first, upper bits 0. */
uint32_t fx_load_le(const uint8_t *from, uint8_t bytes);

/* The same of 4 bytes: one load on chips that can. */
static inline uint32_t fx_load_le32(const uint8_t *from) {
  return (uint32_t)from[0] | ((uint32_t)from[1] << 8) | ((uint32_t)from[2] << 16) |
         ((uint32_t)from[3] << 24);
}

/* The low `bits` (1..32) bits as a two's complement number; the others must be 0. */
int32_t fx_sign_extend(uint32_t value, uint8_t bits);

/* One byte into the CRC of Modbus RTU (CRC-16, reflected 8005h, from FFFFh): over a frame and its
 * CRC, low byte first, it is 0. */
uint16_t fx_crc16_modbus(uint16_t crc, uint8_t byte);

/* The CRC-16 of CANopen's block transfers with one more byte, x^16 + x^12 + x^5 + 1; of nothing it
 * is 0. */
uint16_t fx_crc16_ccitt(uint16_t crc, uint8_t byte);

/* One byte into CRC-32 (reflected 04C11DB7h). From and to UINT32_MAX; the usual CRC is the
 * complement of the last. */
uint32_t fx_crc32(uint32_t crc, uint8_t byte);

/* The same of 4 bytes, the word's lowest one first. */
uint32_t fx_crc32_word(uint32_t crc, uint32_t word);

/* 16 bits, most significant byte first. */
void fx_store_be16(uint8_t *to, uint16_t value);
uint16_t fx_load_be16(const uint8_t *from);

/* Bit n of a row of bytes, least significant first. */
bool fx_bit_get(const uint8_t *from, uint32_t n);

/* The same of a row that is written from bit 0 up: the later bits of its byte become 0. */
void fx_bit_append(uint8_t *to, uint32_t n, bool bit);

/* How many bytes hold `bits` bits. */
static inline uint32_t fx_octets(uint32_t bits) { return (bits + 7) >> 3; }

/* `width` (1..32) bits of a payload from bit `first` up, first + width <= 64. Upper bits 0. */
static inline uint32_t fx_payload_get(uint64_t payload, uint32_t first, uint32_t width) {
  const uint32_t mask = UINT32_MAX >> (32 - width);
  return (uint32_t)(payload >> first) & mask;
}

/* The value of 4 bytes that lie at places of their own, counted from `base`, the first one least
 * significant. */
static inline uint32_t fx_gather_le(const uint8_t *base, const uint16_t places[4]) {
  return (uint32_t)base[places[0]] | (uint32_t)base[places[1]] << 8 |
         (uint32_t)base[places[2]] << 16 | (uint32_t)base[places[3]] << 24;
}

/* The payload behind `bytes` (0..8) bytes, least significant first, the others 0. */
uint64_t fx_load_payload(const uint8_t *from, uint8_t bytes);

#endif
