#include "firmware/guard/first_motion.h"

#include "firmware/fx/fx.h"
#include "firmware/guard/sensor.h"

/* Difference between the number of the fault (AXIS_FAULT_) and the number of the result
 * (AXIS_FIRST_MOTION_RESULT_) of a failed test. The difference is constant, because these faults
 * and results have the same order. */
enum {
  FAULT_OF_RESULT = AXIS_FAULT_FORCE_SENSOR_FAILED - AXIS_FIRST_MOTION_RESULT_FORCE_SENSOR_FAILED
};
_Static_assert(AXIS_FAULT_POSITION_GAIN_ZERO - FAULT_OF_RESULT ==
                       AXIS_FIRST_MOTION_RESULT_POSITION_GAIN_ZERO &&
                   AXIS_FAULT_RUNAWAY - FAULT_OF_RESULT == AXIS_FIRST_MOTION_RESULT_RUNAWAY,
               "a result is its fault, less a constant");

/* Largest permitted change of the motor current at standstill, in per mille of the range of the
 * current. At standstill the current of an axis without a defect never changes by a quarter of its
 * range. */
enum { CURRENT_JUMP_PER_MILLE = 250 };

static void forget_travel(first_motion_t *first) {
  first->moved_cnt = 0;
  first->stopped_cnt = 0;
  first->coasted_cnt = 0;
  first->spent_cnt = 0;
  first->coasts = 0;
}

void first_motion_forget(first_motion_t *first, drive_signals_t *signals) {
  first->phase = (first->coasts != 0) ? FIRST_MOTION_COASTING : FIRST_MOTION_OPEN;
  signals->first_motion_result = AXIS_FIRST_MOTION_RESULT_NOT_RUN;
  signals->first_motion_moved = 0;
  signals->first_motion_code_reached = 0;
  signals->first_motion_force = 0;
}

bool first_motion_depends_on(uint16_t object) {
  return object == AXIS_OBJ_FIRST_MOTION_TEST || object == AXIS_OBJ_FORCE_SIGN ||
         object == AXIS_OBJ_FORCE_ZERO_CODE || object == AXIS_OBJ_ADC_BITS ||
         object == AXIS_OBJ_OUTPUT_BIAS;
}

bool first_motion_is_bounded_by(uint16_t object) {
  return object == AXIS_OBJ_FIRST_MOTION_CODE || object == AXIS_OBJ_FIRST_MOTION_COUNTS ||
         object == AXIS_OBJ_FIRST_MOTION_SPEED || object == AXIS_OBJ_CONTACT_FORCE ||
         object == AXIS_OBJ_FORCE_TARE || object == AXIS_OBJ_OUTPUT_BIAS;
}

static void end_coasting(first_motion_t *first) {
  first->coasts = 0;
  first->phase = FIRST_MOTION_OPEN;
}

/* If the present attempt has switched the amplifier on, stores that the amplifier is switched off
 * now. */
static void stop_attempt(first_motion_t *first) {
  if (first->phase >= FIRST_MOTION_ZERO && first->phase <= FIRST_MOTION_BACK) {
    first->stopped_cnt = first->moved_cnt;
    first->coasts = 1;
  }
}

static void begin_standing(first_motion_t *first) {
  stop_attempt(first);
  first->phase = FIRST_MOTION_STANDING;
  first->phase_tick = 0;
  first->rest_tick = 0;
  first->code = 0;
  first->direction = -1;
  first->sign_seen = 0;
}

void first_motion_begin(first_motion_t *first, const drive_params_t *params,
                        drive_signals_t *signals) {
  if (params->first_motion_test == AXIS_FIRST_MOTION_TEST_OFF) {
    if (first->phase == FIRST_MOTION_COASTING) {
      /* A motion of the axis after this tick does not belong to the first motion test. */
      end_coasting(first);
    }
    return;
  }
  if (first->phase != FIRST_MOTION_OPEN && first->phase != FIRST_MOTION_COASTING) {
    return;
  }
  first_motion_forget(first, signals);
  signals->first_motion_result = AXIS_FIRST_MOTION_RESULT_RUNNING;
  begin_standing(first);
}

void first_motion_cancel(first_motion_t *first, drive_signals_t *signals) {
  if (first_motion_is_running(first)) {
    stop_attempt(first);
    first->phase_tick = 0;
    first_motion_forget(first, signals);
  }
}

void first_motion_yield(first_motion_t *first, drive_signals_t *signals) {
  const bool is_stopped = first_motion_is_running(first) || first->phase == FIRST_MOTION_COASTING;
  forget_travel(first);
  if (is_stopped) {
    first_motion_forget(first, signals);
  }
}

