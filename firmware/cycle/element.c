#include "firmware/cycle/element.h"

#include "firmware/cycle/window.h"
#include "firmware/fx/fx.h"

enum { FOUND = 1, FOUND_2 = 2, UNDER = 1, OVER = 2 };
/* Twice the largest sum that the evaluation element WORK can have. The unit is 1/256 count of force
 * times one encoder count. */
#define SUM_MAX ((int64_t)INT32_MAX * 512)

static bool is_ordered(int32_t least, int32_t most, int32_t bound) {
  return least <= most && fx_within(least, bound) && fx_within(most, bound);
}

/* Returns true if x rises from each point of an envelope's curve to the next, and the curve covers
 * the x range of the element. */
static bool is_curve(const cycle_element_t *element, const cycle_point_t *points, uint8_t count) {
  return count >= 2 && points[0].x <= element->x_least && points[count - 1].x >= element->x_most &&
         cycle_points_are_valid(points, count, INT32_MAX, CYCLE_TRAVEL_MAX, CYCLE_FORCE_MAX_Q8);
}

static bool has_envelope(const cycle_element_t *element, const cycle_point_t *points,
                         uint16_t count) {
  return (uint32_t)element->first + element->lower + element->upper <= count &&
         is_curve(element, &points[element->first], element->lower) &&
         is_curve(element, &points[element->first + element->lower], element->upper);
}

static bool has_crossing(const cycle_element_t *element) {
  const int32_t bound = (element->of_force != 0) ? CYCLE_FORCE_MAX_Q8 : CYCLE_TRAVEL_MAX;
  return element->direction >= CYCLE_RISING && element->direction <= CYCLE_EITHER &&
         element->ordinal > 0 && fx_within(element->level, bound) &&
         (element->kind != CYCLE_DIFFERENCE || fx_within(element->level_2, bound));
}

static bool has_window(const cycle_element_t *element) {
  const uint8_t sides = CYCLE_LEFT | CYCLE_RIGHT | CYCLE_BOTTOM | CYCLE_TOP;
  return is_ordered(element->y_least, element->y_most, CYCLE_FORCE_MAX_Q8) &&
         element->enters != 0 && element->enters <= sides && element->leaves <= sides;
}

/* Returns true if an element meets the conditions that hold for every kind of evaluation element:
 * it evaluates at least one phase, its flags are 0 or 1, and its x range is in order. */
static bool has_curve(const cycle_element_t *element) {
  return element->phases != 0 && element->over_time <= 1 && element->of_force <= 1 &&
         element->reserved == 0 && element->reserved_2 == 0 &&
         is_ordered(element->x_least, element->x_most, CYCLE_TRAVEL_MAX);
}

bool cycle_element_is_valid(const cycle_element_t *element, const cycle_point_t *points,
                            uint16_t count) {
  if (!has_curve(element) || element->kind >= CYCLE_KINDS) {
    return false;
  }
  switch (element->kind) {
    case CYCLE_AT:
    case CYCLE_DIFFERENCE:
      return element->y_least <= element->y_most && has_crossing(element);
    case CYCLE_WINDOW:
      return has_window(element);
    case CYCLE_ENVELOPE:
      return has_envelope(element, points, count);
    default:
      return element->y_least <= element->y_most;
  }
}

void cycle_element_begin(cycle_element_state_t *state) {
  /* Each field is set separately, because the compiler would call memset for the complete
   * structure. */
  state->sum = 0;
  state->begin_tick = 0;
  state->last_tick = 0;
  state->found_tick = 0;
  state->x = 0;
  state->y = 0;
  state->x_seen_least = 0;
  state->x_seen_most = 0;
  state->value = 0;
  state->value_2 = 0;
  state->has_sample = 0;
  state->found = 0;
  state->crossings = 0;
  state->crossings_2 = 0;
  state->entries = 0;
  state->exits = 0;
  state->wrong_side = 0;
  state->inside = 0;
  state->zeroed = 0;
}

