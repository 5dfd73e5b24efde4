#ifndef FIRMWARE_CORE_LIMITS_H_
#define FIRMWARE_CORE_LIMITS_H_

/* Limits of the output. No other part of the firmware bounds the DAC code. The limits act last, on
 * the sum of control law, bump bias and excitation. An active limit is not a fault and ends when
 * its condition ends. */

#include <stdint.h>

#include "firmware/core/axis_state.h"
#include "firmware/core/laws.h"
#include "firmware/fx/fx.h"

/* Returns the range of the DAC codes that are both in range a and in range b. Each of the two
 * ranges contains 0. */
static inline axis_codes_t limits_both(axis_codes_t a, axis_codes_t b) {
  const axis_codes_t both = {.least = (a.least > b.least) ? a.least : b.least,
                             .most = (a.most < b.most) ? a.most : b.most};
  fx_assert(both.least <= 0 && both.most >= 0);
  return both;
}

/* Limits the command of a tick, in 1/65536 code, to the ranges that the drive has set. The range
 * free_codes applies only without contact. If latency_ticks is 1, the ranges of the tick that
 * computed the command apply too. Call this function only while axis->bounded is not 0. It is not
 * inline, so a tick without such ranges uses fewer registers. */
int32_t limits_bound(axis_t *axis, int32_t command_q16);
int32_t limits_bound_late(axis_t *axis, int32_t command_q16);

/* Returns the output that the limits permit for a command. Command and output are in 1/65536 code.
 * The output is the command itself or a whole code, and is within -2048..2047 codes. Writes the
 * active limit, AXIS_LIMIT_REASON_, to *reason. If several limits are active, the last one in this
 * list is the reason:
 *   dac_saturation   the command is beyond -2048..2047 codes
 *   output_limit     the command is beyond +-output_limit, and output_limit is below 2048
 *   position_max     position > position_max, and the command is positive: the output becomes 0 and
 *                    the axis stops; a negative command still moves the axis back
 *   position_min     the same for position < position_min and a negative command
 *   limit_switch_pos the positive limit switch is on, and the command is positive: the output
 *                    becomes 0
 *   limit_switch_neg the same for the negative limit switch and a negative command
 *   drive_limit      a fitted drive reports a limit of its own; limits_add_drive() sets this reason
 * The ranges of the drive act before these limits and set no reason. The command must be within
 * +-2^31 - 2^15; digital_inputs has AXIS_DIGITAL_INPUTS_ bits. position_min and position_max are
 * compared with the encoder count directly, so this count must not wrap. */
static inline int32_t limits_apply(const axis_params_t *params, int32_t position_cnt,
                                   uint8_t digital_inputs, int32_t command_q16, uint8_t *reason) {
  fx_assert(fx_magnitude(command_q16) <= UINT32_C(2147450880));
  fx_assert(params->position_min <= params->position_max);
  fx_assert(params->output_limit <= 2048);
  const int32_t limit = (int32_t)params->output_limit;
  const int32_t highest = (limit > LAW_DAC_MAX) ? LAW_DAC_MAX : limit;
  const int32_t limited = fx_clamp(command_q16, -fx_scale(limit, 16), fx_scale(highest, 16));
  uint8_t why = AXIS_LIMIT_REASON_NONE;
  if (limited != command_q16) {
    why = (limit > LAW_DAC_MAX) ? AXIS_LIMIT_REASON_DAC_SATURATION : AXIS_LIMIT_REASON_OUTPUT_LIMIT;
  }
  uint8_t blocked = AXIS_LIMIT_REASON_NONE;
  if (limited > 0) {
    if ((digital_inputs & AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE) != 0) {
      blocked = AXIS_LIMIT_REASON_LIMIT_SWITCH_POS;
    } else if (position_cnt > params->position_max) {
      blocked = AXIS_LIMIT_REASON_POSITION_MAX;
    }
  } else if (limited < 0) {
    if ((digital_inputs & AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE) != 0) {
      blocked = AXIS_LIMIT_REASON_LIMIT_SWITCH_NEG;
    } else if (position_cnt < params->position_min) {
      blocked = AXIS_LIMIT_REASON_POSITION_MIN;
    }
  }
  *reason = (blocked != AXIS_LIMIT_REASON_NONE) ? blocked : why;
  return (blocked != AXIS_LIMIT_REASON_NONE) ? 0 : limited;
}

/* Writes the reason drive_limit to *reason if a drive on a bus reports a limit of its own and no
 * other limit is active. `drive` is the report of the drive as AXIS_DRIVE_REPORT_ bits. */
static inline void limits_add_drive(uint8_t drive, uint8_t *reason) {
  const uint8_t limited = AXIS_DRIVE_REPORT_FITTED | AXIS_DRIVE_REPORT_LIMIT;
  if ((drive & limited) == limited && *reason == AXIS_LIMIT_REASON_NONE) {
    *reason = AXIS_LIMIT_REASON_DRIVE_LIMIT;
  }
}

#endif
