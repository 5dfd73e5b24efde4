#ifndef FIRMWARE_CYCLE_TABLE_H_
#define FIRMWARE_CYCLE_TABLE_H_

/* Curves of points with straight lines between them. */

#include <stdbool.h>
#include <stdint.h>

typedef struct {
  int32_t x; /* x of the point, which rises from one point of a curve to the next */
  int32_t y;
} cycle_point_t;

/* Bounds of a table: x is +-2^30, consecutive points are at most CYCLE_TABLE_STEP_MAX apart, and y
 * is +-CYCLE_TABLE_Y_MAX. */
#define CYCLE_TABLE_X_MAX INT32_C(1073741823)
#define CYCLE_TABLE_STEP_MAX INT32_C(524287)
#define CYCLE_TABLE_Y_MAX INT32_C(8388096)

/* Returns true if x rises from each of `count` points to the next, by at most `step`, and x and y
 * are within +-x_most and +-y_most. */
bool cycle_points_are_valid(const cycle_point_t *points, uint8_t count, int32_t step,
                            int32_t x_most, int32_t y_most);

/* Returns true if a curve has at least 2 points and is within the bounds of a table. */
bool cycle_table_is_valid(const cycle_point_t *points, uint8_t count);

/* Returns the index of the point at which the line of the curve for x begins. */
uint32_t cycle_line_at(const cycle_point_t *points, uint32_t count, int32_t x);

/* Returns y of a table at x, rounded half up; before the first point the first y, after the last
 * point the last y. At most some 110 instructions on a Cortex-M4. */
int32_t cycle_table_at(const cycle_point_t *points, uint8_t count, int32_t x);

#endif
