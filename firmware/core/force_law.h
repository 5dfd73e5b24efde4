#ifndef FIRMWARE_CORE_FORCE_LAW_H_
#define FIRMWARE_CORE_FORCE_LAW_H_

/* The general force law, whose coefficients are one bank (law_bank.h):
 *
 *   y = H(z) (f_d - f)                  H: up to three sections of second order, in series
 *   u = k_f y + i - k_v v               i grows by w k_f y a tick; v in counts per tick
 *
 * Without sections and integral these are the codes of law_force(), bit for bit.
 *
 * Formats: y has 16 fractional bits and stays within +-2^14 counts, coefficients have 26 and stay
 * within +-2^4. A section is direct form I: five products below 2^60 and a remainder below 2^26,
 * whose sum fits in 64 bits. What the rounding of a section's output drops is added in the next
 * tick, so that a section without input comes to rest within 1/1024 count of 0. */

#include <stdbool.h>
#include <stdint.h>

enum { FORCE_LAW_BANKS = 4, FORCE_LAW_SECTIONS = 3, FORCE_LAW_COEFFICIENTS = 5 };

typedef struct {
  int32_t coefficient_q26[FORCE_LAW_SECTIONS][FORCE_LAW_COEFFICIENTS]; /* b0, b1, b2, a1, a2 */
  uint32_t integral_q26;                                               /* w, 1/tick, at most 1 */
  uint16_t gain_q8;
  uint16_t velocity_gain_q8;
  uint8_t sections;
} force_bank_t;

typedef struct {
  int32_t x[2]; /* inputs and outputs of the two ticks before, the later one first, Q16 */
  int32_t y[2];
  uint32_t remainder_q26; /* what the last output dropped, in 1/65536 count */
} force_section_t;

typedef struct {
  force_bank_t bank;
  force_section_t sections[FORCE_LAW_SECTIONS];
  int32_t integral_q16;            /* code */
  uint32_t integral_remainder_q26; /* what its rounding dropped, in 1/65536 code */
  uint8_t selected;                /* number of the bank, 0: law_force() with force_gain */
  uint8_t halvings;                /* of the gain in force, rounded down */
  uint16_t whole_gain_q8;          /* of the bank, while it is halved */
} force_law_t;

/* What a tick is to the law. `begins`: the error has been this one for ever, so a section whose
 * gain at frequency 0 is 1 is at rest; the integral is kept. `up`, `down`: where the integral may
 * grow. */
typedef struct {
  bool begins;
  bool up;
  bool down;
} force_law_tick_t;

/* One tick: the command in 1/65536 code, limited as those of laws.h. */
int32_t force_law_step(force_law_t *law, int32_t error_q8, int32_t velocity_cnt,
                       force_law_tick_t tick);

#endif
