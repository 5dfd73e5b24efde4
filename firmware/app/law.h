#ifndef FIRMWARE_APP_LAW_H_
#define FIRMWARE_APP_LAW_H_

/* Functions for the objects of the force law in the object dictionary: the filter banks and the
 * certificates of the banks. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw_state.h"

/* The dictionary calls law_check() before and law_written() after a write to an object of the force
 * law. */
int law_check(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);
void law_written(dictionary_t *objects, uint8_t source, uint16_t object, int32_t previous,
                 int32_t value);

/* Updates the force law after a write to adc_bits. */
void law_adc_written(fw_t *fw);

/* Compares the certificates of the filter banks with the present settings. If there is no matching
 * certificate, the drive restricts the force law. Call law_certify() after a write to any object on
 * which a certificate depends. */
void law_certify(fw_t *fw);

/* Updates the force law after the stored parameters were loaded. Returns false if the selected
 * filter bank is not valid. */
bool law_loaded(fw_t *fw);

#endif
