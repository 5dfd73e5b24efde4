#include "firmware/cycle/cycle.h"

#include <stddef.h>

#include "firmware/fx/fx.h"

static int32_t within_force(int32_t force_q8) {
  return fx_clamp(force_q8, -CYCLE_FORCE_MAX_Q8, CYCLE_FORCE_MAX_Q8);
}

/* Subtracts the offset of the cycle program from the measured force. Stores the result, limited to
 * the range of a sample. */
static void take_force(cycle_t *cycle, const cycle_inputs_t *now) {
  cycle->force_q8 = within_force(fx_diff_wrap(now->force_q8, cycle->offset_q8));
}

static int32_t within_travel(int32_t travel) {
  return fx_clamp(travel, -CYCLE_TRAVEL_MAX, CYCLE_TRAVEL_MAX);
}

static int32_t travel_of(const cycle_inputs_t *now, int32_t from_cnt) {
  return within_travel(fx_diff_wrap(now->position, from_cnt));
}

/* Sets the force target of a phase with the action FOLLOW for the next tick. */
static void follow(cycle_t *cycle, const cycle_phase_t *phase, const cycle_inputs_t *now) {
  const cycle_point_t *table = &cycle_points(cycle->program)[phase->first];
  const uint32_t time =
      (cycle->phase_ticks < CYCLE_TRAVEL_MAX) ? cycle->phase_ticks : CYCLE_TRAVEL_MAX;
  const int32_t x = (phase->over_travel != 0) ? travel_of(now, cycle->start_cnt) : (int32_t)time;
  cycle->demand_q8 = cycle_table_at(table, phase->points, x);
  cycle->target = (x >= table[phase->points - 1].x) ? CYCLE_TARGET_BY_DRIVE : CYCLE_TARGET_OPEN;
}

static void begin_tare(cycle_t *cycle, const cycle_inputs_t *now) {
  cycle->tare_cnt = now->position;
  cycle->tare_sum = 0;
  cycle->tare_ticks = 0;
}

/* Begins a phase of a cycle with the action FOLLOW, TARE or OUTPUT. */
static void begin_action(cycle_t *cycle, const cycle_phase_t *phase, const cycle_inputs_t *now) {
  if (phase->action == CYCLE_FOLLOW) {
    const cycle_point_t *last = &cycle_points(cycle->program)[phase->first + phase->points - 1];
    cycle->demand_q8 = cycle->first_q8[cycle->phase];
    cycle->target = (last->x <= 0) ? CYCLE_TARGET_BY_DRIVE : CYCLE_TARGET_OPEN;
  } else {
    cycle->target = (phase->action == CYCLE_OUTPUT) ? CYCLE_TARGET_MET : CYCLE_TARGET_OPEN;
    begin_tare(cycle, now);
  }
}

static void begin_phase(cycle_t *cycle, uint8_t number, const cycle_inputs_t *now) {
  cycle->phase = number;
  cycle->phase_ticks = 0;
  cycle->start_cnt = now->position;
  cycle->section_cnt = now->position;
  cycle->section_force_q8 = cycle->force_q8;
  cycle->section_travel = 0;
  const cycle_phase_t *phase = cycle_phase(cycle);
  cycle->outputs = (uint8_t)((cycle->outputs | phase->outputs_on) & (uint8_t)~phase->outputs_off);
  cycle->demand_q8 = phase->force * INT32_C(256);
  cycle->target = CYCLE_TARGET_BY_DRIVE;
  if (phase->action >= CYCLE_FOLLOW) {
    begin_action(cycle, phase, now);
  }
}

/* Ends the cycle and sets the digital outputs to their safe state. */
static void end(cycle_t *cycle) {
  cycle->state = CYCLE_ENDED;
  cycle->outputs &= cycle->program->outputs_keep;
}

void cycle_end(cycle_t *cycle, uint8_t outcome) {
  if (cycle->outcome == CYCLE_BY_PROGRAM) {
    cycle->outcome = outcome;
    cycle->failed_phase = cycle->phase;
  }
  cycle->ended_by = 0;
  end(cycle);
}

/* Returns the deflection of the press at the force `force_q8`. The offset must already be
 * subtracted from this force. */
static int32_t deflection_at(const cycle_header_t *program, int32_t force_q8) {
  return (program->compliance == 0)
             ? 0
             : cycle_table_at(cycle_points(program), program->compliance, force_q8);
}

