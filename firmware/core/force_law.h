#ifndef FIRMWARE_CORE_FORCE_LAW_H_
#define FIRMWARE_CORE_FORCE_LAW_H_

/* The general force law. A filter bank (law_bank.h) contains the coefficients of this law:
 *
 *   y = H(z) (f_d - f)                  H: up to three second-order sections in series
 *   u = k_f y + i - k_v v               i grows by w k_f y in each tick; v in counts per tick
 *
 * f_d is the force set-point, f the measured force and u the command. Without sections and without
 * integral action the codes of the general law equal the codes of law_force().
 *
 * Formats: y has 16 fractional bits and is limited to +-2^14 counts. The coefficients have 26
 * fractional bits and are limited to +-2^4. A section is computed in direct form I. The sum of five
 * products, each below 2^60, and of a remainder below 2^26 has at most 64 bits. The rounding
 * remainder of the output of a section is added in the next tick. So the output of a section whose
 * input is 0 settles within 1/1024 count of 0. */

#include <stdbool.h>
#include <stdint.h>

/* Version of the force law. Increase this version with every change of this firmware that makes the
 * force law compute other DAC codes from the same filter bank. */
enum { FORCE_LAW_VERSION = 1 };

enum { FORCE_LAW_BANKS = 4, FORCE_LAW_SECTIONS = 3, FORCE_LAW_COEFFICIENTS = 5 };

typedef struct {
  /* coefficients b0, b1, b2, a1, a2 of each second-order section */
  int32_t coefficient_q26[FORCE_LAW_SECTIONS][FORCE_LAW_COEFFICIENTS];
  /* integral rate w of the filter bank in 1/tick, at most 1 */
  uint32_t integral_q26;
  uint16_t gain_q8;
  uint16_t velocity_gain_q8;
  uint8_t sections;
} force_bank_t;

typedef struct {
  /* inputs x and outputs y of the section in the two previous ticks, in 1/65536 count; the newer
   * value is first */
  int32_t x[2];
  int32_t y[2];
  uint32_t remainder_q26; /* rounding remainder of the last output of the section, in 2^-42 count */
} force_section_t;

typedef struct {
  force_bank_t bank;
  force_section_t sections[FORCE_LAW_SECTIONS];
  int32_t integral_q16;            /* integral in 1/65536 code */
  uint32_t integral_remainder_q26; /* rounding remainder of the integral, in 2^-42 code */
  /* number of the selected filter bank; with 0 the force law is law_force() with force_gain */
  uint8_t selected;
  /* number of times that the contact guard halved the active gain; each halved gain is rounded
   * down */
  uint8_t halvings;
  /* gain of the filter bank before the contact guard halved it, in 1/256 code per count */
  uint16_t whole_gain_q8;
} force_law_t;

/* Conditions of the force law in one tick. `begins` is true in the first tick of the law. In this
 * tick each section whose gain at frequency 0 is 1 starts in the steady state for the present force
 * error, and the integral keeps its value. If `up` is true, the integral may rise, and if `down` is
 * true, it may fall. */
typedef struct {
  bool begins;
  bool up;
  bool down;
} force_law_tick_t;

/* Computes one tick of the force law. Returns the command in 1/65536 DAC code. Like the laws of
 * laws.h, the command is limited to one code beyond the range of the DAC. */
int32_t force_law_step(force_law_t *law, int32_t error_q8, int32_t velocity_cnt,
                       force_law_tick_t tick);

#endif
