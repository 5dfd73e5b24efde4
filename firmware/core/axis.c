#include "firmware/core/axis.h"

#include "firmware/core/faults.h"
#include "firmware/core/force_control.h"
#include "firmware/core/laws.h"
#include "firmware/core/limits.h"
#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/access.h"
#include "firmware/objects/value.h"

_Static_assert(sizeof(axis_t) <= 512, "state of an axis, parameters included");

/* Returns the velocity in counts per tick. The last position must be valid. A position that was
 * read p ticks after the last position gives the mean velocity of these p ticks. The remainder of
 * the division is added to the next velocity, so the sum of all velocities is the travel. If there
 * is no newer position, the velocity does not change. */
static int32_t mean_velocity(axis_t *axis, const axis_inputs_t *inputs) {
  fx_assert(axis->velocity_rest_cnt > -256 && axis->velocity_rest_cnt < 256);
  const int32_t moved_cnt = fx_diff_wrap(inputs->encoder_cnt, axis->signals.position);
  const int32_t ticks = 1 + axis->position_age - inputs->position_age;
  if (ticks == 1 && axis->velocity_rest_cnt == 0) {
    return moved_cnt;
  }
  return (ticks <= 0) ? axis->signals.velocity
                      : fx_mean(moved_cnt, ticks, &axis->velocity_rest_cnt);
}

/* Updates the signals that are computed directly from valid sensor values. */
static void measure(axis_t *restrict axis, const axis_inputs_t *restrict inputs) {
  const axis_params_t *params = &axis->params;
  axis_signals_t *signals = &axis->signals;
  if (axis->primed == 0) {
    signals->velocity = 0;
    axis->velocity_rest_cnt = 0;
  } else {
    signals->velocity = mean_velocity(axis, inputs);
  }
  axis->position_age = inputs->position_age;
  axis->force_age = inputs->force_age;
  axis->primed = 1;
  signals->position = inputs->encoder_cnt;
  signals->force_raw = inputs->adc_code[0];
  signals->current_raw = inputs->adc_code[1];
  signals->force = law_force_reading(inputs->adc_code[0], params->force_zero_code,
                                     params->force_sign, params->adc_bits, params->force_tare);
}

/* Sets the position set-point of this tick. The profile follows the position while position mode is
 * not active, and also in the first tick of position mode. The first tick of position mode may also
 * be the first tick of the axis, or the first tick with a valid encoder count. */
static void update_setpoint(axis_t *restrict axis, uint8_t mode) {
  axis_params_t *params = &axis->params;
  axis_signals_t *signals = &axis->signals;
  if (mode != AXIS_MODE_POSITION || signals->active_mode != AXIS_MODE_POSITION) {
    profile_set(&axis->profile, signals->position);
  }
  if (mode == AXIS_MODE_POSITION) {
    if (signals->active_mode != AXIS_MODE_POSITION) {
      if (axis->setpoint_new == 0) {
        params->position_setpoint = signals->position;
      }
      axis->setpoint_new = 0;
    }
    if (params->profile_enable == AXIS_PROFILE_ENABLE_TRAPEZOID) {
      profile_step(&axis->profile, params->position_setpoint, params->profile_velocity_max,
                   params->profile_acceleration_max);
    } else {
      profile_set(&axis->profile, params->position_setpoint);
    }
  }
  signals->profile_position = fx_cnt_from_q32(axis->profile.position_q32);
  signals->profile_velocity = axis->profile.velocity_q16;
  signals->position_error = fx_diff_wrap(signals->profile_position, signals->position);
}

