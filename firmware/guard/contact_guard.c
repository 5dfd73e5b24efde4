#include "firmware/guard/contact_guard.h"

#include "firmware/fx/fx.h"
#include "firmware/guard/contact_excitation.h"

/* Number of ticks from one check of the protections of the contact guard to the next check. */
enum { CHECK_PERIOD_TICKS = 4 };

/* Largest difference between a bound of the DAC code and the last output code, in 1/65536 code. So
 * the bound is near the output when the control law begins to command a larger code. */
#define LEAD_Q16 (INT32_C(2) * 65536)

/* Largest travel in two ticks that the contact guard uses, in counts. Products with this travel
 * need at most 32 bits. */
#define TRAVEL_MAX_CNT INT32_C(8192)

void contact_guard_start(contact_guard_t *guard) {
  guard->bounded_cnt = 0;
  guard->begun = 0;
  guard->setpoint = 0;
  guard->demand = 0;
  guard->slot_tick = 0;
  guard->slots = 0;
  guard->settling_tick = 0;
  guard->steady = 0;
  guard->approaching = 0;
  guard->paused_cnt = 0;
  guard->paused_tick = 0;
  guard->pressing = 0;
  guard->finding = AXIS_FAULT_NONE;
}

void contact_guard_derive(contact_guard_t *guard, const drive_params_t *params) {
  const uint32_t speed = params->touch_velocity_max;
  const int32_t speed_q8 = fx_floor_shift(fx_q16_from_per_s(speed), 7);
  guard->speed_q8 = (speed != 0 && speed_q8 == 0) ? 1 : speed_q8;
}

/* Initialises the bounds of the DAC code at the start of a force law. The bound in the direction of
 * pressing starts at code 0. The bound in the other direction starts at the present code. */
static void begin_bound(contact_guard_t *guard, const axis_t *axis) {
  const int16_t code = (int16_t)fx_code_from_q16(axis->net_q16);
  const bool down = axis->params.force_setpoint < 0;
  guard->codes.most = (down && code > 0) ? code : 0;
  guard->codes.least = (!down && code < 0) ? code : 0;
  guard->most_q16 = fx_scale(guard->codes.most, 16);
  guard->least_q16 = fx_scale(guard->codes.least, 16);
  guard->begun = 1;
}

/* Returns the change of a bound of the DAC code, k_p / 4 (2 v_max - dx), in 1/65536 code. The
 * factor 1/4 prevents an overshoot of the speed if the position law of the axis does not
 * oscillate. */
static int32_t change_q16(const axis_t *axis, int32_t slack_q8) {
  return fx_floor_shift(
      (int32_t)axis->params.position_gain * fx_clamp(slack_q8, -INT16_MAX, INT16_MAX), 2);
}

/* In every second tick, changes the bounds of the DAC code in both directions. The new bound is
 * cap' = cap + k_p / 4 (2 v_max - dx). */
static void move_bound(contact_guard_t *guard, const axis_t *axis) {
  const int32_t position = axis->signals.position;
  const int32_t travel_cnt =
      fx_clamp(fx_diff_wrap(position, guard->bounded_cnt), -TRAVEL_MAX_CNT, TRAVEL_MAX_CNT);
  guard->bounded_cnt = position;
  const int32_t travel_q8 = fx_scale(travel_cnt, 8);
  const int32_t code = fx_code_from_q16(axis->net_q16);
  guard->most_q16 = fx_clamp(guard->most_q16 + change_q16(axis, guard->speed_q8 - travel_q8), 0,
                             fx_scale((code > 0) ? code : 0, 16) + LEAD_Q16);
  guard->least_q16 = fx_clamp(guard->least_q16 - change_q16(axis, guard->speed_q8 + travel_q8),
                              fx_scale((code < 0) ? code : 0, 16) - LEAD_Q16, 0);
  guard->codes.most = (int16_t)fx_round_q16(guard->most_q16);
  guard->codes.least = (int16_t)-fx_round_q16(-guard->least_q16);
}

void contact_guard_bound(contact_guard_t *guard, const drive_signals_t *signals, axis_t *axis) {
  if (guard->begun == 0) {
    begin_bound(guard, axis);
  }
  /* The bounds of the DAC code change only in ticks in which no protection is checked. */
  if ((axis->signals.tick_count & 1) == 0) {
    move_bound(guard, axis);
  }
  axis->bounded = AXIS_BOUNDED_TICKS;
  axis->free_codes = guard->codes;
  axis->bumpless_contact = (uint8_t)(signals->contact == 0);
}

static bool exceeds(uint32_t value, uint32_t limit) { return limit != 0 && value > limit; }

static bool exceeds_travel(contact_guard_t *guard, const drive_params_t *params,
                           const drive_signals_t *signals, const axis_t *axis, bool controlled) {
  const int32_t position = axis->signals.position;
  if (guard->pressing == 0) {
    if (signals->contact != 0) {
      guard->pressing = (axis->signals.force > 0) ? 1 : -1;
      guard->first_cnt = position;
    }
    return false;
  }
  const int32_t moved = fx_diff_wrap(position, guard->first_cnt);
  const bool onward = (moved > 0) == (guard->pressing > 0) && (controlled || signals->contact != 0);
  return onward && exceeds(fx_magnitude(moved), params->contact_travel_max);
}

