#include "firmware/guard/contact_excitation.h"

#include "firmware/core/laws.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/access.h"

#define FULL_Q30 INT32_C(1073741824)

void contact_excitation_end(contact_excitation_t *excitation, drive_signals_t *signals,
                            uint8_t reason) {
  if (contact_excitation_is_active(signals)) {
    signals->excitation_state = reason;
    signals->excitation_value = 0;
    excitation->value_q8 = 0;
  }
}

static int32_t step_of(const drive_params_t *params) {
  const uint32_t ticks = fx_ticks_from_ms(params->excitation_ramp);
  return (ticks == 0) ? FULL_Q30 : (int32_t)fx_quotient((uint32_t)FULL_Q30, ticks);
}

static int start(contact_excitation_t *excitation, const drive_params_t *params,
                 drive_signals_t *signals, const axis_t *axis, bool permitted) {
  if (contact_excitation_is_active(signals)) {
    return FW_ERROR_STATE;
  }
  if (!permitted) {
    signals->excitation_state = AXIS_EXCITATION_STATE_REFUSED_MODE;
    return FW_ERROR_STATE;
  }
  if (signals->contact == 0 || axis->signals.active_mode != AXIS_MODE_FORCE) {
    signals->excitation_state = AXIS_EXCITATION_STATE_REFUSED_CONTACT;
    return FW_ERROR_STATE;
  }
  *excitation = (contact_excitation_t){
      .step_q30 = step_of(params), .start_cnt = axis->signals.position, .begins = 1};
  signals->excitation_state = AXIS_EXCITATION_STATE_RAMPING_UP;
  return FW_OK;
}

int contact_excitation_command(contact_excitation_t *excitation, const drive_params_t *params,
                               drive_signals_t *signals, const axis_t *axis, bool starts,
                               bool permitted) {
  if (starts) {
    return start(excitation, params, signals, axis, permitted);
  }
  if (contact_excitation_is_active(signals)) {
    excitation->step_q30 = step_of(params);
    signals->excitation_state = AXIS_EXCITATION_STATE_RAMPING_DOWN;
  }
  return FW_OK;
}

/* Changes the amplitude of the excitation by one step of the ramp of the amplitude. Returns false
 * when the amplitude has fallen to 0. */
static bool ramp(contact_excitation_t *excitation, drive_signals_t *signals) {
  const int32_t level = excitation->level_q30;
  const int32_t step = excitation->step_q30;
  if (signals->excitation_state == AXIS_EXCITATION_STATE_RAMPING_DOWN) {
    excitation->level_q30 = level - step;
    return level > step;
  }
  excitation->level_q30 = (FULL_Q30 - level > step) ? level + step : FULL_Q30;
  if (excitation->level_q30 == FULL_Q30) {
    signals->excitation_state = AXIS_EXCITATION_STATE_RUNNING;
  }
  return true;
}

void contact_excitation_prepare(contact_excitation_t *excitation, const drive_params_t *params,
                                drive_signals_t *signals, axis_t *axis, bool permitted) {
  if (!permitted || axis->params.mode != AXIS_MODE_FORCE) {
    contact_excitation_end(excitation, signals, AXIS_EXCITATION_STATE_ENDED_MODE);
    return;
  }
  if (!ramp(excitation, signals)) {
    contact_excitation_end(excitation, signals, AXIS_EXCITATION_STATE_DONE);
    return;
  }
  const int32_t amplitude_q8 = (params->excitation_point == AXIS_EXCITATION_POINT_OUTPUT)
                                   ? (int32_t)params->excitation_code * 256
                                   : (int32_t)params->excitation_force;
  const int64_t reached_q8 = fx_floor_shift_wide(fx_mul(amplitude_q8, excitation->level_q30), 30);
  const int32_t wave_q15 =
      excitation_step(&axis->excitation, &axis->params, excitation->begins != 0);
  excitation->begins = 0;
  excitation->value_q8 = (int32_t)fx_floor_shift_wide(fx_mul((int32_t)reached_q8, wave_q15), 15);
}

void contact_excitation_add(contact_excitation_t *excitation, const drive_params_t *params,
                            drive_signals_t *signals, axis_t *axis, const axis_inputs_t *inputs) {
  axis_params_t *law = &axis->params;
  const int32_t force = law_force_reading(inputs->adc_code[0], law->force_zero_code,
                                          law->force_sign, law->adc_bits, law->force_tare);
  const uint32_t moved = fx_magnitude(fx_diff_wrap(inputs->encoder_cnt, excitation->start_cnt));
  uint8_t reason = AXIS_EXCITATION_STATE_IDLE;
  if (fx_within(force, law->contact_force)) {
    reason = AXIS_EXCITATION_STATE_ENDED_CONTACT;
  } else if (force > params->excitation_force_max || force < params->excitation_force_min) {
    reason = AXIS_EXCITATION_STATE_ENDED_FORCE;
  } else if (params->excitation_travel != 0 && moved > params->excitation_travel) {
    reason = AXIS_EXCITATION_STATE_ENDED_TRAVEL;
  }
  if (reason != AXIS_EXCITATION_STATE_IDLE) {
    contact_excitation_end(excitation, signals, reason);
    return;
  }
  signals->excitation_value = excitation->value_q8;
  if (params->excitation_point == AXIS_EXCITATION_POINT_OUTPUT) {
    axis->excitation_q16 = fx_scale(excitation->value_q8, 8);
  } else {
    law->force_setpoint += excitation->value_q8;
  }
}

void contact_excitation_remove(contact_excitation_t *excitation, const drive_params_t *params,
                               drive_signals_t *signals, axis_t *axis) {
  axis->excitation_q16 = 0;
  if (params->excitation_point == AXIS_EXCITATION_POINT_SETPOINT) {
    axis->params.force_setpoint -= signals->excitation_value;
  }
  if (axis->signals.active_mode != AXIS_MODE_FORCE) {
    contact_excitation_end(excitation, signals, AXIS_EXCITATION_STATE_ENDED_MODE);
  }
}
