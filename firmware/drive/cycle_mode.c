#include "firmware/drive/cycle_mode.h"

#include <stddef.h>

#include "firmware/core/laws.h"
#include "firmware/drive/force_modes.h"
#include "firmware/drive/homing.h"
#include "firmware/drive/modes.h"
#include "firmware/drive/motion.h"
#include "firmware/drive/position_modes.h"
#include "firmware/drive/state.h"
#include "firmware/drive/units.h"
#include "firmware/fx/fx.h"

_Static_assert((AXIS_CYCLE_OUTPUTS_OUTPUT_1 | AXIS_CYCLE_OUTPUTS_OUTPUT_2 |
                AXIS_CYCLE_OUTPUTS_OUTPUT_3 | AXIS_CYCLE_OUTPUTS_OUTPUT_4) == CYCLE_OUTPUTS_ALL,
               "bits of cycle_outputs");

/* The modes of operation that carry out the phases of a cycle. */
static const cia402_mode_t moves = {.lead = position_profile,
                                    .shaped = 1,
                                    .reached = position_setpoint_reached,
                                    .bits = cia402_cycle_bits};
static const cia402_mode_t approaches = {.lead = position_guarded_move,
                                         .shaped = 1,
                                         .reached = position_setpoint_reached,
                                         .bits = cia402_cycle_bits};
static const cia402_mode_t presses = {.run = force_profile,
                                      .controls_force = 1,
                                      .holds = CIA402_HOLDS_TARGET,
                                      .halts_itself = 1,
                                      .reached = force_target_reached,
                                      .bits = cia402_cycle_bits};
static const cia402_mode_t waits = {.lead = homing_run, .bits = cia402_cycle_bits};

static const cia402_mode_t *mode_of(uint8_t action) {
  switch (action) {
    case CYCLE_PRESS:
    case CYCLE_FOLLOW:
      return &presses;
    case CYCLE_APPROACH:
      return &approaches;
    case CYCLE_WAIT:
    case CYCLE_TARE:
    case CYCLE_OUTPUT:
      return &waits;
    default:
      return &moves;
  }
}

static cycle_inputs_t inputs_of(const cia402_t *drive, const axis_t *axis) {
  const cia402_mode_t *mode = drive->mode;
  const bool reached = drive->cycle.target == CYCLE_TARGET_BY_DRIVE && mode->reached != NULL &&
                       mode->reached(drive, axis);
  return (cycle_inputs_t){
      .tick = axis->signals.tick_count,
      .position = axis->signals.position,
      .force_q8 = axis->signals.force,
      .contact = drive->signals.contact,
      .reached = reached ? 1 : 0,
      .inputs = axis->signals.digital_inputs,
      .defects = cycle_sample_defects(drive->signals.force_saturated != 0, axis->force_age,
                                      axis->position_age, drive->params.cycle_age_max)};
}

/* Returns the position, in user units, from which the action of a phase measures its target
 * position. */
static int32_t base_of(const cia402_t *drive, const axis_t *axis, uint8_t action) {
  if (action == CYCLE_MOVE) {
    return 0;
  }
  int32_t count = axis->signals.position;
  if (action == CYCLE_MOVE_TO_DEPTH) {
    count = drive->cycle.zero_cnt;
  } else if (drive->tracking == CIA402_TRACKING_AXIS) {
    count = fx_cnt_from_q32(drive->trajectory.position_q32);
  }
  return cia402_user(drive, count);
}

/* Sets the range of the mean force with which a tare succeeds: the magnitude of the sum of this
 * mean and force_tare is at most tare_band. If tare_band is 0, every tare fails. */
static void begin_tare(cia402_t *drive, const axis_t *axis) {
  const int32_t band = (axis->params.tare_band == 0) ? -1 : axis->params.tare_band;
  drive->cycle.tare_least = -band - axis->params.force_tare;
  drive->cycle.tare_most = band - axis->params.force_tare;
}

/* Converts the offset that a tare has found to the unit of the demanded force, and stores the
 * result. */
