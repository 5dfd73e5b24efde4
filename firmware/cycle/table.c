#include "firmware/cycle/table.h"

#include "firmware/fx/fx.h"

bool cycle_points_are_valid(const cycle_point_t *points, uint8_t count, int32_t step,
                            int32_t x_most, int32_t y_most) {
  for (uint8_t i = 0; i < count; i++) {
    if (!fx_within(points[i].x, x_most) || !fx_within(points[i].y, y_most) ||
        (i > 0 && (points[i].x <= points[i - 1].x || points[i].x - points[i - 1].x > step))) {
      return false;
    }
  }
  return true;
}

bool cycle_table_is_valid(const cycle_point_t *points, uint8_t count) {
  return count >= 2 && cycle_points_are_valid(points, count, CYCLE_TABLE_STEP_MAX,
                                              CYCLE_TABLE_X_MAX, CYCLE_TABLE_Y_MAX);
}

uint32_t cycle_line_at(const cycle_point_t *points, uint32_t count, int32_t x) {
  fx_assert(count >= 2 && points[0].x <= x && x <= points[count - 1].x);
  uint32_t line = 0;
  for (uint32_t lines = count - 1; lines > 1;) {
    const uint32_t half = fx_half(lines);
    lines -= half;
    if (points[line + half].x <= x) {
      line += half;
    }
  }
  return line;
}

int32_t cycle_table_at(const cycle_point_t *points, uint8_t count, int32_t x) {
  fx_assert(cycle_table_is_valid(points, count));
  if (x <= points[0].x) {
    return points[0].y;
  }
  if (x >= points[count - 1].x) {
    return points[count - 1].y;
  }
  const cycle_point_t *line = &points[cycle_line_at(points, count, x)];
  return fx_interpolate_short(line[0].x, line[0].y, line[1].x, line[1].y, x);
}
