#include "firmware/drive/touch.h"

#include "firmware/drive/contact_excitation.h"
#include "firmware/fx/fx.h"

/* From one judgement to the next. */
enum { JUDGED_TICKS = 4 };

/* How far the bound leads the code put out last, so that it is near when the law asks for more. */
#define LEAD_Q16 (INT32_C(2) * 65536)

/* The way of two ticks is limited to this, so that it fits in 32 bits. */
#define WAY_MAX_CNT INT32_C(8192)

void touch_start(touch_t *touch) {
  touch->bounded_cnt = 0;
  touch->begun = 0;
  touch->setpoint = 0;
  touch->demand = 0;
  touch->slot_tick = 0;
  touch->slots = 0;
  touch->settling_tick = 0;
  touch->steady = 0;
  touch->approaching = 0;
  touch->pressing = 0;
  touch->finding = AXIS_FAULT_NONE;
}

void touch_derive(touch_t *touch, const drive_params_t *params) {
  const uint32_t speed = params->touch_velocity_max;
  const int32_t speed_q8 = fx_floor_shift(fx_q16_from_per_s(speed), 7);
  touch->speed_q8 = (speed != 0 && speed_q8 == 0) ? 1 : speed_q8;
}

/* A force law begins without a code where it presses; on the other side the one that has held the
 * axis so far may go on. */
static void begin_bound(touch_t *touch, const axis_t *axis) {
  const int16_t code = axis->signals.dac_code;
  const bool down = axis->params.force_setpoint < 0;
  touch->codes.most = (down && code > 0) ? code : 0;
  touch->codes.least = (!down && code < 0) ? code : 0;
  touch->most_q16 = fx_scale(touch->codes.most, 16);
  touch->least_q16 = fx_scale(touch->codes.least, 16);
  touch->begun = 1;
}

/* k_p / 4 (2 v_max - dx), in 1/65536 code. A quarter, so that it does not overshoot where the
 * position law does not oscillate. */
static int32_t change_q16(const axis_t *axis, int32_t slack_q8) {
  return fx_floor_shift(
      (int32_t)axis->params.position_gain * fx_clamp(slack_q8, -INT16_MAX, INT16_MAX), 2);
}

/* Every second tick, for each direction: cap' = cap + k_p / 4 (2 v_max - dx). */
static void move_bound(touch_t *touch, const axis_t *axis) {
  const int32_t position = axis->signals.position;
  const int32_t way_cnt =
      fx_clamp(fx_diff_wrap(position, touch->bounded_cnt), -WAY_MAX_CNT, WAY_MAX_CNT);
  touch->bounded_cnt = position;
  const int32_t way_q8 = fx_scale(way_cnt, 8);
  const int32_t code = axis->signals.dac_code;
  touch->most_q16 = fx_clamp(touch->most_q16 + change_q16(axis, touch->speed_q8 - way_q8), 0,
                             fx_scale((code > 0) ? code : 0, 16) + LEAD_Q16);
  touch->least_q16 = fx_clamp(touch->least_q16 - change_q16(axis, touch->speed_q8 + way_q8),
                              fx_scale((code < 0) ? code : 0, 16) - LEAD_Q16, 0);
  touch->codes.most = (int16_t)fx_round_q16(touch->most_q16);
  touch->codes.least = (int16_t)-fx_round_q16(-touch->least_q16);
}

void touch_bound(touch_t *touch, const drive_signals_t *signals, axis_t *axis) {
  if (touch->begun == 0) {
    begin_bound(touch, axis);
  }
  /* Not in the ticks that are judged. */
  if ((axis->signals.tick_count & 1) == 0) {
    move_bound(touch, axis);
  }
  axis->bounded = AXIS_BOUNDED_TICKS;
  axis->free_codes = touch->codes;
  axis->bumpless_contact = (uint8_t)(signals->contact == 0);
}

static bool exceeds(uint32_t value, uint32_t limit) { return limit != 0 && value > limit; }

static bool exceeds_travel(touch_t *touch, const drive_params_t *params,
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

static bool is_overdue(touch_t *touch, const drive_params_t *params, const drive_signals_t *signals,
                       const axis_t *axis) {
  const int32_t position = axis->signals.position;
  if (signals->contact != 0 || fx_within(touch->setpoint, axis->params.contact_force)) {
    touch->approaching = 0;
    return false;
  }
  const int8_t direction = (touch->setpoint > 0) ? 1 : -1;
  if (touch->approaching != direction) {
    touch->approaching = direction;
    touch->approach_cnt = position;
    touch->approach_tick = 0;
    return false;
  }
  touch->approach_tick += JUDGED_TICKS;
  return exceeds(touch->approach_tick, fx_ticks_from_ms(params->approach_timeout)) ||
         exceeds(fx_magnitude(fx_diff_wrap(position, touch->approach_cnt)),
                 params->approach_travel_max);
}

/* The largest and smallest reading of a slot, and how many slots in a row had too much between. */
static void watch_ripple(touch_t *touch, contact_t *contact, const drive_params_t *params,
                         drive_signals_t *signals, int32_t force) {
  if (params->force_ripple_max == 0) {
    contact->rippling = 0;
    return;
  }
  if (touch->slot_tick == 0) {
    touch->low = force;
    touch->high = force;
    touch->steady = 1;
    touch->steady_demand = touch->demand;
  }
  touch->low = (force < touch->low) ? force : touch->low;
  touch->high = (force > touch->high) ? force : touch->high;
  if (touch->demand != touch->steady_demand || contact_excitation_is_active(signals)) {
    touch->steady = 0;
  }
  touch->slot_tick = (uint8_t)(touch->slot_tick + JUDGED_TICKS);
  if (touch->slot_tick < TOUCH_SLOT_TICKS) {
    return;
  }
  touch->slot_tick = 0;
  signals->force_ripple = touch->high - touch->low;
  if (touch->steady == 0 || signals->force_ripple <= params->force_ripple_max) {
    touch->slots = 0;
  } else if (touch->slots < params->force_ripple_time) {
    touch->slots = (uint8_t)(touch->slots + 1);
  }
  contact->rippling = (uint8_t)(touch->slots >= params->force_ripple_time);
}

void touch_judge(touch_t *touch, contact_t *contact, const drive_params_t *params,
                 drive_signals_t *signals, const axis_t *axis) {
  if ((axis->signals.tick_count & 2) != 0) {
    if (exceeds_travel(touch, params, signals, axis)) {
      touch->finding = AXIS_FAULT_CONTACT_TRAVEL;
    } else if (is_overdue(touch, params, signals, axis)) {
      touch->finding = AXIS_FAULT_NO_CONTACT;
    }
    return;
  }
  watch_ripple(touch, contact, params, signals, axis->signals.force);
  if (touch->settling_tick != 0) {
    touch->settling_tick = (uint16_t)(touch->settling_tick - JUDGED_TICKS);
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
  touch->settling_tick = TOUCH_SETTLING_TICKS;
  return AXIS_FAULT_NONE;
}
