#ifndef FIRMWARE_CYCLE_CYCLE_H_
#define FIRMWARE_CYCLE_CYCLE_H_

/* A press cycle. Conditions lead from one phase to the next. After an exceeded limit the part is
 * not good. Evaluation elements decide whether the pressed part is good. These functions do not
 * move the axis: the drive carries out the phase that cycle_phase() returns
 * (firmware/drive/cycle_mode.h).
 *
 *   cycle_start()     is called between two ticks
 *   cycle_step()      is called once in each tick, after the signals of the tick were computed. A
 *                     missing tick makes the part bad, but the phases continue. A sample of an
 *                     evaluated phase that is not valid (sample.h) has the same effect
 *   cycle_evaluate()  is called between ticks, at the latest after CYCLE_SAMPLES ticks
 *   cycle_abort()     is called at each stop, fault, halt or change of mode; the part is then not
 *                     good */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/cycle/element.h"
#include "firmware/cycle/program.h"
#include "firmware/cycle/sample.h"

/* Largest number of samples that can wait for their evaluation; it must be a power of two. */
enum { CYCLE_SAMPLES = 16 };

/* States of a cycle. ENDED: the last phase has ended, and some samples are not evaluated yet. DONE:
 * the result is complete. */
enum { CYCLE_IDLE = 0, CYCLE_RUNNING = 1, CYCLE_ENDED = 2, CYCLE_DONE = 3 };

/* Outcomes: how a cycle ended.
 *   BY_PROGRAM       the cycle ended as its cycle program intends
 *   OVER_            a limit of a phase was exceeded
 *   STOPPED          the cycle was stopped from outside
 *   SAMPLES_LOST     samples were not evaluated in time, or ticks were missing
 *   TARE_            the tare of a phase failed: the axis was in contact, or did not stand still,
 *                    or the offset is beyond tare_band
 *   SAMPLES_INVALID  a sample of an evaluated phase is not valid
 *   CHANGED          a value that affects the verdict was changed */
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

/* Whether the target of a phase is reached. OPEN: it is not reached, because the tare is not
 * complete, or the demanded force is not yet at the last point of its table. BY_DRIVE: it is
 * reached if the drive reports so. MET: it is reached. */
enum { CYCLE_TARGET_OPEN = 0, CYCLE_TARGET_BY_DRIVE = 1, CYCLE_TARGET_MET = 2 };

/* Measured values of the axis in one tick. */
typedef struct {
  uint32_t tick;
  int32_t position; /* position in encoder counts; the count may wrap */
  int32_t force_q8; /* measured force in 1/256 count */
  uint8_t contact;  /* 1 if the axis is in contact */
  uint8_t reached;  /* 1 if the drive has reached its target; used with CYCLE_TARGET_BY_DRIVE */
  uint8_t inputs;   /* digital inputs as AXIS_DIGITAL_INPUTS_ bits */
  uint8_t defects;  /* reasons why force or position is not valid, CYCLE_SAMPLE_ bits; 0: valid */
} cycle_inputs_t;

