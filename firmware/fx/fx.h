#ifndef FIRMWARE_FX_FX_H_
#define FIRMWARE_FX_FX_H_

/* Fixed-point arithmetic. Only the files in this folder shift, round, saturate or divide.
 *
 * The suffix of a name states the number of fractional bits: 8 for _q8 (stored number = value *
 * 2^8), 16 for _q16, and 32 for _q32, which is an encoder count with 32 fractional bits. All
 * numbers are two's complement of exact width. Every operand is widened before a multiplication,
 * shift or subtraction. So a processor with an int of 16 bits computes exactly the same DAC codes.
 * No function has undefined behaviour for arguments in its stated domain. If the comment of a
 * function states no domain, every argument is permitted.
 *
 * Unless a comment says otherwise, rounding is half up: floor(x + 1/2). Floor means rounding
 * towards minus infinity. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/fx/assertion.h"

/* Returns the two's complement number that the 32 bits represent. Scaling: none. Cannot
 * overflow. */
static inline int32_t fx_s32_from_u32(uint32_t bits) {
  /* A simple cast is not used, because in the C standard its result for numbers above INT32_MAX
   * depends on the compiler. The following expression compiles to no instruction. */
  return (bits <= (uint32_t)INT32_MAX) ? (int32_t)bits : (int32_t)(-(int32_t)(~bits) - 1);
}

/* Returns a - b modulo 2^32, -2^31..2^31-1. The result is the true difference of two counts that
 * are less than 2^31 apart, even if one of the counts has wrapped. Overflow: wraps, as intended. */
static inline int32_t fx_diff_wrap(int32_t a, int32_t b) {
  return fx_s32_from_u32((uint32_t)a - (uint32_t)b);
}

/* Returns a + b modulo 2^32. Overflow: wraps, as intended. */
static inline int32_t fx_sum_wrap(int32_t a, int32_t b) {
  return fx_s32_from_u32((uint32_t)a + (uint32_t)b);
}

/* Returns x limited to low..high, where low <= high. Cannot overflow. */
static inline int32_t fx_clamp(int32_t x, int32_t low, int32_t high) {
  fx_assert(low <= high);
  return (x < low) ? low : ((x > high) ? high : x);
}

/* Returns the 64-bit value x limited to low..high, where low <= high. A value outside this range
 * saturates. */
static inline int32_t fx_saturate(int64_t x, int32_t low, int32_t high) {
  fx_assert(low <= high);
  return (x < (int64_t)low) ? low : ((x > (int64_t)high) ? high : (int32_t)x);
}

/* Returns |x|, 0..2^31. The result is also correct for the most negative value. Cannot overflow. */
static inline uint32_t fx_magnitude(int32_t x) {
  return (x < 0) ? (uint32_t)0 - (uint32_t)x : (uint32_t)x;
}

/* Returns true if -limit <= x <= limit. `limit` must not be negative. Cannot overflow. */
static inline bool fx_within(int32_t x, int32_t limit) {
  fx_assert(limit >= 0);
  /* One comparison is sufficient, because the interval is shifted to 0..2 * limit, modulo 2^32. */
  return (uint32_t)x + (uint32_t)limit <= (uint32_t)limit * 2;
}

/* Returns a * b with 64 bits. Scaling: the product has as many fractional bits as a and b together.
 * Cannot overflow. */
static inline int64_t fx_mul(int32_t a, int32_t b) { return (int64_t)a * (int64_t)b; }

/* Returns x * 2^n, n 0..30. Scaling: the result has n more fractional bits than x. Domain: |x| *
 * 2^n < 2^31; outside this domain the result is the product modulo 2^32. */
static inline int32_t fx_scale(int32_t x, uint32_t n) {
  fx_assert(n <= 30);
  return fx_s32_from_u32((uint32_t)x << n);
}

/* Returns floor(x / 2^n) for a 32-bit value, n 0..31. Scaling: the result has n fractional bits
 * fewer than x. Cannot overflow. */
