#ifndef FIRMWARE_CORE_LAWS_H_
#define FIRMWARE_CORE_LAWS_H_

/* The control laws. Each law is a function without state that computes one command from values in
 * counts.
 *
 * A law returns its command in 1/65536 DAC code without rounding. The command is limited to
 * LAW_MIN_Q16..LAW_MAX_Q16, one code beyond the range of the DAC on either side. So the command
 * needs at most 32 bits, and limits_apply() still detects a command outside the range of the
 * DAC. */

#include <stdint.h>

#include "firmware/fx/fx.h"

#define LAW_DAC_MIN (-2048)
#define LAW_DAC_MAX 2047
#define LAW_MIN_Q8 (-INT32_C(2049) * 256)
#define LAW_MAX_Q8 (INT32_C(2048) * 256)
#define LAW_MIN_Q16 (LAW_MIN_Q8 * 256)
#define LAW_MAX_Q16 (LAW_MAX_Q8 * 256)

/* Largest magnitude of the position error, in counts, that the position law uses. A larger error
 * acts like this value (thesis 1.1.2, Fig 1.2). */
#define LAW_POSITION_ERROR_MAX 32767

/* Computes the measured force f = sign (adc - zero) - tare, in 1/256 of an 8-bit count for every
 * width of the ADC. One code of an ADC with n bits is 2^(16-n) units of 1/256 count. Ranges: adc
 * and zero 0..65535, sign +1 or -1, bits 8..16, tare within +-65536. The result is exact and within
 * +-2^25. */
static inline int32_t law_force_reading(uint16_t adc_code, uint16_t zero_code, int8_t sign,
                                        uint8_t adc_bits, int32_t tare_q8) {
  fx_assert((sign == 1 || sign == -1) && adc_bits >= 8 && adc_bits <= 16);
  fx_assert(tare_q8 >= -65536 * 256 && tare_q8 <= 65536 * 256);
  const int32_t above_zero = (int32_t)adc_code - (int32_t)zero_code;
  const int32_t signed_code = above_zero * (int32_t)sign;
  return fx_scale(signed_code, (uint32_t)16 - (uint32_t)adc_bits) - tare_q8;
}

/* Explicit force control (thesis Fig 1.3): u = k_f (f_d - f). The gain is in 1/256 code per count,
 * the forces are in 1/256 count, and |f_d - f| is below 2^31. The result is exact within
 * LAW_MIN_Q16..LAW_MAX_Q16 and saturates outside this range. */
static inline int32_t law_force(uint16_t gain_q8, int32_t setpoint_q8, int32_t force_q8) {
  fx_assert((int64_t)setpoint_q8 - force_q8 >= -INT32_MAX &&
            (int64_t)setpoint_q8 - force_q8 <= INT32_MAX);
  const int64_t u_q16 = fx_mul((int32_t)gain_q8, setpoint_q8 - force_q8);
  return fx_saturate(u_q16, LAW_MIN_Q16, LAW_MAX_Q16);
}

/* PD position control (thesis Fig 1.2): u = k_p e - k_d v. The position error e, in counts, is the
 * difference of two positions modulo 2^32, limited to +-LAW_POSITION_ERROR_MAX. The velocity v is
 * in counts per tick. k_p is in 1/256 code per count, k_d in 1/256 code per count/tick. The result
 * is exact within LAW_MIN_Q16..LAW_MAX_Q16 and saturates outside this range. */
static inline int32_t law_position(uint16_t position_gain_q8, uint16_t velocity_gain_q8,
                                   int32_t error_cnt, int32_t velocity_cnt) {
  const int32_t e = fx_clamp(error_cnt, -LAW_POSITION_ERROR_MAX, LAW_POSITION_ERROR_MAX);
  const int64_t u_q8 =
      fx_mul((int32_t)position_gain_q8, e) - fx_mul((int32_t)velocity_gain_q8, velocity_cnt);
  return fx_scale(fx_saturate(u_q8, LAW_MIN_Q8, LAW_MAX_Q8), 8);
}

/* Open loop: returns the given DAC code, -2048..2047, as the command. */
static inline int32_t law_open_loop(int16_t code) {
  fx_assert(code >= LAW_DAC_MIN && code <= LAW_DAC_MAX);
  return fx_scale(code, 16);
}

/* Excitation: returns `code` + `amplitude` * `wave` as the command. `amplitude` is 0..2048 codes,
 * `wave` -32768..32767 in Q15. The result is exact within LAW_MIN_Q16..LAW_MAX_Q16 and saturates
 * outside this range. */
static inline int32_t law_excitation(int16_t code, uint16_t amplitude, int32_t wave_q15) {
  fx_assert(amplitude <= 2048 && wave_q15 >= INT16_MIN && wave_q15 <= INT16_MAX);
  const int32_t swing_q16 = fx_scale((int32_t)amplitude * wave_q15, 1);
  return fx_clamp(law_open_loop(code) + swing_q16, LAW_MIN_Q16, LAW_MAX_Q16);
}

#endif
