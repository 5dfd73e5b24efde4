#ifndef FIRMWARE_GUARD_FIRST_MOTION_H_
#define FIRMWARE_GUARD_FIRST_MOTION_H_

/* The first motion test (first_motion_test) checks sensors, amplifier and signs by a small motion
 * in open loop before a control law is closed. It runs when the axis is enabled for the first time
 * after power-up, or after a write to a parameter that determines the meaning of measured values.
 * If the axis was stopped during the test, or failed it, the test runs again when the axis is next
 * enabled.
 *
 *   standing   The amplifier is off. Encoder and measured force must not change for
 *              FIRST_MOTION_STAND_TICKS, and the measured force must be within contact_force. The
 *              axis has FIRST_MOTION_REST_TICKS for this. No sensor may be at an end of its range,
 *              and the current must not jump.
 *   zero       The amplifier is on with code 0 for FIRST_MOTION_ZERO_TICKS: the encoder must move
 * by less than first_motion_counts. out        The axis moves away from the workpiece, or towards
 * it if a limit permits no other direction. The code rises by one in two ticks, at most to
 * first_motion_code, until the encoder has moved by first_motion_counts. The largest code lasts at
 * most FIRST_MOTION_HOLD_TICKS. back       The same code in the other direction, until the encoder
 * is back or a limit is reached.
 *
 * In "out" and "back" a motion that is faster than first_motion_speed, or further than
 * FIRST_MOTION_REACH times first_motion_counts, is the fault `runaway`. In "out" the measured force
 * must not change against the motion by more than contact_force, and a measured force that begins
 * beyond contact_force must change with the motion. With the default bounds the test takes about
 * 0.3 s, less than the 0.4 s that masters permit for a transition, and at most 1.8 s.
 *
 * Without contact the sign of the force cannot be seen. Therefore a check continues after the test:
 * until the first contact, a measured force below -contact_force while the axis moves towards the
 * workpiece is the fault force_reversed.
 *
 * With a dead encoder the axis moves undetected while the code rises and while the largest code
 * lasts: about 5 mm on an axis with 0.4 m/s at 2047 codes. A force code of 0 is no fault if
 * force_zero_code is 0, and a current of 0 is no fault, because an axis without such a sensor
 * measures 0.
 *
 * Every finding disables the axis in the same tick, is latched as a fault and stays in
 * first_motion_result. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"

enum {
  FIRST_MOTION_STAND_TICKS = 64,  /* 43 ms: two periods of 50 Hz */
  FIRST_MOTION_REST_TICKS = 1500, /* 1 s for the axis to reach standstill */
  FIRST_MOTION_ZERO_TICKS = 90,   /* 60 ms, in which a brake releases */
  FIRST_MOTION_HOLD_TICKS = 300,  /* 200 ms: ten time constants of a slow drive */
  /* a motion may exceed first_motion_counts by this factor, because the axis slows down later than
   * its code */
  FIRST_MOTION_REACH = 8,
  FIRST_MOTION_JITTER_CNT = 2 /* largest change of the encoder at standstill, in counts */
};

/* Phases of the first motion test in their order. In the phases "watching" and "done" the test is
 * passed. */
enum {
  FIRST_MOTION_OPEN = 0,
  FIRST_MOTION_STANDING = 1,
  FIRST_MOTION_ZERO = 2,
  FIRST_MOTION_OUT = 3,
  FIRST_MOTION_BACK = 4,
  FIRST_MOTION_WATCHING = 5,
  FIRST_MOTION_DONE = 6
};

typedef struct {
  int32_t start_cnt;     /* encoder count at the start of the phase */
  int32_t force_start;   /* measured force at the start of the phase */
  int32_t force_low;     /* smallest measured force at standstill */
  int32_t force_high;    /* largest measured force at standstill */
  int16_t current_start; /* motor current at the start, in per mille of the range */
  uint16_t phase_tick;   /* ticks in the phase; in "out" and "back", ticks at the largest code */
  uint16_t rest_tick;    /* ticks that the axis has needed to reach standstill */
  int16_t code;          /* magnitude of the DAC code that is output */
  uint8_t phase;         /* FIRST_MOTION_ */
  int8_t direction;      /* direction of motion in the phase "out" */
  /* 1: the test has seen the measured force change in the correct direction */
  uint8_t sign_seen;
  /* 1: the last change seen at standstill was that of the encoder; 0: of the force */
  uint8_t moves;
  uint8_t rises; /* 1: the code increases in this tick */
} first_motion_t;

/* Discards the result of the test, at power-up or after a write to a parameter on which the result
 * depends. */
void first_motion_forget(first_motion_t *first, drive_signals_t *signals);

/* Whether the result of the test depends on an object: the option itself, or a parameter that
 * determines the meaning of measured values. */
bool first_motion_depends_on(uint16_t object);

/* Whether an object is a bound or a criterion of the test. Such an object cannot be written while
 * the test runs. */
bool first_motion_is_bounded_by(uint16_t object);

/* The state machine enables the axis: starts the test if it is selected and not passed yet. */
void first_motion_begin(first_motion_t *first, const drive_params_t *params,
                        drive_signals_t *signals);

/* The axis is disabled, or the port itself moves it: ends a running test without a result. */
void first_motion_cancel(first_motion_t *first, drive_signals_t *signals);

/* Whether the test moves the axis; no other function may move it then. */
static inline bool first_motion_is_running(const first_motion_t *first) {
  return first->phase >= FIRST_MOTION_STANDING && first->phase <= FIRST_MOTION_BACK;
}

/* Sets mode and DAC code of the axis before a tick of a running test; the caller overrides the
 * parameters open_loop_code and bump_decay_shift. `halted`: the axis is switched off, and the test
 * starts again. */
void first_motion_command(first_motion_t *first, axis_t *axis, bool halted);

/* Refuses a mode that moves by the position law while position_gain is 0: the fault is
 * position_gain_zero. */
void first_motion_refuse(first_motion_t *first, drive_signals_t *signals, axis_t *axis);

/* Checks the tick of a running test, after axis_tick() and before the outputs are written. A
 * finding sets the outputs to the safe state. */
void first_motion_check_running(first_motion_t *first, const drive_params_t *params,
                                drive_signals_t *signals, axis_t *axis, axis_outputs_t *outputs);
static inline void first_motion_check(first_motion_t *first, const drive_params_t *params,
                                      drive_signals_t *signals, axis_t *axis,
                                      axis_outputs_t *outputs) {
  if (first->phase != FIRST_MOTION_OPEN && first->phase != FIRST_MOTION_DONE) {
    first_motion_check_running(first, params, signals, axis, outputs);
  }
}

#endif
