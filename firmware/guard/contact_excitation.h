#ifndef FIRMWARE_GUARD_CONTACT_EXCITATION_H_
#define FIRMWARE_GUARD_CONTACT_EXCITATION_H_

/* Excitation inside a closed force mode, for measuring an axis in contact: the waveform of
 * excitation.h, added at the output of the force law or at its set-point.
 *
 * It is started by a command, in force mode 4, 10 or -1 and in contact, and begins in the next
 * tick with the first value of the waveform. Its amplitude rises over excitation_ramp; the stop
 * command lowers it in the same time. A reading outside excitation_force_min and _max, one without
 * contact, and a position further than excitation_travel from the start end it at once: they are
 * judged with the inputs of a tick before its output, so nothing is added in that tick. So does
 * the end of the mode: disabled, halted, stopped, another mode, a fault; a fault that the tick
 * itself finds puts out code 0 anyway. A lost owner ends it whatever abort_connection_option is.
 *
 * excitation_value is what was added in the last tick, 1/256 code or 1/256 count of the reading.
 * Between two ticks the axis' parameters are the user's. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"

typedef struct {
  int32_t value_q8;  /* of the coming tick, unless its inputs end the excitation */
  int32_t level_q30; /* of the amplitude */
  int32_t step_q30;  /* of the level in a tick */
  int32_t start_cnt; /* where it started */
  uint8_t begins;    /* 1: the coming value is the first one */
} contact_excitation_t;

/* Whether the waveform is being added. */
static inline bool contact_excitation_is_active(const drive_signals_t *signals) {
  return signals->excitation_state >= AXIS_EXCITATION_STATE_RAMPING_DOWN;
}

/* excitation_run was written; `permitted`: the drive is in a mode that may be excited. FW_OK, or
 * FW_ERROR_STATE with the reason in excitation_state, which stays while it is active. */
int contact_excitation_command(contact_excitation_t *excitation, const drive_params_t *params,
                               drive_signals_t *signals, const axis_t *axis, bool start,
                               bool permitted);

/* Ends it at once, if it is active: `reason` is an AXIS_EXCITATION_STATE_. */
void contact_excitation_end(contact_excitation_t *excitation, drive_signals_t *signals,
                            uint8_t reason);

/* The three steps of a tick while it is active: prepares the value once the drive has set the mode
 * of the axis; adds it, unless the inputs forbid it, before axis_tick(); takes it off after it. */
void contact_excitation_prepare(contact_excitation_t *excitation, const drive_params_t *params,
                                drive_signals_t *signals, axis_t *axis, bool permitted);
void contact_excitation_add(contact_excitation_t *excitation, const drive_params_t *params,
                            drive_signals_t *signals, axis_t *axis, const axis_inputs_t *inputs);
void contact_excitation_remove(contact_excitation_t *excitation, const drive_params_t *params,
                               drive_signals_t *signals, axis_t *axis);

#endif
