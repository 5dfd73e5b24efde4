#include "firmware/core/law_bank.h"

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/access.h"
#include "firmware/objects/value.h"

#define ONE_Q26 INT32_C(67108864)

enum { COEFFICIENTS = FORCE_LAW_SECTIONS * FORCE_LAW_COEFFICIENTS };

static const int32_t *coefficients_of(const law_params_t *params, uint8_t bank) {
  return &params->bank_coefficient[bank * COEFFICIENTS];
}

uint32_t law_bank_crc(const law_params_t *params, uint8_t bank) {
  uint32_t crc = fx_crc32_word(UINT32_MAX, params->bank_sections[bank]);
  crc = fx_crc32_word(crc, params->bank_gain[bank]);
  crc = fx_crc32_word(crc, params->bank_velocity_gain[bank]);
  crc = fx_crc32_word(crc, params->bank_integral[bank]);
  for (uint8_t i = 0; i < COEFFICIENTS; i++) {
    crc = fx_crc32_word(crc, (uint32_t)coefficients_of(params, bank)[i]);
  }
  return ~crc;
}

static bool is_empty(const law_params_t *params, uint8_t bank) {
  uint32_t bits = params->bank_sections[bank] | params->bank_gain[bank] |
                  params->bank_velocity_gain[bank] | params->bank_integral[bank] |
                  params->bank_crc[bank];
  for (uint8_t i = 0; i < COEFFICIENTS; i++) {
    bits |= (uint32_t)coefficients_of(params, bank)[i];
  }
  return bits == 0;
}

/* Returns true if both poles of a second-order section are inside the unit circle, which means that
 * a1 and a2 are inside the stability triangle. */
static bool is_stable(const int32_t section[FORCE_LAW_COEFFICIENTS]) {
  const int32_t a1 = section[3];
  const int32_t a2 = section[4];
  return a2 > -ONE_Q26 && a2 < ONE_Q26 && fx_magnitude(a1) < (uint32_t)(ONE_Q26 + a2);
}

/* Returns the product of a gain and a / b. The gain and the product are in Q16 DAC codes per
 * count. */
static int32_t times(int32_t gain_q16, uint32_t a, uint32_t b) {
  return (a == 0) ? 0 : fx_ratio_apply(gain_q16, fx_ratio(a, b, 0), 0);
}

static bool is_too_steep(const law_params_t *params, uint8_t bank, uint8_t adc_bits) {
  int32_t direct_q16 = fx_scale(params->bank_gain[bank], 8);
  int32_t highest_q16 = direct_q16;
  for (uint8_t i = 0; i < params->bank_sections[bank]; i++) {
    const int32_t *c = &coefficients_of(params, bank)[i * FORCE_LAW_COEFFICIENTS];
    direct_q16 = times(direct_q16, fx_magnitude(c[0]), (uint32_t)ONE_Q26);
    /* At half the tick rate z is -1, so H is computed there from the sums of coefficients with
     * alternating signs. |b0| + |b1| + |b2| <= 3 * 2^30 needs at most 32 bits. */
    const int64_t above = (int64_t)c[0] - c[1] + c[2];
    highest_q16 = times(highest_q16, (uint32_t)((above < 0) ? -above : above),
                        (uint32_t)(ONE_Q26 - c[3] + c[4]));
  }
  /* One count is one code of an ADC with 8 bits. One code of an ADC with n bits is 2^(8 - n)
   * counts. */
  const int32_t most_q16 = fx_scale(LAW_BANK_HF_CODES_MAX, (uint32_t)adc_bits + 8);
  return direct_q16 > most_q16 || highest_q16 > most_q16;
}

uint8_t law_bank_state(const law_params_t *params, uint8_t bank, uint8_t adc_bits) {
  if (is_empty(params, bank)) {
    return AXIS_BANK_STATE_EMPTY;
  }
  if (law_bank_crc(params, bank) != params->bank_crc[bank]) {
    return AXIS_BANK_STATE_WRONG_CRC;
  }
  for (uint8_t i = 0; i < params->bank_sections[bank]; i++) {
    const int32_t *c = &coefficients_of(params, bank)[i * FORCE_LAW_COEFFICIENTS];
    if (!is_stable(c)) {
      return AXIS_BANK_STATE_UNSTABLE;
    }
    if ((int64_t)c[0] + c[1] + c[2] <= 0) {
      return AXIS_BANK_STATE_WRONG_SIGN;
    }
  }
  return is_too_steep(params, bank, adc_bits) ? AXIS_BANK_STATE_HF_GAIN : AXIS_BANK_STATE_VALID;
}