/* Returns the command that the control law of a mode computes, in 1/65536 DAC code. */
static int32_t evaluate_law(axis_t *axis, uint8_t mode) {
  const axis_params_t *params = &axis->params;
  const axis_signals_t *signals = &axis->signals;
  switch (mode) {
    case AXIS_MODE_POSITION:
      return law_position(params->position_gain, params->velocity_gain, signals->position_error,
                          signals->velocity);
    case AXIS_MODE_FORCE:
      return force_control_step(axis);
    case AXIS_MODE_EXCITATION:
      return law_excitation(
          params->open_loop_code, params->excitation_amplitude,
          excitation_step(&axis->excitation, params, signals->active_mode != mode));
    default:
      return law_open_loop(params->open_loop_code);
  }
}

static void switch_off(axis_t *restrict axis, axis_outputs_t *restrict outputs) {
  axis->signals.active_mode = AXIS_MODE_DISABLED;
  axis->drive_wait_tick = 0;
  axis->brake_tick = 0;
  axis->rebase = 0;
  axis->bounded = 0;
  axis->signals.bump_bias = 0;
  axis->command_q16 = 0;
  axis->signals.command_code = 0;
  axis->signals.dac_code = 0;
  axis->signals.dac_fine = 0;
  axis->net_q16 = 0;
  axis->signals.limit_reason = AXIS_LIMIT_REASON_NONE;
  outputs->dac_code = 0;
  outputs->dac_fine = 0;
  outputs->amp_enable = 0;
  outputs->brake_release = 0;
}

static inline void put_out(axis_signals_t *signals, int32_t output_q16) {
  signals->dac_fine = (int16_t)fx_floor_shift(output_q16, 16 - AXIS_FINE_BITS);
  signals->dac_code = (int16_t)fx_code_from_q16(output_q16);
}

/* Outputs the DAC code of this tick and switches the amplifier on. */
static inline void switch_on(const axis_signals_t *restrict signals,
                             axis_outputs_t *restrict outputs) {
  outputs->dac_code = signals->dac_code;
  outputs->dac_fine = signals->dac_fine;
  outputs->amp_enable = 1;
}

/* Returns true if the axis was disabled without a fault and its brake has not engaged yet. */
static bool is_engaging(const axis_t *axis) {
  return axis->signals.fault == AXIS_FAULT_NONE &&
         axis->signals.active_mode != AXIS_MODE_DISABLED &&
         axis->brake_tick < axis->params.brake_engage_ticks;
}

/* Computes a tick in which the brake engages: the output is the output bias, which holds the weight
 * of the axis, and not the last command, which may press or move the axis. If the axis is enabled
 * again, bumpless transfer begins at the output bias. */
static void hold_for_brake(axis_t *restrict axis, uint8_t digital_inputs,
                           axis_outputs_t *restrict outputs) {
  axis_signals_t *signals = &axis->signals;
  const uint16_t brake_tick = axis->brake_tick;
  switch_off(axis, outputs);
  axis->brake_tick = (uint16_t)(brake_tick + 1);
  axis->rebase = 1;
  const int32_t output_q16 = limits_block(axis, digital_inputs, axis->bias_q16);
  put_out(signals, output_q16);
  signals->active_mode = AXIS_MODE_OPEN_LOOP;
  signals->command_code = signals->dac_code;
  switch_on(signals, outputs);
}

static void latch_fault(axis_t *axis, uint8_t fault) {
  if (axis->signals.fault == AXIS_FAULT_NONE) {
    axis->signals.fault = fault;
  }
  axis->params.mode = AXIS_MODE_DISABLED;
  axis->setpoint_new = 0;
}

/* Returns the mode whose control law is computed in this tick. If the result is disabled, also sets
 * the outputs to the safe state. Exceptions: while the axis waits until its drive on a bus is on,
 * and while its brake engages, the result is disabled, but the amplifier is on. */