static inline int32_t fx_floor_shift(int32_t x, uint32_t n) {
  fx_assert(n <= 31);
  /* In the C standard the right shift of a negative value depends on the compiler. So ~x, which is
   * not negative, is shifted instead. */
  return (x < 0) ? (int32_t) ~(int32_t)(~x >> n) : (int32_t)(x >> n);
}

/* Returns floor(x / 2^16 + 1/2), -32768..32768. Cannot overflow. */
static inline int32_t fx_round_q16(int32_t x_q16) {
  return fx_floor_shift(fx_floor_shift(x_q16, 15) + 1, 1);
}

/* Returns the whole DAC code that is nearest to a code in Q16: floor(x / 2^16 + 1/2). Domain: |x| <
 * 2^31 - 2^15. */
static inline int32_t fx_code_from_q16(int32_t x_q16) {
  fx_assert(x_q16 < INT32_MAX - 32767);
  return fx_floor_shift(fx_sum_wrap(x_q16, 32768), 16);
}

/* Returns the step of a DAC with `bits` bits, 12..16, as a mask for fx_round_to(): -2^(28 - bits).
 * The step of a DAC with 12 bits is 2^16. */
static inline int32_t fx_step_mask(uint8_t bits) {
  fx_assert(bits >= 12 && bits <= 16);
  return -(int32_t)((uint32_t)1 << ((uint32_t)28 - bits));
}

/* Returns x rounded to a multiple of 2^n: floor(x / 2^n + 1/2) 2^n, for mask = -2^n, n 1..16.
 * Domain: |x| < 2^31 - 2^15. */
static inline int32_t fx_round_to(int32_t x, int32_t mask) {
  fx_assert(mask < -1 && mask >= -65536);
  fx_assert(x < INT32_MAX - 32767 && x > INT32_MIN + 32768);
  return fx_s32_from_u32(((uint32_t)x - (uint32_t)fx_floor_shift(mask, 1)) & (uint32_t)mask);
}

/* Returns true if an ADC with `bits` bits, 0..16, can output this code. */
static inline bool fx_fits_bits(uint16_t code, uint8_t bits) {
  fx_assert(bits <= 16);
  return ((uint32_t)code >> bits) == 0;
}

/* Returns sin(2 pi p / 2^32) in Q15, -32767..32767, with an error of at most 6 / 32768. The sum of
 * sin(x) and sin(x + half a turn) is 0 except for a rounding error of 3 units. Cannot overflow. */
static inline int32_t fx_sine_q15(uint32_t phase_q32) {
  /* The phase is reduced to x = -1..1 quarter turns. In this range sin = x (c1 - x^2 (c3 - x^2 c5))
   * with c1 - c3 + c5 = 1. The coefficients are chosen so that the largest error is as small as
   * possible. */
  const uint32_t quarter = (uint32_t)1 << 30;
  const bool outer = phase_q32 + quarter > quarter * 2;
  const uint32_t folded = outer ? quarter * 2 - phase_q32 : phase_q32;
  const int32_t x = fx_floor_shift(fx_s32_from_u32(folded), 15);
  const int32_t square = fx_floor_shift(x * x, 15);
  const int32_t inner = INT32_C(21031) - fx_floor_shift(INT32_C(2344) * square, 15);
  const int32_t slope = INT32_C(51454) - fx_floor_shift(inner * square, 15);
  return fx_floor_shift(x * slope, 15);
}

/* Returns x after one step of a decay towards 0. |x| decreases by floor(|x| / 2^n), at least by 1;
 * n is 0..31. So x reaches exactly 0, its sign never changes, and for x = 0 the result is 0. For n
 * = 0 the first step gives 0. Cannot overflow. */
static inline int32_t fx_decay(int32_t x, uint32_t n) {
  fx_assert(n <= 31);
  const uint32_t size = fx_magnitude(x);
  const uint32_t step = size >> n;
  const uint32_t remaining = (size == 0) ? 0 : size - ((step == 0) ? 1 : step);
  return (x < 0) ? fx_s32_from_u32((uint32_t)0 - remaining) : (int32_t)remaining;
}

/* Converts an encoder count to a Q32 position. The conversion is exact. */
static inline uint64_t fx_q32_from_cnt(int32_t cnt) { return (uint64_t)(uint32_t)cnt << 32; }

