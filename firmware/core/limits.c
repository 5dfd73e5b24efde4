#include "firmware/core/limits.h"

static axis_codes_t codes_of(const axis_t *axis) {
  return fx_within(axis->signals.force, axis->params.contact_force) ? axis->free_codes
                                                                    : axis_codes_all();
}

int32_t limits_bound(axis_t *axis, int32_t code) {
  const axis_codes_t codes = codes_of(axis);
  axis->bounded = (uint8_t)(axis->bounded - 1);
  return fx_clamp(code, codes.least, codes.most);
}

int32_t limits_bound_late(axis_t *axis, int32_t code) {
  const axis_codes_t codes = codes_of(axis);
  const axis_codes_t both = limits_both(codes, axis->late_codes);
  axis->late_codes = limits_both(codes, axis->law_codes);
  axis->bounded = (uint8_t)(axis->bounded - 1);
  return fx_clamp(code, both.least, both.most);
}
