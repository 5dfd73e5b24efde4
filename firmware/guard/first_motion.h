#ifndef FIRMWARE_GUARD_FIRST_MOTION_H_
#define FIRMWARE_GUARD_FIRST_MOTION_H_

/* The first motion test (first_motion_test) checks sensors, amplifier and signs by a small motion
 * in open loop, before a control law acts. The test runs when the axis is enabled for the first
 * time after power-up. It also runs when the axis is enabled for the first time after a write to a
 * parameter that determines the meaning of measured values. If the test was stopped or failed, the
 * test runs again when the axis is next enabled.
 *
 *   standing   The amplifier is off. Encoder and measured force must not change for
 *              FIRST_MOTION_STAND_TICKS, and the measured force must be within contact_force. This
 *              phase lasts at most FIRST_MOTION_REST_TICKS. No sensor may be at an end of its
 *              range, and the motor current must not jump.
 *   zero       The amplifier is on with DAC code 0 for FIRST_MOTION_ZERO_TICKS. A fitted drive must
 *              be on before. The encoder must move by less than first_motion_counts.
 *   out        The axis moves away from the workpiece, or towards the workpiece if a limit prevents
 *              the motion away. The DAC code rises by one in two ticks, at most to
 *              first_motion_code, until the encoder has moved by first_motion_counts. The largest
 *              code lasts at most FIRST_MOTION_HOLD_TICKS.
 *   back       The axis moves back with the same code in the other direction, until the encoder is
 *              at its start count or a limit stops the axis.
 *
 * DAC codes of the test are commands, to which output_bias is added, so in the phase "zero" the
 * output bias alone has to hold the axis.
 *
 * In the phases "out" and "back" the fault is `runaway` if the axis is faster than
 * first_motion_speed or moves further than FIRST_MOTION_REACH times first_motion_counts. This bound
 * of the travel applies to the sum of the travel of all attempts that were halted or disabled. The
 * sum begins when the test has failed or passed, or when the code for the board has moved the axis.
 * The travel of an attempt consists of the motion with the amplifier on, and of the coasting after
 * the stop. The coasting lasts until the axis has stood for FIRST_MOTION_STAND_TICKS. The coasting
 * of an attempt is counted only when the next attempt is stopped too, so an axis that was stopped
 * once still passes. If the counted travel is beyond the bound, the next attempt ends as `runaway`
 * before the amplifier is on. The axis can therefore exceed the bound by the coasting of the last
 * two attempts. Coasting begins with at most the speed first_motion_speed, or with the speed that
 * made the attempt `runaway`. In the phase "out" the measured force must not change by more than
 * contact_force in the direction that contradicts the motion. If the magnitude of the measured
 * force exceeds contact_force at the start, the force must change in the direction of the motion.
 * With the default bounds the test takes about 0.3 s and at most 1.8 s. Masters permit 0.4 s for a
 * transition of the drive state.
 *
 * Without contact the test cannot determine the sign of the force. Therefore a check continues
 * after the test, until the first contact: the fault is force_reversed if the measured force is
 * below -contact_force while the axis moves towards the workpiece.
 *
 * If the encoder gives no counts, the motion of the axis is not detected while the DAC code rises
 * and while the largest code lasts: about 5 mm on an axis with 0.4 m/s at code 2047. A force code
 * of 0 is no fault if force_zero_code is 0. A motor current of 0 is no fault, because an axis
 * without a current sensor measures 0.
 *
 * If the test fails, the axis is disabled in the same tick; the reason is latched as a fault, and
 * is also shown by first_motion_result.*/

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/objects/generated/axis_objects_drive.h"

enum {
  /* duration of standstill without a change of encoder and force: 43 ms, two periods of 50 Hz */
  FIRST_MOTION_STAND_TICKS = 64,
  FIRST_MOTION_REST_TICKS = 1500, /* longest time until the axis is at standstill: 1 s */
  /* duration of the phase "zero" with code 0: 60 ms, the time in which a brake releases */
  FIRST_MOTION_ZERO_TICKS = 90,
  /* longest time for which the largest code is output: 200 ms, ten time constants of a slow
   * drive */
  FIRST_MOTION_HOLD_TICKS = 300,
  /* largest permitted motion as a multiple of first_motion_counts. It is more than 1, because the
     axis slows down later than its DAC code falls */
  FIRST_MOTION_REACH = 8,
  /* largest permitted change of the encoder at standstill, in counts */
  FIRST_MOTION_JITTER_CNT = 2
};

