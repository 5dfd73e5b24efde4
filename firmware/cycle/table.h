#ifndef FIRMWARE_CYCLE_TABLE_H_
#define FIRMWARE_CYCLE_TABLE_H_

/* Tables and curves. They consist of points with straight lines between them. */

#include <stdbool.h>
#include <stdint.h>

typedef struct {
  int32_t x; /* x of the point; x rises from one point of a curve to the next */
  int32_t y;
} cycle_point_t;

/* Bounds of a table: x is within +-2^30, y is within +-CYCLE_TABLE_Y_MAX, and x rises by at most
 * CYCLE_TABLE_STEP_MAX from one point to the next. */
#define CYCLE_TABLE_X_MAX INT32_C(1073741823)
#define CYCLE_TABLE_STEP_MAX INT32_C(524287)
#define CYCLE_TABLE_Y_MAX INT32_C(8388096)

/* Returns true if x rises by at most `step` from each of `count` points to the next, x is within
 * +-x_most, and y is within +-y_most. */
bool cycle_points_are_valid(const cycle_point_t *points, uint8_t count, int32_t step,
                            int32_t x_most, int32_t y_most);

/* Returns true if a curve has at least 2 points and is within the bounds of a table. */
bool cycle_table_is_valid(const cycle_point_t *points, uint8_t count);

/* Returns the index of the point at which the line segment that contains x begins. */
uint32_t cycle_line_at(const cycle_point_t *points, uint32_t count, int32_t x);

/* Returns y of a table at x, rounded half up. Before the first point the result is the first y, and
 * after the last point the last y. The function needs at most some 110 instructions on a
 * Cortex-M4. */
int32_t cycle_table_at(const cycle_point_t *points, uint8_t count, int32_t x);

#endif
