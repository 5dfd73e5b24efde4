#ifndef FIRMWARE_CYCLE_CYCLE_H_
#define FIRMWARE_CYCLE_CYCLE_H_

/* A cycle: conditions lead from phase to phase, an exceeded limit ends the cycle as not good, and
 * evaluation elements decide whether the pressed part is good. The cycle moves nothing; the drive
 * does what cycle_phase() says (firmware/drive/cycle_mode.h).
 *
 *   cycle_start()     between two ticks
 *   cycle_step()      once in each tick, after its signals. A tick that is missing makes the part
 *                     bad, and so does a sample of an evaluated phase that is not valid (sample.h),
 *                     but the phases go on
 *   cycle_evaluate()  between ticks, at the latest after CYCLE_SAMPLES ticks
 *   cycle_abort()     at each stop, fault, halt or change of mode; the part is then not good */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/cycle/element.h"
#include "firmware/cycle/program.h"
#include "firmware/cycle/sample.h"

/* Number of samples that wait for their evaluation, a power of two. */
enum { CYCLE_SAMPLES = 16 };

/* ENDED: the last phase has ended, and some samples are not evaluated yet. */
enum { CYCLE_IDLE = 0, CYCLE_RUNNING = 1, CYCLE_ENDED = 2, CYCLE_DONE = 3 };

/* How a cycle ended: as the program intends; a limit of a phase was exceeded; the cycle was stopped
 * from outside; samples were lost, because they were not evaluated in time or because ticks were
 * missing; the tare of a phase failed, because the axis was in contact or did not stand still, or
 * because the offset is beyond tare_band; a sample of an evaluated phase is not valid; a value that
 * affects the verdict was changed. */
enum {
  CYCLE_BY_PROGRAM = 0,
  CYCLE_OVER_FORCE = 1,
  CYCLE_OVER_TRAVEL = 2,
  CYCLE_OVER_TIME = 3,
  CYCLE_STOPPED = 4,
  CYCLE_SAMPLES_LOST = 5,
  CYCLE_TARE_CONTACT = 6,
  CYCLE_TARE_MOVING = 7,
  CYCLE_TARE_BAND = 8,
  CYCLE_SAMPLES_INVALID = 9,
  CYCLE_CHANGED = 10,
  CYCLE_OUTCOMES = 11
};

/* Whether the target of a phase is reached: no, because its tare is not complete or the demand has
 * not yet reached the last point of its table; if the drive reports it; yes. */
enum { CYCLE_TARGET_OPEN = 0, CYCLE_TARGET_BY_DRIVE = 1, CYCLE_TARGET_MET = 2 };

/* Measured values of the axis in one tick. */
typedef struct {
  uint32_t tick;
  int32_t position; /* position in encoder counts, which may wrap */
  int32_t force_q8; /* measured force in 1/256 count */
  uint8_t contact;  /* 1 in contact */
  uint8_t reached;  /* 1 if the drive has reached its target; used with CYCLE_TARGET_BY_DRIVE */
  uint8_t inputs;   /* digital inputs, AXIS_DIGITAL_INPUTS_ */
  uint8_t defects;  /* reasons why force or position is not valid, CYCLE_SAMPLE_ bits; 0: valid */
} cycle_inputs_t;

