#ifndef FIRMWARE_CYCLE_WINDOW_H_
#define FIRMWARE_CYCLE_WINDOW_H_

/* How a straight line passes a window. All comparisons are exact. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/cycle/element.h"

/* Sides through which a line from outside enters a window, or leaves it: one side, or 0. */
typedef struct {
  uint8_t enters;
  uint8_t leaves;
} window_passage_t;

/* Returns true if a point is in the window of an element or on its sides. */
static inline bool window_contains(const cycle_element_t *element, int32_t x, int32_t y) {
  return x >= element->x_least && x <= element->x_most && y >= element->y_least &&
         y <= element->y_most;
}

/* Returns the sides that the line from (x0, y0) to (x1, y1) crosses. A line that begins inside
 * enters no side, and a line that ends inside leaves none. */
window_passage_t window_pass(const cycle_element_t *element, int32_t x0, int32_t y0, int32_t x1,
                             int32_t y1);

#endif