/* Phases of the first motion test in their order. In the phases "watching" and "done" the axis has
 * passed the test. */
enum {
  FIRST_MOTION_OPEN = 0,
  FIRST_MOTION_STANDING = 1,
  FIRST_MOTION_ZERO = 2,
  FIRST_MOTION_OUT = 3,
  FIRST_MOTION_BACK = 4,
  FIRST_MOTION_WATCHING = 5,
  FIRST_MOTION_DONE = 6,
  /* An attempt of the test was stopped, and the disabled axis has not been at standstill since
   * then. */
  FIRST_MOTION_COASTING = 7
};

typedef struct {
  int32_t start_cnt;  /* encoder count at the start of the present phase */
  int32_t origin_cnt; /* encoder count when the test switched the amplifier on */
  uint32_t moved_cnt; /* largest distance from origin_cnt in this attempt, coasting included */
  /* distance moved_cnt at the moment at which the amplifier was switched off */
  uint32_t stopped_cnt;
  uint32_t coasted_cnt; /* travel in counts by which the axis coasted after the previous attempt */
  /* sum of the travel of all earlier stopped attempts, without the coasting of the previous
   * attempt (coasted_cnt) */
  uint32_t spent_cnt;
  /* measured force at the start of the present phase of the first motion test */
  int32_t force_start;
  int32_t force_low;     /* smallest measured force at standstill */
  int32_t force_high;    /* largest measured force at standstill */
  int16_t current_start; /* motor current at the start of the test, in per mille of its range */
  /* number of ticks of the present phase; in the phases "out" and "back", number of ticks with the
   * largest code */
  uint16_t phase_tick;
  uint16_t rest_tick; /* number of ticks that the axis has needed to reach standstill */
  int16_t code;       /* magnitude of the DAC code that the test outputs */
  uint8_t phase;      /* phase of the test, FIRST_MOTION_ */
  int8_t direction;   /* direction of motion in the phase "out", +1 or -1 */
  /* 1 if the measured force has changed in the correct direction during the test */
  uint8_t sign_seen;
  /* 1 if the test last saw a change of the encoder while the axis should stand still; 0 if the test
   * last saw a change of the measured force */
  uint8_t moves;
  uint8_t rises; /* 1 if the first motion test increases the DAC code in this tick */
  /* 1 after an attempt was stopped while the amplifier was on, until the axis is at standstill */
  uint8_t coasts;
} first_motion_t;

/* Discards the result of the test after a write to a parameter on which the result depends. The
 * counted travel of attempts that were stopped is not discarded. */
void first_motion_forget(first_motion_t *first, drive_signals_t *signals);

/* Returns true if the result of the test depends on this object. The object is then
 * first_motion_test, or a parameter that determines the meaning of measured values. */
bool first_motion_depends_on(uint16_t object);

/* Returns true if this object is a bound or a criterion of the test. Then it cannot be written
 * while the test runs. */
bool first_motion_is_bounded_by(uint16_t object);

/* Starts the test when the state machine enables the axis, if the test is selected and the axis has
 * not passed the test yet. */
void first_motion_begin(first_motion_t *first, const drive_params_t *params,
                        drive_signals_t *signals);

/* Ends a running first motion test without a result, because the axis is disabled. */
void first_motion_cancel(first_motion_t *first, drive_signals_t *signals);

/* Ends a running first motion test, because the code for the board itself moves the axis. */
void first_motion_yield(first_motion_t *first, drive_signals_t *signals);

/* Returns true if the test moves the axis. No other function may move the axis at that time. */
static inline bool first_motion_is_running(const first_motion_t *first) {
  return first->phase >= FIRST_MOTION_STANDING && first->phase <= FIRST_MOTION_BACK;
}

/* Sets the mode and the DAC code of the axis before a tick of a running test. The caller must
 * restore the parameters open_loop_code and bump_decay_shift after the tick. If `halted` is true,
 * the axis is switched off and the test restarts. */
void first_motion_command(first_motion_t *first, axis_t *axis, bool halted);

/* Raises the fault position_gain_zero: the requested mode moves the axis by the position law, but
 * position_gain is 0, so the mode is refused. */
void first_motion_refuse(first_motion_t *first, drive_signals_t *signals, axis_t *axis);

/* Checks a tick of a running test. Call this function after axis_tick() and before the outputs are
 * written, because a failed test sets the outputs to the safe state. */
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
