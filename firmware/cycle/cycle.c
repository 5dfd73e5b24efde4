#include "firmware/cycle/cycle.h"

#include <stddef.h>

#include "firmware/fx/fx.h"

static int32_t force_of(const cycle_inputs_t *now) {
  return fx_clamp(now->force_q8, -CYCLE_FORCE_MAX_Q8, CYCLE_FORCE_MAX_Q8);
}

static int32_t travel_of(const cycle_inputs_t *now, int32_t from_cnt) {
  return fx_clamp(fx_diff_wrap(now->position, from_cnt), -CYCLE_TRAVEL_MAX, CYCLE_TRAVEL_MAX);
}

static void begin_phase(cycle_t *cycle, uint8_t phase, const cycle_inputs_t *now) {
  cycle->phase = phase;
  cycle->phase_ticks = 0;
  cycle->start_cnt = now->position;
  cycle->section_cnt = now->position;
  cycle->section_force_q8 = force_of(now);
  cycle->section_travel = 0;
}

void cycle_init(cycle_t *cycle) {
  cycle->program = NULL;
  cycle->zero_cnt = 0;
  cycle->begin_tick = 0;
  cycle->begin_cnt = 0;
  cycle->start_cnt = 0;
  cycle->section_cnt = 0;
  cycle->section_force_q8 = 0;
  cycle->section_change_q8 = 0;
  cycle->section_travel = 0;
  cycle->phase_ticks = 0;
  for (uint8_t i = 0; i < CYCLE_PHASES_MAX; i++) {
    for (uint8_t k = 0; k < CYCLE_CONDITIONS; k++) {
      cycle->taken[i][k] = 0;
    }
  }
  for (uint8_t i = 0; i < CYCLE_ELEMENTS_MAX; i++) {
    cycle_element_begin(&cycle->elements[i]);
  }
  cycle->written = 0;
  cycle->evaluated = 0;
  cycle->state = CYCLE_IDLE;
  cycle->phase = 0;
  cycle->outcome = CYCLE_BY_PROGRAM;
  cycle->failed_phase = 0;
  cycle->zeroed = 0;
  cycle->incomplete = 0;
  cycle->last_tick = 0;
  cycle->good = 0;
}

void cycle_start(cycle_t *cycle, const cycle_header_t *program, const cycle_inputs_t *now,
                 int32_t reference_cnt) {
  cycle_init(cycle);
  cycle->program = program;
  cycle->state = CYCLE_RUNNING;
  cycle->last_tick = now->tick;
  cycle->begin_tick = now->tick;
  cycle->begin_cnt = now->position;
  cycle->zeroed = (program->zero == CYCLE_ZERO_POSITION) ? 1 : 0;
  cycle->zero_cnt = (cycle->zeroed != 0) ? reference_cnt : now->position;
  begin_phase(cycle, 0, now);
}

static void sample(cycle_t *cycle, const cycle_inputs_t *now) {
  if ((uint8_t)(cycle->written - cycle->evaluated) == CYCLE_SAMPLES) {
    cycle->state = CYCLE_ENDED;
    cycle->outcome = CYCLE_SAMPLES_LOST;
    cycle->failed_phase = cycle->phase;
    return;
  }
  cycle->samples[cycle->written & (CYCLE_SAMPLES - 1)] =
      (cycle_sample_t){.tick = now->tick,
                       .travel = travel_of(now, cycle->zero_cnt),
                       .force_q8 = force_of(now),
                       .phase = cycle->phase,
                       .zeroed = cycle->zeroed};
  cycle->written = (uint8_t)(cycle->written + 1);
}

/* Conditions of the stiffness. With a section in the negative direction both changes have the other
 * sign. */
