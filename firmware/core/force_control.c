#include "firmware/core/force_control.h"

#include "firmware/core/laws.h"
#include "firmware/fx/fx.h"

static int32_t evaluate_bank(axis_t *axis, bool touching) {
  axis_signals_t *signals = &axis->signals;
  force_law_t *law = &axis->law;
  const bool entered = signals->active_mode != AXIS_MODE_FORCE;
  const bool limited = signals->limit_reason != AXIS_LIMIT_REASON_NONE;
  const int32_t error_q8 = axis->params.force_setpoint - signals->force;
  if (entered || law->bank.integral_q26 == 0) {
    law->integral_q16 = 0;
    law->integral_remainder_q26 = 0;
  }
  const force_law_tick_t tick = {.begins = entered || axis->rebase != 0,
                                 .up = touching && !(limited && axis->command_q16 > 0),
                                 .down = touching && !(limited && axis->command_q16 < 0)};
  const int32_t code_q16 = force_law_step(law, error_q8, signals->velocity, tick);
  signals->force_integral = law->integral_q16;
  return code_q16;
}

int32_t force_control_step(axis_t *axis) {
  const axis_params_t *params = &axis->params;
  const int32_t force_q8 = axis->signals.force;
  const bool touching = !fx_within(force_q8, params->contact_force);
  const int32_t code_q16 = (axis->law.selected == 0)
                               ? law_force(fx_halved(params->force_gain, axis->law.halvings),
                                           params->force_setpoint, force_q8)
                               : evaluate_bank(axis, touching);
  if (touching) {
    axis->rebase |= axis->bumpless_contact;
  }
  return code_q16 + axis->excitation_q16;
}