typedef struct {
  const cycle_header_t *program; /* NULL before the first cycle */
  uint32_t phase_ticks;          /* number of ticks since the phase began */
  uint32_t begin_tick;           /* tick of the start */
  uint32_t last_tick;            /* tick of the last sample */
  uint32_t invalid_ticks;        /* number of ticks in evaluated phases whose sample is not valid */
  int32_t start_cnt;             /* position at the start of the phase */
  int32_t zero_cnt;              /* position of travel 0; until travel 0 is found, the position at
                                  * the start of the cycle */
  int32_t begin_cnt;             /* zero_cnt at the start of the cycle */
  int32_t force_q8;              /* force of the last sample minus offset_q8, limited to the range
                                  * of a sample */
  int32_t depth;                 /* depth of the last sample, if has_depth is 1 */
  /* PRESS, FOLLOW: target of the demanded force for the next tick, in 1/256 per mille of
   * rated_force, without the offset */
  int32_t demand_q8;
  int32_t offset_q8; /* offset of the measured force; 0 until a tare has measured the offset */
  /* TARE: smallest and largest offset, which the caller sets when the phase begins; then the
   * position, the sum of the forces and the number of ticks of the measurement */
  int32_t tare_least;
  int32_t tare_most;
  int32_t tare_cnt;
  int32_t tare_sum;
  uint16_t tare_ticks;
  /* Begin of the present section of travel (stiffness_travel), and the changes of force and travel
   * over the last complete section, with the sign that makes section_travel positive.
   * section_travel is 0 until a section is complete. */
  int32_t section_cnt;
  int32_t section_force_q8;
  int32_t section_change_q8;
  int32_t section_travel;
  /* value of demand_q8 at the begin of each phase with the action FOLLOW; cycle_select() computes
   * these values */
  int32_t first_q8[CYCLE_PHASES_MAX];
  cycle_reach_t reach;                                /* range of forces that the force sensor has
                                                       * to measure for this program */
  uint16_t taken[CYCLE_PHASES_MAX][CYCLE_CONDITIONS]; /* number of times that each condition was
                                                       * fulfilled in this cycle */
  cycle_element_state_t elements[CYCLE_ELEMENTS_MAX];
  cycle_sample_t samples[CYCLE_SAMPLES];
  uint16_t judged; /* set of the evaluated phases, which cycle_select() computes */
  uint8_t written; /* numbers of samples that were written and that were evaluated, modulo 256 */
  uint8_t evaluated;
  uint8_t state;   /* CYCLE_IDLE to CYCLE_DONE */
  uint8_t phase;   /* number of the running phase, or of the last phase */
  uint8_t outcome; /* how the cycle ended, CYCLE_BY_PROGRAM to CYCLE_SAMPLES_INVALID */
  /* the phase in which a limit was exceeded first, the cycle was stopped, or the first sample was
   * not valid */
  uint8_t failed_phase;
  /* number, from 1, of the condition that ended the last phase that has ended; 0: a limit, a stop,
   * or no phase has ended yet */
  uint8_t ended_by;
  uint8_t target; /* whether the target of the phase is reached, CYCLE_TARGET_ */
  uint8_t has_depth;
  uint8_t tared;          /* 1 if offset_q8 is new; the drive clears this flag */
  uint8_t outputs;        /* outputs that are on */
  uint8_t outputs_before; /* digital outputs that were on before the start of the cycle */
  uint8_t zeroed;         /* 1 if travel 0 is found */
  uint8_t incomplete;     /* 1 if the cycle missed a tick */
  uint8_t good;           /* 1 if the cycle ended by its program and the verdict on each evaluation
                           * element is good */
} cycle_t;

/* Sets the state at power-up: no cycle has run. */
void cycle_init(cycle_t *cycle);

/* Selects the program of the next cycles, which must have been checked; NULL selects no program.
 * The state is then as at power-up. */
void cycle_select(cycle_t *cycle, const cycle_header_t *program);

/* Starts a cycle with the selected program. The program must not change until the cycle is done.
 * reference_cnt is the position of travel 0 for CYCLE_ZERO_POSITION. */
void cycle_start(cycle_t *cycle, const cycle_header_t *program, const cycle_inputs_t *now,
                 int32_t reference_cnt);

static inline bool cycle_is_running(const cycle_t *cycle) { return cycle->state == CYCLE_RUNNING; }

/* Returns the phase that runs. Only while the cycle is running. */
static inline const cycle_phase_t *cycle_phase(const cycle_t *cycle) {
  return &cycle_phases(cycle->program)[cycle->phase];
}

/* Processes the signals of a tick. Returns true if another phase began or the cycle ended in this
 * tick. */
bool cycle_step(cycle_t *cycle, const cycle_inputs_t *now);

/* Ends a running cycle in its present phase, with the given outcome. */
void cycle_end(cycle_t *cycle, uint8_t outcome);

/* Ends a running cycle as CYCLE_STOPPED. A cycle that is aborted before its first tick has not
 * begun: the state becomes that of power-up, and the outputs are as before the start. */
void cycle_abort(cycle_t *cycle);

/* Evaluates the samples that wait, whose travel becomes the depth. At the end of the cycle the
 * state becomes CYCLE_DONE. */
void cycle_evaluate(cycle_t *cycle);

/* Returns the result of an evaluation element, 0 .. elements - 1 of the program. In a cycle that
 * was stopped from outside, the verdict on an element without a value is CYCLE_ABORTED. */
cycle_element_result_t cycle_result(const cycle_t *cycle, uint8_t element);

#endif
