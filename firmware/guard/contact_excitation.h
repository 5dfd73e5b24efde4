#ifndef FIRMWARE_GUARD_CONTACT_EXCITATION_H_
#define FIRMWARE_GUARD_CONTACT_EXCITATION_H_

/* Excitation in a closed force mode, for measurements of an axis in contact. The waveform of
 * excitation.h is added to the output of the force law or to its set-point.
 *
 * A command starts the excitation in force mode 4, 10 or -1 while the axis is in contact; it begins
 * in the next tick with the first value of the waveform. Its amplitude rises over the time
 * excitation_ramp, and the stop command reduces it over the same time. The excitation ends at once
 * if the measured force is outside excitation_force_min and _max, if contact is lost, or if the
 * position is further than excitation_travel from its start. These conditions are checked with the
 * inputs of a tick before its output, so nothing is added in that tick. The excitation also ends
 * with the mode: the axis is disabled, halted or stopped, changes its mode or has a fault; a fault
 * that the tick itself detects outputs code 0 anyway. The loss of the owner ends the excitation for
 * every value of abort_connection_option.
 *
 * excitation_value is the value added in the last tick, in 1/256 code or 1/256 count of measured
 * force. Between two ticks the parameters of the axis have the values of the user. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"

typedef struct {
  int32_t value_q8;  /* excitation of the next tick, which the inputs of that tick may still end */
  int32_t level_q30; /* present factor of the amplitude, 0 to 1 */
  int32_t step_q30;  /* change of the factor in a tick */
  int32_t start_cnt; /* encoder count at the start of the excitation */
  uint8_t begins;    /* 1: the next value is the first one of the waveform */
} contact_excitation_t;

/* Whether an excitation is active. */
static inline bool contact_excitation_is_active(const drive_signals_t *signals) {
  return signals->excitation_state >= AXIS_EXCITATION_STATE_RAMPING_DOWN;
}

/* Acts on a write to excitation_run. `permitted`: the drive is in a mode that permits excitation.
 * Returns FW_OK, or FW_ERROR_STATE with the reason in excitation_state; while an excitation is
 * active, excitation_state does not change. */
int contact_excitation_command(contact_excitation_t *excitation, const drive_params_t *params,
                               drive_signals_t *signals, const axis_t *axis, bool start,
                               bool permitted);

/* Ends an active excitation at once. `reason` is an AXIS_EXCITATION_STATE_. */
void contact_excitation_end(contact_excitation_t *excitation, drive_signals_t *signals,
                            uint8_t reason);

/* The three steps of a tick with an active excitation. The first computes the value, after the
 * drive has set the mode of the axis; the second adds it before axis_tick(), unless the inputs end
 * the excitation; the third removes it after axis_tick(). */
void contact_excitation_prepare(contact_excitation_t *excitation, const drive_params_t *params,
                                drive_signals_t *signals, axis_t *axis, bool permitted);
void contact_excitation_add(contact_excitation_t *excitation, const drive_params_t *params,
                            drive_signals_t *signals, axis_t *axis, const axis_inputs_t *inputs);
void contact_excitation_remove(contact_excitation_t *excitation, const drive_params_t *params,
                               drive_signals_t *signals, axis_t *axis);

#endif
