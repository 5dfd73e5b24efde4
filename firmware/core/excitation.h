#ifndef FIRMWARE_CORE_EXCITATION_H_
#define FIRMWARE_CORE_EXCITATION_H_

/* The waveform of excitation mode: noise, or a sine whose frequency may rise (a chirp), both able
 * to repeat themselves exactly, so that a measurement over whole periods has no leakage. Frequency
 * and amplitude may be written while it runs: the phase continues, which makes a stepped sine. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/generated/axis_objects.h"

typedef struct {
  uint32_t random;    /* state of the noise generator */
  uint32_t phase_q32; /* of the sine, turns */
  uint32_t swept_q32; /* what the sweep has added to the frequency, turns per tick modulo 1 */
  int32_t age_tick;   /* since the waveform started */
  uint16_t held_tick; /* that the noise's value stays */
} excitation_t;

/* The value of this tick, -32768..32767 of Q15; `start`: from the beginning. Every value of the
 * waveform follows from the excitation_ parameters, as they stood, and its age alone. */
int32_t excitation_step(excitation_t *excitation, const axis_params_t *params, bool start);

#endif