/* Returns the encoder count that is nearest to a Q32 position, rounded half up, modulo 2^32. */
static inline int32_t fx_cnt_from_q32(uint64_t x_q32) {
  return fx_s32_from_u32((uint32_t)((x_q32 + ((uint64_t)1 << 31)) >> 32));
}

/* Returns the position after a motion from the Q32 position x by the Q16 distance v, modulo 2^64.
 * The result is exact. */
static inline uint64_t fx_q32_advance(uint64_t x_q32, int32_t v_q16) {
  return x_q32 + (uint64_t)((int64_t)v_q16 * 65536);
}

/* Largest distance that the following functions use: 2^21 counts. They limit a larger distance to
 * this value. */
#define FX_DISTANCE_MAX_CNT ((uint32_t)1 << 21)
#define FX_DISTANCE_MAX_Q16 (((uint64_t)1 << 37) - 1)

/* Returns the distance from one Q32 position to another, in Q16 counts (floor). The direction is
 * the one that is shorter modulo 2^32. *negative becomes true if this direction is towards smaller
 * counts. Overflow: saturates to FX_DISTANCE_MAX_Q16. */
static inline uint64_t fx_distance_q16(uint64_t to_q32, uint64_t from_q32, bool *negative) {
  const uint64_t forth = to_q32 - from_q32;
  const bool back = forth > (uint64_t)INT64_MAX;
  const uint64_t distance = back ? (uint64_t)0 - forth : forth;
  *negative = back;
  return ((uint32_t)(distance >> 32) >= FX_DISTANCE_MAX_CNT) ? FX_DISTANCE_MAX_Q16 : distance >> 16;
}

/* Returns the product 8 a d. fx_stops_within() compares this product with the square of a speed. a
 * is the deceleration in Q16 counts per tick squared, 0 < a <= 2^24. d is the distance, at most
 * FX_DISTANCE_MAX_Q16. Cannot overflow, because 8 a d < 2^64. */
static inline uint64_t fx_stopping_room(int32_t a_q16, uint64_t d_q16) {
  fx_assert(a_q16 > 0 && a_q16 <= INT32_C(16777216));
  fx_assert(d_q16 <= FX_DISTANCE_MAX_Q16);
  return (uint64_t)((uint32_t)a_q16 * 8) * d_q16;
}

/* Returns true only if an axis stops within the distance d. In this tick the axis moves by v, and
 * in each later tick its speed decreases by a. `room` is fx_stopping_room(a, d). v and a are in
 * Q16, 0 < a <= 2^24, 0 <= v <= 2^28. With v = n a + r the travel is v + (v-a) + (v-2a) + ... =
 * v(v+a)/2a + r(a-r)/2a. r(a-r) is at most a^2/4, so the condition (2v + a)^2 <= 8 a d is
 * sufficient; this condition requires at most a/8 more distance than necessary. Rounding: none.
 * Cannot overflow, because (2v+a)^2 < 2^59. */
static inline bool fx_stops_within(int32_t v_q16, int32_t a_q16, uint64_t room) {
  fx_assert(a_q16 > 0 && a_q16 <= INT32_C(16777216));
  fx_assert(v_q16 >= 0 && v_q16 <= INT32_C(268435456));
  const uint32_t side = (uint32_t)v_q16 * 2 + (uint32_t)a_q16;
  return (uint64_t)side * (uint64_t)side <= room;
}

/* Number of ticks in a second. The build of the host checks that its constant has the same value
 * (host/python/binding/core.cpp). */
enum { FX_TICK_RATE_HZ = 1500 };

/* Returns the smallest number of ticks of 1/1500 s that last at least `ms` milliseconds. Rounding:
 * up. Cannot overflow, ms <= 2^31. */
static inline uint32_t fx_ticks_from_ms(uint32_t ms) {
  fx_assert(ms <= UINT32_C(2147483648));
  return ms + (ms >> 1) + (ms & 1);
}

/* Returns the smallest number of ticks that last at least n times 100 us, n at most 65535.
 * Rounding: up. Cannot overflow. */
