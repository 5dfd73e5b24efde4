#include "firmware/cycle/program.h"

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"

_Static_assert(sizeof(cycle_header_t) == 40, "the structure is the layout of the record");
_Static_assert(sizeof(cycle_phase_t) == 68, "the structure is the layout of the record");
_Static_assert(sizeof(cycle_element_t) == 40, "the structure is the layout of the record");
_Static_assert(sizeof(cycle_point_t) == 8, "the structure is the layout of the record");

enum { CRC_BYTES = 4, INPUTS_ALL = 31 };

static bool is_stiffness(const cycle_condition_t *condition) {
  return condition->when == CYCLE_STIFFNESS_ABOVE || condition->when == CYCLE_STIFFNESS_BELOW;
}

static bool is_target(const cycle_header_t *program, uint8_t next) {
  return next < program->phases || next == CYCLE_END;
}

static bool has_right_level(const cycle_condition_t *condition) {
  switch ((cycle_when_t)condition->when) {
    case CYCLE_NEVER:
    case CYCLE_REACHED:
    case CYCLE_CONTACT:
    case CYCLE_LOST:
      return condition->level == 0;
    case CYCLE_TIME:
    case CYCLE_TRAVEL_ABOVE:
      return condition->level > 0;
    case CYCLE_FORCE_ABOVE:
    case CYCLE_FORCE_BELOW:
      return fx_within(condition->level, CYCLE_FORCE_MAX_Q8);
    case CYCLE_DEPTH_ABOVE:
    case CYCLE_DEPTH_BELOW:
      return fx_within(condition->level, CYCLE_TRAVEL_MAX);
    case CYCLE_INPUT_ON:
    case CYCLE_INPUT_OFF:
      return condition->level > 0 && condition->level <= INPUTS_ALL;
    case CYCLE_STIFFNESS_ABOVE:
    case CYCLE_STIFFNESS_BELOW:
      return true;
    default:
      return false;
  }
}

static bool is_move(uint8_t action) {
  return action == CYCLE_MOVE || action == CYCLE_MOVE_BY || action == CYCLE_MOVE_TO_DEPTH ||
         action == CYCLE_APPROACH;
}

/* Returns true if all fields that the action of a phase does not use are 0. */
static bool has_right_action(const cycle_phase_t *phase) {
  const uint8_t action = phase->action;
  const bool presses = action == CYCLE_PRESS || action == CYCLE_FOLLOW;
  if (action >= CYCLE_ACTIONS || (phase->slope != 0) != presses ||
      (phase->force != 0) != (action == CYCLE_PRESS) || (phase->speed != 0) != is_move(action)) {
    return false;
  }
  if (action == CYCLE_TARE) {
    return phase->target > 0 && phase->target <= CYCLE_TARE_TICKS_MAX;
  }
  return is_move(action) || phase->target == 0;
}

/* Returns true if the table of a phase with the action FOLLOW is valid and lies within the points
 * of the cycle program. */
static bool has_right_table(const cycle_header_t *program, const cycle_phase_t *phase) {
  if (phase->action != CYCLE_FOLLOW) {
    return phase->first == 0 && phase->points == 0 && phase->over_travel == 0;
  }
  return (uint32_t)phase->first + phase->points <= program->points && phase->over_travel <= 1 &&
         cycle_table_is_valid(&cycle_points(program)[phase->first], phase->points);
}

/* Returns true if a phase with the action OUTPUT switches at least one output. */
static bool has_right_outputs(const cycle_phase_t *phase) {
  const uint8_t all = phase->outputs_on | phase->outputs_off;
  return all <= CYCLE_OUTPUTS_ALL && (phase->outputs_on & phase->outputs_off) == 0 &&
         (all != 0 || phase->action != CYCLE_OUTPUT);
}

static bool has_right_limits(const cycle_phase_t *phase) {
  return phase->force_max_q8 > 0 && phase->force_max_q8 <= CYCLE_FORCE_MAX_Q8 &&
         phase->travel_max > 0 && phase->travel_max <= CYCLE_TRAVEL_MAX && phase->time_max > 0;
}

/* Returns true if each condition of a phase is valid. stiffness_travel must be 0 if no condition
 * uses it, and must not be 0 otherwise. */
static bool has_right_conditions(const cycle_header_t *program, const cycle_phase_t *phase) {
  bool uses_stiffness = false;
  for (uint8_t i = 0; i < CYCLE_CONDITIONS; i++) {
    const cycle_condition_t *condition = &phase->conditions[i];
    if (condition->when >= CYCLE_CONDITION_KINDS || !is_target(program, condition->next) ||
        !has_right_level(condition)) {
      return false;
    }
    uses_stiffness = uses_stiffness || is_stiffness(condition);
  }
  return uses_stiffness == (phase->stiffness_travel != 0);
}

static bool is_right_phase(const cycle_header_t *program, const cycle_phase_t *phase) {
  return has_right_action(phase) && phase->force > -INT16_MAX && has_right_table(program, phase) &&
         has_right_outputs(phase) && has_right_limits(phase) &&
         is_target(program, phase->reaction) && has_right_conditions(program, phase);
}

static bool is_of_force(uint8_t when) {
  return when == CYCLE_FORCE_ABOVE || when == CYCLE_FORCE_BELOW || when == CYCLE_CONTACT ||
         when == CYCLE_LOST || when == CYCLE_STIFFNESS_ABOVE || when == CYCLE_STIFFNESS_BELOW;
}

