#ifndef FIRMWARE_GUARD_CONTACT_GUARD_H_
#define FIRMWARE_GUARD_CONTACT_GUARD_H_

/* Protections of the motion around the contact, while a mode controls force. Each is switched off
 * by its default.
 *
 *   touch_velocity_max   Limit of the speed without contact. The largest permitted DAC code rises
 *                        by a quarter of position_gain for each count that the axis is behind
 *                        this speed, and falls by as much for each count that it is ahead. So the
 *                        mean speed stays at the limit for every gain of the amplifier; the
 *                        laboratory axis exceeds it by a tenth. If position_gain is 0, the axis
 *                        does not move. Each direction has its own bound, because the workpiece
 *                        may be on either side, and because a bump bias may drive against the
 *                        direction of the set-point. Bumpless transfer acts at the contact.
 *   contact_travel_max   Largest travel after the first contact, in counts in the direction of
 *                        pressing, which is the sign of the measured force at the first contact
 *                        since force control began; the fault is contact_travel.
 *   approach_timeout     Largest time and travel without contact while there is a demand, which
 *   approach_travel_max  is a target in modes 4 and 10, and in other modes a set-point that would
 *                        be contact; the fault is no_contact. Both start again at each contact,
 *                        without a demand, and when the sign of the demand changes.
 *   force_ripple_max     Largest difference of the measured forces in CONTACT_GUARD_SLOT_TICKS.
 *   force_ripple_time    A larger ripple for this time, at a constant demand and without
 *                        excitation, is a limit cycle, as repeated contact losses are
 *                        (contact.h).
 *   contact_unstable_option
 *                        Reaction to a limit cycle. The gain is halved with bumpless transfer, and
 *                        the guard then waits for CONTACT_GUARD_SETTLING_TICKS. Disabling the axis
 *                        restores the gain. After TOUCH_HALVINGS the fault is contact_unstable.
 *
 * A fault follows fault_reaction_option. Travel and approach are checked in every fourth tick, the
 * limit cycle in a different one of each four ticks; the reaction follows in the next tick. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/guard/contact.h"

enum { CONTACT_GUARD_SLOT_TICKS = 152, TOUCH_HALVINGS = 3, CONTACT_GUARD_SETTLING_TICKS = 1500 };

typedef struct {
  int32_t speed_q8;    /* touch_velocity_max, as counts in two ticks */
  int32_t most_q16;    /* largest DAC code without contact */
  int32_t least_q16;   /* smallest DAC code without contact */
  int32_t bounded_cnt; /* encoder count for which these two codes were computed */
  /* force set-point of the next tick, in 1/256 count; 0 without a force mode */
  int32_t setpoint;
  int32_t demand;         /* demand from which the set-point follows, in any unit */
  int32_t steady_demand;  /* demand in the present slot of the force ripple */
  int32_t first_cnt;      /* encoder count at the first contact */
  int32_t approach_cnt;   /* encoder count at the start of the approach */
  uint32_t approach_tick; /* duration of the approach in ticks */
  int32_t low;            /* smallest measured force in the present slot of the force ripple */
  int32_t high;
  axis_codes_t codes;     /* most_q16 and least_q16 as rounded DAC codes */
  uint16_t settling_tick; /* ticks until a limit cycle is checked again */
  uint8_t slot_tick;
  uint8_t slots;      /* number of consecutive slots with too much force ripple */
  uint8_t steady;     /* 1: the demand has not changed in the present slot */
  int8_t approaching; /* sign of the demand of the present approach, 0 without an approach */
  int8_t pressing;    /* sign of the measured force at the first contact, 0 before it */
  uint8_t begun;      /* 1: the bounds of the DAC code act on the force law */
  uint8_t finding;    /* AXIS_FAULT_ that still needs a reaction */
} contact_guard_t;

/* Force control begins: resets the contact guard. */
void contact_guard_start(contact_guard_t *guard);

/* Derives the values of the contact guard after a write to one of its parameters. */
void contact_guard_derive(contact_guard_t *guard, const drive_params_t *params);

/* Sets the demand of the next tick for a mode that has an approach of its own. Any target other
 * than 0 counts as a demand. */
static inline void contact_guard_approach(contact_guard_t *guard, int32_t target, int32_t demand) {
  guard->setpoint = (target > 0) ? INT32_MAX : (target < 0) ? -INT32_MAX : 0;
  guard->demand = demand;
}

/* Bounds the speed of the axis in the next tick, in a mode without an approach of its own whose
 * force law uses axis->params.force_setpoint. It changes parameters of the axis that the caller
 * overrides for the tick. */
void contact_guard_bound(contact_guard_t *guard, const drive_signals_t *signals, axis_t *axis);
static inline void contact_guard_press(contact_guard_t *guard, const drive_signals_t *signals,
                                       axis_t *axis, int32_t demand) {
  guard->setpoint = axis->params.force_setpoint;
  guard->demand = demand;
  if (guard->speed_q8 != 0) {
    contact_guard_bound(guard, signals, axis);
  }
}

/* Checks the protections of the contact guard; call it after every second tick of force control. */
void contact_guard_evaluate(contact_guard_t *guard, contact_t *contact,
                            const drive_params_t *params, drive_signals_t *signals,
                            const axis_t *axis);

/* Reacts to a finding of the contact guard: halves the gain and returns AXIS_FAULT_NONE, or returns
 * the fault that the drive must raise. */
uint8_t contact_guard_answer(contact_guard_t *guard, contact_t *contact,
                             const drive_params_t *params, drive_signals_t *signals, axis_t *axis);

#endif