static int16_t signed_code(const first_motion_t *first) {
  const bool negative = (first->direction < 0) != (first->phase == FIRST_MOTION_BACK);
  return (int16_t)(negative ? -first->code : first->code);
}

void first_motion_command(first_motion_t *first, axis_t *axis, bool halted) {
  if (halted) {
    begin_standing(first);
  }
  axis->params.mode =
      (first->phase == FIRST_MOTION_STANDING) ? AXIS_MODE_DISABLED : AXIS_MODE_OPEN_LOOP;
  axis->params.open_loop_code = signed_code(first);
  axis->params.bump_decay_shift = 0;
}

static void conclude(first_motion_t *first, drive_signals_t *signals, uint8_t result) {
  first->phase = FIRST_MOTION_OPEN;
  forget_travel(first);
  signals->first_motion_result = result;
}

void first_motion_refuse(first_motion_t *first, drive_signals_t *signals, axis_t *axis) {
  conclude(first, signals, AXIS_FIRST_MOTION_RESULT_POSITION_GAIN_ZERO);
  axis_fault(axis, AXIS_FAULT_POSITION_GAIN_ZERO);
}

static void enter_phase(first_motion_t *first, const axis_t *axis, uint8_t phase) {
  first->phase = phase;
  first->phase_tick = 0;
  first->rises = 0;
  first->start_cnt = axis->signals.position;
  first->force_start = axis->signals.force;
}

static void add_travel(first_motion_t *first, const axis_t *axis) {
  const uint32_t moved = fx_magnitude(fx_diff_wrap(axis->signals.position, first->origin_cnt));
  first->moved_cnt = (moved > first->moved_cnt) ? moved : first->moved_cnt;
}

/* Returns true if the travel of all attempts of the first motion test together is too large. */
static bool is_beyond(first_motion_t *first, const drive_params_t *params, const axis_t *axis) {
  add_travel(first, axis);
  return first->spent_cnt + first->moved_cnt >
         (uint32_t)FIRST_MOTION_REACH * params->first_motion_counts;
}

/* Begins the phase "zero" of the first motion test: switches the amplifier on. */
static void begin_zero(first_motion_t *first, const axis_t *axis) {
  enter_phase(first, axis, FIRST_MOTION_ZERO);
  first->origin_cnt = first->start_cnt;
  first->spent_cnt += first->stopped_cnt + first->coasted_cnt;
  first->coasted_cnt = first->moved_cnt - first->stopped_cnt;
  first->stopped_cnt = 0;
  first->moved_cnt = 0;
  first->coasts = 0;
}

static bool stands(const first_motion_t *first, const axis_t *axis) {
  return fx_within(fx_diff_wrap(axis->signals.position, first->start_cnt), FIRST_MOTION_JITTER_CNT);
}

/* While the disabled axis is not at standstill yet, adds its travel in this tick to the travel of
 * the previous attempt. */
static void coast(first_motion_t *first, const axis_t *axis) {
  add_travel(first, axis);
  if (!stands(first, axis)) {
    first->start_cnt = axis->signals.position;
    first->phase_tick = 0;
  }
  first->phase_tick = (uint16_t)(first->phase_tick + 1);
  if (first->phase_tick == FIRST_MOTION_STAND_TICKS) {
    end_coasting(first);
  }
}

/* Each function whose name begins with check_ checks a tick of one phase of the test. It returns
 * the reason why the test has failed, or AXIS_FIRST_MOTION_RESULT_RUNNING if the test has not
 * failed. */

/* Returns true if the measured force has stayed within contact_force since the phase began. */
static bool is_steady(first_motion_t *first, const axis_t *axis) {
  const int32_t force = axis->signals.force;
  first->force_low = (force < first->force_low) ? force : first->force_low;
  first->force_high = (force > first->force_high) ? force : first->force_high;
  return first->force_high - first->force_low <= axis->params.contact_force;
}

static uint8_t end_standing(first_motion_t *first, const drive_params_t *params,
                            const axis_t *axis) {
  begin_zero(first, axis);
  return is_beyond(first, params, axis) ? AXIS_FIRST_MOTION_RESULT_RUNAWAY
                                        : AXIS_FIRST_MOTION_RESULT_RUNNING;
}

