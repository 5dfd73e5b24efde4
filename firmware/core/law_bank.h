#ifndef FIRMWARE_CORE_LAW_BANK_H_
#define FIRMWARE_CORE_LAW_BANK_H_

/* Filter banks are stored settings of the force law. A master writes a bank value by value. Then
 * the firmware checks the complete bank, and force_bank selects the bank. The selected bank cannot
 * be written, so a master writes a new design to another bank. A bank that was not written
 * completely cannot be selected, because its CRC is wrong. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/objects/generated/axis_objects_law.h"

typedef struct {
  law_params_t params;
  law_signals_t signals;
} law_banks_t;

/* Largest permitted change of the output at high frequency, in DAC codes, when the code of the
 * force ADC changes by one. If the output changed more, the quantisation of the measured force
 * would cause a limit cycle. */
enum { LAW_BANK_HF_CODES_MAX = 15 };

/* Clears all filter banks. No bank is then selected. */
void law_banks_init(law_banks_t *banks);

/* Computes the CRC-32 of filter bank 0..3. The CRC covers all values of the bank except bank_crc,
 * in the order of the sub-indices. Each value is a 32-bit word, least significant byte first. */
uint32_t law_bank_crc(const law_params_t *params, uint8_t bank);

/* Returns the state (AXIS_BANK_STATE_) of bank 0..3 for an ADC with `adc_bits` bits. The first
 * condition that is true determines the state:
 *   empty       every value is 0
 *   wrong_crc   bank_crc is not the CRC of the values
 *   unstable    a section has a pole on or outside the unit circle; a stable section has
 *               |a1| < 1 + a2 and |a2| < 1
 *   wrong_sign  the gain of a section at frequency 0 is not positive, so the integral would diverge
 *   hf_gain     the output changes by more than LAW_BANK_HF_CODES_MAX for one ADC code: either
 *               gain times |H| at half the tick rate, or gain times b0 of all sections
 *   valid       none of these conditions */
uint8_t law_bank_state(const law_params_t *params, uint8_t bank, uint8_t adc_bits);

/* Checks whether a value may be written to an object of the filter banks. The value is within the
 * range of the object. Returns FW_OK. Returns FW_ERROR_STATE if the object belongs to the selected
 * bank, or if the value selects a bank that is not valid. */
int law_banks_check(const law_banks_t *banks, uint16_t object, int32_t value);

/* Reacts to a write to an object of the filter banks: checks the bank to which the object belongs,
 * and makes a newly selected bank the active force law. */
void law_banks_written(law_banks_t *banks, axis_t *axis, uint16_t object);

/* Reacts to the load of stored values: checks all filter banks and makes the selected bank the
 * active force law. If the selected bank is not valid, returns false, and the active force law then
 * gives the output 0. */
bool law_banks_loaded(law_banks_t *banks, axis_t *axis);

/* Returns true if the selected filter bank is valid for an ADC with `adc_bits` bits. Also updates
 * the states of all banks for this ADC. */
bool law_banks_fit(const law_banks_t *banks, uint8_t adc_bits);
void law_banks_set_adc(law_banks_t *banks, uint8_t adc_bits);

#endif
