#ifndef FIRMWARE_GUARD_GUARDS_H_
#define FIRMWARE_GUARD_GUARDS_H_

/* The protections: their states, and which of them acts in which phase of a tick. The drive calls
 * the phases below and knows no protection by its name where a phase is enough. A new protection is
 * its file, its state in guards_t and one line in each phase in which it acts.
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
 *   init      power-up: no finding, nothing under way
 *   derive    a parameter of the drive was written: the values that follow from the parameters
 *   written   a parameter of the axis or of the drive got another value: results that it voids
 *   start     a mode that controls force begins
 *   before    before each tick, while the targets of the drive do not exist yet
 *   limit     before axis_tick(), with the inputs of the tick
 *   check     after axis_tick(), before its outputs go out: a finding disables the axis at once
 *   observe   after each tick: signals of the protection
 *   evaluate  after every second tick: findings that are answered in the next tick
 *   answer    in the tick after a finding: a fault to be raised, or a smaller gain
 *
 * The phases are direct calls and not a walk over a table of functions: a walk costs 17
 * instructions for each row, and the interrupt has no room for them (docs/decisions/0046). */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/guard/contact.h"
#include "firmware/guard/contact_excitation.h"
#include "firmware/guard/contact_guard.h"
#include "firmware/guard/first_motion.h"
#include "firmware/guard/sensor.h"
#include "firmware/guard/tare.h"

/* Copying it copies the protections. */
typedef struct {
  contact_t contact;
  contact_excitation_t excitation;
  contact_guard_t contact_guard;
  first_motion_t first_motion;
  sensor_t sensor;
  tare_t tare;
} guards_t;

void guards_init(guards_t *guards, drive_signals_t *signals);

/* At most 250 instructions, between ticks. */
void guards_derive(guards_t *guards, const drive_params_t *params, drive_signals_t *signals);

void guards_written(guards_t *guards, drive_signals_t *signals, uint16_t object);

/* Whether a protection that is under way depends on this object, so that a write is refused. */
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

/* `controlled`: a mode that controls force was on in the tick. */
static inline void guards_observe(guards_t *guards, const drive_params_t *params,
                                  drive_signals_t *signals, const axis_t *axis, bool controlled) {
  tare_tick(&guards->tare, params, signals, axis);
  if (axis->primed != 0) {
    contact_tick(&guards->contact, params, signals, axis, controlled);
  }
}

/* Whether guards_evaluate() uses `guided`, which the caller need not compute otherwise. */
static inline bool guards_need_guided(const guards_t *guards) {
  return guards->sensor.enabled != 0;
}

/* `guided`: the motion depends on the measured force (cia402_is_guided_by_force()). */
static inline void guards_evaluate(guards_t *guards, const drive_params_t *params,
                                   drive_signals_t *signals, const axis_t *axis, bool controlled,
                                   bool guided) {
  if (guards->sensor.enabled != 0) {
    sensor_guides(&guards->sensor, axis, guided);
  }
  if (axis->primed != 0 && controlled) {
    contact_guard_judge(&guards->contact_guard, &guards->contact, params, signals, axis);
  }
}

/* Whether guards_answer() has something to answer. */
static inline bool guards_have_finding(const guards_t *guards) {
  return guards->contact_guard.finding != AXIS_FAULT_NONE;
}

/* The fault to be raised (AXIS_FAULT_); AXIS_FAULT_NONE if the protection itself has answered. */
uint8_t guards_answer(guards_t *guards, const drive_params_t *params, drive_signals_t *signals,
                      axis_t *axis);

#endif
