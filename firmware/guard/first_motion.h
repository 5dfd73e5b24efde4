#ifndef FIRMWARE_GUARD_FIRST_MOTION_H_
#define FIRMWARE_GUARD_FIRST_MOTION_H_

/* The test before the first motion (first_motion_test): sensors, amplifier and signs are checked by
 * a small motion in open loop before a law is closed over them, at the first enabling since
 * power-up, or since a parameter was written that decides what the readings mean. An axis that was
 * stopped during the test, or failed it, is tested again when it is enabled again.
 *
 *   standing   amplifier off. Encoder and force reading stay where they are for
 *              FIRST_MOTION_STAND_TICKS, the reading within contact_force; they may take
 *              FIRST_MOTION_REST_TICKS to do so. No reading is at an end of its range, and the
 *              current does not jump.
 *   zero       amplifier on, code 0 for FIRST_MOTION_ZERO_TICKS: the encoder moves by less than
 *              first_motion_counts.
 *   out        away from the workpiece, but toward it where a limit allows no other way: the code
 *              rises by one in two ticks, at most to first_motion_code, until the encoder has moved
 *              by first_motion_counts. At most FIRST_MOTION_HOLD_TICKS at the largest code.
 *   back       the same code the other way, until the encoder is back or a limit is reached.
 *
 * On both ways the fault `runaway` ends a motion faster than first_motion_speed or
 * further than FIRST_MOTION_REACH times first_motion_counts. On the way out the reading may not
 * change against the motion by more than contact_force, and one that begins beyond contact_force
 * must change with it. With the default bounds the test takes some 0.3 s, less than the 0.4 s
 * that masters allow a transition, and at most 1.8 s.
 *
 * Out of contact the sign of the force cannot be seen. So the test is followed by a watch: until
 * the first contact, a reading below -contact_force while the axis moves toward the workpiece is
 * the fault force_reversed.
 *
 * An encoder that is dead moves the axis unseen for as long as the code rises and is held: on an
 * axis of 0.4 m/s at 2047 codes some 5 mm. A reading of 0 is no finding where force_zero_code is
 * 0, nor is a current of 0: an axis without such a sensor reads it.
 *
 * Every finding disables the axis in its own tick, is latched as a fault and stays in
 * first_motion_result. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"

enum {
  FIRST_MOTION_STAND_TICKS = 64,  /* 43 ms: two periods of 50 Hz */
  FIRST_MOTION_REST_TICKS = 1500, /* 1 s to come to a stand */
  FIRST_MOTION_ZERO_TICKS = 90,   /* 60 ms: a brake releases meanwhile */
  FIRST_MOTION_HOLD_TICKS = 300,  /* 200 ms: ten time constants of a slow drive */
  FIRST_MOTION_REACH = 8,         /* of an axis that slows down behind its code */
  FIRST_MOTION_JITTER_CNT = 2     /* of an encoder at a stand */
};

/* Phases in their order. Watching and done: the test is passed. */
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
  int32_t start_cnt;     /* where the phase began */
  int32_t force_start;   /* and the reading there */
  int32_t force_low;     /* of the readings at a stand */
  int32_t force_high;    /* and the highest */
  int16_t current_start; /* per mille of the range */
  uint16_t phase_tick;   /* ticks of the phase; of out and back, at the largest code */
  uint16_t rest_tick;    /* ticks of coming to a stand */
  int16_t code;          /* magnitude of what is put out */
  uint8_t phase;         /* FIRST_MOTION_ */
  int8_t direction;      /* of the way out */
  uint8_t sign_seen;     /* 1: the test has seen the force change as it should */
  uint8_t moves;         /* 1: the encoder, not the force, was last not steady */
  uint8_t rises;         /* 1: the code rises in this tick */
} first_motion_t;

/* Power-up, or a parameter was written that the result depends on: there is none. */
void first_motion_forget(first_motion_t *first, drive_signals_t *signals);

/* Whether the result depends on an object: the option itself, and what the readings mean. */
bool first_motion_depends_on(uint16_t object);

/* Whether an object is one of its bounds, or what it judges by: not written while it runs. */
bool first_motion_is_bounded_by(uint16_t object);

/* The axis is enabled by the state machine: the test begins where it is asked for and not passed
 * yet. */
void first_motion_begin(first_motion_t *first, const drive_params_t *params,
                        drive_signals_t *signals);

/* The axis is disabled, or moved by the port itself: a test under way ends without a result. */
void first_motion_cancel(first_motion_t *first, drive_signals_t *signals);

/* Whether the test moves the axis, and nothing else may. */
static inline bool first_motion_is_running(const first_motion_t *first) {
  return first->phase >= FIRST_MOTION_STANDING && first->phase <= FIRST_MOTION_BACK;
}

/* Before a tick of a running test: mode and code of the axis, whose parameters open_loop_code and
 * bump_decay_shift are overridden by the caller. `halted`: the axis is off, and the test begins
 * anew. */
void first_motion_command(first_motion_t *first, axis_t *axis, bool halted);

/* A mode that moves by the position law, without a position_gain: the fault position_gain_zero. */
void first_motion_refuse(first_motion_t *first, drive_signals_t *signals, axis_t *axis);

/* After axis_tick(), before its outputs are put out: judges the tick. A finding takes them back. */
void first_motion_judge(first_motion_t *first, const drive_params_t *params,
                        drive_signals_t *signals, axis_t *axis, axis_outputs_t *outputs);
static inline void first_motion_check(first_motion_t *first, const drive_params_t *params,
                                      drive_signals_t *signals, axis_t *axis,
                                      axis_outputs_t *outputs) {
  if (first->phase != FIRST_MOTION_OPEN && first->phase != FIRST_MOTION_DONE) {
    first_motion_judge(first, params, signals, axis, outputs);
  }
}

#endif