static bool has_stiffness(const cycle_t *cycle, const cycle_condition_t *condition) {
  const int32_t travel = cycle->section_travel;
  if (travel == 0) {
    return false;
  }
  const int32_t sign = (travel > 0) ? 1 : -1;
  const int64_t change = (int64_t)(sign * cycle->section_change_q8) * 65536;
  const int64_t bound = (int64_t)condition->level * (sign * travel);
  return (condition->when == CYCLE_STIFFNESS_ABOVE) ? change >= bound : change <= bound;
}

/* Conditions of a travel. */
static bool has_travelled(const cycle_t *cycle, const cycle_condition_t *condition,
                          const cycle_inputs_t *now) {
  const int32_t since_touch = travel_of(now, cycle->zero_cnt);
  switch (condition->when) {
    case CYCLE_TRAVEL_ABOVE:
      return fx_magnitude(travel_of(now, cycle->start_cnt)) >= (uint32_t)condition->level;
    case CYCLE_TOUCH_ABOVE:
      return cycle->zeroed != 0 && since_touch >= condition->level;
    default:
      return cycle->zeroed != 0 && since_touch <= condition->level;
  }
}

static bool is_met(const cycle_t *cycle, const cycle_condition_t *condition,
                   const cycle_inputs_t *now) {
  const int32_t level = condition->level;
  switch (condition->when) {
    case CYCLE_NEVER:
      return false;
    case CYCLE_REACHED:
      return now->reached != 0;
    case CYCLE_TIME:
      return cycle->phase_ticks >= (uint32_t)level;
    case CYCLE_FORCE_ABOVE:
      return now->force_q8 >= level;
    case CYCLE_FORCE_BELOW:
      return now->force_q8 <= level;
    case CYCLE_CONTACT:
      return now->contact != 0;
    case CYCLE_LOST:
      return now->contact == 0;
    case CYCLE_INPUT_ON:
      return (now->inputs & level) == level;
    case CYCLE_INPUT_OFF:
      return (now->inputs & level) == 0;
    case CYCLE_STIFFNESS_ABOVE:
    case CYCLE_STIFFNESS_BELOW:
      return has_stiffness(cycle, condition);
    default:
      return has_travelled(cycle, condition, now);
  }
}

static uint8_t limit_of(const cycle_t *cycle, const cycle_phase_t *phase,
                        const cycle_inputs_t *now) {
  if (fx_magnitude(now->force_q8) > phase->force_max_q8) {
    return CYCLE_OVER_FORCE;
  }
  if (fx_magnitude(fx_diff_wrap(now->position, cycle->start_cnt)) > phase->travel_max) {
    return CYCLE_OVER_TRAVEL;
  }
  return (cycle->phase_ticks > phase->time_max) ? CYCLE_OVER_TIME : CYCLE_BY_PROGRAM;
}

/* Continues with a phase, or ends the cycle. */
static void go_on(cycle_t *cycle, uint8_t next, const cycle_inputs_t *now) {
  if (next == CYCLE_END) {
    cycle->state = CYCLE_ENDED;
  } else {
    begin_phase(cycle, next, now);
  }
}

/* The first limit that is exceeded is the outcome, and its reaction follows. A second limit ends
 * the cycle. */
static void exceed(cycle_t *cycle, uint8_t limit, const cycle_inputs_t *now) {
  const bool is_first = cycle->outcome == CYCLE_BY_PROGRAM;
  if (is_first) {
    cycle->outcome = limit;
    cycle->failed_phase = cycle->phase;
  }
  go_on(cycle, is_first ? cycle_phase(cycle)->reaction : CYCLE_END, now);
}

/* Returns true if travel 0 is at the sample of this tick. */
static bool is_at_zero(const cycle_header_t *program, const cycle_inputs_t *now) {
  if (program->zero == CYCLE_ZERO_TOUCH) {
    return now->contact != 0;
  }
  return (program->zero_level > 0) ? now->force_q8 >= program->zero_level
                                   : now->force_q8 <= program->zero_level;
}