/* Returns the number (0..3) of the filter bank to which an object belongs, or -1. */
static int bank_of(uint16_t object) {
  enum { SCALARS = 5 };
  static const uint16_t first[SCALARS] = {AXIS_OBJ_BANK_SECTIONS_1, AXIS_OBJ_BANK_GAIN_1,
                                          AXIS_OBJ_BANK_VELOCITY_GAIN_1, AXIS_OBJ_BANK_INTEGRAL_1,
                                          AXIS_OBJ_BANK_CRC_1};
  for (uint8_t i = 0; i < SCALARS; i++) {
    if (object >= first[i] && object < first[i] + FORCE_LAW_BANKS) {
      return object - first[i];
    }
  }
  if (object >= AXIS_OBJ_BANK_COEFFICIENT_1 && object <= AXIS_OBJ_BANK_COEFFICIENT_60) {
    return (int)fx_quotient((uint32_t)(object - AXIS_OBJ_BANK_COEFFICIENT_1), COEFFICIENTS);
  }
  return -1;
}

int law_banks_check(const law_banks_t *banks, uint16_t object, int32_t value) {
  const uint8_t selected = banks->params.force_bank;
  bool fits;
  if (object == AXIS_OBJ_FORCE_BANK) {
    fits = value == 0 || banks->signals.bank_state[value - 1] == AXIS_BANK_STATE_VALID;
  } else {
    const int bank = bank_of(object);
    fits = bank < 0 || bank != selected - 1;
  }
  return fits ? FW_OK : FW_ERROR_STATE;
}

bool law_banks_fit(const law_banks_t *banks, uint8_t adc_bits) {
  const uint8_t selected = banks->params.force_bank;
  return selected == 0 || !is_too_steep(&banks->params, (uint8_t)(selected - 1), adc_bits);
}

void law_banks_set_adc(law_banks_t *banks, uint8_t adc_bits) {
  for (uint8_t i = 0; i < FORCE_LAW_BANKS; i++) {
    uint8_t *state = &banks->signals.bank_state[i];
    if (*state == AXIS_BANK_STATE_VALID || *state == AXIS_BANK_STATE_HF_GAIN) {
      *state = is_too_steep(&banks->params, i, adc_bits) ? AXIS_BANK_STATE_HF_GAIN
                                                         : AXIS_BANK_STATE_VALID;
    }
  }
}

/* Copies the selected filter bank into the force law. The values are copied one by one, because the
 * compiler would call a library function to copy the complete structure. */
static void put_in_force(const law_banks_t *banks, axis_t *axis, bool valid) {
  const law_params_t *params = &banks->params;
  const uint8_t number = params->force_bank;
  const uint8_t bank = (uint8_t)(number - 1);
  force_bank_t *law = &axis->law.bank;
  if (number == 0 || !valid) {
    law->sections = 0;
    law->gain_q8 = 0;
    law->velocity_gain_q8 = 0;
    law->integral_q26 = 0;
  } else {
    law->sections = params->bank_sections[bank];
    law->gain_q8 = params->bank_gain[bank];
    law->velocity_gain_q8 = params->bank_velocity_gain[bank];
    law->integral_q26 = params->bank_integral[bank];
    const int32_t *from = coefficients_of(params, bank);
    for (uint8_t i = 0; i < FORCE_LAW_SECTIONS; i++) {
      for (uint8_t k = 0; k < FORCE_LAW_COEFFICIENTS; k++) {
        law->coefficient_q26[i][k] = *from++;
      }
    }
  }
  axis_bank_selected(axis, number);
}

void law_banks_written(law_banks_t *banks, axis_t *axis, uint16_t object) {
  const uint8_t adc_bits = axis->params.adc_bits;
  if (object == AXIS_OBJ_FORCE_BANK) {
    put_in_force(banks, axis, true);
    return;
  }
  const int bank = bank_of(object);
  if (bank >= 0) {
    banks->signals.bank_state[bank] = law_bank_state(&banks->params, (uint8_t)bank, adc_bits);
  }
}

bool law_banks_loaded(law_banks_t *banks, axis_t *axis) {
  const uint8_t adc_bits = axis->params.adc_bits;
  for (uint8_t i = 0; i < FORCE_LAW_BANKS; i++) {
    banks->signals.bank_state[i] = law_bank_state(&banks->params, i, adc_bits);
  }
  const uint8_t selected = banks->params.force_bank;
  const bool valid =
      selected == 0 || banks->signals.bank_state[selected - 1] == AXIS_BANK_STATE_VALID;
  put_in_force(banks, axis, valid);
  return valid;
}

void law_banks_init(law_banks_t *banks) {
  value_store_defaults(&banks->params, AXIS_BLOCK_LAW_PARAMETER);
  value_store_defaults(&banks->signals, AXIS_BLOCK_LAW_SIGNAL);
}
