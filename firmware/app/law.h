#ifndef FIRMWARE_APP_LAW_H_
#define FIRMWARE_APP_LAW_H_

/* The objects of the force law, for the dictionary: its banks and their certificates. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw.h"

/* The callbacks of the block. */
int law_check(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);
void law_written(dictionary_t *objects, uint8_t source, uint16_t object, int32_t previous,
                 int32_t value);

/* adc_bits was written. */
void law_adc_written(fw_t *fw);

/* Judges the certificates; without one the drive restricts the force law. To be called when
 * anything was written that they depend on. */
void law_certify(fw_t *fw);

/* Stored values were loaded; false: the selected bank is not valid. */
bool law_loaded(fw_t *fw);

#endif
