#ifndef FIRMWARE_CORE_LAW_BANK_H_
#define FIRMWARE_CORE_LAW_BANK_H_

/* Banks: sets of coefficients of the force law. A master writes a bank value by value; the firmware
 * then checks the complete bank, and force_bank selects it. The selected bank cannot be written, so
 * a new design is written to another bank. A bank that was written only in part cannot be selected,
 * because its CRC is wrong. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/objects/generated/axis_objects.h"

typedef struct {
  law_params_t params;
  law_signals_t signals;
} law_banks_t;

/* Largest change of the output at high frequency, in DAC codes, that one code of the force ADC may
 * cause. With a larger change, the quantisation of the measured force would cause a limit cycle. */
enum { LAW_BANK_HF_CODES_MAX = 15 };

/* Clears all banks and selects no bank. */
void law_banks_init(law_banks_t *banks);

/* Computes the CRC-32 of bank 0..3. Each value of the bank except the CRC is used as a 32-bit word,
 * least significant byte first, in the order of the sub-indices. */
uint32_t law_bank_crc(const law_params_t *params, uint8_t bank);

/* Returns the state of bank 0..3 for an ADC with `adc_bits` bits, AXIS_BANK_STATE_. The first
 * condition that is true decides:
 *   empty       every value is 0
 *   wrong_crc   the CRC is not that of the values
 *   unstable    a section has a pole on or outside the unit circle: not |a1| < 1 + a2, |a2| < 1
 *   wrong_sign  the gain of a section at frequency 0 is not positive: the integral would diverge
 *   hf_gain     gain times |H| at half the tick rate, or times b0 of all sections, times the size
 *               of an ADC code, is above LAW_BANK_HF_CODES_MAX
 *   valid       none of these */
uint8_t law_bank_state(const law_params_t *params, uint8_t bank, uint8_t adc_bits);

/* Whether a value within its range may be written to an object of the banks. Returns FW_OK; returns
 * FW_ERROR_STATE if the object belongs to the selected bank, or if the write would select a bank
 * that is not valid. */
int law_banks_check(const law_banks_t *banks, uint16_t object, int32_t value);

/* Acts on a write to an object of the banks: checks the bank of the object, and makes a newly
 * selected bank the active force law. */
void law_banks_written(law_banks_t *banks, axis_t *axis, uint16_t object);

/* Acts on the load of stored values: checks all banks and makes the selected bank the active force
 * law. If the selected bank is not valid, a law with the output 0 becomes active and the function
 * returns false. */
bool law_banks_loaded(law_banks_t *banks, axis_t *axis);

/* Whether the selected bank is valid for an ADC with `adc_bits` bits. Also updates the states of
 * all banks for this ADC. */
bool law_banks_fit(const law_banks_t *banks, uint8_t adc_bits);
void law_banks_set_adc(law_banks_t *banks, uint8_t adc_bits);

#endif
