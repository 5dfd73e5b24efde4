#ifndef FIRMWARE_GUARD_CONTACT_GUARD_H_
#define FIRMWARE_GUARD_CONTACT_GUARD_H_

/* Protections of motion around the contact, while a mode controls force. Each is off at its
 * default.
 *
 *   touch_velocity_max   Out of contact no code drives the axis with more than what rises by a
 *                        quarter of position_gain for each count that the axis is behind this
 *                        speed and falls as much for each that it is ahead. So the mean speed
 *                        is held whatever the amplifier makes of a code; the laboratory axis
 *                        overshoots by a tenth. Without a position_gain the axis stays where it
 *                        is. Each direction has its bound, because the workpiece may be on
 *                        either side, and the bias of a bump may drive where the set-point does
 *                        not. Contact is taken over without a bump.
 *   contact_travel_max   Counts in the direction of pressing, which is the sign of the reading
 *                        at the first contact since force control began: contact_travel.
 *   approach_timeout     Time and counts out of contact with a demand, which in modes 4 and 10
 *   approach_travel_max  is a target, in the others a set-point that would be contact: fault
 *                        no_contact. They start again at each contact, without a demand and
 *                        when its sign changes.
 *   force_ripple_max     The largest less the smallest reading in CONTACT_GUARD_SLOT_TICKS. More
 * than force_ripple_time    this, for so long, in slots of one demand and without excitation, is a
 *                        limit cycle as lost contacts are (contact.h).
 *   contact_unstable_option  What a limit cycle leads to. Half the gain is taken over without a
 *                        bump and given CONTACT_GUARD_SETTLING_TICKS to settle; the gain is whole
 * again once the axis was disabled. After TOUCH_HALVINGS: contact_unstable.
 *
 * A fault follows fault_reaction_option. Every fourth tick judges travel and approach, another one
 * the limit cycle; the answer is the tick after it. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/guard/contact.h"

enum { CONTACT_GUARD_SLOT_TICKS = 152, TOUCH_HALVINGS = 3, CONTACT_GUARD_SETTLING_TICKS = 1500 };

typedef struct {
  int32_t speed_q8;       /* touch_velocity_max, count in two ticks */
  int32_t most_q16;       /* largest code out of contact */
  int32_t least_q16;      /* and the smallest */
  int32_t bounded_cnt;    /* where the axis was when they were made */
  int32_t setpoint;       /* of the coming tick, 1/256 count; without a force mode 0 */
  int32_t demand;         /* from which it follows, in any unit */
  int32_t steady_demand;  /* of the ripple's slot */
  int32_t first_cnt;      /* where contact was first */
  int32_t approach_cnt;   /* where the approach began */
  uint32_t approach_tick; /* for how long it has been under way */
  int32_t low;            /* reading, in the ripple's slot */
  int32_t high;
  axis_codes_t codes;     /* the two, rounded */
  uint16_t settling_tick; /* until a limit cycle is judged again */
  uint8_t slot_tick;
  uint8_t slots;      /* of too much ripple, one after the other */
  uint8_t steady;     /* 1: the demand has been the same throughout the slot */
  int8_t approaching; /* sign of the demand of the approach under way, 0 without one */
  int8_t pressing;    /* sign of the reading at the first contact, 0 before it */
  uint8_t begun;      /* 1: the force law has these codes */
  uint8_t finding;    /* AXIS_FAULT_ to be answered */
} contact_guard_t;

/* Force control begins. */
void contact_guard_start(contact_guard_t *guard);

/* A parameter of contact_guard_t was written. */
void contact_guard_derive(contact_guard_t *guard, const drive_params_t *params);

/* What a mode with an approach of its own asks for in the coming tick: any target moves it. */
static inline void contact_guard_approach(contact_guard_t *guard, int32_t target, int32_t demand) {
  guard->setpoint = (target > 0) ? INT32_MAX : (target < 0) ? -INT32_MAX : 0;
  guard->demand = demand;
}

/* The force law acts on axis->params.force_setpoint in the coming tick, without an approach of its
 * own: bounds its speed, by parameters of the axis that the caller overrides for the tick. */
void contact_guard_bound(contact_guard_t *guard, const drive_signals_t *signals, axis_t *axis);
static inline void contact_guard_press(contact_guard_t *guard, const drive_signals_t *signals,
                                       axis_t *axis, int32_t demand) {
  guard->setpoint = axis->params.force_setpoint;
  guard->demand = demand;
  if (guard->speed_q8 != 0) {
    contact_guard_bound(guard, signals, axis);
  }
}

/* After every second tick of force control. */
void contact_guard_judge(contact_guard_t *guard, contact_t *contact, const drive_params_t *params,
                         drive_signals_t *signals, const axis_t *axis);

/* Answers a finding: halves the gain, or gives the fault to be raised, else AXIS_FAULT_NONE. */
uint8_t contact_guard_answer(contact_guard_t *guard, contact_t *contact,
                             const drive_params_t *params, drive_signals_t *signals, axis_t *axis);

#endif