/* Ends the section of stiffness_travel if it is complete, and begins the next one. */
static void measure_stiffness(cycle_t *cycle, uint32_t section, const cycle_inputs_t *now) {
  const int32_t travel = travel_of(now, cycle->section_cnt);
  if (fx_magnitude(travel) >= section) {
    cycle->section_change_q8 = force_of(now) - cycle->section_force_q8;
    cycle->section_travel = travel;
    cycle->section_cnt = now->position;
    cycle->section_force_q8 = force_of(now);
  }
}

bool cycle_step(cycle_t *cycle, const cycle_inputs_t *now) {
  if (cycle->zeroed == 0 && is_at_zero(cycle->program, now)) {
    cycle->zeroed = 1;
    cycle->zero_cnt = now->position;
  }
  const uint32_t passed = now->tick - cycle->last_tick;
  cycle->last_tick = now->tick;
  cycle->phase_ticks += passed;
  if (passed != 1) {
    cycle->incomplete = 1;
  }
  sample(cycle, now);
  if (cycle->state != CYCLE_RUNNING) {
    return true;
  }
  const cycle_phase_t *phase = cycle_phase(cycle);
  if (phase->stiffness_travel != 0) {
    measure_stiffness(cycle, phase->stiffness_travel, now);
  }
  const uint8_t limit = limit_of(cycle, phase, now);
  if (limit != CYCLE_BY_PROGRAM) {
    exceed(cycle, limit, now);
    return true;
  }
  for (uint8_t i = 0; i < CYCLE_CONDITIONS; i++) {
    const cycle_condition_t *condition = &phase->conditions[i];
    uint16_t *taken = &cycle->taken[cycle->phase][i];
    if ((condition->count == 0 || *taken < condition->count) && is_met(cycle, condition, now)) {
      *taken = (uint16_t)(*taken + (condition->count != 0));
      go_on(cycle, condition->next, now);
      return true;
    }
  }
  return false;
}

void cycle_abort(cycle_t *cycle) {
  if (cycle->state == CYCLE_RUNNING) {
    cycle->state = CYCLE_ENDED;
    if (cycle->outcome == CYCLE_BY_PROGRAM) {
      cycle->failed_phase = cycle->phase;
    }
    cycle->outcome = CYCLE_STOPPED;
  }
}

static void finish(cycle_t *cycle) {
  if (cycle->outcome == CYCLE_BY_PROGRAM && cycle->incomplete != 0) {
    cycle->outcome = CYCLE_SAMPLES_LOST;
  }
  bool good = cycle->outcome == CYCLE_BY_PROGRAM;
  for (uint8_t i = 0; i < cycle->program->elements; i++) {
    good = good && cycle_result(cycle, i).verdict == CYCLE_GOOD;
  }
  cycle->good = good ? 1 : 0;
  cycle->state = CYCLE_DONE;
}

void cycle_evaluate(cycle_t *cycle) {
  if (cycle->state == CYCLE_IDLE || cycle->state == CYCLE_DONE) {
    return;
  }
  const bool has_ended = cycle->state == CYCLE_ENDED;
  const cycle_element_t *elements = cycle_elements(cycle->program);
  while (cycle->evaluated != cycle->written) {
    const cycle_sample_t *next = &cycle->samples[cycle->evaluated & (CYCLE_SAMPLES - 1)];
    for (uint8_t i = 0; i < cycle->program->elements; i++) {
      cycle_element_take(&elements[i], cycle_points(cycle->program), &cycle->elements[i], next);
    }
    cycle->evaluated = (uint8_t)(cycle->evaluated + 1);
  }
  if (has_ended) {
    finish(cycle);
  }
}

cycle_element_result_t cycle_result(const cycle_t *cycle, uint8_t element) {
  cycle_element_result_t result =
      cycle_element_result(&cycle_elements(cycle->program)[element], &cycle->elements[element]);
  if (result.verdict == CYCLE_NOT_REACHED && cycle->outcome == CYCLE_STOPPED) {
    result.verdict = CYCLE_ABORTED;
  }
  return result;
}
