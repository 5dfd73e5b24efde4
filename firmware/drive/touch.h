#ifndef FIRMWARE_DRIVE_TOUCH_H_
#define FIRMWARE_DRIVE_TOUCH_H_

/* Protections of motion around the contact, while a mode controls force. Each is off at its
 * default.
 *
 *   touch_velocity_max   Out of contact a force law presses with at most the code that keeps the
 *                        axis at this speed: a code that rises by position_gain a count that the
 *                        axis is behind, and that leads the code put out by one tick's way at most.
 *                        So the speed has no error at length, whatever the amplifier makes of a
 *                        code, and passes it by less than a count a tick; without a position_gain
 *                        the axis stays where it is. Both directions are bounded, because the
 *                        workpiece may be on either side. Contact is taken over without a bump.
 *   contact_travel_max   Counts in the direction of pressing, which is the sign of the reading at
 *                        the first contact since force control began: fault contact_travel.
 *   approach_timeout     Time and counts out of contact with a demand: a target in modes 4 and 10,
 *   approach_travel_max  in the others a set-point that would be contact. Fault no_contact. Both
 *                        begin anew with a contact, without a demand and with its sign.
 *   force_ripple_max     The largest less the smallest reading of TOUCH_SLOT_TICKS. Above this in
 *   force_ripple_time    slots of the same demand for so long it is a limit cycle, as lost contacts
 *                        are (contact.h).
 *   contact_unstable_option  What a limit cycle leads to. Half the gain is taken over without a
 *                        bump, losses and ripple are counted anew, and the gain is whole again once
 *                        the axis was disabled. After TOUCH_HALVINGS it is the fault
 *                        contact_unstable.
 *
 * A fault follows fault_reaction_option. What is judged is judged in every second tick and answered
 * in the next one. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/drive/contact.h"

enum { TOUCH_SLOT_TICKS = 150, TOUCH_HALVINGS = 3 };

typedef struct {
  int32_t speed_q16;      /* touch_velocity_max, count a tick */
  int32_t cap_q16;        /* largest code that presses out of contact */
  int32_t demand;         /* of the coming tick, in any unit */
  int32_t steady_demand;  /* of the ripple's slot */
  int32_t first_cnt;      /* where contact was first */
  int32_t approach_cnt;   /* where the approach began */
  uint32_t approach_tick; /* for how long it has been under way */
  int32_t low;            /* reading, in the ripple's slot */
  int32_t high;
  uint8_t slot_tick;
  uint8_t slots;      /* of too much ripple, one after the other */
  uint8_t steady;     /* 1: the demand has been the same throughout the slot */
  int8_t direction;   /* of the demand, 0 without one */
  int8_t approaching; /* of the approach under way, 0 without one */
  int8_t pressing;    /* at the first contact, 0 before it */
  uint8_t finding;    /* AXIS_FAULT_ to be answered */
} touch_t;

/* Force control begins. */
void touch_start(touch_t *touch);

/* A parameter of touch_t was written. */
void touch_derive(touch_t *touch, const drive_params_t *params);

/* What the mode asks for in the coming tick. */
static inline void touch_demand(touch_t *touch, int32_t direction, int32_t demand) {
  touch->direction = (int8_t)((direction > 0) - (direction < 0));
  touch->demand = demand;
}

/* The force law acts on axis->params.force_setpoint in the coming tick, without an approach of its
 * own: bounds its speed, by parameters of the axis that the caller overrides for the tick. */
void touch_press(touch_t *touch, const drive_signals_t *signals, axis_t *axis, int32_t demand);

/* After every second tick of force control. */
void touch_judge(touch_t *touch, contact_t *contact, const drive_params_t *params,
                 drive_signals_t *signals, const axis_t *axis);

/* Answers a finding: halves the gain, or gives the fault to be raised, else AXIS_FAULT_NONE. */
uint8_t touch_answer(touch_t *touch, contact_t *contact, const drive_params_t *params,
                     drive_signals_t *signals, axis_t *axis);

#endif
