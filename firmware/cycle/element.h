#ifndef FIRMWARE_CYCLE_ELEMENT_H_
#define FIRMWARE_CYCLE_ELEMENT_H_

/* Evaluation elements. Each element computes one value from the curve of a cycle, and compares this
 * value with its bounds. It takes one sample in each tick and needs no buffer.
 *
 * The curve is force over x, where x is the travel or the time since the element began. It consists
 * of straight lines between the samples of consecutive ticks, all in phases of the element. If the
 * phases of the element are left and entered again, a new piece of the curve begins, and no line
 * joins two pieces. A new piece also begins after a missing tick and after a sample that is not
 * valid. If x is the travel, travel 0 also begins a new piece. All comparisons are exact, and every
 * interpolated value is rounded once, half up.
 *
 *   cycle_element_begin(&state);
 *   in each tick of the cycle: cycle_element_take(element, points, &state, &sample);
 *   at the end of the cycle:   result = cycle_element_result(element, &state);
 *
 * Interpolation divides bit by bit, so cycle_element_take() belongs between two ticks. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/cycle/table.h"
#include "firmware/cycle/window.h"

/* Largest magnitudes of the values of a sample: force in 1/256 of an 8-bit count, and travel in
 * encoder counts. A cycle limits larger values to these magnitudes. */
#define CYCLE_FORCE_MAX_Q8 INT32_C(131071)
#define CYCLE_TRAVEL_MAX CYCLE_TABLE_X_MAX

typedef struct {
  uint32_t tick;    /* number of the tick of this sample; the number may wrap */
  int32_t travel;   /* depth (program.h) in encoder counts, +-CYCLE_TRAVEL_MAX */
  int32_t force_q8; /* measured force, +-CYCLE_FORCE_MAX_Q8 */
  uint8_t phase;    /* number of the phase, 0..15 */
  uint8_t zeroed;   /* 1 in the sample at which travel 0 was found, and in all later samples */
  uint8_t is_valid; /* 1: force and position are valid (sample.h); 0: all evaluation elements ignore
                     * the sample */
} cycle_sample_t;

/* The kinds of evaluation elements, each with the value that is compared with y_least and y_most.
 *   PEAK, VALLEY  largest force, and smallest force, of the samples with x in x_least..x_most
 *   AT            force at which x crosses `level`, or x at which the force crosses `level`
 *   DIFFERENCE    the value of AT at level_2 minus the value of AT at `level`
 *   WORK          sum of force times change of x, over the lines of the curve with both ends in
 *                 x_least..x_most. Its unit is one count of force times one count (or one tick) of
 *                 x; the sum is rounded half up
 *   LAST          force of the last sample, whose x must be in x_least..x_most
 *   WINDOW        number of entries of the curve into the window x_least..x_most, y_least..y_most.
 *                 The curve must enter the window once, through a side of `enters`, and leave it
 *                 once, through a side of `leaves`. If `leaves` is 0, the curve must not leave it.
 *                 The window contains its sides, and a corner belongs to the left or right side. A
 *                 curve that begins in the window has not entered through a side.
 *   ENVELOPE      smallest distance of the samples with x in x_least..x_most from the lower and the
 *                 upper curve of the envelope; negative if a sample is outside the envelope.
 *                 y_least and y_most are not used */
enum {
  CYCLE_PEAK = 0,
  CYCLE_VALLEY = 1,
  CYCLE_AT = 2,
  CYCLE_DIFFERENCE = 3,
  CYCLE_WORK = 4,
  CYCLE_LAST = 5,
  CYCLE_WINDOW = 6,
  CYCLE_ENVELOPE = 7,
  CYCLE_KINDS = 8
};

/* Directions of a crossing. A crossing is rising if the line begins below the level and ends at or
 * above the level. It is falling if the line begins at or above the level and ends below the
 * level. */
enum { CYCLE_RISING = 1, CYCLE_FALLING = 2, CYCLE_EITHER = 3 };

