#include "firmware/core/limits.h"

static axis_codes_t codes_of(const axis_t *axis) {
  return fx_within(axis->signals.force, axis->params.contact_force) ? axis->free_codes
                                                                    : axis_codes_all();
}

static int32_t clamp_to(int32_t command_q16, axis_codes_t codes) {
  return fx_clamp(command_q16, fx_scale(codes.least, 16), fx_scale(codes.most, 16));
}

int32_t limits_bound(axis_t *axis, int32_t command_q16) {
  fx_assert(axis->bounded != 0 && axis->bounded <= AXIS_BOUNDED_TICKS);
  const axis_codes_t codes = codes_of(axis);
  /* No code that is computed in this tick is output in a later tick, so the ranges have no effect
   * in the next tick. */
  axis->bounded = 0;
  return clamp_to(command_q16, codes);
}

int32_t limits_bound_late(axis_t *axis, int32_t command_q16) {
  fx_assert(axis->bounded != 0 && axis->bounded <= AXIS_BOUNDED_TICKS);
  axis_codes_t due = axis->late_codes;
  if (axis->bounded == AXIS_BOUNDED_TICKS) {
    const axis_codes_t codes = codes_of(axis);
    due = limits_both(codes, due);
    axis->late_codes = limits_both(codes, axis->law_codes);
  } else {
    axis->late_codes = axis_codes_all();
  }
  axis->bounded = (uint8_t)(axis->bounded - 1);
  return clamp_to(command_q16, due);
}