typedef struct {
  const cycle_header_t *program; /* selected cycle program; NULL: no program is selected */
  uint32_t phase_ticks;          /* number of ticks since the present phase of the cycle began */
  uint32_t begin_tick;           /* tick in which the cycle started */
  uint32_t last_tick;            /* tick in which the last sample of the cycle was measured */
  /* number of ticks without a valid sample, in phases whose samples affect the verdict */
  uint32_t invalid_ticks;
  int32_t start_cnt; /* position at the start of the present phase of the cycle */
  /* position of travel 0, the origin of the travel; until it is found, the position at the start
   * of the cycle */
  int32_t zero_cnt;
  /* position at the start of the cycle, which is the first value of zero_cnt */
  int32_t begin_cnt;
  int32_t force_q8; /* force of the last sample minus offset_q8, limited to the range of a sample */
  int32_t depth;    /* depth of the last sample; valid only if has_depth is 1 */
  /* actions PRESS and FOLLOW: target of the demanded force for the next tick, in 1/256 per mille of
   * rated_force, without the offset */
  int32_t demand_q8;
  int32_t offset_q8; /* offset of the measured force; 0 until a tare has measured the offset */
  /* smallest and largest offset that the action TARE may measure; the caller sets them when the
   * phase begins. tare_cnt, tare_sum, tare_ticks: position, sum of the forces and number of ticks
   * of the tare measurement */
  int32_t tare_least;
  int32_t tare_most;
  int32_t tare_cnt;
  int32_t tare_sum;
  uint16_t tare_ticks;
  /* Position and force at the begin of the present section of the travel (stiffness_travel), then
   * the changes of force and travel over the last complete section. If the travel of this section
   * was negative, both changes have inverted signs. section_travel is 0 until a section is
   * complete. */
  int32_t section_cnt;
  int32_t section_force_q8;
  int32_t section_change_q8;
  int32_t section_travel;
  /* for each phase with the action FOLLOW, the value of demand_q8 when the phase begins;
   * cycle_select() computes these values */
  int32_t first_q8[CYCLE_PHASES_MAX];
  /* range of forces that the force sensor must be able to measure for this cycle program */
  cycle_reach_t reach;
  /* for each condition whose `count` is not 0, number of times in this cycle that it has ended its
   * phase */
  uint16_t taken[CYCLE_PHASES_MAX][CYCLE_CONDITIONS];
  cycle_element_state_t elements[CYCLE_ELEMENTS_MAX];
  cycle_sample_t samples[CYCLE_SAMPLES];
  /* set, as bits, of the phases whose samples affect the verdict; cycle_select() computes this
   * set */
  uint16_t judged;
  /* number of samples that were stored in this cycle, modulo 256; `evaluated`: number of samples
   * that were evaluated, modulo 256 */
  uint8_t written;
  uint8_t evaluated;
  uint8_t state; /* state of the cycle, CYCLE_IDLE to CYCLE_DONE */
  uint8_t phase; /* number of the running phase of the cycle, or of the last one */
  /* how the cycle ended: CYCLE_BY_PROGRAM to CYCLE_CHANGED */
  uint8_t outcome;
  /* number of the phase in which the cycle failed. It has failed when a limit was exceeded for the
   * first time, when the cycle was stopped, or when a sample was not valid for the first time */
  uint8_t failed_phase;
  /* number, from 1, of the condition that ended the previous phase; 0: a limit or a stop ended it,
   * or no phase has ended yet */
  uint8_t ended_by;
  uint8_t target; /* CYCLE_TARGET_: whether the target of the phase is reached */
  uint8_t has_depth;
  uint8_t tared;   /* 1 if a tare has just set offset_q8; the drive clears this flag */
  uint8_t outputs; /* set of the digital outputs that are on */
  /* set of the digital outputs that were on before the start of the cycle */
  uint8_t outputs_before;
  uint8_t zeroed;     /* 1 if travel 0, the origin of the travel, was found */
  uint8_t incomplete; /* 1 if the cycle missed a tick */
  /* 1 if the cycle ended as its program intends, and the verdict on each evaluation element
   * is good */
  uint8_t good;
} cycle_t;

/* Sets the state of a cycle at power-up: no cycle has run. */
void cycle_init(cycle_t *cycle);

/* Selects the cycle program of the next cycles. cycle_program_check() must have accepted the
 * program. NULL selects no program. The state of the cycle is then the same as at power-up. */
void cycle_select(cycle_t *cycle, const cycle_header_t *program);

/* Starts a cycle with the selected cycle program. The program must not change until the cycle is
 * done. reference_cnt is the position of travel 0 for CYCLE_ZERO_POSITION. */
void cycle_start(cycle_t *cycle, const cycle_header_t *program, const cycle_inputs_t *now,
                 int32_t reference_cnt);

static inline bool cycle_is_running(const cycle_t *cycle) { return cycle->state == CYCLE_RUNNING; }

/* Returns the present phase of the cycle program. Call this function only while the cycle is
 * running. */
static inline const cycle_phase_t *cycle_phase(const cycle_t *cycle) {
  return &cycle_phases(cycle->program)[cycle->phase];
}

/* Processes the signals of a tick. Returns true if another phase began or the cycle ended in this
 * tick. */
bool cycle_step(cycle_t *cycle, const cycle_inputs_t *now);

/* Ends a running cycle before the end of its program, in its present phase and with the given
 * outcome. */
void cycle_end(cycle_t *cycle, uint8_t outcome);

/* Ends a running cycle as CYCLE_STOPPED. If the cycle was aborted before its first tick, it has not
 * begun: its state is the same as at power-up, and the digital outputs are the same as before the
 * start. */
void cycle_abort(cycle_t *cycle);

/* Evaluates the waiting samples. The travel of each sample becomes its depth. At the end of the
 * cycle the state becomes CYCLE_DONE. */
void cycle_evaluate(cycle_t *cycle);

/* Returns the result of the evaluation element with the number `element`, from 0 to the number of
 * elements of the program - 1. In a cycle that was stopped from outside, the verdict on an element
 * without a value is CYCLE_ABORTED. */
cycle_element_result_t cycle_result(const cycle_t *cycle, uint8_t element);

#endif
