#ifndef FIRMWARE_CORE_LIMITS_H_
#define FIRMWARE_CORE_LIMITS_H_

/* Limits of the output. This is the only place that bounds the DAC code. The limits act last, on
 * the sum of control law, bump bias and excitation. An active limit is not a fault and ends by
 * itself. */

#include <stdint.h>

#include "firmware/core/axis_state.h"
#include "firmware/core/laws.h"
#include "firmware/fx/fx.h"

/* Returns the codes that both ranges contain. Each range contains 0. */
static inline axis_codes_t limits_both(axis_codes_t a, axis_codes_t b) {
  const axis_codes_t both = {.least = (a.least > b.least) ? a.least : b.least,
                             .most = (a.most < b.most) ? a.most : b.most};
  return both;
}

/* Bounds the DAC code of a tick to the ranges that the drive has set; the measured force decides
 * whether free_codes applies. With latency_ticks the ranges of the tick in which the code was
 * computed apply too. Call it only while axis->bounded is not 0. It is a separate function, so that
 * ticks without such ranges use fewer registers. */
int32_t limits_bound(axis_t *axis, int32_t code);
int32_t limits_bound_late(axis_t *axis, int32_t code);

/* Returns the DAC code that may be output for a computed code, and in *reason the active limit,
 * AXIS_LIMIT_REASON_. If several limits are active, the last one in this list is the reason:
 *   dac_saturation   the code is beyond -2048..2047
 *   output_limit     the code is beyond +-output_limit, and output_limit is below 2048
 *   position_max     a positive code while position > position_max becomes 0: the axis stops, and a
 *                    negative code still moves it back; position_min acts likewise
 *   limit_switch_pos a positive code on the positive switch becomes 0; limit_switch_neg acts
 * likewise The ranges of the drive act before these limits and have no reason of their own. code is
 * within
 * +-2^17; digital_inputs has AXIS_DIN_ bits. The soft limits compare the counts directly and
 * require an encoder that does not wrap. */
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
