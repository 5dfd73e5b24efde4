#include "firmware/cycle/window.h"

#include "firmware/fx/fx.h"

/* The part of a line between two opposite sides of a window: left and right, or lower and upper. As
 * fractions of the length of the line, this part begins at enter / length and ends at leave /
 * length. */
typedef struct {
  /* distance from the begin of the straight line to the first of the two sides; 0 if the line
   * begins behind this side */
  uint32_t enter;
  /* distance from the begin of the straight line to the second of the two sides; `length` if the
   * line ends before this side */
  uint32_t leave;
  uint32_t length;
  /* first of the two opposite sides that the straight line reaches; `second`: the other side */
  uint8_t first;
  uint8_t second;
  /* true if at least one point of the straight line is between the two opposite sides */
  bool is_reached;
} stretch_t;

/* Two opposite sides of a window: left and right, or lower and upper. */
typedef struct {
  int32_t least;
  int32_t most;
  uint8_t low;
  uint8_t high;
} sides_t;

static stretch_t stretch_of(int32_t from, int32_t to, const sides_t *sides) {
  const bool rises = to >= from;
  const uint32_t length = fx_magnitude(fx_diff_wrap(to, from));
  const int32_t enter = rises ? fx_diff_wrap(sides->least, from) : fx_diff_wrap(from, sides->most);
  const int32_t leave = rises ? fx_diff_wrap(sides->most, from) : fx_diff_wrap(from, sides->least);
  stretch_t along = {.length = length,
                     .first = rises ? sides->low : sides->high,
                     .second = rises ? sides->high : sides->low};
  along.enter = (enter > 0) ? (uint32_t)enter : 0;
  along.is_reached = leave >= 0 && along.enter <= length;
  along.leave = (along.is_reached && (uint32_t)leave < length) ? (uint32_t)leave : length;
  return along;
}

/* Returns true if the fraction a / p is at most the fraction b / q. p and q are lengths, with a <=
 * p and b <= q. */
static bool is_not_later(uint32_t a, uint32_t p, uint32_t b, uint32_t q) {
  fx_assert(a <= p && b <= q);
  return (uint64_t)a * q <= (uint64_t)b * p;
}

/* Returns true if the line misses the window, because it passes the first side of `along` only
 * after it has passed the second of the two other sides. */
static bool is_late(const stretch_t *along, const stretch_t *other) {
  return along->enter > 0 &&
         !is_not_later(along->enter, along->length, other->leave, other->length);
}

static uint8_t side_of_entry(const stretch_t *x, const stretch_t *y) {
  if (x->enter == 0 && y->enter == 0) {
    return 0;
  }
  const bool by_x =
      x->enter > 0 && (y->enter == 0 || is_not_later(y->enter, y->length, x->enter, x->length));
  return by_x ? x->first : y->first;
}

static uint8_t side_of_exit(const stretch_t *x, const stretch_t *y) {
  const bool stays_in_x = x->leave == x->length;
  const bool stays_in_y = y->leave == y->length;
  if (stays_in_x && stays_in_y) {
    return 0;
  }
  const bool by_x =
      !stays_in_x && (stays_in_y || is_not_later(x->leave, x->length, y->leave, y->length));
  return by_x ? x->second : y->second;
}

window_passage_t window_pass(const window_t *window, const window_point_t *from,
                             const window_point_t *to) {
  const sides_t across = {window->x_least, window->x_most, CYCLE_LEFT, CYCLE_RIGHT};
  const sides_t along = {window->y_least, window->y_most, CYCLE_BOTTOM, CYCLE_TOP};
  const stretch_t x = stretch_of(from->x, to->x, &across);
  const stretch_t y = stretch_of(from->y, to->y, &along);
  if (!x.is_reached || !y.is_reached || is_late(&x, &y) || is_late(&y, &x)) {
    return (window_passage_t){0, 0};
  }
  return (window_passage_t){.enters = side_of_entry(&x, &y), .leaves = side_of_exit(&x, &y)};
}
