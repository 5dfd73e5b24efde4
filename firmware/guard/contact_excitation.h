#ifndef FIRMWARE_GUARD_CONTACT_EXCITATION_H_
#define FIRMWARE_GUARD_CONTACT_EXCITATION_H_

/* Excitation in a closed force mode, for measurements of an axis in contact. The waveform of
 * excitation.h is added to the output of the force law or to its set-point.
 *
 * A command starts the excitation in force mode 4, 10 or -1 while the axis is in contact. The first
 * value of the waveform acts in the next tick. During the time excitation_ramp the amplitude rises;
 * after the stop command the amplitude falls during the same time. The excitation ends in the same
 * tick if the measured force is outside excitation_force_min..excitation_force_max, if contact is
 * lost, or if the distance from the start position exceeds excitation_travel. The firmware checks
 * these conditions with the inputs of a tick before the output of this tick, so the excitation is
 * not added any more in this tick. The excitation also ends when the axis is disabled, halted or
 * stopped, when its mode changes, and when it has a fault. In a tick that detects a fault the DAC
 * code is 0 anyway. The loss of the owner ends the excitation for every value of
 * abort_connection_option.
 *
 * excitation_value is the value that was added in the last tick, in 1/256 code or in 1/256 count of
 * measured force. Between two ticks the parameters of the axis have the values that the user has
 * written.*/

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/objects/generated/axis_objects_drive.h"

typedef struct {
  /* value of the excitation for the next tick. The inputs of the next tick may still end the
   * excitation before the value is used */
  int32_t value_q8;
  /* factor of the amplitude ramp, 0 to 1, with which the amplitude of the excitation is multiplied
   * in this tick */
  int32_t level_q30;
  int32_t step_q30;  /* change of the ramp factor level_q30 in each tick */
  int32_t start_cnt; /* encoder count at the start of the excitation */
  uint8_t begins;    /* 1 if the next value of the excitation is the first value of its waveform */
} contact_excitation_t;

/* Returns true if an excitation is active in a force mode. */
static inline bool contact_excitation_is_active(const drive_signals_t *signals) {
  return signals->excitation_state >= AXIS_EXCITATION_STATE_RAMPING_DOWN;
}

/* Reacts to a write to excitation_run. `permitted` is true if the drive is in a mode that permits
 * excitation. Returns FW_OK or FW_ERROR_STATE. After a refusal excitation_state gives the reason,
 * unless an excitation is active: then excitation_state does not change. */
int contact_excitation_command(contact_excitation_t *excitation, const drive_params_t *params,
                               drive_signals_t *signals, const axis_t *axis, bool start,
                               bool permitted);

/* Ends an active excitation immediately. `reason` is an AXIS_EXCITATION_STATE_ value. */
void contact_excitation_end(contact_excitation_t *excitation, drive_signals_t *signals,
                            uint8_t reason);

/* The three steps of a tick with an active excitation. contact_excitation_prepare() computes the
 * value of the excitation after the drive has set the mode of the axis. contact_excitation_add()
 * adds the value before axis_tick(), unless the inputs of the tick end the excitation.
 * contact_excitation_remove() removes the value after axis_tick(). */
void contact_excitation_prepare(contact_excitation_t *excitation, const drive_params_t *params,
                                drive_signals_t *signals, axis_t *axis, bool permitted);
void contact_excitation_add(contact_excitation_t *excitation, const drive_params_t *params,
                            drive_signals_t *signals, axis_t *axis, const axis_inputs_t *inputs);
void contact_excitation_remove(contact_excitation_t *excitation, const drive_params_t *params,
                               drive_signals_t *signals, axis_t *axis);

#endif