static bool is_in_range(const cycle_element_t *element, int32_t x) {
  return x >= element->x_least && x <= element->x_most;
}

static void find(cycle_element_state_t *state, int32_t value, uint32_t tick) {
  state->value = value;
  state->found = (uint8_t)(state->found | FOUND);
  state->found_tick = tick;
}

static void count_up(uint8_t *number) { *number = (uint8_t)(*number + (*number < UINT8_MAX)); }

/* The straight line of the curve from the previous sample to the present sample. */
typedef struct {
  int32_t x0, y0, x1, y1;
} line_t;

/* Counts a crossing if this line crosses the level. If it is the crossing with the number
 * `ordinal`, which the element evaluates, stores the value at this crossing in *value and returns
 * true. */
static bool crosses(const cycle_element_t *element, const line_t *line, int32_t level,
                    uint8_t *number, int32_t *value) {
  const bool of_force = element->of_force != 0;
  const int32_t from = of_force ? line->y0 : line->x0;
  const int32_t to = of_force ? line->y1 : line->x1;
  const bool rises = from < level && to >= level;
  const bool falls = from >= level && to < level;
  if (!(rises && (element->direction & CYCLE_RISING) != 0) &&
      !(falls && (element->direction & CYCLE_FALLING) != 0)) {
    return false;
  }
  count_up(number);
  if (*number != element->ordinal) {
    return false;
  }
  *value = of_force ? fx_interpolate(from, line->x0, to, line->x1, level, FX_ROUND_HALF_UP)
                    : fx_interpolate(from, line->y0, to, line->y1, level, FX_ROUND_HALF_UP);
  return true;
}

static void take_crossings(const cycle_element_t *element, cycle_element_state_t *state,
                           const line_t *line, uint32_t tick) {
  int32_t value;
  if (crosses(element, line, element->level, &state->crossings, &value)) {
    find(state, value, tick);
  }
  if (element->kind == CYCLE_DIFFERENCE &&
      crosses(element, line, element->level_2, &state->crossings_2, &value)) {
    state->value_2 = value;
    state->found = (uint8_t)(state->found | FOUND_2);
    state->found_tick = tick;
  }
}

static void take_work(const cycle_element_t *element, cycle_element_state_t *state,
                      const line_t *line, uint32_t tick) {
  if (!is_in_range(element, line->x0) || !is_in_range(element, line->x1)) {
    return;
  }
  const int64_t sum = state->sum + ((int64_t)line->x1 - line->x0) * (line->y0 + line->y1);
  state->sum = (sum > SUM_MAX) ? SUM_MAX : ((sum < -SUM_MAX) ? -SUM_MAX : sum);
  find(state, (int32_t)fx_floor_shift_wide(state->sum + 256, 9), tick);
}

static window_t window_of(const cycle_element_t *element) {
  return (window_t){element->x_least, element->x_most, element->y_least, element->y_most};
}

static void take_window_line(const cycle_element_t *element, cycle_element_state_t *state,
                             const line_t *line, uint32_t tick) {
  const window_t window = window_of(element);
  const window_point_t from = {line->x0, line->y0};
  const window_point_t to = {line->x1, line->y1};
  const window_passage_t passage = window_pass(&window, &from, &to);
  if (passage.enters != 0) {
    count_up(&state->entries);
    state->wrong_side |= (uint8_t)((passage.enters & element->enters) == 0);
    state->found_tick = tick;
  }
  if (passage.leaves != 0) {
    count_up(&state->exits);
    state->wrong_side |= (uint8_t)((passage.leaves & element->leaves) == 0);
  }
}

/* Evaluates the line that ends at the present sample, for the kinds of elements that evaluate
 * lines. */
