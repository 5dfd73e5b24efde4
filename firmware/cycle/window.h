#ifndef FIRMWARE_CYCLE_WINDOW_H_
#define FIRMWARE_CYCLE_WINDOW_H_

/* Computes through which sides a straight line enters and leaves a rectangular window. All
 * comparisons are exact. x is within +-2^30, and y is within +-2^17. */

#include <stdbool.h>
#include <stdint.h>

/* Sides of a window, as bits. */
enum { CYCLE_LEFT = 1, CYCLE_RIGHT = 2, CYCLE_BOTTOM = 4, CYCLE_TOP = 8 };

/* A rectangular window, including its sides. x_least <= x_most and y_least <= y_most. */
typedef struct {
  int32_t x_least;
  int32_t x_most;
  int32_t y_least;
  int32_t y_most;
} window_t;

typedef struct {
  int32_t x;
  int32_t y;
} window_point_t;

/* side through which a line enters the window; 0: no side. `leaves`: side through which the line
 * leaves the window; 0: no side */
typedef struct {
  uint8_t enters;
  uint8_t leaves;
} window_passage_t;

/* Returns true if a point of the curve is in the window or on the sides of the window. */
static inline bool window_contains(const window_t *window, const window_point_t *point) {
  return point->x >= window->x_least && point->x <= window->x_most && point->y >= window->y_least &&
         point->y <= window->y_most;
}

/* Returns the sides of a window that the line between two points crosses. A line that begins inside
 * the window enters through no side, and a line that ends inside leaves through no side. A corner
 * belongs to the left or right side. */
window_passage_t window_pass(const window_t *window, const window_point_t *from,
                             const window_point_t *to);

#endif
