#ifndef FIRMWARE_CORE_LIMITS_H_
#define FIRMWARE_CORE_LIMITS_H_

/* Limits of the output: the one place that bounds the code, last before it goes out, whatever law,
 * bump bias and excitation add up to. An active limit is not a fault, and ends by itself. */

#include <stdint.h>

#include "firmware/core/axis_state.h"
#include "firmware/core/laws.h"
#include "firmware/fx/fx.h"

/* The codes that lie in both ranges. Each range contains 0. */
static inline axis_codes_t limits_both(axis_codes_t a, axis_codes_t b) {
  const axis_codes_t both = {.least = (a.least > b.least) ? a.least : b.least,
                             .most = (a.most < b.most) ? a.most : b.most};
  return both;
}

/* The code due in a tick, within the bounds that the drive has set (free_codes by its reading); and
 * with latency_ticks within those of the tick that it was computed in. To be called while
 * axis->bounded is not 0, in functions of their own, so that other ticks keep their registers. */
int32_t limits_bound(axis_t *axis, int32_t code);
int32_t limits_bound_late(axis_t *axis, int32_t code);

/* The code that may be put out for a computed one, and in *reason the limit that applies,
 * AXIS_LIMIT_REASON_...; of several the last in this list:
 *   dac_saturation   beyond -2048..2047
 *   output_limit     beyond +-output_limit, when that is below 2048
 *   position_max     a positive code while position > position_max: 0 instead (the axis stops; a
 *                    negative code still brings it back); position_min likewise
 *   limit_switch_pos a positive code on the positive switch: 0 instead; limit_switch_neg likewise
 * The bounds of the drive, which come before, have no reason of their own. code within +-2^17,
 * digital_inputs AXIS_DIN_... bits. Soft limits compare counts as they are: they are meant for an
 * encoder that does not wrap. */
static inline int16_t limits_apply(const axis_params_t *params, int32_t position_cnt,
                                   uint8_t digital_inputs, int32_t code, uint8_t *reason) {
  const int32_t limit = (int32_t)params->output_limit;
  const int32_t highest = (limit > LAW_DAC_MAX) ? LAW_DAC_MAX : limit;
  const int32_t limited = fx_clamp(code, -limit, highest);
  uint8_t why = AXIS_LIMIT_REASON_NONE;
  if (limited != code) {
    why = (limit > LAW_DAC_MAX) ? AXIS_LIMIT_REASON_DAC_SATURATION : AXIS_LIMIT_REASON_OUTPUT_LIMIT;
  }
  uint8_t blocked = AXIS_LIMIT_REASON_NONE;
  if (limited > 0) {
    if ((digital_inputs & AXIS_DIN_LIMIT_POS) != 0) {
      blocked = AXIS_LIMIT_REASON_LIMIT_SWITCH_POS;
    } else if (position_cnt > params->position_max) {
      blocked = AXIS_LIMIT_REASON_POSITION_MAX;
    }
  } else if (limited < 0) {
    if ((digital_inputs & AXIS_DIN_LIMIT_NEG) != 0) {
      blocked = AXIS_LIMIT_REASON_LIMIT_SWITCH_NEG;
    } else if (position_cnt < params->position_min) {
      blocked = AXIS_LIMIT_REASON_POSITION_MIN;
    }
  }
  *reason = (blocked != AXIS_LIMIT_REASON_NONE) ? blocked : why;
  return (blocked != AXIS_LIMIT_REASON_NONE) ? (int16_t)0 : (int16_t)limited;
}

#endif