static uint8_t begin_mode(axis_t *restrict axis, const axis_inputs_t *restrict inputs,
                          axis_outputs_t *restrict outputs) {
  /* A change from any mode to any other mode is permitted, because it is bumpless. */
  const uint8_t mode =
      (axis->signals.fault != AXIS_FAULT_NONE) ? (uint8_t)AXIS_MODE_DISABLED : axis->params.mode;
  const uint8_t reports = inputs->drive | inputs->position_age | inputs->force_age;
  const bool waits = axis_drive_is_off(inputs->drive);
  update_setpoint(axis, waits ? (uint8_t)AXIS_MODE_DISABLED : mode);
  if (mode == AXIS_MODE_DISABLED && !is_engaging(axis)) {
    switch_off(axis, outputs);
    return mode;
  }
  uint8_t fault = fault_detect(&axis->params, &axis->signals, inputs);
  if (fault == AXIS_FAULT_NONE && reports != 0) {
    fault = fault_detect_drive(axis, inputs);
  }
  if (fault != AXIS_FAULT_NONE) {
    latch_fault(axis, fault);
    switch_off(axis, outputs);
    return AXIS_MODE_DISABLED;
  }
  if (waits) {
    const uint16_t waited = axis->drive_wait_tick;
    switch_off(axis, outputs);
    axis->drive_wait_tick = (uint16_t)(waited + 1);
    outputs->amp_enable = 1;
    return AXIS_MODE_DISABLED;
  }
  if (mode == AXIS_MODE_DISABLED) {
    hold_for_brake(axis, inputs->din, outputs);
    return AXIS_MODE_DISABLED;
  }
  axis->brake_tick = 0;
  return mode;
}

/* Asserts the invariants after each tick: the output is within output_limit, a disabled axis has
 * output 0 and a closed brake, and an axis with a fault is disabled. */
static inline void assert_after_tick(const axis_t *axis, const axis_outputs_t *outputs) {
  const axis_params_t *params = &axis->params;
  const axis_signals_t *signals = &axis->signals;
  const int32_t fine = outputs->dac_fine;
  fx_assert(fx_within(fine, fx_scale(params->output_limit, AXIS_FINE_BITS)));
  fx_assert(outputs->dac_code == fx_code_from_q16(fx_scale(fine, 16 - AXIS_FINE_BITS)));
  if (signals->active_mode == AXIS_MODE_DISABLED) {
    fx_assert(fine == 0 && outputs->brake_release == 0);
  }
  if (signals->fault != AXIS_FAULT_NONE) {
    fx_assert(signals->active_mode == AXIS_MODE_DISABLED && outputs->amp_enable == 0);
  }
  fx_assert(signals->active_mode < AXIS_MODE_COUNT);
  fx_assert(signals->limit_reason < AXIS_LIMIT_REASON_COUNT);
  fx_assert(axis->step_mask == fx_step_mask(params->dac_bits));
  fx_assert((axis->bias_q16 & ~axis->step_mask) == 0 &&
            fx_magnitude(axis->bias_q16) <= UINT32_C(1024) * 65536);
  fx_assert(axis->bounded <= AXIS_BOUNDED_TICKS);
  fx_assert(axis->law.bank.sections <= FORCE_LAW_SECTIONS);
  fx_assert(fx_within(axis->profile.velocity_q16, INT32_C(134217728)));
}

/* Sets the output of this tick from a command in 1/65536 code. The limits use the sensor values of
 * this tick. */
static inline void set_output(axis_t *restrict axis, uint8_t digital_inputs, int32_t due_q16) {
  axis_signals_t *signals = &axis->signals;
  const int32_t output_q16 = limits_apply(axis, digital_inputs, due_q16);
  put_out(signals, output_q16);
}