static void take_offset(cia402_t *drive) {
  drive->cycle.tared = 0;
  drive->cycle_offset_q8 =
      fx_clamp(fx_ratio_apply(fx_scale(drive->cycle.offset_q8, 8), drive->force_of_reading, 0),
               -CYCLE_TABLE_Y_MAX, CYCLE_TABLE_Y_MAX);
}

/* Sets the mode and the targets of the phase that has begun. If the target position exceeds 32
 * bits, no axis can reach it: the function then ends the cycle as CYCLE_OVER_TRAVEL and returns
 * false. */
static bool begin_phase(cia402_t *drive, const axis_t *axis) {
  const cycle_phase_t *phase = cycle_phase(&drive->cycle);
  const cia402_mode_t *mode = mode_of(phase->action);
  const bool moves_to = mode == &moves || mode == &approaches;
  const int32_t base = moves_to ? base_of(drive, axis, phase->action) : 0;
  const int32_t place = fx_sum_wrap(base, phase->target);
  if ((place < base) != (phase->target < 0)) {
    cycle_end(&drive->cycle, CYCLE_OVER_TRAVEL);
    return false;
  }
  if (drive->cycle.tared != 0) {
    take_offset(drive);
  }
  if (phase->action == CYCLE_TARE) {
    begin_tare(drive, axis);
  }
  if (mode->run != drive->mode->run) {
    cia402_end_mode(drive);
    contact_guard_phase(&drive->guards.contact_guard, &drive->params, &drive->signals, axis,
                        mode->controls_force != 0);
  }
  drive->mode = mode;
  drive->setpoint = (cia402_setpoint_t){.position = place, .speed = phase->speed};
  drive->setpoint_active = moves_to ? 1 : 0;
  drive->setpoint_buffered = 0;
  drive->stopped_by_contact = 0;
  drive->reached_tick = 0;
  return true;
}

/* Returns true if the cycle program contains absolute positions. They are measured from the
 * reference position of the axis. */
static bool needs_reference(const cycle_header_t *program) {
  if (program->zero == CYCLE_ZERO_POSITION) {
    return true;
  }
  for (uint8_t i = 0; i < program->phases; i++) {
    if (cycle_phases(program)[i].action == CYCLE_MOVE) {
      return true;
    }
  }
  return false;
}

static int32_t reading_of(const axis_params_t *params, uint16_t code) {
  return law_force_reading(code, params->force_zero_code, params->force_sign, params->adc_bits,
                           params->force_tare);
}

/* Returns true if a force of a program is at or beyond an end of the range of the force sensor
 * (sensor_is_railed()). No valid sample can have such a force. force_max is compared with the end
 * of the range in compression. If the range ends at force 0 there, because the sensor measures only
 * tension, force_max is compared with the end of the range in tension. */
static bool is_beyond_sensor(const axis_params_t *params, const cycle_reach_t *reach) {
  const bool rises = params->force_sign > 0;
  const uint16_t last = fx_highest_code(params->adc_bits);
  const int32_t most_q8 = reading_of(params, rises ? last : 0);
  const int32_t least_q8 = reading_of(params, rises ? 0 : last);
  const bool has_zero_within = params->force_zero_code != 0;
  if ((rises || has_zero_within) && (reach->most_q8 >= most_q8 || reach->force_max_q8 >= most_q8)) {
    return true;
  }
  return (!rises || has_zero_within) &&
         (reach->least_q8 <= least_q8 ||
          (!rises && !has_zero_within && -reach->force_max_q8 <= least_q8));
}

/* Returns the reason why no cycle can start (AXIS_CYCLE_STATE_), or AXIS_CYCLE_STATE_IDLE if a
 * cycle can start. */
