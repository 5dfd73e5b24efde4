#include "firmware/fx/fx.h"

uint32_t fx_ticks_from_period(uint8_t mantissa, int8_t exponent) {
  fx_assert(exponent >= -6 && exponent <= 0);
  /* Number of ticks in 10^exponent s, 1500 * 10^exponent, as the fraction ticks / per. The first
   * entry is for the exponent 0, the next one for the exponent -1. */
  static const uint16_t ticks[] = {1500, 150, 15, 3, 3, 3, 3};
  static const uint16_t per[] = {1, 1, 1, 2, 20, 200, 2000};
  const uint8_t row = (uint8_t)-exponent;
  return ((uint32_t)mantissa * ticks[row] + per[row] - 1) / per[row];
}

fx_ratio_t fx_ratio(uint32_t a, uint32_t b, int8_t e) {
  fx_assert(a > 0 && b > 0);
  fx_assert(e >= -32 - 32 && e <= 32 + 32);
  uint64_t remaining = a;
  uint64_t by = b;
  int32_t shift = 31 - (int32_t)e;
  for (; remaining < by; remaining <<= 1) {
    shift += 1;
  }
  for (; remaining >= by << 1; by <<= 1) {
    shift -= 1;
  }
  /* Long division by the number `by`. At its begin, `by` <= `remaining` < 2 * `by`, so the first
   * bit of the quotient is 1. */
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

fx_ratio_t fx_ratio_wide(uint64_t a, uint64_t b, int8_t e) {
  fx_assert(a > 0 && b > 0);
  fx_assert(e >= -32 && e <= 32);
  int32_t exponent = e;
  for (; a > UINT32_MAX; a >>= 1) {
    exponent += 1;
  }
  for (; b > UINT32_MAX; b >>= 1) {
    exponent -= 1;
  }
  return fx_ratio((uint32_t)a, (uint32_t)b, (int8_t)exponent);
}

uint32_t fx_quotient(uint32_t a, uint32_t b) {
  fx_assert(b > 0);
  return a / b;
}

fx_ratio_t fx_ratio_divided(fx_ratio_t ratio, uint32_t by, int8_t n) {
  fx_assert(by > 0);
  fx_assert(n >= -16 && n <= 16);
  fx_ratio_t result = fx_ratio(ratio.mantissa, by, 0);
  result.shift = (uint8_t)(result.shift + ratio.shift + n);
  return result;
}

static uint32_t greatest_divisor(uint32_t a, uint32_t b) {
  while (b != 0) {
    const uint32_t remainder = a % b;
    a = b;
    b = remainder;
  }
  return a;
}

/* Multiplies the three numbers `factors`. Returns false if the product has more than 31 bits. */
static bool multiply(const uint32_t factors[3], uint32_t *product) {
  uint64_t wide = factors[0];
  for (uint8_t i = 1; i < 3; i++) {
    wide *= factors[i];
    if (wide > (uint64_t)INT32_MAX) {
      return false;
    }
  }
  *product = (uint32_t)wide;
  return true;
}

bool fx_fraction(const uint32_t over[3], const uint32_t under[3], fx_fraction_t *fraction) {
  uint32_t a[3] = {over[0], over[1], over[2]};
  uint32_t b[3] = {under[0], under[1], under[2]};
  for (uint8_t i = 0; i < 3; i++) {
    for (uint8_t k = 0; k < 3; k++) {
      const uint32_t common = greatest_divisor(a[i], b[k]);
      a[i] /= common;
      b[k] /= common;
    }
  }
  uint32_t num;
  uint32_t den;
  if (!multiply(a, &num) || !multiply(b, &den)) {
    return false;
  }
  fraction->num = num;
  fraction->den = den;
  fraction->ratio = fx_ratio(num, den, 0);
  fraction->inverse = fx_ratio(den, num, 0);
  return true;
}

/* Returns x * num / den, rounded exactly. `ratio` is an approximation of num / den: its relative
 * error is at most 2^-31, and it is never too large. So the first quotient is too small by less
 * than 2, and its remainder is less than twice the denominator and has at most 32 bits. */
static int32_t scale_exactly(int32_t x, uint32_t num, uint32_t den, fx_ratio_t ratio) {
  fx_assert(num > 0 && num <= INT32_MAX && den > 0 && den <= INT32_MAX);
  const uint32_t size = fx_magnitude(x);
  const uint64_t product = (uint64_t)size * ratio.mantissa;
  const uint32_t high = (uint32_t)(product >> 32);
  uint32_t quotient = (uint32_t)INT32_MAX;
  /* The shift is split into two shifts, because on some processors a 64-bit shift by a variable
   * calls a library function. */
  if (ratio.shift >= 32) {
    quotient = high >> (ratio.shift - 32);
  } else if (high >> ratio.shift == 0) {
    quotient = ((uint32_t)product >> ratio.shift) | (high << (31 - ratio.shift) << 1);
  }
  if (quotient >= (uint32_t)INT32_MAX - 4) {
    return (x < 0) ? -INT32_MAX : INT32_MAX;
  }
  const uint32_t rest = size * num - quotient * den;
  /* Rounding half up means away from 0 for a positive x, and towards 0 for a negative x. */
  const uint32_t half = (x < 0) ? (den >> 1) + 1 : den - (den >> 1);
  quotient += (rest >= half) ? 1 : 0;
  quotient += (rest >= half + den) ? 1 : 0;
  return (x < 0) ? -(int32_t)quotient : (int32_t)quotient;
}

int32_t fx_fraction_apply(int32_t x, const fx_fraction_t *fraction) {
  return scale_exactly(x, fraction->num, fraction->den, fraction->ratio);
}

int32_t fx_fraction_invert(int32_t x, const fx_fraction_t *fraction) {
  return scale_exactly(x, fraction->den, fraction->num, fraction->inverse);
}

/* The quotient of the interpolation has at most 32 bits, because x lies between x0 and x1. */
int32_t fx_interpolate(int32_t x0, int32_t y0, int32_t x1, int32_t y1, int32_t x,
                       uint8_t rounding) {
  fx_assert(x0 != x1);
  fx_assert((x0 <= x && x <= x1) || (x1 <= x && x <= x0));
  fx_assert(rounding <= FX_ROUND_HALF_UP);
  fx_assert(fx_magnitude(y0) <= UINT32_C(1073741824) && fx_magnitude(y1) <= UINT32_C(1073741824));
  const uint32_t length = fx_magnitude(fx_diff_wrap(x1, x0));
  const bool falls = y1 < y0;
  const uint64_t product =
      (uint64_t)fx_magnitude(fx_diff_wrap(x, x0)) * fx_magnitude(fx_diff_wrap(y1, y0));
  uint64_t rest = product >> 32;
  uint32_t low = (uint32_t)product;
  uint32_t quotient = 0;
  for (uint8_t i = 0; i < 32; i++) {
    rest = (rest << 1) | (low >> 31);
    low <<= 1;
    const bool one = rest >= length;
    quotient = (quotient << 1) | (uint32_t)one;
    rest = one ? rest - length : rest;
  }
  bool more = rest != 0 && (rounding == FX_ROUND_UP) != falls;
  if (rounding == FX_ROUND_HALF_UP) {
    more = falls ? rest << 1 > length : rest << 1 >= length;
  }
  quotient += (uint32_t)more;
  return falls ? fx_s32_from_u32((uint32_t)y0 - quotient)
               : fx_s32_from_u32((uint32_t)y0 + quotient);
}

/* 2^17 n is added to the sum, so that it is not negative. The result is then at most 2^18 n, which
 * is below 2^32. */
int32_t fx_mean_half_up(int32_t sum, uint32_t n) {
  fx_assert(n >= 1 && n <= 16383);
  fx_assert(fx_magnitude(sum) <= n << 17);
  const uint32_t raised = (uint32_t)sum + (n << 17);
  return (int32_t)((raised + (n >> 1)) / n) - (INT32_C(1) << 17);
}
