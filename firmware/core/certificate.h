#ifndef FIRMWARE_CORE_CERTIFICATE_H_
#define FIRMWARE_CORE_CERTIFICATE_H_

/* The certificate of a bank of the force law. The tool that designed the bank writes it; it names
 * the conditions for which the bank was designed. The firmware computes the certificate that its
 * bank, sensor and law require whenever one of them is written, and never in a tick.
 *
 * certificate_hash is the CRC-32 of five 32-bit words, least significant byte first: bank_crc,
 * adc_bits, force_scale, FORCE_LAW_VERSION, AXIS_LAW_SIGNATURE. The signature covers name, type,
 * unit and scale of the objects that the law computes with, so a new object elsewhere invalidates
 * no certificate.
 *
 * certificate_parts has one byte for each part and only shows which part differs: from the lowest
 * byte up, the lowest byte of bank_crc, adc_bits, the lowest byte of the CRC-32 of force_scale, and
 * the lowest byte of the CRC-32 of version and signature. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/law_bank.h"

typedef struct {
  uint32_t hash;
  uint32_t parts;
} certificate_t;

/* Computes the certificate of a bank with this CRC for this force sensor and this firmware.
 * force_scale is in micronewtons per count. */
certificate_t certificate_of(uint32_t bank_crc, uint8_t adc_bits, uint32_t force_scale);

/* Compares the certificate of each bank with the required one and writes the result
 * (AXIS_CERTIFICATE_STATE_) to its signal: none if the hash is 0, a match, or the first part that
 * differs. */
void certificates_check(law_banks_t *banks, uint8_t adc_bits, uint32_t force_scale);

/* Whether the selected force law has no certificate that matches. Bank 0, force_gain alone, needs
 * no certificate unless certificate_required is set; with certificate_required it always counts as
 * without certificate. */
bool certificate_is_missing(const law_banks_t *banks);

#endif