static uint8_t refusal_of(const cia402_t *drive, const axis_t *axis) {
  const cycle_header_t *program = drive->program;
  if (program == NULL) {
    return AXIS_CYCLE_STATE_NO_PROGRAM;
  }
  if ((drive->params.controlword & AXIS_CONTROLWORD_HALT) != 0) {
    return AXIS_CYCLE_STATE_HALTED;
  }
  if (program->bank_crc != 0 && program->bank_crc != cycle_mode_bank(drive)) {
    return AXIS_CYCLE_STATE_OTHER_BANK;
  }
  if (needs_reference(program) && drive->homed == 0) {
    return AXIS_CYCLE_STATE_NOT_HOMED;
  }
  return is_beyond_sensor(&axis->params, &drive->cycle.reach)
             ? (uint8_t)AXIS_CYCLE_STATE_BEYOND_SENSOR
             : drive->cycle_lock;
}

bool cycle_mode_can_start(const cia402_t *drive, const axis_t *axis) {
  return drive->signals.modes_of_operation_display == AXIS_MODES_OF_OPERATION_CYCLE &&
         drive->signals.drive_state == AXIS_DRIVE_STATE_OPERATION_ENABLED && drive->leaving == 0 &&
         !cycle_mode_is_busy(drive) && refusal_of(drive, axis) == AXIS_CYCLE_STATE_IDLE;
}

bool cycle_mode_select(cia402_t *drive, const cycle_header_t *program) {
  if (cycle_mode_is_busy(drive)) {
    return false;
  }
  drive->program = program;
  cycle_select(&drive->cycle, program);
  drive->cycle_refusal = AXIS_CYCLE_STATE_IDLE;
  return true;
}

void cycle_mode_moved(cia402_t *drive, const cycle_header_t *program) {
  drive->program = program;
  if (drive->cycle.program != NULL) {
    drive->cycle.program = program;
  }
}

void cycle_mode_start(cia402_t *drive, const axis_t *axis) {
  drive->cycle_refusal = refusal_of(drive, axis);
  if (drive->cycle_refusal == AXIS_CYCLE_STATE_IDLE) {
    const cycle_inputs_t now = inputs_of(drive, axis);
    cycle_start(&drive->cycle, drive->program, &now,
                cia402_encoder(drive, drive->program->zero_level));
    drive->cycle_offset_q8 = 0;
    drive->cycle_bank_crc = cycle_mode_bank(drive);
    drive->signals.cycle_count += 1;
    guards_start(&drive->guards, &drive->signals);
    if (!begin_phase(drive, axis)) {
      cia402_leave_mode(drive);
    }
  }
  cia402_show_cycle(drive);
}

void cycle_mode_change(cia402_t *drive) {
  if (cycle_is_running(&drive->cycle)) {
    cycle_end(&drive->cycle, CYCLE_CHANGED);
    cia402_leave_mode(drive);
    cia402_show_cycle(drive);
  }
}

void cycle_mode_interrupt(cia402_t *drive) {
  if (cycle_is_running(&drive->cycle)) {
    cia402_leave_mode(drive);
  }
}

/* Returns true if the axis no longer follows the cycle: a ramp or a halt stops the axis, the mode
 * of operation changes, or the contact guard has detected a fault that acts in the next tick. */
static bool is_stopping(const cia402_t *drive) {
  return drive->leaving != 0 || contact_guard_has_fault(&drive->guards.contact_guard) ||
         (drive->params.controlword & AXIS_CONTROLWORD_HALT) != 0 ||
         drive->params.modes_of_operation != drive->signals.modes_of_operation_display;
}

void cycle_mode_step(cia402_t *drive, const axis_t *axis) {
  if (is_stopping(drive)) {
    cycle_mode_interrupt(drive);
    return;
  }
  const cycle_inputs_t now = inputs_of(drive, axis);
  if (cycle_step(&drive->cycle, &now)) {
    if (!cycle_is_running(&drive->cycle) || !begin_phase(drive, axis)) {
      cia402_leave_mode(drive);
    }
    cia402_show_cycle(drive);
  }
}

void cycle_mode_between(cia402_t *drive) {
  cycle_evaluate(&drive->cycle);
  cia402_show_cycle(drive);
}
