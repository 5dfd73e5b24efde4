#include "firmware/core/certificate.h"

#include "firmware/fx/bytes.h"
#include "firmware/objects/generated/axis_objects.h"

enum { BANK, ADC, SCALE, LAW, PARTS };

static uint8_t lowest_byte(uint32_t word) { return (uint8_t)(word & 0xFFu); }

certificate_t certificate_of(uint32_t bank_crc, uint8_t adc_bits, uint32_t force_scale) {
  uint32_t hash = fx_crc32_word(UINT32_MAX, bank_crc);
  hash = fx_crc32_word(hash, adc_bits);
  hash = fx_crc32_word(hash, force_scale);
  hash = fx_crc32_word(hash, FORCE_LAW_VERSION);
  hash = fx_crc32_word(hash, AXIS_LAW_SIGNATURE);
  const uint32_t law =
      ~fx_crc32_word(fx_crc32_word(UINT32_MAX, FORCE_LAW_VERSION), AXIS_LAW_SIGNATURE);
  const uint8_t parts[PARTS] = {[BANK] = lowest_byte(bank_crc),
                                [ADC] = adc_bits,
                                [SCALE] = lowest_byte(~fx_crc32_word(UINT32_MAX, force_scale)),
                                [LAW] = lowest_byte(law)};
  return (certificate_t){.hash = ~hash, .parts = fx_load_le32(parts)};
}

static uint8_t state_of(certificate_t certificate, certificate_t asked) {
  static const uint8_t other[PARTS] = {
      [BANK] = AXIS_CERTIFICATE_STATE_OTHER_BANK,
      [ADC] = AXIS_CERTIFICATE_STATE_OTHER_ADC,
      [SCALE] = AXIS_CERTIFICATE_STATE_OTHER_SCALE,
      [LAW] = AXIS_CERTIFICATE_STATE_OTHER_LAW,
  };
  if (certificate.hash == 0) {
    return AXIS_CERTIFICATE_STATE_NONE;
  }
  if (certificate.hash == asked.hash) {
    return AXIS_CERTIFICATE_STATE_FITS;
  }
  uint8_t has[PARTS];
  uint8_t wants[PARTS];
  fx_store_le(has, certificate.parts, PARTS);
  fx_store_le(wants, asked.parts, PARTS);
  for (uint8_t i = 0; i < PARTS; i++) {
    if (has[i] != wants[i]) {
      return other[i];
    }
  }
  return AXIS_CERTIFICATE_STATE_WRONG_HASH;
}

void certificates_check(law_banks_t *banks, uint8_t adc_bits, uint32_t force_scale) {
  const law_params_t *params = &banks->params;
  for (uint8_t i = 0; i < FORCE_LAW_BANKS; i++) {
    const certificate_t certificate = {.hash = params->certificate_hash[i],
                                       .parts = params->certificate_parts[i]};
    banks->signals.certificate_state[i] =
        state_of(certificate, certificate_of(params->bank_crc[i], adc_bits, force_scale));
  }
}

bool certificate_is_missing(const law_banks_t *banks) {
  const uint8_t selected = banks->params.force_bank;
  return (selected == 0)
             ? banks->params.certificate_required != 0
             : banks->signals.certificate_state[selected - 1] != AXIS_CERTIFICATE_STATE_FITS;
}