static uint8_t check_standstill(first_motion_t *first, const drive_params_t *params,
                                const axis_t *axis) {
  const axis_signals_t *signals = &axis->signals;
  const int16_t current = fx_per_mille_of_bits(signals->current_raw, axis->params.adc_bits);
  if (sensor_is_railed(axis)) {
    return AXIS_FIRST_MOTION_RESULT_FORCE_SENSOR_FAILED;
  }
  if (signals->current_raw >= fx_highest_code(axis->params.adc_bits)) {
    return AXIS_FIRST_MOTION_RESULT_CURRENT_SENSOR_FAILED;
  }
  first->rest_tick = (uint16_t)(first->rest_tick + 1);
  if (first->coasts != 0) {
    add_travel(first, axis);
  }
  const bool is_still = stands(first, axis);
  const bool changes = !is_steady(first, axis) || !is_still;
  if (first->phase_tick == 0 || changes) {
    enter_phase(first, axis, FIRST_MOTION_STANDING);
    first->force_low = signals->force;
    first->force_high = signals->force;
    first->current_start = current;
    first->moves = is_still ? 0 : 1;
  }
  if (!fx_within(current - first->current_start, CURRENT_JUMP_PER_MILLE)) {
    return AXIS_FIRST_MOTION_RESULT_CURRENT_SENSOR_FAILED;
  }
  if (first->rest_tick > FIRST_MOTION_REST_TICKS) {
    return (first->moves != 0) ? AXIS_FIRST_MOTION_RESULT_NOT_STANDING
                               : AXIS_FIRST_MOTION_RESULT_FORCE_SENSOR_FAILED;
  }
  first->phase_tick = (uint16_t)(first->phase_tick + 1);
  return (first->phase_tick == FIRST_MOTION_STAND_TICKS) ? end_standing(first, params, axis)
                                                         : AXIS_FIRST_MOTION_RESULT_RUNNING;
}

static uint8_t check_zero(first_motion_t *first, const drive_params_t *params, const axis_t *axis) {
  const int32_t moved = fx_diff_wrap(axis->signals.position, first->start_cnt);
  if (!fx_within(moved, params->first_motion_counts - 1)) {
    return AXIS_FIRST_MOTION_RESULT_AMPLIFIER_OFFSET;
  }
  if (is_beyond(first, params, axis)) {
    return AXIS_FIRST_MOTION_RESULT_RUNAWAY;
  }
  first->phase_tick = (uint16_t)(first->phase_tick + 1);
  if (first->phase_tick == FIRST_MOTION_ZERO_TICKS) {
    enter_phase(first, axis, FIRST_MOTION_OUT);
  }
  return AXIS_FIRST_MOTION_RESULT_RUNNING;
}

/* Returns true if a limit prevents the axis from moving in its present direction. */
static bool is_blocked(const axis_t *axis) {
  return axis->signals.limit_reason >= AXIS_LIMIT_REASON_POSITION_MIN &&
         axis->signals.limit_reason <= AXIS_LIMIT_REASON_LIMIT_SWITCH_POS;
}
_Static_assert(AXIS_LIMIT_REASON_POSITION_MIN > AXIS_LIMIT_REASON_OUTPUT_LIMIT &&
                   AXIS_LIMIT_REASON_LIMIT_SWITCH_POS - AXIS_LIMIT_REASON_POSITION_MIN == 3,
               "the reasons from position_min to limit_switch_pos block");

/* Sets the DAC code of the test for the next tick. Returns false when the largest code has been
 * output for FIRST_MOTION_HOLD_TICKS. */
static bool raise_code(first_motion_t *first, const drive_params_t *params) {
  first->rises ^= 1;
  if (first->code < params->first_motion_code) {
    first->code = (int16_t)(first->code + first->rises);
    return true;
  }
  first->phase_tick = (uint16_t)(first->phase_tick + 1);
  return first->phase_tick < FIRST_MOTION_HOLD_TICKS;
}

static bool runs_away(first_motion_t *first, const drive_params_t *params, const axis_t *axis) {
  return !fx_within(axis->signals.velocity, params->first_motion_speed) ||
         is_beyond(first, params, axis);
}

/* Checks the change of the measured force over the complete motion away from the start position. */
static uint8_t check_force(first_motion_t *first, const axis_t *axis, int32_t change) {
  const int32_t step = fx_scale(1, (uint32_t)16 - axis->params.adc_bits);
  if (fx_within(first->force_start, axis->params.contact_force)) {
    return AXIS_FIRST_MOTION_RESULT_RUNNING;
  }
  if (change <= -step) {
    return AXIS_FIRST_MOTION_RESULT_FORCE_REVERSED;
  }
  if (change < step && !fx_within(axis->signals.force, axis->params.contact_force)) {
    /* The axis is not in contact now, so the remaining measured force is an offset of the force
     * sensor. */
    return AXIS_FIRST_MOTION_RESULT_FORCE_SENSOR_FAILED;
  }
  first->sign_seen = (change > axis->params.contact_force) ? 1 : 0;
  return AXIS_FIRST_MOTION_RESULT_RUNNING;
}