static bool is_overdue(contact_guard_t *guard, const drive_params_t *params,
                       const drive_signals_t *signals, const axis_t *axis) {
  const int32_t position = axis->signals.position;
  if (signals->contact != 0 || fx_within(guard->setpoint, axis->params.contact_force)) {
    guard->approaching = 0;
    return false;
  }
  const int8_t direction = (guard->setpoint > 0) ? 1 : -1;
  if (guard->approaching != direction) {
    guard->approaching = direction;
    guard->approach_cnt = position;
    guard->approach_tick = axis->signals.tick_count;
    return false;
  }
  return exceeds(axis->signals.tick_count - guard->approach_tick,
                 fx_ticks_from_ms(params->approach_timeout)) ||
         exceeds(fx_magnitude(fx_diff_wrap(position, guard->approach_cnt)),
                 params->approach_travel_max);
}

/* Updates the largest and the smallest measured force in the present time slot of
 * CONTACT_GUARD_SLOT_TICKS. At the end of a time slot, counts the consecutive slots whose force
 * ripple exceeds force_ripple_max. */
static void watch_ripple(contact_guard_t *guard, contact_t *contact, const drive_params_t *params,
                         drive_signals_t *signals, int32_t force) {
  if (params->force_ripple_max == 0) {
    contact->rippling = 0;
    return;
  }
  if (guard->slot_tick == 0) {
    guard->low = force;
    guard->high = force;
    guard->steady = 1;
    guard->steady_demand = guard->demand;
  }
  guard->low = (force < guard->low) ? force : guard->low;
  guard->high = (force > guard->high) ? force : guard->high;
  if (guard->demand != guard->steady_demand || contact_excitation_is_active(signals)) {
    guard->steady = 0;
  }
  guard->slot_tick = (uint8_t)(guard->slot_tick + CHECK_PERIOD_TICKS);
  if (guard->slot_tick < CONTACT_GUARD_SLOT_TICKS) {
    return;
  }
  guard->slot_tick = 0;
  signals->force_ripple = guard->high - guard->low;
  if (guard->steady == 0 || signals->force_ripple <= params->force_ripple_max) {
    guard->slots = 0;
  } else if (guard->slots < params->force_ripple_time) {
    guard->slots = (uint8_t)(guard->slots + 1);
  }
  contact->rippling = (uint8_t)(guard->slots >= params->force_ripple_time);
}

void contact_guard_phase(contact_guard_t *guard, const drive_params_t *params,
                         const drive_signals_t *signals, const axis_t *axis, bool controls) {
  const int32_t position = axis->signals.position;
  const uint32_t tick = axis->signals.tick_count;
  if (controls) {
    guard->approach_cnt =
        fx_sum_wrap(guard->approach_cnt, fx_diff_wrap(position, guard->paused_cnt));
    guard->approach_tick += tick - guard->paused_tick;
    guard->begun = 0;
    return;
  }
  /* This check is needed at the end of a phase, because a phase of a cycle may be shorter than the
   * time between two checks. */
  if (is_overdue(guard, params, signals, axis) && guard->finding == AXIS_FAULT_NONE) {
    guard->finding = AXIS_FAULT_NO_CONTACT;
  }
  guard->paused_cnt = position;
  guard->paused_tick = tick;
  guard->slot_tick = 0;
}

void contact_guard_evaluate(contact_guard_t *guard, contact_t *contact,
                            const drive_params_t *params, drive_signals_t *signals,
                            const axis_t *axis, bool controlled) {
  if ((axis->signals.tick_count & 2) != 0) {
    if (!controlled && signals->contact != 0) {
      guard->approaching = 0;
    }
    if (exceeds_travel(guard, params, signals, axis, controlled)) {
      guard->finding = AXIS_FAULT_CONTACT_TRAVEL;
    } else if (controlled && is_overdue(guard, params, signals, axis)) {
      guard->finding = AXIS_FAULT_NO_CONTACT;
    }
    return;
  }
  if (!controlled) {
    return;
  }
  watch_ripple(guard, contact, params, signals, axis->signals.force);
  if (guard->settling_tick != 0) {
    guard->settling_tick = (uint16_t)(guard->settling_tick - CHECK_PERIOD_TICKS);
  } else if (signals->limit_cycle != 0 &&
             params->contact_unstable_option != AXIS_CONTACT_UNSTABLE_OPTION_WARN) {
    guard->finding = AXIS_FAULT_CONTACT_UNSTABLE;
  }
}

uint8_t contact_guard_answer(contact_guard_t *guard, contact_t *contact,
                             const drive_params_t *params, drive_signals_t *signals, axis_t *axis) {
  const uint8_t fault = guard->finding;
  guard->finding = AXIS_FAULT_NONE;
  if (fault != AXIS_FAULT_CONTACT_UNSTABLE ||
      params->contact_unstable_option != AXIS_CONTACT_UNSTABLE_OPTION_HALVE_GAIN ||
      signals->gain_halvings == TOUCH_HALVINGS) {
    return fault;
  }
  signals->gain_halvings = (uint8_t)(signals->gain_halvings + 1);
  axis_halve_force_gain(axis, signals->gain_halvings);
  contact_forget_losses(contact);
  signals->limit_cycle = 0;
  guard->slot_tick = 0;
  guard->slots = 0;
  guard->settling_tick = CONTACT_GUARD_SETTLING_TICKS;
  return AXIS_FAULT_NONE;
}
