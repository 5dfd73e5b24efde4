#ifndef FIRMWARE_GUARD_GUARDS_H_
#define FIRMWARE_GUARD_GUARDS_H_

/* The states of all protections, and the phases of a tick in which each protection acts. The drive
 * calls the phases that are columns of the following table. It calls a single protection directly
 * only where no phase is suitable. A new protection needs its own file, its state in guards_t, and
 * one line in the function of each of its phases.
 *
 *                      init  derive  written  start  before  limit  check  observe  evaluate answer
 *   first_motion        x              x                            x
 *   sensor              x      x                                    x                  x
 *   tare                x                                                   x
 *   calibration                x
 *   contact             x                      x                            x
 *   contact_guard       x      x               x       x                               x        x
 *   contact_excitation  x                                    x
 *
 *   init      at power-up: clears violations, tests and measurements
 *   derive    after a write to a parameter of the drive: computes derived values
 *   written   after a change of a parameter of the axis or drive: discards invalid results
 *   start     when a mode that controls force or a cycle begins: resets the protection
 *   before    before each tick, when the targets of the drive are not set yet
 *   limit     before axis_tick(), with the inputs of the tick
 *   check     after axis_tick(), before the outputs are written: a violation disables the axis
 *   observe   after each tick: updates the signals of the protection
 *   evaluate  after every second tick: a violation acts in the next tick
 *   answer    in the tick after a violation: raises a fault or reduces the gain
 *
 * The function of each phase calls the protections directly. A loop over a table of functions would
 * need 17 more instructions for each protection. This is too many for the interrupt
 * (docs/decisions/0046). */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/guard/contact.h"
#include "firmware/guard/contact_excitation.h"
#include "firmware/guard/contact_guard.h"
#include "firmware/guard/first_motion.h"
#include "firmware/guard/sensor.h"
#include "firmware/guard/tare.h"
#include "firmware/objects/generated/axis_objects_drive.h"

/* States of all protections. A copy of this structure is a copy of the protections. */
typedef struct {
  contact_t contact;
  contact_excitation_t excitation;
  contact_guard_t contact_guard;
  first_motion_t first_motion;
  sensor_t sensor;
  tare_t tare;
} guards_t;

void guards_init(guards_t *guards, drive_signals_t *signals);

/* Computes the values of the protections that depend on the parameters. This needs at most 250
 * instructions. Call this function between ticks. */
void guards_derive(guards_t *guards, const drive_params_t *params, drive_signals_t *signals);

void guards_written(guards_t *guards, drive_signals_t *signals, uint16_t object);

/* Returns true if an active protection depends on this object. The firmware then refuses a write to
 * the object. */
bool guards_freeze(const guards_t *guards, uint16_t object);

void guards_start(guards_t *guards, drive_signals_t *signals);

static inline void guards_before(guards_t *guards) { guards->contact_guard.setpoint = 0; }

static inline void guards_limit(guards_t *guards, const drive_params_t *params,
                                drive_signals_t *signals, axis_t *axis,
                                const axis_inputs_t *inputs) {
  if (contact_excitation_is_active(signals)) {
    contact_excitation_add(&guards->excitation, params, signals, axis, inputs);
  }
}

static inline void guards_check(guards_t *guards, const drive_params_t *params,
                                drive_signals_t *signals, axis_t *axis, axis_outputs_t *outputs) {
  first_motion_check(&guards->first_motion, params, signals, axis, outputs);
  sensor_check(&guards->sensor, params, axis, outputs);
}

/* Updates the signals of the protections after a tick. `controlled` is true if a mode with force
 * control was active in the tick. */
static inline void guards_observe(guards_t *guards, const drive_params_t *params,
                                  drive_signals_t *signals, const axis_t *axis, bool controlled) {
  tare_tick(&guards->tare, params, signals, axis);
  if (axis->primed != 0) {
    contact_tick(&guards->contact, params, signals, axis, controlled);
  }
}

/* Returns true if guards_evaluate() uses its argument `guided`. If not, the caller need not compute
 * this argument. */
static inline bool guards_need_guided(const guards_t *guards) {
  return guards->sensor.enabled != 0;
}

/* Checks the protections. `guided` is true if the motion depends on the measured force
 * (cia402_is_guided_by_force()). `cycles` is true while a cycle is running. */
static inline void guards_evaluate(guards_t *guards, const drive_params_t *params,
                                   drive_signals_t *signals, const axis_t *axis, bool controlled,
                                   bool guided, bool cycles) {
  if (guards->sensor.enabled != 0) {
    sensor_guides(&guards->sensor, axis, guided);
  }
  if (axis->primed != 0 && (controlled || cycles)) {
    contact_guard_evaluate(&guards->contact_guard, &guards->contact, params, signals, axis,
                           controlled);
  }
}

/* Returns true if a protection has detected a violation to which guards_answer() must react. */
static inline bool guards_have_finding(const guards_t *guards) {
  return guards->contact_guard.finding != AXIS_FAULT_NONE;
}

/* Returns the fault (AXIS_FAULT_) that the drive must raise, or AXIS_FAULT_NONE if the protection
 * itself has reacted to the violation. */
uint8_t guards_answer(guards_t *guards, const drive_params_t *params, drive_signals_t *signals,
                      axis_t *axis);

#endif