static inline uint32_t fx_ticks_from_100us(uint16_t n) { return ((uint32_t)n * 3 + 19) / 20; }

/* Returns the smallest number of ticks of 1/1500 s that last at least mantissa * 10^exponent s,
 * exponent -6..0. Rounding: up. Cannot overflow. */
uint32_t fx_ticks_from_period(uint8_t mantissa, int8_t exponent);

/* Largest rate that fx_q16_from_per_s() converts. A larger rate is limited to this value. */
#define FX_PER_S_MAX ((uint32_t)49151999)

/* Converts units per second to Q16 units per tick: floor(x * 2^16 / 1500). Because of the floor, a
 * converted limit is never exceeded, and fx_per_s_from_q16() returns exactly x again. Overflow:
 * saturates above FX_PER_S_MAX. */
static inline int32_t fx_q16_from_per_s(uint32_t x) {
  const uint32_t rate = (x > FX_PER_S_MAX) ? FX_PER_S_MAX : x;
  /* 2^16 / 1500 = 2^14 / 375. The quotient is computed in two parts of at most 32 bits. */
  return (int32_t)(((rate / 375) << 14) + (((rate % 375) << 14) / 375));
}

/* Converts units per second squared to Q16 units per tick squared: floor(x * 2^16 / 1500^2); x
 * below 2^30. */
static inline int32_t fx_q16_from_per_s2(uint32_t x) {
  fx_assert(x < UINT32_C(1073741824));
  return (int32_t)(((x / 140625) << 12) + (((x % 140625) << 12) / 140625));
}

/* Returns floor(x / 2^n) for a 64-bit value, n 1..31. Scaling: the result has n fractional bits
 * fewer than x. Cannot overflow. */
static inline int64_t fx_floor_shift_wide(int64_t x, uint32_t n) {
  fx_assert(n >= 1 && n <= 31);
  /* The lower and the upper half are shifted separately, so that only the upper half has a sign.
   * The compiler needs no instruction for the last line. */
  const uint64_t bits = (uint64_t)x;
  const uint32_t high = (uint32_t)fx_floor_shift(fx_s32_from_u32((uint32_t)(bits >> 32)), n);
  const uint64_t shifted = (uint64_t)high << 32 | (uint32_t)(bits >> n);
  return (shifted <= (uint64_t)INT64_MAX) ? (int64_t)shifted : -(int64_t)(~shifted) - 1;
}

/* Converts Q16 units per tick to units per second: floor(x * 1500 / 2^16 + 1/2). Cannot
 * overflow. */
static inline int32_t fx_per_s_from_q16(int32_t x_q16) {
  return (int32_t)fx_floor_shift_wide((int64_t)x_q16 * 375 + 8192, 14);
}

/* Converts a travel in counts during 16 ticks to counts per second: floor(x * 1500 / 16 + 1/2).
 * Overflow: saturates. */
static inline int32_t fx_per_s_from_16_ticks(int32_t x) {
  return fx_saturate(fx_floor_shift_wide((int64_t)x * 375 + 2, 2), INT32_MIN, INT32_MAX);
}

/* Converts a travel in counts during one tick to counts per second. Overflow: saturates. */
static inline int32_t fx_per_s_from_tick(int32_t x) {
  return fx_saturate((int64_t)x * 1500, INT32_MIN, INT32_MAX);
}

/* Returns the mean change per step of a value that changes by x in n steps, n 1..256, truncated
 * towards 0. `rest` contains the remainder of the last division, within +-255, and receives the
 * remainder of this division. So the sum of all changes x is the sum of n times each mean, plus the
 * last remainder. Overflow: for n = 1 the result wraps. */
static inline int32_t fx_mean(int32_t x, int32_t n, int16_t *rest) {
  fx_assert(n >= 1 && n <= 256);
  fx_assert(*rest > -256 && *rest < 256);
  const int32_t left = x % n + *rest;
  *rest = (int16_t)(left % n);
  return fx_sum_wrap(x / n, left / n);
}

/* Returns the step with which a distance is passed in n > 0 ticks: 1/n of the distance, at most
 * `most`. Rounding: down, by less than 2^-10 count; exact for n = 1. Cannot overflow. */
