#include "firmware/core/limits.h"

static axis_codes_t codes_of(const axis_t *axis) {
  return fx_within(axis->signals.force, axis->params.contact_force) ? axis->free_codes
                                                                    : axis_codes_all();
}

static int32_t clamp_to(int32_t command_q16, axis_codes_t codes) {
  return fx_clamp(command_q16, fx_scale(codes.least, 16), fx_scale(codes.most, 16));
}

/* Limits a command to the range that a force law without a certificate has in this tick. */
static int32_t clamp_law(axis_t *axis, int32_t command_q16) {
  const int32_t limited_q16 = clamp_to(command_q16, axis->law_codes);
  if (limited_q16 != command_q16) {
    axis->signals.limit_reason = AXIS_LIMIT_REASON_OUTPUT_LIMIT;
  }
  return limited_q16;
}

int32_t limits_bound(axis_t *axis, int32_t command_q16) {
  fx_assert(axis->bounded != 0 && axis->bounded <= AXIS_BOUNDED_TICKS);
  const axis_codes_t codes = codes_of(axis);
  /* The DAC code of this tick is output at once. So the ranges of this tick are not needed in the
   * next tick. */
  axis->bounded = 0;
  return clamp_to(clamp_law(axis, command_q16), codes);
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
  return clamp_to(clamp_law(axis, command_q16), due);
}

/* Return true if the output bias drives a moving axis further in this direction. */
static bool drives_up(int32_t bias_q16, int32_t velocity) { return bias_q16 > 0 && velocity > 0; }
static bool drives_down(int32_t bias_q16, int32_t velocity) { return bias_q16 < 0 && velocity < 0; }

int32_t limits_block(axis_t *axis, uint8_t digital_inputs, int32_t output_q16) {
  const int32_t bias_q16 = axis->bias_q16;
  const int32_t velocity = axis->signals.velocity;
  const bool switch_pos = (digital_inputs & AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE) != 0;
  const bool switch_neg = (digital_inputs & AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE) != 0;
  const int32_t most_q16 = drives_up(bias_q16, velocity) ? 0 : bias_q16;
  const int32_t least_q16 = drives_down(bias_q16, velocity) ? 0 : bias_q16;
  int32_t held_q16 = output_q16;
  axis->net_q16 = output_q16 - bias_q16;
  if (held_q16 > most_q16 && (switch_pos || axis->signals.position > axis->params.position_max)) {
    held_q16 = most_q16;
    axis->net_q16 = 0;
    axis->signals.limit_reason =
        switch_pos ? AXIS_LIMIT_REASON_LIMIT_SWITCH_POS : AXIS_LIMIT_REASON_POSITION_MAX;
  }
  if (held_q16 < least_q16 && (switch_neg || axis->signals.position < axis->params.position_min)) {
    held_q16 = least_q16;
    axis->net_q16 = 0;
    axis->signals.limit_reason =
        switch_neg ? AXIS_LIMIT_REASON_LIMIT_SWITCH_NEG : AXIS_LIMIT_REASON_POSITION_MIN;
  }
  return held_q16;
}
