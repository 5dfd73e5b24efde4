#ifndef FIRMWARE_GUARD_CONTACT_GUARD_H_
#define FIRMWARE_GUARD_CONTACT_GUARD_H_

/* The contact guard: protections of the motion before and after contact, while a mode controls
 * force. By default each protection is off.
 *
 *   touch_velocity_max   Limit of the speed without contact. The largest permitted DAC code rises
 *                        by a quarter of position_gain for each count by which the axis is behind
 *                        this speed, and falls by the same amount for each count by which the axis
 *                        is ahead. So the mean speed stays at the limit for every gain of the
 *                        amplifier; the laboratory axis exceeds the limit by a tenth. If
 *                        position_gain is 0, the axis does not move. Each direction has a separate
 *                        bound, because the workpiece may be on either side, and because a bump
 *                        bias may act against the direction of the set-point. Codes of these bounds
 *                        are without the output bias. Bumpless transfer acts at the contact.
 *   contact_travel_max   Largest travel after the first contact, in counts in the direction of
 *                        pressing. This direction is the sign of the measured force at the first
 *                        contact since force control began. A larger travel is the fault
 *                        contact_travel. A running cycle (mode -9) counts from its first contact,
 *                        in each of its phases; in phases that control no force only in contact.
 *   approach_timeout     Largest time and largest travel without contact while a demand acts. The
 *   approach_travel_max  demand is a target in modes 4 and 10. In other modes the demand is a
 *                        set-point whose magnitude exceeds contact_force. A larger time or travel
 *                        is the fault no_contact. Time and travel restart from 0 at each contact,
 *                        without a demand, and when the sign of the demand changes. Phases of a
 *                        cycle that control no force neither count nor restart them.
 *   force_ripple_max     Largest permitted force ripple in CONTACT_GUARD_SLOT_TICKS.
 *   force_ripple_time    A larger force ripple during this time is a limit cycle, like repeated
 *                        contact losses (contact.h). The ripple is checked only at a constant
 *                        demand and without excitation.
 *   contact_unstable_option
 *                        Reaction to a limit cycle. The gain is halved with bumpless transfer, and
 *                        the guard then waits for CONTACT_GUARD_SETTLING_TICKS. When the axis is
 *                        disabled, the gain is restored. After TOUCH_HALVINGS the fault is
 *                        contact_unstable.
 *
 * fault_reaction_option determines the reaction to these faults. The travel and the approach are
 * checked in every fourth tick. A limit cycle is also checked in every fourth tick, but in another
 * one. The reaction follows in the next tick. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/guard/contact.h"
#include "firmware/objects/generated/axis_objects_drive.h"

enum { CONTACT_GUARD_SLOT_TICKS = 152, TOUCH_HALVINGS = 3, CONTACT_GUARD_SETTLING_TICKS = 1500 };

typedef struct {
  /* speed touch_velocity_max in counts per two ticks, with 8 fractional bits */
  int32_t speed_q8;
  int32_t most_q16;    /* largest permitted DAC code without contact, in 1/65536 code */
  int32_t least_q16;   /* smallest permitted DAC code without contact, in 1/65536 code */
  int32_t bounded_cnt; /* encoder count at which most_q16 and least_q16 were computed */
  /* force set-point of the next tick, in 1/256 count; 0 if no force mode is active */
  int32_t setpoint;
  /* demanded force before it is converted to a force set-point, in the unit of the mode of
   * operation */
  int32_t demand;
  /* demanded force at the start of the present time slot of the force ripple */
  int32_t steady_demand;
  int32_t first_cnt; /* encoder count at the first contact */
  /* encoder count and tick at the start of the approach. The travel and the time of later cycle
   * phases that do not control force are added to both values, so that these phases do not count */
  int32_t approach_cnt;
  uint32_t approach_tick;
  /* encoder count and tick at the begin of the present phase of a cycle, if this phase does not
   * control force */
  int32_t paused_cnt;
  uint32_t paused_tick;
  int32_t low; /* smallest measured force in the present time slot of the force ripple */
  int32_t high;
  axis_codes_t codes; /* the bounds most_q16 and least_q16, rounded to whole DAC codes */
  /* number of ticks until the contact guard checks for a limit cycle again */
  uint16_t settling_tick;
  uint8_t slot_tick;
  uint8_t slots; /* number of consecutive time slots whose force ripple was too large */
  /* 1 if the demanded force has not changed in the present time slot of the force ripple */
  uint8_t steady;
  /* sign of the demanded force during the present approach; 0: there is no approach */
  int8_t approaching;
  /* sign of the measured force at the first contact; 0 before the first contact */
  int8_t pressing;
  uint8_t begun;   /* 1 if the bounds of the DAC code act on the force law */
  uint8_t finding; /* detected fault (AXIS_FAULT_) to which the drive has not reacted yet */
} contact_guard_t;

/* Resets the contact guard at the start of force control. */
void contact_guard_start(contact_guard_t *guard);

/* Computes the values of the contact guard that depend on its parameters. Call this function after
 * a write to a parameter of the contact guard. */
void contact_guard_derive(contact_guard_t *guard, const drive_params_t *params);

/* Sets the demanded force of the next tick for a mode that has its own approach to the workpiece.
 * Every target other than 0 counts as a demand. */
static inline void contact_guard_approach(contact_guard_t *guard, int32_t target, int32_t demand) {
  guard->setpoint = (target > 0) ? INT32_MAX : (target < 0) ? -INT32_MAX : 0;
  guard->demand = demand;
}

/* Bounds the speed of the axis in the next tick. Use this function for modes without their own
 * approach whose force law uses axis->params.force_setpoint. The function changes parameters of the
 * axis; the caller must restore these parameters after the tick. */
void contact_guard_bound(contact_guard_t *guard, const drive_signals_t *signals, axis_t *axis);
static inline void contact_guard_press(contact_guard_t *guard, const drive_signals_t *signals,
                                       axis_t *axis, int32_t demand) {
  guard->setpoint = axis->params.force_setpoint;
  guard->demand = demand;
  if (guard->speed_q8 != 0) {
    contact_guard_bound(guard, signals, axis);
  }
}

/* Checks the protections of the contact guard. Call this function after every second tick of force
 * control or of a cycle. `controlled` is true if the mode of operation or the phase of the cycle
 * controls force. */
void contact_guard_evaluate(contact_guard_t *guard, contact_t *contact,
                            const drive_params_t *params, drive_signals_t *signals,
                            const axis_t *axis, bool controlled);

/* Call this function after the last tick of a phase of a cycle if only this phase or only the next
 * phase controls force. `controls` is true if the next phase controls force. */
void contact_guard_phase(contact_guard_t *guard, const drive_params_t *params,
                         const drive_signals_t *signals, const axis_t *axis, bool controls);

/* Returns true if the guard has detected a violation that becomes a fault in the next tick,
 * whatever reaction the option objects select. */
static inline bool contact_guard_has_fault(const contact_guard_t *guard) {
  return guard->finding == AXIS_FAULT_CONTACT_TRAVEL || guard->finding == AXIS_FAULT_NO_CONTACT;
}

/* Reacts to a violation that the contact guard has detected. Either halves the gain and returns
 * AXIS_FAULT_NONE, or returns the fault that the drive must raise. */
uint8_t contact_guard_answer(contact_guard_t *guard, contact_t *contact,
                             const drive_params_t *params, drive_signals_t *signals, axis_t *axis);

#endif