static void take_line(const cycle_element_t *element, cycle_element_state_t *state,
                      const line_t *line, uint32_t tick) {
  switch (element->kind) {
    case CYCLE_AT:
    case CYCLE_DIFFERENCE:
      take_crossings(element, state, line, tick);
      break;
    case CYCLE_WORK:
      take_work(element, state, line, tick);
      break;
    case CYCLE_WINDOW:
      take_window_line(element, state, line, tick);
      break;
    default:
      break;
  }
}

/* Returns the force of an envelope's curve at x. `rounding` makes the permitted range of forces
 * smaller, never larger. */
static int32_t force_at(const cycle_point_t *points, uint8_t count, int32_t x, uint8_t rounding) {
  const cycle_point_t *line = &points[cycle_line_at(points, count, x)];
  return fx_interpolate(line[0].x, line[0].y, line[1].x, line[1].y, x, rounding);
}

static void take_envelope(const cycle_element_t *element, const cycle_point_t *points,
                          cycle_element_state_t *state, int32_t x, int32_t y, uint32_t tick) {
  const bool begins = state->has_sample == 0;
  state->x_seen_least = (begins || x < state->x_seen_least) ? x : state->x_seen_least;
  state->x_seen_most = (begins || x > state->x_seen_most) ? x : state->x_seen_most;
  if (!is_in_range(element, x)) {
    return;
  }
  const cycle_point_t *lower = &points[element->first];
  const int32_t over = y - force_at(lower, element->lower, x, FX_ROUND_UP);
  const int32_t under = force_at(lower + element->lower, element->upper, x, FX_ROUND_DOWN) - y;
  const int32_t distance = (over < under) ? over : under;
  if ((state->found & FOUND) == 0 || distance < state->value) {
    find(state, distance, tick);
    state->wrong_side = (distance >= 0) ? 0 : ((over < under) ? UNDER : OVER);
  }
}

/* Keeps the largest force (PEAK) or the smallest force (VALLEY) so far. If two forces are equal,
 * the first one stays. */
static void take_extreme(const cycle_element_t *element, cycle_element_state_t *state,
                         const cycle_sample_t *sample, int32_t x) {
  const int32_t y = sample->force_q8;
  const bool is_further = (element->kind == CYCLE_PEAK) ? y > state->value : y < state->value;
  if (is_in_range(element, x) && (is_further || (state->found & FOUND) == 0)) {
    find(state, y, sample->tick);
  }
}

/* Evaluates the present sample, for the kinds of elements that evaluate single samples. */
static void take_sample(const cycle_element_t *element, const cycle_point_t *points,
                        cycle_element_state_t *state, const cycle_sample_t *sample, int32_t x) {
  switch (element->kind) {
    case CYCLE_PEAK:
    case CYCLE_VALLEY:
      take_extreme(element, state, sample, x);
      break;
    case CYCLE_LAST:
      find(state, sample->force_q8, sample->tick);
      break;
    case CYCLE_ENVELOPE:
      take_envelope(element, points, state, x, sample->force_q8, sample->tick);
      break;
    case CYCLE_WINDOW: {
      const window_t window = window_of(element);
      const window_point_t point = {x, sample->force_q8};
      state->inside = window_contains(&window, &point) ? 1 : 0;
      break;
    }
    default:
      break;
  }
}

/* Begins a piece of the curve. A piece that begins inside the window counts as an entry through a
 * side that is not permitted. */
static void begin_piece(const cycle_element_t *element, cycle_element_state_t *state,
                        const cycle_sample_t *sample) {
  if (element->kind == CYCLE_WINDOW && state->inside != 0) {
    count_up(&state->entries);
    state->wrong_side = 1;
    state->found_tick = sample->tick;
  }
}

/* Returns the x value of a sample: its travel, or the time since the evaluation element began. */
static int32_t x_of(const cycle_element_t *element, const cycle_element_state_t *state,
                    const cycle_sample_t *sample) {
  if (element->over_time == 0) {
    return sample->travel;
  }
  return fx_clamp(fx_s32_from_u32(sample->tick - state->begin_tick), 0, CYCLE_TRAVEL_MAX);
}