/* Returns the depth that belongs to a travel and a force. The magnitude of the depth is at most
 * CYCLE_TRAVEL_MAX + CYCLE_TABLE_Y_MAX. */
static int32_t depth_of(const cycle_header_t *program, int32_t travel, int32_t force_q8) {
  return travel - deflection_at(program, force_q8);
}

/* Sets travel 0, the origin of the travel, so that the depth at this sample is 0. From then on the
 * travel of the cycle is measured from travel 0. */
static void set_zero(cycle_t *cycle, const cycle_inputs_t *now) {
  cycle->zero_cnt = fx_diff_wrap(now->position, deflection_at(cycle->program, cycle->force_q8));
  cycle->depth = 0;
  cycle->has_depth = 1;
}

void cycle_init(cycle_t *cycle) {
  cycle->program = NULL;
  cycle->zero_cnt = 0;
  cycle->begin_tick = 0;
  cycle->invalid_ticks = 0;
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
  cycle->force_q8 = 0;
  cycle->depth = 0;
  cycle->demand_q8 = 0;
  cycle->offset_q8 = 0;
  cycle->tare_least = 0;
  cycle->tare_most = 0;
  cycle->tare_cnt = 0;
  cycle->tare_sum = 0;
  cycle->tare_ticks = 0;
  cycle->ended_by = 0;
  cycle->has_depth = 0;
  cycle->target = CYCLE_TARGET_OPEN;
  cycle->tared = 0;
  cycle->outputs = 0;
  cycle->outputs_before = 0;
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

void cycle_select(cycle_t *cycle, const cycle_header_t *program) {
  cycle_init(cycle);
  cycle->judged = (program == NULL) ? 0 : cycle_program_judged(program);
  cycle->reach = (program == NULL) ? (cycle_reach_t){0, 0, 0} : cycle_program_reach(program);
  for (uint8_t i = 0; program != NULL && i < program->phases; i++) {
    const cycle_phase_t *phase = &cycle_phases(program)[i];
    cycle->first_q8[i] =
        (phase->action == CYCLE_FOLLOW)
            ? cycle_table_at(&cycle_points(program)[phase->first], phase->points, 0)
            : 0;
  }
}

void cycle_start(cycle_t *cycle, const cycle_header_t *program, const cycle_inputs_t *now,
                 int32_t reference_cnt) {
  const uint8_t kept = cycle->outputs & program->outputs_keep;
  cycle_init(cycle);
  cycle->program = program;
  cycle->state = CYCLE_RUNNING;
  cycle->outputs = kept;
  cycle->outputs_before = kept;
  cycle->last_tick = now->tick;
  cycle->begin_tick = now->tick;
  cycle->zeroed = (program->zero == CYCLE_ZERO_POSITION) ? 1 : 0;
  cycle->zero_cnt = reference_cnt;
  take_force(cycle, now);
  if (cycle->zeroed == 0) {
    set_zero(cycle, now);
  }
  cycle->begin_cnt = cycle->zero_cnt;
  begin_phase(cycle, 0, now);
}

static void sample(cycle_t *cycle, const cycle_inputs_t *now) {
  if ((uint8_t)(cycle->written - cycle->evaluated) == CYCLE_SAMPLES) {
    cycle->outcome = CYCLE_BY_PROGRAM;
    cycle_end(cycle, CYCLE_SAMPLES_LOST);
    return;
  }
  cycle->samples[cycle->written & (CYCLE_SAMPLES - 1)] =
      (cycle_sample_t){.tick = now->tick,
                       .travel = fx_diff_wrap(now->position, cycle->zero_cnt),
                       .force_q8 = cycle->force_q8,
                       .phase = cycle->phase,
                       .zeroed = cycle->zeroed,
                       .is_valid = (uint8_t)(now->defects == CYCLE_SAMPLE_VALID)};
  cycle->written = (uint8_t)(cycle->written + 1);
}

/* Returns true if a condition on the stiffness is met. */
static bool has_stiffness(const cycle_t *cycle, const cycle_condition_t *condition) {
  if (cycle->section_travel == 0) {
    return false;
  }
  const int64_t change = (int64_t)cycle->section_change_q8 * 65536;
  const int64_t bound = (int64_t)condition->level * cycle->section_travel;
  return (condition->when == CYCLE_STIFFNESS_ABOVE) ? change >= bound : change <= bound;
}

/* Returns the depth of the press in this tick. It is computed only once in a tick, and only if a
 * condition needs it. */
static int32_t depth_now(cycle_t *cycle, const cycle_inputs_t *now) {
  if (cycle->has_depth == 0) {
    cycle->has_depth = 1;
    cycle->depth = depth_of(cycle->program, travel_of(now, cycle->zero_cnt), cycle->force_q8);
  }
  return cycle->depth;
}

/* Returns true if a condition on the depth is met. */
static bool is_deep(cycle_t *cycle, const cycle_condition_t *condition, const cycle_inputs_t *now) {
  if (cycle->zeroed == 0) {
    return false;
  }
  const int32_t depth = depth_now(cycle, now);
  return (condition->when == CYCLE_DEPTH_ABOVE) ? depth >= condition->level
                                                : depth <= condition->level;
}

/* Returns true if a condition of the kind `when` can be met in this tick. This is so if the sample
 * is valid, or if a condition of this kind needs no sample. */
static bool has_sample(const cycle_t *cycle, uint8_t when, const cycle_inputs_t *now) {
  return now->defects == CYCLE_SAMPLE_VALID || when == CYCLE_TIME || when == CYCLE_INPUT_ON ||
         when == CYCLE_INPUT_OFF || (when == CYCLE_REACHED && cycle->target == CYCLE_TARGET_MET);
}

/* Returns true if a condition is met. Each kind of condition has a case (-Wswitch-enum). */
static bool is_met(cycle_t *cycle, const cycle_condition_t *condition, const cycle_inputs_t *now) {
  const int32_t level = condition->level;
  switch ((cycle_when_t)condition->when) {
    case CYCLE_NEVER:
      return false;
    case CYCLE_REACHED:
      return (cycle->target & (CYCLE_TARGET_MET | now->reached)) != 0;
    case CYCLE_TIME:
      return cycle->phase_ticks >= (uint32_t)level;
    case CYCLE_FORCE_ABOVE:
      return cycle->force_q8 >= level;
    case CYCLE_FORCE_BELOW:
      return cycle->force_q8 <= level;
    case CYCLE_TRAVEL_ABOVE:
      return fx_magnitude(travel_of(now, cycle->start_cnt)) >= (uint32_t)level;
    case CYCLE_DEPTH_ABOVE:
    case CYCLE_DEPTH_BELOW:
      return is_deep(cycle, condition, now);
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
      return false;
  }
}

/* Returns true if the verdict on the pressed part depends on the sample of this tick. Until travel
 * 0 is found, this is true in each phase. */
static bool is_judged(const cycle_t *cycle) {
  return cycle->zeroed == 0 || (cycle->judged & (uint16_t)fx_scale(1, cycle->phase)) != 0;
}

/* Counts a sample that is not valid, if the verdict on the pressed part depends on this sample. */
static void count_invalid(cycle_t *cycle) {
  if (!is_judged(cycle)) {
    return;
  }
  if (cycle->invalid_ticks == 0 && cycle->outcome == CYCLE_BY_PROGRAM) {
    cycle->failed_phase = cycle->phase;
  }
  cycle->invalid_ticks += 1;
}

/* Returns the limit of the phase that is exceeded in this tick, or CYCLE_BY_PROGRAM. A measured
 * force at the end of its range counts as larger than force_max, because the true force may be
 * larger. */
static uint8_t limit_of(const cycle_t *cycle, const cycle_phase_t *phase,
                        const cycle_inputs_t *now) {
  if ((now->defects & CYCLE_SAMPLE_AT_END) != 0) {
    return is_judged(cycle) ? CYCLE_SAMPLES_INVALID : CYCLE_OVER_FORCE;
  }
  if (fx_magnitude(now->force_q8) > phase->force_max_q8) {
    return CYCLE_OVER_FORCE;
  }
  if (fx_magnitude(fx_diff_wrap(now->position, cycle->start_cnt)) > phase->travel_max) {
    return CYCLE_OVER_TRAVEL;
  }
  return (cycle->phase_ticks > phase->time_max) ? CYCLE_OVER_TIME : CYCLE_BY_PROGRAM;
}

/* Adds a sample to the tare measurement, and ends this measurement with its last sample. Returns
 * the reason why the tare fails (CYCLE_TARE_), or CYCLE_BY_PROGRAM if it does not fail. */
static uint8_t measure_tare(cycle_t *cycle, const cycle_phase_t *phase, const cycle_inputs_t *now) {
  if (now->contact != 0) {
    return CYCLE_TARE_CONTACT;
  }
  const bool is_valid = now->defects == CYCLE_SAMPLE_VALID;
  if (!is_valid ||
      !fx_within(fx_diff_wrap(now->position, cycle->tare_cnt), CYCLE_TARE_JITTER_CNT)) {
    begin_tare(cycle, now);
  }
  if (!is_valid) {
    return CYCLE_BY_PROGRAM;
  }
  cycle->tare_sum += within_force(now->force_q8);
  cycle->tare_ticks = (uint16_t)(cycle->tare_ticks + 1);
  if (cycle->tare_ticks < (uint32_t)phase->target) {
    return CYCLE_BY_PROGRAM;
  }
  const int32_t mean = fx_mean_half_up(cycle->tare_sum, cycle->tare_ticks);
  if (mean < cycle->tare_least || mean > cycle->tare_most) {
    return CYCLE_TARE_BAND;
  }
  cycle->offset_q8 = mean;
  take_force(cycle, now);
  cycle->target = CYCLE_TARGET_MET;
  cycle->tared = 1;
  return CYCLE_BY_PROGRAM;
}

/* Returns the outcome of a failure in this tick: the exceeded limit of the phase, or the reason why
 * the tare of the phase fails. Returns CYCLE_BY_PROGRAM if nothing fails. */
static uint8_t failure_of(cycle_t *cycle, const cycle_phase_t *phase, const cycle_inputs_t *now) {
  const uint8_t limit = limit_of(cycle, phase, now);
  if (phase->action != CYCLE_TARE || cycle->target != CYCLE_TARGET_OPEN) {
    return limit;
  }
  if (limit != CYCLE_BY_PROGRAM) {
    return (limit == CYCLE_OVER_TIME) ? (uint8_t)CYCLE_TARE_MOVING : limit;
  }
  return measure_tare(cycle, phase, now);
}

/* Begins the phase with the number `next`. If `next` is CYCLE_END, ends the cycle. */
static void go_on(cycle_t *cycle, uint8_t next, const cycle_inputs_t *now) {
  if (next == CYCLE_END) {
    end(cycle);
  } else {
    begin_phase(cycle, next, now);
  }
}

/* Acts on an exceeded limit. The first exceeded limit determines the outcome of the cycle, and the
 * cycle continues with the phase `reaction` of the present phase. A second exceeded limit ends the
 * cycle. */
static void exceed(cycle_t *cycle, uint8_t limit, const cycle_inputs_t *now) {
  const bool is_first = cycle->outcome == CYCLE_BY_PROGRAM;
  if (is_first) {
    cycle->outcome = limit;
    cycle->failed_phase = cycle->phase;
  }
  cycle->ended_by = 0;
  go_on(cycle, is_first ? cycle_phase(cycle)->reaction : CYCLE_END, now);
}

/* Returns true if the sample of this tick defines travel 0, the origin of the travel. */
static bool is_at_zero(const cycle_t *cycle, const cycle_inputs_t *now) {
  const int32_t level = cycle->program->zero_level;
  if (cycle->program->zero == CYCLE_ZERO_TOUCH) {
    return now->contact != 0;
  }
  return (level > 0) ? cycle->force_q8 >= level : cycle->force_q8 <= level;
}

/* The stiffness is measured over sections of the travel (stiffness_travel). If the present section
 * is complete, stores its changes of force and travel, and begins the next section. For a section
 * in the negative direction, the signs of both changes are inverted. */
static void measure_stiffness(cycle_t *cycle, uint32_t section, const cycle_inputs_t *now) {
  const int32_t travel = travel_of(now, cycle->section_cnt);
  if (fx_magnitude(travel) >= section) {
    const int32_t change = cycle->force_q8 - cycle->section_force_q8;
    cycle->section_change_q8 = (travel < 0) ? -change : change;
    cycle->section_travel = (travel < 0) ? -travel : travel;
    cycle->section_cnt = now->position;
    cycle->section_force_q8 = cycle->force_q8;
  }
}

/* Finds the first condition of the phase that is met, and begins the next phase of this condition.
 * Returns false if no condition is met. */
static bool take_condition(cycle_t *cycle, const cycle_phase_t *phase, const cycle_inputs_t *now) {
  uint16_t *taken = cycle->taken[cycle->phase];
  for (uint8_t i = 0; i < CYCLE_CONDITIONS; i++) {
    const cycle_condition_t *condition = &phase->conditions[i];
    if ((condition->count == 0 || taken[i] < condition->count) &&
        has_sample(cycle, condition->when, now) && is_met(cycle, condition, now)) {
      taken[i] = (uint16_t)(taken[i] + (condition->count != 0));
      cycle->ended_by = (uint8_t)(i + 1);
      go_on(cycle, condition->next, now);
      return true;
    }
  }
  return false;
}

/* Asserts the invariants of a cycle that has begun: the cycle is in a phase of its program, and the
 * force is within the range of a sample. After the end of the cycle only outputs of outputs_keep
 * are on. */
static inline void assert_begun(const cycle_t *cycle) {
  const cycle_header_t *program = cycle->program;
  fx_assert(program != NULL && cycle->phase < program->phases);
  fx_assert(program->phases <= CYCLE_PHASES_MAX && program->elements <= CYCLE_ELEMENTS_MAX);
  fx_assert(fx_within(cycle->force_q8, CYCLE_FORCE_MAX_Q8));
  fx_assert(cycle->outcome < CYCLE_OUTCOMES && cycle->target <= CYCLE_TARGET_MET);
  fx_assert(cycle->ended_by <= CYCLE_CONDITIONS && cycle->outputs <= CYCLE_OUTPUTS_ALL);
  if (cycle->state == CYCLE_ENDED) {
    fx_assert((cycle->outputs & (uint8_t)~program->outputs_keep) == 0);
  }
}

bool cycle_step(cycle_t *cycle, const cycle_inputs_t *now) {
  fx_assert(cycle->state == CYCLE_RUNNING);
  assert_begun(cycle);
  take_force(cycle, now);
  cycle->has_depth = 0;
  if (now->defects != CYCLE_SAMPLE_VALID) {
    count_invalid(cycle);
  } else if (cycle->zeroed == 0 && is_at_zero(cycle, now)) {
    cycle->zeroed = 1;
    set_zero(cycle, now);
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
  if (phase->stiffness_travel != 0 && now->defects == CYCLE_SAMPLE_VALID) {
    measure_stiffness(cycle, phase->stiffness_travel, now);
  }
  const uint8_t failure = failure_of(cycle, phase, now);
  if (failure != CYCLE_BY_PROGRAM) {
    exceed(cycle, failure, now);
    return true;
  }
  if (take_condition(cycle, phase, now)) {
    return true;
  }
  if (phase->action == CYCLE_FOLLOW) {
    follow(cycle, phase, now);
  }
  return false;
}

void cycle_abort(cycle_t *cycle) {
  if (cycle->state != CYCLE_RUNNING) {
    return;
  }
  if (cycle->last_tick == cycle->begin_tick) {
    const uint8_t outputs = cycle->outputs_before;
    cycle_init(cycle);
    cycle->outputs = outputs;
    return;
  }
  cycle_end(cycle, CYCLE_STOPPED);
  cycle->outcome = CYCLE_STOPPED;
}

static void finish(cycle_t *cycle) {
  if (cycle->outcome == CYCLE_BY_PROGRAM) {
    cycle->outcome = (cycle->incomplete != 0)      ? CYCLE_SAMPLES_LOST
                     : (cycle->invalid_ticks != 0) ? CYCLE_SAMPLES_INVALID
                                                   : CYCLE_BY_PROGRAM;
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
  assert_begun(cycle);
  const bool has_ended = cycle->state == CYCLE_ENDED;
  const cycle_element_t *elements = cycle_elements(cycle->program);
  while (cycle->evaluated != cycle->written) {
    cycle_sample_t *next = &cycle->samples[cycle->evaluated & (CYCLE_SAMPLES - 1)];
    next->travel =
        within_travel(depth_of(cycle->program, within_travel(next->travel), next->force_q8));
    for (uint8_t i = 0; next->is_valid != 0 && i < cycle->program->elements; i++) {
      cycle_element_take(&elements[i], cycle_points(cycle->program), &cycle->elements[i], next);
    }
    cycle->evaluated = (uint8_t)(cycle->evaluated + 1);
  }
  if (has_ended) {
    finish(cycle);
  }
}

cycle_element_result_t cycle_result(const cycle_t *cycle, uint8_t element) {
  fx_assert(cycle->program != NULL && element < cycle->program->elements);
  cycle_element_result_t result =
      cycle_element_result(&cycle_elements(cycle->program)[element], &cycle->elements[element]);
  if (result.verdict == CYCLE_NOT_REACHED && cycle->outcome == CYCLE_STOPPED) {
    result.verdict = CYCLE_ABORTED;
  }
  return result;
}
