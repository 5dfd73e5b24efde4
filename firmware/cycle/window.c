#include "firmware/cycle/window.h"

#include "firmware/fx/fx.h"

/* A line from its begin (0) to its end (1) along one coordinate. It is within the two sides of this
 * coordinate from enter / length to leave / length. */
typedef struct {
  int64_t enter; /* <= 0: the begin is not before the first side */
  int64_t leave; /* < 0: the begin is behind the second side */
  uint32_t length;
  uint8_t first; /* side at which the line enters, and side at which it leaves */
  uint8_t second;
} stretch_t;

static stretch_t stretch_of(int32_t from, int32_t to, int32_t least, int32_t most, uint8_t low,
                            uint8_t high) {
  if (to >= from) {
    return (stretch_t){.enter = (int64_t)least - from,
                       .leave = (int64_t)most - from,
                       .length = fx_magnitude(fx_diff_wrap(to, from)),
                       .first = low,
                       .second = high};
  }
  return (stretch_t){.enter = (int64_t)from - most,
                     .leave = (int64_t)from - least,
                     .length = fx_magnitude(fx_diff_wrap(from, to)),
                     .first = high,
                     .second = low};
}

/* Returns true if a / p <= b / q for lengths p and q. A length of 0 means a coordinate that does
 * not change: a is then <= 0 (entered before the begin) or the line is outside, and b >= 0 (never
 * left). */
static bool is_not_later(int64_t a, uint32_t p, int64_t b, uint32_t q) {
  return a * (int64_t)q <= b * (int64_t)p;
}

/* Returns true if the line is within both sides of a coordinate at some place. */
static bool is_reached(const stretch_t *along) {
  return along->leave >= 0 && along->enter <= (int64_t)along->length;
}

window_passage_t window_pass(const cycle_element_t *element, int32_t x0, int32_t y0, int32_t x1,
                             int32_t y1) {
  const stretch_t x =
      stretch_of(x0, x1, element->x_least, element->x_most, CYCLE_LEFT, CYCLE_RIGHT);
  const stretch_t y =
      stretch_of(y0, y1, element->y_least, element->y_most, CYCLE_BOTTOM, CYCLE_TOP);
  window_passage_t passage = {0, 0};
  if (!is_reached(&x) || !is_reached(&y) ||
      (x.enter > 0 && !is_not_later(x.enter, x.length, y.leave, y.length)) ||
      (y.enter > 0 && !is_not_later(y.enter, y.length, x.leave, x.length))) {
    return passage;
  }
  if (x.enter > 0 || y.enter > 0) {
    const bool by_x =
        x.enter > 0 && (y.enter <= 0 || is_not_later(y.enter, y.length, x.enter, x.length));
    passage.enters = by_x ? x.first : y.first;
  }
  const bool ends_in_x = x.leave >= (int64_t)x.length;
  const bool ends_in_y = y.leave >= (int64_t)y.length;
  if (!ends_in_x || !ends_in_y) {
    const bool by_x =
        !ends_in_x && (ends_in_y || is_not_later(x.leave, x.length, y.leave, y.length));
    passage.leaves = by_x ? x.second : y.second;
  }
  return passage;
}
