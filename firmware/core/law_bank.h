#ifndef FIRMWARE_CORE_LAW_BANK_H_
#define FIRMWARE_CORE_LAW_BANK_H_

/* Banks: sets of coefficients of the force law, written value by value, checked as a whole and then
 * selected by force_bank. The bank that is selected is not written, so another one is the shadow in
 * which a design is prepared; one that was written in part cannot be selected, because its CRC does
 * not fit. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/objects/generated/axis_objects.h"

typedef struct {
  law_params_t params;
  law_signals_t signals;
} law_banks_t;

/* One code of the force ADC moves the output by at most this many codes at high frequency. A law
 * with more turns the quantisation of the reading into a limit cycle. */
enum { LAW_BANK_HF_CODES_MAX = 15 };

/* All empty, none selected. */
void law_banks_init(law_banks_t *banks);

/* CRC-32 of a bank (0..3): each value but the CRC as a 32-bit word, least significant byte first,
 * in the order of the sub-indices. */
uint32_t law_bank_crc(const law_params_t *params, uint8_t bank);

/* What a bank (0..3) is for an ADC of `adc_bits`, AXIS_BANK_STATE_: the first that applies of
 *   empty       every value is 0
 *   wrong_crc   the values are not those that the CRC is of
 *   unstable    poles of a section on the unit circle or outside: not |a1| < 1 + a2, |a2| < 1
 *   wrong_sign  the gain of a section at frequency 0 is not positive: the integral would run away
 *   hf_gain     gain times |H| at half the tick rate, or times b0 of all sections, times the size
 *               of an ADC code, is above LAW_BANK_HF_CODES_MAX
 *   valid */
uint8_t law_bank_state(const law_params_t *params, uint8_t bank, uint8_t adc_bits);

/* Whether a value within its range may be written to an object of the banks: FW_OK, or
 * FW_ERROR_STATE for the bank that is selected, and for a selection of one that is not valid. */
int law_banks_check(const law_banks_t *banks, uint16_t object, int32_t value);

/* The object was written: its bank is checked, a selected one is put in force. */
void law_banks_written(law_banks_t *banks, axis_t *axis, uint16_t object);

/* Stored values were loaded: all banks are checked, and the selected one is put in force; one that
 * is not valid is replaced by a law that puts out 0. False: it is not valid. */
bool law_banks_loaded(law_banks_t *banks, axis_t *axis);

/* Whether the selected bank bears an ADC of `adc_bits`; and what each bank is with one from now on.
 */
bool law_banks_fit(const law_banks_t *banks, uint8_t adc_bits);
void law_banks_set_adc(law_banks_t *banks, uint8_t adc_bits);

#endif
