#include "firmware/app/law.h"

#include "firmware/app/ownership.h"
#include "firmware/core/certificate.h"
#include "firmware/drive/drive.h"

int law_check(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value) {
  (void)source;
  return law_banks_check(&fw_of_const(objects)->banks, object, value);
}

void law_written(dictionary_t *objects, uint8_t source, uint16_t object, int32_t previous,
                 int32_t value) {
  fw_t *fw = fw_of(objects);
  (void)source;
  (void)previous;
  (void)value;
  law_banks_written(&fw->banks, &fw->axis, object);
  law_certify(fw);
}

void law_adc_written(fw_t *fw) {
  law_banks_set_adc(&fw->banks, fw->axis.params.adc_bits);
  law_certify(fw);
}

void law_certify(fw_t *fw) {
  const law_params_t *params = &fw->banks.params;
  fw->drive.law_crc = (params->force_bank == 0) ? 0 : params->bank_crc[params->force_bank - 1];
  certificates_check(&fw->banks, fw->axis.params.adc_bits, fw->drive.params.force_scale);
  if (certificate_is_missing(&fw->banks)) {
    cia402_restrict_law(&fw->drive, params->uncertified_force, params->uncertified_output);
  } else {
    cia402_release_law(&fw->drive);
  }
}

bool law_loaded(fw_t *fw) {
  const bool valid = law_banks_loaded(&fw->banks, &fw->axis);
  law_certify(fw);
  return valid;
}