void axis_tick(axis_t *restrict axis, const axis_inputs_t *restrict inputs,
               axis_outputs_t *restrict outputs) {
  const axis_params_t *params = &axis->params;
  axis_signals_t *signals = &axis->signals;
  signals->tick_count += 1;
  axis->fault_waits = 0;
  signals->digital_inputs = inputs->din;
  signals->drive_report = inputs->drive;

  if (inputs->sensor_valid == 0) {
    /* After a tick with invalid sensors the velocity is 0, because there is no valid previous
     * encoder count. */
    signals->velocity = 0;
    axis->primed = 0;
    latch_fault(axis, AXIS_FAULT_SENSOR_INVALID);
    switch_off(axis, outputs);
    assert_after_tick(axis, outputs);
    return;
  }
  measure(axis, inputs);

  const uint8_t mode = begin_mode(axis, inputs, outputs);
  if (mode == AXIS_MODE_DISABLED) {
    assert_after_tick(axis, outputs);
    return;
  }

  const int32_t law_q16 = evaluate_law(axis, mode);
  /* A command is limited in the tick in which it is output, even if it was computed one tick
   * earlier. */
  const bool late = params->latency_ticks != 0;
  signals->limit_reason = AXIS_LIMIT_REASON_NONE;
  if (late) {
    const int32_t due_q16 =
        (axis->bounded != 0) ? limits_bound_late(axis, axis->command_q16) : axis->command_q16;
    set_output(axis, inputs->din, due_q16);
  }
  /* At this point net_q16 still belongs to the output that was computed in the previous tick. */
  if (mode != signals->active_mode || axis->rebase != 0) {
    axis->bias_shift = params->bump_decay_shift;
    signals->bump_bias = (axis->bias_shift == 0) ? 0 : axis->net_q16 - law_q16;
    axis->rebase = 0;
  } else {
    signals->bump_bias = fx_decay(signals->bump_bias, axis->bias_shift);
  }
  signals->active_mode = mode;
  fx_assert(fx_magnitude(law_q16) <= UINT32_C(4098) * 65536 &&
            fx_magnitude(signals->bump_bias) <= UINT32_C(7170) * 65536);
  /* The limits change only the output. So command_code shows the command of the control law, even
   * if the drive gets this command one tick later. The magnitude of the law, with excitation, is
   * below 4098 codes, that of the bump bias below 7170 codes, and that of the output bias at most
   * 1024 codes. So their sum in 1/65536 code is within +-2^30. */
  const int32_t command_q16 = fx_round_to(law_q16 + signals->bump_bias, axis->step_mask);
  axis->command_q16 = command_q16;
  signals->command_code = (int16_t)fx_code_from_q16(command_q16 + axis->bias_q16);
  if (!late) {
    set_output(axis, inputs->din,
               (axis->bounded != 0) ? limits_bound(axis, command_q16) : command_q16);
  }
  limits_add_drive(inputs->drive, &signals->limit_reason);
  switch_on(signals, outputs);
  outputs->brake_release = 1;
  assert_after_tick(axis, outputs);
}

/* Computes the limits and the bias of the output from the parameters output_limit, output_bias and
 * dac_bits. */
static void derive_output(axis_t *axis) {
  const int32_t most_q16 = fx_scale(axis->params.output_limit, 16);
  axis->step_mask = fx_step_mask(axis->params.dac_bits);
  const int32_t bias_q16 =
      fx_round_to(fx_scale(axis->params.output_bias, 16 - AXIS_FINE_BITS), axis->step_mask);
  axis->bias_q16 = fx_clamp(bias_q16, -most_q16, most_q16);
}

void axis_init(axis_t *axis) {
  fx_clear(axis, sizeof(*axis));
  axis->free_codes = axis_codes_all();
  axis->law_codes = axis_codes_all();
  axis->late_codes = axis_codes_all();
  value_store_defaults(&axis->params, AXIS_BLOCK_AXIS_PARAMETER);
  value_store_defaults(&axis->signals, AXIS_BLOCK_AXIS_SIGNAL);
  derive_output(axis);
  profile_set(&axis->profile, 0);
}

/* Checks a new tare against tare_band. If tare_band is not 0, the tare cannot change while the axis
 * is enabled, and its magnitude never exceeds tare_band. */
