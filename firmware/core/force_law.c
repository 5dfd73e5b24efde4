#include "firmware/core/force_law.h"

#include "firmware/core/laws.h"
#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"

#define ONE_Q26 INT32_C(67108864)
/* largest magnitude of a signal of the force law: 2^14 counts of force, or 2^14 DAC codes */
#define SIGNAL_MAX_Q16 INT32_C(1073741824)

static int32_t section_step(const int32_t coefficient_q26[FORCE_LAW_COEFFICIENTS],
                            force_section_t *section, int32_t x) {
  const int64_t sum_q42 =
      fx_mul(coefficient_q26[0], x) + fx_mul(coefficient_q26[1], section->x[0]) +
      fx_mul(coefficient_q26[2], section->x[1]) - fx_mul(coefficient_q26[3], section->y[0]) -
      fx_mul(coefficient_q26[4], section->y[1]) + section->remainder_q26;
  const int64_t floor_q16 = fx_floor_shift_wide(sum_q42, 26);
  const int32_t y = fx_saturate(floor_q16, -SIGNAL_MAX_Q16, SIGNAL_MAX_Q16);
  section->remainder_q26 = (y == floor_q16) ? fx_field((uint32_t)sum_q42, 0, 26) : 0;
  section->x[1] = section->x[0];
  section->x[0] = x;
  section->y[1] = section->y[0];
  section->y[0] = y;
  return y;
}

/* Sets a second-order section to its steady state for the constant input x. */
static void settle(force_section_t *section, int32_t x) {
  section->x[0] = x;
  section->x[1] = x;
  section->y[0] = x;
  section->y[1] = x;
  section->remainder_q26 = 0;
}

static void begin(force_law_t *law, int32_t x) {
  /* A comment with @ is a contract in ACSL, for the proof by Frama-C in tests/firmware/proof. */
  /*@ loop invariant 0 <= i <= law->bank.sections && legal_sections(law);
      loop assigns i, law->sections[0 .. 2]; */
  for (uint8_t i = 0; i < law->bank.sections; i++) {
    settle(&law->sections[i], x);
  }
}

static void integrate(force_law_t *law, int32_t proportional_q16) {
  const int64_t sum_q42 = (int64_t)law->integral_q16 * ONE_Q26 + law->integral_remainder_q26 +
                          (int64_t)law->bank.integral_q26 * proportional_q16;
  const int64_t floor_q16 = fx_floor_shift_wide(sum_q42, 26);
  const int32_t limited_q16 = fx_saturate(floor_q16, LAW_MIN_Q16, LAW_MAX_Q16);
  law->integral_q16 = limited_q16;
  law->integral_remainder_q26 = (limited_q16 == floor_q16) ? fx_field((uint32_t)sum_q42, 0, 26) : 0;
}

int32_t force_law_step(force_law_t *law, int32_t error_q8, int32_t velocity_cnt,
                       force_law_tick_t tick) {
  const force_bank_t *bank = &law->bank;
  int32_t y = fx_saturate((int64_t)error_q8 * 256, -SIGNAL_MAX_Q16, SIGNAL_MAX_Q16);
  if (tick.begins) {
    begin(law, y);
  }
  /*@ loop invariant 0 <= i <= bank->sections && legal_sections(law) && bounded(y);
      loop assigns i, y, law->sections[0 .. 2]; */
  for (uint8_t i = 0; i < bank->sections; i++) {
    y = section_step(bank->coefficient_q26[i], &law->sections[i], y);
  }
  const int32_t proportional_q16 = fx_saturate(fx_floor_shift_wide(fx_mul(bank->gain_q8, y), 8),
                                               -SIGNAL_MAX_Q16, SIGNAL_MAX_Q16);
  if ((proportional_q16 > 0) ? tick.up : tick.down) {
    integrate(law, proportional_q16);
  }
  fx_assert(law->integral_q16 >= LAW_MIN_Q16 && law->integral_q16 <= LAW_MAX_Q16 &&
            bank->sections <= FORCE_LAW_SECTIONS);
  const int64_t damping_q16 = fx_mul(bank->velocity_gain_q8, velocity_cnt) * 256;
  return fx_saturate((int64_t)proportional_q16 + law->integral_q16 - damping_q16, LAW_MIN_Q16,
                     LAW_MAX_Q16);
}