static inline int32_t fx_part_q16(uint64_t d_q16, uint32_t n, int32_t most) {
  fx_assert(n > 0 && most >= 0 && d_q16 <= FX_DISTANCE_MAX_Q16);
  if (d_q16 >= (uint64_t)(uint32_t)most * n) {
    return most;
  }
  /* If the distance has more than 32 bits (it is at most 2^37), at most its lowest six bits are
   * lost. */
  return (int32_t)((d_q16 <= UINT32_MAX) ? (uint32_t)d_q16 / n : (uint32_t)(d_q16 >> 6) / n << 6);
}

/* A ratio: the number mantissa / 2^shift. The mantissa is 2^31..2^32-1, or 0 if the ratio is
 * negligible. */
typedef struct {
  uint32_t mantissa;
  uint8_t shift;
} fx_ratio_t;

/* Returns the ratio a / b * 2^e with a relative error of at most 2^-31 (floor); a > 0, b > 0, e
 * -16..16. The ratio saturates just below 2^32. The function needs some hundred instructions, so do
 * not call it in every tick; call it when a parameter is written. */
fx_ratio_t fx_ratio(uint32_t a, uint32_t b, int8_t e);

/* Returns the ratio a / b * 2^e of 64-bit numbers a and b, with a relative error of at most 2^-30;
 * e -32..32. */
fx_ratio_t fx_ratio_wide(uint64_t a, uint64_t b, int8_t e);

/* Returns x * ratio / 2^n, n 0..32. Rounding: half away from 0. Overflow: saturates to
 * +-INT32_MAX. */
static inline int32_t fx_ratio_apply(int32_t x, fx_ratio_t ratio, uint32_t n) {
  fx_assert(n <= 32);
  const uint32_t shift = (uint32_t)ratio.shift + n;
  const uint64_t product = (uint64_t)fx_magnitude(x) * ratio.mantissa;
  const uint32_t high = (uint32_t)(product >> 32);
  const uint32_t low = (uint32_t)product;
  /* Twice the product is computed, so that half a unit of the last bit can be added as an
   * integer. */
  uint32_t doubled;
  if (shift > 63) {
    return 0;
  }
  /* The shift is split into two shifts, because on some processors a 64-bit shift by a variable
   * calls a library function. */
  if (shift > 32) {
    doubled = high >> (shift - 33);
  } else if (shift == 0) {
    doubled = (high != 0 || low > (uint32_t)INT32_MAX) ? UINT32_MAX : low * 2;
  } else if (high >> (shift - 1) != 0) {
    doubled = UINT32_MAX;
  } else {
    doubled = (low >> (shift - 1)) | (high << (32 - shift) << 1);
  }
  const uint32_t size = (doubled >> 1) + (doubled & 1);
  const int32_t limited = (size > (uint32_t)INT32_MAX) ? INT32_MAX : (int32_t)size;
  return (x < 0) ? -limited : limited;
}

/* A fraction num / den in lowest terms, and approximations of this fraction and of its inverse. num
 * and den are 1..2^31-1. */
typedef struct {
  uint32_t num;
  uint32_t den;
  fx_ratio_t ratio;
  fx_ratio_t inverse;
} fx_fraction_t;

/* Computes the product of the three numbers `over`, divided by the product of the three numbers
 * `under`, as a fraction. All numbers are 1..2^31-1. If the numerator or the denominator has more
 * than 31 bits in lowest terms, returns false and does not change *fraction. The function needs
 * some thousand instructions. */
bool fx_fraction(const uint32_t over[3], const uint32_t under[3], fx_fraction_t *fraction);

/* fx_fraction_apply() returns floor(x * num / den + 1/2) exactly, and fx_fraction_invert() returns
 * floor(x * den / num + 1/2) exactly. Overflow: a result whose magnitude is INT32_MAX - 4 or more
 * becomes +-INT32_MAX. Each function needs about 35 instructions. */
int32_t fx_fraction_apply(int32_t x, const fx_fraction_t *fraction);
int32_t fx_fraction_invert(int32_t x, const fx_fraction_t *fraction);