static bool rests_on_force(const cycle_header_t *program, const cycle_phase_t *phase) {
  const uint8_t action = phase->action;
  bool rests = action == CYCLE_APPROACH || action == CYCLE_PRESS || action == CYCLE_FOLLOW ||
               action == CYCLE_TARE;
  for (uint8_t i = 0; i < CYCLE_CONDITIONS; i++) {
    const uint8_t when = phase->conditions[i].when;
    rests = rests || is_of_force(when) ||
            (program->compliance != 0 && (when == CYCLE_DEPTH_ABOVE || when == CYCLE_DEPTH_BELOW));
  }
  return rests;
}

uint16_t cycle_program_judged(const cycle_header_t *program) {
  uint32_t judged = 0;
  for (uint8_t i = 0; i < program->elements; i++) {
    judged |= cycle_elements(program)[i].phases;
  }
  for (uint8_t i = 0; i < program->phases; i++) {
    judged |= rests_on_force(program, &cycle_phases(program)[i]) ? (uint32_t)fx_scale(1, i) : 0;
  }
  return (uint16_t)judged;
}

static int32_t larger(int32_t a, int32_t b) { return (a > b) ? a : b; }

cycle_reach_t cycle_program_reach(const cycle_header_t *program) {
  const int32_t zero = (program->zero == CYCLE_ZERO_FORCE) ? program->zero_level : 0;
  cycle_reach_t reach = {0, larger(zero, 0), -larger(-zero, 0)};
  for (uint8_t i = 0; i < program->phases; i++) {
    const cycle_phase_t *phase = &cycle_phases(program)[i];
    reach.force_max_q8 = larger(reach.force_max_q8, (int32_t)phase->force_max_q8);
    for (uint8_t k = 0; k < CYCLE_CONDITIONS; k++) {
      const cycle_condition_t *condition = &phase->conditions[k];
      if (condition->when == CYCLE_FORCE_ABOVE) {
        reach.most_q8 = larger(reach.most_q8, condition->level);
      } else if (condition->when == CYCLE_FORCE_BELOW) {
        reach.least_q8 = -larger(-reach.least_q8, -condition->level);
      }
    }
  }
  return reach;
}

static bool has_right_zero(const cycle_header_t *program) {
  switch (program->zero) {
    case CYCLE_ZERO_TOUCH:
      return program->zero_level == 0;
    case CYCLE_ZERO_FORCE:
      return program->zero_level != 0 && fx_within(program->zero_level, CYCLE_FORCE_MAX_Q8);
    default:
      return program->zero == CYCLE_ZERO_POSITION;
  }
}

/* Returns true if the curve of the compliance is valid, and its forces are within the range of a
 * sample. */
static bool has_right_compliance(const cycle_header_t *program) {
  const cycle_point_t *points = cycle_points(program);
  const uint8_t count = program->compliance;
  return count == 0 ||
         (count <= program->points && count <= CYCLE_COMPLIANCE_MAX &&
          cycle_table_is_valid(points, count) && fx_within(points[0].x, CYCLE_FORCE_MAX_Q8) &&
          fx_within(points[count - 1].x, CYCLE_FORCE_MAX_Q8));
}

static bool has_right_header(const cycle_header_t *program) {
  return program->reserved == 0 && program->outputs_keep <= CYCLE_OUTPUTS_ALL &&
         has_right_compliance(program);
}

static bool has_right_size(const cycle_header_t *program, uint32_t size) {
  return program->phases > 0 && program->phases <= CYCLE_PHASES_MAX &&
         program->elements <= CYCLE_ELEMENTS_MAX && program->size == size &&
         sizeof(cycle_header_t) + program->phases * sizeof(cycle_phase_t) +
                 program->elements * sizeof(cycle_element_t) +
                 program->points * sizeof(cycle_point_t) + CRC_BYTES ==
             size;
}

uint32_t cycle_program_crc(const cycle_header_t *program) {
  const void *record = program;
  return fx_load_le32((const uint8_t *)record + program->size - CRC_BYTES);
}

static bool has_right_crc(const uint8_t *bytes, uint32_t size) {
  uint32_t crc = UINT32_MAX;
  for (uint32_t i = 0; i < size - CRC_BYTES; i++) {
    crc = fx_crc32(crc, bytes[i]);
  }
  return ~crc == fx_load_le32(&bytes[size - CRC_BYTES]);
}

static cycle_check_t check_parts(const cycle_header_t *program) {
  for (uint8_t i = 0; i < program->phases; i++) {
    if (!is_right_phase(program, &cycle_phases(program)[i])) {
      return (cycle_check_t){CYCLE_WRONG_PHASE, i};
    }
  }
  for (uint8_t i = 0; i < program->elements; i++) {
    if (!cycle_element_is_valid(&cycle_elements(program)[i], cycle_points(program),
                                program->points)) {
      return (cycle_check_t){CYCLE_WRONG_ELEMENT, i};
    }
  }
  return (cycle_check_t){CYCLE_ACCEPTED, 0};
}

cycle_check_t cycle_program_check(const void *record, uint32_t size) {
  const cycle_header_t *program = (const cycle_header_t *)record;
  if (size < sizeof(cycle_header_t) || program->magic != CYCLE_MAGIC) {
    return (cycle_check_t){CYCLE_NO_PROGRAM, 0};
  }
  if (program->version != CYCLE_VERSION) {
    return (cycle_check_t){CYCLE_OTHER_VERSION, 0};
  }
  if (size > CYCLE_PROGRAM_BYTES_MAX || !has_right_size(program, size)) {
    return (cycle_check_t){CYCLE_WRONG_SIZE, 0};
  }
  if (!has_right_crc((const uint8_t *)record, size)) {
    return (cycle_check_t){CYCLE_WRONG_CRC, 0};
  }
  if (!has_right_header(program)) {
    return (cycle_check_t){CYCLE_WRONG_HEADER, 0};
  }
  return has_right_zero(program) ? check_parts(program) : (cycle_check_t){CYCLE_WRONG_ZERO, 0};
}