static uint8_t check_out(first_motion_t *first, const drive_params_t *params,
                         drive_signals_t *signals, const axis_t *axis) {
  const int32_t counts = fx_diff_wrap(axis->signals.position, first->start_cnt);
  const int32_t force = fx_diff_wrap(axis->signals.force, first->force_start);
  const bool negative = first->direction < 0;
  const int32_t moved = negative ? fx_diff_wrap(0, counts) : counts;
  const int32_t change = negative ? -force : force;
  signals->first_motion_moved = counts;
  signals->first_motion_code_reached = signed_code(first);
  signals->first_motion_force = force;
  if (runs_away(first, params, axis)) {
    return AXIS_FIRST_MOTION_RESULT_RUNAWAY;
  }
  if (moved <= -(int32_t)params->first_motion_counts ||
      (change < -axis->params.contact_force && moved < 0)) {
    return AXIS_FIRST_MOTION_RESULT_ENCODER_REVERSED;
  }
  if (change < -axis->params.contact_force) {
    return (moved > 0) ? AXIS_FIRST_MOTION_RESULT_FORCE_REVERSED
                       : AXIS_FIRST_MOTION_RESULT_NO_MOTION;
  }
  if (moved >= params->first_motion_counts) {
    first->phase = FIRST_MOTION_BACK;
    first->phase_tick = 0;
    return check_force(first, axis, change);
  }
  if (is_blocked(axis) && negative) {
    first->direction = 1;
    first->code = 0;
    return AXIS_FIRST_MOTION_RESULT_RUNNING;
  }
  return raise_code(first, params) ? AXIS_FIRST_MOTION_RESULT_RUNNING
                                   : AXIS_FIRST_MOTION_RESULT_NO_MOTION;
}

static uint8_t check_back(first_motion_t *first, const drive_params_t *params, axis_t *axis) {
  const int32_t counts = fx_diff_wrap(axis->signals.position, first->start_cnt);
  const bool is_back = (first->direction < 0) ? counts >= 0 : counts <= 0;
  if (runs_away(first, params, axis)) {
    return AXIS_FIRST_MOTION_RESULT_RUNAWAY;
  }
  if (!is_back && !is_blocked(axis)) {
    const int32_t velocity = axis->signals.velocity;
    const bool returns = (first->direction < 0) ? velocity > 0 : velocity < 0;
    return returns || raise_code(first, params) ? AXIS_FIRST_MOTION_RESULT_RUNNING
                                                : AXIS_FIRST_MOTION_RESULT_NO_MOTION;
  }
  first->phase = (first->sign_seen != 0) ? FIRST_MOTION_DONE : FIRST_MOTION_WATCHING;
  forget_travel(first);
  /* After the test bumpless transfer acts, even if the next mode is open-loop mode. */
  axis->rebase = 1;
  return AXIS_FIRST_MOTION_RESULT_PASSED;
}

/* Checks the sign of the measured force: it must be positive when the axis presses on the
 * workpiece. */
static uint8_t check_contact(first_motion_t *first, const axis_t *axis) {
  const axis_signals_t *signals = &axis->signals;
  if (signals->active_mode == AXIS_MODE_DISABLED || signals->velocity <= 0 ||
      fx_within(signals->force, axis->params.contact_force)) {
    return AXIS_FIRST_MOTION_RESULT_PASSED;
  }
  first->phase = FIRST_MOTION_DONE;
  return (signals->force < 0) ? AXIS_FIRST_MOTION_RESULT_FORCE_REVERSED
                              : AXIS_FIRST_MOTION_RESULT_PASSED;
}

void first_motion_check_running(first_motion_t *first, const drive_params_t *params,
                                drive_signals_t *signals, axis_t *axis, axis_outputs_t *outputs) {
  if (first->phase == FIRST_MOTION_COASTING) {
    coast(first, axis);
    return;
  }
  /* If the axis has a drive on a bus, the phase "zero" begins only when this drive is on. */
  const bool waits =
      first->phase == FIRST_MOTION_ZERO && axis->signals.active_mode == AXIS_MODE_DISABLED;
  if (axis->signals.fault != AXIS_FAULT_NONE || waits) {
    return;
  }
  uint8_t result = AXIS_FIRST_MOTION_RESULT_RUNNING;
  switch (first->phase) {
    case FIRST_MOTION_STANDING:
      result = check_standstill(first, params, axis);
      break;
    case FIRST_MOTION_ZERO:
      result = check_zero(first, params, axis);
      break;
    case FIRST_MOTION_OUT:
      result = check_out(first, params, signals, axis);
      break;
    case FIRST_MOTION_BACK:
      result = check_back(first, params, axis);
      break;
    default:
      result = check_contact(first, axis);
      break;
  }
  signals->first_motion_result = result;
  if (result > AXIS_FIRST_MOTION_RESULT_PASSED) {
    conclude(first, signals, result);
    axis_trip(axis, (uint8_t)(result + FAULT_OF_RESULT), outputs);
  }
}
