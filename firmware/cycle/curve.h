#ifndef FIRMWARE_CYCLE_CURVE_H_
#define FIRMWARE_CYCLE_CURVE_H_

/* The curve of a press cycle: points with force, travel and time, in memory of the caller.
 *
 *   cycle_curve_begin()   at the start of a cycle; the curve of the previous cycle is lost
 *   cycle_curve_take()    with each sample of the cycle, between ticks
 *   cycle_curve_end()     after the last sample of the cycle
 *
 * The first and the last sample of the cycle become points. Any other sample becomes a point if its
 * phase differs from the phase of the last point, or if its travel, force or time differs from the
 * last point by at least the step of this quantity. A step of 0 is not used.
 *
 * The curve always contains the whole cycle. If a point has no room in the memory, the curve is
 * thinned: of each two points the first point stays, and every step that is used is doubled. If
 * only the second of the two points begins a phase, the second point stays, so the begin of a phase
 * is not moved.
 *
 * The travel of a point is the travel of its sample. In a cycle this travel is the depth
 * (program.h), measured from travel 0 of the cycle program. The offset of the program is subtracted
 * from the force. When travel 0 is found, the same number of counts is subtracted from the travel
 * of all earlier points, so all points have the same zero.
 *
 * Cost on a Cortex-M4: at most 60 instructions for a sample. When travel 0 is found, 6 more
 * instructions for each point, once in a cycle. Each time the curve is thinned, 13 instructions for
 * each point: with 1,000 points 13,000 instructions, or some 0.1 ms. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/cycle/element.h"

/* One point of a curve. It has 12 bytes, and the lowest byte of each number is first. */
typedef struct {
  uint32_t time;  /* number of the tick since the start of the cycle; the first tick is 1 */
  int32_t travel; /* travel in encoder counts */
  /* upper 24 bits: measured force in 1/256 count; lower 8 bits: number of the phase */
  int32_t force_phase;
} cycle_curve_point_t;

/* Largest number of points of a recorded curve, on the host and on the STM32. */
enum { CYCLE_CURVE_POINTS = 1000 };

typedef struct {
  /* a sample becomes a point when its travel differs by this number of encoder counts from the last
   * point; 0: the travel is not compared */
  uint32_t travel;
  /* a sample becomes a point when its force differs by this value, in 1/256 count, from the last
   * point; 0: the force is not compared */
  uint32_t force;
  /* a sample becomes a point when this number of ticks has passed since the last point; 0: the
   * time is not compared */
  uint32_t time;
} cycle_curve_steps_t;

typedef struct {
  cycle_curve_point_t *points;
  uint32_t bytes;      /* size of the memory in bytes; 0: no curve is recorded */
  uint32_t count;      /* number of points of the curve */
  uint32_t begin_tick; /* tick at which the time of the curve is 0 */
  cycle_curve_steps_t steps;
  cycle_curve_point_t last; /* the last sample of the curve; valid only if the curve has a point */
  uint8_t thinned;          /* number of times that the curve was thinned, at most 255 */
  /* 1 after travel 0, the origin of the travel, was found in this cycle */
  uint8_t zeroed;
} cycle_curve_t;

/* Initialises an empty curve in `memory`, which begins at a multiple of 4. If the memory has no
 * room for two points, no curve is recorded. */
void cycle_curve_init(cycle_curve_t *curve, void *memory, uint32_t bytes);

/* Begins the curve of a cycle that starts in tick begin_tick. */
void cycle_curve_begin(cycle_curve_t *curve, const cycle_curve_steps_t *steps, uint32_t begin_tick);

/* Adds a sample to the curve. `zero_travel` is the travel from the start of the cycle to travel 0;
 * it is used only after travel 0 was found. */
void cycle_curve_take(cycle_curve_t *curve, const cycle_sample_t *sample, int32_t zero_travel);

/* Adds the last sample as a point of the curve, unless this sample already is a point. */
void cycle_curve_end(cycle_curve_t *curve);

/* Copies up to `count` bytes of the points of the curve, from the byte offset `offset` on. Returns
 * the number of copied bytes. */
uint32_t cycle_curve_bytes(const cycle_curve_t *curve, uint32_t offset, uint8_t *bytes,
                           uint32_t count);

#endif
