#include "firmware/fx/fx.h"

void fx_store_le(uint8_t *to, uint32_t value, uint8_t bytes) {
  for (uint8_t i = 0; i < bytes; i++) {
    to[i] = (uint8_t)(value & 0xFFu);
    value >>= 8;
  }
}

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

uint32_t fx_quotient(uint32_t a, uint32_t b) { return a / b; }

void fx_store_payload(uint8_t *to, uint64_t payload, uint8_t bytes) {
  for (uint8_t i = 0; i < bytes; i++) {
    to[i] = (uint8_t)(payload & 0xFFu);
    payload >>= 8;
  }
}

uint64_t fx_load_payload(const uint8_t *from, uint8_t bytes) {
  uint64_t payload = 0;
  for (uint8_t i = bytes; i > 0; i--) {
    payload = (payload << 8) | (uint64_t)from[i - 1];
  }
  return payload;
}
