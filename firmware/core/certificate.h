#ifndef FIRMWARE_CORE_CERTIFICATE_H_
#define FIRMWARE_CORE_CERTIFICATE_H_

/* The certificate of a filter bank of the force law. The certificate states the conditions for
 * which the bank was designed. The tool that designed the bank writes the certificate. After each
 * write to the bank or to the parameters of the force sensor, the firmware computes the certificate
 * that this bank, this sensor and the force law require. No certificate is computed in a tick.
 *
 * certificate_hash is the CRC-32 of five 32-bit words, least significant byte first: bank_crc,
 * adc_bits, force_scale, FORCE_LAW_VERSION, AXIS_LAW_SIGNATURE. AXIS_LAW_SIGNATURE is a hash of the
 * name, type, unit and scale of each object that the force law computes with. A new object that the
 * law does not use therefore invalidates no certificate.
 *
 * certificate_parts has one byte for each part of the certificate. It only serves to show which
 * part differs. Its bytes from the lowest to the highest are: the lowest byte of bank_crc;
 * adc_bits; the lowest byte of the CRC-32 of force_scale; the lowest byte of the CRC-32 of
 * FORCE_LAW_VERSION and AXIS_LAW_SIGNATURE. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/law_bank.h"

typedef struct {
  uint32_t hash;
  uint32_t parts;
} certificate_t;

/* Computes the certificate that this firmware requires for a filter bank with the CRC `bank_crc`.
 * The force sensor has adc_bits and force_scale (in micronewtons per count). */
certificate_t certificate_of(uint32_t bank_crc, uint8_t adc_bits, uint32_t force_scale);

/* Compares the certificate of each filter bank with the required certificate, and writes the result
 * (AXIS_CERTIFICATE_STATE_) to the signal certificate_state of the bank. The result is `none` if
 * certificate_hash is 0. Otherwise the result is `fits`, or it names the first part of the
 * certificate that differs. */
void certificates_check(law_banks_t *banks, uint8_t adc_bits, uint32_t force_scale);

/* Returns true if the selected filter bank has no matching certificate. Bank 0 is the force law
 * with only force_gain and has no certificate. For bank 0 the result is true only if
 * certificate_required is set. */
bool certificate_is_missing(const law_banks_t *banks);

#endif