static int check_tare(const axis_t *axis, int32_t value) {
  const int32_t band = axis->params.tare_band;
  if (band == 0) {
    return FW_OK;
  }
  if (axis->params.mode != AXIS_MODE_DISABLED || axis->signals.active_mode != AXIS_MODE_DISABLED) {
    return FW_ERROR_STATE;
  }
  return fx_within(value, band) ? FW_OK : FW_ERROR_RANGE;
}

int axis_check(const axis_t *axis, uint16_t object, int32_t value) {
  bool fits = true;
  switch (object) {
    case AXIS_OBJ_FORCE_TARE:
      return check_tare(axis, value);
    case AXIS_OBJ_POSITION_MIN:
      fits = value <= axis->params.position_max;
      break;
    case AXIS_OBJ_POSITION_MAX:
      fits = value >= axis->params.position_min;
      break;
    default:
      break;
  }
  return fits ? FW_OK : FW_ERROR_RANGE;
}

void axis_output_loaded(axis_t *axis, uint8_t most) {
  if (axis->params.dac_bits > most) {
    axis->params.dac_bits = most;
  }
  derive_output(axis);
}

void axis_parameter_written(axis_t *axis, uint16_t object, int32_t previous, int32_t value) {
  const uint8_t mode = axis->signals.active_mode;
  switch (object) {
    case AXIS_OBJ_FORCE_GAIN:
      axis->rebase |=
          (uint8_t)(mode == AXIS_MODE_FORCE && axis->law.selected == 0 && value != previous);
      break;
    case AXIS_OBJ_POSITION_GAIN:
    case AXIS_OBJ_VELOCITY_GAIN:
      axis->rebase |= (uint8_t)(mode == AXIS_MODE_POSITION && value != previous);
      break;
    case AXIS_OBJ_DAC_BITS:
    case AXIS_OBJ_OUTPUT_LIMIT:
    case AXIS_OBJ_OUTPUT_BIAS:
      derive_output(axis);
      break;
    case AXIS_OBJ_POSITION_SETPOINT:
      axis->setpoint_new |=
          (uint8_t)(mode != AXIS_MODE_POSITION || axis->params.mode != AXIS_MODE_POSITION);
      break;
    default:
      break;
  }
}

/* Stores the halved gain in law->bank, so that a tick needs no additional instructions for the
 * halvings. */
static void halve_bank(force_law_t *law, uint8_t halvings) {
  law->halvings = halvings;
  law->bank.gain_q8 = fx_halved(law->whole_gain_q8, halvings);
}

void axis_bank_selected(axis_t *axis, uint8_t number) {
  fx_assert(number <= FORCE_LAW_BANKS && axis->law.bank.sections <= FORCE_LAW_SECTIONS);
  axis->law.selected = number;
  axis->law.whole_gain_q8 = axis->law.bank.gain_q8;
  halve_bank(&axis->law, axis->law.halvings);
  axis->rebase |= (uint8_t)(axis->signals.active_mode == AXIS_MODE_FORCE);
}

void axis_halve_force_gain(axis_t *axis, uint8_t halvings) {
  if (axis->law.halvings == 0) {
    axis->law.whole_gain_q8 = axis->law.bank.gain_q8;
  }
  halve_bank(&axis->law, halvings);
  axis->rebase |= (uint8_t)(axis->signals.active_mode == AXIS_MODE_FORCE);
}

void axis_fault(axis_t *axis, uint8_t fault) {
  fx_assert(fault > AXIS_FAULT_NONE && fault < AXIS_FAULT_COUNT);
  axis->fault_waits = 1;
  latch_fault(axis, fault);
}

void axis_trip(axis_t *axis, uint8_t fault, axis_outputs_t *outputs) {
  fx_assert(fault > AXIS_FAULT_NONE && fault < AXIS_FAULT_COUNT);
  latch_fault(axis, fault);
  switch_off(axis, outputs);
}

bool axis_fault_reset(axis_t *axis) {
  if (axis->fault_waits != 0) {
    return false;
  }
  axis->signals.fault = AXIS_FAULT_NONE;
  return true;
}