typedef struct {
  uint8_t kind;
  uint8_t over_time; /* 1: x is the time in ticks since the element began; 0: x is the travel */
  uint16_t phases;   /* set, as bits, of the phases whose samples the element evaluates */
  /* kinds AT and DIFFERENCE. 1: the element evaluates crossings of a force level; 0: crossings
   * of a level of x */
  uint8_t of_force;
  /* kinds AT and DIFFERENCE: direction of the crossings that the element counts */
  uint8_t direction;
  /* kinds AT and DIFFERENCE: number of the crossing that the element evaluates; 1 is the first
   * crossing */
  uint8_t ordinal;
  uint8_t enters; /* kind WINDOW: sides through which the curve may enter the window */
  /* kind WINDOW: sides through which the curve may leave the window; 0: the curve must end in
   * the window */
  uint8_t leaves;
  /* kind ENVELOPE: number of points of the lower curve of the envelope, at least 2 */
  uint8_t lower;
  /* kind ENVELOPE: number of points of the upper curve of the envelope; these points follow the
   * points of the lower curve */
  uint8_t upper;
  uint8_t reserved; /* 0 */
  /* kind ENVELOPE: index of the first point of the envelope among the points of the program */
  uint16_t first;
  uint16_t reserved_2; /* 0 */
  int32_t x_least;
  int32_t x_most;
  int32_t y_least;
  int32_t y_most;
  int32_t level;
  int32_t level_2;
} cycle_element_t;

/* Verdicts on an evaluation element. ABORTED: the cycle was stopped before the element had a
 * value. */
enum {
  CYCLE_GOOD = 0,
  /* verdict: the value of the element is below y_least, or the curve is below the envelope */
  CYCLE_BELOW = 1,
  /* verdict: the value of the element is above y_most, or the curve is above the envelope */
  CYCLE_ABOVE = 2,
  /* verdict: the curve crossed a side of the window that is not permitted (kind WINDOW), or x is
   * outside of its bounds (kind LAST) */
  CYCLE_WRONG_SIDE = 3,
  CYCLE_AGAIN = 4, /* verdict: the curve entered or left the window more than once (kind WINDOW) */
  /* verdict: the element has no value, because there was no sample or no crossing, or the curve
   * ended too early */
  CYCLE_NOT_REACHED = 5,
  CYCLE_ABORTED = 6,
  CYCLE_VERDICTS = 7
};

typedef struct {
  /* kind WORK: twice the integral of the force over x, in 1/256 count of force times one count or
   * one tick of x */
  int64_t sum;
  uint32_t begin_tick; /* tick of the first sample that the evaluation element has evaluated */
  uint32_t last_tick;
  uint32_t found_tick; /* tick of the sample that gave the value */
  int32_t x;           /* x value of the last sample */
  int32_t y;
  int32_t x_seen_least; /* kind ENVELOPE: smallest and largest x of all evaluated samples */
  int32_t x_seen_most;
  int32_t value;
  int32_t value_2;     /* kind DIFFERENCE: value at the crossing of level_2 */
  uint8_t has_sample;  /* 1 after the first sample that the evaluation element has evaluated */
  uint8_t found;       /* bit 0 is 1 if `value` was found, and bit 1 is 1 if value_2 was found */
  uint8_t crossings;   /* number of times that the curve has crossed `level` so far, at most 255 */
  uint8_t crossings_2; /* number of times that the curve has crossed level_2 so far, at most 255 */
  /* kind WINDOW: number of times that the curve entered the window, at most 255; `exits`: number of
   * times that it left the window */
  uint8_t entries;
  uint8_t exits;
  /* kind WINDOW: 1 if the curve crossed a side that is not permitted. Kind ENVELOPE: 1 if the curve
   * was below the envelope, 2 if it was above */
  uint8_t wrong_side;
  uint8_t inside; /* kind WINDOW: 1 if the last sample is in the window */
  /* value of the field `zeroed` of the last sample, which is 1 after travel 0 was found */
  uint8_t zeroed;
} cycle_element_state_t;

typedef struct {
  /* value of the evaluation element, which is compared with y_least and y_most; 0 if none */
  int32_t value;
  /* tick of the sample that gave the value; for a line, tick of the sample at its end */
  uint32_t found_tick;
  uint8_t verdict;
} cycle_element_result_t;

/* Returns true if an element with `count` points can be evaluated. Its kind, direction, ordinal and
 * sides must be permitted values. Its bounds must be in order and within the largest magnitudes. In
 * its curves x must rise from point to point and cover x_least..x_most. */
bool cycle_element_is_valid(const cycle_element_t *element, const cycle_point_t *points,
                            uint16_t count);

/* Sets the state of an evaluation element at the start of a cycle. */
void cycle_element_begin(cycle_element_state_t *state);

/* Evaluates the sample of a tick. Samples are ignored if their phase is not in the set `phases` of
 * the element. */
void cycle_element_take(const cycle_element_t *element, const cycle_point_t *points,
                        cycle_element_state_t *state, const cycle_sample_t *sample);

/* Returns the result that the evaluation element would have if the cycle ended now. */
cycle_element_result_t cycle_element_result(const cycle_element_t *element,
                                            const cycle_element_state_t *state);

#endif
