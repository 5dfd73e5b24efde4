#include "firmware/drive/touch.h"

#include "firmware/core/laws.h"
#include "firmware/fx/fx.h"

void touch_start(touch_t *touch) {
  touch->slot_tick = 0;
  touch->slots = 0;
  touch->steady = 0;
  touch->approaching = 0;
  touch->pressing = 0;
  touch->finding = AXIS_FAULT_NONE;
}

void touch_derive(touch_t *touch, const drive_params_t *params) {
  touch->speed_q16 = fx_q16_from_per_s(params->touch_velocity_max);
}

static inline int32_t along(int32_t x, bool negative) { return negative ? -x : x; }

/* cap' = cap + k_p (v_max - v), in 1/65536 code, at most k_p v_max above the code put out last, so
 * that it does not run ahead while the law asks for less. */
static void bound_speed(touch_t *touch, const drive_signals_t *signals, axis_t *axis) {
  const bool negative = axis->params.force_setpoint < 0;
  const int32_t velocity = along(fx_clamp(axis->signals.velocity, -2048, 2048), negative);
  const int32_t code = along(axis->signals.dac_code, negative);
  const int32_t bias_q16 = along(axis->signals.bump_bias, negative);
  const int32_t gain_q8 = axis->params.position_gain;
  const int32_t lead_q16 = (int32_t)fx_saturate(
      fx_floor_shift_wide(fx_mul(gain_q8, touch->speed_q16), 8), 0, LAW_MAX_Q16);
  const int64_t change_q16 =
      fx_floor_shift_wide(fx_mul(gain_q8, touch->speed_q16 - fx_scale(velocity, 16)), 8);
  const int32_t most_q16 = fx_scale((code > 0) ? code : 0, 16) + lead_q16;
  touch->cap_q16 = fx_saturate(touch->cap_q16 + change_q16, 0, most_q16);
  /* What is left of a bump adds to the law. */
  axis->press_cap_code =
      (int16_t)fx_clamp(fx_round_q16(touch->cap_q16 - bias_q16), 0, AXIS_PRESS_CAP_NONE - 1);
  axis->bumpless_contact = (uint8_t)(signals->contact == 0);
}

void touch_press(touch_t *touch, const drive_signals_t *signals, axis_t *axis, int32_t demand) {
  const int32_t setpoint = axis->params.force_setpoint;
  const bool presses = !fx_within(setpoint, axis->params.contact_force);
  touch_demand(touch, presses ? setpoint : 0, demand);
  if (touch->speed_q16 != 0) {
    bound_speed(touch, signals, axis);
  }
}

static bool exceeds(uint32_t value, uint32_t limit) { return limit != 0 && value > limit; }

static bool is_overdue(touch_t *touch, const drive_params_t *params, const drive_signals_t *signals,
                       const axis_t *axis) {
  const int32_t position = axis->signals.position;
  if (signals->contact != 0 || touch->direction == 0) {
    touch->approaching = 0;
    return false;
  }
  if (touch->approaching != touch->direction) {
    touch->approaching = touch->direction;
    touch->approach_cnt = position;
    touch->approach_tick = 0;
    return false;
  }
  touch->approach_tick += 2;
  return exceeds(touch->approach_tick, fx_ticks_from_ms(params->approach_timeout)) ||
         exceeds(fx_magnitude(fx_diff_wrap(position, touch->approach_cnt)),
                 params->approach_travel_max);
}

static bool has_given_way(touch_t *touch, const drive_params_t *params,
                          const drive_signals_t *signals, const axis_t *axis) {
  const int32_t position = axis->signals.position;
  if (touch->pressing == 0) {
    if (signals->contact != 0) {
      touch->pressing = (axis->signals.force > 0) ? 1 : -1;
      touch->first_cnt = position;
    }
    return false;
  }
  const int32_t moved = fx_diff_wrap(position, touch->first_cnt);
  const bool onward = (moved > 0) == (touch->pressing > 0);
  return onward && exceeds(fx_magnitude(moved), params->contact_travel_max);
}

static void begin_slot(touch_t *touch, int32_t force) {
  touch->slot_tick = 0;
  touch->low = force;
  touch->high = force;
  touch->steady = 1;
  touch->steady_demand = touch->demand;
}

static void watch_ripple(touch_t *touch, contact_t *contact, const drive_params_t *params,
                         drive_signals_t *signals, int32_t force) {
  if (touch->slot_tick == 0) {
    begin_slot(touch, force);
  }
  touch->low = (force < touch->low) ? force : touch->low;
  touch->high = (force > touch->high) ? force : touch->high;
  if (touch->demand != touch->steady_demand) {
    touch->steady = 0;
  }
  touch->slot_tick = (uint8_t)(touch->slot_tick + 2);
  if (touch->slot_tick < TOUCH_SLOT_TICKS) {
    return;
  }
  touch->slot_tick = 0;
  signals->force_ripple = touch->high - touch->low;
  const bool swings = touch->steady != 0 && signals->force_ripple > params->force_ripple_max;
  touch->slots = (uint8_t)(swings ? touch->slots + 1 : 0);
  contact->rippling = (uint8_t)(touch->slots >= params->force_ripple_time);
  if (contact->rippling != 0) {
    touch->slots = params->force_ripple_time;
  }
}

void touch_judge(touch_t *touch, contact_t *contact, const drive_params_t *params,
                 drive_signals_t *signals, const axis_t *axis) {
  if (params->force_ripple_max != 0) {
    watch_ripple(touch, contact, params, signals, axis->signals.force);
  } else {
    contact->rippling = 0;
  }
  if (has_given_way(touch, params, signals, axis)) {
    touch->finding = AXIS_FAULT_CONTACT_TRAVEL;
  } else if (is_overdue(touch, params, signals, axis)) {
    touch->finding = AXIS_FAULT_NO_CONTACT;
  } else if (signals->limit_cycle != 0 &&
             params->contact_unstable_option != AXIS_CONTACT_UNSTABLE_OPTION_WARN) {
    touch->finding = AXIS_FAULT_CONTACT_UNSTABLE;
  }
}

uint8_t touch_answer(touch_t *touch, contact_t *contact, const drive_params_t *params,
                     drive_signals_t *signals, axis_t *axis) {
  const uint8_t fault = touch->finding;
  touch->finding = AXIS_FAULT_NONE;
  if (fault != AXIS_FAULT_CONTACT_UNSTABLE ||
      params->contact_unstable_option != AXIS_CONTACT_UNSTABLE_OPTION_HALVE_GAIN ||
      signals->gain_halvings == TOUCH_HALVINGS) {
    return fault;
  }
  signals->gain_halvings = (uint8_t)(signals->gain_halvings + 1);
  axis_halve_force_gain(axis, signals->gain_halvings);
  contact_forget_losses(contact);
  signals->limit_cycle = 0;
  touch->slot_tick = 0;
  touch->slots = 0;
  return AXIS_FAULT_NONE;
}
