#ifndef FIRMWARE_CORE_CERTIFICATE_H_
#define FIRMWARE_CORE_CERTIFICATE_H_

/* The certificate of a bank of the force law: written by the tool that designed the bank, it says
 * what the design was made for. The firmware computes anew what its bank, sensor and law ask for,
 * whenever one of them is written, never in a tick.
 *
 * certificate_hash is the CRC-32 of five 32-bit words, least significant byte first: bank_crc,
 * adc_bits, force_scale, FORCE_LAW_VERSION, AXIS_LAW_SIGNATURE (name, type, unit and scale of the
 * objects that the law computes with, so that a new object elsewhere voids no certificate).
 *
 * certificate_parts has a byte of each part, only to say which one differs: the lowest one is of
 * bank_crc, then adc_bits, then the lowest one of the CRC-32 of force_scale, then that of version
 * and signature. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/law_bank.h"

typedef struct {
  uint32_t hash;
  uint32_t parts;
} certificate_t;

/* That of a bank with this CRC under this sensor and this firmware. force_scale in uN. */
certificate_t certificate_of(uint32_t bank_crc, uint8_t adc_bits, uint32_t force_scale);

/* AXIS_CERTIFICATE_STATE_ of each bank into its signal: none (the hash is 0), fits, or the first
 * part that is another. */
void certificates_judge(law_banks_t *banks, uint8_t adc_bits, uint32_t force_scale);

/* Whether the law that is selected has no certificate that fits. force_gain alone, bank 0, needs
 * none, and has none with certificate_required. */
bool certificate_is_missing(const law_banks_t *banks);

#endif
