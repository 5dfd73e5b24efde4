#ifndef FIRMWARE_CORE_CERTIFICATE_H_
#define FIRMWARE_CORE_CERTIFICATE_H_

/* The certificate of a bank of the force law. The tool that designed the bank writes the
 * certificate, which states the conditions for which the bank was designed. After each write to the
 * bank or to the parameters of the force sensor, the firmware computes the certificate that this
 * bank, this sensor and the force law require. No certificate is computed in a tick.
 *
 * certificate_hash is the CRC-32 of five 32-bit words, least significant byte first: bank_crc,
 * adc_bits, force_scale, FORCE_LAW_VERSION, AXIS_LAW_SIGNATURE. AXIS_LAW_SIGNATURE is a hash of the
 * name, type, unit and scale of each object that the force law computes with. A new object that the
 * law does not use therefore invalidates no certificate.
 *
 * certificate_parts has one byte for each part of the certificate and only shows which part
 * differs. Its bytes from the lowest to the highest are: the lowest byte of bank_crc; adc_bits; the
 * lowest byte of the CRC-32 of force_scale; the lowest byte of the CRC-32 of FORCE_LAW_VERSION and
 * AXIS_LAW_SIGNATURE. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/law_bank.h"

typedef struct {
  uint32_t hash;
  uint32_t parts;
} certificate_t;

/* Computes the certificate of the bank that has the CRC bank_crc, for a force sensor with adc_bits
 * and force_scale (in micronewtons per count) and for this firmware. */
certificate_t certificate_of(uint32_t bank_crc, uint8_t adc_bits, uint32_t force_scale);

/* Compares the certificate of each bank with the required certificate, and writes the result
 * (AXIS_CERTIFICATE_STATE_) to the signal certificate_state of the bank. The result is none if
 * certificate_hash is 0, otherwise a match or the first part that differs. */
void certificates_check(law_banks_t *banks, uint8_t adc_bits, uint32_t force_scale);

/* Returns true if the selected bank has no matching certificate. Bank 0, the law with force_gain
 * alone, has no certificate: the result is true only if certificate_required is set. */
bool certificate_is_missing(const law_banks_t *banks);

#endif
