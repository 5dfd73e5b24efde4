#ifndef FIRMWARE_APP_LAW_H_
#define FIRMWARE_APP_LAW_H_

/* The objects of the force law for the dictionary: its banks and their certificates. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw.h"

/* Functions that the dictionary calls for the objects of the force law. */
int law_check(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);
void law_written(dictionary_t *objects, uint8_t source, uint16_t object, int32_t previous,
                 int32_t value);

/* Updates the force law after a write to adc_bits. */
void law_adc_written(fw_t *fw);

/* Compares the certificates with the present settings; without a matching certificate the drive
 * restricts the force law. Call it after a write to any object on which a certificate depends. */
void law_certify(fw_t *fw);

/* Updates the force law after the load of stored values; returns false if the selected bank is not
 * valid. */
bool law_loaded(fw_t *fw);

#endif