/* Returns true if 2^-bits <= ratio < 2^(bits+1), bits 0..20. */
static inline bool fx_ratio_is_moderate(fx_ratio_t ratio, uint8_t bits) {
  fx_assert(bits <= 20);
  return ratio.shift >= 31 - bits && ratio.shift <= 31 + bits;
}

/* Returns the ratio divided by 2^n and by the number `by`; `by` > 0, n -16..16. Call this function
 * when a parameter is written, not in every tick. */
fx_ratio_t fx_ratio_divided(fx_ratio_t ratio, uint32_t by, int8_t n);

/* Converts an ADC code to per mille of the range of the ADC: code * 1000 / 2^bits, bits 0..16.
 * Rounding: down. Cannot overflow. */
static inline int16_t fx_per_mille_of_bits(uint16_t code, uint8_t bits) {
  fx_assert(bits <= 16);
  const uint32_t share = ((uint32_t)code * 1000) >> bits;
  return (int16_t)((share > INT16_MAX) ? INT16_MAX : share);
}

/* Returns the largest code of an ADC with `bits` bits: 2^bits - 1, bits 0..16. */
static inline uint16_t fx_highest_code(uint8_t bits) {
  fx_assert(bits <= 16);
  return (uint16_t)(((uint32_t)1 << bits) - 1);
}

/* Rounding modes of fx_interpolate(): towards minus infinity, towards plus infinity, or half up. */
enum { FX_ROUND_DOWN = 0, FX_ROUND_UP = 1, FX_ROUND_HALF_UP = 2 };

/* Returns y at x on the line through (x0, y0) and (x1, y1): y0 + (y1 - y0) (x - x0) / (x1 - x0),
 * rounded once. x is between x0 and x1. The difference of x0 and x1 is 1 to 2^31-1; |y0|, |y1| <=
 * 2^30. Cannot overflow. */
int32_t fx_interpolate(int32_t x0, int32_t y0, int32_t x1, int32_t y1, int32_t x, uint8_t rounding);

/* Returns the same result as fx_interpolate() with FX_ROUND_HALF_UP, in some 25 instructions.
 * Domain: x0 <= x <= x1, x1 - x0 is 1 to 2^19-1, and |y1 - y0| < 2^24. */
static inline int32_t fx_interpolate_short(int32_t x0, int32_t y0, int32_t x1, int32_t y1,
                                           int32_t x) {
  fx_assert(x0 <= x && x <= x1 && x0 < x1 && x1 - x0 < 524288);
  fx_assert(fx_magnitude(y1 - y0) < 16777216);
  const uint32_t length = (uint32_t)(x1 - x0);
  const uint32_t part = (uint32_t)(x - x0);
  const bool falls = y1 < y0;
  const uint32_t size = fx_magnitude(y1 - y0);
  /* The product is computed in two parts of 12 bits each, so that no number has more than 32 bits:
   * `high` is below 2^31, and the last sum is below 8192 times `length`. If the line falls, the
   * quotient is subtracted, so a half is then rounded down. */
  const uint32_t high = (size >> 12) * part;
  const uint32_t half = (length - (falls ? 1 : 0)) >> 1;
  const uint32_t low = ((high % length) << 12) + (size & 4095) * part + half;
  const int32_t change = (int32_t)(((high / length) << 12) + low / length);
  return falls ? y0 - change : y0 + change;
}

/* Returns floor(n / 2). */
static inline uint16_t fx_half(uint32_t n) { return (uint16_t)(n >> 1); }

/* Returns floor(x / 2^n), n 0..15. */
static inline uint16_t fx_halved(uint16_t x, uint8_t n) {
  fx_assert(n <= 15);
  return (uint16_t)(x >> n);
}

/* Returns floor(a / b), b > 0. */
uint32_t fx_quotient(uint32_t a, uint32_t b);

/* Returns the mean of n values whose sum is `sum`: floor(sum / n + 1/2), n 1..16383, |sum| <= 2^17
 * n. */
int32_t fx_mean_half_up(int32_t sum, uint32_t n);

#endif
