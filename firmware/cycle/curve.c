#include "firmware/cycle/curve.h"

#include <stddef.h>

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"

enum { POINT_BYTES = sizeof(cycle_curve_point_t), FORCE_BIT = 8, THINNED_MAX = 255 };

_Static_assert(POINT_BYTES == 12, "a point has no gaps");

void cycle_curve_init(cycle_curve_t *curve, void *memory, uint32_t bytes) {
  curve->points = (cycle_curve_point_t *)memory;
  curve->bytes = (memory != NULL && bytes >= 2 * POINT_BYTES) ? bytes : 0;
  cycle_curve_begin(curve, &(cycle_curve_steps_t){0, 0, 0}, 0);
}

void cycle_curve_begin(cycle_curve_t *curve, const cycle_curve_steps_t *steps,
                       uint32_t begin_tick) {
  curve->count = 0;
  curve->begin_tick = begin_tick;
  curve->steps = *steps;
  curve->last = (cycle_curve_point_t){0, 0, 0};
  curve->thinned = 0;
  curve->zeroed = 0;
}

static uint8_t phase_of(const cycle_curve_point_t *point) {
  return (uint8_t)fx_field((uint32_t)point->force_phase, 0, FORCE_BIT);
}

/* Returns twice the step of a recorded curve, limited to UINT32_MAX. */
static uint32_t doubled(uint32_t step) {
  const uint32_t twice = step + step;
  return (twice < step) ? UINT32_MAX : twice;
}

/* Thins a curve: keeps one point of each two consecutive points, and doubles the steps of the
 * curve. */
static void thin(cycle_curve_t *curve) {
  cycle_curve_point_t *points = curve->points;
  uint32_t kept = 0;
  /* phase number of the curve point before the two points that are compared */
  uint8_t phase = phase_of(points);
  for (uint32_t i = 0; i < curve->count; i += 2) {
    const uint32_t second = (i + 1 < curve->count) ? i + 1 : i;
    const uint8_t first_phase = phase_of(&points[i]);
    const uint8_t second_phase = phase_of(&points[second]);
    const bool takes_second = i > 0 && first_phase == phase && second_phase != first_phase;
    points[kept] = points[takes_second ? second : i];
    phase = second_phase;
    kept++;
  }
  curve->count = kept;
  curve->steps.travel = doubled(curve->steps.travel);
  curve->steps.force = doubled(curve->steps.force);
  curve->steps.time = doubled(curve->steps.time);
  if (curve->thinned < THINNED_MAX) {
    curve->thinned++;
  }
}

static void append(cycle_curve_t *curve, const cycle_curve_point_t *point) {
  if ((curve->count + 1) * POINT_BYTES > curve->bytes) {
    thin(curve);
  }
  curve->points[curve->count] = *point;
  curve->count++;
}

static bool is_step(uint32_t change, uint32_t step) { return step != 0 && change >= step; }

static uint32_t change_of(int32_t now, int32_t before) {
  return fx_magnitude(fx_diff_wrap(now, before));
}

/* Returns true if a sample must become a point of the curve: it differs from the last point by a
 * step of the curve, or it belongs to another phase. */
static bool is_due(const cycle_curve_t *curve, const cycle_curve_point_t *now) {
  const cycle_curve_point_t *last = &curve->points[curve->count - 1];
  const int32_t force = fx_floor_shift(now->force_phase, FORCE_BIT);
  return phase_of(now) != phase_of(last) ||
         is_step(change_of(now->travel, last->travel), curve->steps.travel) ||
         is_step(change_of(force, fx_floor_shift(last->force_phase, FORCE_BIT)),
                 curve->steps.force) ||
         is_step(now->time - last->time, curve->steps.time);
}

void cycle_curve_take(cycle_curve_t *curve, const cycle_sample_t *sample, int32_t zero_travel) {
  if (curve->bytes == 0) {
    return;
  }
  if (sample->zeroed != 0 && curve->zeroed == 0) {
    for (uint32_t i = 0; i < curve->count; i++) {
      curve->points[i].travel = fx_diff_wrap(curve->points[i].travel, zero_travel);
    }
    curve->zeroed = 1;
  }
  curve->last =
      (cycle_curve_point_t){.time = sample->tick - curve->begin_tick,
                            .travel = sample->travel,
                            .force_phase = fx_scale(sample->force_q8, FORCE_BIT) + sample->phase};
  if (curve->count == 0 || is_due(curve, &curve->last)) {
    append(curve, &curve->last);
  }
}

void cycle_curve_end(cycle_curve_t *curve) {
  if (curve->count != 0 && curve->points[curve->count - 1].time != curve->last.time) {
    append(curve, &curve->last);
  }
}

uint32_t cycle_curve_bytes(const cycle_curve_t *curve, uint32_t offset, uint8_t *bytes,
                           uint32_t count) {
  const uint32_t size = curve->count * POINT_BYTES;
  const uint32_t rest = (offset < size) ? size - offset : 0;
  const uint32_t given = (count < rest) ? count : rest;
  const void *points = curve->points;
  const uint8_t *from = (const uint8_t *)points;
  for (uint32_t i = 0; i < given; i++) {
    bytes[i] = from[offset + i];
  }
  return given;
}
