#ifndef FIRMWARE_CYCLE_WINDOW_H_
#define FIRMWARE_CYCLE_WINDOW_H_

/* Computes how a straight line passes a window. All comparisons are exact. x is +-2^30, y is
 * +-2^17. */

#include <stdbool.h>
#include <stdint.h>

/* Sides of a window, as bits. */
enum { CYCLE_LEFT = 1, CYCLE_RIGHT = 2, CYCLE_BOTTOM = 4, CYCLE_TOP = 8 };

/* A window with its sides; x_least <= x_most, y_least <= y_most. */
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

/* Sides through which a line from outside enters a window, or leaves it: one side, or 0. */
typedef struct {
  uint8_t enters;
  uint8_t leaves;
} window_passage_t;

/* Returns true if a point is in the window or on its sides. */
static inline bool window_contains(const window_t *window, const window_point_t *point) {
  return point->x >= window->x_least && point->x <= window->x_most && point->y >= window->y_least &&
         point->y <= window->y_most;
}

/* Returns the sides that the line between two points crosses. A line that begins inside enters no
 * side, and a line that ends inside leaves none. A corner belongs to the left or right side. */
window_passage_t window_pass(const window_t *window, const window_point_t *from,
                             const window_point_t *to);

#endif