/* Returns true if a line leads from the previous sample to this sample, so that no new piece of the
 * curve begins. */
static bool continues(const cycle_element_t *element, const cycle_element_state_t *state,
                      const cycle_sample_t *sample) {
  return state->has_sample != 0 && sample->tick - state->last_tick == 1 &&
         (element->over_time != 0 || sample->zeroed == state->zeroed);
}

void cycle_element_take(const cycle_element_t *element, const cycle_point_t *points,
                        cycle_element_state_t *state, const cycle_sample_t *sample) {
  if ((element->phases & (uint16_t)fx_scale(1, sample->phase)) == 0) {
    return;
  }
  if (state->has_sample == 0) {
    state->begin_tick = sample->tick;
  }
  const int32_t x = x_of(element, state, sample);
  const bool goes_on = continues(element, state, sample);
  if (goes_on) {
    const line_t line = {state->x, state->y, x, sample->force_q8};
    take_line(element, state, &line, sample->tick);
  }
  take_sample(element, points, state, sample, x);
  if (!goes_on) {
    begin_piece(element, state, sample);
  }
  state->x = x;
  state->y = sample->force_q8;
  state->last_tick = sample->tick;
  state->zeroed = sample->zeroed;
  state->has_sample = 1;
}

static uint8_t verdict_of(const cycle_element_t *element, int32_t value) {
  return (value < element->y_least) ? CYCLE_BELOW
                                    : ((value > element->y_most) ? CYCLE_ABOVE : CYCLE_GOOD);
}

static uint8_t verdict_of_window(const cycle_element_t *element,
                                 const cycle_element_state_t *state) {
  if (state->entries == 0) {
    return CYCLE_NOT_REACHED;
  }
  if (state->wrong_side != 0) {
    return CYCLE_WRONG_SIDE;
  }
  if (state->entries > 1 || state->exits > 1) {
    return CYCLE_AGAIN;
  }
  const bool ended = (element->leaves != 0) ? state->exits == 1 : state->inside != 0;
  return ended ? CYCLE_GOOD : CYCLE_NOT_REACHED;
}

static uint8_t verdict_of_envelope(const cycle_element_t *element,
                                   const cycle_element_state_t *state) {
  if (state->wrong_side != 0) {
    return (state->wrong_side == UNDER) ? CYCLE_BELOW : CYCLE_ABOVE;
  }
  const bool covered =
      state->x_seen_least <= element->x_least && state->x_seen_most >= element->x_most;
  return covered ? CYCLE_GOOD : CYCLE_NOT_REACHED;
}

cycle_element_result_t cycle_element_result(const cycle_element_t *element,
                                            const cycle_element_state_t *state) {
  cycle_element_result_t result = {.verdict = CYCLE_NOT_REACHED};
  if (element->kind == CYCLE_WINDOW) {
    result.value = state->entries;
    result.found_tick = state->found_tick;
    result.verdict = verdict_of_window(element, state);
    return result;
  }
  const uint8_t needed = (element->kind == CYCLE_DIFFERENCE) ? (FOUND | FOUND_2) : FOUND;
  if ((state->found & needed) != needed) {
    return result;
  }
  result.found_tick = state->found_tick;
  result.value = state->value;
  if (element->kind == CYCLE_DIFFERENCE) {
    const int64_t difference = (int64_t)state->value_2 - state->value;
    result.value = fx_saturate(difference, INT32_MIN, INT32_MAX);
  }
  if (element->kind == CYCLE_ENVELOPE) {
    result.verdict = verdict_of_envelope(element, state);
  } else {
    result.verdict = verdict_of(element, result.value);
  }
  if (element->kind == CYCLE_LAST && !is_in_range(element, state->x)) {
    result.verdict = CYCLE_WRONG_SIDE;
  }
  return result;
}
