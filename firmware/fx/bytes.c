#include "firmware/fx/bytes.h"

#include "firmware/fx/fx.h"

uint32_t fx_load_le(const uint8_t *from, uint8_t bytes) {
  uint32_t value = 0;
  for (uint8_t i = bytes; i > 0; i--) {
    value = (value << 8) | (uint32_t)from[i - 1];
  }
  return value;
}

int32_t fx_sign_extend(uint32_t value, uint8_t bits) {
  const uint32_t sign = (uint32_t)1 << (bits - 1);
  return fx_s32_from_u32((value ^ sign) - sign);
}

uint64_t fx_load_payload(const uint8_t *from, uint8_t bytes) {
  uint64_t payload = 0;
  for (uint8_t i = bytes; i > 0; i--) {
    payload = (payload << 8) | (uint64_t)from[i - 1];
  }
  return payload;
}

/* The CRC of each value of 4 bits: of a polynomial, reflected, that is 8's; each other value is the
 * sum of its bits'. Eight times as fast as bit by bit. */
static const uint16_t crc16_of_nibble[16] = {0x0000, 0xCC01, 0xD801, 0x1400, 0xF001, 0x3C00,
                                             0x2800, 0xE401, 0xA001, 0x6C00, 0x7800, 0xB401,
                                             0x5000, 0x9C01, 0x8801, 0x4400};

uint16_t fx_crc16_modbus(uint16_t crc, uint8_t byte) {
  uint32_t c = (uint32_t)crc ^ byte;
  c = (c >> 4) ^ crc16_of_nibble[c & 15u];
  c = (c >> 4) ^ crc16_of_nibble[c & 15u];
  return (uint16_t)c;
}

uint16_t fx_crc16_ccitt(uint16_t crc, uint8_t byte) {
  uint32_t c = (uint32_t)crc ^ ((uint32_t)byte << 8);
  for (uint8_t i = 0; i < 8; i++) {
    c = ((c & 0x8000u) != 0) ? (c << 1) ^ 0x1021u : c << 1;
  }
  return (uint16_t)(c & 0xFFFFu);
}

/* The same of CRC-32: a store of 32 KiB is checked at power-up, before the first tick. */
static const uint32_t crc32_of_nibble[16] = {
    UINT32_C(0x00000000), UINT32_C(0x1DB71064), UINT32_C(0x3B6E20C8), UINT32_C(0x26D930AC),
    UINT32_C(0x76DC4190), UINT32_C(0x6B6B51F4), UINT32_C(0x4DB26158), UINT32_C(0x5005713C),
    UINT32_C(0xEDB88320), UINT32_C(0xF00F9344), UINT32_C(0xD6D6A3E8), UINT32_C(0xCB61B38C),
    UINT32_C(0x9B64C2B0), UINT32_C(0x86D3D2D4), UINT32_C(0xA00AE278), UINT32_C(0xBDBDF21C)};

uint32_t fx_crc32(uint32_t crc, uint8_t byte) {
  crc ^= byte;
  crc = (crc >> 4) ^ crc32_of_nibble[crc & 15u];
  return (crc >> 4) ^ crc32_of_nibble[crc & 15u];
}

uint32_t fx_crc32_word(uint32_t crc, uint32_t word) {
  uint8_t bytes[4];
  fx_store_le(bytes, word, 4);
  for (uint8_t i = 0; i < 4; i++) {
    crc = fx_crc32(crc, bytes[i]);
  }
  return crc;
}

void fx_store_be16(uint8_t *to, uint16_t value) {
  to[0] = (uint8_t)((uint32_t)value >> 8);
  to[1] = (uint8_t)(value & 0xFFu);
}

uint16_t fx_load_be16(const uint8_t *from) {
  return (uint16_t)(((uint32_t)from[0] << 8) | (uint32_t)from[1]);
}

bool fx_bit_get(const uint8_t *from, uint32_t n) {
  return (((uint32_t)from[n >> 3] >> (n & 7u)) & 1u) != 0;
}

void fx_bit_append(uint8_t *to, uint32_t n, bool bit) {
  const uint32_t before = ((n & 7u) == 0) ? 0 : to[n >> 3];
  to[n >> 3] = (uint8_t)(before | ((uint32_t)(bit ? 1 : 0) << (n & 7u)));
}
