#ifndef FIRMWARE_CORE_LIMITS_H_
#define FIRMWARE_CORE_LIMITS_H_

/* Limits of the output. No other part of the firmware bounds the DAC code. The limits act last, on
 * the sum of control law, bump bias, excitation and output bias. An active limit is not a fault and
 * ends when its condition ends.
 *
 * The output bias holds the weight of a vertical axis, so a limit that stops the motion in one
 * direction must not take it away: with code 0 the axis would fall. The ranges of the drive and the
 * limits of the position therefore bound the command, which is the output without the output bias.
 * output_limit and the range of the DAC bound the sum. */

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
 * computed the command apply too. A command outside law_codes gives the limit reason output_limit.
 * Call this function only while axis->bounded is not 0, and before limits_apply(). It is not
 * inline, so a tick without such ranges uses fewer registers. */
int32_t limits_bound(axis_t *axis, int32_t command_q16);
int32_t limits_bound_late(axis_t *axis, int32_t command_q16);

/* Bounds an output, in 1/65536 code, whose axis is beyond a position limit or at a limit switch,
 * and writes axis->net_q16. See limits_apply(). */
int32_t limits_block(axis_t *axis, uint8_t digital_inputs, int32_t output_q16);

/* Returns the output that the limits permit for a command. Command and output are in 1/65536 code.
 * The output bias axis->bias_q16 is added here. The output is the sum itself, the output bias, or a
 * whole code, and is within -2048..2047 codes. Writes the output beside the output bias to
 * axis->net_q16, where a command that an end of the travel stops is 0. Writes the active limit,
 * AXIS_LIMIT_REASON_, to signals.limit_reason, which keeps its value if no limit is active. If
 * several limits are active, the last one in this list is the reason:
 *   dac_saturation   the sum is beyond -2048..2047 codes
 *   output_limit     the sum is beyond +-output_limit, and output_limit is below 2048
 *   position_max     position > position_max, and the command is positive: the output becomes the
 *                    output bias, so the axis is not driven further. A negative command still
 *                    moves the axis back. If the axis still moves in the positive direction, for
 *                    example because the output bias is too large, the output is not positive.
 *   position_min     the same for position < position_min and the negative direction
 *   limit_switch_pos the same as position_max while the positive limit switch is on
 *   limit_switch_neg the same as position_min while the negative limit switch is on
 *   drive_limit      a fitted drive reports a limit of its own; limits_add_drive() sets this reason
 * If both ends are reached at once, the output is the output bias or 0. The ranges of the drive act
 * before these limits. The command must be within +-(2^30 - 2^15), and the output bias within
 * +-output_limit; digital_inputs has AXIS_DIGITAL_INPUTS_ bits. position_min and position_max are
 * compared with the encoder count directly, so this count must not wrap. */
static inline int32_t limits_apply(axis_t *axis, uint8_t digital_inputs, int32_t command_q16) {
  const axis_params_t *params = &axis->params;
  axis_signals_t *signals = &axis->signals;
  fx_assert(fx_magnitude(command_q16) <= UINT32_C(1073709056));
  fx_assert(params->position_min <= params->position_max);
  fx_assert(params->output_limit <= 2048);
  fx_assert(fx_within(axis->bias_q16, fx_scale(params->output_limit, 16)));
  const int32_t limit = (int32_t)params->output_limit;
  const int32_t highest = (limit > LAW_DAC_MAX) ? LAW_DAC_MAX : limit;
  const int32_t sum_q16 = command_q16 + axis->bias_q16;
  const int32_t limited_q16 = fx_clamp(sum_q16, -fx_scale(limit, 16), fx_scale(highest, 16));
  if (limited_q16 != sum_q16) {
    signals->limit_reason =
        (limit > LAW_DAC_MAX) ? AXIS_LIMIT_REASON_DAC_SATURATION : AXIS_LIMIT_REASON_OUTPUT_LIMIT;
  }
  const uint8_t switches = AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE | AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE;
  const bool is_within = (digital_inputs & switches) == 0 &&
                         signals->position <= params->position_max &&
                         signals->position >= params->position_min;
  if (!is_within) {
    return limits_block(axis, digital_inputs, limited_q16);
  }
  axis->net_q16 = limited_q16 - axis->bias_q16;
  return limited_q16;
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
