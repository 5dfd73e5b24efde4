#include "firmware/fx/fx.h"

uint32_t fx_ticks_from_period(uint8_t mantissa, int8_t exponent) {
  /* 1500 * 10^exponent as a fraction, exponent 0 first. */
  static const uint16_t ticks[] = {1500, 150, 15, 3, 3, 3, 3};
  static const uint16_t per[] = {1, 1, 1, 2, 20, 200, 2000};
  const uint8_t row = (uint8_t)-exponent;
  return ((uint32_t)mantissa * ticks[row] + per[row] - 1) / per[row];
}

fx_ratio_t fx_ratio(uint32_t a, uint32_t b, int8_t e) {
  uint64_t remaining = a;
  uint64_t by = b;
  int32_t shift = 31 - (int32_t)e;
  for (; remaining < by; remaining <<= 1) {
    shift += 1;
  }
  for (; remaining >= by << 1; by <<= 1) {
    shift -= 1;
  }
  /* by <= remaining < 2 by: long division, the first bit is a one. */
  uint32_t mantissa = 0;
  for (uint8_t i = 0; i < 32; i++) {
    const bool one = remaining >= by;
    mantissa = (mantissa << 1) | (uint32_t)one;
    remaining = (one ? remaining - by : remaining) << 1;
  }
  if (shift < 0) {
    return (fx_ratio_t){.mantissa = UINT32_MAX, .shift = 0};
  }
  return (fx_ratio_t){.mantissa = mantissa, .shift = (uint8_t)shift};
}

uint32_t fx_quotient(uint32_t a, uint32_t b) { return a / b; }
